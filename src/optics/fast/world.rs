//! What rays meet while a sensor is prepared: triangles, what they are made of, and which patch they belong to.
//! Radiance inside a plate is counted over n^2, so that it is the same on both sides of a face.
//!
//! Every surface is cut into patches of about a millimetre, walls right beside lamps into smaller ones: a triangle into a grid in its barycentric
//! coordinates, the pad's lattice into blocks of quads. Each side of a patch is an element of the radiosity solution.

use super::around_lamps;
use super::parted::{cut_at, levels};
use super::plate::Slab;
use super::source::Lamp;
use crate::optics::Material;
use crate::optics::bsdf::{fresnel, refract};
use crate::optics::sampler::hash;
use crate::optics::{Albedo, Error, Mesh, Role, Scene, accel::Accel, accel::Hit};
use glam::Vec3;

/// Edge of a patch, mm.
const PATCH_MM: f32 = 1.1;
/// Shorter side of a pad for which lengths in mm are meant, mm.
const USUAL_MM: f32 = 14.3;
/// An element is small below this part of the square of a patch's edge.
const SMALL: f32 = 0.12;
/// Most patches along an edge of one triangle.
const MOST_CUTS: u32 = 24;

/// Faces of clear bodies that a path crosses at most.
const MOST_CROSSINGS: u32 = 24;

/// How a part is cut into patches.
#[derive(Debug, Clone, Copy)]
enum Cut {
    /// Each triangle into `n * n` smaller ones.
    Triangles { n: u32 },
    /// A lattice of `nx - 1` quads a row into blocks, `columns` of them a row.
    Blocks { quads_x: u32, quads_y: u32, columns: u32, rows: u32 },
}

/// What a surface or a light is made of.
#[derive(Debug, Clone, Copy)]
struct Made {
    albedo: Vec3,
    /// Index of refraction, where it is clear.
    clear: Option<f32>,
    light: Option<usize>,
}

/// Triangles of a surface or of a light.
#[derive(Debug, Clone)]
struct Part {
    made: Made,
    first_triangle: u32,
    first_patch: u32,
    cut: Cut,
}

/// A scene's geometry.
#[derive(Debug, Clone)]
pub struct World {
    accel: Accel,
    corners: Vec<[Vec3; 3]>,
    part_of: Vec<u16>,
    parts: Vec<Part>,
    /// Distance by which rays start off a surface, mm.
    pub offset: f32,
    /// How many patches there are; each has two sides.
    pub patches: usize,
    /// Their edge, mm.
    pub patch_mm: f32,
}

/// What a ray met.
#[derive(Debug, Clone, Copy)]
pub struct Met {
    /// Where.
    pub hit: Hit,
    /// Normal on the side the ray came from.
    pub normal: Vec3,
    /// Diffuse reflectance.
    pub albedo: Vec3,
    /// The light whose patch it is.
    pub light: Option<usize>,
    /// Whether it was met on the side of its geometric normal.
    pub front: bool,
    /// Element of the radiosity solution.
    pub element: usize,
    /// How many faces of clear bodies the path met before: so many events it took.
    pub faces: u32,
    /// Index of refraction behind the surface over that before it, where it is clear.
    eta: Option<f32>,
}

/// By how much finer than usual a sensor is looked at: walls stand as much nearer to each other as a pad is smaller.
pub fn fineness(scene: &Scene) -> f32 {
    let sides = scene.surfaces.iter().filter(|s| s.role == Role::Pad).filter_map(|s| {
        let [x, y] = extent(&s.mesh, s.mesh.lattice?);
        Some(x.min(y) / USUAL_MM)
    });
    sides.fold(1.0, f32::min)
}

/// Lengths of a lattice's sides, mm.
fn extent(mesh: &Mesh, [nx, ny]: [usize; 2]) -> [f32; 2] {
    let p = &mesh.positions;
    let along = |a: usize, b: usize| (p[b] - p[a]).length();
    [along(0, nx - 1), along(0, (ny - 1) * nx)]
}

