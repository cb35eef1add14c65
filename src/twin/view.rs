//! What the sensor's camera would see of a deformed pad.

use super::contact_mask::contact_mask;
use crate::elastomer::{ElastomerCapture, Pad, PadShape};
use crate::image::{self, Mask};
use crate::optics::Error;
use crate::optics::basis_folder::Contents;
use crate::optics::imager::{Background, Imager, Method, Notice};
use crate::optics::judge::Judged;
use crate::optics::sensor::SensorOptics;
use crate::optics::store::Store;
use crate::optics::surface::DisplacedSurface;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The camera's side of a twin.
#[derive(Debug, Clone)]
pub struct View {
    /// The sensor.
    pub sensor: SensorOptics,
    /// How pictures are made.
    pub method: Method,
    /// Where the fast mode keeps what it prepares, if anywhere.
    pub store: Option<Store>,
    /// The sensor untouched, worn where no other picture of it is given.
    pub untouched: Option<image::Picture>,
}

/// The sensor with its pad wearing a picture of itself untouched (or nothing).
#[derive(Debug, Clone)]
pub struct Wear {
    imager: Imager,
    shape: PadShape,
    told: Arc<Told>,
}

/// What was said of a picture: once is enough.
#[derive(Debug, Default)]
struct Told {
    above_tolerance: AtomicBool,
    fell_back: AtomicBool,
}

/// A simulated capture, as the camera would give it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// 8-bit RGB, row 0 on top.
    pub image: image::Picture,
    /// Pad-frame height of the face, mm, on the same grid.
    pub depth_mm: Vec<f32>,
    /// Where the face touches the indenter, on the same grid.
    pub contact: Mask,
    /// Bounding box of the contact with a margin: x0, y0, x1, y1 (exclusive), pixels.
    pub contact_box_px: Option<[u32; 4]>,
    /// One picture a light, where [asked for](Wear::light_by_light). An untouched image that is worn is not in them: it brings
    /// its own light.
    pub basis: Option<Contents>,
    /// relRMSE to expect of its light, of the reference mode its noise.
    pub estimated_error: Option<f64>,
    /// Whether that is within the tolerance asked for; None where none was.
    pub meets_tolerance: Option<bool>,
    /// How its light was truly rendered, for the record: after a fall back that is not what was asked for.
    pub method: Method,
    /// Set when the error is above what was asked for, or the picture was left to the reference mode.
    pub notice: Option<Notice>,
    /// Time it took.
    pub took: Duration,
}

impl Wear {
    /// What holds for all pictures, such as a fall back to the reference mode.
    pub fn notices(&self) -> &[Notice] {
        self.imager.notices()
    }

    /// From now on each picture is made of one a light, which it brings along.
    pub fn light_by_light(mut self) -> Self {
        self.imager = self.imager.light_by_light();
        self
    }

    /// Warns of the first picture of its kind, and notes the others.
    fn tell(&self, capture: u32, notice: &Notice) {
        let (told, others) = match notice {
            Notice::AboveTolerance { .. } => (
                &self.told.above_tolerance,
                "Others may be above it, too: light_error and light_meets_tolerance are kept of each",
            ),
            // (What holds for all pictures is told once, of none of them.)
            Notice::Dark
            | Notice::BackgroundClipped { .. }
            | Notice::BeyondWork { .. }
            | Notice::FellBack { .. }
            | Notice::PictureFellBack { .. } => {
                (&self.told.fell_back, "Others may be, too: optics_mode and spp are kept of each")
            }
        };
        if told.swap(true, Ordering::Relaxed) {
            tracing::info!("capture {capture}: {notice}");
        } else {
            tracing::warn!("capture {capture}: {notice}. {others}");
        }
    }
}

impl View {
    /// Gets ready to wear an untouched image, or the sensor file's where none is given.
    ///
    /// # Errors
    /// When the image has another size than the sensor's camera, or the sensor cannot be rendered.
    pub fn wear(&self, untouched: Option<&image::Picture>, pad: &Pad) -> Result<Wear, Error> {
        let camera = &self.sensor.camera;
        let untouched = untouched.or(self.untouched.as_ref());
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
        let background = untouched.map(|image| Background {
            width: image.width as usize,
            height: image.height as usize,
            rgb: &image.rgb,
        });
        let (rest, store) = (untouched_face(pad), self.store.as_ref());
        let imager = Imager::with_store(&self.sensor, self.method, background, &rest, store)?;
        imager.notices().iter().for_each(|notice| tracing::warn!("{notice}"));
        Ok(Wear { imager, shape: pad.shape, told: Arc::default() })
    }

