//! What features of a sensor's optics cost, on presses as they are ([`crate::optics::bench::features`]).

use super::scene;
use super::still_light::{Error, LATTICE, face};
use crate::elastomer::{self, Friction, Pad};
use crate::optics::SensorOptics;
use crate::optics::bench::{Effect, features::Seen};
use crate::pose::Pose;

/// How deep the sphere is seen, mm.
const DEPTHS_MM: [f64; 5] = [0.1, 0.2, 0.3, 0.4, 0.5];

/// Presses a sphere on a flat pad and looks at it with and without each feature, in pictures of this size.
///
/// # Errors
/// When the pad cannot be pressed or the sensor cannot be rendered.
pub fn measure(
    (pad, sensor): (&Pad, &SensorOptics),
    size: [usize; 2],
    tolerance: f64,
    cpu: &dyn Fn() -> f64,
    repeat: u32,
) -> Result<Vec<Effect>, Error> {
    let settings = scene::quasi_static(Friction::Infinite, tolerance);
    let mut state = elastomer::solver(pad, &settings, scene::sphere(3.0), &Pose::new(0.0, 0.0, 0.5, 0.0))?;
    let mut faces = Vec::new();
    for depth_mm in DEPTHS_MM {
        state.advance(&Pose::new(0.0, 0.0, -depth_mm, 0.0))?;
        faces.push(face(&state.capture(LATTICE[0], LATTICE[1])?));
    }
    Ok(Seen { sensor, faces: &faces, size, tolerance }.effects(cpu, repeat)?)
}
