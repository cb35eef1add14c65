//! The way of a ray from the camera through plate and lens down to the pad.
//!
//! All faces are round about the camera's axis, so a ray that begins on the axis stays in one plane with it: it is followed
//! there face by face, exactly (transfer to a spherical face as in Welford, *Aberrations of Optical Systems*, section 4.3).
//! Rays near the axis tell what a pixel sees of the face, as a lens maker would work it out.

use super::sensor::SensorOptics;

/// What lies between camera and pad.
#[derive(Debug, Clone, PartialEq)]
pub struct Sightline {
    /// The camera over the undeformed face, mm.
    eye_mm: f64,
    /// From the camera down.
    faces: Vec<Face>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Face {
    vertex_mm: f64,
    curvature: f64,
    /// From the axis to its rim, mm.
    half_mm: f64,
    /// Index of refraction below over that above.
    eta: f64,
}

/// Where rays near the axis end on the undeformed face: one that leaves the camera `y` mm off the axis with the tangent `u`
/// meets it `a y + b u` mm off the axis, and at a depth of `z` mm behind it `d u z` mm farther out if y is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paraxial {
    /// By the place of the ray.
    pub a: f64,
    /// By its tangent, mm: the face seems to be so far away.
    pub b: f64,
    /// By depth and tangent.
    pub d: f64,
}

/// A ray in its plane: distance from the axis and height over the undeformed face, mm, and a unit direction.
#[derive(Debug, Clone, Copy)]
struct Ray {
    at: [f64; 2],
    along: [f64; 2],
}

impl Ray {
    /// How far it is from the axis at a height, mm.
    fn at_height(&self, height_mm: f64) -> f64 {
        self.at[0] + (height_mm - self.at[1]) * self.along[0] / self.along[1]
    }
}

/// What counts as near the axis: the square of it is lost in the result.
const NEAR_AXIS: f64 = 1e-6;
/// Steps within which a ray is found, and how near to its goal, mm.
const STEPS: usize = 24;
const FOUND_MM: f64 = 1e-7;

impl Sightline {
    /// Of a sensor.
    pub fn of(sensor: &SensorOptics) -> Self {
        let mut faces = Vec::new();
        if let Some(plate) = &sensor.plate {
            let [low, high] = plate.heights_mm();
            let face = |vertex_mm, eta| Face { vertex_mm, curvature: 0.0, half_mm: f64::INFINITY, eta };
            faces.extend([face(high, plate.ior), face(low, 1.0 / plate.ior)]);
        }
        if let Some(lens) = &sensor.lens {
            for (face, eta) in [(lens.back(), lens.ior), (lens.front(), 1.0 / lens.ior)] {
                let (vertex_mm, curvature) = (face.vertex_mm, face.curvature);
                faces.push(Face { vertex_mm, curvature, half_mm: lens.half_mm(), eta });
            }
        }
        faces.sort_by(|a, b| b.vertex_mm.total_cmp(&a.vertex_mm));
        Self { eye_mm: sensor.camera.distance_mm, faces }
    }

    /// How rays near the axis run.
    pub fn paraxial(&self) -> Paraxial {
        let ends = |y: f64, u: f64| {
            let ray = self.follow(y, u);
            ray.map_or((f64::NAN, f64::NAN), |ray| (ray.at_height(0.0), -ray.along[0] / ray.along[1]))
        };
        let (by_place, by_tangent) = (ends(NEAR_AXIS, 0.0), ends(0.0, NEAR_AXIS));
        Paraxial { a: by_place.0 / NEAR_AXIS, b: by_tangent.0 / NEAR_AXIS, d: by_tangent.1 / NEAR_AXIS }
    }

    /// How far from the axis, mm, a ray of this tangent meets a height over the undeformed face; None where it passes beside
    /// the lens, or is reflected inside.
    pub fn meets(&self, tangent: f64, height_mm: f64) -> Option<f64> {
        Some(self.follow(0.0, tangent)?.at_height(height_mm))
    }

    /// The tangent at which the camera sees what is so far from the axis and so high over the undeformed face, mm.
    pub fn tangent(&self, r_mm: f64, height_mm: f64) -> Option<f64> {
        if r_mm < FOUND_MM {
            return Some(0.0);
        }
        let near = self.paraxial();
        let mut before = (0.0, -r_mm);
        let mut tangent = r_mm / (near.b - near.d * height_mm);
        for _ in 0..STEPS {
            let off = self.meets(tangent, height_mm)? - r_mm;
            if off.abs() < FOUND_MM {
                return Some(tangent);
            }
            let slope = (off - before.1) / (tangent - before.0);
            before = (tangent, off);
            tangent -= off / slope;
        }
        None
    }

    fn follow(&self, off_axis_mm: f64, tangent: f64) -> Option<Ray> {
        let cos = 1.0 / (1.0 + tangent * tangent).sqrt();
        let start = Ray { at: [off_axis_mm, self.eye_mm], along: [tangent * cos, -cos] };
        self.faces.iter().try_fold(start, |ray, face| face.refract(ray))
    }
}

