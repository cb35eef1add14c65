//! Scenes that nobody thought of: the benchmark scene with lamps, walls, plates and presses as they are drawn.

use super::cases::{LATTICE, case, grey};
use super::lamps::{self, lift_plates};
use super::{Case, Due};
use crate::draw::Draw;
use crate::optics::bench_scene::Variant;
use crate::optics::trial::{Press, Trial};
use crate::optics::{Light, LightShape, Role, Scene};
use glam::Vec3;

/// Half of the extent of the box along x and y, mm.
const HALF_BOX_MM: [f32; 2] = [10.0, 7.5];
/// Free of lamps beside its corners, mm.
const CORNER_MM: f32 = 0.6;
/// Lamps are as bright as this area of their wall would be with the radiance of the benchmark scene, mm^2.
const BRIGHTNESS_MM2: f32 = 8.0;
/// Lower and upper face of the plate where the benchmark scene has it, mm, and how far it may be lifted.
const PLATE_MM: [f32; 2] = [1.5, 3.5];
const LIFT_MM: f32 = 5.5;
/// Events of even and odd scenes with a plate.
const PLATE_EVENTS: [u32; 2] = [7, 16];
/// Lamps keep so far from it, mm.
const CLEAR_MM: f32 = 0.2;

const PRESSES: [Press; 13] = [
    Press::Sphere,
    Press::Punch,
    Press::Stamp,
    Press::Cone,
    Press::Ridge,
    Press::Pyramid,
    Press::Ring,
    Press::Post,
    Press::Cliff,
    Press::Dots,
    Press::Dent,
    Press::Drag(3.0),
    Press::Fold,
];
/// Those that stay below a plate that is not lifted.
const LOW_PRESSES: [Press; 4] = [Press::Sphere, Press::Cone, Press::Ring, Press::Dots];

/// So many scenes of a seed.
pub(super) fn cases(seed: u64, count: u32) -> Vec<Case> {
    (0..count).map(|number| drawn(seed, number)).collect()
}

fn drawn(seed: u64, number: u32) -> Case {
    let mut draw = Draw::new(seed, number);
    let plate = (draw.below(10) < 3).then(|| draw.of(&[0.0, LIFT_MM]));
    let variant = if plate.is_some() { Variant::B } else { Variant::Ac };
    let press = draw.of(if plate == Some(0.0) { &LOW_PRESSES } else { &PRESSES });
    // Where lamps may stand, between the pad and the ceiling.
    let heights = match plate {
        None => [0.8, 12.0],
        Some(0.0) => [PLATE_MM[1] + CLEAR_MM, 12.0],
        Some(lift) => [0.8, PLATE_MM[0] + lift - CLEAR_MM],
    };
    let walls = draw.of(&[0.0, 0.15, 0.5, 0.8]);
    let pad = draw.of(&[0.1, 0.5, 0.9]);
    let events = if plate.is_some() { PLATE_EVENTS[number as usize % 2] } else { draw.of(&[2, 4, 8, 12]) };
    let shapes: Vec<(LightShape, Vec3, u32)> = (0..1 + draw.below(4))
        .map(|_| {
            let colour = Vec3::from_array([0; 3].map(|_| draw.of(&[0.1, 0.4, 0.7, 1.0])));
            (shape(&mut draw, heights), colour, draw.of(&[0, 0, 0, 1, 4]))
        })
        .collect();
    let kinds: Vec<&str> = shapes.iter().map(|(shape, ..)| kind(shape)).collect();
    let under = plate.map_or(String::new(), |lift| format!(", a plate at {} mm", PLATE_MM[0] + lift));
    let name = format!("random {seed}:{number}, {press:?}{under}, {}", kinds.join(", "));
    let change = move |scene: &mut Scene| {
        grey(scene, Role::Housing, walls);
        grey(scene, Role::Pad, pad);
        scene.max_events = events;
        lift_plates(scene, plate.unwrap_or(0.0));
        scene.lights.truncate(shapes.len());
        for (light, (shape, colour, power)) in scene.lights.iter_mut().zip(&shapes) {
            let bright = light.radiance.max_element() * BRIGHTNESS_MM2 / lamps::area(shape);
            *light = Light {
                shape: shape.clone(),
                radiance: *colour * bright,
                cosine_power: *power as f32,
                albedo: Vec3::splat(walls),
                ..light.clone()
            };
        }
    };
    // (Lamps that hide each other are refused.)
    case(name, Due::Either, move |s| Ok(Trial::new(variant, press, s.size, LATTICE)?.changed(&change)))
}

/// A lamp at one of the walls.
fn shape(draw: &mut Draw, [low, high]: [f32; 2]) -> LightShape {
    let (axis, sign) = (draw.below(2), draw.of(&[-1.0, 1.0]));
    let inwards = -sign * [Vec3::X, Vec3::Y][axis];
    let along = [Vec3::Y, Vec3::X][axis];
    let tall = draw.of(&[0.4, 1.0, 2.0f32]);
    let wide = draw.of(&[0.4, 1.4, 4.0, 10.0f32]);
    let part = |draw: &mut Draw| draw.below(1001) as f32 / 1000.0;
    let free = HALF_BOX_MM[1 - axis] - CORNER_MM - 0.5 * wide;
    // Most lamps stand low.
    let z = low + 0.5 * tall + part(draw).powi(2) * (high - low - tall);
    let foot = -inwards * HALF_BOX_MM[axis] + along * (2.0 * part(draw) - 1.0) * free + Vec3::Z * z;
    match draw.below(4) {
        0 => LightShape::Disc {
            center: foot + inwards * draw.of(&[0.001, 0.3]),
            normal: inwards,
            radius: 0.5 * tall.min(wide),
        },
        1 => {
            let (middle, half) = (foot + inwards * 0.5, along * 0.5 * wide);
            LightShape::Tube { from: middle - half, to: middle + half, radius: 0.2 }
        }
        _ => {
            let half_v = Vec3::Z * (0.5 * tall);
            let half_u = half_v.cross(inwards).normalize() * (0.5 * wide);
            LightShape::Rectangle { center: foot + inwards * draw.of(&[0.001, 0.3]), half_u, half_v }
        }
    }
}

fn kind(shape: &LightShape) -> &'static str {
    match shape {
        LightShape::Rectangle { .. } => "rectangle",
        LightShape::Disc { .. } => "disc",
        LightShape::Tube { .. } => "tube",
        LightShape::Mesh(_) => "mesh",
    }
}
