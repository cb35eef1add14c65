//! Cameras that do not look straight down on the pad.

use super::cases::{case, changed};
use super::{Case, Due};
use crate::optics::Scene;
use glam::Vec3;

pub(super) fn cases(cases: &mut Vec<Case>) {
    let (down, up) = (Vec3::NEG_Z, Vec3::Z);
    for (name, origin, forward, above) in [
        ("looks at the ceiling", Vec3::Z * 4.0, up, Vec3::Y),
        ("looks sideways", Vec3::new(-6.0, 0.0, 4.0), Vec3::X, up),
        ("looks askew onto pad and walls", Vec3::new(-6.0, 0.0, 12.0), Vec3::X + down, Vec3::X + up),
        ("is turned by 30 degrees", Vec3::Z * 19.0, down, Vec3::new(0.5, 0.866, 0.0)),
    ] {
        let turn = move |scene: &mut Scene| {
            let camera = &mut scene.camera;
            (camera.origin, camera.forward, camera.up) = (origin, forward.normalize(), above.normalize());
            camera.right = camera.forward.cross(camera.up).normalize();
        };
        cases.push(case(format!("the camera {name}"), Due::Picture, changed(turn)).judged_closely());
    }
}
