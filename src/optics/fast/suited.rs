//! What of a scene the fast mode takes: one pad on a lattice, and lights that have a closed form.

use super::source::{Lamp, Source};
use super::view::View;
use crate::optics::{Albedo, Camera, Error, Light, LightShape, Material, Mesh, Role, Scene, Surface};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// A light may reach into a wall by this much, mm.
const BESIDE_MM: f32 = 0.01;
/// Most points along an edge of the pad in the world that light is solved in: the untouched face is smooth.
const WORLD_POINTS: usize = 81;

/// Why the mode leaves a scene to the reference.
pub(super) fn unsupported(key: &'static str, value: &str, what: &str) -> Error {
    Error::NotFast { key, value: value.to_owned(), what: what.to_owned() }
}

/// Refuses what may stand between lights and pad: of direct light it is known only what the pad itself hides.
pub(super) fn nothing_within(scene: &Scene) -> Result<(), Error> {
    let housings = scene.surfaces.iter().filter(|s| s.role == Role::Housing).skip(1);
    match scene.surfaces.iter().filter(|s| s.role == Role::Other).chain(housings).next() {
        Some(surface) => Err(unsupported(
            "surfaces",
            &surface.name,
            "a pad, one housing and plates with nothing in between",
        )),
        None => Ok(()),
    }
}

/// The pad, of which there is one.
pub(super) fn pad_of(scene: &Scene) -> Result<&Surface, Error> {
    let mut pads = scene.surfaces.iter().filter(|s| s.role == Role::Pad);
    match (pads.next(), pads.next()) {
        (Some(pad), None) => Ok(pad),
        (found, _) => {
            let n = if found.is_some() { "several" } else { "none" };
            Err(unsupported("pad", n, "scenes with exactly one pad"))
        }
    }
}

/// Points of a pad along x and y.
pub(super) fn lattice_of(mesh: &Mesh) -> Result<[usize; 2], Error> {
    match mesh.lattice {
        Some([nx, ny]) if nx >= 2 && ny >= 2 && mesh.positions.len() == nx * ny => Ok([nx, ny]),
        _ => Err(unsupported("pad", "no lattice", "pads whose mesh is a lattice of points")),
    }
}

/// The scene's camera with so many times its pixels that they are not coarser than the pad's lattice.
pub(super) fn fine_camera(scene: &Scene) -> Result<Camera, Error> {
    let camera = &scene.camera;
    let mesh = &pad_of(scene)?.mesh;
    let [nx, _] = lattice_of(mesh)?;
    let p = &mesh.positions;
    let spacing = (p[1] - p[0]).length().max((p[nx] - p[0]).length());
    let pixel = 2.0 * camera.tan_half_x * camera.origin.z.abs() / camera.width as f32;
    let grain = if spacing > 0.0 { (pixel / spacing).round() as usize } else { 1 };
    let grain = grain.clamp(1, MOST_GRAIN);
    Ok(camera.with_raster(camera.width * grain, camera.height * grain))
}

/// Most samples along the edge of a pixel.
const MOST_GRAIN: usize = 4;

/// The lights, where all of them have a closed form.
pub(super) fn sources_of(scene: &Scene) -> Result<Vec<Source>, Error> {
    let source = |light: &Light| {
        Source::new(light).ok_or_else(|| {
            let kind = if light.two_sided { "shines on both sides" } else { "is a mesh" };
            let value = format!("{:?}, which {kind}", light.name);
            unsupported("lights", &value, "one-sided rectangles, discs and tubes only")
        })
    };
    scene.lights.iter().map(source).collect()
}

