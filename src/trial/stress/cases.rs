//! The cases: a number becomes a family, and draws choose the levels.
//!
//! Levels (elastomer.md, section 4): stiffness over four decades, nu to 0.499, depth to 60 % of the thickness,
//! friction from none to infinite, slides to 5 mm, turns to 45 degrees, coarse and fine, sharp and thin bodies,
//! edges of the pad, tiny and huge pads, steps up to the stability limit. Coarse tolerances are drawn more often than fine
//! ones: they cost less, and a robust solver is shown by many cases rather than by large ones.

use super::hostile;
use super::thin::draw_thin;
use crate::draw::Draw;
use crate::elastomer::mpm::scheme::Scheme;
use crate::elastomer::{Coating, Friction, Law, Mode, Pad, PadShape, Settings};
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{self, Indenter, IndenterSpec};
use crate::trial::scene;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Most particle-steps of an explicit case without a purpose of its own.
const MOST_PARTICLE_STEPS: f64 = 3e7;

/// What a case is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Press, look at work and symmetry, release.
    Press,
    /// Press, slide, release.
    Slide,
    /// Press, turn, release.
    Turn,
    /// A small press against the exact bonded layer.
    Layer,
    /// The same press with a third of the tolerance.
    Finer,
    /// A slide to one side and to the other.
    Mirror,
    /// The same path twice, with other threads.
    Repeat,
    /// Press and let go, many times.
    Cycles,
    /// Indenters at, over and beside the pad's edge.
    Border,
    /// Tiny, huge, thin and thick pads.
    Scale,
    /// Domed, cylindrical and rounded pads, coated or not.
    Shape,
    /// Thin bodies askew to the grid.
    Thin,
    /// The explicit modes.
    Explicit,
    /// The explicit modes at their limits: 1e5 steps, 13 million particles.
    Long,
    /// What makes no sense.
    Hostile,
}

impl Family {
    /// All of them.
    pub const ALL: [Family; 15] = [
        Family::Press,
        Family::Slide,
        Family::Turn,
        Family::Layer,
        Family::Finer,
        Family::Mirror,
        Family::Repeat,
        Family::Cycles,
        Family::Border,
        Family::Scale,
        Family::Shape,
        Family::Thin,
        Family::Explicit,
        Family::Long,
        Family::Hostile,
    ];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Family::Press => "press",
            Family::Slide => "slide",
            Family::Turn => "turn",
            Family::Layer => "exact layer",
            Family::Finer => "against finer",
            Family::Mirror => "mirrored slides",
            Family::Repeat => "repeated",
            Family::Cycles => "cycles",
            Family::Border => "pad's edge",
            Family::Scale => "size of pad",
            Family::Shape => "shape of pad",
            Family::Thin => "thin bodies",
            Family::Explicit => "mpm, impm",
            Family::Long => "mpm, long",
            Family::Hostile => "bad settings",
        }
    }
}

/// The order in which families take turns: every twenty cases have the same composition.
const TURNS: [Family; 20] = [
    Family::Press,
    Family::Explicit,
    Family::Slide,
    Family::Hostile,
    Family::Turn,
    Family::Explicit,
    Family::Press,
    Family::Layer,
    Family::Slide,
    Family::Hostile,
    Family::Finer,
    Family::Explicit,
    Family::Press,
    Family::Mirror,
    Family::Scale,
    Family::Hostile,
    Family::Explicit,
    Family::Turn,
    Family::Border,
    // Cycles, Repeat, Cycles, Long by turns.
    Family::Cycles,
];

/// Numbers of the cases about pads that are not flat or have a skin.
const SHAPES: std::ops::Range<u32> = 300..330;
/// Numbers of the cases about thin bodies.
const THIN: std::ops::Range<u32> = 330..360;

/// An indenter file.
#[derive(Debug, Clone)]
pub struct Body {
    /// Its name.
    pub name: String,
    /// What it says.
    pub spec: IndenterSpec,
}

