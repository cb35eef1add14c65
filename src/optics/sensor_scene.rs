//! From a sensor's description and the pad's face to a scene.

use super::sensor::{LightShapeSpec, RGB_ENERGY_OF_ONE, SensorOptics};
use super::surface::DisplacedSurface;
use super::{
    Albedo, Camera, Error, Light, LightShape, Material, Mesh, Role, Scene, Surface, Texture, camera, from_pad,
};
use crate::problem::Problems;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The scene of the sensor with this face. `albedo` is what is on its coating, linear, row 0 on top: the image of the untouched
/// sensor in texture mode `lit`, or printed markers; without it the coating has its own everywhere. The face is taken as it
/// is: see [`face`] for the description's mesh and depth noise.
///
/// # Errors
/// When the face is no lattice, or a part of the description cannot be rendered.
pub fn scene(
    sensor: &SensorOptics,
    surface: &DisplacedSurface,
    albedo: Option<&Arc<Texture>>,
) -> Result<Scene, Error> {
    let mesh = surface.mesh(|p| texture_coordinate(sensor, p))?;
    let albedo = match albedo {
        Some(texture) => Albedo::Texture(texture.clone()),
        None => Albedo::grey(sensor.coating.albedo as f32),
    };
    let roughness = sensor.coating.roughness as f32;
    let material = if roughness >= 1.0 {
        Material::Lambert { albedo }
    } else {
        Material::FlakeCoating {
            albedo,
            flakes: 1.0 - roughness,
            f0: Vec3::splat(FLAKE_REFLECTANCE),
            alpha: (roughness * roughness).max(0.001),
        }
    };
    let mut surfaces =
        vec![Surface { name: "pad".to_owned(), role: Role::Pad, mesh: Arc::new(mesh), material }];
    if let Some(h) = &sensor.housing {
        surfaces.push(Surface {
            name: "housing".to_owned(),
            role: Role::Housing,
            mesh: Arc::new(Mesh::open_box(
                from_pad(pad(&[h.x_mm[0], h.y_mm[1], h.skirt_mm])),
                from_pad(pad(&[h.x_mm[1], h.y_mm[0], -h.height_mm])),
            )),
            material: Material::Lambert { albedo: Albedo::grey(h.albedo as f32) },
        });
    }
    if let Some(p) = &sensor.plate {
        // It protrudes through the walls, so that no light slips past its rim.
        let half = match &sensor.housing {
            Some(h) => [h.x_mm, h.y_mm].map(|e| e[0].abs().max(e[1].abs()) as f32 + 0.1),
            None => sensor.view_mm().map(|e| e as f32),
        };
        let (low, high) = (p.gap_mm as f32, (p.gap_mm + p.thickness_mm) as f32);
        surfaces.push(Surface {
            name: "plate".to_owned(),
            role: Role::Plate,
            mesh: Arc::new(Mesh::cuboid(
                Vec3::new(-half[0], -half[1], low),
                Vec3::new(half[0], half[1], high),
            )),
            material: Material::Dielectric { ior: p.ior as f32 },
        });
    }
    // A plate's faces are events, too; those of the file are scatterings.
    let max_events = if sensor.plate.is_some() { (2 * sensor.max_events).max(16) } else { sensor.max_events };
    let scene = Scene { surfaces, lights: lights(sensor), camera: camera_of(sensor), max_events };
    scene.check()?;
    Ok(scene)
}

/// Reports, at the sensor's keys, what no renderer takes of the untouched sensor: what is found here does not end a session.
/// The values by themselves are the business of [`SensorOptics::check`], and in range.
pub fn check(sensor: &SensorOptics, untouched: &DisplacedSurface, problems: &mut Problems) {
    if let (true, Some(distortion)) = (camera_of(sensor).folds(), sensor.camera.distortion) {
        problems.push(
            "camera.distortion",
            format!("{distortion:?}"),
            "coefficients with which the picture reaches its corners without folding over",
            "use coefficients nearer to 0: those of a calibration hold within its pictures",
        );
    } else if let Err(e) = scene(sensor, untouched, None) {
        let (key, what, next) = match e {
            Error::Scene { part, what, next } => (key_of(sensor, &part), what, next),
            other => (String::new(), other.to_string(), "correct it in the sensor file".to_owned()),
        };
        problems.push(&key, what, "what can be rendered", next);
    }
}

/// What of a sensor the fast mode has no way for, at its key of the sensor file. The mode itself would tell what
/// it finds of the scene.
pub fn not_fast(sensor: &SensorOptics) -> Option<Error> {
    let refuse = |key, value: String, what: &str| Some(Error::NotFast { key, value, what: what.to_owned() });
    let (roughness, radius) = (sensor.coating.roughness, sensor.camera.aperture_radius_mm);
    if roughness < 1.0 {
        return refuse("optics.coating.roughness", roughness.to_string(), "1 only, a diffuse coating");
    }
    if radius > 0.0 {
        return refuse("optics.camera.aperture_radius_mm", radius.to_string(), "0 only, a pinhole");
    }
    let of_triangles = |light: &&super::sensor::LightSpec| matches!(light.shape, LightShapeSpec::Mesh { .. });
    let light = sensor.lights.iter().find(of_triangles)?;
    refuse("optics.lights", format!("{:?}, a mesh", light.name), "rectangles, discs and tubes only")
}

