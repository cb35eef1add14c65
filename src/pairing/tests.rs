//! Pairing on small datasets whose pictures are known.

use super::*;
use crate::dataset::{Provenance, RealRecord, SCHEMA, SimRecord, depth};
use crate::motion::{CaptureMark, Episode, Phase, Primitive, Trajectory, Waypoint};
use crate::pose::Pose;
use std::path::Path;
use std::time::Duration;

const SIZE: (u32, u32) = (64, 48);

fn trajectory(captures: u32) -> Trajectory {
    let waypoint = |k: u32| Waypoint {
        pose: Pose::new(0.0, 0.0, -0.1 * f64::from(k), 0.0),
        starts: Duration::ZERO,
        arrives: Duration::ZERO,
        feed_mm_s: 1.0,
        feed_deg_s: 0.0,
        phase: Phase::Press,
        episode: 0,
        capture: Some(k),
    };
    let mark = |k: u32| CaptureMark {
        waypoint: k,
        episode: 0,
        step: k,
        depth_mm: 0.1 * f64::from(k),
        slip_mm: 0.0,
        slip_direction_deg: 0.0,
        rotation_deg: 0.0,
    };
    let episode = Episode {
        indenter: "sphere".into(),
        primitive: Primitive::Press,
        location_mm: [0.0, 0.0],
        repeat: 0,
        first_waypoint: 0,
        end_waypoint: captures,
    };
    Trajectory {
        waypoints: (0..captures).map(waypoint).collect(),
        episodes: vec![episode],
        captures: (0..captures).map(mark).collect(),
    }
}

pub(crate) fn provenance(trajectory: &Trajectory) -> Provenance {
    Provenance {
        schema: SCHEMA.into(),
        tool_version: "test".into(),
        created_utc: "2026-01-01T00:00:00Z".into(),
        rig: "virtual".into(),
        plan: "small".into(),
        sensor: "gelsight".into(),
        real_is_virtual: true,
        captures: trajectory.captures.len() as u32,
        splits: vec!["train".into(); trajectory.captures.len()],
        seed: 1,
        trajectory_hash: trajectory.hash(),
        rig_hash: String::new(),
        simulation_hash: String::new(),
        rig_toml: String::new(),
        plan_toml: String::new(),
        sensor_toml: String::new(),
        overrides: vec![],
    }
}

pub(crate) fn real_record() -> RealRecord {
    RealRecord {
        session: "run".into(),
        is_virtual: true,
        commanded: Pose::default(),
        measured: Pose::default(),
        contact_zero_mm: 0.0,
        contact_method: "given".into(),
        axes: vec![],
        departed: false,
        exposed_mono_ns: 0,
        settled_mono_ns: 0,
        utc_ns: 0,
        settle_ms: 1.0,
        still_rms: 0.5,
        frame_sequence: 0,
        frame_flags: 0,
        dropped_before: 0,
        frames_averaged: 1,
        exposure_us: None,
        width: SIZE.0,
        height: SIZE.1,
        fourcc: "RGB3".into(),
        drift_rms: 0.0,
    }
}

pub(crate) fn sim_record(contact_box_px: Option<[u32; 4]>) -> SimRecord {
    SimRecord {
        config_hash: String::new(),
        engine_version: "test".into(),
        pose: Pose::default(),
        poses: "commanded".into(),
        elastomer_mode: "impm".into(),
        law: "neo_hookean".into(),
        youngs_modulus_mpa: 0.145,
        poisson_ratio: 0.45,
        friction: None,
        optics_mode: "reference".into(),
        spp: Some(16),
        seed: 1,
        elastomer_ms: 1.0,
        render_ms: 1.0,
        normal_force_n: 0.1,
        shear_force_n: [0.0, 0.0],
        torque_n_mm: 0.0,
        contact_area_mm2: 1.0,
        held: None,
        contact_box_px,
        iterations: 3,
        passes_per_step: 1.0,
        limit_hits: 0,
        particles: 9,
        residual: 0.0,
        estimated_error: None,
        light_error: None,
        light_meets_tolerance: None,
    }
}

/// A shaded background with a blob of the given strength at (x, y).
fn picture(x: f64, y: f64, strength: f64) -> Vec<u8> {
    let value = |i: u32, j: u32| {
        let (dx, dy) = (f64::from(i) - x, f64::from(j) - y);
        let blob = strength * (-(dx * dx + 1.4 * dy * dy) / 40.0).exp() * (1.0 + 0.3 * dx / 6.0);
        (100.0 + f64::from(i) * 0.5 + f64::from(j) * 0.3 + blob).round().clamp(0.0, 255.0) as u8
    };
    let rgb = (0..SIZE.0 * SIZE.1).flat_map(|k| [value(k % SIZE.0, k / SIZE.0); 3]).collect();
    png::encode(&Picture { width: SIZE.0, height: SIZE.1, rgb }).unwrap()
}