/// One case of the sweep.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its number.
    pub number: u32,
    /// What it is about.
    pub family: Family,
    /// What is pressed into the pad.
    pub body: Body,
    /// Pad and material.
    pub pad: Pad,
    /// Settings.
    pub settings: Settings,
    /// Where the press is, mm.
    pub at_mm: [f64; 2],
    /// How the body stands to the grid from the beginning, degrees.
    pub askew_deg: f64,
    /// How deep, mm.
    pub depth_mm: f64,
    /// Slide, mm.
    pub slide_mm: f64,
    /// Its direction, degrees.
    pub direction_deg: f64,
    /// Turn, degrees.
    pub turn_deg: f64,
    /// Points of the surface lattice along each side.
    pub lattice: usize,
    /// Press-release cycles, or steps.
    pub times: u32,
    /// What makes no sense about it.
    pub hostile: Option<&'static str>,
}

impl Case {
    /// The indenter.
    pub fn indenter(&self) -> Arc<dyn Indenter> {
        indenter::from_spec(&self.body.name, &self.body.spec, None)
            .expect("the bodies of the sweep are built when its cases are made")
    }

    /// Everything that was drawn, in a line.
    pub fn title(&self) -> String {
        let m = &self.pad.material;
        let s = &self.settings;
        let mode = match s.mode {
            Mode::QuasiStatic => format!("tolerance {}", s.tolerance),
            Mode::Mpm => format!("mpm {:?} dt {:?} v {:.0}", s.particles, s.dt_s, s.speed_mm_s),
            Mode::Impm => format!(
                "impm {:?} dt {:?} v {:.0} rest {}",
                s.particles, s.dt_s, s.speed_mm_s, s.rest_threshold
            ),
        };
        let law = match m.law {
            Law::FixedCorotated => "fixed-corotated",
            Law::NeoHookean => "neo-Hookean",
        };
        let friction = match s.friction {
            Friction::Infinite => "stick".to_owned(),
            Friction::Coefficient(mu) => format!("mu {mu}"),
        };
        let mut text = format!(
            "{} edge {} on {}x{}x{} mm, E {} nu {} {law}, {friction}, {mode}: depth {} at ({}, {})",
            self.body.name,
            self.body.spec.edge_round_mm,
            self.pad.size_x_mm,
            self.pad.size_y_mm,
            self.pad.thickness_mm,
            m.youngs_modulus_mpa,
            m.poisson_ratio,
            self.depth_mm,
            self.at_mm[0],
            self.at_mm[1]
        );
        if self.pad.shape != PadShape::Cuboid {
            text += &format!(", {:?}", self.pad.shape);
        }
        if let Some(skin) = &self.pad.coating {
            text += &format!(", skin {} mm of {} MPa", skin.thickness_mm, skin.youngs_modulus_mpa);
        }
        if self.askew_deg != 0.0 {
            text += &format!(", {} deg askew", self.askew_deg);
        }
        if self.slide_mm != 0.0 {
            text += &format!(", slide {} mm towards {} deg", self.slide_mm, self.direction_deg);
        }
        if self.turn_deg != 0.0 {
            text += &format!(", turn {} deg", self.turn_deg);
        }
        if self.times > 1 {
            text += &format!(", {} times", self.times);
        }
        if let Some(hostile) = self.hostile {
            text += &format!(" [{hostile}]");
        }
        text
    }
}

/// Bodies that no shipped file has: sharp, thin, tiny.
fn hard_bodies() -> Vec<Body> {
    let body = |name: &str, shape| Body { name: name.into(), spec: scene::spec(shape, 0.0) };
    let flat = |plan| Shape::Flat { plan };
    vec![
        body("needle", Shape::Cone { tip_diameter_mm: 0.1, half_angle_deg: 10.0 }),
        body("knife", flat(Plan::Rectangle { x_mm: 0.2, y_mm: 10.0 })),
        body("pin", flat(Plan::Disc { diameter_mm: 0.4 })),
        body("bead", Shape::Dome { radius_mm: 0.3, diameter_mm: 0.6 }),
        body("lens", Shape::Dome { radius_mm: 100.0, diameter_mm: 10.0 }),
        body("tall_cone", Shape::Cone { tip_diameter_mm: 0.5, half_angle_deg: 45.0 }),
    ]
}

