//! What the optics must bear: odd pads, lights, scales and scenes, each rendered by the fast mode or refused.
//!
//! A case ends well when its picture is finite, not negative, below what its lights can give at all, and no farther from
//! the reference than its own estimate says, pixel by pixel and in the means of squares, in which there is less noise and as
//! much of what is too bright or too dark; or when it is refused with a typed error where a refusal is due. The presses
//! and lights here are others than those that the estimate's constants were found on, so they test its honesty.

use super::bench_scene::Variant;
use super::trial::{Judge, Press, Trial, bound};
use super::{Albedo, Error, Film, Light, LightShape, Material, Mesh, Role, Scene, fast, reference};
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

/// How much to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns and rows of the pictures.
    pub size: [usize; 2],
    /// Samples a pixel of each of the two judging pictures.
    pub judge_samples: u32,
    /// relRMSE asked for.
    pub tolerance: f64,
    /// Every so many-th case only.
    pub every: usize,
    /// Only cases whose names hold this.
    pub only: Option<String>,
}

/// How a case ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Outcome {
    /// Rendered.
    Picture {
        /// relRMSE against the reference, its noise taken off.
        error: f64,
        /// Below this the judges cannot tell.
        floor: f64,
        /// The same two of the means of squares.
        means: [f64; 2],
        /// What the mode said of itself.
        estimated: f64,
        /// Whether the judges' noise is more than that: the case tells nothing finer than its floor.
        undecided: bool,
    },
    /// Refused.
    Refused {
        /// The message.
        why: String,
    },
}

/// A case and its verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// What was tried.
    pub case: String,
    /// How it ended.
    pub outcome: Outcome,
    /// What is wrong with that; none when all is well.
    pub faults: Vec<String>,
}

/// Errors may exceed the estimate by this factor, and by this much, before it is called dishonest: an estimate is no bound.
const HONEST: (f64, f64) = (1.15, 0.0005);

/// What a case may end as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Due {
    Picture,
    Refusal,
    Either,
    /// A refusal, and a picture by the reference mode.
    Reference,
}

/// Makes what a case tries.
type Make = Box<dyn Fn(&Settings) -> Result<Trial, Error>>;

struct Case {
    name: String,
    due: Due,
    make: Make,
    /// So many times the samples judge it: the edge of a lamp is noise in a few pixels, of which the floor tells too little.
    times: u32,
}

impl Case {
    fn judged_closely(self) -> Self {
        Self { times: CLOSELY, ..self }
    }
}

/// How many times the samples of other cases.
const CLOSELY: u32 = 4;

/// Tries all cases; `tell` hears each verdict as it falls.
pub fn run(settings: &Settings, mut tell: impl FnMut(&Verdict)) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    // Cases of one sensor follow each other: it is prepared once for all of them.
    let mut prepared: Option<([u8; 32], fast::Precomputed)> = None;
    let wanted = |case: &&Case| settings.only.as_ref().is_none_or(|part| case.name.contains(part));
    for case in cases().iter().filter(wanted).step_by(settings.every.max(1)) {
        let verdict = try_case(case, settings, &mut prepared);
        tell(&verdict);
        verdicts.push(verdict);
    }
    verdicts
}

fn try_case(
    case: &Case,
    settings: &Settings,
    prepared: &mut Option<([u8; 32], fast::Precomputed)>,
) -> Verdict {
    let mut faults = Vec::new();
    let outcome = match picture_of(case, settings, prepared, &mut faults) {
        Ok(outcome) => outcome,
        Err(e) => Outcome::Refused { why: e.to_string() },
    };
    match (&outcome, case.due) {
        (Outcome::Refused { why }, Due::Picture) => faults.push(format!("it was refused: {why}")),
        (Outcome::Picture { .. }, Due::Refusal | Due::Reference) => {
            faults.push("it was not refused".to_owned());
        }
        (Outcome::Refused { .. }, Due::Reference) => faults.extend(not_traced(case, settings)),
        _ => {}
    }
    Verdict { case: case.name.clone(), outcome, faults }
}

/// What is wrong with a case's picture by the reference mode.
fn not_traced(case: &Case, settings: &Settings) -> Option<String> {
    let traced = || {
        let scene = (case.make)(settings)?.scene;
        let samples = settings.judge_samples;
        Ok::<_, Error>(reference::Renderer::new(&scene)?.render(&reference::Settings { samples, seed: 0xa }))
    };
    match traced() {
        Ok(film) if film.pixels.iter().any(|p| !(p.is_finite() && p.cmpge(Vec3::ZERO).all())) => {
            Some("the reference mode's picture is no light".to_owned())
        }
        Ok(film) if film.mean() == Vec3::ZERO => Some("the reference mode's picture is black".to_owned()),
        Ok(_) => None,
        Err(e) => Some(format!("the reference mode refused it, too: {e}")),
    }
}

