//! Walls right beside a lamp that shines on them, cut finer than others: the light of a tube that stands a few tenths of a millimetre
//! off its wall fades there within as little, and what the wall sends on of it is most of what lights the pad around.

use super::source::Lamp;
use crate::optics::{Mesh, mesh::nearest_on};
use glam::Vec3;

/// Longest edge over the distance to a lamp that shines there. Found by experiment: with patches of 1.1 mm pictures lit by a tube 0.3 mm
/// off its wall are 4.5 to 6.4 % off, with this 1.5 to 3 %, and with 0.5 no less.
const PART: f32 = 0.7;
/// Edges are not cut below this part of a patch's.
const LEAST: f32 = 0.2;

/// Steps to and fro between a triangle and a lamp.
const ROUNDS: u32 = 6;

/// Triangles of a mesh at most: where lamps ask for more, edges are not cut as far.
const MOST: usize = 12_000;

/// A mesh whose triangles are as small as lamps near them ask for.
pub fn cut(mesh: Mesh, lamps: &[Lamp], patch_mm: f32) -> Mesh {
    let mut least = LEAST;
    loop {
        match cut_down_to(&mesh, lamps, patch_mm, least) {
            Cut::Whole => return mesh,
            Cut::Into(parts) => return parts,
            Cut::TooMany => least *= 2.0,
        }
    }
}

enum Cut {
    /// No triangle is too large.
    Whole,
    Into(Mesh),
    TooMany,
}

fn cut_down_to(mesh: &Mesh, lamps: &[Lamp], patch_mm: f32, least: f32) -> Cut {
    let asks = |corners: &[Vec3; 3]| lamps.iter().any(|lamp| asks(lamp, corners, patch_mm, least));
    let mut waiting: Vec<[Vec3; 3]> = (0..mesh.triangles.len()).map(|k| mesh.corners(k)).collect();
    if !waiting.iter().any(asks) {
        return Cut::Whole;
    }
    let most = MOST + waiting.len();
    let mut parts = Mesh::default();
    while let Some(corners) = waiting.pop() {
        if parts.triangles.len() + waiting.len() > most {
            return Cut::TooMany;
        }
        if asks(&corners) {
            waiting.extend(halves(corners));
            continue;
        }
        let first = parts.positions.len() as u32;
        parts.positions.extend_from_slice(&corners);
        parts.triangles.push([first, first + 1, first + 2]);
    }
    Cut::Into(parts)
}

/// Whether a lamp shines on a triangle that is too large for so near to it.
fn asks(lamp: &Lamp, corners: &[Vec3; 3], patch_mm: f32, least: f32) -> bool {
    let edge = longest(corners).1;
    // From one to the other, to and fro, comes to where they are nearest to each other. (That of a round lamp is the parallelogram
    // around it, that of a tube its axis.)
    let [a, b, c, d] = lamp.source.around();
    let (mut on_lamp, mut distance) = (lamp.center, f32::INFINITY);
    for _ in 0..ROUNDS {
        let on_triangle = nearest_on(corners, on_lamp);
        let halves = [[a, b, c], [a, c, d]].map(|half| nearest_on(&half, on_triangle));
        let [p, q] = halves.map(|p| p.distance(on_triangle));
        (on_lamp, distance) = if p < q { (halves[0], p) } else { (halves[1], q) };
    }
    let distance = (distance - lamp.source.radius_mm()).max(0.0);
    let most = (PART * distance).max(least * patch_mm);
    edge > most && PART * distance < patch_mm && corners.iter().any(|p| lamp.source.faces(*p))
}

/// Which corner a triangle's longest edge begins at, and how long it is.
fn longest(corners: &[Vec3; 3]) -> (usize, f32) {
    let edges = [0, 1, 2].map(|k| (k, corners[k].distance(corners[(k + 1) % 3])));
    edges.into_iter().fold(edges[0], |a, b| if b.1 > a.1 { b } else { a })
}

