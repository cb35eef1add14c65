//! What every level is made of, and whether it can be solved.

use super::chart::Chart;
use super::level::Level;
use super::resolution::Resolution;
use crate::elastomer::{Coating, Error, Friction, Material, Pad, PadShape, Settings, pose_can_be_reached};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Shortest radius of a dome or a cylinder over the distance of its axis from the pad's furthest place: beyond, the
/// face is too steep for a grid that is laid over it.
const STEEPEST: f64 = 1.03;
/// Thickest pad over the radius of its face.
const THICKEST: f64 = 0.8;
/// Largest rounding over the thickness: something is left below it.
const ROUNDEST: f64 = 0.9;

/// A pad as overridden by settings.
#[derive(Debug, Clone)]
pub struct Body {
    /// Outline.
    pub shape: PadShape,
    /// Extent in x and y, and thickness, mm.
    pub size_mm: [f64; 3],
    /// Bulk.
    pub material: Material,
    /// Skin of another stiffness.
    pub coating: Option<Coating>,
    /// Friction of the face.
    pub friction: Friction,
}

impl Body {
    /// The body of a pad.
    pub fn new(pad: &Pad, settings: &Settings) -> Self {
        let mut material = pad.material;
        material.law = settings.law.unwrap_or(material.law);
        material.youngs_modulus_mpa = settings.youngs_modulus_mpa.unwrap_or(material.youngs_modulus_mpa);
        material.poisson_ratio = settings.poisson_ratio.unwrap_or(material.poisson_ratio);
        let size_mm = [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm];
        Self { shape: pad.shape, size_mm, material, coating: pad.coating, friction: settings.friction }
    }

    /// It at rest, at one resolution.
    pub fn level(&self, resolution: &Resolution, at: Pose, guesses: bool) -> Level {
        Level::new(self, resolution, at, guesses)
    }

    /// Refuses a pose that no indenter can be brought to.
    ///
    /// # Errors
    /// [`Error::Pose`] for one too far away, or in the backing; [`Error::Low`] for one in which the indenter is all in the pad.
    pub fn reaches(&self, indenter: &dyn Indenter, pose: &Pose) -> Result<(), Error> {
        let face_mm = Chart::new(self.shape, self.size_mm).map_or(0.0, |c| c.height_mm(pose.x_mm, pose.y_mm));
        pose_can_be_reached(indenter, pose, face_mm, self.size_mm[2])
    }
}

/// Whether a pad can be solved as the settings say.
pub fn check(pad: &Pad, settings: &Settings) -> Result<(), Error> {
    let range = |key, value: f64, min: f64, max: f64, unit: &str| {
        if value.is_finite() && value >= min && value <= max {
            Ok(())
        } else {
            Err(Error::Setting {
                key,
                value: value.to_string(),
                why: format!("choose a value from {min} to {max}{unit}"),
            })
        }
    };
    let m = &pad.material;
    let youngs_modulus_mpa = settings.youngs_modulus_mpa.unwrap_or(m.youngs_modulus_mpa);
    range("youngs_modulus_mpa", youngs_modulus_mpa, 1e-4, 1e4, " MPa")?;
    range("poisson_ratio", settings.poisson_ratio.unwrap_or(m.poisson_ratio), 0.0, 0.499, "")?;
    range("tolerance", settings.tolerance, 5e-4, 0.1, "")?;
    range("size_x_mm", pad.size_x_mm, 1.0, 200.0, " mm")?;
    range("size_y_mm", pad.size_y_mm, 1.0, 200.0, " mm")?;
    range("thickness_mm", pad.thickness_mm, 0.1, 50.0, " mm")?;
    if let Friction::Coefficient(mu) = settings.friction {
        range("friction", mu, 0.0, 10.0, "")?;
    }
    let furthest = match pad.shape {
        PadShape::Cylinder { .. } => pad.size_x_mm / 2.0,
        _ => pad.size_x_mm.hypot(pad.size_y_mm) / 2.0,
    };
    match pad.shape {
        PadShape::Cuboid => {}
        PadShape::Rounded { radius_mm } => {
            let most = ROUNDEST * pad.thickness_mm.min(pad.size_x_mm / 2.0).min(pad.size_y_mm / 2.0);
            range(
                "shape.radius_mm",
                radius_mm,
                1e-3,
                most,
                " mm: something must be left below the rounding",
            )?;
        }
        PadShape::Dome { radius_mm } | PadShape::Cylinder { radius_mm } => {
            let least = (STEEPEST * furthest).max(pad.thickness_mm / THICKEST);
            let why = " mm: the face may not be upright at the pad's sides, nor the pad thicker than its radius allows";
            range("shape.radius_mm", radius_mm, least, 1e4, why)?;
        }
    }
    if let Some(coating) = &pad.coating {
        range("coating.thickness_mm", coating.thickness_mm, 1e-3, pad.thickness_mm / 2.0, " mm")?;
        range("coating.youngs_modulus_mpa", coating.youngs_modulus_mpa, 1e-4, 1e4, " MPa")?;
        range("coating.poisson_ratio", coating.poisson_ratio, 0.0, 0.499, "")?;
    }
    Ok(())
}