impl World {
    /// The scene, with or without its pad.
    pub fn new(scene: &Scene, with_pad: bool) -> Result<Self, Error> {
        let mut world = Self {
            accel: Accel::new(&[]),
            corners: Vec::new(),
            part_of: Vec::new(),
            parts: Vec::new(),
            offset: 0.0,
            patches: 0,
            patch_mm: PATCH_MM * fineness(scene),
        };
        let levels = levels(scene, Slab::of(scene)?);
        let lamps: Vec<Lamp> = scene.lights.iter().filter_map(Lamp::new).collect();
        for surface in &scene.surfaces {
            if surface.role == Role::Pad && !with_pad {
                continue;
            }
            if let (Role::Plate, Material::Dielectric { ior }) = (surface.role, &surface.material) {
                world.add(&surface.mesh, Made { albedo: Vec3::ZERO, clear: Some(*ior), light: None });
                continue;
            }
            let Material::Lambert { albedo } = &surface.material else {
                let value = format!("{} ({})", surface.material.kind(), surface.name);
                return Err(super::unsupported("material", &value, "diffuse surfaces only"));
            };
            let albedo = match albedo {
                Albedo::Constant(c) => *c,
                // Only the pad's own texture is drawn; in the light that walls exchange its mean stands for it.
                Albedo::Texture(t) if surface.role == Role::Pad => t.mean(),
                Albedo::Texture(_) => {
                    let value = format!("a texture ({})", surface.name);
                    return Err(super::unsupported("material", &value, "walls of one colour only"));
                }
            };
            let made = Made { albedo, clear: None, light: None };
            match surface.role {
                Role::Housing => {
                    for strip in cut_at(&surface.mesh, &levels) {
                        world.add(&around_lamps::cut(strip, &lamps, world.patch_mm), made);
                    }
                }
                _ => world.add(&surface.mesh, made),
            }
        }
        for (k, light) in scene.lights.iter().enumerate() {
            let made = Made { albedo: light.albedo, clear: None, light: Some(k) };
            world.add(&light.shape.tessellate(), made);
        }
        let extent = world.corners.iter().flatten().fold(0.0f32, |m, p| m.max(p.abs().max_element()));
        world.offset = extent * 2e-6;
        world.accel = Accel::new(&world.corners);
        Ok(world)
    }

    fn add(&mut self, mesh: &Mesh, made: Made) {
        let all = 0..mesh.triangles.len();
        match mesh.lattice {
            Some([nx, ny]) if nx >= 2 && ny >= 2 && self.has_fine_quads(mesh, [nx, ny]) => {
                let [x, y] = extent(mesh, [nx, ny]);
                let (quads_x, quads_y) = (nx as u32 - 1, ny as u32 - 1);
                let blocks =
                    |length: f32, quads: u32| ((length / self.patch_mm).ceil() as u32).clamp(1, quads);
                let (columns, rows) = (blocks(x, quads_x), blocks(y, quads_y));
                let cut = Cut::Blocks { quads_x, quads_y, columns, rows };
                self.add_part(made, cut, all.map(|k| mesh.corners(k)).collect());
            }
            // Walls that are cut into strips have large and small triangles: those that take as many patches are a part.
            _ => {
                // Edge of a square of twice the area: slender triangles need few patches.
                let edge_of = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length().sqrt();
                let mut parts = [const { Vec::new() }; MOST_CUTS as usize];
                for corners in all.map(|k| mesh.corners(k)) {
                    let n = ((edge_of(corners) / self.patch_mm).ceil() as usize).clamp(1, parts.len());
                    parts[n - 1].push(corners);
                }
                for (n, triangles) in (1..).zip(parts).filter(|(_, triangles)| !triangles.is_empty()) {
                    self.add_part(made, Cut::Triangles { n }, triangles);
                }
            }
        }
    }

    fn add_part(&mut self, made: Made, cut: Cut, triangles: Vec<[Vec3; 3]>) {
        let (first_triangle, first_patch) = (self.corners.len() as u32, self.patches as u32);
        self.part_of.resize(self.part_of.len() + triangles.len(), self.parts.len() as u16);
        self.parts.push(Part { made, first_triangle, first_patch, cut });
        self.patches += match cut {
            Cut::Triangles { n } => (n * n) as usize * triangles.len(),
            Cut::Blocks { columns, rows, .. } => (columns * rows) as usize,
        };
        self.corners.extend(triangles);
    }

    /// Whether the quads of a lattice are no larger than patches: blocks of them can be patches.
    fn has_fine_quads(&self, mesh: &Mesh, [nx, ny]: [usize; 2]) -> bool {
        let [x, y] = extent(mesh, [nx, ny]);
        x <= self.patch_mm * (nx - 1) as f32 && y <= self.patch_mm * (ny - 1) as f32
    }

