//! The indenter file: which solid, how large, how round.
//!
//! Lengths are mm in the indenter's own frame (tip at z = 0, body towards +z, x and y as the pad's at
//! zero rotation). `edge_round_mm` takes convex edges off inwards: faces stay where they are.

mod polygon;

use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One file of `rig_configs/indenters/`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IndenterSpec {
    /// What it is, for people.
    #[serde(default)]
    pub description: String,
    /// Radius of convex edges unless the plan says otherwise, mm.
    #[serde(default)]
    pub edge_round_mm: f64,
    /// Height of the body above the tip, mm. No base plate is modelled.
    #[serde(default = "default_height_mm")]
    pub height_mm: f64,
    /// The solid.
    pub shape: Shape,
}

fn default_height_mm() -> f64 {
    8.0
}

/// The solids a file can name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// Part of a sphere, with upright walls where it reaches `diameter_mm`.
    Dome {
        /// Radius of the sphere.
        radius_mm: f64,
        /// Diameter of the body; twice the radius makes a full hemisphere.
        diameter_mm: f64,
    },
    /// Equal domes on a circle, the first towards +x.
    Domes {
        /// Radius of each sphere.
        radius_mm: f64,
        /// How many.
        count: u32,
        /// Radius of the circle their centres lie on.
        centre_radius_mm: f64,
    },
    /// A truncated cone.
    Cone {
        /// Diameter of the flat tip.
        tip_diameter_mm: f64,
        /// Angle between wall and axis.
        half_angle_deg: f64,
    },
    /// A ring of circular section.
    Torus {
        /// Radius of the section.
        tube_radius_mm: f64,
        /// Radius of the circle of section centres.
        centre_radius_mm: f64,
    },
    /// A cylinder lying along y.
    LyingCylinder {
        /// Radius.
        radius_mm: f64,
        /// Length along y.
        length_mm: f64,
    },
    /// Asymmetric ridges along y with rounded crests.
    Wave {
        /// Distance between crests along x.
        pitch_mm: f64,
        /// Number of crests.
        count: u32,
        /// Depth of the valleys below the sharp crests, before rounding.
        depth_mm: f64,
        /// Fraction of the pitch that the steeper flank takes.
        steep_fraction: f64,
        /// Radius of the crests (`edge_round_mm` replaces it where that is larger).
        crest_radius_mm: f64,
        /// Length along y.
        length_mm: f64,
    },
    /// A flat face of any plan.
    Flat {
        /// Its plan.
        plan: Plan,
    },
    /// A flat face with a hemispherical cavity at its centre.
    Socket {
        /// Plan of the face.
        plan: Plan,
        /// Radius of the cavity.
        cavity_radius_mm: f64,
    },
    /// Ridges along y standing on the same ridges along x.
    CrossedRidges {
        /// Number of ridges in each layer.
        count: u32,
        /// Width of each.
        width_mm: f64,
        /// Length of each.
        length_mm: f64,
        /// Distance between centre lines.
        pitch_mm: f64,
        /// Height of the lower (touching) layer.
        ridge_height_mm: f64,
    },
    /// A watertight mesh from a file.
    Stl {
        /// The file; relative to this one.
        path: PathBuf,
        /// Unit of its coordinates (STL does not say).
        unit: LengthUnit,
        /// Which end of the mesh's z axis touches the pad.
        #[serde(default)]
        tip: TipEnd,
        /// What becomes x = y = 0.
        #[serde(default)]
        centre: Centre,
    },
}

/// A plan of a flat face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Plan {
    /// A disc.
    Disc {
        /// Diameter.
        diameter_mm: f64,
    },
    /// A disc with a concentric hole.
    Ring {
        /// Outer diameter.
        outer_diameter_mm: f64,
        /// Inner diameter.
        inner_diameter_mm: f64,
    },
    /// A rectangle.
    Rectangle {
        /// Extent along x.
        x_mm: f64,
        /// Extent along y.
        y_mm: f64,
    },
    /// A regular polygon with a corner towards +x.
    Regular {
        /// Number of corners.
        corners: u32,
        /// Diameter of the circle through the corners.
        across_corners_mm: f64,
    },
    /// Any simple polygon.
    Polygon {
        /// Corners in order.
        corners_mm: Vec<[f64; 2]>,
    },
    /// A disc bitten by another disc, the horns towards +x; centred on its bounding box.
    Crescent {
        /// Diameter of the disc.
        outer_diameter_mm: f64,
        /// Diameter of the bite.
        cut_diameter_mm: f64,
        /// Distance from the centre of the disc to the centre of the bite.
        cut_offset_mm: f64,
    },
    /// A disc with a wedge removed from its centre towards +x.
    Pacman {
        /// Diameter.
        diameter_mm: f64,
        /// Angle of the wedge.
        mouth_deg: f64,
    },
    /// Equal ridges along y, side by side.
    Stripes {
        /// How many.
        count: u32,
        /// Width of each.
        width_mm: f64,
        /// Length along y.
        length_mm: f64,
        /// Distance between centre lines.
        pitch_mm: f64,
    },
}

