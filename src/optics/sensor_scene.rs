//! From a sensor's description and the pad's face to a scene.

use super::sensor::{LightShapeSpec, LightSpec, RGB_ENERGY_OF_ONE, SensorOptics};
use super::sightline::{Paraxial, Sightline};
use super::surface::DisplacedSurface;
use super::{
    Albedo, Camera, Error, Light, Material, Mesh, Role, Scene, Surface, Texture, camera, clearance, from_pad,
    lens_mesh, shape,
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
    let seen = paraxial(sensor);
    let mesh = surface.mesh(|p| seen_at(sensor, &seen, p))?;
    clearance::untouched(sensor, &mesh)?;
    let albedo = match albedo {
        Some(texture) => Albedo::Texture(texture.clone()),
        None => Albedo::grey(sensor.coating.albedo as f32),
    };
    let (cover, alpha) = (sensor.coating.cover() as f32, alpha_of(sensor.coating.roughness));
    let f0 = Vec3::splat(FLAKE_REFLECTANCE);
    let material = match cover {
        0.0 => Material::Lambert { albedo },
        1.0 => Material::RoughConductor { f0, alpha },
        flakes => Material::FlakeCoating { albedo, flakes, f0, alpha },
    };
    let mut surfaces =
        vec![Surface { name: "pad".to_owned(), role: Role::Pad, mesh: Arc::new(mesh), material }];
    if let Some(h) = &sensor.housing {
        surfaces.push(Surface {
            name: "housing".to_owned(),
            role: Role::Housing,
            mesh: Arc::new(Mesh::open_box(
                from_pad(shape::vector(&[h.x_mm[0], h.y_mm[1], h.skirt_mm])),
                from_pad(shape::vector(&[h.x_mm[1], h.y_mm[0], -h.height_mm])),
            )),
            material: Material::Lambert { albedo: Albedo::grey(h.albedo as f32) },
        });
    }
    // (The fast mode prepares a plate for half a minute.)
    let plate = sensor.plate.as_ref().filter(|plate| plate.shows());
    if let Some(p) = plate {
        // It protrudes through the walls, so that no light slips past its rim; without any it is twice as wide as the view.
        let [x, y] = match &sensor.housing {
            Some(h) => [h.x_mm, h.y_mm].map(|e| {
                let half = e[0].abs().max(e[1].abs()) as f32 + 0.1;
                [-half, half]
            }),
            None => {
                let [cx, cy] = sensor.camera.center_mm.map(|c| c as f32);
                let [w, h] = sensor.view_mm().map(|v| v as f32);
                [[cx - w, cx + w], [-cy - h, -cy + h]]
            }
        };
        let (low, high) = (p.gap_mm as f32, (p.gap_mm + p.thickness_mm) as f32);
        surfaces.push(Surface {
            name: "plate".to_owned(),
            role: Role::Plate,
            mesh: Arc::new(Mesh::cuboid(Vec3::new(x[0], y[0], low), Vec3::new(x[1], y[1], high))),
            material: match p.roughness {
                0.0 => Material::Dielectric { ior: p.ior as f32 },
                roughness => Material::RoughDielectric { ior: p.ior as f32, alpha: alpha_of(roughness) },
            },
        });
    }
    if let Some(lens) = &sensor.lens {
        surfaces.push(Surface {
            name: clearance::LENS.to_owned(),
            role: Role::Other,
            mesh: Arc::new(lens_mesh::of_lens(lens, sensor.camera.center_mm)),
            material: Material::Dielectric { ior: lens.ior as f32 },
        });
    }
    for baffle in &sensor.baffles {
        surfaces.push(Surface {
            name: clearance::baffle_name(&baffle.name),
            role: Role::Other,
            mesh: Arc::new(baffle.mesh()),
            material: Material::Lambert { albedo: Albedo::grey(baffle.albedo as f32) },
        });
    }
    // The faces of clear bodies are events, too; those of the file are scatterings.
    let max_events = match u32::from(plate.is_some()) + u32::from(sensor.lens.is_some()) {
        0 => sensor.max_events,
        bodies => ((1 + bodies) * sensor.max_events).max(8 + 8 * bodies),
    };
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
        return;
    }
    let before = problems.len();
    if let Ok(pad) = untouched.mesh(|_| Vec2::ZERO) {
        clearance::check(sensor, &pad, problems);
    }
    // One mistake is told once.
    if problems.len() > before {
        return;
    }
    match scene(sensor, untouched, None) {
        Ok(scene) => clearance::check_view(sensor, &scene, problems),
        Err(e) => {
            let (key, what, next) = match e {
                Error::Scene { part, what, next } => (key_of(sensor, &part), what, next),
                other => (String::new(), other.to_string(), "correct it in the sensor file".to_owned()),
            };
            problems.push(&key, what, "what can be rendered", next);
        }
    }
}

