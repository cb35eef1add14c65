//! The fast mode's error where it is hard: indenters with edges, deep presses, drags, folds, textures, a domed pad, a glossy
//! coat, single lights, the plate.
//!
//! Each case is judged at one tolerance against two reference pictures of its own ([`Judge`]), beside what the mode said of
//! itself.

use super::Clock;
use crate::optics::bench_scene::Variant;
use crate::optics::judge::{Judge, Judged};
use crate::optics::trial::{Press, Trial};
use crate::optics::{Error, Material, Scene, fast};
use glam::Vec3;
use serde::Serialize;
use std::sync::Arc;

/// A case measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// What is seen.
    pub name: String,
    /// How the fast mode did; why it leaves the case to the reference mode, otherwise.
    pub outcome: Result<Measured, String>,
}

/// How the fast mode did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measured {
    /// relRMSE against the reference, the judges' noise taken off.
    pub error: f64,
    /// Below this the judges cannot tell.
    pub floor: f64,
    /// What the mode said of itself.
    pub estimated: f64,
    /// Processor seconds a frame.
    pub cpu_s: f64,
    /// Wall seconds a frame.
    pub wall_s: f64,
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Columns and rows of the pictures.
    pub size: [usize; 2],
    /// Samples a pixel of each of the two judging pictures.
    pub judge_samples: u32,
    /// relRMSE asked for.
    pub tolerance: f64,
}

/// Points of the pad's lattice.
const LATTICE: [usize; 2] = [641, 481];
/// Radius of the domed pad, and how far its top is above the flat one, mm.
const DOME_MM: [f32; 2] = [100.0, 0.3];

type Make = Box<dyn Fn() -> Result<Trial, Error>>;

fn cases(size: [usize; 2]) -> Vec<(String, Make)> {
    let mut cases: Vec<(String, Make)> = Vec::new();
    let mut add = |name: &str, make: Make| cases.push((name.to_owned(), make));
    for (name, variant) in
        [("Ac", Variant::Ac), ("At: dotted texture", Variant::At), ("B: plate", Variant::B)]
    {
        add(name, Box::new(move || Trial::own(variant, size)));
    }
    for (name, variant, press) in [
        ("stamp, 1 mm, steep flanks", Variant::Ac, Press::Stamp),
        ("round plug, 1.2 mm, upright flanks", Variant::Ac, Press::Plug),
        ("round plug with dots", Variant::At, Press::Plug),
        ("cone, 1.2 mm", Variant::Ac, Press::Cone),
        ("pyramid, 1 mm", Variant::Ac, Press::Pyramid),
        ("ridge, 0.8 mm", Variant::Ac, Press::Ridge),
        ("step of 1 mm", Variant::Ac, Press::Cliff),
        ("punch, 1.5 mm", Variant::Ac, Press::Punch),
        ("post, 1.5 mm", Variant::Ac, Press::Post),
        ("ball, dragged 5 mm", Variant::Ac, Press::Drag(5.0)),
        ("ball, dragged over itself", Variant::Ac, Press::Fold),
        ("punch, 1.5 mm, dotted", Variant::At, Press::Punch),
        ("dragged 5 mm, dotted", Variant::At, Press::Drag(5.0)),
        ("cone under the plate", Variant::B, Press::Cone),
    ] {
        add(name, Box::new(move || Trial::new(variant, press, size, LATTICE)));
    }
    add(
        "domed pad, stamp 1 mm",
        Box::new(move || Ok(domed(Trial::new(Variant::Ac, Press::Stamp, size, LATTICE)?))),
    );
    add(
        "glossy coat",
        Box::new(move || {
            let gloss = Material::RoughConductor { f0: Vec3::splat(0.8), alpha: 0.3 };
            Ok(Trial::own(Variant::Ac, size)?.changed(|s| s.surfaces[0].material = gloss.clone()))
        }),
    );
    for light in 0..4 {
        add(
            &format!("Ac, light {light} alone"),
            Box::new(move || Ok(alone(Trial::own(Variant::Ac, size)?, light))),
        );
    }
    for light in 0..2 {
        add(
            &format!("punch, 1.5 mm, light {light} alone"),
            Box::new(move || Ok(alone(Trial::new(Variant::Ac, Press::Punch, size, LATTICE)?, light))),
        );
    }
    cases
}

/// Names of all cases.
pub fn names() -> Vec<String> {
    cases([1, 1]).into_iter().map(|(name, _)| name).collect()
}

fn alone(trial: Trial, light: usize) -> Trial {
    trial.changed(|scene| {
        let others = scene.lights.iter_mut().enumerate().filter(|(k, _)| *k != light);
        others.for_each(|(_, l)| l.radiance = Vec3::ZERO);
    })
}

/// The same press on a dome.
fn domed(trial: Trial) -> Trial {
    let [radius, top] = DOME_MM;
    trial.changed(|scene: &mut Scene| {
        for p in &mut Arc::make_mut(&mut scene.surfaces[0].mesh).positions {
            p.z += (radius * radius - p.x * p.x - p.y * p.y).sqrt() - radius + top;
        }
    })
}

/// Measures all cases whose name contains `which`.
pub(super) fn run(
    settings: &Settings,
    which: &str,
    clock: &Clock,
    tell: &mut impl FnMut(&str),
) -> Result<Vec<Case>, Error> {
    let mut done = Vec::new();
    let mut prepared: Option<([u8; 32], fast::Precomputed)> = None;
    for (name, make) in cases(settings.size).into_iter().filter(|(name, _)| name.contains(which)) {
        tell(&format!("case {name} ..."));
        let Trial { scene, untouched } = make()?;
        let key = fast::Precomputed::key(&untouched);
        let once = match prepared.take() {
            Some((of, once)) if of == key => Ok(once),
            _ => fast::Precomputed::new(&untouched),
        };
        let once = match once {
            Ok(once) => once,
            Err(e @ Error::NotFast { .. }) => {
                done.push(Case { name, outcome: Err(e.to_string()) });
                continue;
            }
            Err(e) => return Err(e),
        };
        let radiances: Vec<Vec3> = scene.lights.iter().map(|l| l.radiance).collect();
        let lit = once.with_radiances(&radiances)?;
        let (took, (film, estimated)) = clock.time(|| super::frame(&lit, &scene, settings.tolerance))?;
        let judge = Judge::new(&scene, settings.judge_samples)?;
        let Judged { error, floor } = judge.judged(&film);
        let measured = Measured { error, floor, estimated, cpu_s: took.cpu_s, wall_s: took.wall_s };
        done.push(Case { name, outcome: Ok(measured) });
        prepared = Some((key, once));
    }
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glossy_coat_is_left_to_the_reference_and_the_rest_is_measured() {
        let start = std::time::Instant::now();
        let cpu = move || start.elapsed().as_secs_f64();
        let clock = Clock { cpu: &cpu, repeat: 1 };
        let settings = Settings { size: [32, 24], judge_samples: 8, tolerance: 0.005 };
        let cases = run(&settings, "glossy", &clock, &mut |_| {}).unwrap();
        assert!(cases.len() == 1 && cases[0].outcome.as_ref().unwrap_err().contains("reference"));
        let cases = run(&settings, "light 2 alone", &clock, &mut |_| {}).unwrap();
        let measured = cases[0].outcome.as_ref().unwrap();
        assert!(measured.error < 0.02 + measured.floor && measured.estimated > 0.0, "{measured:?}");
    }
}
