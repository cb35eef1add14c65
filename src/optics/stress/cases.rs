//! Odd pads, scales and scenes.

use super::lamps::{self, at_height};
use super::{Case, Due, Make, Settings};
use super::{cameras, grazing};
use crate::optics::bench_scene::Variant;
use crate::optics::trial::{Press, Trial};
use crate::optics::{Albedo, Error, Light, LightShape, Material, Mesh, Role, Scene};
use glam::Vec3;
use std::sync::Arc;

/// Points of the pad's lattice.
pub(super) const LATTICE: [usize; 2] = [401, 301];

pub(super) fn case(
    name: impl Into<String>,
    due: Due,
    make: impl Fn(&Settings) -> Result<Trial, Error> + 'static,
) -> Case {
    Case { name: name.into(), due, make: Box::new(make), times: 1 }
}

fn pressed(press: Press) -> impl Fn(&Settings) -> Result<Trial, Error> {
    move |s| Trial::new(Variant::Ac, press, s.size, LATTICE)
}

/// A ball under changed lights or walls.
pub(super) fn changed(change: impl Fn(&mut Scene) + Copy) -> impl Fn(&Settings) -> Result<Trial, Error> {
    move |s| Ok(Trial::new(Variant::Ac, Press::Sphere, s.size, LATTICE)?.changed(change))
}

pub(super) fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for press in [
        Press::Cone,
        Press::Ridge,
        Press::Pyramid,
        Press::Ring,
        Press::Post,
        Press::Cliff,
        Press::Dots,
        Press::Dent,
        Press::Drag(2.0),
        Press::Drag(5.0),
        Press::Fold,
        Press::Punch,
        Press::Plug,
        Press::Stamp,
    ] {
        cases.push(case(format!("press {press:?}"), Due::Picture, pressed(press)));
    }
    for light in 0..4 {
        let name = format!("punch under light {light} alone");
        cases.push(case(name, Due::Picture, move |s| {
            let keep = |scene: &mut Scene| {
                scene
                    .lights
                    .iter_mut()
                    .enumerate()
                    .filter(|(k, _)| *k != light)
                    .for_each(|(_, l)| l.radiance = Vec3::ZERO);
            };
            Ok(Trial::new(Variant::Ac, Press::Punch, s.size, LATTICE)?.changed(keep))
        }));
    }
    for (name, press) in
        [("cone", Press::Cone), ("ring", Press::Ring), ("drag", Press::Drag(3.0)), ("plug", Press::Plug)]
    {
        cases.push(case(format!("textured {name}"), Due::Picture, move |s| {
            Trial::new(Variant::At, press, s.size, LATTICE)
        }));
        cases.push(case(format!("{name} under a plate"), Due::Picture, move |s| {
            Trial::new(Variant::B, press, s.size, LATTICE)
        }));
    }
    lamps::misplaced(&mut cases);
    in_view(&mut cases);
    cameras::cases(&mut cases);
    extremes(&mut cases);
    lamps::by_plate(&mut cases);
    lamps::profiled(&mut cases);
    grazing::cases(&mut cases);
    cases
}

