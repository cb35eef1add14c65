//! A sensor's optics as data: the `[optics]` table of a file in `rig_configs/sensors/`.
//!
//! Positions are in the pad frame, mm: x right and y down in the picture, z away from the camera, so
//! everything inside the sensor has negative z. What the table describes is built by
//! [`scene`](super::sensor_scene::scene); what is wrong with its tables by themselves is told by [`SensorOptics::check`].

mod baffle;
mod camera;
mod coating;
mod housing;
mod image;
mod lens;
mod light;
mod mesh;
mod place;

pub use baffle::{BaffleShapeSpec, BaffleSpec};
pub use camera::CameraSpec;
pub use coating::{CoatingSpec, GrainSpec, MarkerSpec, TextureMode};
pub use housing::{HousingSpec, PlateSpec};
pub use image::ImageSpec;
pub use lens::{LensFace, LensSpec};
pub use light::{LightShapeSpec, LightSpec, MOST_ENERGY, RGB_ENERGY_OF_ONE};
pub use mesh::MeshSpec;

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
    /// A clear lens or dome between pad and camera.
    #[serde(default)]
    pub lens: Option<LensSpec>,
    /// Opaque sheets and blocks inside.
    #[serde(default)]
    pub baffles: Vec<BaffleSpec>,
    /// Lights, at least one.
    pub lights: Vec<LightSpec>,
    /// The pad's coating.
    #[serde(default)]
    pub coating: CoatingSpec,
    /// Dots printed on the coating. With an image of the untouched sensor they are in that.
    #[serde(default)]
    pub markers: Option<MarkerSpec>,
    /// Grain and specks of the coating. With an image of the untouched sensor they are in that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grain: Option<GrainSpec>,
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

impl SensorOptics {
    /// Vertices along x and y of the mesh of a face of this extent, mm.
    pub fn mesh_vertices(&self, size_mm: [f64; 2]) -> [usize; 2] {
        self.mesh.vertices_of(size_mm, &self.camera)
    }

    /// What the camera sees of the undeformed face, mm.
    pub fn view_mm(&self) -> [f64; 2] {
        self.camera.view_mm()
    }

    /// Reports everything that is wrong.
    pub fn check(&self, problems: &mut Problems) {
        let (camera, housing, plate) = (&self.camera, self.housing.as_ref(), self.plate.as_ref());
        problems.within("camera", |p| camera.check(p));
        if let Some(housing) = housing {
            problems.within("housing", |p| housing.check(camera, p));
        }
        if let Some(plate) = plate {
            problems.within("plate", |p| plate.check(camera, p));
        }
        if let Some(lens) = &self.lens {
            problems.within("lens", |p| lens.check(camera, plate, p));
        }
        self.check_baffles(problems);
        self.check_lights(problems);
        problems.within("coating", |p| self.coating.check(p));
        self.check_metal_film(problems);
        if let Some(markers) = &self.markers {
            problems.within("markers", |p| markers.check(p));
        }
        if let Some(grain) = &self.grain {
            problems.within("grain", |p| grain.check(p));
        }
        problems.within("mesh", |p| self.mesh.check(p));
        problems.within("image", |p| self.image.check(p));
        problems.range("max_events", f64::from(self.max_events), 1.0, 64.0, "");
    }

    /// What is printed, or pictured, is on the coat's binder.
    fn check_metal_film(&self, problems: &mut Problems) {
        let worn = [
            ("markers", self.markers.is_some()),
            ("grain", self.grain.as_ref().is_some_and(GrainSpec::shows)),
            ("texture = \"lit\"", self.texture == TextureMode::Lit),
        ];
        // (What follows from the roughness is less than 1 wherever that is one.)
        if self.coating.flakes != Some(1.0) {
            return;
        }
        for (key, _) in worn.into_iter().filter(|(_, is_there)| *is_there) {
            problems.push(
                "coating.flakes",
                self.coating.cover(),
                format!("below 1 with {key}, which shows on what flakes leave free"),
                format!("use fewer flakes, e.g. 0.9, or leave out {key}"),
            );
        }
    }

    /// The housing, where it has an inside that things can be in.
    fn walls(&self) -> Option<&HousingSpec> {
        self.housing.as_ref().filter(|housing| housing.has_inside())
    }

    fn check_baffles(&self, problems: &mut Problems) {
        for (k, baffle) in self.baffles.iter().enumerate() {
            problems.within(format!("baffles.[{k}]"), |p| {
                let is_taken = self.baffles[..k].iter().any(|other| other.name == baffle.name);
                if baffle.name.is_empty() || is_taken {
                    p.push(
                        "name",
                        format!("{:?}", baffle.name),
                        "a name that no other baffle has",
                        "give each baffle a name of its own, e.g. \"left hood\": messages tell it by that",
                    );
                }
                baffle.check(self.walls(), self.plate.as_ref(), p);
            });
        }
    }

    fn check_lights(&self, problems: &mut Problems) {
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
                light.check(self.walls(), p);
            });
        }
        if self.lights.is_empty() {
            problems.push("lights", "[]", "at least one light", "add a [[optics.lights]] table");
        } else if !self.lights.iter().any(LightSpec::shines) {
            problems.push(
                "lights",
                "all dark, of energy 0 or rgb [0, 0, 0]",
                "at least one light that shines: without any every picture is black",
                "give a light an energy and an rgb above 0",
            );
        }
    }
}
