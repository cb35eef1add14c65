//! A sensor's optics as data: the `[optics]` table of a file in `rig_configs/sensors/`.
//!
//! Positions are in the pad frame, mm: x right and y down in the picture, z away from the camera, so
//! everything inside the sensor has negative z. What the table describes is built by
//! [`scene`](super::sensor_scene::scene); what is wrong with it is told by [`SensorOptics::check`].

use crate::problem::Problems;
use serde::{Deserialize, Serialize};

/// Everything about a sensor that light meets, its pad's shape excepted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorOptics {
    /// The camera.
    pub camera: CameraSpec,
    /// Walls and ceiling.
    pub housing: Option<HousingSpec>,
    /// A clear plate between pad and camera.
    pub plate: Option<PlateSpec>,
    /// Lights, at least one.
    pub lights: Vec<LightSpec>,
    /// The pad's coating.
    #[serde(default)]
    pub coating: CoatingSpec,
    /// Dots printed on the coating. With an image of the untouched sensor they are in that.
    #[serde(default)]
    pub markers: Option<MarkerSpec>,
    /// How the image of the untouched sensor is used.
    #[serde(default)]
    pub texture: TextureMode,
    /// The mesh the face becomes.
    #[serde(default)]
    pub mesh: MeshSpec,
    /// From linear light to code values.
    #[serde(default)]
    pub image: ImageSpec,
    /// Most scattering events between camera and light.
    #[serde(default = "default_events")]
    pub max_events: u32,
}

fn default_events() -> u32 {
    8
}

/// A camera that looks straight at the pad, its picture upright.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Columns of the picture.
    pub width_px: usize,
    /// Rows of the picture.
    pub height_px: usize,
    /// What a pixel sees of the undeformed face, mm.
    pub mm_per_px: f64,
    /// From the optical centre to the undeformed face, mm.
    pub distance_mm: f64,
    /// Where the optical axis meets the face, mm.
    #[serde(default)]
    pub center_mm: [f64; 2],
    /// Radial distortion coefficients k1, k2 (Brown; in units of the focal length).
    #[serde(default)]
    pub distortion: Option<[f64; 2]>,
    /// Radius of the aperture for depth of field, mm (focused on the undeformed face); 0 is a pinhole.
    #[serde(default)]
    pub aperture_radius_mm: f64,
}

/// A box around the pad's face, open towards the pad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HousingSpec {
    /// Inner extent in x, mm.
    pub x_mm: [f64; 2],
    /// Inner extent in y, mm.
    pub y_mm: [f64; 2],
    /// From the undeformed face to the ceiling, mm.
    pub height_mm: f64,
    /// How far the walls reach past the undeformed face, mm (a pressed pad bulges).
    #[serde(default = "default_skirt")]
    pub skirt_mm: f64,
    /// Diffuse reflectance of walls and ceiling.
    pub albedo: f64,
}

fn default_skirt() -> f64 {
    0.5
}

/// A clear plate with flat faces, parallel to the undeformed face; it fills the housing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlateSpec {
    /// From the undeformed face to the nearer side of the plate, mm (above the deepest press).
    pub gap_mm: f64,
    /// Thickness, mm.
    pub thickness_mm: f64,
    /// Index of refraction (acrylic 1.49).
    pub ior: f64,
}

/// One light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightSpec {
    /// Name in reports.
    pub name: String,
    /// Luminous surface.
    pub shape: LightShapeSpec,
    /// Colour, 0 to 255 a channel, taken as linear (the paper's table).
    pub rgb: [f64; 3],
    /// Energy in the units of the paper's table; radiance = rgb/255 energy/100, whatever the light's area.
    pub energy: f64,
    /// Angular profile: radiance falls as cos^k; 0 is Lambertian.
    #[serde(default)]
    pub cosine_power: f64,
    /// Diffuse reflectance of the light's own patch.
    #[serde(default = "default_patch_albedo")]
    pub albedo: f64,
}

fn default_patch_albedo() -> f64 {
    0.5
}

/// The highest energy of a light.
pub const MOST_ENERGY: f64 = 1e6;

/// What rgb times energy is divided by: white (255) of energy 100 has radiance 1.
pub const RGB_ENERGY_OF_ONE: f64 = 25_500.0;

