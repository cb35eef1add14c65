//! How much work a tolerance takes, and what error to expect of a picture.

use super::frame::{self, Effort};
use super::grid::Grid;
use super::horizon::Heights;
use super::traces;
use super::{Lamp, Precomputed, Renderer, Source};
use crate::optics::{Albedo, Material, Role};
use glam::Vec3;

impl Effort {
    /// What it takes, as a rule (found by experiment on the scenes of the tests).
    pub(super) fn for_tolerance(tolerance: f64) -> Self {
        // Few pixels have a shadow's edge: there an error may be larger.
        let [shadow, field] = [8.0, 0.2].map(|part| part * tolerance as f32);
        if tolerance >= COARSE {
            Self {
                cells: [2.0; 2],
                block_mm: 0.26,
                shadow_mm: 0.13,
                curved_mm: 0.04,
                shadow,
                field,
                fine: false,
                sparse: true,
                ..Self::FINEST
            }
        } else if tolerance >= 0.004 {
            Self { block_mm: 0.26, curved_mm: 0.02, shadow, field, ..Self::FINEST }
        } else {
            Self { shadow, field, ..Self::FINEST }
        }
    }

    /// What a picture takes whose error is above the tolerance at this effort; None where more would not make it smaller.
    fn finer(self) -> Option<Self> {
        let Self { bounce, thorough, shadow, field, .. } = self;
        (!self.fine).then(|| Self { bounce, thorough, shadow, field, ..Self::for_tolerance(MIDDLE) })
    }

    /// What it takes over a pad: sharp rims throw shadows all along.
    pub(super) fn over(self, heights: &Heights) -> Self {
        match heights.has_sharp_rims() {
            true if self.fine => Self { shadow: self.shadow * AT_RIMS, ..self },
            true => Self { sparse: false, ..self },
            false => self,
        }
    }

    const FINEST: Self = Self {
        cells: [1.1, 0.8],
        block_mm: 0.13,
        shadow_mm: 0.07,
        shadow: 0.0,
        field: 0.0,
        curved_mm: 0.01,
        fine: true,
        sparse: false,
        bounce: true,
        thorough: false,
    };
}

/// Beside sharp rims a shadow's edge may be wrong by this part of what it may be elsewhere.
const AT_RIMS: f32 = 0.25;
/// From this tolerance on the least effort will do, as a rule, and a tolerance that takes more.
const COARSE: f64 = 0.009;
const MIDDLE: f64 = 0.005;
/// A picture is rendered again where that takes its error to this part.
const WORTHWHILE: f64 = 0.9;

