//! Whether points of lights are drawn with the density that is claimed: over the surface, and as seen from a place.

use super::*;
use crate::optics::Mesh;
use crate::optics::accel::Accel;
use crate::optics::noise::uniform;
use crate::optics::pearson::{UNLIKELY, chance};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

const N: u32 = 100_000;
/// Bins over a surface, along and across.
const CELLS: [usize; 2] = [16, 12];

fn light(shape: LightShape) -> Light {
    Light {
        name: "l".to_owned(),
        shape,
        radiance: Vec3::ONE,
        two_sided: false,
        cosine_power: 0.0,
        albedo: Vec3::ZERO,
    }
}

/// Points drawn of a light.
fn drawn(emitter: &Emitter) -> impl Iterator<Item = LightPoint> {
    (0..N).map(|i| emitter.sample(Vec2::new(uniform(1, i) as f32, uniform(2, i) as f32)))
}

/// Maps a surface to the unit square, equal areas to equal areas.
type Unroll = Box<dyn Fn(Vec3) -> [f32; 2]>;

/// A light's shape, its area, mm^2, and its surface unrolled.
fn shapes() -> Vec<(&'static str, LightShape, f32, Unroll)> {
    let center = Vec3::new(1.0, -2.0, 3.0);
    // Three axes at right angles that are nobody's axes.
    let [x, y, z] =
        [Vec3::new(2.0, 2.0, 1.0), Vec3::new(-2.0, 1.0, 2.0), Vec3::new(1.0, -2.0, 2.0)].map(|v| v / 3.0);
    let turn = move |along: Vec3, s: Vec3, t: Vec3| (along.dot(t).atan2(along.dot(s)) / TAU).rem_euclid(1.0);
    let strip = LightShape::Rectangle { center, half_u: x * 5.0, half_v: y * 0.25 };
    let rectangle = LightShape::Rectangle { center, half_u: x * 1.5, half_v: y * 2.0 };
    let disc = LightShape::Disc { center, normal: z, radius: 0.8 };
    let tube = LightShape::Tube { from: center, to: center + z * 3.0, radius: 0.5 };
    // A square of 3 by 3 made of triangles of unlike areas.
    let mesh = Mesh {
        positions: [(0.0, 0.0), (3.0, 0.0), (2.0, 1.0), (3.0, 3.0), (0.0, 3.0)]
            .map(|(s, t)| center + x * s + y * t)
            .into(),
        triangles: vec![[0, 1, 2], [1, 3, 2], [2, 3, 4], [0, 2, 4]],
        ..Mesh::default()
    };
    let over = move |half: [f32; 2]| -> Unroll {
        Box::new(move |p| {
            [(p - center).dot(x) / half[0], (p - center).dot(y) / half[1]].map(|v| 0.5 + 0.5 * v)
        })
    };
    // Facets as the tessellation has them, 4 to a bin around: they begin where a disc's and a tube's first corner is.
    let (s, t) = z.any_orthonormal_pair();
    let of_disc: Unroll = {
        let step = TAU / 64.0;
        let apothem = 0.8 * (step / step.sin()).sqrt() * (0.5 * step).cos();
        Box::new(move |p| {
            let around = turn(p - center, s, t);
            let middle = Vec2::from_angle(((around * 64.0).floor() + 0.5) * step);
            let reach = (p - center).dot(s * middle.x + t * middle.y) / apothem;
            [around, reach * reach]
        })
    };
    let of_tube: Unroll = Box::new(move |p| [turn(p - center, s, t), (p - center).dot(z) / 3.0]);
    let of_mesh: Unroll = Box::new(move |p| [(p - center).dot(x) / 3.0, (p - center).dot(y) / 3.0]);
    vec![
        ("rectangle", rectangle, 12.0, over([1.5, 2.0])),
        ("strip", strip, 5.0, over([5.0, 0.25])),
        ("disc", disc, 0.64 * PI, of_disc),
        ("tube", tube, 3.0 * PI, of_tube),
        ("mesh", LightShape::Mesh(Arc::new(mesh)), 9.0, of_mesh),
    ]
}

