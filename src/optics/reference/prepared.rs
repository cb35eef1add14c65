//! A scene with everything that is worked out once: the tree, the lights, what each triangle is made of.

use super::plate::Plate;
use crate::optics::{
    Albedo, Camera, Error, LightShape, Material, Mesh, Role, Scene, accel::Accel, accel::Hit,
    accel::overlaps, bsdf::Bsdf, emitter::Emitter,
};
use glam::{Vec2, Vec3};
use std::cell::Cell;

#[derive(Debug, Clone)]
pub struct Prepared {
    pub camera: Camera,
    pub max_events: u32,
    pub emitters: Vec<Emitter>,
    /// Names of the lights.
    pub names: Vec<String>,
    pub accel: Accel,
    /// Distance by which rays start off a surface, mm: above the rounding of a hit, far below any detail.
    pub offset: f32,
    /// Boxes around clear bodies: no closed-form light through them.
    clear: Vec<[Vec3; 2]>,
    /// The only plate through which lights can be connected exactly; other clear bodies are in the way of such connections.
    pub plate: Option<Plate>,
    /// Images of the lights in the lower and in the upper face of that.
    images: [Vec<Emitter>; 2],
    /// Rooms: parts that are faces of an axis-aligned box; they block nothing between points inside.
    rooms: Vec<[Vec3; 2]>,
    /// Boxes around all other parts, with the light whose flat patch it is.
    blockers: Vec<([Vec3; 2], Option<usize>)>,
    /// Boxes around the lights.
    lamps: Vec<[Vec3; 2]>,
    /// Farther off than this there is nothing, mm.
    far: f32,
    /// By triangle: index into `parts`.
    part_of: Vec<u32>,
    parts: Vec<Part>,
}

/// A surface, or the patch of a light.
#[derive(Debug, Clone)]
struct Part {
    material: Material,
    light: Option<usize>,
    pad: bool,
    /// Whether it is the plate through which lights are connected.
    connects: bool,
    first_triangle: usize,
    /// Texture coordinates by corner; empty where nothing needs them.
    uvs: Vec<[Vec2; 3]>,
    /// Normals by corner; empty where the triangles are what is meant, or the surface is not clear.
    normals: Vec<[Vec3; 3]>,
}

/// What a ray hit.
pub struct Surfel {
    pub hit: Hit,
    pub light: Option<usize>,
    /// Whether it is the pad's face.
    pub pad: bool,
    /// Whether it is the plate through which lights are connected.
    pub connects: bool,
    /// Texture coordinate, 0 where the surface has none.
    pub uv: Vec2,
    /// Normal on the side the ray came from: that of the triangle, or of the clear curved surface that it stands for.
    pub normal: Vec3,
    pub bsdf: Bsdf,
}

impl Surfel {
    /// Whether it lies in one of the large faces of that plate.
    pub fn is_face(&self) -> bool {
        self.connects && self.normal.z.abs() > 0.999
    }
}