/// Error of a pad of one colour, and of a textured one, under one light, without anything of what follows: of several lights
/// each errs for itself.
const BASE_ERROR: [f64; 2] = [0.004, 0.0048];
/// What a plate adds, of an even picture: its light is solved by fewer rays than it takes. What it mirrors comes from the bright parts, so it
/// is more beside these, and grows faster than they do. (Behind a ring under one lamp, whose picture's rms is 1.87 times its mean, means are 1.2 % off.)
const PLATE_ERROR: f64 = 0.004;
/// What lamps between pad and plate add besides: they are seen mirrored, from places a millimetre apart. (A GelSight with a plate of
/// 2 mm, 6 mm over its pad, is 0.6 % off untouched, 640 x 480.)
const MIRRORED_ERROR: f64 = 0.0045;
/// What a curved face adds: what its press changes in the light of the walls is left out.
const CURVED_ERROR: f64 = 0.004;
/// What a tube adds: the wall behind it is lit more unevenly than patches resolve.
const TUBE_ERROR: f64 = 0.016;
/// What an angular profile adds, under one light: its field is interpolated between nodes, and bends more.
const PROFILE_ERROR: f64 = 0.007;
/// A picture's rms over its mean beyond which what every part of the light is off counts for more, so many times: a lamp of half a
/// millimetre, a millimetre off what is seen of the pad, lights a spot 78 times as bright as the mean, and all errors are there.
const UNEVEN: f64 = 2.0;
/// What a light adds beyond whose plane some of the pad is: pixels that the plane runs through are half lit.
const SIDED_ERROR: f64 = 0.006;
/// It counts as before the light at least this part of the pad.
const LEAST_FACED: f64 = 0.02;
/// What walls lose each time they send light on. Found by experiment: between walls of 0.95 over a coat of 0.9 a picture is 0.37 % too
/// dark after 8 events and 0.67 % after 64.
const LOST_ERROR: f64 = 4e-4;
/// Part of the bounce that is wrong or left out.
const BOUNCE_ERROR: f64 = 0.2;
/// Part of what the press changes in the light on walls and lamps in the view that is wrong or left out.
const GLOW_ERROR: f64 = 0.3;
/// Part of the light of walls that show that is wrong: each patch of theirs has its mean. (A camera that looks at the ceiling alone is
/// 0.8 % off; of one that looks askew into the corners, 0.68 %, it is 1.7 % of their light, of one that sees all walls far from
/// them 0.3 %.)
const WALLS_ERROR: f64 = 0.0175;
/// Error of a picture all of which shows as large flanks that send all their light to themselves. (Found by experiment: punches of 2.5 and
/// 3 mm in radius that are 0.9 to 1.5 mm high, upright and round as their lattice has them, are up to 0.2 % further off than the rest states.)
const NOTCHED_ERROR: f64 = 0.2;
/// Part of what walls give back of the press that is wrong.
const ECHO_ERROR: f64 = 0.25;
/// What steep flanks add, by the rms of |n - n0|^2 over the untouched normal n0: shadows' edges are interpolated between nodes.
/// Far more so where bent horizons are not followed finely: of the GelSight's 21 bodies 1 mm deep, sharp ones and round, that is 0.03
/// (torus) to 0.145 (parallel lines) of it, and no less of dots, which have no rims, than of a line.
const STEEP_ERROR: [f64; 2] = [0.01, 0.15];
/// What flanks add that face each other: by the square of the same, and by what there is of sharp rims, mm on a square millimetre, if
/// that is more. Light goes to and fro between them. (Parallel lines 0.5 and 1 mm deep are 0.49 and 0.90 % off.)
const GROOVE_ERROR: f64 = 0.08;
const RIMS_ERROR: f64 = 0.011;
/// The part of that which is left once what bounces was traced: light that comes straight through slits between flanks.
const STRAIGHT_PART: f64 = 0.5;
/// What a press adds that ends beyond the picture, for 1 mm all around: light bounces only once off flanks there. (A slab of 14 mm, 1 mm
/// deep, ends beyond the GelSight's view: 0.44 % off.)
const BEYOND_ERROR: f64 = 0.004;
/// What sharp rims add at least where bent horizons are not followed finely: a pin of 0.3 mm hardly counts among the flanks of a
/// face, and throws a shadow across it that is off by 0.6 to 0.8 % of the picture.
const RIM_ERROR: f64 = 0.0075;

/// What lights a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lit {
    /// The scene's lights.
    ByAll,
    /// One of them alone, white.
    By(usize),
}

impl Precomputed {
    /// How many lights of equal strength would be as many as those that light the untouched face.
    fn lights_in_effect(&self) -> f64 {
        let of_light = |(ground, radiance): (&Grid<3>, &Vec3)| {
            let sum: Vec3 = ground.parts().1.iter().map(|e| Vec3::from(*e)).sum();
            f64::from((sum * *radiance).element_sum())
        };
        // (The first is of all lights together.)
        let lights: Vec<f64> = self.grounds[1..].iter().zip(&self.radiances).map(of_light).collect();
        let squares: f64 = lights.iter().map(|e| e * e).sum();
        if squares > 0.0 { lights.iter().sum::<f64>().powi(2) / squares } else { 1.0 }
    }
}

impl Precomputed {
    fn has_lamps_below_plate(&self) -> bool {
        let lamps = || self.fixed_scene.lights.iter().filter_map(Lamp::new);
        self.view.slab.is_some_and(|slab| lamps().any(|lamp| slab.covers(lamp.center)))
    }

    /// How often light is sent on between walls before it is lost, were they all around.
    fn bounces_between_walls(&self) -> f64 {
        let (mut areas, mut reflected) = (0.0, 0.0);
        for surface in self.fixed_scene.surfaces.iter().filter(|s| s.role != Role::Plate) {
            let Material::Lambert { albedo } = &surface.material else { continue };
            let corners = (0..surface.mesh.triangles.len()).map(|k| surface.mesh.corners(k));
            let area: f32 = corners.map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
            if area == 0.0 {
                // (The pad is not among the fixed parts, and the mean of its texture takes time.)
                continue;
            }
            let albedo = match albedo {
                Albedo::Constant(albedo) => *albedo,
                Albedo::Texture(texture) => texture.mean(),
            };
            areas += f64::from(area);
            reflected += f64::from(area * albedo.max_element());
        }
        let albedo = if areas > 0.0 { reflected / areas } else { 0.0 };
        (1.0 - albedo).recip().min(f64::from(self.fixed_scene.max_events))
    }
}

