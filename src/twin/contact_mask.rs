//! Which pixels show the face where it touches the indenter.
//!
//! The elastomer tells contact at the nodes of its surface lattice. Each cell that touches is drawn where the
//! camera sees its displaced corners (a pinhole straight above the pad; behind a plate as near as it seems, through a lens as
//! its rays run), and
//! a pixel is in contact when the value interpolated at its centre is at least one half. Folds are not sorted: a
//! pixel that shows any part in contact is in contact.

use crate::elastomer::ElastomerCapture;
use crate::image::Mask;
use crate::optics::sensor::SensorOptics;
use crate::optics::sensor_scene::camera_of;
use crate::optics::sightline::Sightline;
use glam::{Vec2, Vec3};

/// The mask of a deformed pad, on the camera's raster.
pub fn contact_mask(sensor: &SensorOptics, pad: &ElastomerCapture) -> Mask {
    let lens = Lens::of(sensor);
    let (width, height) = (sensor.camera.width_px, sensor.camera.height_px);
    let mut mask = Mask { width: width as u32, height: height as u32, inside: vec![false; width * height] };
    let (nx, ny) = (pad.surface.nx, pad.surface.ny);
    let positions = pad.drawn();
    // (Contact ends at a rim.)
    let mut parts: Vec<f32> = pad.contact.iter().map(|touches| if *touches { 1.0 } else { 0.0 }).collect();
    pad.rim.iter().for_each(|rim| parts[rim.point] = 0.5);
    for j in 0..ny.saturating_sub(1) {
        for i in 0..nx.saturating_sub(1) {
            let corners = [j * nx + i, j * nx + i + 1, (j + 1) * nx + i + 1, (j + 1) * nx + i];
            if !corners.iter().any(|k| parts[*k] > 0.0) {
                continue;
            }
            let at = corners.map(|k| lens.pixel(positions[k]));
            let touches = corners.map(|k| parts[k]);
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                fill(&mut mask, [at[a], at[b], at[c]], [touches[a], touches[b], touches[c]]);
            }
        }
    }
    mask
}

/// The way from a point of the pad to a place in the picture.
struct Lens {
    center_mm: Vec2,
    /// From the pinhole to the untouched face, as it seems.
    distance_mm: f32,
    px_per_tangent: f32,
    middle_px: Vec2,
    distortion: Option<crate::optics::camera::Distortion>,
    /// Where a lens bends the rays.
    sightline: Option<Sightline>,
}

impl Lens {
    fn of(sensor: &SensorOptics) -> Self {
        let (camera, spec) = (camera_of(sensor), &sensor.camera);
        let distance_mm = (sensor.view_mm()[0] / 2.0) as f32 / camera.tan_half_x;
        Lens {
            center_mm: Vec2::from(spec.center_mm.map(|v| v as f32)),
            distance_mm,
            px_per_tangent: spec.width_px as f32 / (2.0 * camera.tan_half_x),
            middle_px: Vec2::new(spec.width_px as f32, spec.height_px as f32) / 2.0,
            distortion: camera.distortion,
            sightline: sensor.lens.as_ref().map(|_| Sightline::of(sensor)),
        }
    }

    /// Pixels from the upper left corner. Pressed points (z below 0) are nearer to the camera.
    fn pixel(&self, point: Vec3) -> Vec2 {
        let off_axis = point.truncate() - self.center_mm;
        let r_mm = off_axis.length();
        let bent = self.sightline.as_ref().and_then(|s| s.tangent(f64::from(r_mm), f64::from(-point.z)));
        let tangent = match bent {
            Some(tangent) => off_axis.normalize_or_zero() * tangent as f32,
            None => off_axis / (self.distance_mm + point.z).max(1e-3),
        };
        let seen = self.distortion.map_or(tangent, |d| d.distort(tangent));
        self.middle_px + seen * self.px_per_tangent
    }
}

