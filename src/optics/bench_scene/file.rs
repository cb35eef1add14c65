//! The file as it stands; keys with explanations in words are read over.

use super::{EXAMPLE, fault};
use crate::optics::{Camera, Error, Light, LightShape, Mesh};
use glam::{Vec2, Vec3};
use serde::Deserialize;

pub(super) struct SceneFile {
    pub(super) name: String,
    pub(super) elastomer: PadFile,
    pub(super) walls: BoxFile,
    pub(super) lights: Vec<LightFile>,
    pub(super) camera: CameraFile,
    pub(super) max_scattering_events: EventsFile,
    pub(super) plate: PlateFile,
}

impl SceneFile {
    /// The parts one by one, so that what is wrong is told with the part it is in.
    pub(super) fn of(mut value: serde_json::Value) -> Result<Self, Error> {
        let mut lights = Vec::new();
        let listed = value["lights"].take();
        for (k, light) in part::<Vec<serde_json::Value>>("lights", listed)?.into_iter().enumerate() {
            lights.push(part(&format!("lights[{k}]"), light)?);
        }
        Ok(Self {
            name: part("name", value["name"].take())?,
            elastomer: part("elastomer", value["elastomer"].take())?,
            walls: part("box", value["box"].take())?,
            lights,
            camera: part("camera", value["camera"].take())?,
            max_scattering_events: part("max_scattering_events", value["max_scattering_events"].take())?,
            plate: part("plate", value["plate"].take())?,
        })
    }
}

/// A part of the file, by the name it has there.
fn part<T: serde::de::DeserializeOwned>(name: &str, value: serde_json::Value) -> Result<T, Error> {
    if value.is_null() {
        return Err(fault(format!("\"{name}\" is missing"), EXAMPLE));
    }
    serde_json::from_value(value).map_err(|e| fault(format!("\"{name}\": {e}"), EXAMPLE))
}

#[derive(Deserialize)]
pub(super) struct PadFile {
    pub(super) nx: usize,
    pub(super) ny: usize,
    pub(super) x_range: [f64; 2],
    pub(super) y_range: [f64; 2],
    cx: f64,
    cy: f64,
    #[serde(rename = "R")]
    pub(super) radius: f64,
    d: f64,
    pub(super) rc: f64,
    hc: f64,
    k: f64,
    pub(super) albedo_const: f32,
}

impl PadFile {
    /// Height of the pressed pad: a spherical cap inside rc, an exponential tail outside.
    fn height(&self, x: f64, y: f64) -> f64 {
        let r = (x - self.cx).hypot(y - self.cy);
        if r <= self.rc {
            self.d - self.radius + (self.radius * self.radius - r * r).sqrt()
        } else {
            self.hc * (-self.k * (r - self.rc)).exp()
        }
    }

    pub(super) fn mesh(&self) -> Mesh {
        let mut positions = Vec::with_capacity(self.nx * self.ny);
        let mut uvs = Vec::with_capacity(self.nx * self.ny);
        let ([x0, x1], [y0, y1]) = (self.x_range, self.y_range);
        for j in 0..self.ny {
            for i in 0..self.nx {
                let (s, t) = (i as f64 / (self.nx - 1) as f64, j as f64 / (self.ny - 1) as f64);
                let (x, y) = (x0 + (x1 - x0) * s, y0 + (y1 - y0) * t);
                positions.push(Vec3::new(x as f32, y as f32, self.height(x, y) as f32));
                uvs.push(Vec2::new(s as f32, t as f32));
            }
        }
        Mesh::from_lattice(self.nx, self.ny, positions, uvs)
    }
}

#[derive(Deserialize)]
pub(super) struct BoxFile {
    pub(super) x: [f32; 2],
    pub(super) y: [f32; 2],
    pub(super) z: [f32; 2],
    pub(super) albedo: f32,
}

impl BoxFile {
    /// Walls and ceiling; no floor, the pad closes the box.
    pub(super) fn mesh(&self) -> Mesh {
        Mesh::open_box(Vec3::new(self.x[0], self.y[0], self.z[0]), Vec3::new(self.x[1], self.y[1], self.z[1]))
    }
}

#[derive(Deserialize)]
pub(super) struct PlateFile {
    pub(super) x: [f32; 2],
    pub(super) y: [f32; 2],
    pub(super) z: [f32; 2],
    pub(super) ior: f32,
}

#[derive(Deserialize)]
pub(super) struct EventsFile {
    #[serde(rename = "A")]
    pub(super) a: u32,
    #[serde(rename = "B")]
    pub(super) b: u32,
}

#[derive(Deserialize)]
pub(super) struct LightFile {
    pub(super) name: String,
    center_mm: Vec3,
    pub(super) normal: Vec3,
    pub(super) u_dir: Vec3,
    pub(super) size_u_mm: f32,
    pub(super) v_dir: Vec3,
    pub(super) size_v_mm: f32,
    radiance_linear_rgb: Vec3,
}

impl LightFile {
    pub(super) fn light(&self, albedo: f32) -> Light {
        // Our rectangles shine towards u x v; the file states the normal on its own.
        let sign = self.u_dir.cross(self.v_dir).dot(self.normal).signum();
        Light {
            name: self.name.clone(),
            shape: LightShape::Rectangle {
                center: self.center_mm,
                half_u: self.u_dir * (sign * self.size_u_mm / 2.0),
                half_v: self.v_dir * (self.size_v_mm / 2.0),
            },
            radiance: self.radiance_linear_rgb,
            two_sided: false,
            cosine_power: 0.0,
            albedo: Vec3::splat(albedo),
        }
    }
}

#[derive(Deserialize)]
pub(super) struct CameraFile {
    #[serde(rename = "type")]
    kind: String,
    origin: Vec3,
    look_dir: Vec3,
    up: Vec3,
    right: Vec3,
    hfov_deg: f64,
    pub(super) res: [usize; 2],
}

/// The widest horizontal field of view, degrees.
const WIDEST_DEG: f64 = 179.0;

impl CameraFile {
    pub(super) fn camera(&self) -> Result<Camera, Error> {
        if self.kind != "pinhole" {
            return Err(fault(
                format!("camera.type = \"{}\": the format has \"pinhole\" only", self.kind),
                "write that; cameras with an aperture or a distortion are for sensor files (.toml)",
            ));
        }
        if !(self.hfov_deg > 0.0 && self.hfov_deg < WIDEST_DEG) {
            return Err(fault(
                format!("camera.hfov_deg = {}: it is above 0 and below {WIDEST_DEG} degrees", self.hfov_deg),
                "choose the full horizontal angle of view, e.g. 50",
            ));
        }
        Ok(Camera {
            origin: self.origin,
            right: self.right,
            up: self.up,
            forward: self.look_dir,
            tan_half_x: (self.hfov_deg / 2.0).to_radians().tan() as f32,
            width: self.res[0],
            height: self.res[1],
            distortion: None,
            lens: None,
        })
    }
}