/// What of a sensor the fast mode has no way for, at its key of the sensor file. The mode itself would tell what
/// it finds of the scene.
pub fn not_fast(sensor: &SensorOptics) -> Option<Error> {
    let refuse = |key, value: String, what: &str| Some(Error::NotFast { key, value, what: what.to_owned() });
    let (coating, radius) = (&sensor.coating, sensor.camera.aperture_radius_mm);
    match coating.flakes {
        Some(flakes) if flakes > 0.0 => {
            return refuse("optics.coating.flakes", flakes.to_string(), "0 only, a diffuse coating");
        }
        None if coating.roughness < 1.0 => {
            let roughness = coating.roughness.to_string();
            return refuse("optics.coating.roughness", roughness, "1 only, a diffuse coating");
        }
        _ => {}
    }
    if let Some(plate) = sensor.plate.as_ref().filter(|plate| plate.roughness > 0.0) {
        return refuse("optics.plate.roughness", plate.roughness.to_string(), "0 only, a polished plate");
    }
    if radius > 0.0 {
        return refuse("optics.camera.aperture_radius_mm", radius.to_string(), "0 only, a pinhole");
    }
    if let Some(baffle) = sensor.baffles.first() {
        return refuse("optics.baffles", format!("{:?}", baffle.name), "sensors without baffles only");
    }
    if let Some(lens) = &sensor.lens {
        return refuse(
            "optics.lens",
            format!("of index {}", lens.ior),
            "sensors without a lens or dome only",
        );
    }
    if let Some(light) = sensor.lights.iter().find(|light| light.two_sided) {
        let value = format!("{:?}, which shines on both sides", light.name);
        return refuse("optics.lights", value, "one-sided lights only");
    }
    let of_triangles = |light: &&LightSpec| matches!(light.shape, LightShapeSpec::Mesh { .. });
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
        clearance::LENS => "lens".to_owned(),
        name => {
            let light = sensor.lights.iter().position(|light| light.name == name);
            let baffle = || sensor.baffles.iter().position(|b| clearance::baffle_name(&b.name) == name);
            match light {
                Some(k) => format!("lights[{k}]"),
                None => baffle().map_or_else(String::new, |k| format!("baffles[{k}]")),
            }
        }
    }
}

/// GGX alpha of a roughness.
fn alpha_of(roughness: f64) -> f32 {
    ((roughness * roughness) as f32).max(0.001)
}

/// Reflectance of a metal flake at normal incidence (aluminium).
const FLAKE_REFLECTANCE: f32 = 0.9;

/// The face on the description's mesh, with its depth noise.
pub fn face(sensor: &SensorOptics, surface: &DisplacedSurface) -> DisplacedSurface {
    let [nx, ny] = sensor.mesh_vertices(surface.size_mm);
    surface.resampled(nx, ny).with_depth_noise(sensor.mesh.depth_noise_mm, sensor.mesh.depth_noise_seed)
}

/// Where a point of the undeformed face, pad frame, mm, lies in the image of the untouched sensor, (0, 0) the upper left
/// corner (what lenses distort apart). Points of a dome are seen under their own depth.
pub fn texture_coordinate(sensor: &SensorOptics, point: Vec3) -> Vec2 {
    seen_at(sensor, &paraxial(sensor), point)
}

fn seen_at(sensor: &SensorOptics, seen: &Paraxial, point: Vec3) -> Vec2 {
    let [w, h] = sensor.view_mm().map(|v| v as f32);
    let [cx, cy] = sensor.camera.center_mm.map(|v| v as f32);
    // As it would stand on the plane through the apex, for which `mm_per_px` holds.
    let distance = (seen.b / seen.d) as f32;
    let scale = distance / (distance + point.z).max(1e-3);
    Vec2::new((point.x - cx) * scale / w + 0.5, (point.y - cy) * scale / h + 0.5)
}

/// The camera of the description. Behind a plate the face seems nearer by t (1 - 1/n) (near the axis), behind a lens nearer or
/// farther, so the field of view is as much wider or narrower and `mm_per_px` still holds on the face. A finite aperture is
/// focused on where the face seems to be.
pub fn camera_of(sensor: &SensorOptics) -> Camera {
    let c = &sensor.camera;
    let seen = paraxial(sensor);
    let origin = from_pad(shape::vector(&[c.center_mm[0], c.center_mm[1], -c.distance_mm]));
    let tan_half_x = (sensor.view_mm()[0] / 2.0 / seen.b) as f32;
    let mut camera = Camera::above(origin, tan_half_x, c.width_px, c.height_px);
    camera.distortion = c.distortion.map(|[k1, k2]| camera::Distortion { k1: k1 as f32, k2: k2 as f32 });
    if c.aperture_radius_mm > 0.0 {
        camera.lens = Some(camera::ThinLens {
            aperture_radius_mm: c.aperture_radius_mm as f32,
            focus_mm: (seen.b / seen.a) as f32,
        });
    }
    camera
}

/// How the camera sees the undeformed face near its axis.
fn paraxial(sensor: &SensorOptics) -> Paraxial {
    if sensor.lens.is_some() {
        return Sightline::of(sensor).paraxial();
    }
    let shift = sensor.plate.as_ref().map_or(0.0, |p| p.thickness_mm * (1.0 - 1.0 / p.ior));
    Paraxial { a: 1.0, b: sensor.camera.distance_mm - shift, d: 1.0 }
}

fn lights(sensor: &SensorOptics) -> Vec<Light> {
    let light = |spec: &LightSpec| Light {
        name: spec.name.clone(),
        shape: shape::of_light(&spec.shape),
        radiance: shape::vector(&spec.rgb) * (spec.energy / RGB_ENERGY_OF_ONE) as f32,
        two_sided: spec.two_sided,
        cosine_power: spec.cosine_power as f32,
        albedo: Vec3::splat(spec.albedo as f32),
    };
    sensor.lights.iter().map(light).collect()
}

#[cfg(test)]
mod tests;
