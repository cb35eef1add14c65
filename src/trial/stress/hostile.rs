//! Settings, pads and poses that make no sense: each must be refused in words, before or when it is met.

use super::cases::Case;
use crate::elastomer::{Friction, Mode};

/// What is spoiled, in the order of [`spoil`].
pub const NAMES: [&str; 34] = [
    "tolerance 0",
    "tolerance 1",
    "tolerance not a number",
    "nu 0.5",
    "nu 0.6",
    "nu -0.1",
    "nu not a number",
    "E 0",
    "E -1",
    "E infinite",
    "E overridden with 0",
    "friction -1",
    "friction not a number",
    "pad without extent",
    "pad of negative thickness",
    "pad of thickness not a number",
    "pad as large as a house",
    "pose not a number",
    "pose infinitely deep",
    "depth beyond the pad",
    "a lattice of one point",
    "mpm: dt 5 % above the limit",
    "mpm: dt ten times the limit",
    "mpm: dt negative",
    "mpm: dt not a number",
    "mpm: 11 x 11 x 3 particles",
    "mpm: particles three times as dense one way",
    "mpm: dx below the particles' spacing",
    "mpm: dx ten spacings",
    "mpm: speed 0",
    "mpm: faster than a cell a step",
    "mpm: Coulomb friction",
    "impm: rest limit 0",
    "impm: rest threshold not a number",
];

/// Spoils a sound case in the `nth` way, over and over.
pub fn spoil(case: &mut Case, nth: usize) {
    let nth = nth % NAMES.len();
    let name = NAMES[nth];
    case.hostile = Some(name);
    let explicit = name.starts_with("mpm") || name.starts_with("impm");
    let (s, pad) = (&mut case.settings, &mut case.pad);
    if explicit {
        s.mode = if name.starts_with("impm") { Mode::Impm } else { Mode::Mpm };
        s.particles = [26, 26, 6];
        s.friction = Friction::Infinite;
    }
    // dx / sqrt((3 lambda + 2 mu) / rho) of the pad with its spacing of 0.8 mm.
    let m = &pad.material;
    let limit =
        33.0 / 256.0 * 8.0 / ((3.0 * m.lambda_mpa() + 2.0 * m.mu_mpa()) * 1e6 / m.density_g_mm3).sqrt();
    match nth {
        0 => s.tolerance = 0.0,
        1 => s.tolerance = 1.0,
        2 => s.tolerance = f64::NAN,
        3 => pad.material.poisson_ratio = 0.5,
        4 => pad.material.poisson_ratio = 0.6,
        5 => pad.material.poisson_ratio = -0.1,
        6 => pad.material.poisson_ratio = f64::NAN,
        7 => pad.material.youngs_modulus_mpa = 0.0,
        8 => pad.material.youngs_modulus_mpa = -1.0,
        9 => pad.material.youngs_modulus_mpa = f64::INFINITY,
        10 => s.youngs_modulus_mpa = Some(0.0),
        11 => s.friction = Friction::Coefficient(-1.0),
        12 => s.friction = Friction::Coefficient(f64::NAN),
        13 => pad.size_x_mm = 0.0,
        14 => pad.thickness_mm = -4.0,
        15 => pad.thickness_mm = f64::NAN,
        16 => pad.size_y_mm = 1e4,
        17 => case.at_mm[0] = f64::NAN,
        18 => case.depth_mm = f64::INFINITY,
        19 => case.depth_mm = 5.0,
        20 => case.lattice = 1,
        21 => s.dt_s = Some(1.05 * limit),
        22 => s.dt_s = Some(10.0 * limit),
        23 => s.dt_s = Some(-1e-4),
        24 => s.dt_s = Some(f64::NAN),
        25 => s.particles = [11, 11, 3],
        26 => s.particles = [76, 26, 16],
        27 => s.dx_mm = Some(0.5),
        28 => s.dx_mm = Some(8.0),
        29 => s.speed_mm_s = 0.0,
        30 => s.speed_mm_s = 5e3,
        31 => s.friction = Friction::Coefficient(0.5),
        32 => s.rest_limit = 0,
        _ => s.rest_threshold = f64::NAN,
    }
}
