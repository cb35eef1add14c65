//! The same path twice, on one thread and on three.

use super::super::cases::Case;
use super::super::checks::Checks;
use super::Walk;
use crate::elastomer::{ElastomerCapture, Error};
use crate::pose::Pose;

/// The same path twice, on one thread and on three: the same bytes.
pub(super) fn repeat(case: &Case, checks: &mut Checks) -> Result<(), Error> {
    let captures = |threads: usize, checks: &mut Checks| -> Result<Vec<ElastomerCapture>, Error> {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| Error::Setting {
                key: "threads",
                value: threads.to_string(),
                allowed: format!("as many as the system makes ({e})"),
                next: "ask for fewer".to_owned(),
            })?;
        pool.install(|| {
            let alter = |_: &mut ElastomerCapture| {};
            let mut walk = Walk::new(case, case.settings.tolerance, checks, &alter)?;
            let press = walk.go(walk.at(-case.depth_mm))?;
            let slid = walk.go(Pose { x_mm: case.slide_mm, ..walk.pose })?;
            let turned = walk.go(Pose { theta_deg: case.turn_deg, ..walk.pose })?;
            Ok(vec![press, slid, turned])
        })
    };
    // An error is an answer, too, and must be the same one.
    let (one, three) = (captures(1, checks), captures(3, checks));
    checks.hold("differs when repeated", if one == three { 0.0 } else { 2.0 }, 1.0);
    one.map(drop)
}
