//! Odd lamps.

use super::cases::{LATTICE, case, changed};
use super::{Case, Due, Settings};
use crate::optics::bench_scene::Variant;
use crate::optics::trial::{Press, Trial};
use crate::optics::{Error, Light, LightShape, Role, Scene};
use glam::Vec3;
use std::sync::Arc;

/// Walls 2 to 2.5 mm further out, and lamps before them 0.85 mm above the face.
pub fn further_out(scene: &mut Scene) {
    let out = |p: Vec3| Vec3::new(p.x * 1.2, p.y * 4.0 / 3.0, p.z);
    for surface in scene.surfaces.iter_mut().filter(|s| s.role == Role::Housing) {
        Arc::make_mut(&mut surface.mesh).positions.iter_mut().for_each(|p| *p = out(*p));
    }
    for light in &mut scene.lights {
        at_height(light, 0.85);
        if let LightShape::Rectangle { center, half_u, half_v } = &mut light.shape {
            let normal = half_u.cross(*half_v).normalize();
            *center = out(*center + normal * -0.001) + normal * 0.001;
        }
    }
}

/// Lights in places where they should not be.
pub(super) fn misplaced(cases: &mut Vec<Case>) {
    for z in [0.6, 1.05, 3.0, 15.0] {
        let name = format!("lights {z} mm above the face");
        cases.push(case(name, Due::Picture, move |s| {
            let lower = move |scene: &mut Scene| scene.lights.iter_mut().for_each(|l| at_height(l, z));
            changed(lower)(s)
        }));
    }
    // Strips that hide patches of the walls but for a few micrometres.
    cases.push(
        case("lamps low over the pad by walls further out", Due::Picture, changed(further_out))
            .judged_closely(),
    );
    cases.push(case("the pad rises over lamps", Due::Reference, |s| {
        let lower = |scene: &mut Scene| {
            // The lamp at the raised end alone.
            scene.lights.swap(0, 1);
            scene.lights.truncate(1);
            at_height(&mut scene.lights[0], 0.8);
        };
        Ok(Trial::new(Variant::Ac, Press::Cliff, s.size, LATTICE)?.changed(lower))
    }));
    cases.push(case(
        "lights as small as a pixel",
        Due::Picture,
        changed(|s| s.lights.iter_mut().for_each(|l| scaled(l, 0.02, 2500.0))),
    ));
    cases.push(case(
        "lights touch the walls",
        Due::Either,
        changed(|s| {
            s.lights.iter_mut().for_each(|l| {
                if let LightShape::Rectangle { center, half_u, half_v } = &mut l.shape {
                    *center -= half_u.cross(*half_v).normalize() * 0.001;
                }
            });
        }),
    ));
    cases.push(case(
        "a light faces the ceiling",
        Due::Picture,
        changed(|s| {
            if let LightShape::Rectangle { center, half_u, half_v } = &mut s.lights[0].shape {
                (*center, *half_u, *half_v) = (Vec3::new(-6.0, 0.0, 8.0), Vec3::X, Vec3::Y);
            }
        }),
    ));
    cases.push(case(
        "a light hangs over the pad",
        Due::Picture,
        changed(|s| {
            if let LightShape::Rectangle { center, half_u, half_v } = &mut s.lights[1].shape {
                (*center, *half_u, *half_v) = (Vec3::new(7.0, 4.0, 10.0), Vec3::Y, Vec3::X);
            }
        }),
    ));
    cases.push(case(
        "no light shines",
        Due::Picture,
        changed(|s| s.lights.iter_mut().for_each(|l| l.radiance = Vec3::ZERO)),
    ));
}