/// The key of what a scene calls a part.
fn key_of(sensor: &SensorOptics, part: &str) -> String {
    match part {
        "the camera" => "camera".to_owned(),
        "the pad" => "plate.gap_mm".to_owned(),
        "the light" => "max_events".to_owned(),
        "pad" => "coating".to_owned(),
        "plate" => "plate".to_owned(),
        "housing" | "the housing" => "housing".to_owned(),
        name => match sensor.lights.iter().position(|light| light.name == name) {
            Some(k) => format!("lights[{k}]"),
            None => String::new(),
        },
    }
}

/// Reflectance of a metal flake at normal incidence (aluminium).
const FLAKE_REFLECTANCE: f32 = 0.9;

/// The face on the description's mesh, with its depth noise.
pub fn face(sensor: &SensorOptics, surface: &DisplacedSurface) -> DisplacedSurface {
    let [nx, ny] = sensor.mesh_vertices();
    surface.resampled(nx, ny).with_depth_noise(sensor.mesh.depth_noise_mm, sensor.mesh.depth_noise_seed)
}

/// Where a point of the undeformed face, pad frame, mm, lies in the image of the untouched sensor, (0, 0) the upper left
/// corner (the lens' distortion apart). Points of a dome are seen under their own depth.
pub fn texture_coordinate(sensor: &SensorOptics, point: Vec3) -> Vec2 {
    let [w, h] = sensor.view_mm().map(|v| v as f32);
    let [cx, cy] = sensor.camera.center_mm.map(|v| v as f32);
    // As it would stand on the plane through the apex, for which `mm_per_px` holds.
    let distance = apparent_distance(sensor) as f32;
    let scale = distance / (distance + point.z).max(1e-3);
    Vec2::new((point.x - cx) * scale / w + 0.5, (point.y - cy) * scale / h + 0.5)
}

/// The camera of the description. Behind a plate the face seems nearer by t (1 - 1/n) (paraxially), so the field
/// of view is that much wider and `mm_per_px` still holds on the face.
pub fn camera_of(sensor: &SensorOptics) -> Camera {
    let c = &sensor.camera;
    let distance = apparent_distance(sensor);
    let origin = from_pad(pad(&[c.center_mm[0], c.center_mm[1], -c.distance_mm]));
    let tan_half_x = (sensor.view_mm()[0] / 2.0 / distance) as f32;
    let mut camera = Camera::above(origin, tan_half_x, c.width_px, c.height_px);
    camera.distortion = c.distortion.map(|[k1, k2]| camera::Distortion { k1: k1 as f32, k2: k2 as f32 });
    if c.aperture_radius_mm > 0.0 {
        camera.lens = Some(camera::ThinLens {
            aperture_radius_mm: c.aperture_radius_mm as f32,
            focus_mm: distance as f32,
        });
    }
    camera
}

/// From the optical centre to the undeformed face as it seems.
fn apparent_distance(sensor: &SensorOptics) -> f64 {
    let shift = sensor.plate.as_ref().map_or(0.0, |p| p.thickness_mm * (1.0 - 1.0 / p.ior));
    sensor.camera.distance_mm - shift
}

fn lights(sensor: &SensorOptics) -> Vec<Light> {
    let light = |spec: &super::sensor::LightSpec| Light {
        name: spec.name.clone(),
        shape: shape(&spec.shape),
        radiance: pad(&spec.rgb) * (spec.energy / RGB_ENERGY_OF_ONE) as f32,
        two_sided: false,
        cosine_power: spec.cosine_power as f32,
        albedo: Vec3::splat(spec.albedo as f32),
    };
    sensor.lights.iter().map(light).collect()
}

fn shape(spec: &LightShapeSpec) -> LightShape {
    match spec {
        LightShapeSpec::Rectangle { center_mm, facing, size_mm } => {
            let normal = from_pad(pad(facing)).normalize();
            // The first edge is level; for a light that faces along z it runs along x.
            let level = Vec3::Z.cross(normal);
            let u = if level.length() > 1e-4 { level.normalize() } else { Vec3::X };
            LightShape::Rectangle {
                center: from_pad(pad(center_mm)),
                half_u: u * (size_mm[0] / 2.0) as f32,
                half_v: normal.cross(u) * (size_mm[1] / 2.0) as f32,
            }
        }
        LightShapeSpec::Disc { center_mm, facing, radius_mm } => LightShape::Disc {
            center: from_pad(pad(center_mm)),
            normal: from_pad(pad(facing)).normalize(),
            radius: *radius_mm as f32,
        },
        LightShapeSpec::Tube { from_mm, to_mm, radius_mm } => LightShape::Tube {
            from: from_pad(pad(from_mm)),
            to: from_pad(pad(to_mm)),
            radius: *radius_mm as f32,
        },
        LightShapeSpec::Mesh { vertices_mm, triangles } => LightShape::Mesh(Arc::new(Mesh {
            positions: vertices_mm.iter().map(|v| from_pad(pad(v))).collect(),
            triangles: triangles.clone(),
            ..Mesh::default()
        })),
    }
}

fn pad(v: &[f64; 3]) -> Vec3 {
    Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32)
}
