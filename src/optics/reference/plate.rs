//! Light through a clear plate: the refracted path between two points, solved exactly.
//!
//! A plate with faces at right angles to z bends a ray in one vertical plane, and n sin(theta) stays the same
//! all along. With x the tangent of the angle in air, t_a and t_g the heights travelled in air and in glass, the
//! horizontal distance is r(x) = t_a x + t_g x / sqrt(n^2 + (n^2 - 1) x^2), concave, so that Newton's method from
//! the left never overshoots. Plain connections to a light behind a plate see nothing; these see what is
//! transmitted without inner reflection, and the rest is left to scattered rays.

use crate::optics::bsdf::fresnel;
use glam::Vec3;

/// A clear plate: a box whose large faces are at right angles to z.
#[derive(Debug, Clone, Copy)]
pub struct Plate {
    lo: Vec3,
    hi: Vec3,
    ior: f32,
}

/// The refracted path between two points on different sides of a face.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// Direction in which it leaves the first point.
    pub leaving: Vec3,
    /// Direction in which it arrives at the second.
    pub arriving: Vec3,
    /// Where it crosses the faces, in order.
    pub crossings: [Vec3; 2],
    /// How many faces it crosses, 1 or 2: so many events it takes.
    pub faces: u32,
    /// Radiance leaving the second point that arrives at the first, as a factor: what the faces transmit, and n^2.
    pub transmittance: f32,
    /// Solid angle at the first point for a unit of area at right angles to the ray at the second.
    pub solid_angle: f32,
}

impl Plate {
    pub fn new([lo, hi]: [Vec3; 2], ior: f32) -> Self {
        Self { lo, hi, ior }
    }

    /// Whether the segment crosses a face of the plate.
    pub fn between(&self, p: Vec3, y: Vec3) -> bool {
        [self.lo.z, self.hi.z].iter().any(|&face| (p.z < face) != (y.z < face))
    }