/// What the camera sees beside the pad, before it and in the plate.
fn in_view(cases: &mut Vec<Case>) {
    for (side, name) in [(-1.0, "left"), (1.0, "right")] {
        // Mirror images of each other.
        let stands = move |s: &mut Scene| {
            s.lights.truncate(1);
            let (center, half_u) = (Vec3::new(6.03 * side, 0.0, 1.5), Vec3::Y * (-4.0 * side));
            s.lights[0].shape = LightShape::Rectangle { center, half_u, half_v: Vec3::Z };
        };
        // So far aside, and so high over the untouched pad, mm.
        let at = move |x: f32, low: f32| {
            move |s: &mut Scene| {
                stands(s);
                if let LightShape::Rectangle { center, .. } = &mut s.lights[0].shape {
                    (center.x, center.z) = (x * side, low + 1.0);
                }
            }
        };
        let turned = |s: &mut Scene| {
            if let LightShape::Rectangle { half_u, .. } = &mut s.lights[0].shape {
                *half_u = -*half_u;
            }
        };
        let away = move |s: &mut Scene| {
            stands(s);
            turned(s);
        };
        let low_and_away = move |s: &mut Scene| {
            at(6.03, 0.25)(s);
            turned(s);
        };
        // Too near to the pad to be told, unless beyond the view: the fast mode may leave some of these to the reference.
        let these: [(&str, Due, Make); 7] = [
            ("a lamp stands in the view", Due::Picture, Box::new(changed(stands))),
            ("one that faces away", Due::Picture, Box::new(changed(away))),
            ("one on the pad", Due::Either, Box::new(changed(at(6.03, 0.0)))),
            ("one just over the pad", Due::Picture, Box::new(changed(at(6.03, 0.25)))),
            ("that turned away", Due::Either, Box::new(changed(low_and_away))),
            ("one over a ball", Due::Either, Box::new(changed(at(3.0, 0.5)))),
            ("one on the pad at its end", Due::Picture, Box::new(changed(at(9.99, 0.0)))),
        ];
        for (what, due, make) in these {
            cases.push(case(format!("{what}, {name}"), due, make).judged_closely());
        }
    }
    cases.push(case(
        "a lamp before another",
        Due::Refusal,
        changed(|s| {
            let mut before = s.lights[0].clone();
            if let LightShape::Rectangle { center, .. } = &mut before.shape {
                center.x *= 0.6;
            }
            s.lights.push(Light { name: "before".to_owned(), ..before });
        }),
    ));
    cases.push(case(
        "the pad's edge is in the view",
        Due::Picture,
        changed(|s| {
            let pad = s.surfaces.iter_mut().filter(|s| s.role == Role::Pad);
            pad.for_each(|s| {
                let positions = &mut Arc::make_mut(&mut s.mesh).positions;
                positions.iter_mut().for_each(|p| *p *= Vec3::new(0.73, 0.77, 1.0));
            });
        }),
    ));
    cases.push(case("a lamp is mirrored in a thick plate", Due::Picture, |s| {
        let thick = |scene: &mut Scene| {
            scene.lights.truncate(1);
            at_height(&mut scene.lights[0], 12.0);
            for surface in scene.surfaces.iter_mut().filter(|s| s.role == Role::Plate) {
                let positions = &mut Arc::make_mut(&mut surface.mesh).positions;
                let low = positions.iter().fold(f32::INFINITY, |low, p| low.min(p.z));
                positions.iter_mut().filter(|p| p.z > low).for_each(|p| p.z = 8.0);
            }
        };
        Ok(Trial::new(Variant::B, Press::Cone, s.size, LATTICE)?.changed(thick))
    }));
}

