//! `collect --dry-run`: everything is checked, and the bytes that would be sent are printed.

use super::exit::Exit;
use super::screen;
use crate::config::{CheckReport, Setup};
use crate::device::mover::preview_move;
use crate::motion::{Coordinate, Phase};
use crate::pose::Pose;
use serde::Serialize;

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
        "bytes that the moves would send (heights at the nominal contact; homing, polling and touch-off come besides):",
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

/// The moves of the trajectory as the session would make them, from the clearance height of the first pose.
fn sendings(setup: &Setup) -> Result<Vec<Sending>, crate::device::mover::MoverError> {
    let Some(plan) = &setup.plan else { return Ok(Vec::new()) };
    let (rig, waypoints) = (&setup.rig, &plan.trajectory.waypoints);
    let mut at: Option<Pose> = None;
    let mut sendings = Vec::new();
    for (index, waypoint) in waypoints.iter().enumerate() {
        let to = waypoint.pose;
        let goes_up = at.is_some_and(|from| to.z_mm > from.z_mm);
        let sideways = [Coordinate::X, Coordinate::Y, Coordinate::Theta];
        let order: Vec<Coordinate> = match goes_up {
            true => std::iter::once(Coordinate::Z).chain(sideways).collect(),
            false => sideways.into_iter().chain([Coordinate::Z]).collect(),
        };
        for coordinate in order {
            let Some(role) = rig.motion.role(coordinate) else { continue };
            if at.is_some_and(|from| (coordinate.of(&from) - coordinate.of(&to)).abs() < 1e-6) {
                continue;
            }
            let settings = &rig.devices[&role.device];
            let feed = match coordinate {
                Coordinate::Theta if waypoint.feed_deg_s > 0.0 => waypoint.feed_deg_s,
                Coordinate::Theta => plan.plan.feeds.rotate_deg_s,
                _ if waypoint.feed_mm_s > 0.0 => waypoint.feed_mm_s,
                _ => plan.plan.feeds.travel_mm_s,
            };
            let target = role.to_axis(coordinate.of(&to));
            let spec = &setup.protocols[&settings.protocol];
            let bytes = preview_move(spec, settings, &[(role.axis.as_str(), target)], feed)?;
            sendings.push(Sending {
                waypoint: index,
                phase: waypoint.phase,
                device: role.device.clone(),
                bytes: bytes.iter().map(|b| b.escape_ascii().to_string()).collect(),
                capture: waypoint.capture,
            });
        }
        at = Some(to);
    }
    Ok(sendings)
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