    /// The path from `p` to `y`, which lie on different sides of a face; None where it would leave the plate's
    /// outline.
    pub fn link(&self, p: Vec3, y: Vec3) -> Option<Link> {
        let n = f64::from(self.ior);
        let (pz, yz) = (f64::from(p.z), f64::from(y.z));
        let (lo, hi) = (f64::from(self.lo.z), f64::from(self.hi.z));
        let glass = (pz.max(yz).min(hi) - pz.min(yz).max(lo)).max(0.0);
        let air = (pz - yz).abs() - glass;
        let flat = (y - p).truncate().as_dvec2();
        let r = flat.length();
        if air <= 0.0 {
            return None;
        }
        // Solve r(x) = r.
        let root = |x: f64| (n * n + (n * n - 1.0) * x * x).sqrt();
        let slope = |x: f64| air + glass * n * n / root(x).powi(3);
        let mut x = r / (air + glass / n);
        for _ in 0..20 {
            let step = (r - air * x - glass * x / root(x)) / slope(x);
            x += step;
            if step.abs() <= 1e-9 * (1.0 + x) {
                break;
            }
        }
        let cos_air = 1.0 / (1.0 + x * x).sqrt();
        let sin_air = x * cos_air;
        let cos_glass = (1.0 - (sin_air / n).powi(2)).sqrt();
        let tan_glass = sin_air / n / cos_glass;

        // The faces in between, in order from p.
        let up = yz > pz;
        let ahead = if r > 0.0 { flat / r } else { glam::DVec2::X };
        let order = if up { [lo, hi] } else { [hi, lo] };
        let (mut at, mut z) = (0.0, pz);
        let mut crossings = [Vec3::ZERO; 2];
        let mut faces = 0;
        for face in order {
            if (pz < face) != (yz < face) {
                let in_glass = 0.5 * (z + face) > lo && 0.5 * (z + face) < hi;
                at += (face - z).abs() * if in_glass { tan_glass } else { x };
                z = face;
                let q = (p.truncate().as_dvec2() + ahead * at).as_vec2().extend(face as f32);
                let inside = q.cmpge(self.lo).all() && q.cmple(self.hi).all();
                if !inside {
                    return None;
                }
                crossings[faces as usize] = q;
                faces += 1;
            }
        }
        let inside = |z: f64| z > lo && z < hi;
        let direction = |in_glass: bool| {
            let (sin, cos) = if in_glass { (sin_air / n, cos_glass) } else { (sin_air, cos_air) };
            (ahead * sin).as_vec2().extend(if up { cos } else { -cos } as f32)
        };
        let (leaving, arriving) = (direction(inside(pz)), direction(inside(yz)));
        let index2 = |in_glass: bool| if in_glass { n * n } else { 1.0 };
        let through_face = f64::from(1.0 - fresnel(cos_air as f32, self.ior));
        let transmittance = through_face.powi(faces as i32) * index2(inside(pz)) / index2(inside(yz));
        // d omega = x dx dphi cos_air^4 / (n_p^2 cos_p), and r dr dphi is the horizontal area at y.
        let x_over_r = if r > 0.0 { x / r } else { 1.0 / (air + glass / n) };
        let horizontal = x_over_r * cos_air.powi(4)
            / (slope(x) * index2(inside(pz)) * f64::from(leaving.z.abs()).max(1e-12));
        let solid_angle = horizontal / f64::from(arriving.z.abs()).max(1e-12);
        Some(Link {
            leaving,
            arriving,
            crossings,
            faces,
            transmittance: transmittance as f32,
            solid_angle: solid_angle as f32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::bsdf::refract;

    const PLATE: Plate = Plate { lo: Vec3::new(-9.0, -9.0, 1.5), hi: Vec3::new(9.0, 9.0, 3.5), ior: 1.49 };

    /// Follows the ray face by face, as a path tracer would.
    fn follow(p: Vec3, mut d: Vec3, up: bool, z_end: f32) -> Vec3 {
        let mut at = p;
        for face in if up { [1.5, 3.5] } else { [3.5, 1.5] } {
            if (p.z < face) == (z_end < face) {
                continue;
            }
            at += d * ((face - at.z) / d.z);
            let entering = up == (face == 1.5);
            let normal = if up { Vec3::NEG_Z } else { Vec3::Z };
            d = refract(-d, normal, if entering { 1.49 } else { 1.0 / 1.49 }).unwrap();
        }
        at + d * ((z_end - at.z) / d.z)
    }

    #[test]
    fn the_refracted_ray_arrives_and_its_beam_has_the_right_size() {
        for (p, y) in [
            (Vec3::new(0.5, -1.0, 0.3), Vec3::new(-6.0, 2.0, 5.0)),
            (Vec3::new(0.5, -1.0, 0.3), Vec3::new(0.5, -1.0, 6.0)),
            (Vec3::new(2.0, 1.0, 2.0), Vec3::new(0.5, 2.0, 4.6)),
            (Vec3::new(-4.0, 1.0, 7.0), Vec3::new(3.0, 2.0, 0.2)),
            (Vec3::new(-4.0, 1.0, 7.0), Vec3::new(3.0, 2.0, 3.0)),
        ] {
            let link = PLATE.link(p, y).unwrap();
            let up = y.z > p.z;
            let end = follow(p, link.leaving, up, y.z);
            assert!((end - y).length() < 2e-4, "{p} {y}: {end}");
            // Solid angle of a small cone around the direction against the area it covers at y's height.
            let (s, t) = link.leaving.any_orthonormal_pair();
            let h = 2e-3;
            let corner = |a: f32, b: f32| follow(p, (link.leaving + s * a + t * b).normalize(), up, y.z);
            let edge_s = (corner(h, 0.0) - corner(-h, 0.0)).as_dvec3();
            let edge_t = (corner(0.0, h) - corner(0.0, -h)).as_dvec3();
            let perpendicular = edge_s.cross(edge_t).length() * f64::from(link.arriving.z.abs());
            let truth = 4.0 * f64::from(h * h) / perpendicular;
            assert!(
                (f64::from(link.solid_angle) / truth - 1.0).abs() < 5e-3,
                "{p} {y}: {} {truth}",
                link.solid_angle
            );
        }
    }

    #[test]
    fn without_refraction_it_is_the_straight_line() {
        let glassless = Plate { ior: 1.0, ..PLATE };
        let (p, y) = (Vec3::new(0.5, -1.0, 0.3), Vec3::new(-6.0, 2.0, 5.0));
        let link = glassless.link(p, y).unwrap();
        assert!((link.leaving - (y - p).normalize()).length() < 1e-6);
        assert!((link.solid_angle * (y - p).length_squared() - 1.0).abs() < 1e-5);
        assert!((link.transmittance - 1.0).abs() < 1e-6 && link.faces == 2);
    }

    #[test]
    fn paths_beside_the_plate_are_none() {
        assert!(PLATE.link(Vec3::new(20.0, 0.0, 0.0), Vec3::new(20.0, 0.0, 6.0)).is_none());
        assert!(!PLATE.between(Vec3::new(0.0, 0.0, 4.0), Vec3::new(0.0, 0.0, 6.0)));
    }
}