    /// The picture of a deformed pad; `capture` numbers it, so that each has its own noise.
    ///
    /// # Errors
    /// When the face cannot be rendered.
    pub fn picture(&self, pad: &ElastomerCapture, wear: &Wear, capture: u32) -> Result<Picture, Error> {
        let begun = Instant::now();
        let seen = wear.imager.picture(&displaced(pad, wear.shape), capture)?;
        let camera = &self.sensor.camera;
        let (width, height) = (camera.width_px as u32, camera.height_px as u32);
        let image = image::Picture { width, height, rgb: seen.rgb };
        let contact = contact_mask(&self.sensor, pad);
        let contact_box_px = self.contact_box(&contact);
        if let Some(notice) = &seen.notice {
            wear.tell(capture, notice);
        }
        Ok(Picture {
            image,
            depth_mm: seen.depth_mm,
            contact,
            contact_box_px,
            basis: seen.basis,
            estimated_error: seen.estimated_error,
            meets_tolerance: seen.meets_tolerance,
            method: seen.method,
            notice: seen.notice,
            took: begun.elapsed(),
        })
    }

    /// How far the light of that picture is from two of the reference mode, of so many samples a pixel each.
    ///
    /// # Errors
    /// As [`View::picture`].
    pub fn judged(&self, pad: &ElastomerCapture, wear: &Wear, samples: u32) -> Result<Judged, Error> {
        wear.imager.judged(&displaced(pad, wear.shape), samples)
    }

    /// Where the contact is in the picture, with a margin: what happens around a contact belongs to it.
    fn contact_box(&self, contact: &Mask) -> Option<[u32; 4]> {
        let (width, height) = (contact.width, contact.height);
        let inside = contact.inside.iter().enumerate().filter(|(_, inside)| **inside);
        let pixels = inside.map(|(k, _)| (k as u32 % width, k as u32 / width));
        let bounds = pixels.fold(None, |bounds: Option<[u32; 4]>, (x, y)| match bounds {
            None => Some([x, y, x + 1, y + 1]),
            Some([x0, y0, x1, y1]) => Some([x0.min(x), y0.min(y), x1.max(x + 1), y1.max(y + 1)]),
        });
        let margin = (CONTACT_MARGIN_MM / self.sensor.camera.mm_per_px).ceil() as u32;
        bounds.map(|[x0, y0, x1, y1]| {
            let (right, low) = ((x1 + margin).min(width), (y1 + margin).min(height));
            [x0.saturating_sub(margin), y0.saturating_sub(margin), right, low]
        })
    }
}

/// A contact shades its surroundings about this far (found by experiment on presses of a millimetre).
const CONTACT_MARGIN_MM: f64 = 0.7;

/// Points of the untouched face of a pad that is not flat.
const REST_LATTICE: [usize; 2] = [201, 201];

/// The face of a pad that nothing touches, in the optics' words.
pub fn untouched_face(pad: &Pad) -> DisplacedSurface {
    let [nx, ny] = if pad.shape == PadShape::Cuboid { [2, 2] } else { REST_LATTICE };
    let size = [pad.size_x_mm, pad.size_y_mm];
    DisplacedSurface::resting(nx, ny, size, |x, y| pad.shape.face_height_mm(size, [x, y]))
}

/// The elastomer's surface in the optics' words.
pub(super) fn displaced(pad: &ElastomerCapture, shape: PadShape) -> DisplacedSurface {
    let surface = &pad.surface;
    let size_mm = [surface.size_x_mm, surface.size_y_mm];
    let rest_z = match shape {
        PadShape::Cuboid => Vec::new(),
        _ => {
            let height = |x: f64, y: f64| shape.face_height_mm(size_mm, [x, y]);
            DisplacedSurface::resting(surface.nx, surface.ny, size_mm, height).rest_z
        }
    };
    DisplacedSurface { nx: surface.nx, ny: surface.ny, size_mm, positions: pad.drawn(), rest_z }
}
