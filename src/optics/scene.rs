//! A scene: surfaces, lights, a camera, and how often light may scatter.

use super::light::is_radiance;
use super::{Camera, Error, Light, LightShape, Material, Mesh, overlap, scale};
use glam::Vec3;
use std::sync::Arc;

/// What a surface is to the sensor. The fast renderer treats the pad and plates on their own;
/// the reference renderer makes no difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// The coated face of the elastomer, the only thing that moves between frames.
    Pad,
    /// Walls and ceiling.
    Housing,
    /// A clear body with flat faces between pad and camera (a closed cuboid).
    Plate,
    /// Anything else: baffles, lenses.
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
/// Faces of a housing this near to its top are its ceiling, mm.
const CEILING_MM: f32 = 1e-3;

fn fault(part: &str, what: String, next: &str) -> Result<(), Error> {
    Err(Error::Scene { part: part.to_owned(), what, next: next.to_owned() })
}

impl Scene {
    /// The first surface with the role, if there is one.
    pub fn surface(&self, role: Role) -> Option<&Surface> {
        self.surfaces.iter().find(|s| s.role == role)
    }

    /// The same with every light of radiance 1.
    pub fn in_white_light(&self) -> Self {
        let mut white = self.clone();
        white.lights.iter_mut().for_each(|light| light.radiance = Vec3::ONE);
        white
    }

    /// Whether every part can be rendered.
    ///
    /// # Errors
    /// Names the first part that cannot, and what to do.
    pub fn check(&self) -> Result<(), Error> {
        for surface in &self.surfaces {
            surface.mesh.check(&surface.name)?;
            if let Some((what, next)) = surface.material.fault() {
                return fault(&surface.name, what, next);
            }
        }
        self.check_lights()?;
        scale::check(self)?;
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
        self.check_camera()
    }

