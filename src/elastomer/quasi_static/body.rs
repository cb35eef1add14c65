//! What every level is made of, and whether it can be solved.

use super::chart::Chart;
use super::level::Level;
use super::resolution::Resolution;
use crate::elastomer::{
    Coating, Error, Friction, Material, Pad, PadShape, Settings, Skip, pose_can_be_reached,
};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Shortest radius of a dome or a cylinder over the distance of its axis from the pad's furthest place: beyond, the
/// face is too steep for a grid that is laid over it.
const STEEPEST: f64 = 1.03;
/// Thickest pad over the radius of its face.
const THICKEST: f64 = 0.8;
/// Largest rounding over the thickness: something is left below it.
const ROUNDEST: f64 = 0.9;

/// Stiffest coating over the bulk, and softest under it, of which there is hope. Found by experiment: a sphere and a flat
/// punch pressed 0.5 mm find their equilibria up to a hundred times either way, but the punch on the thinnest skins; at
/// a thousand times hardly anything does, and it takes a quarter of a minute to find out.
const MOST_CONTRAST: f64 = 300.0;
/// The same contrast from which it is named as what may stand in the way.
const DOUBTFUL_CONTRAST: f64 = 20.0;

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
    /// Whether what touches without friction has anchors all the same.
    pub anchored: bool,
    /// Whether the face is looked at where the indenter is clear of it, before the first touch.
    pub looked_at: bool,
}

impl Body {
    /// The body of a pad.
    pub fn new(pad: &Pad, settings: &Settings) -> Self {
        let mut material = pad.material;
        material.law = settings.law.unwrap_or(material.law);
        material.youngs_modulus_mpa = settings.youngs_modulus_of(pad).1;
        material.poisson_ratio = settings.poisson_ratio_of(pad).1;
        let size_mm = [pad.size_x_mm, pad.size_y_mm, pad.thickness_mm];
        Self {
            shape: pad.shape,
            size_mm,
            material,
            coating: pad.coating,
            friction: settings.friction,
            anchored: !settings.skips(Skip::Frictionless),
            looked_at: !settings.skips(Skip::FirstTouch),
        }
    }

    /// It at rest, at one resolution.
    pub fn level(&self, resolution: &Resolution, at: Pose, guesses: bool) -> Level {
        Level::new(self, resolution, at, guesses)
    }

    /// What in the pad itself may keep an equilibrium from being found.
    pub fn doubt(&self) -> Option<String> {
        let coating = self.coating.as_ref()?;
        let times = coating.youngs_modulus_mpa / self.material.youngs_modulus_mpa;
        (times.ln().abs() > DOUBTFUL_CONTRAST.ln()).then(|| {
            format!(
                "the coating is {times:.3} times as stiff as the pad below it: bring pad.coating.youngs_modulus_mpa nearer"
            )
        })
    }

    /// How much the pad is of one stuff, by Young's moduli alone: the lesser of coating and bulk over the other; 1 without a coating.
    pub fn evenness(&self) -> f64 {
        let Some(coating) = &self.coating else { return 1.0 };
        let times = coating.youngs_modulus_mpa / self.material.youngs_modulus_mpa;
        times.min(1.0 / times)
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
    let range = |key, value: f64, [min, max]: [f64; 2], unit: &str, next: &str| {
        if value.is_finite() && value >= min && value <= max {
            Ok(())
        } else {
            Err(Error::Setting {
                key,
                value: value.to_string(),
                allowed: format!("{min} to {max}{unit}"),
                next: next.to_owned(),
            })
        }
    };
    let within = |key, value, span, unit| range(key, value, span, unit, "choose a value in that range");
    let (key, youngs_modulus_mpa) = settings.youngs_modulus_of(pad);
    within(key, youngs_modulus_mpa, [1e-4, 1e4], " MPa")?;
    let (key, poisson_ratio) = settings.poisson_ratio_of(pad);
    within(key, poisson_ratio, [0.0, 0.499], "")?;
    within("elastomer.tolerance", settings.tolerance, [5e-4, 0.1], "")?;
    within("pad.size_x_mm", pad.size_x_mm, [1.0, 200.0], " mm")?;
    within("pad.size_y_mm", pad.size_y_mm, [1.0, 200.0], " mm")?;
    within("pad.thickness_mm", pad.thickness_mm, [0.1, 50.0], " mm")?;
    if let Friction::Coefficient(mu) = settings.friction {
        let next = "set elastomer.friction = \"infinite\" for a face that sticks, or choose a coefficient in that range";
        range("elastomer.friction", mu, [0.0, Friction::MOST], "", next)?;
    }
    let furthest = match pad.shape {
        PadShape::Cylinder { .. } => pad.size_x_mm / 2.0,
        _ => pad.size_x_mm.hypot(pad.size_y_mm) / 2.0,
    };
    match pad.shape {
        PadShape::Cuboid => {}
        PadShape::Rounded { radius_mm } => {
            let most = ROUNDEST * pad.thickness_mm.min(pad.size_x_mm / 2.0).min(pad.size_y_mm / 2.0);
            let next = "choose a smaller radius: something must be left below the rounding";
            range("pad.shape.radius_mm", radius_mm, [1e-3, most], " mm", next)?;
        }
        PadShape::Dome { radius_mm } | PadShape::Cylinder { radius_mm } => {
            let least = (STEEPEST * furthest).max(pad.thickness_mm / THICKEST);
            let next = "choose a larger radius, or a smaller or thinner pad: the face may not be upright at the pad's sides";
            range("pad.shape.radius_mm", radius_mm, [least, 1e4], " mm", next)?;
        }
    }
    if let Some(coating) = &pad.coating {
        within("pad.coating.thickness_mm", coating.thickness_mm, [1e-3, pad.thickness_mm / 2.0], " mm")?;
        let span = [youngs_modulus_mpa / MOST_CONTRAST, youngs_modulus_mpa * MOST_CONTRAST];
        let next = format!("choose one nearer to the {youngs_modulus_mpa} MPa of the pad below it");
        range("pad.coating.youngs_modulus_mpa", coating.youngs_modulus_mpa, span, " MPa", &next)?;
        within("pad.coating.poisson_ratio", coating.poisson_ratio, [0.0, 0.499], "")?;
    }
    Ok(())
}
