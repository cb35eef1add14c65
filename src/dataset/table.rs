//! The columns of `metadata.parquet`: one row per pair.
//!
//! Columns that end in `_file_name` become image features (`real`, `sim`, `depth`,
//! `contact_mask`) when the folder is
//! loaded as a Hugging Face `imagefolder`; paths are relative to the table's own folder.

use super::columns::Table;
use super::{Dataset, ImageScores, PairMetrics, RealRecord, Row, SimRecord};
use crate::motion::{CaptureMark, Episode, Primitive};
use std::collections::BTreeMap;

/// The table of one split.
pub fn pairs(dataset: &Dataset, split: &str, rows: &[&Row], metrics: &BTreeMap<u32, PairMetrics>) -> Table {
    let trajectory = dataset.trajectory();
    let provenance = dataset.provenance();
    let mark = |r: &Row| -> &CaptureMark { &trajectory.captures[r.capture as usize] };
    let episode = |r: &Row| -> &Episode { &trajectory.episodes[mark(r).episode as usize] };
    let prefix = format!("data/{split}/");
    let file = |path: Option<&str>| path.map(|p| p.strip_prefix(&prefix).unwrap_or(p).to_owned());
    let real_file = |r: &Row| file(r.real.as_ref().map(|l| l.files[0].path.as_str()));
    let sim_file =
        |r: &Row, i: usize| file(r.sim.as_ref().and_then(|l| l.files.get(i)).map(|f| f.path.as_str()));

    let mut t = Table::new();
    // Files, identity.
    t.text("real_file_name", rows.iter().map(|r| real_file(r)));
    t.text("sim_file_name", rows.iter().map(|r| sim_file(r, 0)));
    t.text("depth_file_name", rows.iter().map(|r| sim_file(r, 1)));
    t.text("contact_mask_file_name", rows.iter().map(|r| sim_file(r, 2)));
    t.integer("capture", rows.iter().map(|r| Some(i64::from(r.capture))));
    t.text("pair_id", rows.iter().map(|r| Some(pair_id(&provenance.trajectory_hash, r.capture))));
    t.integer("episode_id", rows.iter().map(|r| Some(i64::from(mark(r).episode))));
    t.integer("step_id", rows.iter().map(|r| Some(i64::from(mark(r).step))));
    t.text("split", rows.iter().map(|_| Some(split)));
    t.text("primitive", rows.iter().map(|r| Some(primitive(episode(r).primitive))));
    t.integer("repeat", rows.iter().map(|r| Some(i64::from(episode(r).repeat))));
    t.text("indenter_id", rows.iter().map(|r| Some(episode(r).indenter.clone())));
    t.text("sensor", rows.iter().map(|_| Some(provenance.sensor.clone())));
    t.text("trajectory_hash", rows.iter().map(|_| Some(provenance.trajectory_hash.clone())));

    // What was asked for.
    t.float("cmd_depth_mm", rows.iter().map(|r| Some(mark(r).depth_mm)));
    t.float("cmd_slip_mm", rows.iter().map(|r| Some(mark(r).slip_mm)));
    t.float("cmd_slip_dir_deg", rows.iter().map(|r| Some(mark(r).slip_direction_deg)));
    t.float("cmd_rot_deg", rows.iter().map(|r| Some(mark(r).rotation_deg)));
    let pose = |r: &Row| trajectory.pose_of(r.capture);
    t.float("cmd_x_mm", rows.iter().map(|r| Some(pose(r).x_mm)));
    t.float("cmd_y_mm", rows.iter().map(|r| Some(pose(r).y_mm)));
    t.float("cmd_z_mm", rows.iter().map(|r| Some(pose(r).z_mm)));

    // What was measured.
    let real = |r: &Row, f: fn(&RealRecord) -> f64| r.real.as_ref().map(|l| f(&l.record));
    t.float("measured_x_mm", rows.iter().map(|r| real(r, |q| q.measured.x_mm)));
    t.float("measured_y_mm", rows.iter().map(|r| real(r, |q| q.measured.y_mm)));
    t.float("measured_z_mm", rows.iter().map(|r| real(r, |q| q.measured.z_mm)));
    t.float("measured_rot_deg", rows.iter().map(|r| real(r, |q| q.measured.theta_deg)));
    t.float("contact_z_mm", rows.iter().map(|r| real(r, |q| q.contact_zero_mm)));
    t.text("contact_method", rows.iter().map(|r| r.real.as_ref().map(|l| l.record.contact_method.clone())));
    t.boolean("departed", rows.iter().map(|r| r.real.as_ref().map(|l| l.record.departed)));
    t.boolean("real_is_virtual", rows.iter().map(|r| r.real.as_ref().map(|l| l.record.is_virtual)));
    t.text("session", rows.iter().map(|r| r.real.as_ref().map(|l| l.record.session.clone())));

    // When and how it was photographed.
    let whole = |r: &Row, f: fn(&RealRecord) -> i64| r.real.as_ref().map(|l| f(&l.record));
    t.integer("t_capture_mono_ns", rows.iter().map(|r| whole(r, |q| q.exposed_mono_ns)));
    t.integer("t_settled_mono_ns", rows.iter().map(|r| whole(r, |q| q.settled_mono_ns)));
    t.integer("t_capture_utc_ns", rows.iter().map(|r| whole(r, |q| q.utc_ns)));
    t.float("settle_ms", rows.iter().map(|r| real(r, |q| q.settle_ms)));
    t.float("still_rms", rows.iter().map(|r| real(r, |q| q.still_rms)));
    t.float("drift_rms", rows.iter().map(|r| real(r, |q| q.drift_rms)));
    t.integer("v4l2_sequence", rows.iter().map(|r| whole(r, |q| i64::from(q.frame_sequence))));
    t.integer("v4l2_flags", rows.iter().map(|r| whole(r, |q| i64::from(q.frame_flags))));
    t.integer("dropped_before", rows.iter().map(|r| whole(r, |q| i64::from(q.dropped_before))));
    t.integer("frames_averaged", rows.iter().map(|r| whole(r, |q| i64::from(q.frames_averaged))));
    t.float("exposure_us", rows.iter().map(|r| r.real.as_ref().and_then(|l| l.record.exposure_us)));
    t.integer("width", rows.iter().map(|r| whole(r, |q| i64::from(q.width))));
    t.integer("height", rows.iter().map(|r| whole(r, |q| i64::from(q.height))));
    t.text("fourcc", rows.iter().map(|r| r.real.as_ref().map(|l| l.record.fourcc.clone())));

    // How it was simulated.
    let sim = |r: &Row, f: fn(&SimRecord) -> f64| r.sim.as_ref().map(|l| f(&l.record));
    let text = |r: &Row, f: fn(&SimRecord) -> &str| r.sim.as_ref().map(|l| f(&l.record).to_owned());
    let count = |r: &Row, f: fn(&SimRecord) -> u64| {
        r.sim.as_ref().map(|l| i64::try_from(f(&l.record)).unwrap_or(i64::MAX))
    };
    t.text("sim_config_hash", rows.iter().map(|r| text(r, |q| &q.config_hash)));
    t.text("engine_version", rows.iter().map(|r| text(r, |q| &q.engine_version)));
    t.text("elastomer_mode", rows.iter().map(|r| text(r, |q| &q.elastomer_mode)));
    t.text("law", rows.iter().map(|r| text(r, |q| &q.law)));
    t.text("optics_mode", rows.iter().map(|r| text(r, |q| &q.optics_mode)));
    t.text("twin_poses", rows.iter().map(|r| text(r, |q| &q.poses)));
    t.integer("spp", rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.record.spp.map(i64::from))));
    t.integer("seed", rows.iter().map(|r| count(r, |q| q.seed)));
    t.integer("particles", rows.iter().map(|r| count(r, |q| q.particles)));
    t.integer("iterations", rows.iter().map(|r| count(r, |q| q.iterations)));
    t.float("impm_passes_per_step", rows.iter().map(|r| sim(r, |q| q.passes_per_step)));
    t.integer("impm_limit_hits", rows.iter().map(|r| count(r, |q| q.limit_hits)));
    t.float("residual", rows.iter().map(|r| sim(r, |q| q.residual)));
    t.float("estimated_error", rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.record.estimated_error)));
    t.float("light_error", rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.record.light_error)));
    t.boolean(
        "light_meets_tolerance",
        rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.record.light_meets_tolerance)),
    );
    t.float("youngs_modulus_mpa", rows.iter().map(|r| sim(r, |q| q.youngs_modulus_mpa)));
    t.float("poisson_ratio", rows.iter().map(|r| sim(r, |q| q.poisson_ratio)));
    t.float(
        "friction",
        rows.iter().map(|r| r.sim.as_ref().map(|l| l.record.friction.unwrap_or(f64::INFINITY))),
    );
    t.float("sim_ms", rows.iter().map(|r| sim(r, |q| q.elastomer_ms)));
    t.float("render_ms", rows.iter().map(|r| sim(r, |q| q.render_ms)));
    t.float("sim_normal_force_n", rows.iter().map(|r| sim(r, |q| q.normal_force_n)));
    t.float("sim_shear_force_x_n", rows.iter().map(|r| sim(r, |q| q.shear_force_n[0])));
    t.float("sim_shear_force_y_n", rows.iter().map(|r| sim(r, |q| q.shear_force_n[1])));
    t.float("sim_torque_n_mm", rows.iter().map(|r| sim(r, |q| q.torque_n_mm)));
    t.float("contact_area_mm2", rows.iter().map(|r| sim(r, |q| q.contact_area_mm2)));
    t.float("held", rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.record.held)));

    // How the two compare.
    type Pick = fn(&PairMetrics) -> Option<ImageScores>;
    let scored: [(&str, Pick); 4] = [
        ("", |m| Some(m.full)),
        ("_roi", |m| m.contact),
        ("_null", |m| Some(m.null_full)),
        ("_null_roi", |m| m.null_contact),
    ];
    for (suffix, pick) in scored {
        let score = |r: &Row, f: fn(ImageScores) -> f64| metrics.get(&r.capture).and_then(pick).map(f);
        t.float(&format!("mse{suffix}"), rows.iter().map(|r| score(r, |s| s.mse)));
        t.float(&format!("psnr_db{suffix}"), rows.iter().map(|r| score(r, |s| s.psnr_db)));
        t.float(&format!("ssim{suffix}"), rows.iter().map(|r| score(r, |s| s.ssim)));
    }

    // Sums.
    t.text("real_blake3", rows.iter().map(|r| r.real.as_ref().map(|l| l.files[0].blake3.clone())));
    t.text("sim_blake3", rows.iter().map(|r| r.sim.as_ref().map(|l| l.files[0].blake3.clone())));
    t.text("depth_blake3", rows.iter().map(|r| r.sim.as_ref().map(|l| l.files[1].blake3.clone())));
    t.text(
        "contact_mask_blake3",
        rows.iter().map(|r| r.sim.as_ref().and_then(|l| l.files.get(2)).map(|f| f.blake3.clone())),
    );
    t
}

/// A name for a pair that is the same in every dataset of the same trajectory.
fn pair_id(trajectory_hash: &str, capture: u32) -> String {
    blake3::hash(format!("{trajectory_hash}/{capture}").as_bytes()).to_hex()[..16].to_owned()
}

fn primitive(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::Press => "press",
        Primitive::Slip => "slip",
        Primitive::Rotate => "rotate",
    }
}