/// Marks the pixels of a triangle whose centres see a value of at least one half.
fn fill(mask: &mut Mask, corners: [Vec2; 3], values: [f32; 3]) {
    let [a, b, c] = corners;
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let low = a.min(b).min(c);
    let high = a.max(b).max(c);
    let range = |low: f32, high: f32, size: u32| {
        let first = (low - 0.5).ceil().clamp(0.0, size as f32) as usize;
        first..((high - 0.5).floor() + 1.0).clamp(0.0, size as f32) as usize
    };
    for y in range(low.y, high.y, mask.height) {
        for x in range(low.x, high.x, mask.width) {
            let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let weights = [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)];
            let weights = weights.map(|w| w / area);
            let value: f32 = weights.iter().zip(values).map(|(w, v)| w * v).sum();
            if weights.iter().all(|w| *w >= -1e-5) && value >= 0.5 {
                mask.inside[y * mask.width as usize + x] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::{ContactForces, RimPoint, SolverStats, Surface};
    use crate::optics::sensor::LensSpec;

    /// A round contact at (2, -1) of radius 1.5 mm, pressed flat to a depth.
    fn pressed(depth_mm: f32) -> ElastomerCapture {
        let (n, size) = (201, 20.0_f32);
        let mut positions = Vec::new();
        let mut contact = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let at = |k: usize| size * (k as f32 / (n - 1) as f32 - 0.5);
                let touches = Vec2::new(at(i) - 2.0, at(j) + 1.0).length() <= 1.5;
                positions.push(Vec3::new(at(i), at(j), if touches { -depth_mm } else { 0.0 }));
                contact.push(touches);
            }
        }
        let surface = Surface { nx: n, ny: n, size_x_mm: 20.0, size_y_mm: 20.0, positions };
        let (forces, stats) = (ContactForces::default(), SolverStats::default());
        ElastomerCapture { surface, contact, rim: Vec::new(), forces, stats }
    }

    #[test]
    fn the_mask_is_where_a_path_tracer_sees_the_contact() {
        let file: toml::Table = toml::from_str(include_str!("../../rig_configs/sensors/skin.toml")).unwrap();
        let mut sensor: SensorOptics = file["optics"].clone().try_into().expect("the shipped sensor");
        agrees(&sensor);
        // A dome that shows what is off its axis farther out than near it.
        sensor.lens = Some(LensSpec {
            gap_mm: 3.0,
            thickness_mm: 9.0,
            diameter_mm: 19.0,
            front_radius_mm: Some(11.0),
            back_radius_mm: None,
            ior: 1.49,
        });
        agrees(&sensor);
    }

    fn agrees(sensor: &SensorOptics) {
        let pad = pressed(1.0);
        let mask = contact_mask(sensor, &pad);
        let seen = crate::optics::imager::depth_map(
            sensor,
            &crate::twin::view::displaced(&pad, crate::elastomer::PadShape::Cuboid),
        )
        .unwrap();
        let (mut both, mut either) = (0, 0);
        for (inside, depth_mm) in mask.inside.iter().zip(seen) {
            let pressed = depth_mm < -0.5;
            both += usize::from(*inside && pressed);
            either += usize::from(*inside || pressed);
        }
        // The wall around the contact is one lattice cell wide: what is left is its outline.
        assert!(both > 1000 && both as f64 > 0.95 * either as f64, "{both} of {either}");
    }

    #[test]
    fn a_contact_ends_at_its_rim() {
        let file: toml::Table = toml::from_str(include_str!("../../rig_configs/sensors/skin.toml")).unwrap();
        let mut sensor: SensorOptics = file["optics"].clone().try_into().expect("the shipped sensor");
        sensor.camera.center_mm = [0.0, 0.0];
        // Touched to the left of x = 1.03, between two points of the lattice.
        let mut pad = pressed(0.0);
        let (n, edge_mm) = (pad.surface.nx, 1.03_f32);
        let x = |k: usize| 0.1 * (k % n) as f32 - 10.0;
        pad.contact = (0..n * n).map(|k| x(k) < edge_mm).collect();
        let area_mm2 = |pad: &ElastomerCapture| {
            let mask = contact_mask(&sensor, pad);
            let mm2 = sensor.camera.mm_per_px.powi(2);
            mask.inside.iter().filter(|inside| **inside).count() as f64 * mm2
        };
        let [wide, high] = sensor.view_mm();
        let truth = high * (wide / 2.0 + f64::from(edge_mm));
        let off = |pad: &ElastomerCapture| area_mm2(pad) / high - truth / high;
        // Half a spacing beside its last points without a rim.
        assert!((off(&pad) - 0.02).abs() < 0.6 * sensor.camera.mm_per_px, "{} mm", off(&pad));
        let nearest = (0..n * n).filter(|k| (x(*k) - edge_mm).abs() < 0.05);
        pad.rim = nearest
            .map(|point| RimPoint { point, at: pad.surface.positions[point].with_x(edge_mm) })
            .collect();
        assert!(off(&pad).abs() < 0.6 * sensor.camera.mm_per_px, "{} mm", off(&pad));
    }

    #[test]
    fn nothing_touches_nothing_is_marked() {
        let file: toml::Table = toml::from_str(include_str!("../../rig_configs/sensors/skin.toml")).unwrap();
        let sensor: SensorOptics = file["optics"].clone().try_into().expect("the shipped sensor");
        let mut pad = pressed(0.0);
        pad.contact.fill(false);
        assert!(contact_mask(&sensor, &pad).inside.iter().all(|inside| !inside));
    }
}