/// A triangle cut through the middle of its longest edge.
fn halves(corners: [Vec3; 3]) -> [[Vec3; 3]; 2] {
    let (k, _) = longest(&corners);
    let [a, b, c] = [0, 1, 2].map(|n| corners[(k + n) % 3]);
    let middle = 0.5 * (a + b);
    [[a, middle, c], [middle, b, c]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::{Light, LightShape};

    fn lamp(shape: LightShape) -> Lamp {
        let light = Light {
            name: "lamp".to_owned(),
            shape,
            radiance: Vec3::ONE,
            two_sided: false,
            cosine_power: 0.0,
            albedo: Vec3::ZERO,
        };
        Lamp::new(&light).unwrap()
    }

    #[test]
    fn walls_beside_a_tube_are_cut_and_those_behind_a_rectangle_are_not() {
        let walls = Mesh::open_box(Vec3::new(-10.0, -7.0, 0.0), Vec3::new(10.0, 7.0, 20.0));
        let (from, to) = (Vec3::new(9.5, -1.0, 1.6), Vec3::new(9.5, 1.0, 1.6));
        let tube = lamp(LightShape::Tube { from, to, radius: 0.2 });
        let fine = cut(walls.clone(), std::slice::from_ref(&tube), 1.1);
        let area = |mesh: &Mesh| (0..mesh.triangles.len()).map(|k| mesh.area(k)).sum::<f32>();
        assert!((area(&fine) / area(&walls) - 1.0).abs() < 1e-4);
        // As small as asked for beside the tube, large at the other wall, and no more than it takes.
        let edges = |x: f32| {
            let at = (0..fine.triangles.len()).map(|k| fine.corners(k)).filter(move |corners| {
                let middle = corners.iter().sum::<Vec3>() / 3.0;
                (middle.x - x).abs() < 1e-3 && middle.y.abs() < 1.0 && (middle.z - 1.6).abs() < 0.2
            });
            at.map(|corners| longest(&corners).1).fold(0.0, f32::max)
        };
        assert!((0.14..0.23).contains(&edges(10.0)), "{}", edges(10.0));
        assert!(fine.triangles.len() < 5000, "{}", fine.triangles.len());
        let other = (0..fine.triangles.len()).filter(|k| fine.corners(*k).iter().all(|p| p.x < -9.9)).count();
        assert_eq!(other, 2);
        // Normals stay inwards.
        let middle = Vec3::Z * 3.0;
        for [a, b, c] in (0..fine.triangles.len()).map(|k| fine.corners(k)) {
            assert!((b - a).cross(c - a).dot(middle - a) > 0.0);
        }
        // One askew, whose box is as large as the room, asks for no more than where it is near; many ask for coarser ones.
        let (from, to) = (Vec3::new(-9.0, -6.0, 1.6), Vec3::new(9.0, 6.0, 5.0));
        let askew = lamp(LightShape::Tube { from, to, radius: 0.2 });
        let fine = cut(walls.clone(), &[askew], 1.1);
        assert!(fine.triangles.len() < 2000, "{}", fine.triangles.len());
        let row = |k: u32| {
            let x = k as f32 * 0.6 - 9.0;
            let (from, to) = (Vec3::new(x, 6.5, 1.0), Vec3::new(x, 6.5, 9.0));
            lamp(LightShape::Tube { from, to, radius: 0.2 })
        };
        let many: Vec<Lamp> = (0..30).map(row).collect();
        let fine = cut(walls.clone(), &many, 1.1);
        assert!(fine.triangles.len() <= MOST + walls.triangles.len(), "{}", fine.triangles.len());
        let center = Vec3::new(9.999, 0.0, 1.6);
        let rectangle = lamp(LightShape::Rectangle { center, half_u: -Vec3::Y, half_v: Vec3::Z });
        assert_eq!(cut(walls.clone(), &[rectangle], 1.1).triangles.len(), walls.triangles.len());
    }
}
