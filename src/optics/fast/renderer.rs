//! One pad under a prepared sensor: what a frame needs anew, and its pictures.

use super::estimate::Lit;
use super::frame::{self, Effort, Frame};
use super::horizon::Heights;
use super::raster::{self, Projected};
use super::slots::Slots;
use super::source::{LINES, MOST_LINES};
use super::suited::{
    lattice_of, lights_clear_of_press, lights_off_face, lit_from_within, pad_of, same_but_pad_mesh,
    unsupported,
};
use super::traced::Traced;
use super::view::View;
use super::{DIRECT_LIFT_MM, Precomputed};
use crate::optics::basis::{BasisError, LightBasis};
use crate::optics::reference::Sight;
use crate::optics::{Albedo, Error, Film, Material, Mesh, Scene, to_pad};
use crate::wakeful::wakeful;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A picture whose error is this many times the tolerance has its bounced light traced, where flanks face each other.
const TRACED_FROM: f64 = 1.6;

/// A face that a press has lifted by more may be too near to a light that the untouched one is clear of, mm.
const LIFTED_MM: f32 = 0.1;

/// A pad as the prepared sensor sees it.
pub struct Renderer<'a> {
    pub(super) once: &'a Precomputed,
    pub(super) mesh: Arc<Mesh>,
    pub(super) lattice: [usize; 2],
    pub(super) albedo: Albedo,
    pub(super) heights: Heights,
    pub(super) effort: Effort,
    pub(super) tolerance: f64,
}

impl<'a> Renderer<'a> {
    /// Makes the scene's pad ready. `tolerance` is the relRMSE asked for.
    ///
    /// # Errors
    /// When anything but the pad's mesh differs from what was prepared, or the mesh is none for this mode.
    pub fn new(once: &'a Precomputed, scene: &Scene, tolerance: f64) -> Result<Self, Error> {
        wakeful(|| Self::over(once, scene, tolerance))
    }

    fn over(once: &'a Precomputed, scene: &Scene, tolerance: f64) -> Result<Self, Error> {
        if !(tolerance > 0.0 && tolerance <= 1.0) {
            return Err(Error::Setting {
                key: "tolerance",
                value: tolerance.to_string(),
                why: "it is a relative error above 0 and up to 1, e.g. 0.005".to_owned(),
            });
        }
        let pad = pad_of(scene)?;
        if !same_but_pad_mesh(scene, &once.fixed_scene) {
            return Err(Error::Setting {
                key: "mode",
                value: "fast".to_owned(),
                why: "more than the pad's mesh has changed since the sensor was prepared; prepare it anew"
                    .to_owned(),
            });
        }
        let Material::Lambert { albedo } = &pad.material else {
            return Err(unsupported("coating", pad.material.kind(), "diffuse coatings only"));
        };
        if matches!(albedo, Albedo::Texture(_)) && pad.mesh.uvs.is_empty() {
            return Err(Error::Scene {
                part: pad.name.clone(),
                what: "it has a texture, but its mesh has no texture coordinates".to_owned(),
                next: "give the mesh one coordinate a vertex, or use a constant albedo".to_owned(),
            });
        }
        let lattice = lattice_of(&pad.mesh)?;
        let p = &pad.mesh.positions;
        if !p.par_iter().with_min_len(65_536).all(|p| p.is_finite()) {
            // The full check names the vertex.
            pad.mesh.check(&pad.name)?;
        }
        let lift = p.iter().step_by(1 + p.len() / 4096).map(|p| once.total.lift(*p));
        let [low, high] = lift.fold([0.0f32; 2], |[l, h], lift| [l.min(lift), h.max(lift)]);
        if low < 2.0 * DIRECT_LIFT_MM[0] || high > DIRECT_LIFT_MM[1] {
            let value = format!("{low} to {high} mm above its untouched face");
            return Err(unsupported("pad", &value, "pads that move by -1.5 to 3 mm"));
        }
        let mut effort = Effort::for_tolerance(tolerance);
        // Without interreflection there is no bounce to look for.
        let dark = matches!(albedo, Albedo::Constant(a) if *a == Vec3::ZERO);
        effort.bounce = scene.max_events > 1 && !dark;
        let heights = Heights::of(&pad.mesh, lattice, effort.cells);
        let effort = effort.over(&heights);
        let (lights, view, extent, face) =
            (&scene.lights, &once.view, heights.extent(), |p: Vec2| heights.at(p));
        lit_from_within(scene, extent, face)?;
        // (Where it has hardly moved the untouched face has told, and a black pad sends nothing on.)
        let is_lifted = |p: Vec2, z: f32| !dark && once.total.lift(p.extend(z)) > LIFTED_MM;
        lights_clear_of_press(lights, extent, |p| Some(face(p)).filter(|z| is_lifted(p, *z)))?;
        lights_off_face(lights, view, once.pixel_mm, extent, face)?;
        Ok(Self { once, mesh: pad.mesh.clone(), lattice, albedo: albedo.clone(), heights, effort, tolerance })
    }

