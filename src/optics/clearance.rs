//! Whether baffles and lens of a sensor leave room for its pad, for each other and for the camera's view.

use super::sensor::{BaffleSpec, SensorOptics};
use super::sightline::Sightline;
use super::{Error, Mesh, Role, Scene, lens_mesh, overlap, reference, to_pad};
use crate::problem::Problems;
use glam::Vec2;

/// What of a sensor a pad's face reaches into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touched {
    /// The lens.
    Lens,
    /// A baffle, by number.
    Baffle(usize),
}

/// What a face reaches into, if anything. Its mesh is in the scene frame.
pub fn touched(sensor: &SensorOptics, pad: &Mesh) -> Option<Touched> {
    if in_lens(sensor, pad) {
        return Some(Touched::Lens);
    }
    let cuts = |baffle: &BaffleSpec| overlap::cut(pad, &baffle.mesh());
    sensor.baffles.iter().position(cuts).map(Touched::Baffle)
}

/// The same as an error of the scene.
///
/// # Errors
/// When there is such a part.
pub fn untouched(sensor: &SensorOptics, pad: &Mesh) -> Result<(), Error> {
    let (what, next) = match touched(sensor, pad) {
        None => return Ok(()),
        Some(Touched::Lens) => {
            ("it reaches into the lens".to_owned(), "press less deep, or give the lens a larger gap")
        }
        Some(Touched::Baffle(k)) => (
            format!("it reaches into the baffle {:?}", sensor.baffles[k].name),
            "press less deep or elsewhere, or move the baffle away from the face",
        ),
    };
    Err(Error::Scene { part: "the pad".to_owned(), what, next: next.to_owned() })
}

fn in_lens(sensor: &SensorOptics, pad: &Mesh) -> bool {
    let Some(lens) = &sensor.lens else { return false };
    let (low, half, front) = (lens.heights_mm()[0], lens.half_mm(), lens.front());
    let axis = axis_of(sensor);
    pad.positions.iter().any(|p| {
        let (height, r) = (f64::from(p.z), f64::from((p.truncate() - axis).length()));
        height >= low && r <= half && height >= front.height_mm(r)
    })
}

/// Where the camera's axis meets the face, scene frame.
fn axis_of(sensor: &SensorOptics) -> Vec2 {
    let [x, y] = sensor.camera.center_mm;
    Vec2::new(x as f32, -y as f32)
}

/// Reports what of baffles and lens is in the way of the untouched pad or of each other. The values by themselves are in range.
pub fn check(sensor: &SensorOptics, pad: &Mesh, problems: &mut Problems) {
    if in_lens(sensor, pad) {
        problems.push(
            "lens.gap_mm",
            sensor.lens.as_ref().map_or(0.0, |lens| lens.gap_mm),
            "a lens above the pad's face everywhere",
            "raise the lens, or give its front the curve of the face",
        );
    }
    check_power(sensor, problems);
    let lens = sensor.lens.as_ref().map(|lens| lens_mesh::of_lens(lens, sensor.camera.center_mm));
    for (k, baffle) in sensor.baffles.iter().enumerate() {
        let mesh = baffle.mesh();
        problems.within(format!("baffles.[{k}]"), |p| {
            let mut refuse = |what: &str, allowed: &str, next: &str| {
                p.push("shape", format!("{:?}, {what}", baffle.name), allowed, next);
            };
            if overlap::cut(pad, &mesh) || mesh.positions.iter().any(|v| is_under(pad, v.truncate(), v.z)) {
                refuse(
                    "in the pad or under its face",
                    "above the pad's untouched face",
                    "move it towards the camera: give it a lower z, or less height",
                );
            }
            let is_in_lens = |lens: &Mesh| overlap::cut(lens, &mesh) || has_points_in_lens(sensor, &mesh);
            if lens.as_ref().is_some_and(is_in_lens) {
                refuse("in the lens", "beside, above or below the lens", "move it out of the lens");
            }
        });
    }
}

