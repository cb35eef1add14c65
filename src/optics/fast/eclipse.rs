//! Lights that stand before others.
//!
//! Of direct light it is known what the pad itself hides, and of walls what lamps hide. A lamp between another one and the pad throws
//! a shadow that nothing here knows: such sensors are left to the reference.

use super::source::Source;
use super::suited::unsupported;
use crate::optics::accel::Accel;
use crate::optics::{Error, Light, Mesh};
use glam::{Vec2, Vec3};

/// Points of the pad along each side that are looked at.
const PLACES: usize = 17;
/// Points of a light: so many along each side of its triangles, where these are few.
const FINE: usize = 4;
/// With more triangles their middles do.
const FEW_TRIANGLES: usize = 16;
/// Part of a light's points that may be hidden from a place: less is a corner of a lamp, seen from a corner of the pad.
const MOST_HIDDEN: f32 = 0.01;
/// A light shines from so far before itself, mm: what touches it from behind hides nothing.
const BEFORE_MM: f32 = 1e-3;

/// Refuses lights of which others hide a part from the pad, which lies within a rectangle under `face`.
pub(super) fn none(
    lights: &[Light],
    sources: &[Source],
    [low, high]: [Vec2; 2],
    face: impl Fn(Vec2) -> f32,
) -> Result<(), Error> {
    if lights.len() < 2 {
        return Ok(());
    }
    let meshes: Vec<Mesh> = lights.iter().map(|light| light.shape.tessellate()).collect();
    let places: Vec<Vec3> = (0..PLACES * PLACES)
        .map(|k| {
            let part = Vec2::new((k % PLACES) as f32 + 0.5, (k / PLACES) as f32 + 0.5) / PLACES as f32;
            let across = low + (high - low) * part;
            across.extend(face(across))
        })
        .collect();
    for (b, blocker) in lights.iter().enumerate() {
        let triangles: Vec<[Vec3; 3]> =
            (0..meshes[b].triangles.len()).map(|k| meshes[b].corners(k)).collect();
        let accel = Accel::new(&triangles);
        for (a, light) in lights.iter().enumerate().filter(|(a, _)| *a != b) {
            let points = points_of(&meshes[a]);
            let lit = places.iter().filter(|place| sources[a].faces(**place));
            let hidden = lit.map(|place| hidden_part(&points, *place, &accel)).fold(0.0, f32::max);
            if hidden > MOST_HIDDEN {
                let value = format!("{:?}, between {:?} and the pad", blocker.name, light.name);
                return Err(unsupported("lights", &value, "lights that hide no other light from the pad"));
            }
        }
    }
    Ok(())
}

/// Points of a light with its normals there.
fn points_of(mesh: &Mesh) -> Vec<[Vec3; 2]> {
    let along = if mesh.triangles.len() > FEW_TRIANGLES { 1 } else { FINE };
    let mut points = Vec::new();
    for k in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(k);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for n in 0..along * along {
            // The middles of equal triangles.
            let (row, place) = ((n as f32).sqrt() as usize, n - ((n as f32).sqrt() as usize).pow(2));
            let hanging = place % 2;
            let third = (1 + hanging) as f32 / 3.0;
            let s = (row - place / 2 - hanging) as f32 + third;
            let t = (place / 2) as f32 + third;
            let p = a + (b - a) * (s / along as f32) + (c - a) * (t / along as f32);
            points.push([p, normal]);
        }
    }
    points
}

/// The part of a light's points before a place that something hides from it.
fn hidden_part(points: &[[Vec3; 2]], place: Vec3, accel: &Accel) -> f32 {
    let (mut hidden, mut all) = (0.0, 0.0f32);
    for [point, normal] in points {
        if (place - *point).dot(*normal) <= 0.0 {
            continue;
        }
        all += 1.0;
        hidden += f32::from(u8::from(accel.blocked(*point + *normal * BEFORE_MM, place)));
    }
    hidden / all.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::LightShape;
    use crate::optics::bench_scene::Variant;
    use crate::optics::fast::Precomputed;
    use crate::optics::trial::Trial;

    #[test]
    fn a_triangle_is_cut_into_equal_ones() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let points = points_of(&mesh);
        assert_eq!(points.len(), FINE * FINE);
        let mean = points.iter().map(|[p, _]| *p).sum::<Vec3>() / points.len() as f32;
        assert!((mean - Vec3::new(1.0, 1.0, 0.0) / 3.0).length() < 1e-6, "{mean}");
        assert!(points.iter().all(|[p, n]| p.x > 0.0 && p.y > 0.0 && p.x + p.y < 1.0 && *n == Vec3::Z));
        for (k, [p, _]) in points.iter().enumerate() {
            assert!(points[..k].iter().all(|[q, _]| (*p - *q).length() > 0.5 / FINE as f32 / 3.0));
        }
    }

    /// The blue lamp of the benchmark scene pulled before the pad: light from behind it would shine through.
    #[test]
    fn a_lamp_before_another_is_left_to_the_reference_and_one_beside_it_is_not() {
        let mut scene = Trial::own(Variant::Ac, [40, 30]).expect("the scene").untouched;
        assert!(Precomputed::new(&scene).is_ok());
        let behind = scene.lights[0].clone();
        let LightShape::Rectangle { center, .. } = &mut scene.lights[0].shape else { panic!("a rectangle") };
        center.x *= 0.6;
        scene.lights = vec![scene.lights[0].clone(), Light { name: "behind".to_owned(), ..behind }];
        let told = Precomputed::new(&scene).expect_err("a shadow that is not known").to_string();
        assert!(told.contains("\"blue\", between"), "{told}");
    }
}