/// Captures 1.. touch; the simulated blob lies `shift` to the right of the real one and is a bit weaker.
pub(crate) fn dataset(root: &Path, captures: u32, shift: f64) -> Dataset {
    let trajectory = trajectory(captures);
    let dataset = Dataset::create(root, provenance(&trajectory), &trajectory).unwrap();
    dataset.put_background("run-000-sphere", &picture(0.0, 0.0, 0.0)).unwrap();
    for c in 0..captures {
        let (x, y) = (28.0 + f64::from(c), 24.0);
        let strength = 25.0 * f64::from(c.min(3));
        dataset.append_real(c, real_record(), &picture(x, y, strength)).unwrap();
        let contact = (c > 0).then_some([22, 18, 40, 30]);
        let tiff = depth::encode(SIZE.0, SIZE.1, &vec![0.0; (SIZE.0 * SIZE.1) as usize]).unwrap();
        let sim = picture(x + shift, y, 0.9 * strength);
        dataset.append_sim(c, sim_record(contact), &sim, &tiff, b"contact").unwrap();
    }
    dataset
}

#[test]
fn a_good_simulation_beats_the_null_predictor_most_where_the_contact_is() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 5, 0.0);
    let pairing = pair(&dataset, Alignment::Off).unwrap();
    assert_eq!((pairing.pairs.len(), pairing.refused.len()), (5, 0));
    for p in &pairing.pairs[1..] {
        let m = p.metrics;
        let (contact, null) = (m.contact.unwrap(), m.null_contact.unwrap());
        assert!(m.full.mse < 0.1 * m.null_full.mse && contact.mse < 0.1 * null.mse, "{m:?}");
        // Errors are concentrated in the region.
        assert!(null.mse > 1.8 * m.null_full.mse, "{m:?}");
        let b = p.region.unwrap();
        assert_eq!((b.x0, b.y0, b.x1, b.y1), (10, 6, 52, 42));
    }
    // Untouched: no region, and both predictions are the truth itself.
    let untouched = &pairing.pairs[0];
    assert_eq!((untouched.region, untouched.metrics.contact), (None, None));
    assert_eq!(untouched.metrics.null_full.mse, 0.0);
    assert_eq!(pairing.metrics().len(), 5);
}

#[test]
fn a_global_shift_is_reported_and_removed_only_when_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 6, 2.5);
    let as_is = pair(&dataset, Alignment::Off).unwrap();
    let shift = as_is.shift.unwrap();
    assert!((shift.dx_px - 2.5).abs() < 0.25 && shift.dy_px.abs() < 0.25, "{shift:?}");
    assert_eq!(as_is.removed, None);
    // The blobs carry no background with them here, so only the blob is aligned; it dominates.
    let aligned = pair(&dataset, Alignment::Estimated).unwrap();
    let contact = |p: &Pairing| p.pairs[4].metrics.contact.unwrap().mse;
    assert!(contact(&aligned) < 0.4 * contact(&as_is), "{} {}", contact(&aligned), contact(&as_is));
    // The null predictor is cropped but not moved: an untouched pair stays perfect.
    assert_eq!(aligned.pairs[0].metrics.null_full.mse, 0.0);
}

#[test]
fn what_cannot_be_compared_is_listed_and_does_not_stop_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 3, 0.0);
    std::fs::write(folder.path().join("data/train/sim/000001.png"), b"torn").unwrap();
    let pairing = pair(&dataset, Alignment::Off).unwrap();
    assert_eq!(pairing.pairs.iter().map(|p| p.capture).collect::<Vec<_>>(), [0, 2]);
    assert_eq!(pairing.refused[0].0, 1);
}

#[test]
fn without_an_untouched_picture_there_is_no_null_predictor() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path(), 2, 0.0);
    std::fs::remove_file(folder.path().join("background/run-000-sphere.png")).unwrap();
    let error = pair(&dataset, Alignment::Off).unwrap_err().to_string();
    assert!(error.contains("no picture of the untouched sensor"), "{error}");
    // The twin's texture stands in.
    dataset.put_background(FIRST_BACKGROUND, &picture(0.0, 0.0, 0.0)).unwrap();
    assert_eq!(pair(&dataset, Alignment::Off).unwrap().pairs.len(), 2);
}
