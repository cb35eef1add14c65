//! How small and how large a scene may be: single precision tells points apart to a ten-millionth of the largest coordinate,
//! and rays start that far off what they leave.

use super::{Error, Role, Scene};
use glam::Vec3;

/// Diagonal of a pad, mm. (Of pads of 0.02 and of 20 million mm the same picture is seen to the noise of 16 samples a pixel;
/// one of 0.0002 mm comes out a fifth too dark.)
const PAD_MM: [f32; 2] = [1e-2, 1e7];
/// How far from the origin anything may reach, in diagonals of the pad: rays then start at most 0.04 % of one off a surface.
const MOST_REACH: f32 = 200.0;

/// Whether the parts of a scene are near enough to each other, and its pad of a size, to be told apart.
///
/// # Errors
/// Names the first part that is too small or too far away.
pub fn check(scene: &Scene) -> Result<(), Error> {
    let Some(pad) = scene.surface(Role::Pad) else { return Ok(()) };
    let inf = Vec3::splat(f32::INFINITY);
    let [low, high] =
        pad.mesh.positions.iter().fold([inf, -inf], |[low, high], p| [low.min(*p), high.max(*p)]);
    let diagonal_mm = (high - low).length();
    if !(PAD_MM[0]..=PAD_MM[1]).contains(&diagonal_mm) {
        return Err(Error::Scene {
            part: pad.name.clone(),
            what: format!("its diagonal is {diagonal_mm} mm"),
            next: format!("use {} to {} mm: lengths of a scene are in mm", PAD_MM[0], PAD_MM[1]),
        });
    }
    let farthest = |points: &[Vec3]| points.iter().fold(0.0f32, |most, p| most.max(p.abs().max_element()));
    let surfaces = scene.surfaces.iter().map(|s| (s.name.as_str(), farthest(&s.mesh.positions)));
    let lights = scene.lights.iter().map(|l| (l.name.as_str(), farthest(&l.shape.tessellate().positions)));
    let camera = ("the camera", farthest(&[scene.camera.origin]));
    let allowed_mm = MOST_REACH * diagonal_mm;
    match surfaces.chain(lights).chain([camera]).find(|(_, reach)| *reach > allowed_mm) {
        None => Ok(()),
        Some((part, reach)) => Err(Error::Scene {
            part: part.to_owned(),
            what: format!(
                "it reaches {reach} mm from the origin, {:.0} times the pad's diagonal",
                reach / diagonal_mm
            ),
            next: format!(
                "keep everything within {MOST_REACH} times that, {allowed_mm} mm; brighter lights need not be larger"
            ),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::LightShape;
    use crate::optics::bench_scene::{Variant, parse};
    use std::sync::Arc;

    #[test]
    fn what_single_precision_cannot_tell_apart_is_refused() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        let told = |change: &dyn Fn(&mut Scene)| {
            let mut scene = parse(text, Variant::Ac).unwrap();
            change(&mut scene);
            scene.check().map_err(|e| e.to_string()).err().unwrap_or_default()
        };
        let away = |scene: &mut Scene, to: f32| match &mut scene.lights[1].shape {
            LightShape::Rectangle { center, .. } => center.z = to,
            _ => unreachable!("the lights of the scene are rectangles"),
        };
        assert_eq!(told(&|s| away(s, 1e3)), "");
        for far in [1e4, 1e8, 1e30] {
            let told = told(&|s| away(s, far));
            assert!(told.contains("mm from the origin") && told.contains("within 200 times"), "{told}");
        }
        let resized = |scene: &mut Scene, scale: f32| {
            let mut mesh = (*scene.surfaces[0].mesh).clone();
            mesh.positions.iter_mut().for_each(|p| *p *= scale);
            scene.surfaces[0].mesh = Arc::new(mesh);
        };
        assert!(told(&|s| resized(s, 1e-5)).contains("use 0.01 to"), "{}", told(&|s| resized(s, 1e-5)));
        assert!(told(&|s| s.camera.origin.x = 1e7).contains("the camera"));
    }
}
