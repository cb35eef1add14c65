//! What is written down about a run: provenance, the notes of a session, its settings.

use super::bench::Assembled;
use crate::collection::RunNotes;
use crate::config::{Kind, PlanSetup, Setup};
use crate::dataset::{Provenance, SCHEMA};
use crate::plan::Contact;
use crate::session::bench::Feeds;
use crate::session::{SessionSettings, TouchOffSettings};
use serde::Serialize;
use std::time::Duration;

/// Why a run has no provenance.
#[derive(Debug, thiserror::Error)]
pub enum ProvenanceError {
    /// There is nothing to do.
    #[error("a dataset needs a plan and its sensor; name a plan")]
    NoPlan,
    /// A setting cannot be hashed.
    #[error("a setting cannot be written down: {0}")]
    Encode(#[from] serde_json::Error),
}

/// Where a dataset collected with this setup comes from.
pub fn provenance(setup: &Setup) -> Result<Provenance, ProvenanceError> {
    let (Some(plan), Some(sensor)) = (&setup.plan, &setup.sensor) else {
        return Err(ProvenanceError::NoPlan);
    };
    let rig = &setup.rig;
    let text = |kind| setup.source(kind).map(|s| s.text.clone()).unwrap_or_default();
    let splits = plan.plan.split.of_episodes(&plan.trajectory);
    let splits = plan.trajectory.captures.iter().map(|c| splits[c.episode as usize].to_owned()).collect();
    let indenters: Vec<_> = plan.indenters.iter().map(|(name, i)| (name, i.edge_round_mm)).collect();
    let indenter_files: Vec<_> =
        setup.sources.iter().filter(|s| s.kind == Kind::Indenter).map(|s| (&s.name, &s.blake3)).collect();
    Ok(Provenance {
        schema: SCHEMA.into(),
        tool_version: env!("CARGO_PKG_VERSION").into(),
        created_utc: jiff::Timestamp::now().to_string(),
        rig: rig.name.clone(),
        plan: plan.plan.name.clone(),
        sensor: sensor.name.clone(),
        real_is_virtual: rig.is_virtual(),
        captures: plan.trajectory.captures.len() as u32,
        splits,
        seed: u64::from(rig.optics.seed),
        trajectory_hash: plan.trajectory.hash(),
        rig_hash: hash(&(&rig.devices, &rig.motion, &rig.camera, &rig.session, &rig.world))?,
        simulation_hash: hash(&(
            env!("CARGO_PKG_VERSION"),
            &sensor.pad,
            &sensor.optics,
            &rig.elastomer,
            &rig.optics,
            &rig.twin.poses,
            &indenters,
            &indenter_files,
        ))?,
        rig_toml: text(Kind::Rig),
        plan_toml: text(Kind::Plan),
        sensor_toml: text(Kind::Sensor),
        overrides: setup.sets.clone(),
    })
}

fn hash(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(blake3::hash(&serde_json::to_vec(value)?).to_hex().to_string())
}

/// What is noted when a session begins: who is there, and what every file said.
pub fn session_note(run: &str, setup: &Setup, assembled: &Assembled) -> serde_json::Value {
    let movers: serde_json::Map<String, serde_json::Value> = assembled
        .bench
        .movers
        .iter()
        .map(|(device, mover)| {
            let note = serde_json::json!({
                "identity": mover.identity(),
                "protocol": mover.settings().protocol,
                "port": mover.settings().port,
            });
            (device.clone(), note)
        })
        .collect();
    let files: Vec<_> = setup
        .sources
        .iter()
        .map(|s| serde_json::json!({ "kind": s.kind, "path": s.path, "blake3": s.blake3 }))
        .collect();
    serde_json::json!({
        "session": run,
        "begun_utc": jiff::Timestamp::now().to_string(),
        "tool_version": env!("CARGO_PKG_VERSION"),
        "speed": assembled.bench.clock.speed(),
        "devices": movers,
        "camera": assembled.bench.camera.description(),
        "files": files,
        "overrides": setup.sets,
    })
}

/// What every row of a run has in common.
pub fn run_notes(run: &str, setup: &Setup, plan: &PlanSetup) -> RunNotes {
    RunNotes {
        session: run.to_owned(),
        is_virtual: setup.rig.is_virtual(),
        contact_method: match plan.plan.contact {
            Contact::Given { .. } => "given".into(),
            Contact::TouchOff(_) => "touch_off".into(),
        },
    }
}

/// How a session over this plan is run.
pub fn session_settings(setup: &Setup, plan: &PlanSetup) -> SessionSettings {
    let (table, plan) = (&setup.rig.session, &plan.plan);
    let (touch_off, given_zero_mm) = match plan.contact {
        Contact::Given { zero_mm } => (None, zero_mm),
        Contact::TouchOff(touch) => (
            Some(TouchOffSettings {
                start_mm: touch.start_mm,
                step_mm: touch.step_mm,
                threshold: touch.threshold.unwrap_or(table.touch_threshold),
                max_depth_mm: touch.max_depth_mm,
                feed_mm_s: table.touch_feed_mm_s,
            }),
            0.0,
        ),
    };
    SessionSettings {
        touch_off,
        given_zero_mm,
        clearance_mm: plan.clearance_mm,
        travel: Feeds { mm_s: plan.feeds.travel_mm_s, deg_s: plan.feeds.rotate_deg_s },
        still_rms: table.still_rms,
        frame_within: Duration::from_millis(table.frame_within_ms),
        warmup_frames: table.warmup_frames,
        background_every: table.background_every,
        departure: table.departure,
    }
}