/// Unit of an STL file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthUnit {
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
    /// Metres.
    #[serde(rename = "m")]
    Metre,
    /// Inches.
    #[serde(rename = "inch")]
    Inch,
}

impl LengthUnit {
    /// As the file writes it.
    pub fn name(self) -> &'static str {
        match self {
            LengthUnit::Millimetre => "mm",
            LengthUnit::Metre => "m",
            LengthUnit::Inch => "inch",
        }
    }

    /// Millimetres in one of these.
    pub fn in_mm(self) -> f64 {
        match self {
            LengthUnit::Millimetre => 1.0,
            LengthUnit::Metre => 1000.0,
            LengthUnit::Inch => 25.4,
        }
    }
}

/// The touching end of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum TipEnd {
    /// The highest point, as for features modelled on top of a base; the mesh is turned over about x.
    #[default]
    #[serde(rename = "+z")]
    PlusZ,
    /// The lowest point.
    #[serde(rename = "-z")]
    MinusZ,
}

/// What becomes the axis of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Centre {
    /// The middle of its bounding box.
    #[default]
    Bounds,
    /// Its own origin.
    Origin,
}

impl IndenterSpec {
    /// Makes a relative STL path relative to `folder` (that of the indenter file).
    pub fn resolve(&mut self, folder: &Path) {
        if let Shape::Stl { path, .. } = &mut self.shape
            && path.is_relative()
        {
            *path = folder.join(&*path);
        }
    }

    /// Reports every number that makes no sense.
    pub fn check(&self, problems: &mut Problems) {
        problems.range("edge_round_mm", self.edge_round_mm, 0.0, 5.0, "mm");
        problems.range("height_mm", self.height_mm, 0.5, 100.0, "mm");
        problems.within("shape", |p| self.shape.check(p, self.height_mm));
    }
}

/// Checks one length of a feature.
fn length(p: &mut Problems, key: &str, value: f64) {
    p.range(key, value, 0.01, 50.0, "mm");
}

fn less(p: &mut Problems, key: &str, value: f64, limit_key: &str, limit: f64) {
    if value >= limit {
        p.push(
            key,
            value,
            format!("less than {limit_key} = {limit}"),
            format!("lower {key} or raise {limit_key}"),
        );
    }
}

