//! A clear plate between camera and pad, as the fast renderer sees it: rays through it in closed form.
//!
//! The faces are at right angles to z and wider than the box they stand in, so a path through the plate stays in one
//! upright plane, whatever it does inside. With x the tangent of its angle in air, h the heights travelled in air and
//! t that in glass, it gets r = h x + t x / sqrt(n^2 + (n^2 - 1) x^2) ahead (see `reference::plate`). A path that is
//! reflected twice inside is one through a plate three times as thick.

mod way;

use crate::optics::bsdf::fresnel;
use crate::optics::{Camera, Error, Material, Mesh, Role, Scene};
use glam::{Vec2, Vec3};

/// Orders of inner reflection that are followed.
pub const ORDERS: usize = 4;

/// Mirror images of a lamp that a camera sees: seen from above in acrylic the next is ten million times darker than the lamp.
pub const MIRRORED: usize = 3;

/// Fewest events of a scene with a plate, each of whose faces is one: with fewer some of the light that comes straight to the pad by way of
/// the plate is cut off. (Two faces to the pad, which is the third, and four with a reflection inside to what is beyond. Of what is reflected
/// more often inside nothing is cut off, of lamps as near over a plate as may be 2 % of the pad's light, of others 0.05 % at most.)
const LEAST_EVENTS: u32 = 7;
/// A plate may miss the walls by this much, mm.
const SLIT_MM: f32 = 0.01;

/// A plate of infinite width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// Height of the lower face, mm.
    pub low: f32,
    /// Height of the upper face, mm.
    pub high: f32,
    /// Index of refraction.
    pub ior: f32,
}

/// How a point below is seen mirrored from below.
#[derive(Debug, Clone, Copy)]
pub struct Image {
    /// The unit vector in the direction in which it appears.
    pub direction: Vec3,
    /// Part of its radiance that arrives.
    pub reflected: f32,
    /// Solid angle filled by a square millimetre that faces the way there.
    pub angle_per_mm2: f32,
}

/// How a point above is seen from below.
#[derive(Debug, Clone, Copy)]
pub struct Sighted {
    /// A vector in the direction in which it appears.
    pub offset: Vec3,
    /// Part of its radiance that arrives.
    pub transmitted: f32,
}