fn picture_of(
    case: &Case,
    settings: &Settings,
    prepared: &mut Option<([u8; 32], fast::Precomputed)>,
    faults: &mut Vec<String>,
) -> Result<Outcome, Error> {
    let Trial { scene, untouched } = (case.make)(settings)?;
    let key = fast::Precomputed::key(&untouched);
    let once = match prepared.take() {
        Some((of, once)) if of == key => once,
        _ => fast::Precomputed::new(&untouched)?,
    };
    let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
    let once = once.with_radiances(&radiances)?;
    let (film, estimated) = fast::Renderer::new(&once, &scene, settings.tolerance)?.render_with_error();
    *prepared = Some((key, once));
    let most = bound(&scene) * 1.001;
    let broken = film.pixels.iter().filter(|p| !(p.is_finite() && p.cmpge(Vec3::ZERO).all())).count();
    if broken > 0 || !estimated.is_finite() {
        faults.push(format!("{broken} pixels are no light (estimate {estimated})"));
    }
    let bright = film.pixels.iter().filter(|p| !p.cmple(most).all()).count();
    if bright > 0 {
        faults.push(format!("{bright} pixels are brighter than all light there is ({most})"));
    }
    let mut trial = judged(&scene, &film, settings.judge_samples * case.times, estimated)?;
    if trial.undecided && case.times < CLOSELY {
        trial = judged(&scene, &film, settings.judge_samples * CLOSELY, estimated)?;
    }
    for [error, floor] in [trial.pixels, trial.means] {
        if error > HONEST.0 * estimated + HONEST.1 + floor {
            faults.push(format!("the error is {error:.4}, the estimate said {estimated:.4}"));
        }
    }
    let Judged { pixels: [error, floor], means, undecided } = trial;
    Ok(Outcome::Picture { error, floor, means, estimated, undecided })
}

/// Errors of a picture, and below what they drown in noise.
struct Judged {
    pixels: [f64; 2],
    means: [f64; 2],
    undecided: bool,
}

fn judged(scene: &Scene, film: &Film, samples: u32, estimated: f64) -> Result<Judged, Error> {
    let judge = Judge::new(scene, samples)?;
    let (of_means, shrunk) = (judge.of_means(SQUARE), film.shrunk(SQUARE));
    let pixels = [judge.error(film), judge.floor()];
    let means = [of_means.error(&shrunk), of_means.floor()];
    Ok(Judged { pixels, means, undecided: pixels[1].min(means[1]) > estimated })
}

/// Pixels along a side of the squares whose means are judged.
const SQUARE: usize = 8;

/// Points of the pad's lattice.
const LATTICE: [usize; 2] = [401, 301];

fn case(
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
fn changed(change: impl Fn(&mut Scene) + Copy) -> impl Fn(&Settings) -> Result<Trial, Error> {
    move |s| Ok(Trial::new(Variant::Ac, Press::Sphere, s.size, LATTICE)?.changed(change))
}

fn cases() -> Vec<Case> {
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
    for (name, press) in [("cone", Press::Cone), ("ring", Press::Ring), ("drag", Press::Drag(3.0))] {
        cases.push(case(format!("textured {name}"), Due::Picture, move |s| {
            Trial::new(Variant::At, press, s.size, LATTICE)
        }));
        cases.push(case(format!("{name} under a plate"), Due::Picture, move |s| {
            Trial::new(Variant::B, press, s.size, LATTICE)
        }));
    }
    lights(&mut cases);
    in_view(&mut cases);
    extremes(&mut cases);
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

/// Lights in places where they should not be.
fn lights(cases: &mut Vec<Case>) {
    for z in [0.6, 1.05, 3.0, 15.0] {
        let name = format!("lights {z} mm above the face");
        cases.push(case(name, Due::Picture, move |s| {
            let lower = move |scene: &mut Scene| scene.lights.iter_mut().for_each(|l| at_height(l, z));
            changed(lower)(s)
        }));
    }
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

/// Albedos, sizes, meshes and scenes at their ends.
fn extremes(cases: &mut Vec<Case>) {
    let grey = |s: &mut Scene, role: Role, albedo: f32| {
        s.surfaces
            .iter_mut()
            .filter(|s| s.role == role)
            .for_each(|s| s.material = Material::Lambert { albedo: Albedo::grey(albedo) });
    };
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
            let plates = s.surfaces.iter_mut().filter(|s| s.role == Role::Plate);
            plates.flat_map(|s| &mut Arc::make_mut(&mut s.mesh).positions).for_each(|p| p.z += 5.5);
        }))
    }));
    cases.push(case("the camera is inside the plate", Due::Refusal, |s| {
        Ok(Trial::new(Variant::B, Press::Sphere, s.size, LATTICE)?.changed(|s| s.camera.origin.z = 2.5))
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

/// Moves a light's lower edge to a height.
fn at_height(light: &mut Light, z: f32) {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Some of the cases on small pictures (the command does all of them): each ends well.
    #[test]
    fn one_triangle_is_refused_and_traced() {
        let settings = Settings { size: [32, 24], judge_samples: 4, tolerance: 0.005, every: 1, only: None };
        let cases = cases();
        let mut of_one = cases.into_iter().filter(|case| case.name.contains("of 1 triangle"));
        let mut case = of_one.next().unwrap();
        let verdict = try_case(&case, &settings, &mut None);
        let Outcome::Refused { why } = &verdict.outcome else { panic!("{verdict:?}") };
        assert!(why.contains("reference") && verdict.faults.is_empty(), "{verdict:?}");
        // What the reference mode cannot render either is a fault.
        case.make = Box::new(|s| changed(|s| s.surfaces.clear())(s));
        assert!(!try_case(&case, &settings, &mut None).faults.is_empty());
    }

    #[test]
    fn every_ninth_case_ends_well() {
        let settings = Settings { size: [32, 24], judge_samples: 16, tolerance: 0.005, every: 9, only: None };
        let verdicts = run(&settings, |_| {});
        let bad: Vec<&Verdict> = verdicts.iter().filter(|v| !v.faults.is_empty()).collect();
        assert!(bad.is_empty() && verdicts.len() > 4, "{bad:#?}");
    }
}