/// Refuses lights that walls hide from the pad: behind them, and under its face.
pub(super) fn lit_from_within(
    scene: &Scene,
    [low, high]: [Vec2; 2],
    face: impl Fn(Vec2) -> f32,
) -> Result<(), Error> {
    let inf = Vec3::splat(f32::INFINITY);
    let walls = scene.surfaces.iter().filter(|s| s.role == Role::Housing).flat_map(|s| &s.mesh.positions);
    let [from, to] = walls.fold([inf, -inf], |[l, h], p| [l.min(*p), h.max(*p)]);
    for light in &scene.lights {
        let lamp = light.shape.tessellate();
        let points = &lamp.positions;
        let outside = |p: &Vec3| p.cmplt(from - BESIDE_MM).any() || p.cmpgt(to + BESIDE_MM).any();
        if from.x < to.x && points.iter().any(outside) {
            let value = format!("{:?}, beyond the walls", light.name);
            return Err(unsupported("lights", &value, "lights within the walls only"));
        }
        let over = |p: &Vec3| p.truncate().cmpge(low).all() && p.truncate().cmple(high).all();
        let [foot, top] =
            points.iter().fold([f32::INFINITY, -f32::INFINITY], |[l, h], p| [l.min(p.z), h.max(p.z)]);
        let sunk = HIDDEN_FOOT * (top - foot);
        if edge_points(&lamp).any(|p| over(&p) && p.z < face(p.truncate()) - sunk) {
            let value = format!("{:?}, under the pad's face", light.name);
            return Err(unsupported("lights", &value, "lights above the pad's face only"));
        }
    }
    Ok(())
}

/// Part of a light's height that may be under the face: what a press far away lifts about the foot of a light that stands on the pad
/// hides nothing that counts.
const HIDDEN_FOOT: f32 = 0.01;

/// Refuses lights in the view that stand on the face, or so low over it that pad and light show each other's light within less
/// than is resolved here. (Beyond the view they may be as near as [`lights_clear_of_face`] says.)
pub(super) fn lights_off_face(
    lights: &[Light],
    view: &View,
    pixel_mm: f32,
    [low, high]: [Vec2; 2],
    face: impl Fn(Vec2) -> f32,
) -> Result<(), Error> {
    let raster = Vec2::new(view.camera.width as f32, view.camera.height as f32);
    let beside = GAP_MM / pixel_mm;
    let near = |p: Vec3, gap_mm: f32| {
        let across = p.truncate();
        let is_over = across.cmpge(low).all() && across.cmple(high).all();
        // (What the pad hides by rising over it is as near.)
        is_over && p.z < face(across) + 0.999 * gap_mm && {
            let at = view.project(p).truncate();
            at.cmpge(Vec2::splat(-beside)).all() && at.cmple(raster + beside).all()
        }
    };
    let below_eye = view.camera.origin.truncate();
    for light in lights {
        let shines_here = Source::new(light).is_none_or(|s| s.faces(below_eye.extend(face(below_eye))));
        let gap_mm = if shines_here { GAP_MM } else { GAP_AWAY_MM };
        if edge_points(&light.shape.tessellate()).any(|p| near(p, gap_mm)) {
            let value = format!("{:?}, in the view and less than {gap_mm} mm over the pad", light.name);
            return Err(unsupported("lights", &value, "lights in the view that are clear of the pad only"));
        }
    }
    Ok(())
}

/// Refuses lights most of whose light falls on the untouched face right beside them, in the view or beyond it: it is sent on from
/// within less than a patch. (A black pad sends nothing on.)
pub(super) fn lights_clear_of_face(
    lights: &[Light],
    pad: &Surface,
    view: &View,
    [low, high]: [Vec2; 2],
    face: impl Fn(Vec2) -> f32,
) -> Result<(), Error> {
    if matches!(&pad.material, Material::Lambert { albedo: Albedo::Constant(c) } if *c == Vec3::ZERO) {
        return Ok(());
    }
    for (light, middle) in lights.iter().filter_map(|light| Some((light, Lamp::new(light)?.center))) {
        let beside = middle.truncate().clamp(low, high);
        let gap_mm = middle.z - face(beside);
        let across = middle.truncate();
        let from_rim_mm = (across - low).min(high - across).min_element();
        let least_mm = match lies_flat(&light.shape) {
            false => CLEAR_MM,
            true if from_rim_mm < BY_WALL_MM && !view.sees(middle) => CLEAR_BY_WALL_MM,
            true => CLEAR_FLAT_MM,
        };
        if beside.distance(middle.truncate()) < BESIDE_PAD_MM && gap_mm < least_mm {
            let value = format!("{:?}, whose middle is {gap_mm:.2} mm over the pad", light.name);
            let wanted = format!(
                "lights whose middle is {CLEAR_MM} mm or more over the pad ({CLEAR_FLAT_MM} mm where they lie flat, \
                 {CLEAR_BY_WALL_MM} mm if that is by a wall beyond the view) only"
            );
            return Err(unsupported("lights", &value, &wanted));
        }
    }
    Ok(())
}