/// The luminous surface of a light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum LightShapeSpec {
    /// A rectangle or strip.
    Rectangle {
        /// Centre, mm.
        center_mm: [f64; 3],
        /// Direction in which it shines.
        facing: [f64; 3],
        /// Length at right angles to z, and the other edge, mm.
        size_mm: [f64; 2],
    },
    /// A disc.
    Disc {
        /// Centre, mm.
        center_mm: [f64; 3],
        /// Direction in which it shines.
        facing: [f64; 3],
        /// Radius, mm.
        radius_mm: f64,
    },
    /// A tube that shines all around.
    Tube {
        /// One end of the axis, mm.
        from_mm: [f64; 3],
        /// The other end, mm.
        to_mm: [f64; 3],
        /// Radius, mm.
        radius_mm: f64,
    },
    /// Triangles that shine where their normals point.
    Mesh {
        /// Corners, mm.
        vertices_mm: Vec<[f64; 3]>,
        /// Three corners each by number from 0, counterclockwise seen from where they shine.
        triangles: Vec<[u32; 3]>,
    },
}

/// The coating of the pad's face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoatingSpec {
    /// Diffuse reflectance where no texture says otherwise.
    pub albedo: f64,
    /// 1 is fully diffuse (the paper's choice); below, metal flakes show: their GGX alpha is the
    /// roughness squared and they cover `1 - roughness` of the area.
    pub roughness: f64,
}

impl Default for CoatingSpec {
    fn default() -> Self {
        Self { albedo: 0.5, roughness: 1.0 }
    }
}

/// Dots in rows and columns on the pad's face, printed on its coating.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerSpec {
    /// From dot to dot, mm (on the plane through the apex of a curved face, as the camera sees it).
    pub pitch_mm: f64,
    /// Of a dot, mm.
    pub diameter_mm: f64,
    /// Diffuse reflectance of the ink.
    #[serde(default = "default_ink")]
    pub albedo: f64,
    /// Where one of the dots is, pad frame, mm.
    #[serde(default)]
    pub offset_mm: [f64; 2],
}

fn default_ink() -> f64 {
    0.05
}

/// How the image of the untouched sensor becomes part of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TextureMode {
    /// The coating alone.
    None,
    /// The paper's way: the image is the albedo, and is lit again.
    Lit,
    /// The image times the ratio of deformed to untouched light: the untouched simulation is the untouched image.
    #[default]
    Ratio,
}

/// The mesh of the pad's face.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MeshSpec {
    /// Vertices along x and y; [0, 0] takes the camera's raster (the paper's choice).
    pub vertices: [usize; 2],
    /// Standard deviation of seeded noise on the heights, mm (the paper uses 1e-4, we need none).
    pub depth_noise_mm: f64,
    /// Seed of that noise.
    pub depth_noise_seed: u32,
}

impl Default for MeshSpec {
    fn default() -> Self {
        Self { vertices: [0, 0], depth_noise_mm: 0.0, depth_noise_seed: 0 }
    }
}

/// What the camera makes of linear light. Every effect is optional. In texture mode `ratio` the untouched image has
/// been through all of them: its response is undone and done again, and the rest stays as it is in the image, its noise
/// brighter or darker with the light.
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

impl SensorOptics {
    /// Vertices of the face's mesh along x and y.
    pub fn mesh_vertices(&self) -> [usize; 2] {
        match self.mesh.vertices {
            [0, 0] => [self.camera.width_px, self.camera.height_px],
            other => other,
        }
    }

    /// What the camera sees of the undeformed face, mm.
    pub fn view_mm(&self) -> [f64; 2] {
        let c = &self.camera;
        [c.width_px as f64 * c.mm_per_px, c.height_px as f64 * c.mm_per_px]
    }