    fn check_lights(&self) -> Result<(), Error> {
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
            if light.name.is_empty() {
                return fault("a light", "it has no name".to_owned(), "give each a name of its own");
            }
            if self.lights.iter().filter(|l| l.name == light.name).count() > 1 {
                return fault(
                    &light.name,
                    "several lights have this name".to_owned(),
                    "give each a name of its own",
                );
            }
            if !is_radiance(light.radiance) {
                return fault(
                    &light.name,
                    format!("its radiance is {:?}", light.radiance.to_array()),
                    "use 0 to 1e12 in each channel",
                );
            }
            if !(light.albedo.min_element() >= 0.0 && light.albedo.max_element() < 1.0) {
                return fault(&light.name, format!("its albedo is {}", light.albedo), "use 0 to below 1");
            }
        }
        self.check_lights_apart()
    }

    /// Of flat lights that share a part of one plane a ray meets either, as rounding has it. (Where the light of both has a closed form,
    /// as that of the colours of one strip, none needs to.)
    fn check_lights_apart(&self) -> Result<(), Error> {
        let is_flat = |l: &&Light| matches!(l.shape, LightShape::Rectangle { .. } | LightShape::Disc { .. });
        let is_closed = |l: &Light| matches!(l.shape, LightShape::Rectangle { .. }) && l.cosine_power == 0.0;
        let is_clear = |s: &Surface| {
            matches!(s.material, Material::Dielectric { .. } | Material::RoughDielectric { .. })
        };
        let is_bent = self.surfaces.iter().any(is_clear);
        let flat: Vec<_> = self.lights.iter().filter(is_flat).map(|l| (l, l.shape.tessellate())).collect();
        for (k, (light, mesh)) in flat.iter().enumerate() {
            let shares = |(other, its): &&(&Light, Mesh)| {
                (is_bent || !is_closed(light) || !is_closed(other)) && overlap::coincide(mesh, its)
            };
            if let Some((other, _)) = flat[..k].iter().find(shares) {
                return fault(
                    &light.name,
                    format!("it lies in the same place as a part of {:?}", other.name),
                    "move one aside; or give one light the sum of their colours if they shine the same way, or set them 0.01 mm \
                     apart if they shine opposite ways",
                );
            }
        }
        Ok(())
    }

    /// A camera that cannot see the pad's face for certain gives a black picture: under the pad, in it, or over a ceiling.
    fn check_place(&self) -> Result<(), Error> {
        let at = self.camera.origin;
        let pad = self.surface(Role::Pad).map(|pad| &pad.mesh);
        let heights = || pad.into_iter().flat_map(|mesh| &mesh.positions).map(|p| p.z);
        let [low, high] = [f32::min, f32::max].map(|of| heights().reduce(of).unwrap_or(f32::NEG_INFINITY));
        if low.is_finite() && at.z <= low {
            return fault(
                "the camera",
                format!("it is at z = {} mm, under the pad, which begins at {low} mm", at.z),
                "put it above the pad: z points from the pad towards the camera",
            );
        }
        let around = |corners: [Vec3; 3]| {
            let [a, b, c] = corners.map(|p| (p - at).truncate());
            [a.perp_dot(b), b.perp_dot(c), c.perp_dot(a)]
        };
        let is_within = |turns: [f32; 3]| turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0);
        // (Only what is lower than some of the pad can be in it.)
        let pad = pad.filter(|_| high >= at.z);
        let faces = pad.into_iter().flat_map(|mesh| (0..mesh.triangles.len()).map(|k| mesh.corners(k)));
        let face = faces.filter(|corners| is_within(around(*corners))).map(|[a, b, c]| {
            let [of_c, of_a, of_b] = around([a, b, c]);
            (a.z * of_a + b.z * of_b + c.z * of_c) / (of_a + of_b + of_c)
        });
        if let Some(face) = face.filter(|z| *z >= at.z).reduce(f32::max) {
            return fault(
                "the camera",
                format!("it is at z = {} mm, in the pad, whose face is at {face} mm there", at.z),
                "put it above the pad, or press less deep",
            );
        }
        let housing = || self.surfaces.iter().filter(|s| s.role == Role::Housing);
        let top = housing().flat_map(|s| &s.mesh.positions).fold(f32::NEG_INFINITY, |top, p| top.max(p.z));
        let covers =
            |corners: [Vec3; 3]| corners.iter().all(|p| top - p.z < CEILING_MM) && is_within(around(corners));
        let below = |mesh: &Mesh| (0..mesh.triangles.len()).any(|k| covers(mesh.corners(k)));
        if at.z >= top && housing().any(|s| below(&s.mesh)) {
            return fault(
                "the camera",
                format!("it is at z = {} mm, and the housing is closed above {top} mm", at.z),
                "put it below the ceiling, or raise that",
            );
        }
        Ok(())
    }

    fn check_camera(&self) -> Result<(), Error> {
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
                format!(
                    "its horizontal field of view is {} degrees, from {}",
                    2.0 * camera.tan_half_x.atan().to_degrees(),
                    camera.origin
                ),
                "use a field of view above 0 and below 179 degrees, and a finite place",
            );
        }
        self.check_place()?;
        if let Some(d) = camera.distortion.filter(|_| camera.folds()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::bench_scene::{Variant, parse};

    #[test]
    fn what_would_give_no_picture_is_refused_with_what_it_is() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        let told = |change: &dyn Fn(&mut Scene)| {
            let mut scene = parse(text, Variant::Ac).unwrap();
            change(&mut scene);
            scene.check().map_err(|e| e.to_string()).err().unwrap_or_default()
        };
        assert_eq!(told(&|_| {}), "");
        assert_eq!(told(&|s| s.lights[0].radiance = Vec3::splat(1e12)), "");
        for bad in [1e13, -1.0, f32::INFINITY, f32::NAN] {
            let told = told(&|s| s.lights[1].radiance.y = bad);
            assert!(told.contains("radiance") && told.contains("0 to 1e12"), "{told}");
        }
        assert!(told(&|s| s.lights[0].name.clear()).contains("no name"));
        let twice = told(&|s| {
            let LightShape::Rectangle { center, .. } = &mut s.lights[0].shape else { panic!() };
            *center += Vec3::Z * 0.1;
            s.lights[1].cosine_power = 1.0;
            let mut shape = s.lights[0].shape.clone();
            let LightShape::Rectangle { center, .. } = &mut shape else { panic!() };
            *center += Vec3::Z * 0.5;
            s.lights[1].shape = shape;
        });
        assert!(twice.contains("same place") && twice.contains("0.01 mm"), "{twice}");
        let line = |s: &mut Scene| {
            let mesh = Mesh { positions: vec![Vec3::Z; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
            s.lights[0].shape = LightShape::Mesh(Arc::new(mesh));
        };
        assert!(told(&line).contains("0 mm^2"), "{}", told(&line));
        assert!(told(&|s| s.camera.tan_half_x = 1e9).contains("180 degrees"));
        assert!(told(&|s| s.camera.origin.z = -1.0).contains("under the pad"));
        assert!(told(&|s| s.camera.origin.z = 1e3).contains("closed above"));
        // Beside its housing a camera may see something.
        assert_eq!(told(&|s| s.camera.origin = Vec3::splat(1e3)), "");
    }
}
