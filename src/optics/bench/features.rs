//! What each feature of a sensor costs: a picture of it with the feature against one without, two presses in turns so that no
//! picture is one that is there already.

use super::{Clock, Effect};
use crate::optics::imager::{Background, FALLBACK_SAMPLES, Imager, Method};
use crate::optics::sensor::{GrainSpec, ImageSpec, MarkerSpec, SensorOptics, TextureMode};
use crate::optics::{DisplacedSurface, Error, reference};
use std::cell::Cell;

type Change = fn(&mut SensorOptics);

/// What the fast mode does itself.
const FAST: [(&str, Change); 8] = [
    ("printed markers", |s| s.markers = Some(dots())),
    ("grain and specks of the coat", |s| s.grain = Some(grain())),
    ("lights with an angular profile (cosine power 2)", |s| {
        s.lights.iter_mut().for_each(|light| light.cosine_power = 2.0);
    }),
    ("lens distortion", |s| s.camera.distortion = Some([-0.1, 0.01])),
    ("vignetting", |s| s.image.vignetting = 0.15),
    ("a response curve (gamma 2.2)", |s| s.image.gamma = Some(2.2)),
    ("blur of 0.9 pixels", |s| s.image.blur_px = 0.9),
    ("shot and read noise", |s| {
        (s.image.full_well_electrons, s.image.read_noise) = (Some(11_000.0), 0.5);
    }),
];

/// What is left to the reference mode.
const LEFT: [(&str, Change); 3] = [
    ("a glossy coat", |s| s.coating.roughness = 0.5),
    ("an aperture", |s| s.camera.aperture_radius_mm = 0.2),
    ("a light that shines on both sides", |s| s.lights[0].two_sided = true),
];

fn dots() -> MarkerSpec {
    MarkerSpec {
        pitch_mm: 1.5,
        diameter_mm: 0.5,
        albedo: 0.05,
        offset_mm: [0.0; 2],
        place_rms: 0.02,
        size_rms: 0.03,
        faint_rms: 0.04,
        seed: 0,
    }
}

fn grain() -> GrainSpec {
    GrainSpec { rms: 0.0025, specks_per_mm2: 0.6, speck_mm: 0.25, ..GrainSpec::default() }
}

/// A sensor, three presses of it or more, and how good a picture has to be.
pub struct Seen<'a> {
    /// The sensor.
    pub sensor: &'a SensorOptics,
    /// Faces of its pad.
    pub faces: &'a [DisplacedSurface],
    /// Columns and rows.
    pub size: [usize; 2],
    /// relRMSE asked for.
    pub tolerance: f64,
}

impl Seen<'_> {
    /// Costs of features, the features of the sensor itself left out where they are not the one in question.
    ///
    /// # Errors
    /// When the sensor cannot be rendered.
    pub fn effects(&self, cpu: &dyn Fn() -> f64, repeat: u32) -> Result<Vec<Effect>, Error> {
        let clock = Clock { cpu, repeat: repeat.max(1) };
        let bare = self.bare(1);
        let plain = self.imager(&bare, None)?;
        let without = self.looking_at(&plain);
        let mut effects = Vec::new();
        for (what, change) in FAST {
            let imager = self.imager(&changed(&bare, change), None)?;
            effects.push(clock.compare(what, &without, self.looking_at(&imager), |_, _| None)?);
        }
        let rest = self.faces[0].at_rest();
        let [width, height] = self.size;
        let image = plain.picture(&rest, 0)?.rgb;
        for (what, texture) in [
            ("an image of the untouched sensor, relit by ratio", TextureMode::Ratio),
            ("the same, lit again as the coat's albedo", TextureMode::Lit),
        ] {
            let worn = SensorOptics { texture, ..bare.clone() };
            let imager = self.imager(&worn, Some(Background { width, height, rgb: &image }))?;
            effects.push(clock.compare(what, &without, self.looking_at(&imager), |_, _| None)?);
        }
        let every = self.imager(&bare, None)?;
        effects.push(clock.compare(
            &format!("a picture at each of {} steps of a press, one of which is captured", self.faces.len()),
            &without,
            || self.faces.iter().try_for_each(|face| every.picture(face, 0).map(drop)),
            |(), ()| None,
        )?);
        // The reference mode takes long: half as many columns and rows, once.
        let (clock, bare) = (Clock { repeat: 1, ..clock }, self.bare(2));
        let plain = self.imager(&bare, None)?;
        for (what, change) in LEFT {
            let imager = self.imager(&changed(&bare, change), None)?;
            let what =
                format!("{what}, left to the reference mode (half the raster, {FALLBACK_SAMPLES} samples)");
            effects.push(clock.compare(
                &what,
                self.looking_at(&plain),
                self.looking_at(&imager),
                |_, _| None,
            )?);
        }
        Ok(effects)
    }

    /// The sensor without what can be left out, and with so many times larger pixels.
    fn bare(&self, coarser: usize) -> SensorOptics {
        let mut bare = self.sensor.clone();
        let camera = &mut bare.camera;
        let size = self.size.map(|n| (n / coarser).max(1));
        camera.mm_per_px *= camera.width_px as f64 / size[0] as f64;
        [camera.width_px, camera.height_px] = size;
        camera.distortion = None;
        bare.image = ImageSpec::default();
        (bare.markers, bare.grain, bare.texture) = (None, None, TextureMode::None);
        bare
    }

    fn imager(&self, sensor: &SensorOptics, image: Option<Background<'_>>) -> Result<Imager, Error> {
        let fallback = reference::Settings { samples: FALLBACK_SAMPLES, seed: 0 };
        Imager::new(
            sensor,
            Method::Fast { tolerance: self.tolerance, fallback },
            image,
            &self.faces[0].at_rest(),
        )
    }

    /// The next of the first two presses with each call.
    fn looking_at(&self, imager: &Imager) -> impl Fn() -> Result<(), Error> {
        let turn = Cell::new(0);
        move || {
            turn.set(turn.get() + 1);
            imager.picture(&self.faces[turn.get() % 2], 0).map(drop)
        }
    }
}

fn changed(sensor: &SensorOptics, change: Change) -> SensorOptics {
    let mut sensor = sensor.clone();
    change(&mut sensor);
    sensor
}