/// A lens so strong that it turns the picture over, or that no aperture focuses through.
fn check_power(sensor: &SensorOptics, problems: &mut Problems) {
    let Some(lens) = &sensor.lens else { return };
    let (near, radius) = (Sightline::of(sensor).paraxial(), sensor.camera.aperture_radius_mm);
    if near.b < LEAST_APPARENT * sensor.camera.distance_mm {
        problems.push(
            "lens.ior",
            lens.ior,
            "a lens that shows the face upright",
            "use faces of larger radius, or bring the lens nearer to the face or to the camera",
        );
    } else if radius > 0.0 && near.a < LEAST_APPARENT {
        problems.push(
            "camera.aperture_radius_mm",
            radius,
            "0, a pinhole: through this lens the face seems to be infinitely far away, where no aperture focuses",
            "use 0, or a lens whose faces have larger radii",
        );
    }
}

/// The least distance at which a face may seem to be, of what it truly is.
const LEAST_APPARENT: f64 = 0.02;

fn has_points_in_lens(sensor: &SensorOptics, mesh: &Mesh) -> bool {
    let axis = axis_of(sensor);
    let Some(lens) = &sensor.lens else { return false };
    mesh.positions.iter().any(|v| {
        let r = (v.truncate() - axis).length();
        lens.contains(f64::from(r), f64::from(v.z))
    })
}

/// Whether a point is under the untouched face; nothing is beside it.
fn is_under(pad: &Mesh, at: Vec2, z: f32) -> bool {
    (0..pad.triangles.len()).map(|k| pad.corners(k)).any(|[a, b, c]| {
        let [p, q, r] = [a, b, c].map(|v| v.truncate() - at);
        let weights = [q.perp_dot(r), r.perp_dot(p), p.perp_dot(q)];
        let sum: f32 = weights.iter().sum();
        sum > 0.0
            && weights.iter().all(|w| *w >= 0.0)
            && z < (weights[0] * a.z + weights[1] * b.z + weights[2] * c.z) / sum
    })
}

/// Columns of the picture by which it is known whether any of the pad is seen.
const LOOK_PX: usize = 48;

/// Reports a camera that sees nothing of the pad for baffles or the lens. The scene is that of the untouched sensor, of which
/// baffles have their names.
pub fn check_view(sensor: &SensorOptics, scene: &Scene, problems: &mut Problems) {
    if sensor.baffles.is_empty() && sensor.lens.is_none() {
        return;
    }
    let sees_pad = |keep: &dyn Fn(&str) -> bool| {
        let mut scene = scene.clone();
        let rows = (LOOK_PX * scene.camera.height / scene.camera.width).clamp(1, LOOK_PX * LOOK_PX);
        scene.camera = scene.camera.with_raster(LOOK_PX, rows);
        scene.surfaces.retain(|surface| surface.role != Role::Other || keep(&surface.name));
        let renderer = reference::Renderer::new(&scene);
        renderer.is_ok_and(|renderer| renderer.sights().iter().any(Option::is_some))
    };
    // What else keeps the pad from view is told elsewhere.
    if sees_pad(&|_| true) || !sees_pad(&|_| false) {
        return;
    }
    let is_lens = |name: &str| name == LENS;
    if !sees_pad(&is_lens) {
        problems.push(
            "lens",
            "a lens through which the camera sees nothing of the pad",
            "a view of the pad",
            "make it wider, or bring it nearer to the camera",
        );
        return;
    }
    let alone = |baffle: &&BaffleSpec| !sees_pad(&|name| is_lens(name) || name == baffle_name(&baffle.name));
    let key = sensor
        .baffles
        .iter()
        .position(|baffle| alone(&baffle))
        .map_or_else(|| "baffles".to_owned(), |k| format!("baffles[{k}].shape"));
    let [x, y] = sensor.camera.center_mm;
    let eye = to_pad(scene.camera.origin).z;
    problems.push(
        &key,
        format!("before the camera, which looks from [{x}, {y}, {eye}]: it sees nothing of the pad"),
        "a view of the pad past all baffles",
        "move it aside, or make it smaller",
    );
}

/// What a scene calls the lens.
pub const LENS: &str = "the lens";

/// What a scene calls a baffle.
pub fn baffle_name(name: &str) -> String {
    format!("baffle {name:?}")
}