    /// The first surface along a ray.
    pub fn trace(&self, origin: Vec3, direction: Vec3) -> Option<Met> {
        let hit = self.accel.hit(origin, direction, f32::INFINITY)?;
        let part = &self.parts[usize::from(self.part_of[hit.triangle as usize])];
        let front = hit.normal.dot(direction) < 0.0;
        let triangle = hit.triangle - part.first_triangle;
        let patch = part.first_patch + part.cut.patch(triangle, hit.barycentric);
        Some(Met {
            normal: if front { hit.normal } else { -hit.normal },
            albedo: part.made.albedo,
            light: part.made.light,
            front,
            element: 2 * patch as usize + usize::from(!front),
            faces: 0,
            eta: part.made.clear.map(|ior| if front { ior } else { 1.0 / ior }),
            hit,
        })
    }

    /// The first surface that is not clear, along a path that reflects or refracts by chance at clear ones. `dice` is the state of
    /// the chance.
    pub fn follow(&self, mut origin: Vec3, mut direction: Vec3, dice: &mut u32) -> Option<Met> {
        for faces in 0..MOST_CROSSINGS {
            let met = self.trace(origin, direction)?;
            let Some(eta) = met.eta else { return Some(Met { faces, ..met }) };
            let cos = -direction.dot(met.normal);
            *dice = hash(*dice, 0x51ab);
            let chance = (*dice >> 8) as f32 * (1.0 / 16_777_216.0);
            let refracted =
                if chance < fresnel(cos, eta) { None } else { refract(-direction, met.normal, eta) };
            (origin, direction) = match refracted {
                Some(direction) => (met.hit.point - met.normal * self.offset, direction),
                None => (met.hit.point + met.normal * self.offset, direction + met.normal * (2.0 * cos)),
            };
        }
        None
    }

    /// Whether something stands on the open segment.
    pub fn blocked(&self, from: Vec3, to: Vec3) -> bool {
        self.accel.blocked(from, to)
    }

    /// Whether anything is clear.
    pub fn has_clear(&self) -> bool {
        self.parts.iter().any(|p| p.made.clear.is_some())
    }

    /// A point of an element with its normal, for `u` in the unit square.
    pub fn point(&self, element: usize, u: [f32; 2]) -> (Vec3, Vec3) {
        let patch = (element / 2) as u32;
        let k = self.parts.partition_point(|p| p.first_patch <= patch) - 1;
        let part = &self.parts[k];
        let (triangle, [s, t]) = part.cut.place(patch - part.first_patch, u);
        let [a, b, c] = self.corners[(part.first_triangle + triangle) as usize];
        let normal = (b - a).cross(c - a).normalize_or_zero();
        (a + (b - a) * s + (c - a) * t, if element.is_multiple_of(2) { normal } else { -normal })
    }

    /// A point near the middle of an element, be it of a triangle or a block of quads, with its normal.
    pub fn middle(&self, element: usize) -> (Vec3, Vec3) {
        self.point(element, [0.3, 0.3])
    }

    /// Area of an element, mm^2.
    pub fn area(&self, element: usize) -> f32 {
        let patch = (element / 2) as u32;
        let part = &self.parts[self.parts.partition_point(|p| p.first_patch <= patch) - 1];
        let [a, b, c] = [[0.001, 0.001], [0.998, 0.001], [0.001, 0.998]].map(|u| self.point(element, u).0);
        let whole = (b - a).cross(c - a).length() * (1.0 / (0.997 * 0.997));
        if matches!(part.cut, Cut::Triangles { .. }) { 0.5 * whole } else { whole }
    }

    /// Whether it is a small part of a usual patch: of those there are many side by side, whose errors average out.
    pub fn is_small(&self, element: usize) -> bool {
        self.area(element) < SMALL * self.patch_mm * self.patch_mm
    }

    /// Longest edge of the box around everything, mm.
    pub fn extent(&self) -> f32 {
        let inf = Vec3::splat(f32::INFINITY);
        let [low, high] = self.corners.iter().flatten().fold([inf, -inf], |[l, h], p| [l.min(*p), h.max(*p)]);
        (high - low).max_element()
    }

    /// Reflectance of an element, and the light whose patch it is.
    pub fn element(&self, element: usize) -> (Vec3, Option<usize>) {
        let patch = (element / 2) as u32;
        let part = &self.parts[self.parts.partition_point(|p| p.first_patch <= patch) - 1];
        (part.made.albedo, part.made.light)
    }

    /// Irradiance of a point straight from light `k` of radiance 1, hidden or not as its middle is.
    pub fn direct(&self, point: Vec3, normal: Vec3, own: Option<usize>, k: usize, lamp: &Lamp) -> f32 {
        if own == Some(k) {
            return 0.0;
        }
        let e = lamp.irradiance(point, normal);
        let from = point + normal * self.offset;
        let to = lamp.middle_from(from);
        if e > 0.0 && !self.blocked(from, to) { e } else { 0.0 }
    }
}