impl Face {
    fn refract(&self, ray: Ray) -> Option<Ray> {
        let c = self.curvature;
        let [along_r, along_h] = ray.along;
        // From the plane through the vertex on to the face.
        let r = ray.at_height(self.vertex_mm);
        let f = c * r * r;
        let g = along_h - c * r * along_r;
        let root = g * g - c * f;
        if root < 0.0 {
            return None;
        }
        let t = f / (g + root.sqrt().copysign(g));
        let (r, sag) = (r + along_r * t, along_h * t);
        if r.abs() > self.half_mm {
            return None;
        }
        // The normal against the ray, and Snell's law.
        let up = [-c * r, 1.0 - c * sag];
        let sign = if up[0] * along_r + up[1] * along_h > 0.0 { -1.0 } else { 1.0 };
        let normal = up.map(|v| sign * v);
        let cos = -(normal[0] * along_r + normal[1] * along_h);
        let k = 1.0 - (1.0 - cos * cos) / (self.eta * self.eta);
        if k < 0.0 {
            return None;
        }
        let turn = cos / self.eta - k.sqrt();
        let along = [along_r / self.eta + turn * normal[0], along_h / self.eta + turn * normal[1]];
        (along[1] < 0.0).then_some(Ray { at: [r, self.vertex_mm + sag], along })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::sensor::LensSpec;

    fn sensor(rest: &str) -> SensorOptics {
        let text = format!(
            "lights = []\n[camera]\nwidth_px = 64\nheight_px = 48\nmm_per_px = 0.2\ndistance_mm = 20.0\n{rest}"
        );
        toml::from_str(&text).unwrap()
    }

    #[test]
    fn a_plate_lifts_the_face_by_its_thickness_less_what_it_is_in_air() {
        let line = Sightline::of(&sensor("[plate]\ngap_mm = 1.0\nthickness_mm = 3.0\nior = 1.5\n"));
        let near = line.paraxial();
        assert!((near.b - 19.0).abs() < 1e-9 && (near.a - 1.0).abs() < 1e-9 && (near.d - 1.0).abs() < 1e-9);
        // Off the axis by Snell's law: 17 mm in air and 3 mm in glass.
        let u: f64 = 0.8;
        let sin = u / (1.0 + u * u).sqrt() / 1.5;
        let truth = 17.0 * u + 3.0 * sin / (1.0 - sin * sin).sqrt();
        assert!((line.meets(u, 0.0).unwrap() - truth).abs() < 1e-12);
    }

    #[test]
    fn a_lens_does_near_its_axis_what_the_lensmakers_formula_says() {
        let (front, back, thick, n, gap, eye) = (12.0, 20.0, 4.0, 1.5, 2.0, 20.0);
        let line = Sightline::of(&sensor(&format!(
            "[lens]\ngap_mm = {gap:?}\nthickness_mm = {thick:?}\ndiameter_mm = 12.0\nfront_radius_mm = {front:?}\n\
             back_radius_mm = {back:?}\nior = {n:?}\n"
        )));
        // Powers of both faces, and the system's matrix from the camera to the pad.
        let (p1, p2) = ((n - 1.0) / back, (n - 1.0) / front);
        let (s, t, e) = (eye - gap - thick, thick / n, gap);
        let focal: f64 = 1.0 / (p1 + p2 - p1 * p2 * t);
        let a = (1.0 - p1 * t) - e / focal;
        let b = s * (1.0 - p1 * t) + t + e * (1.0 - p2 * t - s / focal);
        let d = 1.0 - p2 * t - s / focal;
        let near = line.paraxial();
        assert!(
            (near.a - a).abs() < 1e-6 && (near.b - b).abs() < 1e-6 && (near.d - d).abs() < 1e-6,
            "{near:?}"
        );
        assert!((focal - 15.6521739).abs() < 1e-6, "{focal}");
        // And what the camera sees somewhere is seen there.
        for (r, height) in [(0.0, 0.0), (1.0, 0.0), (2.5, 0.8), (4.0, 0.0)] {
            let tangent = line.tangent(r, height).unwrap();
            assert!((line.meets(tangent, height).unwrap() - r).abs() < 1e-6);
        }
    }

    #[test]
    fn a_shell_round_about_the_camera_bends_nothing_on_its_way() {
        // Both faces have their centre in the camera: every ray meets them head on.
        let mut sensor = sensor("");
        let shell = |gap_mm: f64, thickness_mm: f64| LensSpec {
            gap_mm,
            thickness_mm,
            diameter_mm: 30.0,
            front_radius_mm: Some(20.0 - gap_mm),
            back_radius_mm: Some(gap_mm + thickness_mm - 20.0),
            ior: 1.7,
        };
        sensor.lens = Some(shell(1.0, 2.0));
        let line = Sightline::of(&sensor);
        for u in [1e-3, 0.3, 0.7] {
            assert!((line.meets(u, 0.0).unwrap() - 20.0 * u).abs() < 1e-9);
        }
        assert!(line.meets(2.0, 0.0).is_none(), "it passes beside the rim");
    }
}