/// How many points fall on each bin of a surface.
fn over_the_surface(points: impl Iterator<Item = Vec3>, unroll: &Unroll) -> Vec<f64> {
    let mut seen = vec![0.0; CELLS[0] * CELLS[1]];
    for point in points {
        let [a, b] = unroll(point);
        let bin = |part: f32, cells: usize| ((part * cells as f32).max(0.0) as usize).min(cells - 1);
        seen[bin(b, CELLS[1]) * CELLS[0] + bin(a, CELLS[0])] += 1.0;
    }
    seen
}

#[test]
fn points_fall_on_every_part_of_a_light_with_the_density_claimed() {
    for (name, shape, area, unroll) in shapes() {
        let emitter = Emitter::new(&light(shape));
        assert!((emitter.area / area - 1.0).abs() < 1e-5, "{name}: {} mm2", emitter.area);
        // Over the whole surface the density adds up to 1.
        assert!((emitter.pdf_area() * area - 1.0).abs() < 1e-4, "{name}: {}", emitter.pdf_area() * area);
        let in_a_bin = f64::from(N) * f64::from(emitter.pdf_area() * area) / (CELLS[0] * CELLS[1]) as f64;
        let expected = vec![in_a_bin; CELLS[0] * CELLS[1]];
        assert!(drawn(&emitter).all(|at| at.pdf_area == emitter.pdf_area()));
        let seen = over_the_surface(drawn(&emitter).map(|at| at.point), &unroll);
        let likely = chance(&seen, &expected);
        assert!(likely > UNLIKELY, "{name}: {likely}");
        // A density that is a twentieth off, or grows by a fifth from end to end, is told.
        let off: Vec<f64> = expected.iter().map(|e| 1.05 * e).collect();
        let tilted = |k: usize| in_a_bin * (0.9 + 0.2 * ((k % CELLS[0]) as f64 + 0.5) / CELLS[0] as f64);
        let tilted: Vec<f64> = (0..expected.len()).map(tilted).collect();
        assert!(chance(&seen, &off) < UNLIKELY && chance(&seen, &tilted) < UNLIKELY, "{name}");
        // Its image in a mirror is sampled as it is itself.
        let seen = over_the_surface(
            drawn(&emitter.mirrored(7.0)).map(|at| at.point.with_z(14.0 - at.point.z)),
            &unroll,
        );
        let likely = chance(&seen, &expected);
        assert!(likely > UNLIKELY, "{name}, mirrored: {likely}");
    }
}

/// Bins over the directions around that to a light's middle, from the axis and around it.
const RINGS: [usize; 2] = [16, 24];
/// Directions to a side of each bin in which the density is asked for.
const FINE: usize = 24;

/// Directions up to an angle from an axis, in bins of one solid angle.
struct Cone {
    axes: [Vec3; 3],
    /// Cosine of that angle.
    edge: f32,
}

impl Cone {
    fn around(axis: Vec3, edge: f32) -> Self {
        let (s, t) = axis.any_orthonormal_pair();
        Self { axes: [s, t, axis], edge }
    }

    /// The bin of a direction; the last is of all beyond the cone.
    fn bin(&self, direction: Vec3) -> usize {
        let [s, t, axis] = self.axes.map(|a| a.dot(direction));
        let ring = (1.0 - axis) / (1.0 - self.edge) * RINGS[0] as f32;
        let turn = (t.atan2(s) / TAU).rem_euclid(1.0) * RINGS[1] as f32;
        if ring >= RINGS[0] as f32 {
            return RINGS[0] * RINGS[1];
        }
        ring as usize * RINGS[1] + (turn as usize).min(RINGS[1] - 1)
    }

    /// Directions spread over a bin.
    fn within(&self, bin: usize) -> impl Iterator<Item = Vec3> {
        let part = |k: usize| (k as f32 + 0.5) / FINE as f32;
        (0..FINE * FINE).map(move |k| {
            let ring = ((bin / RINGS[1]) as f32 + part(k / FINE)) / RINGS[0] as f32;
            let turn = ((bin % RINGS[1]) as f32 + part(k % FINE)) / RINGS[1] as f32;
            let cos = 1.0 - ring * (1.0 - self.edge);
            let around = Vec2::from_angle(turn * TAU) * (1.0 - cos * cos).max(0.0).sqrt();
            self.axes[0] * around.x + self.axes[1] * around.y + self.axes[2] * cos
        })
    }