/// Lamps whose light comes by way of a plate, those of the size of an LED among them.
pub(super) fn by_plate(cases: &mut Vec<Case>) {
    let small: fn(&mut Light) = |l| shaped(l, |center, normal| square(center, normal, 1.4));
    let discs: fn(&mut Light) = |l| shaped(l, disc);
    let profiled: fn(&mut Light) = |l| l.cosine_power = 4.0;
    // How far the plate is moved up, mm: over the lamps, or where it is, under them.
    for (where_, lift) in [("under", 5.5), ("over", 0.0)] {
        for (what, change) in [("lamps of 1.4 mm", small), ("discs", discs), ("lamps of a profile", profiled)]
        {
            let name = format!("{what} {where_} a plate");
            let make = move |s: &Settings| under_plate(s, lift, |lights| lights.iter_mut().for_each(change));
            cases.push(case(name, Due::Picture, make).judged_closely());
        }
    }
    let alone = move |s: &Settings| {
        under_plate(s, 5.5, |lights| {
            lights.truncate(1);
            small(&mut lights[0]);
        })
    };
    cases.push(case("one lamp of 1.4 mm under a plate", Due::Picture, alone).judged_closely());
}

/// Lamps that are not as bright from aside.
pub(super) fn profiled(cases: &mut Vec<Case>) {
    for power in [1.0, 4.0] {
        for (what, shape) in [("tubes", tube as fn(Vec3, Vec3) -> LightShape), ("discs", disc)] {
            cases.push(case(
                format!("{what} of a cosine power of {power}"),
                Due::Picture,
                changed(move |s| {
                    for light in &mut s.lights {
                        shaped(light, shape);
                        light.cosine_power = power;
                    }
                }),
            ));
        }
    }
    let tubes = |s: &Settings| {
        under_plate(s, 5.5, |lights| {
            for light in lights {
                shaped(light, tube);
                light.cosine_power = 4.0;
            }
        })
    };
    cases.push(case("tubes of a profile under a plate", Due::Picture, tubes).judged_closely());
}

/// A ball between grey walls under a plate that is moved up, with changed lights.
fn under_plate(settings: &Settings, lift_mm: f32, change: impl Fn(&mut Vec<Light>)) -> Result<Trial, Error> {
    Ok(Trial::new(Variant::B, Press::Sphere, settings.size, LATTICE)?.changed(|scene| {
        lift_plates(scene, lift_mm);
        change(&mut scene.lights);
    }))
}

/// Moves the plates away from the pad.
pub(super) fn lift_plates(scene: &mut Scene, by_mm: f32) {
    let plates = scene.surfaces.iter_mut().filter(|s| s.role == Role::Plate);
    plates.flat_map(|s| &mut Arc::make_mut(&mut s.mesh).positions).for_each(|p| p.z += by_mm);
}

/// Gives a light another shape, from its centre and the direction in which it shines, and as much power as it had.
fn shaped(light: &mut Light, shape: impl Fn(Vec3, Vec3) -> LightShape) {
    let LightShape::Rectangle { center, half_u, half_v } = light.shape else { return };
    let before = area(&light.shape);
    light.shape = shape(center, half_u.cross(half_v).normalize());
    light.radiance *= before / area(&light.shape);
}

/// The area that shines, mm^2.
pub(super) fn area(shape: &LightShape) -> f32 {
    let mesh = shape.tessellate();
    (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum()
}

fn square(center: Vec3, normal: Vec3, edge_mm: f32) -> LightShape {
    let half_v = Vec3::Z * (0.5 * edge_mm);
    LightShape::Rectangle { center, half_u: half_v.cross(normal), half_v }
}

fn disc(center: Vec3, normal: Vec3) -> LightShape {
    LightShape::Disc { center, normal, radius: 0.8 }
}

/// Half a millimetre off its wall.
fn tube(center: Vec3, normal: Vec3) -> LightShape {
    let (middle, half) = (center + normal * 0.5, normal.cross(Vec3::Z) * 2.0);
    LightShape::Tube { from: middle - half, to: middle + half, radius: 0.2 }
}

/// Moves a light's lower edge to a height.
pub(super) fn at_height(light: &mut Light, z: f32) {
    if let LightShape::Rectangle { center, half_u, half_v } = &mut light.shape {
        center.z = z + half_u.z.abs() + half_v.z.abs();
    }
}

/// A light `size` times as large and `radiance` times as bright.
fn scaled(light: &mut Light, size: f32, radiance: f32) {
    if let LightShape::Rectangle { half_u, half_v, .. } = &mut light.shape {
        (*half_u, *half_v) = (*half_u * size, *half_v * size);
    }
    light.radiance *= radiance;
}