fn sphere(radius_mm: f64) -> Body {
    let shape = Shape::Dome { radius_mm, diameter_mm: 2.0 * radius_mm };
    let spec = IndenterSpec { height_mm: radius_mm + 4.0, ..scene::spec(shape, 0.0) };
    Body { name: format!("sphere R{radius_mm}"), spec }
}

/// A flat round punch, its edge rounded.
fn disc() -> Body {
    let shape = Shape::Flat { plan: Plan::Disc { diameter_mm: 6.0 } };
    Body { name: "disc".into(), spec: scene::spec(shape, 0.3) }
}

/// One of the given bodies or a hard one, its edges sharp or rounded where that fits.
fn any_body(draw: &mut Draw, bodies: &[Body]) -> Body {
    let hard = hard_bodies();
    let n = draw.below(bodies.len() + hard.len());
    let mut body = if n < bodies.len() { bodies[n].clone() } else { hard[n - bodies.len()].clone() };
    let round = draw.of(&[0.0, 0.3, 0.3, 0.5]);
    if indenter::from_spec(&body.name, &body.spec, Some(round)).is_ok() {
        body.spec.edge_round_mm = round;
    }
    body
}

/// Case `number` of the sweep with this seed, over the given bodies (at least one) and a few hard ones.
pub fn case(number: u32, seed: u64, bodies: &[Body]) -> Case {
    let mut draw = Draw::new(seed, number);
    let draw = &mut draw;
    let (round, turn) = (number / TURNS.len() as u32, number as usize % TURNS.len());
    let mut family = TURNS[turn];
    if family == Family::Cycles {
        family = [Family::Cycles, Family::Repeat, Family::Long, Family::Repeat][round as usize % 4];
    }
    if SHAPES.contains(&number) {
        family = Family::Shape;
    }
    if THIN.contains(&number) {
        family = Family::Thin;
    }
    let law = draw.of(&[Law::NeoHookean, Law::FixedCorotated]);
    let mut case = Case {
        number,
        family,
        body: any_body(draw, bodies),
        pad: scene::pad(law),
        settings: scene::quasi_static(Friction::Coefficient(0.5), 0.05),
        at_mm: [0.0; 2],
        askew_deg: 0.0,
        depth_mm: draw.of(&[0.01, 0.1, 0.25, 0.5, 0.5, 1.0, 1.0, 1.6, 2.4]),
        slide_mm: 0.0,
        direction_deg: 0.0,
        turn_deg: 0.0,
        lattice: 81,
        times: 1,
        hostile: None,
    };
    let m = &mut case.pad.material;
    m.youngs_modulus_mpa = draw.of(&[0.001, 0.0145, 0.145, 0.145, 0.145, 1.45, 10.0]);
    m.poisson_ratio = draw.of(&[0.0, 0.3, 0.40, 0.45, 0.45, 0.48, 0.49, 0.499]);
    let mu = draw.of(&[0.0, 0.2, 0.5, 1.0]);
    case.settings.friction = if draw.below(5) < 2 { Friction::Infinite } else { Friction::Coefficient(mu) };
    case.settings.tolerance = draw.of(&[0.1, 0.1, 0.1, 0.05, 0.05, 0.02]);
    let (direction, slide, angle) =
        (45.0 * draw.below(8) as f64, draw.of(&[0.25, 1.0, 2.0, 5.0]), draw.of(&[-15.0, 5.0, 15.0, 45.0]));
    match family {
        Family::Press => case.settings.tolerance = draw.of(&[0.1, 0.05, 0.05, 0.02, 0.01]),
        Family::Slide => {
            (case.slide_mm, case.direction_deg) = (slide, direction);
            case.depth_mm = case.depth_mm.min(1.6);
        }
        Family::Turn => {
            case.turn_deg = angle;
            case.depth_mm = case.depth_mm.min(1.6);
        }
        Family::Layer => {
            let radius = draw.of(&[2.0, 3.0, 4.0, 5.0]);
            case.body = sphere(radius);
            // sqrt(R d) / h from 0.14 to 0.17: deep enough for the cells, shallow enough for small strain.
            case.depth_mm = (draw.of(&[0.14, 0.155, 0.17]) * case.pad.thickness_mm).powi(2) / radius;
            case.pad.material.poisson_ratio = draw.of(&[0.3, 0.40, 0.45, 0.48, 0.49]);
            case.settings.friction = Friction::Coefficient(0.0);
            case.settings.tolerance = draw.of(&[0.02, 0.01]);
        }
        Family::Finer => {
            case.settings.tolerance = draw.of(&[0.1, 0.05]);
            case.depth_mm = case.depth_mm.clamp(0.1, 1.0);
            case.slide_mm = draw.of(&[0.0, 0.0, 0.25]);
        }
        Family::Mirror => {
            case.body = draw.of(&[sphere(2.0), sphere(3.0), sphere(5.0), disc()].each_ref()).clone();
            case.slide_mm = slide.min(1.0);
            case.depth_mm = case.depth_mm.clamp(0.1, 1.0);
        }
        Family::Repeat => {
            case.slide_mm = 0.25;
            case.turn_deg = 5.0;
            case.settings.tolerance = 0.1;
            case.depth_mm = case.depth_mm.min(1.0);
        }
        Family::Cycles => {
            case.body = sphere(draw.of(&[1.0, 2.0]));
            (case.pad.size_x_mm, case.pad.size_y_mm, case.pad.thickness_mm) = (8.0, 8.0, 2.0);
            case.depth_mm = draw.of(&[0.2, 0.4]);
            case.settings.tolerance = 0.1;
            case.settings.friction = draw.of(&[Friction::Coefficient(0.0), Friction::Infinite]);
            case.times = if case.settings.friction == Friction::Infinite { 100 } else { 1000 };
            case.lattice = 17;
        }
        Family::Border => {
            case.at_mm =
                draw.of(&[[7.0, 0.0], [8.5, 8.5], [9.9, 0.0], [10.0, 10.0], [12.0, 0.0], [30.0, -30.0]]);
            case.depth_mm = case.depth_mm.min(1.0);
            case.slide_mm = draw.of(&[0.0, 1.0]);
        }
        Family::Scale => {
            let [x, y, z] = draw.of(&[
                [2.0, 2.0, 0.5],
                [40.0, 40.0, 4.0],
                [10.0, 30.0, 2.0],
                [6.0, 6.0, 12.0],
                [20.0, 20.0, 0.5],
            ]);
            (case.pad.size_x_mm, case.pad.size_y_mm, case.pad.thickness_mm) = (x, y, z);
            case.depth_mm = case.depth_mm.min(0.6 * z);
            if x.min(y) < 5.0 {
                case.body = sphere(0.5);
                case.depth_mm = case.depth_mm.min(0.1);
            }
        }
        Family::Shape => {
            (case.pad.size_x_mm, case.pad.size_y_mm, case.pad.thickness_mm) = (18.0, 18.0, 3.0);
            case.pad.shape = draw.of(&[
                PadShape::Dome { radius_mm: 13.5 },
                PadShape::Dome { radius_mm: 40.0 },
                PadShape::Cylinder { radius_mm: 10.0 },
                PadShape::Cylinder { radius_mm: 25.0 },
                PadShape::Rounded { radius_mm: 1.0 },
                PadShape::Rounded { radius_mm: 2.5 },
                PadShape::Cuboid,
            ]);
            let skin = |thickness_mm, times| {
                let youngs_modulus_mpa = times * case.pad.material.youngs_modulus_mpa;
                Some(Coating { thickness_mm, youngs_modulus_mpa, poisson_ratio: 0.45 })
            };
            case.pad.coating = draw.of(&[None, None, skin(0.1, 10.0), skin(0.5, 0.2), skin(0.03, 50.0)]);
            case.at_mm = draw.of(&[[0.0, 0.0], [0.0, 0.0], [2.0, 0.0], [-3.0, 2.5], [0.0, 4.0]]);
            case.depth_mm = case.depth_mm.clamp(0.1, 1.0);
            case.slide_mm = draw.of(&[0.0, 0.5]);
            case.turn_deg = draw.of(&[0.0, 5.0]);
        }
        Family::Thin => draw_thin(&mut case, draw),
        Family::Explicit => explicit(&mut case, draw, slide.min(2.0), angle),
        Family::Long => long(&mut case, round / 4),
        Family::Hostile => {
            // Each in turn; three of twenty cases are of this kind.
            let nth = 3 * round as usize + [3, 9, 15].iter().position(|t| *t == turn).unwrap_or(0);
            case.body = sphere(3.0);
            case.depth_mm = 0.5;
            case.pad = scene::pad(law);
            case.settings = scene::quasi_static(Friction::Coefficient(0.5), 0.1);
            hostile::spoil(&mut case, nth);
        }
    }
    case
}