/// Albedos, sizes, meshes and scenes at their ends.
fn extremes(cases: &mut Vec<Case>) {
    cases.push(case("a black pad", Due::Picture, changed(move |s| grey(s, Role::Pad, 0.0))));
    cases.push(case("a white pad", Due::Picture, changed(move |s| grey(s, Role::Pad, 1.0))));
    cases.push(case("black walls", Due::Picture, changed(move |s| grey(s, Role::Housing, 0.0))));
    cases.push(case(
        "bright walls, a bright pad, lamps a little off the walls",
        Due::Picture,
        changed(move |s| {
            grey(s, Role::Pad, 0.9);
            grey(s, Role::Housing, 0.9);
            for light in &mut s.lights {
                if let LightShape::Rectangle { center, half_u, half_v } = &mut light.shape {
                    *center += half_u.cross(*half_v).normalize() * 0.05;
                }
            }
        }),
    ));
    cases.push(case(
        "a closed white box",
        Due::Refusal,
        changed(move |s| {
            grey(s, Role::Pad, 1.0);
            grey(s, Role::Housing, 1.0);
        }),
    ));
    cases.push(case("one event", Due::Picture, changed(|s| s.max_events = 1)));
    cases.push(case("the pad reaches into the plate", Due::Refusal, |s| {
        Trial::new(Variant::B, Press::Punch, s.size, LATTICE)
    }));
    cases.push(case("the lamps stand between pad and plate", Due::Picture, |s| {
        Ok(Trial::new(Variant::B, Press::Sphere, s.size, LATTICE)?.changed(|s| {
            lamps::lift_plates(s, 5.5);
        }))
    }));
    cases.push(case("the camera is inside the plate", Due::Refusal, |s| {
        Ok(Trial::new(Variant::B, Press::Sphere, s.size, LATTICE)?.changed(|s| s.camera.origin.z = 2.5))
    }));
    cases.push(case("the camera is inside the pad", Due::Refusal, |s| {
        let into_ball = |scene: &mut Scene| scene.camera.origin = Vec3::new(1.5, -1.0, 0.5);
        Ok(Trial::new(Variant::Ac, Press::Sphere, s.size, LATTICE)?.changed(into_ball))
    }));
    cases.push(case("a vertex is not a number", Due::Refusal, |s| {
        let mut trial = Trial::new(Variant::Ac, Press::Sphere, s.size, LATTICE)?;
        Arc::make_mut(&mut trial.scene.surfaces[0].mesh).positions[777].z = f32::NAN;
        Ok(trial)
    }));
    cases.push(case(
        "an empty scene",
        Due::Refusal,
        changed(|s| {
            s.surfaces.clear();
            s.lights.clear();
        }),
    ));
    cases.push(case(
        "a pad without extent",
        Due::Refusal,
        changed(|s| {
            Arc::make_mut(&mut s.surfaces[0].mesh).positions.iter_mut().for_each(|p| *p = Vec3::ZERO);
        }),
    ));
    cases.push(case(
        "walls with triangles of no area, and two in one place",
        Due::Picture,
        changed(|s| {
            for walls in s.surfaces.iter_mut().filter(|s| s.role == Role::Housing) {
                let triangles = &mut Arc::make_mut(&mut walls.mesh).triangles;
                let first = triangles[0];
                let [a, b, _] = first;
                triangles.extend([[a, a, b], [b, b, b], first]);
            }
        }),
    ));
    cases.push(case(
        "a pad of 1 triangle, which is left to the reference mode",
        Due::Reference,
        changed(|s| {
            let corners =
                [Vec3::new(-10.0, -7.5, 0.0), Vec3::new(10.0, -7.5, 0.0), Vec3::new(10.0, 7.5, 0.0)];
            let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Mesh::default() };
            s.surfaces[0].mesh = Arc::new(mesh);
        }),
    ));
    for lattice in [[2, 2], [3, 2], [1001, 501]] {
        let name = format!("a pad of {} triangles", 2 * (lattice[0] - 1) * (lattice[1] - 1));
        cases
            .push(case(name, Due::Picture, move |s| Trial::new(Variant::Ac, Press::Sphere, s.size, lattice)));
    }
    for (name, change) in [
        ("a lamp 100 m away", (|s| at_height(&mut s.lights[0], 1e5)) as fn(&mut Scene)),
        ("a lamp beyond all numbers", |s| at_height(&mut s.lights[0], 1e30)),
        ("everything a millionth as large", |s| resized(s, 1e-6)),
    ] {
        cases.push(case(name, Due::Refusal, changed(change)));
    }
    for scale in [0.01, 0.5, 3.0, 1000.0] {
        let name = format!("everything {scale} times as large");
        cases.push(case(name, Due::Either, move |s| changed(move |s| resized(s, scale))(s)));
    }
}

/// Gives what has this role a grey coat.
pub(super) fn grey(scene: &mut Scene, role: Role, albedo: f32) {
    let of_role = scene.surfaces.iter_mut().filter(|s| s.role == role);
    of_role.for_each(|s| s.material = Material::Lambert { albedo: Albedo::grey(albedo) });
}

fn resized(scene: &mut Scene, scale: f32) {
    for surface in &mut scene.surfaces {
        let mesh: &mut Mesh = Arc::make_mut(&mut surface.mesh);
        mesh.positions.iter_mut().for_each(|p| *p *= scale);
    }
    for light in &mut scene.lights {
        if let LightShape::Rectangle { center, half_u, half_v } = &mut light.shape {
            (*center, *half_u, *half_v) = (*center * scale, *half_u * scale, *half_v * scale);
        }
    }
    scene.camera.origin *= scale;
}
