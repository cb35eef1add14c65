//! Lamps that graze the pad: hardly higher than its face, or in a plane that nearly holds it.

use super::cases::{LATTICE, case};
use super::{Case, Due};
use crate::optics::bench_scene::Variant;
use crate::optics::trial::{Press, Trial};
use crate::optics::{LightShape, Role, Scene};
use glam::Vec3;
use std::rc::Rc;
use std::sync::Arc;

/// Pads that are seen.
const PRESSES: [Press; 2] = [Press::Untouched, Press::Sphere];
/// From the pad's middle to the wall, mm.
const WALL_MM: f32 = 10.0;
/// Area of the lamps that these stand for, mm^2: they are to be as strong.
const USUAL_MM2: f32 = 18.0;
/// Of its extent a pad keeps so much beside which lamps stand: more than is in view.
const NARROWER: f32 = 0.93;

pub(super) fn cases(cases: &mut Vec<Case>) {
    for (what, due, change) in lamps() {
        for press in PRESSES {
            let change = Rc::clone(&change);
            cases.push(case(format!("grazing: {what}, {press:?}"), due, move |s| {
                Ok(Trial::new(Variant::Ac, press, s.size, LATTICE)?.changed(&*change))
            }));
        }
    }
}

type Change = Rc<dyn Fn(&mut Scene)>;

/// Lamps, and whether they are far enough from the pad for the fast mode.
fn lamps() -> Vec<(String, Due, Change)> {
    let mut lamps: Vec<(String, Due, Change)> = Vec::new();
    let mut add = |what: String, due: Due, change: Change| lamps.push((what, due, change));
    for angle_deg in [0.5, 1.0, 2.0, 3.0] {
        let foot_mm = WALL_MM * f32::to_radians(angle_deg).tan();
        add(
            format!("strips {angle_deg} degrees above the face"),
            Due::Reference,
            Rc::new(move |s| upright(s, WALL_MM - 1e-3, [foot_mm, foot_mm + 0.1])),
        );
    }
    add(
        "strips whose middle is 0.7 mm over the face".to_owned(),
        Due::Picture,
        Rc::new(|s| upright(s, WALL_MM - 1e-3, [0.65, 0.75])),
    );
    for (angle_deg, height_mm, due) in [
        (0.5, 0.6, Due::Reference),
        (1.0, 0.6, Due::Reference),
        (2.0, 0.6, Due::Reference),
        (1.0, 1.6, Due::Reference),
        (1.0, 2.5, Due::Picture),
    ] {
        add(
            format!("a strip whose plane is {angle_deg} degrees over the face, {height_mm} mm up"),
            due,
            Rc::new(move |s| flat(s, height_mm, angle_deg, -1.0)),
        );
    }
    for height_mm in [0.05, 0.5] {
        add(
            format!("a strip turned away but for 2 degrees, {height_mm} mm up"),
            Due::Reference,
            Rc::new(move |s| flat(s, height_mm, 2.0, 1.0)),
        );
    }
    for (what, heights_mm) in [("half of them under its face", [-0.3, 0.3]), ("from its face up", [0.0, 0.1])]
    {
        add(
            format!("strips beside the pad, {what}"),
            Due::Reference,
            Rc::new(move |s| {
                narrow(s);
                upright(s, WALL_MM - 0.35, heights_mm);
            }),
        );
    }
    lamps
}

/// Two lamps at opposite ends, upright, between two heights.
fn upright(scene: &mut Scene, aside_mm: f32, [foot, top]: [f32; 2]) {
    scene.lights.truncate(2);
    for (light, side) in scene.lights.iter_mut().zip([-1.0, 1.0]) {
        let center = Vec3::new(side * aside_mm, 0.0, 0.5 * (foot + top));
        let half_v = Vec3::Z * (0.5 * (top - foot));
        light.shape = LightShape::Rectangle { center, half_u: Vec3::Y * (-4.0 * side), half_v };
        light.radiance *= USUAL_MM2 / (8.0 * (top - foot));
    }
}

/// One lamp at the end of the pad, beyond the view, in a plane that rises over the pad by an angle. It shines up (1) or down (-1).
fn flat(scene: &mut Scene, height_mm: f32, angle_deg: f32, up: f32) {
    scene.lights.truncate(1);
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let light = &mut scene.lights[0];
    // Up it shines over the pad, down on it.
    let half_u = Vec3::new(cos, 0.0, -up * sin) * 0.4;
    let center = Vec3::new(0.5 - WALL_MM, 0.0, height_mm);
    light.shape = LightShape::Rectangle { center, half_u, half_v: Vec3::Y * (4.0 * up) };
    light.radiance *= USUAL_MM2 / 6.4;
}

/// Leaves room between pad and walls.
fn narrow(scene: &mut Scene) {
    for pad in scene.surfaces.iter_mut().filter(|s| s.role == Role::Pad) {
        let positions = &mut Arc::make_mut(&mut pad.mesh).positions;
        positions.iter_mut().for_each(|p| *p *= Vec3::new(NARROWER, NARROWER, 1.0));
    }
}
