//! The camera's picture of linear light in a sensor file.

use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// What the camera makes of linear light. Every effect is optional. In texture mode `ratio` the untouched image has
/// been through all of them: its response is undone and done again, what changes of the light is blurred, and the rest stays
/// as it is in the image, its noise brighter or darker with the light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSpec {
    /// Factor on radiance; absent: chosen so that the untouched picture has the mean of the untouched image,
    /// or 0.35 without one.
    pub exposure: Option<f64>,
    /// Exponent of the response curve (code = value^(1/gamma)); absent: the sRGB curve.
    pub gamma: Option<f64>,
    /// Relative loss of light in the corners, growing with the square of the distance to the centre.
    pub vignetting: f64,
    /// Standard deviation of a Gaussian blur, pixels.
    pub blur_px: f64,
    /// Electrons at full scale, for shot noise; absent: none.
    pub full_well_electrons: Option<f64>,
    /// Standard deviation of read noise, code values of 255 before the response curve.
    pub read_noise: f64,
    /// Seed of shot and read noise; the index of the picture is mixed in.
    pub noise_seed: u32,
}

impl Default for ImageSpec {
    fn default() -> Self {
        Self {
            exposure: None,
            gamma: None,
            vignetting: 0.0,
            blur_px: 0.0,
            full_well_electrons: None,
            read_noise: 0.0,
            noise_seed: 0,
        }
    }
}

impl ImageSpec {
    pub(super) fn check(&self, p: &mut Problems) {
        if let Some(exposure) = self.exposure {
            p.range("exposure", exposure, 1e-6, 1e6, "");
        }
        if let Some(gamma) = self.gamma {
            p.range("gamma", gamma, 0.2, 5.0, "");
        }
        p.range("vignetting", self.vignetting, 0.0, 1.0, "");
        p.range("blur_px", self.blur_px, 0.0, 20.0, "px");
        p.range("read_noise", self.read_noise, 0.0, 64.0, "code values");
        if let Some(electrons) = self.full_well_electrons {
            p.range("full_well_electrons", electrons, 10.0, 1e7, "electrons");
        }
    }
}