    /// Reports everything that is wrong.
    pub fn check(&self, problems: &mut Problems) {
        let c = &self.camera;
        problems.within("camera", |p| {
            p.range("width_px", c.width_px as f64, 8.0, 8192.0, "px");
            p.range("height_px", c.height_px as f64, 8.0, 8192.0, "px");
            p.range("mm_per_px", c.mm_per_px, 1e-4, 1.0, "mm");
            p.range("distance_mm", c.distance_mm, 0.5, 500.0, "mm");
            p.range("aperture_radius_mm", c.aperture_radius_mm, 0.0, 10.0, "mm");
            for (axis, value) in c.center_mm.iter().enumerate() {
                p.range(&format!("center_mm[{axis}]"), *value, -100.0, 100.0, "mm");
            }
            for (k, value) in c.distortion.iter().flatten().enumerate() {
                p.range(&format!("distortion[{k}]"), *value, -0.5, 0.5, "");
            }
        });
        if let Some(h) = &self.housing {
            problems.within("housing", |p| h.check(c, self.view_mm(), p));
        }
        if let Some(plate) = &self.plate {
            problems.within("plate", |p| {
                p.range("gap_mm", plate.gap_mm, 0.1, 100.0, "mm");
                p.range("thickness_mm", plate.thickness_mm, 0.05, 100.0, "mm");
                p.range("ior", plate.ior, 1.0, 4.0, "");
                let top = plate.gap_mm + plate.thickness_mm;
                if top >= c.distance_mm {
                    p.push(
                        "thickness_mm",
                        plate.thickness_mm,
                        format!(
                            "the plate ends {top} mm above the face, below the camera at {} mm",
                            c.distance_mm
                        ),
                        "make the plate thinner or move the camera away",
                    );
                }
            });
        }
        if self.lights.is_empty() {
            problems.push("lights", "[]", "at least one light", "add a [[optics.lights]] table");
        }
        for (k, light) in self.lights.iter().enumerate() {
            problems.within(format!("lights.[{k}]"), |p| {
                let is_taken = self.lights[..k].iter().any(|other| other.name == light.name);
                if light.name.is_empty() || is_taken {
                    p.push(
                        "name",
                        format!("{:?}", light.name),
                        "a name that no other light has",
                        "give each light a name of its own, e.g. \"left\": pictures and records are told apart by it",
                    );
                }
                light.check(self.housing.as_ref(), p);
            });
        }
        problems.within("coating", |p| {
            p.range("albedo", self.coating.albedo, 0.0, 0.99, "");
            p.range("roughness", self.coating.roughness, 0.05, 1.0, "");
        });
        if let Some(markers) = &self.markers {
            problems.within("markers", |p| markers.check(p));
        }
        problems.within("mesh", |p| {
            let bad = |n: usize| !(2..=8192).contains(&n);
            if self.mesh.vertices != [0, 0] && self.mesh.vertices.into_iter().any(bad) {
                let value = format!("{:?}", self.mesh.vertices);
                p.push("vertices", value, "2 to 8192 each, or [0, 0]", "use [0, 0] for the camera's raster");
            }
            p.range("depth_noise_mm", self.mesh.depth_noise_mm, 0.0, 0.1, "mm");
        });
        problems.within("image", |p| self.image.check(p));
        problems.range("max_events", f64::from(self.max_events), 1.0, 64.0, "");
    }
}

impl HousingSpec {
    fn check(&self, camera: &CameraSpec, view_mm: [f64; 2], p: &mut Problems) {
        p.range("albedo", self.albedo, 0.0, 0.95, "");
        p.range("height_mm", self.height_mm, 0.5, 500.0, "mm");
        p.range("skirt_mm", self.skirt_mm, 0.0, 10.0, "mm");
        for (axis, (key, extent)) in [("x_mm", self.x_mm), ("y_mm", self.y_mm)].into_iter().enumerate() {
            let half = view_mm[axis] / 2.0;
            let (low, high) = (camera.center_mm[axis] - half, camera.center_mm[axis] + half);
            if !(extent[0] <= low && extent[1] >= high) {
                p.push(
                    key,
                    format!("{extent:?}"),
                    format!("walls outside the view, which is {low} to {high} mm"),
                    "move the walls out, or lower camera.mm_per_px",
                );
            }
        }
        if camera.distance_mm >= self.height_mm {
            p.push(
                "height_mm",
                self.height_mm,
                format!("above the camera, which is {} mm from the face", camera.distance_mm),
                "raise the ceiling: the camera stands inside the box",
            );
        }
    }
}

impl LightSpec {
    fn check_within(&self, housing: &HousingSpec, p: &mut Problems) {
        let places = match &self.shape {
            LightShapeSpec::Rectangle { center_mm, .. } | LightShapeSpec::Disc { center_mm, .. } => {
                vec![("shape.center_mm", center_mm)]
            }
            LightShapeSpec::Tube { from_mm, to_mm, .. } => {
                vec![("shape.from_mm", from_mm), ("shape.to_mm", to_mm)]
            }
            LightShapeSpec::Mesh { vertices_mm, .. } => {
                vertices_mm.iter().map(|v| ("shape.vertices_mm", v)).collect()
            }
        };
        let walls = [housing.x_mm, housing.y_mm, [-housing.height_mm, f64::INFINITY]];
        for (key, at) in places {
            if at.iter().zip(walls).any(|(v, [low, high])| *v < low || *v > high) {
                p.push(
                    key,
                    format!("{at:?}"),
                    format!(
                        "within the walls: x in {:?}, y in {:?}, z from {} mm",
                        housing.x_mm, housing.y_mm, -housing.height_mm
                    ),
                    "move the light in, or optics.housing out: walls hide what is behind them",
                );
            }
        }
    }

