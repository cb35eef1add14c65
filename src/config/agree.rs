//! Rig, sensor and plan held against each other, as far as each of them holds by itself.

use super::document::{Document, Reading};
use super::load::IndenterConfig;
use super::report::Finding;
use super::rig::{RigConfig, RigFile};
use super::sensor::{SensorConfig, SensorFile};
use crate::device::camera::settings::CameraSource;
use crate::elastomer;
use crate::motion::Trajectory;
use crate::plan::{self, Plan, PlanFile};
use crate::problem::{Problem, Problems};
use std::collections::BTreeMap;

/// A rig file and the rig it describes.
pub(super) type RigReading = Reading<RigFile, RigConfig>;
/// A sensor file and the sensor it describes.
pub(super) type SensorReading = Reading<SensorFile, SensorConfig>;
/// A plan file and the plan it describes.
pub(super) type PlanReading = Reading<PlanFile, Option<Plan>>;

/// A real camera must have the sensor's raster; a virtual one takes it.
pub(super) fn on_picture(
    document: &Document,
    rig: &RigReading,
    sensor: &SensorReading,
    findings: &mut Vec<Finding>,
) {
    let camera = &rig.value.camera;
    let is_known = rig.holds("camera") && sensor.holds("optics.camera");
    if !is_known || camera.source == CameraSource::Virtual {
        return;
    }
    let given = [("camera.width", camera.width), ("camera.height", camera.height)];
    for ((key, given), wanted) in given.into_iter().zip(raster(&sensor.checked)) {
        if given != wanted {
            findings.push(document.complain(
                key,
                given,
                format!("{wanted} px, the raster of sensor {}", sensor.checked.name),
                "choose that camera mode, or correct [optics.camera] in the sensor file",
            ));
        }
    }
}

/// What the twin's solver will refuse is refused before anything moves: at the rig's key, or at that of the sensor's pad.
pub(super) fn on_elastomer(
    (document, rig): (&Document, &RigReading),
    (sensor_document, sensor): (&Document, &SensorReading),
    findings: &mut Vec<Finding>,
) {
    if !rig.holds("elastomer") || !sensor.holds("pad") {
        return;
    }
    if let Err(elastomer::Error::Setting { key, value, allowed, next }) =
        elastomer::check(&sensor.value.pad, &rig.value.elastomer)
    {
        let file = if key.starts_with("pad.") { sensor_document } else { document };
        findings.push(file.complain(key, value, allowed, next));
    }
}

/// The plan's expansion, held against the axes and, when the sensor is known, the pad.
pub(super) fn on_path(
    document: &Document,
    plan: &PlanReading,
    rig: &RigReading,
    sensor: Option<&SensorReading>,
    indenters: &BTreeMap<String, IndenterConfig>,
    findings: &mut Vec<Finding>,
) -> Option<Trajectory> {
    let holds =
        |d: &String| ["axes", "kinematics"].iter().all(|part| rig.holds(&format!("devices.{d}.{part}")));
    let has_axes = rig.value.devices.keys().all(holds);
    if !has_axes || !rig.holds("motion") || !PATH_KEYS.iter().all(|key| plan.holds(key)) {
        return None;
    }
    let plan = plan.checked.as_ref()?;
    let trajectory = plan::expand(plan);
    let fences = rig.checked.fences();
    let bodies = indenters.iter().map(|(name, i)| (name.clone(), i.body.clone())).collect();
    let mut problems = Problems::new();
    match sensor.filter(|s| s.holds("pad")) {
        Some(sensor) => {
            let bench = plan::check::Bench { rig: &fences, pad: &sensor.value.pad, indenters: &bodies };
            plan::check(plan, &trajectory, &bench, &mut problems);
        }
        None => plan::check_axes(plan, &trajectory, &fences, &mut problems),
    }
    let mut problems: Vec<Problem> = problems.into_vec();
    problems.sort_by(|a, b| a.key.cmp(&b.key));
    findings.extend(problems.iter().map(|p| document.finding(p)));
    Some(trajectory)
}

/// A press moves the pad's face towards the camera: it stays below plate and lens.
pub(super) fn on_clear_bodies(
    document: &Document,
    trajectory: &Trajectory,
    sensor: &SensorReading,
    findings: &mut Vec<Finding>,
) {
    let (optics, pad) = (&sensor.value.optics, &sensor.value.pad);
    let plate = optics.plate.as_ref().filter(|_| sensor.holds("optics.plate")).map(|plate| plate.gap_mm);
    let has_lens = ["pad", "optics.lens", "optics.camera"].iter().all(|part| sensor.holds(part));
    let size = [pad.size_x_mm, pad.size_y_mm];
    let face_mm = |at: [f64; 2]| {
        let is_on_pad = at.iter().zip(size).all(|(at, size)| at.abs() <= size / 2.0);
        is_on_pad.then(|| -pad.shape.face_height_mm(size, at))
    };
    let lens = optics.lens.as_ref().filter(|_| has_lens);
    let lens = lens.map(|lens| lens.clearance_mm(optics.camera.center_mm, face_mm));
    let deepest = trajectory.waypoints.iter().map(|w| -w.pose.z_mm).fold(0.0, f64::max);
    for (body, gap_mm) in [("plate", plate), ("lens", lens)] {
        let Some(gap_mm) = gap_mm.filter(|gap_mm| deepest >= *gap_mm) else { continue };
        let gap_mm = (gap_mm * 1e4).round() / 1e4;
        findings.push(document.complain(
            "depths",
            format!("{deepest} mm deep"),
            format!(
                "below {gap_mm} mm, where the {body} of sensor {} begins (optics.{body}.gap_mm)",
                sensor.value.name
            ),
            format!("press less deep, or correct optics.{body}.gap_mm in the sensor file"),
        ));
    }
}

/// The keys of a plan that its path depends on.
const PATH_KEYS: [&str; 11] = [
    "primitive",
    "indenters",
    "locations",
    "depths",
    "slide",
    "rotate",
    "feeds",
    "clearance_mm",
    "approach_mm",
    "contact",
    "repeats",
];

/// Width and height of a sensor's picture, px.
pub(super) fn raster(sensor: &SensorConfig) -> [u32; 2] {
    [sensor.optics.camera.width_px, sensor.optics.camera.height_px].map(|n| n as u32)
}