impl Shape {
    fn check(&self, p: &mut Problems, height_mm: f64) {
        match self {
            Shape::Dome { radius_mm, diameter_mm } => {
                p.range("radius_mm", *radius_mm, 0.01, 1000.0, "mm");
                p.range("diameter_mm", *diameter_mm, 0.01, 2.0 * radius_mm, "mm");
                let half = diameter_mm / 2.0;
                let cap = radius_mm - (radius_mm * radius_mm - half * half).max(0.0).sqrt();
                less(p, "diameter_mm (cap height)", cap, "height_mm", height_mm);
            }
            Shape::Domes { radius_mm, count, centre_radius_mm } => {
                length(p, "radius_mm", *radius_mm);
                p.range("count", f64::from(*count), 1.0, 100.0, "");
                p.range("centre_radius_mm", *centre_radius_mm, 0.0, 50.0, "mm");
                less(p, "radius_mm", *radius_mm, "height_mm", height_mm);
            }
            Shape::Cone { tip_diameter_mm, half_angle_deg } => {
                length(p, "tip_diameter_mm", *tip_diameter_mm);
                p.range("half_angle_deg", *half_angle_deg, 0.0, 80.0, "degrees");
            }
            Shape::Torus { tube_radius_mm, centre_radius_mm } => {
                length(p, "tube_radius_mm", *tube_radius_mm);
                length(p, "centre_radius_mm", *centre_radius_mm);
                less(p, "tube_radius_mm", *tube_radius_mm, "centre_radius_mm", *centre_radius_mm);
            }
            Shape::LyingCylinder { radius_mm, length_mm } => {
                length(p, "radius_mm", *radius_mm);
                length(p, "length_mm", *length_mm);
            }
            Shape::Wave { pitch_mm, count, depth_mm, steep_fraction, crest_radius_mm, length_mm } => {
                length(p, "pitch_mm", *pitch_mm);
                p.range("count", f64::from(*count), 1.0, 100.0, "");
                length(p, "depth_mm", *depth_mm);
                p.range("steep_fraction", *steep_fraction, 0.05, 0.95, "");
                p.range("crest_radius_mm", *crest_radius_mm, 0.0, 50.0, "mm");
                length(p, "length_mm", *length_mm);
                less(p, "depth_mm", *depth_mm, "height_mm", height_mm);
            }
            Shape::Flat { plan } => p.within("plan", |p| plan.check(p)),
            Shape::Socket { plan, cavity_radius_mm } => {
                p.within("plan", |p| plan.check(p));
                length(p, "cavity_radius_mm", *cavity_radius_mm);
                less(p, "cavity_radius_mm", *cavity_radius_mm, "height_mm", height_mm);
            }
            Shape::CrossedRidges { count, width_mm, length_mm, pitch_mm, ridge_height_mm } => {
                check_stripes(p, *count, *width_mm, *length_mm, *pitch_mm);
                length(p, "ridge_height_mm", *ridge_height_mm);
                less(p, "ridge_height_mm", *ridge_height_mm, "height_mm", height_mm);
            }
            Shape::Stl { path, .. } => {
                if path.as_os_str().is_empty() {
                    p.push(
                        "path",
                        "\"\"",
                        "the path of an STL file",
                        "name the file, relative to the indenter file",
                    );
                }
            }
        }
    }
}

fn check_stripes(p: &mut Problems, count: u32, width_mm: f64, length_mm: f64, pitch_mm: f64) {
    p.range("count", f64::from(count), 1.0, 100.0, "");
    length(p, "width_mm", width_mm);
    length(p, "length_mm", length_mm);
    length(p, "pitch_mm", pitch_mm);
    less(p, "width_mm", width_mm, "pitch_mm", pitch_mm);
}

impl Plan {
    fn check(&self, p: &mut Problems) {
        match self {
            Plan::Disc { diameter_mm } => length(p, "diameter_mm", *diameter_mm),
            Plan::Ring { outer_diameter_mm, inner_diameter_mm } => {
                length(p, "outer_diameter_mm", *outer_diameter_mm);
                length(p, "inner_diameter_mm", *inner_diameter_mm);
                less(p, "inner_diameter_mm", *inner_diameter_mm, "outer_diameter_mm", *outer_diameter_mm);
            }
            Plan::Rectangle { x_mm, y_mm } => {
                length(p, "x_mm", *x_mm);
                length(p, "y_mm", *y_mm);
            }
            Plan::Regular { corners, across_corners_mm } => {
                p.range("corners", f64::from(*corners), 3.0, 360.0, "");
                length(p, "across_corners_mm", *across_corners_mm);
            }
            Plan::Polygon { corners_mm } => polygon::check(p, corners_mm),
            Plan::Crescent { outer_diameter_mm, cut_diameter_mm, cut_offset_mm } => {
                length(p, "outer_diameter_mm", *outer_diameter_mm);
                length(p, "cut_diameter_mm", *cut_diameter_mm);
                let (outer, cut) = (outer_diameter_mm / 2.0, cut_diameter_mm / 2.0);
                let (low, high) = ((outer - cut).abs() + 0.01, outer + cut - 0.01);
                p.range("cut_offset_mm", *cut_offset_mm, low, high, "mm (so that the two circles cross)");
            }
            Plan::Pacman { diameter_mm, mouth_deg } => {
                length(p, "diameter_mm", *diameter_mm);
                p.range("mouth_deg", *mouth_deg, 1.0, 350.0, "degrees");
            }
            Plan::Stripes { count, width_mm, length_mm, pitch_mm } => {
                check_stripes(p, *count, *width_mm, *length_mm, *pitch_mm);
            }
        }
    }
}
