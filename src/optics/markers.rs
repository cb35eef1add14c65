//! What is on the pad's coating: dots printed in rows and columns, and the coat's own grain.

mod dots;

use super::Texture;
use super::grain;
use super::sensor::{MarkerSpec, SensorOptics};
use dots::Dots;
use glam::{DVec2, Vec3};

/// Texels along the edge of a camera pixel: bilinear samples of texels this small keep a dot's edge within half a pixel.
const FINENESS: usize = 2;
/// Samples along the edge of a texel that a dot's edge may cross.
const SAMPLES: usize = 4;

/// The albedo of a face with the sensor's markers and grain, in the coordinates of
/// [`texture_coordinate`](super::sensor_scene::texture_coordinate); None where it has neither. Ink covers the grain.
pub fn printed(sensor: &SensorOptics) -> Option<Texture> {
    let grain = sensor.grain.as_ref().filter(|grain| grain.shows());
    if sensor.markers.is_none() && grain.is_none() {
        return None;
    }
    let size = [sensor.camera.width_px, sensor.camera.height_px].map(|n| FINENESS * n);
    let coat = sensor.coating.albedo;
    let mut texture = match &sensor.markers {
        Some(markers) => {
            let covered = cover(sensor, markers, size);
            Texture::from_fn(size[0], size[1], |u, v| {
                let ink = covered(u, v);
                Vec3::splat((ink * markers.albedo + (1.0 - ink) * coat) as f32)
            })
        }
        None => Texture {
            width: size[0],
            height: size[1],
            texels: vec![Vec3::splat(coat as f32); size[0] * size[1]],
        },
    };
    if let Some(grain) = grain {
        let factors = grain::factors(grain, size, sensor.view_mm()[0] / size[0] as f64);
        let ink = sensor.markers.as_ref().map_or(0.0, |markers| markers.albedo);
        // What a texel has of the coat, by its albedo.
        let bare = |albedo: f32| if coat == ink { 1.0 } else { (f64::from(albedo) - ink) / (coat - ink) };
        for (texel, factor) in texture.texels.iter_mut().zip(factors) {
            let change = bare(texel.x) * coat * f64::from(factor - 1.0);
            *texel = Vec3::splat((f64::from(texel.x) + change).clamp(0.0, MOST_ALBEDO) as f32);
        }
    }
    Some(texture)
}

/// Grain makes no coat brighter than this, which light would not leave.
const MOST_ALBEDO: f64 = 0.99;

/// How much of a texel dots cover, by its middle.
fn cover(
    sensor: &SensorOptics,
    markers: &MarkerSpec,
    [width, height]: [usize; 2],
) -> impl Fn(f64, f64) -> f64 {
    let view = DVec2::from(sensor.view_mm());
    let center = DVec2::from(sensor.camera.center_mm) - DVec2::from(markers.offset_mm);
    let step = view / DVec2::new(width as f64, height as f64);
    let dots = Dots::of(markers, center - 0.5 * view, center + 0.5 * view);
    move |u: f64, v: f64| dots.cover((DVec2::new(u, v) - 0.5) * view + center, step, SAMPLES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::sensor::GrainSpec;
    use crate::optics::sensor_scene::texture_coordinate;

    #[test]
    fn markers_are_dark_dots_at_their_places_and_cover_their_part_of_the_face() {
        let mut sensor: SensorOptics = toml::from_str(
            "lights = []\n[camera]\nwidth_px = 160\nheight_px = 120\nmm_per_px = 0.1\ndistance_mm = 12.0\n\
             center_mm = [0.3, -0.2]\n[coating]\nalbedo = 0.6\n[markers]\npitch_mm = 2.0\ndiameter_mm = 0.8\n\
             albedo = 0.1\noffset_mm = [0.5, 0.25]\n\
             place_rms = 0.0\nsize_rms = 0.0\nfaint_rms = 0.0",
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
        // Of ink and grain, ink is on top; a grain that does not show changes no bit.
        let still = Some(GrainSpec { seed: 7, ..GrainSpec::default() });
        assert_eq!(
            printed(&SensorOptics { grain: still.clone(), ..sensor.clone() }).as_ref(),
            Some(&texture)
        );
        let grain = Some(GrainSpec { rms: 0.05, size_mm: 0.1, ..GrainSpec::default() });
        let grainy = printed(&SensorOptics { grain: grain.clone(), ..sensor.clone() }).unwrap();
        let mut spread = [0.0, 0.0];
        for (plain, grainy) in texture.texels.iter().zip(&grainy.texels) {
            for (k, albedo) in [0.1, 0.6].into_iter().enumerate() {
                if (plain.x - albedo).abs() < 1e-6 {
                    spread[k] += f64::from(grainy.x / albedo - 1.0).powi(2) / texture.texels.len() as f64;
                }
            }
        }
        assert!(spread[0] < 1e-12 && (spread[1].sqrt() / 0.05 - 0.93).abs() < 0.1, "{spread:?}");
        sensor.markers = None;
        assert!(printed(&sensor).is_none());
        sensor.grain = still;
        assert!(printed(&sensor).is_none());
        sensor.grain = grain;
        let bare = printed(&sensor).unwrap();
        assert!((bare.mean().x - 0.6).abs() < 1e-3, "{}", bare.mean());
        assert!(toml::from_str::<GrainSpec>("rms = 0.01\nsize = 3").is_err());
        assert!(toml::from_str::<MarkerSpec>("pitch_mm = 2.0\ndiameter_mm = 0.8\ncolour = 3").is_err());
        assert!(
            toml::from_str::<MarkerSpec>("pitch_mm = 2.0\ndiameter_mm = 0.8\nplace_rms_mm = 0.1").is_err()
        );
    }
}
