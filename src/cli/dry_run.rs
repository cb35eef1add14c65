//! `collect --dry-run`: everything is checked, and the bytes that would be sent are printed.

use super::exit::Exit;
use super::screen;
use crate::config::{CheckReport, Setup};
use crate::device::mover::{MoverError, preview_move};
use crate::motion::{Coordinate, Phase};
use crate::pose::Pose;
use serde::Serialize;
use std::collections::BTreeMap;

/// What one move would send to one device.
#[derive(Debug, Serialize)]
struct Sending {
    waypoint: usize,
    phase: Phase,
    device: String,
    bytes: Vec<String>,
    capture: Option<u32>,
}

/// Prints the check and the bytes. Nothing is opened.
pub fn show(setup: &Setup, json: bool) -> Exit {
    let sendings = match sendings(setup) {
        Ok(sendings) => sendings,
        Err(e) => {
            screen::error(e);
            return Exit::Refused;
        }
    };
    let report = CheckReport::new(setup);
    if json {
        screen::json(&serde_json::json!({ "check": report, "sends": sendings }));
        return Exit::Done;
    }
    screen::result(&report);
    screen::result(
        "bytes that the moves would send (heights at the nominal contact; line numbers and checksums follow the dialogue; homing, polling and touch-off come besides):",
    );
    for s in &sendings {
        let capture = s.capture.map(|c| format!("   capture {c}")).unwrap_or_default();
        for bytes in &s.bytes {
            screen::result(format_args!(
                "{:>6} {:<8} {:<8} {bytes}{capture}",
                s.waypoint,
                name(s.phase),
                s.device
            ));
        }
    }
    Exit::Done
}

/// The moves of the trajectory as the session makes them: first up to the clearance height, then from waypoint to
/// waypoint in the order of [`crate::session::Bench::go`].
fn sendings(setup: &Setup) -> Result<Vec<Sending>, MoverError> {
    let Some(plan) = &setup.plan else { return Ok(Vec::new()) };
    let waypoints = &plan.trajectory.waypoints;
    let Some(first) = waypoints.first() else { return Ok(Vec::new()) };
    let feeds = &plan.plan.feeds;
    let mut rehearsal = Rehearsal { setup, here: BTreeMap::new(), sendings: Vec::new() };
    let clearance_mm = plan.plan.clearance_mm;
    let lift = Step { waypoint: 0, phase: first.phase, capture: None };
    rehearsal.send(lift, &[(Coordinate::Z, clearance_mm)], feeds.travel_mm_s)?;
    let mut from: Option<Pose> = None;
    for (index, waypoint) in waypoints.iter().enumerate() {
        let to = waypoint.pose;
        let step = Step { waypoint: index, phase: waypoint.phase, capture: waypoint.capture };
        let or = |own: f64, otherwise: f64| if own > 0.0 { own } else { otherwise };
        let line_feed = or(waypoint.feed_mm_s, feeds.travel_mm_s);
        let differs = |c: &Coordinate| from.is_none_or(|from| (c.of(&from) - c.of(&to)).abs() >= 1e-6);
        let lines: Vec<_> =
            [Coordinate::X, Coordinate::Y].into_iter().filter(differs).map(|c| (c, c.of(&to))).collect();
        let turn: Vec<_> = [Coordinate::Theta].into_iter().filter(differs).map(|c| (c, c.of(&to))).collect();
        let z_mm = from.map_or(clearance_mm, |from| from.z_mm);
        let goes_up = to.z_mm > z_mm + 1e-6;
        if goes_up {
            rehearsal.send(step, &[(Coordinate::Z, to.z_mm)], line_feed)?;
        }
        rehearsal.send(step, &lines, line_feed)?;
        rehearsal.send(step, &turn, or(waypoint.feed_deg_s, feeds.rotate_deg_s))?;
        if !goes_up {
            rehearsal.send(step, &[(Coordinate::Z, to.z_mm)], line_feed)?;
        }
        from = Some(to);
    }
    Ok(rehearsal.sendings)
}

/// Where in the trajectory a move belongs.
#[derive(Clone, Copy)]
struct Step {
    waypoint: usize,
    phase: Phase,
    capture: Option<u32>,
}

/// The moves so far, and where they have led.
struct Rehearsal<'a> {
    setup: &'a Setup,
    /// Positions of the axes, by device.
    here: BTreeMap<String, BTreeMap<String, f64>>,
    sendings: Vec<Sending>,
}

impl Rehearsal<'_> {
    /// One straight move of each device involved, one device after the other.
    fn send(&mut self, step: Step, to: &[(Coordinate, f64)], feed: f64) -> Result<(), MoverError> {
        let mut by_device: BTreeMap<&str, Vec<(&str, f64)>> = BTreeMap::new();
        for (coordinate, value) in to {
            let Some(role) = self.setup.rig.motion.role(*coordinate) else { continue };
            by_device.entry(&role.device).or_default().push((&role.axis, role.to_axis(*value)));
        }
        for (device, targets) in by_device {
            let settings = &self.setup.rig.devices[device];
            let here = self.here.entry(device.to_owned()).or_default();
            let bytes =
                preview_move(&self.setup.protocols[&settings.protocol], settings, here, &targets, feed)?;
            here.extend(targets.iter().map(|(axis, target)| ((*axis).to_owned(), *target)));
            self.sendings.push(Sending {
                waypoint: step.waypoint,
                phase: step.phase,
                device: device.to_owned(),
                bytes: bytes.iter().map(|b| b.escape_ascii().to_string()).collect(),
                capture: step.capture,
            });
        }
        Ok(())
    }
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Approach => "approach",
        Phase::Press => "press",
        Phase::Slide => "slide",
        Phase::Rotate => "rotate",
        Phase::Retract => "retract",
    }
}