    /// Tests for shadows where no light can be hidden, too. For measuring what leaving that out saves.
    pub fn thorough(mut self) -> Self {
        self.effort.thorough = true;
        self
    }

    /// Looks for what bounces where nothing does, too. For measuring what leaving that out saves.
    pub fn bouncing(mut self) -> Self {
        self.effort.bounce = true;
        self
    }

    /// The vertices in a raster of pixels.
    fn projected(&self) -> Vec<Vec3> {
        let positions = self.mesh.positions.par_iter().with_min_len(4096);
        positions.map(|p| self.once.view.project(*p)).collect()
    }

    /// What the centre of each pixel sees of the pad's face, row 0 on top; None where something else is in the way.
    pub fn sights(&self) -> Vec<Option<Sight>> {
        let view = &self.once.view;
        let grain = self.once.grain;
        let (width, height) = (view.camera.width / grain, view.camera.height / grain);
        let mut vertices = self.projected();
        let share = 1.0 / grain as f32;
        vertices.par_iter_mut().with_min_len(4096).for_each(|v| *v *= Vec3::new(share, share, 1.0));
        let samples =
            Projected { lattice: self.lattice, vertices: &vertices, offset: 0.5 }.draw(width, height);
        let sight = |(k, sample): (usize, &raster::Sample)| {
            let (x, y) = (k % width, k / width);
            // The fixed part at the corner at the middle, or below and to the right of it.
            let corner = [x, y].map(|c| c * grain + grain.div_ceil(2));
            let hidden = self.once.fixed(corner[0], corner[1]).is_some_and(|value| value > sample.value);
            if sample.triangle == u32::MAX || hidden {
                return None;
            }
            let ray = view.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * grain as f32);
            let point = View::point(ray, sample.value);
            let uv = frame::uv(&self.mesh, self.lattice[0], sample.triangle, point);
            Some(Sight { point: to_pad(point), uv })
        };
        samples.par_iter().with_min_len(4096).enumerate().map(sight).collect()
    }

    /// The picture.
    pub fn render(&self) -> Film {
        self.render_with_error().0
    }

    /// The picture and what relRMSE to expect of it. Where that would be above the tolerance, and more work would help, more is
    /// done; where it still is well above, and flanks face each other, what bounces between them is traced.
    pub fn render_with_error(&self) -> (Film, f64) {
        wakeful(|| {
            let (mut pictures, effort, error) = self.within_tolerance(|pad| pad.pictures(1));
            let is_off = error > TRACED_FROM * self.tolerance;
            let still = pictures.still.take().filter(|_| is_off);
            let traced = still.and_then(|still| self.traced(&pictures.films[0], &still, effort));
            match traced {
                Some(Traced { film, error }) => {
                    let error = self.error_of_traced(&pictures, &effort, error);
                    (film, error)
                }
                None => (pictures.films.swap_remove(0), error),
            }
        })
    }

    /// One picture for each light of radiance 1, in the scene's order.
    pub fn basis(&self) -> LightBasis {
        self.basis_with_error().0
    }

    /// The same, and what relRMSE to expect of each, and of their sum in the scene's colours. More work is done where the
    /// picture of all lights would take it, so that the sum is that picture, but for bounced light that is traced there.
    pub fn basis_with_error(&self) -> (LightBasis, BasisError) {
        let names = self.once.fixed_scene.lights.iter().map(|l| l.name.clone()).collect();
        let (pictures, effort, together) = wakeful(|| self.within_tolerance(|pad| pad.light_by_light()));
        let error = |light| self.estimated_error(&pictures, Lit::By(light), &effort);
        let lights = (0..self.once.sources.len()).map(error).collect();
        (LightBasis { names, films: pictures.films }, BasisError { lights, together })
    }

    fn light_by_light(&self) -> frame::Pictures {
        match self.once.sources.len() {
            // A single picture is one of all lights together: here of a white one.
            1 => self.pictures_of(&self.once.lit_by(&[Vec3::ONE]), 1),
            n => self.pictures(n),
        }
    }

    /// Whether flanks face each other, and their rims alone take the error above the tolerance: then what bounces is traced, as a
    /// rule, and most of what is left is light that comes straight through slits between them.
    fn has_slits(&self) -> bool {
        self.effort.is_traced(self.once, &self.heights) && self.least_error() > self.tolerance
    }

    pub(super) fn pictures(&self, films: usize) -> frame::Pictures {
        self.pictures_of(self.once, films)
    }

    pub(super) fn pictures_of(&self, once: &Precomputed, films: usize) -> frame::Pictures {
        match self.has_slits() {
            true => self.pictures_by::<MOST_LINES>(once, films),
            false => self.pictures_by::<LINES>(once, films),
        }
    }

    /// The pictures, by so many lines to a light.
    fn pictures_by<const N: usize>(&self, once: &Precomputed, films: usize) -> frame::Pictures {
        let [columns, rows] = once.view.corners();
        let vertices = self.projected();
        let seen = Projected { lattice: self.lattice, vertices: &vertices, offset: 0.0 }.draw(columns, rows);
        let varying = once.sources.iter().any(|s| !s.is_fixed());
        let grey = films > 1 && once.greys.is_some();
        let frame = Frame::<N> {
            once,
            mesh: &self.mesh,
            nx: self.lattice[0],
            albedo: &self.albedo,
            heights: &self.heights,
            seen: &seen,
            vertices: &vertices,
            effort: self.effort,
            slots: Slots::new(once.sources.len(), films, varying, once.view.slab.is_some(), grey),
            level: 0.0,
            sided: Vec::new(),
        };
        let mut pictures = frame.render();
        let grain = once.grain;
        if grain > 1 {
            pictures.films.iter_mut().chain(&mut pictures.still).for_each(|film| *film = film.shrunk(grain));
            // Errors of neighbours average out over a pixel, changes do not.
            let once = (grain * grain) as f64;
            let scaled = |numbers: &mut [f64], part: f64| numbers.iter_mut().for_each(|n| *n /= part);
            scaled(&mut pictures.spread, once * once);
            scaled(&mut pictures.bounced, once);
            scaled(&mut pictures.glowed, once);
            scaled(&mut pictures.feet, once);
            scaled(&mut pictures.walls, once);
        }
        pictures
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ONCE, against_reference, punch, ridges, scene};
    use super::*;
    use crate::optics::bench_scene::Variant;

    #[test]
    fn between_flanks_straight_light_is_cut_along_more_lines_and_nearer_to_the_reference() {
        // Upright walls, whose slits show a part of a lamp.
        let mut scene_of_straight = scene(Variant::Ac, ridges);
        scene_of_straight.max_events = 1;
        let mut rest = scene_of_straight.clone();
        let mesh = Arc::make_mut(&mut rest.surfaces[0].mesh);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
        let once = Precomputed::new(&rest).unwrap();
        let straight = Renderer::new(&once, &scene_of_straight, 0.005).unwrap();
        let off = |pictures: frame::Pictures| against_reference(&scene_of_straight, &pictures.films[0]).0;
        let [few, many] =
            [straight.pictures_by::<LINES>(&once, 1), straight.pictures_by::<MOST_LINES>(&once, 1)].map(off);
        assert!(many < few, "{few} {many}");

        let at = |height: fn(f32, f32) -> f32, tolerance| {
            Renderer::new(&ONCE, &scene(Variant::Ac, height), tolerance).unwrap()
        };
        let slits = at(ridges, 0.005);
        assert!(slits.has_slits() && !at(ridges, 0.02).has_slits() && !at(punch, 0.005).has_slits());
        assert_eq!(slits.pictures(1).films, slits.pictures_by::<MOST_LINES>(&ONCE, 1).films);
    }
}
