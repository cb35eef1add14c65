//! A scene: surfaces, lights, a camera, and how often light may scatter.

use super::{Camera, Error, Light, LightShape, Material, Mesh};
use std::sync::Arc;

/// What a surface is to the sensor. The fast renderer treats the pad and plates on their own;
/// the reference renderer makes no difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// The coated face of the elastomer, the only thing that moves between frames.
    Pad,
    /// Walls, ceiling, baffles.
    Housing,
    /// A clear body with flat faces between pad and camera (a closed cuboid).
    Plate,
    /// Anything else.
    Other,
}

/// A mesh of one material.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Name in messages.
    pub name: String,
    /// What it is to the sensor.
    pub role: Role,
    /// Its geometry.
    pub mesh: Arc<Mesh>,
    /// What it is made of.
    pub material: Material,
}

/// Everything a renderer needs, in the scene frame (z towards the camera, mm).
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// What reflects and refracts, lights' own patches excepted.
    pub surfaces: Vec<Surface>,
    /// What shines.
    pub lights: Vec<Light>,
    /// Who looks.
    pub camera: Camera,
    /// Most surface scattering events between camera and light (a passage of one face of a plate is one).
    pub max_events: u32,
}

/// Most events that light is followed over.
const MOST_EVENTS: u32 = 1000;
/// Tangent of half of the widest field of view, 179 degrees.
const WIDEST: f32 = 114.59;

impl Scene {
    /// The first surface with the role, if there is one.
    pub fn surface(&self, role: Role) -> Option<&Surface> {
        self.surfaces.iter().find(|s| s.role == role)
    }

    /// Whether every part can be rendered.
    ///
    /// # Errors
    /// Names the first part that cannot, and what to do.
    pub fn check(&self) -> Result<(), Error> {
        let fault = |part: &str, what: String, next: &str| {
            Err(Error::Scene { part: part.to_owned(), what, next: next.to_owned() })
        };
        for surface in &self.surfaces {
            surface.mesh.check(&surface.name)?;
            if let Some((what, next)) = surface.material.fault() {
                return fault(&surface.name, what, next);
            }
        }
        for light in &self.lights {
            if let LightShape::Mesh(mesh) = &light.shape {
                mesh.check(&light.name)?;
            }
            if let Some(what) = light.shape.fault() {
                return fault(
                    &light.name,
                    what,
                    "give it a finite extent above 0, edges at right angles, unit directions",
                );
            }
            if self.lights.iter().filter(|l| l.name == light.name).count() > 1 {
                return fault(
                    &light.name,
                    "several lights have this name".to_owned(),
                    "give each a name of its own",
                );
            }
            if !(light.radiance.is_finite() && light.radiance.min_element() >= 0.0) {
                return fault(
                    &light.name,
                    format!("its radiance is {}", light.radiance),
                    "use finite values of 0 or more",
                );
            }
            if !(light.albedo.min_element() >= 0.0 && light.albedo.max_element() < 1.0) {
                return fault(&light.name, format!("its albedo is {}", light.albedo), "use 0 to below 1");
            }
        }
        let heights = |role: Role| {
            let all = self.surfaces.iter().filter(move |s| s.role == role).flat_map(|s| &s.mesh.positions);
            all.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], p| [low.min(p.z), high.max(p.z)])
        };
        let ([_, pad], [plate, _]) = (heights(Role::Pad), heights(Role::Plate));
        if pad >= plate {
            return fault(
                "the pad",
                format!("it reaches up to z = {pad} mm, into the plate that begins at {plate} mm"),
                "press less deep, or give the plate a larger gap",
            );
        }
        let white = |s: &Surface| matches!(s.material, Material::Lambert { albedo: super::Albedo::Constant(a) } if a.max_element() >= 1.0);
        let solid = |s: &&Surface| s.role != Role::Plate;
        if self.surface(Role::Housing).is_some() && self.surfaces.iter().filter(solid).all(white) {
            return fault(
                "the housing",
                "pad and walls all reflect everything, so light never leaves".to_owned(),
                "give one of them an albedo below 1",
            );
        }
        if !(1..=MOST_EVENTS).contains(&self.max_events) {
            return fault(
                "the light",
                format!("it is followed over at most {} events", self.max_events),
                "use 1 to 1000 events; 8 to 16 are enough for most sensors",
            );
        }
        let camera = &self.camera;
        let axes = glam::Mat3::from_cols(camera.right, camera.up, camera.forward);
        if !(axes.transpose() * axes).abs_diff_eq(glam::Mat3::IDENTITY, 1e-3) {
            return fault(
                "the camera",
                format!("its axes are {}, {} and {}", camera.right, camera.up, camera.forward),
                "use three unit vectors at right angles: to the right, upwards, and along the optical axis",
            );
        }
        if camera.width == 0 || camera.height == 0 {
            return fault(
                "the camera",
                format!("its raster is {} x {}", camera.width, camera.height),
                "use at least one pixel",
            );
        }
        if !(camera.origin.is_finite() && camera.tan_half_x > 0.0 && camera.tan_half_x < WIDEST) {
            return fault(
                "the camera",
                format!("its half field of view is {} (tangent)", camera.tan_half_x),
                "use a field of view above 0 and below 179 degrees",
            );
        }
        let corner = glam::Vec2::new(camera.tan_half_x, camera.tan_half_y()).length();
        if let Some(d) = camera.distortion.filter(|d| !d.reaches(corner)) {
            return fault(
                "the camera",
                format!("its distortion ({}, {}) folds the picture before its corner", d.k1, d.k2),
                "use coefficients nearer to 0: those of a calibration hold within its pictures",
            );
        }
        Ok(())
    }
}