impl Prepared {
    pub fn new(scene: &Scene) -> Result<Self, Error> {
        scene.check()?;
        let mut triangles = Vec::new();
        let mut part_of = Vec::new();
        let mut parts = Vec::new();
        let (mut clear, mut rooms, mut blockers, mut lamps) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut plates = Vec::new();
        let extent = extent_of(scene);
        let margin = extent * 1e-5;
        for surface in &scene.surfaces {
            let mesh = &surface.mesh;
            let textured = matches!(
                &surface.material,
                Material::Lambert { albedo: Albedo::Texture(_) }
                    | Material::FlakeCoating { albedo: Albedo::Texture(_), .. }
            );
            if textured && mesh.uvs.is_empty() {
                return Err(Error::Scene {
                    part: surface.name.clone(),
                    what: "it has a texture, but its mesh has no texture coordinates".to_owned(),
                    next: "give the mesh one coordinate a vertex, or use a constant albedo".to_owned(),
                });
            }
            let bounds = bounds_of(&mesh.positions);
            let is_clear =
                matches!(surface.material, Material::Dielectric { .. } | Material::RoughDielectric { .. });
            if is_clear {
                clear.push(bounds);
            }
            if let (Material::Dielectric { ior }, true) = (&surface.material, is_room(mesh, bounds)) {
                plates.push((Plate::new(bounds, *ior), parts.len()));
            }
            if !is_clear && is_room(mesh, bounds) {
                rooms.push(bounds);
            } else {
                blockers.push((grow(bounds, margin), None));
            }
            let pad = surface.role == Role::Pad;
            let uvs = if textured || (pad && !mesh.uvs.is_empty()) {
                mesh.triangles.iter().map(|t| t.map(|i| mesh.uvs[i as usize])).collect()
            } else {
                Vec::new()
            };
            let normals = match is_clear && !mesh.normals.is_empty() {
                true => mesh.triangles.iter().map(|t| t.map(|i| mesh.normals[i as usize])).collect(),
                false => Vec::new(),
            };
            part_of.resize(part_of.len() + mesh.triangles.len(), parts.len() as u32);
            parts.push(Part {
                material: surface.material.clone(),
                light: None,
                pad,
                connects: false,
                first_triangle: triangles.len(),
                uvs,
                normals,
            });
            triangles.extend((0..mesh.triangles.len()).map(|k| mesh.corners(k)));
        }
        let emitters: Vec<Emitter> = scene.lights.iter().map(Emitter::new).collect();
        for (k, light) in scene.lights.iter().enumerate() {
            let mesh = light.shape.tessellate();
            let flat = matches!(light.shape, LightShape::Rectangle { .. } | LightShape::Disc { .. });
            lamps.push(grow(bounds_of(&mesh.positions), margin));
            blockers.push((lamps[k], flat.then_some(k)));
            part_of.resize(part_of.len() + mesh.triangles.len(), parts.len() as u32);
            parts.push(Part {
                material: Material::Lambert { albedo: Albedo::Constant(light.albedo) },
                light: Some(k),
                pad: false,
                connects: false,
                first_triangle: triangles.len(),
                uvs: Vec::new(),
                normals: Vec::new(),
            });
            triangles.extend((0..mesh.triangles.len()).map(|k| mesh.corners(k)));
        }
        let connecting = if plates.len() == 1 { plates.pop() } else { None };
        if let Some((_, part)) = connecting {
            parts[part].connects = true;
        }
        Ok(Self {
            camera: scene.camera.clone(),
            max_events: scene.max_events,
            images: connecting.map_or([vec![], vec![]], |(plate, _)| {
                plate.faces().map(|face| emitters.iter().map(|e| e.mirrored(face)).collect())
            }),
            emitters,
            names: scene.lights.iter().map(|l| l.name.clone()).collect(),
            accel: Accel::new(&triangles),
            offset: extent * 2e-6,
            plate: connecting.map(|(plate, _)| plate),
            clear,
            rooms: rooms.into_iter().map(|room| grow(room, margin)).collect(),
            blockers,
            lamps,
            far: 4.0 * extent,
            part_of,
            parts,
        })
    }

    /// The first surface along a ray.
    #[inline]
    pub fn trace(&self, origin: Vec3, direction: Vec3) -> Option<Surfel> {
        let hit = self.accel.hit(origin, direction, f32::INFINITY)?;
        let part = &self.parts[self.part_of[hit.triangle as usize] as usize];
        let outside = hit.normal.dot(direction) < 0.0;
        let triangle = hit.triangle as usize - part.first_triangle;
        let uv = match part.uvs.get(triangle) {
            Some([a, b, c]) => *a + (*b - *a) * hit.barycentric[0] + (*c - *a) * hit.barycentric[1],
            None => Vec2::ZERO,
        };
        let mut normal = if outside { hit.normal } else { -hit.normal };
        if let Some([a, b, c]) = part.normals.get(triangle) {
            let smooth = *a + (*b - *a) * hit.barycentric[0] + (*c - *a) * hit.barycentric[1];
            let smooth = if outside { smooth } else { -smooth }.normalize_or_zero();
            // A ray that grazes the facet may come from behind the curved surface: there the facet itself counts.
            if smooth.dot(direction) < 0.0 {
                normal = smooth;
            }
        }
        Some(Surfel {
            light: part.light,
            pad: part.pad,
            connects: part.connects,
            uv,
            normal,
            bsdf: Bsdf::new(&part.material, uv, outside),
            hit,
        })
    }

