//! What the sensor's camera would see of a deformed pad.

use crate::elastomer::{ElastomerCapture, Pad, Surface};
use crate::image::RgbImage;
use crate::optics::imaging;
use crate::optics::reference::{self, Renderer};
use crate::optics::sensor::{SensorOptics, TextureMode};
use crate::optics::sensor_scene::{face, scene, texture_coordinate};
use crate::optics::surface::DisplacedSurface;
use crate::optics::{Error, Film, Texture};
use std::time::{Duration, Instant};

/// The camera's side of a twin.
#[derive(Debug, Clone)]
pub struct View {
    /// The sensor.
    pub sensor: SensorOptics,
    /// How pictures are made.
    pub settings: reference::Settings,
}

/// What the pad wears: the picture of the untouched sensor, and how it relates to the untouched simulation.
#[derive(Debug, Clone)]
pub struct Wear {
    /// The untouched image as linear light.
    texture: Option<Texture>,
    /// The untouched simulation (texture mode `ratio`).
    untouched: Option<Film>,
    /// Factor from radiance to the scale of code values.
    exposure: f32,
}

/// A simulated capture, as the camera would give it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// 8-bit RGB, row 0 on top.
    pub rgb: Vec<u8>,
    /// Pad-frame height of the face, mm, on the same grid.
    pub depth_mm: Vec<f32>,
    /// Bounding box of the contact: x0, y0, x1, y1 (exclusive), pixels.
    pub contact_box_px: Option<[u32; 4]>,
    /// Time it took.
    pub took: Duration,
}

/// Exposure where neither the sensor file nor an untouched image says anything.
const EXPOSURE_WITHOUT_IMAGE: f32 = 0.35;

impl View {
    /// Gets ready to wear an untouched image.
    ///
    /// # Errors
    /// When the image has another size than the sensor's camera, or the sensor cannot be rendered.
    pub fn wear(&self, untouched: Option<&RgbImage>, pad: &Pad) -> Result<Wear, Error> {
        let camera = &self.sensor.camera;
        if let Some(image) = untouched
            && (image.width as usize, image.height as usize) != (camera.width_px, camera.height_px)
        {
            return Err(Error::Setting {
                key: "camera",
                value: format!("{} x {}", camera.width_px, camera.height_px),
                why: format!(
                    "the untouched image is {} x {}; give the sensor file and the rig's [camera] the same size",
                    image.width, image.height
                ),
            });
        }
        let texture = untouched.map(|image| {
            let linear = image.rgb.iter().map(|code| imaging::decode(*code, &self.sensor.image));
            Texture::from_linear(image.width as usize, image.height as usize, linear)
        });
        let flat = DisplacedSurface::flat(2, 2, [pad.size_x_mm, pad.size_y_mm]);
        let film = self.render(&flat, texture.as_ref())?;
        let exposure = match (self.sensor.image.exposure, &texture) {
            (Some(exposure), _) => exposure as f32,
            (None, Some(texture)) => texture.mean().element_sum() / film.mean().element_sum().max(1e-12),
            (None, None) => EXPOSURE_WITHOUT_IMAGE,
        };
        let is_ratio = self.sensor.texture == TextureMode::Ratio && texture.is_some();
        Ok(Wear { texture, untouched: is_ratio.then_some(film), exposure })
    }

    /// The picture of a deformed pad.
    ///
    /// # Errors
    /// When the face cannot be rendered.
    pub fn picture(&self, pad: &ElastomerCapture, wear: &Wear, capture: u32) -> Result<Picture, Error> {
        let begun = Instant::now();
        let surface = displaced(&pad.surface);
        let film = self.render(&surface, wear.texture.as_ref())?;
        let image = &self.sensor.image;
        let rgb = match (&wear.untouched, &wear.texture) {
            (Some(untouched), Some(texture)) => {
                imaging::develop(&relit(&film, untouched, texture), image, capture)
            }
            _ => imaging::expose(&film, image, wear.exposure, capture),
        };
        let depth_mm = crate::optics::depth::depth_map(&surface, &crate::optics::sensor_scene::camera_of(&self.sensor));
        let (width, height) = (film.width as u32, film.height as u32);
        let contact_box_px = self.contact_box(pad, width, height);
        Ok(Picture { width, height, rgb, depth_mm, contact_box_px, took: begun.elapsed() })
    }

    fn render(&self, surface: &DisplacedSurface, texture: Option<&Texture>) -> Result<Film, Error> {
        let scene = scene(&self.sensor, &face(&self.sensor, surface), texture)?;
        Ok(Renderer::new(&scene)?.render(&self.settings))
    }

    /// Name of the optics mode, for the record.
    pub fn mode_name(&self) -> &'static str {
        "reference"
    }

    /// Samples per pixel, where that is what was chosen.
    pub fn samples(&self) -> Option<u32> {
        Some(self.settings.samples)
    }

    /// Where the contact is in the picture, with a margin: what happens around a contact belongs to it.
    fn contact_box(&self, pad: &ElastomerCapture, width: u32, height: u32) -> Option<[u32; 4]> {
        let surface = &pad.surface;
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for (k, position) in surface.positions.iter().enumerate() {
            if pad.contact[k] {
                let uv = texture_coordinate(&self.sensor, position.x, position.y);
                for (axis, value) in uv.to_array().into_iter().enumerate() {
                    low[axis] = low[axis].min(value);
                    high[axis] = high[axis].max(value);
                }
            }
        }
        let margin = (CONTACT_MARGIN_MM / self.sensor.camera.mm_per_px) as f32;
        let pixel = |uv: f32, size: u32, shift: f32| (uv * size as f32 + shift).clamp(0.0, size as f32) as u32;
        let (x0, y0) = (pixel(low[0], width, -margin), pixel(low[1], height, -margin));
        let (x1, y1) = (pixel(high[0], width, margin), pixel(high[1], height, margin));
        (x0 < x1 && y0 < y1 && low[0].is_finite()).then_some([x0, y0, x1, y1])
    }
}

/// A contact shades its surroundings about this far (found by experiment on presses of a millimetre).
const CONTACT_MARGIN_MM: f64 = 0.7;

/// The elastomer's surface in the optics' words.
fn displaced(surface: &Surface) -> DisplacedSurface {
    DisplacedSurface {
        nx: surface.nx,
        ny: surface.ny,
        size_mm: [surface.size_x_mm, surface.size_y_mm],
        positions: surface.positions.clone(),
        rest_z: Vec::new(),
    }
}

/// The untouched image times the ratio of deformed to untouched light.
fn relit(film: &Film, untouched: &Film, texture: &Texture) -> Film {
    let mut lit = film.clone();
    for (k, p) in lit.pixels.iter_mut().enumerate() {
        let ratio = *p / untouched.pixels[k].max(glam::Vec3::splat(1e-6));
        *p = texture.texel(k % film.width, k / film.width) * ratio;
    }
    lit
}
