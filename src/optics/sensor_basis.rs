//! What the pictures of a sensor, one a light, need to be held against a photograph and to say what stands in its file.
//!
//! A camera's exposure, vignetting and blur are linear: they are done to the simulated light, so that a photograph needs its
//! response undone alone, and weighs as it was taken. The noise of a photograph evens out over its pixels.

use super::sensor::{ImageSpec, RGB_ENERGY_OF_ONE, SensorOptics};
use super::{Film, LightBasis, imaging, response};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// How a sensor's camera forms pictures of its light, and how its file writes lights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorCamera {
    /// Without noise; its exposure is given.
    pub image: ImageSpec,
    /// Whether the sensor's file gives that exposure; else it was chosen.
    pub file_gives_exposure: bool,
    /// Energies of the lights in the file, in its order.
    pub energies: Vec<f64>,
}

/// A light in the words of a sensor's file.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Written {
    /// The strongest channel is 255.
    pub rgb: [f64; 3],
    /// What is left of the radiance.
    pub energy: f64,
}

impl SensorCamera {
    /// The camera of a sensor on the raster of a picture of it untouched. `image_mean` is the mean of a photograph of that,
    /// linear, if there is one.
    pub fn new(sensor: &SensorOptics, untouched: &Film, image_mean: Option<f32>) -> Self {
        let exposure = imaging::exposure(&sensor.image, untouched, image_mean);
        Self::exposed(sensor, exposure, untouched.width)
    }

    /// The camera of a sensor with a factor on radiance, on a raster of so many columns.
    pub fn exposed(sensor: &SensorOptics, exposure: f32, columns: usize) -> Self {
        let image = ImageSpec {
            exposure: Some(f64::from(exposure)),
            // On another raster the same lens blurs as many millimetres.
            blur_px: sensor.image.blur_px * columns as f64 / sensor.camera.width_px as f64,
            full_well_electrons: None,
            read_noise: 0.0,
            ..sensor.image.clone()
        };
        Self {
            image,
            file_gives_exposure: sensor.image.exposure.is_some(),
            energies: sensor.lights.iter().map(|light| light.energy).collect(),
        }
    }

    /// The factor on radiance.
    pub fn exposure(&self) -> f64 {
        self.image.exposure.unwrap_or(1.0)
    }

    /// The same, rounded to what is worth writing.
    pub fn written_exposure(&self) -> f64 {
        to_five_digits(self.exposure())
    }

    /// The picture of light as code values.
    pub fn picture(&self, light: &Film) -> Vec<u8> {
        response::encode(&self.arriving(light), &self.image)
    }

    /// The light that made these code values, as it arrived on the chip, and by pixel whether it tells how bright that was:
    /// one at the end of the scale does not, and a black one may be no picture of the pad.
    pub fn undone(&self, width: usize, height: usize, rgb: &[u8]) -> (Film, Vec<bool>) {
        let light = |code: u8| response::decode(code, &self.image);
        let pixels = rgb.chunks_exact(3).map(|p| Vec3::new(light(p[0]), light(p[1]), light(p[2]))).collect();
        let tells = rgb.chunks_exact(3).map(|p| !p.contains(&u8::MAX) && p.iter().any(|code| *code > 0));
        (Film { width, height, pixels }, tells.collect())
    }

    /// What arrives on the chip of each light.
    pub fn basis_on_chip(&self, basis: &LightBasis) -> LightBasis {
        let films = basis.films.iter().map(|film| self.arriving(film)).collect();
        LightBasis { names: basis.names.clone(), films }
    }

    fn arriving(&self, light: &Film) -> Film {
        imaging::arriving(light, &self.image, self.exposure() as f32)
    }

    /// A radiance of the light `k`, rounded to what is worth writing; a dark light keeps its energy.
    pub fn written(&self, k: usize, radiance: Vec3) -> Written {
        let radiance = radiance.to_array().map(f64::from);
        let most = radiance.into_iter().fold(0.0, f64::max);
        if most <= 0.0 {
            let energy = self.energies.get(k).copied().unwrap_or(0.0);
            return Written { rgb: [0.0; 3], energy };
        }
        let rgb = radiance.map(|v| (100.0 * 255.0 * v / most).round() / 100.0);
        Written { rgb, energy: to_five_digits(most * RGB_ENERGY_OF_ONE / 255.0) }
    }
}

fn to_five_digits(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}