impl Slab {
    /// The plate of a scene; None where there is none, an error where it is no flat one between camera and pad.
    pub fn of(scene: &Scene) -> Result<Option<Self>, Error> {
        let mut plates = scene.surfaces.iter().filter(|s| s.role == Role::Plate);
        let Some(plate) = plates.next() else { return Ok(None) };
        let refused = |value: &str, what: &str| Err(super::unsupported("plate", value, what));
        let Material::Dielectric { ior } = plate.material else {
            return refused(plate.material.kind(), "clear plates with smooth faces only");
        };
        let z = |mesh: &Mesh| {
            let heights = mesh.positions.iter().map(|p| p.z);
            heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], z| [l.min(z), h.max(z)])
        };
        let [low, high] = z(&plate.mesh);
        let on_a_face = |p: &glam::Vec3| p.z == low || p.z == high;
        if plates.next().is_some()
            || plate.mesh.triangles.len() != 12
            || !plate.mesh.positions.iter().all(on_a_face)
        {
            return refused("several, or one whose faces lean", "one plate with level faces only");
        }
        let camera = &scene.camera;
        if camera.forward.dot(Vec3::NEG_Z) < 1.0 - 1e-5 || camera.origin.z <= high {
            let value = format!("up to z = {high} mm, the camera at {} mm", camera.origin.z);
            return refused(&value, "plates under a camera that looks straight down on them only");
        }
        let pad = scene.surface(Role::Pad).map_or(f32::NEG_INFINITY, |pad| z(&pad.mesh)[1]);
        if pad >= low {
            return refused(
                &format!("from z = {low} mm, the pad up to {pad} mm"),
                "plates above the pad only",
            );
        }
        let across = |mesh: &Mesh| mesh.positions.iter().map(|p| p.truncate()).collect::<Vec<_>>();
        let bounds = |points: &[Vec2]| {
            let inf = Vec2::splat(f32::INFINITY);
            points.iter().fold([inf, -inf], |[low, high], p| [low.min(*p), high.max(*p)])
        };
        let [from, to] = bounds(&across(&plate.mesh));
        let mut walls = [from, to];
        if let Some(within) = scene.surface(Role::Housing).or(scene.surface(Role::Pad)) {
            let [low, high] = bounds(&across(&within.mesh));
            if from.cmpgt(low + SLIT_MM).any() || to.cmplt(high - SLIT_MM).any() {
                let value = format!("x {} to {} mm, y {} to {} mm", from.x, to.x, from.y, to.y);
                return refused(&value, "plates as wide as the walls that they stand between only");
            }
            if within.role == Role::Housing {
                walls = [low, high];
            }
        }
        let slab = Self { low, high, ior };
        // What stands above the plate's lower face is looked for nowhere.
        let [seen_from, seen_to] = bounds(&slab.seen_border(camera));
        if seen_from.cmplt(walls[0] - SLIT_MM).any() || seen_to.cmpgt(walls[1] + SLIT_MM).any() {
            let value = format!(
                "a view of x {:.2} to {:.2} mm, y {:.2} to {:.2} mm at z = {low} mm",
                seen_from.x, seen_to.x, seen_from.y, seen_to.y
            );
            let wanted = "views that reach no wall above the lower face of a plate, and none beside it, only";
            return Err(super::unsupported("camera", &value, wanted));
        }
        if scene.max_events < LEAST_EVENTS {
            let value = scene.max_events.to_string();
            let wanted = format!("scenes with a plate of {LEAST_EVENTS} events or more");
            return Err(super::unsupported("max_events", &value, &wanted));
        }
        for light in &scene.lights {
            let [from, to] = z(&light.shape.tessellate());
            if to > low && from < high {
                let value = format!("z {low} to {high} mm, light {:?} {from} to {to} mm", light.name);
                return refused(&value, "plates that no light reaches into only");
            }
        }
        Ok(Some(slab))
    }

    /// Where the rays along the border of a camera's picture leave the lower face.
    fn seen_border(&self, camera: &Camera) -> Vec<Vec2> {
        let [width, height] = [camera.width, camera.height].map(|n| n as f32);
        let at = |x: f32, y: f32| {
            let (origin, direction) = camera.ray(x, y, Vec2::ZERO);
            self.below(origin, direction)[0].truncate()
        };
        let rows = (0..=camera.height).flat_map(|y| [at(0.0, y as f32), at(width, y as f32)]);
        rows.chain((0..=camera.width).flat_map(|x| [at(x as f32, 0.0), at(x as f32, height)])).collect()
    }

    fn glass(&self) -> f32 {
        self.high - self.low
    }

    /// Way ahead in a thickness `t` of glass.
    #[inline(always)]
    fn ahead(&self, x: f32, t: f32) -> f32 {
        let n2 = self.ior * self.ior;
        t * x / (n2 + (n2 - 1.0) * x * x).sqrt()
    }

    /// Tangent of the angle in air of the path that gets `r` ahead over `air` and `glass`.
    #[inline(always)]
    fn tangent(&self, r: f32, air: f32, glass: f32) -> f32 {
        let n2 = self.ior * self.ior;
        let mut x = r / (air + glass / self.ior);
        // Concave: Newton's method from the left never overshoots; four steps reach single precision.
        for _ in 0..4 {
            let root = (n2 + (n2 - 1.0) * x * x).sqrt();
            let slope = air + glass * n2 / (root * root * root);
            x += (r - air * x - glass * x / root) / slope;
        }
        x
    }

    /// Where a ray from above goes on below: its point on the lower face, and its direction for a unit of depth.
    pub fn below(&self, origin: Vec3, direction: Vec3) -> [Vec3; 2] {
        let flat = direction.truncate() / -direction.z;
        let x = flat.length();
        let ahead = if x > 0.0 { flat / x } else { Vec2::X };
        let r = x * (origin.z - self.high) + self.ahead(x, self.glass());
        [(origin.truncate() + ahead * r).extend(self.low), flat.extend(-1.0)]
    }

    /// The tangent at which a camera above sees a point below, and its value: one over its depth below the plate.
    #[inline(always)]
    pub fn apparent(&self, camera: Vec3, p: Vec3) -> (Vec2, f32) {
        let flat = (p - camera).truncate();
        let r = flat.length();
        let depth = (self.low - p.z).max(1e-3);
        let x = self.tangent(r, camera.z - self.high + depth, self.glass());
        (if r > 0.0 { flat * (x / r) } else { flat }, 1.0 / depth)
    }

    /// What of a ray from below arrives above, all inner reflections together.
    pub fn transmitted(&self, direction: Vec3) -> f32 {
        let r = fresnel(direction.z.abs(), self.ior);
        (1.0 - r) / (1.0 + r)
    }

    /// The mirror images that a ray from above sees: in the upper face, and in the lower after 0, 1, ... further round trips inside;
    /// where each leaves the upper face, and its weight.
    pub fn mirrored(&self, origin: Vec3, direction: Vec3) -> [(Vec3, f32); MIRRORED] {
        let (face, first, round) = self.at_upper_face(origin, direction);
        std::array::from_fn(|image| {
            let weight = match image {
                0 => face,
                _ => (1.0 - face) * (1.0 - face) * face.powi(2 * image as i32 - 1),
            };
            ((first + round * image as f32).extend(self.high), weight)
        })
    }

    /// Where a ray from above leaves the lower face if it is reflected twice inside, and the part that does: what it meets there shows
    /// as a ghost beside what it meets without.
    pub fn ghost(&self, origin: Vec3, direction: Vec3) -> (Vec3, f32) {
        let (face, first, round) = self.at_upper_face(origin, direction);
        ((first + round * 1.5).extend(self.low), ((1.0 - face) * face).powi(2))
    }

    /// Of a ray from above the part that a face reflects, where it meets the upper one, and how far ahead each way down and up inside
    /// takes it.
    fn at_upper_face(&self, origin: Vec3, direction: Vec3) -> (f32, Vec2, Vec2) {
        let flat = direction.truncate() / -direction.z;
        let x = flat.length();
        let ahead = if x > 0.0 { flat / x } else { Vec2::X };
        let first = origin.truncate() + flat * (origin.z - self.high);
        (fresnel(direction.z.abs(), self.ior), first, ahead * (2.0 * self.ahead(x, self.glass())))
    }

    /// The direction in which a point `y` above appears from a point `p` below, without reflections inside.
    #[inline(always)]
    pub fn towards(&self, p: Vec3, y: Vec3) -> Vec3 {
        let flat = (y - p).truncate();
        let r = flat.length();
        let x = self.tangent(r, (y.z - p.z - self.glass()).max(1e-4), self.glass());
        (flat * (x / r.max(1e-12))).extend(1.0)
    }

    /// The part in air of the way from a point `p` below to a point `y` above, without reflections inside.
    pub fn in_air(&self, p: Vec3, y: Vec3) -> Vec3 {
        self.towards(p, y) * (y.z - p.z - self.glass()).max(1e-4)
    }

    /// How a point `y` above appears from a point `p` below after `2 order` reflections inside.
    pub fn sighted(&self, p: Vec3, y: Vec3, order: usize) -> Sighted {
        let flat = (y - p).truncate();
        let r = flat.length();
        let (air, glass) = ((y.z - p.z) - self.glass(), self.glass() * (2 * order + 1) as f32);
        let air = air.max(1e-4);
        let x = self.tangent(r, air, glass);
        let cos = 1.0 / (1.0 + x * x).sqrt();
        let face = fresnel(cos, self.ior);
        let transmitted = (1.0 - face) * (1.0 - face) * face.powi(2 * order as i32);
        let ahead = if r > 0.0 { flat / r } else { Vec2::X };
        Sighted { offset: (ahead * x).extend(1.0), transmitted }
    }

    /// How a point `y` below appears from a point `p` below: by the lower face (`order` 0), or after so many reflections at the upper one.
    pub fn image(&self, p: Vec3, y: Vec3, order: usize) -> Image {
        let flat = (y - p).truncate();
        let r = flat.length();
        let air = (2.0 * self.low - p.z - y.z).max(1e-4);
        let glass = self.glass() * (2 * order) as f32;
        let x = self.tangent(r, air, glass);
        let cos = 1.0 / (1.0 + x * x).sqrt();
        let face = fresnel(cos, self.ior);
        let reflected = match order {
            0 => face,
            _ => (1.0 - face) * (1.0 - face) * face.powi(2 * order as i32 - 1),
        };
        let ahead = if r > 0.0 { flat * (x / r) } else { Vec2::ZERO };
        let angle_per_mm2 = self.angle_per_mm2([x, cos], r, air, glass);
        Image { direction: ahead.extend(1.0) * cos, reflected, angle_per_mm2 }
    }

    /// Solid angle in air that a square millimetre fills which faces the way there, at the end of a path that gets `r` ahead; `x` is
    /// the tangent of its angle in air.
    fn angle_per_mm2(&self, [x, cos]: [f32; 2], r: f32, air: f32, glass: f32) -> f32 {
        // The way ahead is r(x): a ring of directions about z fills x cos^3 dx, and x dx / (r dr) of a level one where it ends.
        let n2 = self.ior * self.ior;
        let root = (n2 + (n2 - 1.0) * x * x).sqrt();
        let slope = air + glass * n2 / (root * root * root);
        let narrows = if r > 1e-6 { x / r } else { 1.0 / (air + glass / self.ior) };
        cos * cos * narrows / slope
    }

    /// How many faces of the plate a way from a point to one outside of it meets that is not straight: at least, and with a reflection
    /// inside, or another one.
    pub fn faces_between(&self, point: Vec3, outside: Vec3) -> [u8; 2] {
        if point.z >= self.low && point.z <= self.high {
            return [1, 2];
        }
        if self.covers(point) == self.covers(outside) { [1, 3] } else { [2, 4] }
    }

    /// Whether the point is below the plate.
    pub fn covers(&self, p: Vec3) -> bool {
        p.z < self.low
    }
}