impl Material {
    /// What is out of range, and the next move.
    fn fault(&self) -> Option<(String, &'static str)> {
        use super::Albedo;
        let albedo_fault = |albedo: &Albedo| {
            let (low, high) = match albedo {
                Albedo::Constant(c) => (c.min_element(), c.max_element()),
                Albedo::Texture(t) => t.texels.iter().fold((0.0f32, 0.0f32), |(low, high), c| {
                    (low.min(c.min_element()), high.max(c.max_element()))
                }),
            };
            let bad = !(low >= 0.0 && high <= 1.0);
            bad.then(|| (format!("its albedo ranges from {low} to {high}"), "keep it from 0 to 1"))
        };
        let alpha_fault = |alpha: f32| {
            let bad = !(0.001..=1.0).contains(&alpha);
            bad.then(|| (format!("its GGX alpha is {alpha}"), "use 0.001 to 1, or the smooth material"))
        };
        let ior_fault = |ior: f32| {
            let bad = !(1.0..=4.0).contains(&ior);
            bad.then(|| (format!("its index of refraction is {ior}"), "use 1 to 4"))
        };
        let unit_fault = |name: &str, low: f32, high: f32| {
            let bad = !(low >= 0.0 && high <= 1.0);
            bad.then(|| (format!("its {name} ranges from {low} to {high}"), "keep it from 0 to 1"))
        };
        match self {
            Material::Lambert { albedo } => albedo_fault(albedo),
            Material::Dielectric { ior } => ior_fault(*ior),
            Material::RoughDielectric { ior, alpha } => ior_fault(*ior).or_else(|| alpha_fault(*alpha)),
            Material::RoughConductor { f0, alpha } => {
                unit_fault("reflectance", f0.min_element(), f0.max_element()).or_else(|| alpha_fault(*alpha))
            }
            Material::FlakeCoating { albedo, flakes, f0, alpha } => albedo_fault(albedo)
                .or_else(|| unit_fault("flake cover", *flakes, *flakes))
                .or_else(|| unit_fault("reflectance", f0.min_element(), f0.max_element()))
                .or_else(|| alpha_fault(*alpha)),
        }
    }
}