    /// What a light adds to the irradiance of a point by way of the plate's nearer face, about: good for choosing among lights.
    pub fn mirrored(&self, point: Vec3, normal: Vec3, light: usize) -> f32 {
        let Some(plate) = self.plate.filter(|plate| plate.is_outside(point)) else { return 0.0 };
        let center = self.emitters[light].center;
        if plate.between(point, center) {
            return 0.0;
        }
        let image = &self.images[plate.nearer_face(point)][light];
        let to = (image.center - point).normalize_or_zero();
        // The farther face mirrors nearly as much.
        2.0 * plate.mirrored_part(to.z.abs()) * image.unoccluded(point, normal)
    }

    /// Whether the segment passes a clear body (by its box).
    #[inline]
    pub fn passes_clear(&self, from: Vec3, to: Vec3) -> bool {
        self.clear.iter().any(|bounds| overlaps(bounds, from, to))
    }

    /// Whether a ray goes by a lamp (by its box).
    #[inline]
    pub fn passes_lamp(&self, from: Vec3, along: Vec3) -> bool {
        self.lamps.iter().any(|bounds| overlaps(bounds, from, from + along * self.far))
    }

    /// Whether something stands between a point and a point of a light. No ray is traced, and counted, where the boxes
    /// alone tell that nothing does.
    #[inline]
    pub fn blocked(&self, from: Vec3, to: Vec3, light: usize, rays: &Cell<u64>) -> bool {
        let inside = |[lo, hi]: &[Vec3; 2]| {
            from.cmpge(*lo).all() && from.cmple(*hi).all() && to.cmpge(*lo).all() && to.cmple(*hi).all()
        };
        let free = self.rooms.iter().all(inside)
            && self
                .blockers
                .iter()
                .all(|(bounds, patch)| *patch == Some(light) || !overlaps(bounds, from, to));
        if free {
            return false;
        }
        rays.set(rays.get() + 1);
        self.accel.blocked(from, to)
    }
}

fn bounds_of(points: &[Vec3]) -> [Vec3; 2] {
    let inf = Vec3::splat(f32::INFINITY);
    points.iter().fold([inf, -inf], |[lo, hi], p| [lo.min(*p), hi.max(*p)])
}

fn grow([lo, hi]: [Vec3; 2], margin: f32) -> [Vec3; 2] {
    [lo - Vec3::splat(margin), hi + Vec3::splat(margin)]
}

/// Whether every triangle lies in a face of the mesh's own box.
fn is_room(mesh: &Mesh, [lo, hi]: [Vec3; 2]) -> bool {
    let in_face = |[a, b, c]: [Vec3; 3]| {
        (0..3).any(|axis| [lo, hi].iter().any(|face| [a, b, c].iter().all(|p| p[axis] == face[axis])))
    };
    mesh.triangles.len() <= 64 && (0..mesh.triangles.len()).all(|k| in_face(mesh.corners(k)))
}

/// The largest coordinate of any surface or light.
fn extent_of(scene: &Scene) -> f32 {
    let largest = |mesh: &Mesh| mesh.positions.iter().fold(0.0f32, |m, p| m.max(p.abs().max_element()));
    let surfaces = scene.surfaces.iter().map(|s| largest(&s.mesh));
    let lights = scene.lights.iter().map(|l| largest(&l.shape.tessellate()));
    surfaces.chain(lights).fold(0.0, f32::max)
}