impl Cut {
    fn patch(self, triangle: u32, [s, t]: [f32; 2]) -> u32 {
        match self {
            Cut::Triangles { n } => {
                let (x, y) = (s * n as f32, t * n as f32);
                let (i, j) = ((x as u32).min(n - 1), (y as u32).min(n - 1));
                // Rows of 2 (n - j) - 1 triangles: upright ones even, hanging ones odd.
                let hanging = x.fract() + y.fract() > 1.0;
                let row = n * n - (n - j) * (n - j);
                let last = 2 * (n - j) - 2;
                triangle * n * n + row + (2 * i + u32::from(hanging)).min(last)
            }
            Cut::Blocks { quads_x, quads_y, columns, rows } => {
                let (i, j) = (triangle / 2 % quads_x, triangle / 2 / quads_x);
                j * rows / quads_y * columns + i * columns / quads_x
            }
        }
    }

    fn place(self, patch: u32, [u, v]: [f32; 2]) -> (u32, [f32; 2]) {
        match self {
            Cut::Triangles { n } => {
                let (triangle, within) = (patch / (n * n), patch % (n * n));
                let j = (0..n).rfind(|j| n * n - (n - j) * (n - j) <= within).unwrap_or(0);
                let k = within - (n * n - (n - j) * (n - j));
                let (mut s, mut t) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                if k % 2 == 1 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                (triangle, [((k / 2) as f32 + s) / n as f32, (j as f32 + t) / n as f32])
            }
            Cut::Blocks { quads_x, quads_y, columns, rows } => {
                let within = |k: u32, blocks: u32, quads: u32, u: f32| {
                    let (low, high) = ((k * quads).div_ceil(blocks), ((k + 1) * quads).div_ceil(blocks));
                    let at = low as f32 + u * (high - low) as f32;
                    ((at as u32).min(quads - 1), at.fract())
                };
                let (i, s) = within(patch % columns, columns, quads_x, u);
                let (j, t) = within(patch / columns, rows, quads_y, v);
                let quad = 2 * (j * quads_x + i);
                // a + (b - a) s' + (c - a) t', where c is the far corner of the quad.
                if s >= t { (quad, [s - t, t]) } else { (quad + 1, [s, t - s]) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene;
    use super::*;
    use crate::optics::bench_scene::Variant;
    use crate::optics::sampler::Sampler;
    use std::sync::Arc;

    #[test]
    fn neither_a_coarse_lattice_nor_a_small_sensor_has_fewer_patches() {
        let usual = scene(Variant::Ac, |_, _| 0.0);
        let patches = |scene: &Scene| World::new(scene, true).unwrap().patches as f32;
        let mut corners = usual.clone();
        let pad = &mut corners.surfaces[0].mesh;
        let [nx, ny] = pad.lattice.unwrap();
        let four = [0, nx - 1, nx * (ny - 1), nx * ny - 1].map(|k| pad.positions[k]).to_vec();
        *pad = Arc::new(Mesh::from_lattice(2, 2, four, Vec::new()));
        assert!(patches(&corners) >= patches(&usual));
        let mut small = usual.clone();
        for surface in &mut small.surfaces {
            Arc::make_mut(&mut surface.mesh).positions.iter_mut().for_each(|p| *p *= 0.25);
        }
        small.lights.clear();
        let mut unlit = usual.clone();
        unlit.lights.clear();
        let times = patches(&small) / patches(&unlit);
        assert!((0.85..1.3).contains(&times), "{times} times as many patches");
    }

    #[test]
    fn a_point_of_a_patch_lies_in_that_patch() {
        for cut in [
            Cut::Triangles { n: 1 },
            Cut::Triangles { n: 7 },
            Cut::Blocks { quads_x: 23, quads_y: 9, columns: 5, rows: 4 },
        ] {
            let patches = match cut {
                Cut::Triangles { n } => 3 * n * n,
                Cut::Blocks { columns, rows, .. } => columns * rows,
            };
            let s = Sampler::new(1, 2, 3, 64);
            for patch in 0..patches {
                for k in 0..64 {
                    let [u, v, ..] = s.group(k, patch);
                    let (triangle, at) = cut.place(patch, [0.01 + 0.98 * u, 0.01 + 0.98 * v]);
                    assert!(at[0] >= 0.0 && at[1] >= 0.0 && at[0] + at[1] <= 1.0 + 1e-5);
                    assert_eq!(cut.patch(triangle, at), patch, "{cut:?} {at:?}");
                }
            }
        }
    }
}
