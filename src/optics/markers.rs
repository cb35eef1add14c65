//! Dots printed on the pad's coating, in rows and columns.

use super::Texture;
use super::sensor::SensorOptics;
use glam::{DVec2, Vec3};

/// Texels along the edge of a camera pixel: bilinear samples of texels this small keep a dot's edge within half a pixel.
const FINENESS: usize = 2;
/// Samples along the edge of a texel that a dot's edge may cross.
const SAMPLES: usize = 4;

/// The albedo of a face with the sensor's markers, in the coordinates of
/// [`texture_coordinate`](super::sensor_scene::texture_coordinate); None where it has none.
pub fn printed(sensor: &SensorOptics) -> Option<Texture> {
    let markers = sensor.markers.as_ref()?;
    let view = DVec2::from(sensor.view_mm());
    let center = DVec2::from(sensor.camera.center_mm) - DVec2::from(markers.offset_mm);
    let [width, height] = [sensor.camera.width_px, sensor.camera.height_px].map(|n| FINENESS * n);
    let step = view / DVec2::new(width as f64, height as f64);
    let radius = markers.diameter_mm / 2.0;
    // How far from the middle of the nearest marker.
    let away = |p: DVec2| (p - (p / markers.pitch_mm).round() * markers.pitch_mm).length();
    let covered = |u: f64, v: f64| {
        let middle = (DVec2::new(u, v) - 0.5) * view + center;
        let reach = 0.5 * step.length();
        let distance = away(middle);
        if (distance - radius).abs() > reach {
            return f64::from(u8::from(distance < radius));
        }
        let mut inside = 0;
        for k in 0..SAMPLES * SAMPLES {
            let at = DVec2::new((k % SAMPLES) as f64 + 0.5, (k / SAMPLES) as f64 + 0.5) / SAMPLES as f64;
            inside += usize::from(away(middle + (at - 0.5) * step) < radius);
        }
        inside as f64 / (SAMPLES * SAMPLES) as f64
    };
    Some(Texture::from_fn(width, height, |u, v| {
        let ink = covered(u, v);
        Vec3::splat((ink * markers.albedo + (1.0 - ink) * sensor.coating.albedo) as f32)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::sensor::MarkerSpec;
    use crate::optics::sensor_scene::texture_coordinate;

    #[test]
    fn markers_are_dark_dots_at_their_places_and_cover_their_part_of_the_face() {
        let mut sensor: SensorOptics = toml::from_str(
            "lights = []\n[camera]\nwidth_px = 160\nheight_px = 120\nmm_per_px = 0.1\ndistance_mm = 12.0\n\
             center_mm = [0.3, -0.2]\n[coating]\nalbedo = 0.6\n[markers]\npitch_mm = 2.0\ndiameter_mm = 0.8\n\
             albedo = 0.1\noffset_mm = [0.5, 0.25]",
        )
        .unwrap();
        let texture = printed(&sensor).unwrap();
        let at = |x: f32, y: f32| texture.sample(texture_coordinate(&sensor, Vec3::new(x, y, 0.0))).x;
        for (x, y) in [(0.5, 0.25), (2.5, 0.25), (-3.5, 4.25)] {
            assert!((at(x, y) - 0.1).abs() < 1e-6);
            assert!((at(x + 1.0, y + 1.0) - 0.6).abs() < 1e-6);
            // At the rim half of it is ink.
            assert!((at(x + 0.4, y) - 0.35).abs() < 0.12, "{}", at(x + 0.4, y));
        }
        // 16 x 12 mm hold 8 x 6 whole pitches.
        let share = std::f32::consts::PI * 0.4 * 0.4 / 4.0;
        assert!((texture.mean().x - (0.6 - 0.5 * share)).abs() < 1e-3, "{}", texture.mean());
        sensor.markers = None;
        assert!(printed(&sensor).is_none());
        assert!(toml::from_str::<MarkerSpec>("pitch_mm = 2.0\ndiameter_mm = 0.8\ncolour = 3").is_err());
    }
}