    /// Solid angle of a bin.
    fn bin_sr(&self) -> f32 {
        TAU * (1.0 - self.edge) / (RINGS[0] * RINGS[1]) as f32
    }
}

/// The density per solid angle by which light sampling is weighted against scattered rays holds in every direction, and over
/// all directions adds up to the part of the light that faces the place.
#[test]
fn directions_to_a_light_have_the_density_that_scattered_rays_are_weighted_with() {
    let block = Mesh::cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0));
    let places = [
        (
            Vec3::new(0.3, 0.2, 0.0),
            LightShape::Rectangle {
                center: Vec3::new(0.0, 0.0, 2.0),
                half_u: Vec3::Y,
                half_v: Vec3::X * 1.5,
            },
        ),
        (
            Vec3::new(2.5, 0.5, 1.2),
            LightShape::Disc { center: Vec3::new(0.0, 0.0, 2.0), normal: Vec3::X, radius: 0.8 },
        ),
        (Vec3::new(0.0, -2.0, 1.0), LightShape::Tube { from: Vec3::ZERO, to: Vec3::Z * 3.0, radius: 0.5 }),
        (Vec3::new(4.0, 5.0, 5.5), LightShape::Mesh(Arc::new(block))),
    ];
    for (from, shape) in places {
        let emitter = Emitter::new(&light(shape.clone()));
        let mesh = shape.tessellate();
        let corners: Vec<_> = (0..mesh.triangles.len()).map(|k| mesh.corners(k)).collect();
        let accel = Accel::new(&corners);
        // (None of these hides a part of itself that faces the place.)
        let faces = |[a, b, c]: &[Vec3; 3]| (*b - *a).cross(*c - *a).dot(from - *a) > 0.0;
        let area = |[a, b, c]: &[Vec3; 3]| f64::from((*b - *a).cross(*c - *a).length());
        let facing = corners.iter().filter(|t| faces(t)).map(area).sum::<f64>()
            / corners.iter().map(area).sum::<f64>();
        let axis = (emitter.center - from).normalize();
        let edge = mesh.positions.iter().map(|p| axis.dot((*p - from).normalize())).fold(1.0, f32::min);
        let cone = Cone::around(axis, edge - 0.02 * (1.0 - edge));
        let mut seen = vec![0.0; RINGS[0] * RINGS[1] + 1];
        let mut behind = 0.0;
        for at in drawn(&emitter) {
            let direction = (at.point - from).normalize();
            match direction.dot(at.normal) < 0.0 {
                true => seen[cone.bin(direction)] += 1.0,
                false => behind += 1.0,
            }
        }
        let density = |direction: Vec3| {
            let hit = accel.hit(from, direction, f32::INFINITY);
            hit.map_or(0.0, |hit| emitter.pdf_area() * hit.t * hit.t / -hit.normal.dot(direction))
        };
        let in_a_bin = |bin| {
            let sum: f32 = cone.within(bin).map(density).sum();
            f64::from(N) * f64::from(sum * cone.bin_sr()) / (FINE * FINE) as f64
        };
        let mut expected: Vec<f64> = (0..RINGS[0] * RINGS[1]).map(in_a_bin).collect();
        let whole = expected.iter().sum::<f64>() / f64::from(N);
        assert!((whole / facing - 1.0).abs() < 2e-3, "{shape:?}: {whole} instead of {facing}");
        // What faces away is the last bin's, and the test one of all points.
        expected.push(f64::from(N) * (1.0 - facing));
        *seen.last_mut().unwrap() += behind;
        let likely = chance(&seen, &expected);
        assert!(likely > UNLIKELY, "{shape:?}: {likely}");
        // One that is a twentieth off is told.
        let off: Vec<f64> = expected.iter().map(|e| 1.05 * e).collect();
        assert!(chance(&seen, &off) < UNLIKELY, "{shape:?}");
    }
}