/// Refuses lights that a press has brought the face so near to, anywhere along them: light was solved without it. `lifted` tells the
/// height of the face where a press has lifted it.
pub(super) fn lights_clear_of_press(
    lights: &[Light],
    [low, high]: [Vec2; 2],
    lifted: impl Fn(Vec2) -> Option<f32>,
) -> Result<(), Error> {
    for light in lights {
        let [from, to] = along(&light.shape);
        let places = (0..=EDGE_POINTS).map(|k| from.lerp(to, k as f32 / EDGE_POINTS as f32));
        let gaps = places.filter_map(|place| {
            let across = place.truncate();
            let beside = across.clamp(low, high);
            let gap_mm = place.z - lifted(beside)?;
            (beside.distance(across) < BESIDE_PAD_MM).then_some(gap_mm)
        });
        let gap_mm = gaps.fold(f32::INFINITY, f32::min);
        if gap_mm < CLEAR_MM {
            let value = format!("{:?}, {gap_mm:.2} mm over what a press has lifted", light.name);
            let wanted = format!("lights whose middle is {CLEAR_MM} mm or more over the pressed pad only");
            return Err(unsupported("lights", &value, &wanted));
        }
    }
    Ok(())
}

/// The line along the middle of a light, as level as it has one.
fn along(shape: &LightShape) -> [Vec3; 2] {
    match shape {
        LightShape::Rectangle { center, half_u, half_v } => {
            let rise = |half: &Vec3| half.z.abs() / half.length().max(1e-12);
            let half = if rise(half_u) < rise(half_v) { *half_u } else { *half_v };
            [*center - half, *center + half]
        }
        LightShape::Disc { center, normal, radius } => {
            let half = normal.cross(Vec3::Z).normalize_or(Vec3::X) * *radius;
            [*center - half, *center + half]
        }
        LightShape::Tube { from, to, .. } => [*from, *to],
        // (None has a closed form.)
        LightShape::Mesh(_) => [Vec3::INFINITY; 2],
    }
}

/// Whether a light faces the pad or the ceiling rather than walls.
fn lies_flat(shape: &LightShape) -> bool {
    let normal = match shape {
        LightShape::Rectangle { half_u, half_v, .. } => half_u.cross(*half_v).normalize_or_zero(),
        LightShape::Disc { normal, .. } => *normal,
        LightShape::Tube { .. } | LightShape::Mesh(_) => Vec3::ZERO,
    };
    normal.z.abs() > 0.5
}

/// The middle of a light is so far over the pad's face, mm. Found by experiment: of upright strips 0.1 mm high, at the wall, with the middle
/// 0.14, 0.22 and 0.4 mm over the face, pictures are 3.5, 1.5 and 0.3 % off, and of one at 0.57 mm still 1.6 % where a punch of 1.5 mm
/// stands before it.
const CLEAR_MM: f32 = 0.65;
/// The same of lights that lie flat.
const CLEAR_FLAT_MM: f32 = 1.5;
/// The same by a wall beyond the view, where a picture is lit by little else than what wall and pad send to and fro. Of one of 0.8 mm, 0.6
/// and 1.6 mm over the face, pictures are 5 and 7 % off, and 6 % where it shines up from 0.5 mm; at this height they are as right as they say.
const CLEAR_BY_WALL_MM: f32 = 2.5;
/// Lights so near the pad's rim stand by a wall, mm.
const BY_WALL_MM: f32 = 2.5;
/// Lights so far beside the pad are as near to it as over it, mm.
const BESIDE_PAD_MM: f32 = 1.0;