fn explicit(case: &mut Case, draw: &mut Draw, slide_mm: f64, turn_deg: f64) {
    let s = &mut case.settings;
    s.friction = Friction::Infinite;
    s.mode = draw.of(&[Mode::Mpm, Mode::Impm]);
    s.particles = draw.of(&[[26, 26, 6], [41, 41, 9], [51, 51, 11], [81, 81, 17]]);
    s.rest_threshold = draw.of(&[0.05, 0.5, 0.5, 1.0]);
    s.rest_limit = draw.of(&[1, 5, 20]);
    case.lattice = 101;
    match draw.below(3) {
        0 => {}
        1 => case.slide_mm = slide_mm,
        _ => case.turn_deg = turn_deg,
    }
    let Ok(scheme) = Scheme::new(&case.pad, &case.settings) else { return };
    let s = &mut case.settings;
    if let Some(part) = draw.of(&[None, Some(0.3), Some(0.6), Some(0.99)]) {
        s.dt_s = Some(part * scheme.stability_limit_s());
    }
    // As slow as the budget allows, as fast as the cell allows.
    let dt = s.dt_s.unwrap_or(scheme.dt_s);
    let way = case.depth_mm + 3.0 * scheme.dx_mm + case.slide_mm + case.turn_deg.abs() / 10.0;
    let steps = MOST_PARTICLE_STEPS / scheme.particles.iter().product::<usize>() as f64;
    let fastest = 0.29 * scheme.dx_mm / dt;
    s.speed_mm_s = draw.of(&[20.0f64, 100.0, 200.0, 400.0]).max(way / (steps * dt)).min(fastest);
}

/// Those that take long for a reason.
fn long(case: &mut Case, nth: u32) {
    case.body = sphere(3.0);
    case.pad = scene::pad(case.pad.material.law);
    let s = &mut case.settings;
    s.friction = Friction::Infinite;
    case.depth_mm = 0.5;
    if nth.is_multiple_of(2) {
        // 1e5 steps back and forth on a pad of 605 particles.
        s.mode = Mode::Impm;
        s.particles = [11, 11, 5];
        (case.pad.size_x_mm, case.pad.size_y_mm, case.pad.thickness_mm) = (10.0, 10.0, 4.0);
        s.speed_mm_s = 50.0;
        case.times = 100_000;
        case.lattice = 21;
    } else {
        // The finest lattice that is asked for, a few steps into contact.
        s.mode = Mode::Mpm;
        s.particles = [401, 401, 81];
        case.depth_mm = 0.02;
        case.lattice = 201;
    }
}