impl Renderer<'_> {
    /// The same pad, rendered otherwise.
    pub(super) fn with_effort(&self, effort: Effort) -> Self {
        let heights = Heights::of(&self.mesh, self.lattice, effort.cells);
        Self {
            once: self.once,
            mesh: self.mesh.clone(),
            lattice: self.lattice,
            albedo: self.albedo.clone(),
            effort: effort.over(&heights),
            heights,
            tolerance: self.tolerance,
        }
    }

    /// Renders more finely what is expected to be above the tolerance, where that helps: once at most, so that a picture takes
    /// no more than about the time of two.
    pub(super) fn within_tolerance(
        &self,
        render: impl Fn(&Self) -> frame::Pictures,
    ) -> (frame::Pictures, Effort, f64) {
        let pictures = render(self);
        let error = self.estimated_error(&pictures, Lit::ByAll, &self.effort);
        let finer = self.effort.finer().filter(|_| error > self.tolerance);
        let is_worth_it =
            |effort: &Effort| self.estimated_error(&pictures, Lit::ByAll, effort) < WORTHWHILE * error;
        match finer.filter(is_worth_it) {
            Some(effort) => {
                let pictures = render(&self.with_effort(effort));
                let error = self.estimated_error(&pictures, Lit::ByAll, &effort);
                (pictures, effort, error)
            }
            None => (pictures, self.effort, error),
        }
    }

    /// No picture of this pad is expected to be off by less, lit by anything: by its sharp rims alone.
    pub(super) fn least_error(&self) -> f64 {
        RIMS_ERROR * f64::from(self.heights.rims_per_mm())
    }

    /// What relRMSE to expect. It follows from the picture itself: the light that flanks send each other is worked out with
    /// one bounce on a coarse raster, and a part of what that changed is taken for its error, as is a part of what walls
    /// give back; pixels over creases are means of a few pieces, and their variance tells the error of the mean. The
    /// constants were found by comparing with the reference (see the tests).
    pub(super) fn estimated_error(&self, pictures: &frame::Pictures, lit: Lit, effort: &Effort) -> f64 {
        self.error_but_for(pictures, lit, effort, None)
    }

    /// The same of a picture whose bounced light was traced, which is as far off as measured.
    pub(super) fn error_of_traced(&self, pictures: &frame::Pictures, effort: &Effort, measured: f64) -> f64 {
        self.error_but_for(pictures, Lit::ByAll, effort, Some(measured))
    }

    /// `traced` is the error of the bounced light, where that is known.
    fn error_but_for(
        &self,
        pictures: &frame::Pictures,
        lit: Lit,
        effort: &Effort,
        traced: Option<f64>,
    ) -> f64 {
        // A picture without any light is rightly black: of lights that are off, or of parts that reflect nothing.
        if self.mean_light(pictures, lit) == Vec3::ZERO {
            return 0.0;
        }
        let n = (pictures.films[0].pixels.len() * 3) as f64;
        let mean = f64::from(self.mean_light(pictures, lit).element_sum() / 3.0).max(1e-30);
        let of = |numbers: &[f64]| match lit {
            Lit::ByAll => traces::of_sum(numbers),
            Lit::By(light) => numbers[light],
        };
        let shines = |light: usize| lit == Lit::ByAll || lit == Lit::By(light);
        let lights_in_effect = if lit == Lit::ByAll { self.once.lights_in_effect() } else { 1.0 };
        let bounce = traced.unwrap_or(BOUNCE_ERROR * (of(&pictures.bounced) / n).sqrt() / mean);
        let spread = (of(&pictures.spread) / n).sqrt() / mean;
        let glow = GLOW_ERROR * (of(&pictures.glowed) / n).sqrt() / mean;
        let feet = (of(&pictures.feet) / n).sqrt() / mean;
        let walls = WALLS_ERROR * (of(&pictures.walls) / n).sqrt() / mean;
        let base = BASE_ERROR[usize::from(matches!(self.albedo, Albedo::Texture(_)))];
        let base = base / lights_in_effect.sqrt();
        let notched = NOTCHED_ERROR * pictures.notched;
        let echo = ECHO_ERROR * of(&pictures.echoed).sqrt();
        let steep = STEEP_ERROR[usize::from(!effort.fine)] * pictures.steepness;
        let rims = if !effort.fine && self.heights.has_sharp_rims() { RIM_ERROR } else { 0.0 };
        let steep = steep.max(rims);
        let groove = GROOVE_ERROR * pictures.steepness * pictures.steepness;
        let groove = groove.max(self.least_error());
        let groove = if traced.is_some() { STRAIGHT_PART * groove } else { groove };
        let beyond = BEYOND_ERROR * pictures.border_mm;
        let bounces = self.once.bounces_between_walls();
        let plate = match self.once.view.slab {
            Some(_) => PLATE_ERROR * self.contrast(pictures, lit).max(1.0).powf(1.5),
            None => 0.0,
        };
        let mirrored = if self.once.has_lamps_below_plate() { MIRRORED_ERROR } else { 0.0 };
        let curved = if self.once.total.parts().0.is_curved() { CURVED_ERROR } else { 0.0 };
        let sources = || self.once.sources.iter().enumerate().filter(|(l, _)| shines(*l)).map(|(_, s)| s);
        let tube = if sources().any(Source::is_tube) { TUBE_ERROR } else { 0.0 };
        let profile = if sources().any(|s| s.angular().is_some()) { PROFILE_ERROR } else { 0.0 };
        let profile = profile / lights_in_effect.sqrt();
        let uneven = (self.rms(pictures, lit) / mean / UNEVEN).max(1.0);
        let [base, tube, profile] = [base, tube, profile].map(|part| part * uneven);
        let lost = LOST_ERROR * bounces;
        // (Where one light leaves most of the picture dark, the same is more of what is left.)
        let sided = pictures.sided.iter().filter(|(l, _)| shines(*l)).map(|(_, faced)| *faced);
        let sided = sided.reduce(f64::min).map_or(0.0, |faced| {
            let dark = (0.5 / faced.max(LEAST_FACED)).max(1.0) - 1.0;
            SIDED_ERROR * (1.0 + dark / lights_in_effect)
        });
        [
            base, bounce, glow, feet, walls, echo, spread, steep, groove, beyond, plate, mirrored, tube,
            curved, profile, lost, sided, notched,
        ]
        .iter()
        .map(|e| e * e)
        .sum::<f64>()
        .sqrt()
    }

    /// Root mean square over pixels and channels of a picture.
    fn rms(&self, pictures: &frame::Pictures, lit: Lit) -> f64 {
        let n = pictures.films[0].pixels.len();
        let squares = (0..n).map(|k| f64::from(self.light(pictures, lit, k).length_squared()));
        (squares.sum::<f64>() / (3 * n) as f64).sqrt()
    }

    /// How uneven a picture is, whatever its colours: its rms over its mean, of what the channels have together.
    fn contrast(&self, pictures: &frame::Pictures, lit: Lit) -> f64 {
        let n = pictures.films[0].pixels.len();
        let greys = || (0..n).map(|k| f64::from(self.light(pictures, lit, k).element_sum()));
        let squares: f64 = greys().map(|grey| grey * grey).sum();
        (squares * n as f64).sqrt() / greys().sum::<f64>().max(1e-30)
    }

    /// The light of a pixel.
    fn light(&self, pictures: &frame::Pictures, lit: Lit, k: usize) -> Vec3 {
        let films = &pictures.films;
        match (&films[..], lit) {
            ([one], _) => one.pixels[k],
            (many, Lit::By(light)) => many[light].pixels[k],
            (many, Lit::ByAll) => {
                many.iter().zip(&self.once.radiances).map(|(film, radiance)| film.pixels[k] * *radiance).sum()
            }
        }
    }

    /// Mean over the pixels of a picture.
    fn mean_light(&self, pictures: &frame::Pictures, lit: Lit) -> Vec3 {
        match (&pictures.means[..], lit) {
            ([one], _) => *one,
            (means, Lit::By(light)) => means[light],
            (means, Lit::ByAll) => {
                means.iter().zip(&self.once.radiances).map(|(mean, radiance)| *mean * *radiance).sum()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ONCE, punch, scene};
    use super::*;
    use crate::optics::Scene;
    use crate::optics::bench_scene::Variant;

    #[test]
    fn as_many_lights_count_as_shine() {
        let all = ONCE.lights_in_effect();
        assert!((3.0..4.0).contains(&all), "{all}");
        let radiances: Vec<Vec3> = (0..4).map(|l| if l == 2 { Vec3::ONE } else { Vec3::ZERO }).collect();
        assert!((ONCE.with_radiances(&radiances).unwrap().lights_in_effect() - 1.0).abs() < 1e-9);
    }

    /// What the help of `render --tolerance` says.
    #[test]
    fn however_little_is_asked_for_no_less_is_stated_than_what_work_does_not_change() {
        let scene = scene(Variant::Ac, |_, _| 0.0);
        let (_, stated) = Renderer::new(&ONCE, &scene, 1e-4).unwrap().basis_with_error();
        assert!((0.002..0.003).contains(&stated.together), "{}", stated.together);
        assert!(stated.lights.iter().all(|error| (0.004..0.005).contains(error)), "{:?}", stated.lights);
    }

    #[test]
    fn a_picture_without_light_is_black_for_certain() {
        let mut dark = scene(Variant::Ac, |_, _| 0.0);
        dark.lights.iter_mut().for_each(|light| light.radiance = Vec3::ZERO);
        let once = Precomputed::new(&dark).unwrap();
        let (image, stated) = Renderer::new(&once, &dark, 0.005).unwrap().render_with_error();
        assert!(image.pixels.iter().all(|light| *light == Vec3::ZERO));
        assert_eq!(stated, 0.0);
    }

    #[test]
    fn bright_walls_and_profiles_are_told() {
        let stated = |change: fn(&mut Scene)| {
            let mut scene = scene(Variant::Ac, |_, _| 0.0);
            change(&mut scene);
            let once = Precomputed::new(&scene).unwrap();
            Renderer::new(&once, &scene, 0.005).unwrap().render_with_error().1
        };
        let usual = stated(|_| ());
        let profiled = stated(|s| s.lights.iter_mut().for_each(|l| l.cosine_power = 4.0));
        let bright = stated(|s| {
            for surface in s.surfaces.iter_mut().filter(|s| s.role != Role::Pad) {
                surface.material = Material::Lambert { albedo: Albedo::Constant(Vec3::splat(0.95)) };
            }
        });
        assert!(profiled > 1.5 * usual && bright > 1.1 * usual, "{usual} {profiled} {bright}");
    }

    /// Dots as they are pressed into a pad: steep all around, and no rim is sharp.
    fn dots(x: f32, y: f32) -> f32 {
        let from_middle = |at: f32| at - 3.0 * (at / 3.0).round().clamp(-1.0, 1.0);
        let radius = from_middle(x).hypot(from_middle(y));
        1.0 / (1.0 + ((radius - 0.75) / 0.1).exp())
    }

    #[test]
    fn a_quick_picture_of_steep_flanks_states_what_a_thorough_one_would_change() {
        for face in [dots, |x: f32, _: f32| dots(x, 0.0)] {
            let scene = scene(Variant::Ac, face);
            let at = |tolerance: f64| Renderer::new(&ONCE, &scene, tolerance).unwrap().render_with_error();
            let ((quick, stated), (thorough, _)) = (at(0.5), at(0.004));
            let off = quick.relative_rmse(&thorough);
            assert!(off > 0.005 && off < stated, "{off} {stated}");
        }
    }

    #[test]
    fn a_picture_above_its_tolerance_is_rendered_again_where_that_helps() {
        let scene = scene(Variant::Ac, punch);
        let at = |tolerance: f64| Renderer::new(&ONCE, &scene, tolerance).unwrap();
        let estimated = |r: &Renderer| r.estimated_error(&r.pictures(1), Lit::ByAll, &r.effort);
        let coarse = at(0.0095);
        let before = estimated(&coarse);
        let (film, error) = coarse.render_with_error();
        assert!(before > 0.0095 && error < 0.0095, "{before} {error}");
        assert_ne!(film, coarse.pictures(1).films[0]);
        // One that is within its tolerance, and one that more work makes no better, are left as they are.
        for renderer in [at(1.1 * before), at(0.003)] {
            assert_eq!(
                renderer.render_with_error(),
                (renderer.pictures(1).films.swap_remove(0), estimated(&renderer))
            );
        }
        assert!(at(0.003).render_with_error().1 > 0.003);
    }
}
