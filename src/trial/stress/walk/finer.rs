//! The same path with a smaller tolerance.

use super::super::checks::Checks;
use super::Walk;
use crate::elastomer::{ElastomerCapture, Error};
use crate::pose::Pose;
use crate::trial::scene;

/// The same path with a third of the tolerance.
pub(super) fn finer(walk: &mut Walk<'_>, alter: &dyn Fn(&mut ElastomerCapture)) -> Result<(), Error> {
    let case = walk.case;
    let depth = case.depth_mm;
    let target = Pose { x_mm: case.slide_mm, ..walk.at(-depth) };
    walk.go(walk.at(-depth))?;
    let coarse = walk.go(target)?;
    let mut own = Checks::default();
    let mut other = Walk::new(case, case.settings.tolerance / 3.0, &mut own, alter)?;
    other.go(other.at(-depth))?;
    let fine = other.go(target)?;
    let claims = walk.claim + other.claim;
    let radius = (fine.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
    let [rmse_um, _] =
        scene::height_difference_um(&coarse.surface, &fine.surface, (2.0 * radius).max(3.0), f64::MAX);
    walk.checks.hold("RMSE against finer, of the depth", 1e-3 * rmse_um / depth, claims);
    let normal = fine.forces.normal_force_n.max(walk.least_force());
    let off = (coarse.forces.normal_force_n - normal).abs() / normal;
    walk.checks.hold("force against finer", off, 3.0 * claims);
    Ok(())
}
