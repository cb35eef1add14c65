//! How much of a picture stays as it was when a press goes a little deeper.
//!
//! Pictures of an unmoved pad are reused whole ([`crate::optics::reuse`]); whether single pixels could be is a question to
//! presses as they are, so the elastomer makes them and the sensor's own camera looks on. A pixel that stays is one
//! whose three colours of linear light, before noise and rounding, do.

use crate::elastomer::{self, ElastomerCapture, Friction, Pad};
use crate::indenter::spec::{Plan, Shape};
use crate::indenter::{self, Indenter};
use crate::optics::bench::StillLight;
use crate::optics::imager::{Imager, Method};
use crate::optics::{self, DisplacedSurface, Film, SensorOptics, reference};
use crate::pose::Pose;
use crate::trial::scene;
use std::sync::Arc;

/// Points of the face along x and y.
pub(super) const LATTICE: [usize; 2] = [201, 201];
/// How much deeper the second picture of a pair is, mm.
const DEEPER_MM: f64 = 0.1;
/// Light that differs by less is called nearly the same, relative; it is far below a code value.
const NEARLY: f32 = 1e-4;

/// Why it was not measured.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The press.
    #[error(transparent)]
    Elastomer(#[from] elastomer::Error),
    /// The picture.
    #[error(transparent)]
    Optics(#[from] optics::Error),
}

/// Presses a sphere and a punch on a flat pad and looks at what stays.
///
/// # Errors
/// When the pad cannot be pressed or the sensor cannot be rendered.
pub fn measure(pad: &Pad, sensor: &SensorOptics, tolerance: f64) -> Result<Vec<StillLight>, Error> {
    let method = Method::Fast { tolerance, fallback: reference::Settings::default() };
    let size_mm = [pad.size_x_mm, pad.size_y_mm];
    let untouched = DisplacedSurface::flat(2, 2, size_mm);
    let imager = Imager::new(sensor, method, None, &untouched)?;
    let look = |surface: &DisplacedSurface| imager.picture(surface, 0).map(|picture| picture.light);

    let mut rows = Vec::new();
    for (name, body, depths_mm) in bodies() {
        let settings = scene::quasi_static(Friction::Infinite, tolerance);
        let above = Pose::new(0.0, 0.0, 0.5, 0.0);
        let mut state = elastomer::solver(pad, &settings, body, &above)?;
        for depth_mm in depths_mm {
            let mut at = |depth_mm: f64| {
                state.advance(&Pose::new(0.0, 0.0, -depth_mm, 0.0))?;
                Ok::<_, Error>(face(&state.capture(LATTICE[0], LATTICE[1])?))
            };
            let faces = [at(depth_mm)?, at(depth_mm + DEEPER_MM)?];
            let points = faces[0].positions.iter().zip(&faces[1].positions);
            let [same_points, _] = shares(points.map(|(a, b)| (a.to_array(), b.to_array())));
            let [same_pixels, nearly] = stay(&look(&faces[0])?, &look(&faces[1])?);
            rows.push(StillLight {
                what: format!("{name} from {depth_mm} to {:.1} mm deep", depth_mm + DEEPER_MM),
                same_points,
                same_pixels,
                nearly_same_pixels: nearly,
            });
        }
    }
    Ok(rows)
}

/// What is pressed, and from which depths, mm.
fn bodies() -> [(&'static str, Arc<dyn Indenter>, Vec<f64>); 2] {
    let round = Shape::Flat { plan: Plan::Disc { diameter_mm: 6.0 } };
    let punch = indenter::from_spec("punch", &scene::spec(round, 0.3), None);
    [
        ("sphere of radius 3 mm", scene::sphere(3.0), vec![0.1, 0.5, 0.9]),
        ("punch of 6 mm", punch.expect("the round fits into the punch"), vec![0.1, 0.5]),
    ]
}

pub(super) fn face(capture: &ElastomerCapture) -> DisplacedSurface {
    let s = &capture.surface;
    let size_mm = [s.size_x_mm, s.size_y_mm];
    DisplacedSurface { nx: s.nx, ny: s.ny, size_mm, positions: s.positions.clone(), rest_z: Vec::new() }
}

/// Shares of pixels whose light is the same to the bit, and nearly.
fn stay(before: &Film, after: &Film) -> [f64; 2] {
    shares(before.pixels.iter().zip(&after.pixels).map(|(a, b)| (a.to_array(), b.to_array())))
}

/// Shares of triples that are the same to the bit, and nearly.
fn shares(pairs: impl Iterator<Item = ([f32; 3], [f32; 3])>) -> [f64; 2] {
    let (mut same, mut nearly, mut all) = (0u32, 0u32, 0u32);
    for (a, b) in pairs {
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= NEARLY * a.abs().max(b.abs());
        all += 1;
        same += u32::from(a.map(f32::to_bits) == b.map(f32::to_bits));
        nearly += u32::from(a.iter().zip(&b).all(near));
    }
    [same, nearly].map(|count| f64::from(count) / f64::from(all.max(1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn shares_are_counted_over_pixels_whose_every_colour_stays() {
        let film = |pixels: [Vec3; 4]| Film { width: 2, height: 2, pixels: pixels.to_vec() };
        let a = film([Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::new(1.0, 1.0, 1e-3)]);
        let b = film([Vec3::ONE, Vec3::splat(1.00005), Vec3::splat(1.01), Vec3::new(1.0, 1.0, 1.01e-3)]);
        assert_eq!(stay(&a, &b), [0.25, 0.5]);
    }

    /// What the rule of reusing whole pictures alone rests on.
    #[test]
    fn a_deeper_press_moves_every_point_of_the_pad_and_the_light_of_nearly_every_pixel() {
        #[derive(serde::Deserialize)]
        struct Sensor {
            pad: Pad,
            optics: SensorOptics,
        }
        let file: Sensor = toml::from_str(include_str!("../../rig_configs/sensors/gelsight.toml")).unwrap();
        let mut optics = file.optics;
        (optics.camera.width_px, optics.camera.height_px, optics.camera.mm_per_px) = (64, 48, 0.28125);
        for row in measure(&file.pad, &optics, 0.05).unwrap() {
            assert!(row.same_points < 0.01 && row.same_pixels < 0.05, "{row:?}");
            assert!(row.nearly_same_pixels >= row.same_pixels, "{row:?}");
        }
    }
}