/// Refuses lights at the camera: it would look into them, or past them within less than a pixel.
pub(super) fn lights_clear_of_camera(lights: &[Light], camera: &Camera) -> Result<(), Error> {
    for light in lights {
        let nearest = light.shape.tessellate().nearest(camera.origin);
        let gap_mm = nearest.map_or(f32::INFINITY, |p| p.distance(camera.origin));
        if gap_mm < CLEAR_OF_CAMERA_MM {
            let value = format!("{:?}, {gap_mm:.2} mm from the camera", light.name);
            let wanted = format!("lights that are {CLEAR_OF_CAMERA_MM} mm or more from the camera only");
            return Err(unsupported("lights", &value, &wanted));
        }
    }
    Ok(())
}

/// Lights are so far from the camera, mm. Found by experiment: a lamp 0.1 mm before it is 6 % off where 0.2 are stated.
const CLEAR_OF_CAMERA_MM: f32 = 1.0;

/// Places along the edges of a light.
fn edge_points(mesh: &Mesh) -> impl Iterator<Item = Vec3> {
    let edges = (0..mesh.triangles.len()).flat_map(|k| {
        let [a, b, c] = mesh.corners(k);
        [(a, b), (b, c), (c, a)]
    });
    edges.flat_map(|(a, b)| (0..=EDGE_POINTS).map(move |k| a.lerp(b, k as f32 / EDGE_POINTS as f32)))
}

/// Lights in the view must be so far off the pad, mm: at 0.2 mm a picture was found to be as right as it says.
const GAP_MM: f32 = 0.2;
/// The same of those that face away from its middle: what shines into the dark under their edge comes and goes within less than
/// the distance of probes, and is all the light there is.
const GAP_AWAY_MM: f32 = 0.45;
/// Points at which an edge of a light is looked at, less one.
const EDGE_POINTS: usize = 32;

/// The same scene with a pad of no more points than light between walls needs.
pub(super) fn coarse(scene: &Scene) -> Result<Scene, Error> {
    let mut out = scene.clone();
    for surface in out.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        let [nx, ny] = lattice_of(&surface.mesh)?;
        let picked = |n: usize| -> Vec<usize> {
            let m = n.min(WORLD_POINTS);
            (0..m).map(|k| k * (n - 1) / (m - 1)).collect()
        };
        let (columns, rows) = (picked(nx), picked(ny));
        let at = |k: usize| rows[k / columns.len()] * nx + columns[k % columns.len()];
        let positions = (0..rows.len() * columns.len()).map(|k| surface.mesh.positions[at(k)]).collect();
        surface.mesh = Arc::new(Mesh::from_lattice(columns.len(), rows.len(), positions, Vec::new()));
    }
    Ok(out)
}

/// What does not change with the pad.
pub(super) fn without_pad_mesh(scene: &Scene) -> Scene {
    let mut fixed = scene.clone();
    for surface in fixed.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        surface.mesh = Arc::new(Mesh::default());
    }
    fixed
}

/// Whether a scene is that one with a pad.
pub(super) fn same_but_pad_mesh(scene: &Scene, fixed: &Scene) -> bool {
    scene.camera == fixed.camera
        && scene.lights == fixed.lights
        && scene.max_events == fixed.max_events
        && scene.surfaces.len() == fixed.surfaces.len()
        && scene.surfaces.iter().zip(&fixed.surfaces).all(|(a, b)| {
            a.role == b.role && a.material == b.material && (a.role == Role::Pad || a.mesh == b.mesh)
        })
}