    fn check(&self, housing: Option<&HousingSpec>, p: &mut Problems) {
        for (channel, value) in self.rgb.iter().enumerate() {
            p.range(&format!("rgb[{channel}]"), *value, 0.0, 255.0, "");
        }
        if let Some(h) = housing {
            self.check_within(h, p);
        }
        p.range("energy", self.energy, 0.0, MOST_ENERGY, "");
        p.range("cosine_power", self.cosine_power, 0.0, 200.0, "");
        p.range("albedo", self.albedo, 0.0, 0.95, "");
        let point = |p: &mut Problems, key: &str, at: &[f64; 3]| {
            if !at.iter().all(|v| v.is_finite()) || at[2] >= 0.0 {
                p.push(
                    key,
                    format!("{at:?}"),
                    "finite, z below 0 (inside the sensor)",
                    "z points away from the camera: give lights a negative z",
                );
            }
        };
        let direction = |p: &mut Problems, facing: &[f64; 3]| {
            let length = facing.iter().map(|v| v * v).sum::<f64>().sqrt();
            if !(length.is_finite() && length > 1e-6) {
                p.push(
                    "shape.facing",
                    format!("{facing:?}"),
                    "a direction",
                    "e.g. [1.0, 0.0, 0.0] for the left wall",
                );
            }
        };
        match &self.shape {
            LightShapeSpec::Rectangle { center_mm, facing, size_mm } => {
                point(p, "shape.center_mm", center_mm);
                direction(p, facing);
                for (k, value) in size_mm.iter().enumerate() {
                    p.range(&format!("shape.size_mm[{k}]"), *value, 1e-3, 200.0, "mm");
                }
            }
            LightShapeSpec::Disc { center_mm, facing, radius_mm } => {
                point(p, "shape.center_mm", center_mm);
                direction(p, facing);
                p.range("shape.radius_mm", *radius_mm, 1e-3, 100.0, "mm");
            }
            LightShapeSpec::Tube { from_mm, to_mm, radius_mm } => {
                point(p, "shape.from_mm", from_mm);
                point(p, "shape.to_mm", to_mm);
                let length = from_mm.iter().zip(to_mm).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                if length < LEAST_TUBE_MM {
                    p.push(
                        "shape.to_mm",
                        format!("{to_mm:?}"),
                        format!("{LEAST_TUBE_MM} mm or more from shape.from_mm"),
                        "give both ends of the tube's axis",
                    );
                }
                p.range("shape.radius_mm", *radius_mm, 1e-3, 100.0, "mm");
            }
            LightShapeSpec::Mesh { vertices_mm, triangles } => {
                vertices_mm.iter().for_each(|v| point(p, "shape.vertices_mm", v));
                let beyond = |t: &&[u32; 3]| t.iter().any(|k| *k as usize >= vertices_mm.len());
                if let Some(triangle) = triangles.iter().find(beyond) {
                    p.push(
                        "shape.triangles",
                        format!("{triangle:?}"),
                        format!("numbers of the {} corners, from 0", vertices_mm.len()),
                        "count the corners of shape.vertices_mm from 0",
                    );
                }
                if triangles.is_empty() {
                    p.push("shape.triangles", "[]", "at least one triangle", "e.g. [[0, 1, 2]]");
                } else if !triangles.iter().any(|t| beyond(&t)) {
                    let area: f64 = triangles.iter().map(|t| area(t.map(|k| vertices_mm[k as usize]))).sum();
                    if area < LEAST_MESH_MM2 {
                        p.push(
                            "shape.triangles",
                            format!("{area} mm^2 in all"),
                            format!("{LEAST_MESH_MM2} mm^2 or more"),
                            "give triangles whose corners do not lie on a line",
                        );
                    }
                }
            }
        }
    }
}

/// The shortest tube, mm.
const LEAST_TUBE_MM: f64 = 1e-3;
/// The smallest light of triangles, mm^2.
const LEAST_MESH_MM2: f64 = 1e-6;

fn area([a, b, c]: [[f64; 3]; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(glam::DVec3::from_array);
    (b - a).cross(c - a).length() / 2.0
}

impl MarkerSpec {
    fn check(&self, p: &mut Problems) {
        p.range("pitch_mm", self.pitch_mm, 0.1, 50.0, "mm");
        p.range("diameter_mm", self.diameter_mm, 0.02, self.pitch_mm.max(0.02), "mm, up to the pitch");
        p.range("albedo", self.albedo, 0.0, 0.99, "");
        for (axis, value) in self.offset_mm.iter().enumerate() {
            p.range(&format!("offset_mm[{axis}]"), *value, -100.0, 100.0, "mm");
        }
    }
}

impl ImageSpec {
    fn check(&self, p: &mut Problems) {
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
