//! The loader of benchmark scenes (the format of tactile-bench-1.json).
//!
//! The file gives every number of one sensor scene: a pad as a height field over a lattice, a box
//! without floor, four rectangular lights, a camera. Variants: `Ac` (constant albedo), `At` (analytic
//! texture), `B` (`Ac` plus a clear plate). Formulas given in words in the file (height, texture) are
//! implemented here; a file whose words differ is another format and is refused by its name.

use super::{
    Albedo, Camera, Error, Light, LightShape, Material, Mesh, Role, Scene, Surface, Texture, camera,
};
use glam::{DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::{path::Path, sync::Arc};

/// Which of the three scenes of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Variant {
    /// Constant albedo.
    Ac,
    /// Analytic texture.
    At,
    /// Constant albedo and a clear plate.
    B,
}

impl Variant {
    /// Its name in the format.
    pub fn name(self) -> &'static str {
        match self {
            Variant::Ac => "Ac",
            Variant::At => "At",
            Variant::B => "B",
        }
    }
}

impl std::str::FromStr for Variant {
    type Err = Error;

    fn from_str(s: &str) -> Result<Self, Error> {
        match s {
            "Ac" => Ok(Variant::Ac),
            "At" => Ok(Variant::At),
            "B" => Ok(Variant::B),
            _ => Err(Error::Setting {
                key: "variant",
                value: s.to_owned(),
                why: "a scene file has the variants Ac, At and B; choose one of them".to_owned(),
            }),
        }
    }
}

/// Loads one variant of a scene file, with the file's own raster.
///
/// # Errors
/// When the file cannot be read or does not follow the format.
pub fn load(path: &Path, variant: Variant) -> Result<Scene, Error> {
    let told = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|e| Error::File {
        action: "read",
        path: told.clone(),
        reason: e.to_string(),
    })?;
    let text = std::str::from_utf8(&bytes).map_err(|e| Error::Content {
        path: told.clone(),
        reason: format!("it is no UTF-8 text from byte {} on", e.valid_up_to()),
        next: "give a scene file, which is JSON, and save it as UTF-8",
    })?;
    parse(text, variant).map_err(|e| match e {
        Error::SceneFormat { reason, next, .. } => Error::SceneFormat { path: told, reason, next },
        other => other,
    })
}

/// The same from the text of the file.
///
/// # Errors
/// When the text does not follow the format.
pub fn parse(text: &str, variant: Variant) -> Result<Scene, Error> {
    let value: serde_json::Value = serde_json::from_str(text)
        .map_err(|e| fault(format!("it is no JSON: {e}"), "mend the file at that line and column"))?;
    if !value.is_object() {
        return Err(fault("it is JSON, but no object".to_owned(), EXAMPLE));
    }
    if let Some(unknown) = unknown_key(&value) {
        return Err(fault(unknown, "correct the key, or leave it out"));
    }
    let file = SceneFile::of(value)?;
    if file.name != "tactile-bench-1" {
        return Err(fault(
            format!("its name is \"{}\", the only known one is \"tactile-bench-1\"", file.name),
            "write that name if the file has this format; other formats are not read",
        ));
    }
    let pad = &file.elastomer;
    for (key, n) in [("nx", pad.nx), ("ny", pad.ny)] {
        if !(2..=8192).contains(&n) {
            return Err(fault(
                format!("elastomer.{key} = {n}: the pad's lattice has 2 to 8192 points along an edge"),
                "choose about one point a pixel that sees the pad, e.g. 641",
            ));
        }
    }
    file.check()?;
    let albedo = match variant {
        Variant::At => Albedo::Texture(Arc::new(bench_texture())),
        Variant::Ac | Variant::B => Albedo::grey(pad.albedo_const),
    };
    // Lights' own patches have it, too, so a message of theirs would not name it.
    if !(0.0..1.0).contains(&file.walls.albedo) {
        return Err(fault(
            format!("box.albedo = {}: it is from 0 to below 1", file.walls.albedo),
            "choose what the walls reflect, e.g. 0.3 where they are painted dark",
        ));
    }
    let mut surfaces = vec![
        Surface {
            name: "pad".to_owned(),
            role: Role::Pad,
            mesh: Arc::new(pad.mesh()),
            material: Material::Lambert { albedo },
        },
        Surface {
            name: "box".to_owned(),
            role: Role::Housing,
            mesh: Arc::new(file.walls.mesh()),
            material: Material::Lambert { albedo: Albedo::grey(file.walls.albedo) },
        },
    ];
    if variant == Variant::B {
        let p = &file.plate;
        if let Some((axis, [low, high])) =
            [("x", p.x), ("y", p.y), ("z", p.z)].into_iter().find(|(_, [low, high])| low >= high)
        {
            return Err(fault(
                format!("plate.{axis} = [{low}, {high}]: the first number is below the second"),
                IN_ORDER,
            ));
        }
        surfaces.push(Surface {
            name: "plate".to_owned(),
            role: Role::Plate,
            mesh: Arc::new(Mesh::cuboid(
                Vec3::new(p.x[0], p.y[0], p.z[0]),
                Vec3::new(p.x[1], p.y[1], p.z[1]),
            )),
            material: Material::Dielectric { ior: p.ior },
        });
    }
    let events = &file.max_scattering_events;
    let scene = Scene {
        surfaces,
        lights: file.lights.iter().map(|l| l.light(file.walls.albedo)).collect(),
        camera: file.camera.camera()?,
        max_events: if variant == Variant::B { events.b } else { events.a },
    };
    scene.check()?;
    Ok(scene)
}

/// The texture of variant At: dark dots at 2 mm pitch on a wavy ground, on the 20 x 15 mm pad.
fn bench_texture() -> Texture {
    use std::f64::consts::TAU;
    Texture::from_fn(640, 480, |u, v| {
        let (x, y) = (20.0 * u - 10.0, 15.0 * v - 7.5);
        let nearest = |c: f64| c - (2.0 * ((c - 1.0) / 2.0).round() + 1.0);
        let q = nearest(x).hypot(nearest(y));
        let m = 1.0 - 0.85 * (-(q / 0.25).powi(4)).exp();
        let rgb = DVec3::new(
            0.55 + 0.15 * (TAU * x / 5.0).sin(),
            0.50 + 0.20 * (TAU * (x + y) / 4.0).sin(),
            0.45 + 0.15 * (TAU * y / 3.0).cos(),
        );
        (m * rgb).as_vec3()
    })
}

/// Keys of each part of a file, those with explanations in words included.
const KEYS: [(&str, &[&str]); 8] = [
    (
        "",
        &[
            "name",
            "units",
            "elastomer",
            "box",
            "lights",
            "light_notes",
            "camera",
            "max_scattering_events",
            "plate",
            "metrics",
        ],
    ),
    (
        "elastomer",
        &[
            "nx",
            "ny",
            "x_range",
            "y_range",
            "vertex",
            "triangles",
            "height",
            "cx",
            "cy",
            "R",
            "d",
            "rc",
            "hc",
            "k",
            "normals",
            "bsdf",
            "albedo_const",
            "uv",
            "texture",
        ],
    ),
    ("box", &["x", "y", "z", "faces", "albedo"]),
    (
        "lights",
        &[
            "name",
            "center_mm",
            "normal",
            "u_dir",
            "size_u_mm",
            "v_dir",
            "size_v_mm",
            "rgb255",
            "energy_table",
            "radiance_linear_rgb",
        ],
    ),
    ("camera", &["type", "origin", "look_dir", "up", "right", "hfov_deg", "note", "res", "filter", "output"]),
    ("max_scattering_events", &["A", "B", "note"]),
    ("plate", &["variant", "x", "y", "z", "ior", "bsdf", "note"]),
    ("metrics", &["relRMSE", "exposure", "exposure_value"]),
];

/// What is wrong, in a text that has no path yet.
fn fault(reason: String, next: &str) -> Error {
    Error::SceneFormat { path: "<text>".to_owned(), reason, next: next.to_owned() }
}

/// The next move where an extent ends before it begins.
const IN_ORDER: &str = "write the smaller coordinate first, in mm";

/// What is wrong with the first key that the format does not have.
fn unknown_key(file: &serde_json::Value) -> Option<String> {
    KEYS.into_iter().find_map(|(part, known)| {
        let value = if part.is_empty() { file } else { &file[part] };
        let tables = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
        let keys = tables.iter().filter_map(|table| table.as_object()).flat_map(|table| table.keys());
        let key = keys.into_iter().find(|key| !known.contains(&key.as_str()))?;
        let place = if part.is_empty() { "the file".to_owned() } else { format!("\"{part}\"") };
        Some(format!("{place} has an unknown key \"{key}\"; known are {}", known.join(", ")))
    })
}

// The file as it stands; keys with explanations in words are read over.

struct SceneFile {
    name: String,
    elastomer: PadFile,
    walls: BoxFile,
    lights: Vec<LightFile>,
    camera: CameraFile,
    max_scattering_events: EventsFile,
    plate: PlateFile,
}

/// Most pixels along an edge of the picture.
const MOST_PX: usize = 16_384;

impl SceneFile {
    /// The parts one by one, so that what is wrong is told with the part it is in.
    fn of(mut value: serde_json::Value) -> Result<Self, Error> {
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

    /// What is wrong with its numbers, the first of all: key, value, what is allowed, and the next move.
    fn check(&self) -> Result<(), Error> {
        let Self { elastomer: pad, walls, camera, .. } = self;
        let ranges = [("elastomer.x_range", pad.x_range), ("elastomer.y_range", pad.y_range)];
        let sides = [("box.x", walls.x), ("box.y", walls.y), ("box.z", walls.z)];
        let sides = sides.map(|(key, range)| (key, range.map(f64::from)));
        if let Some((key, [low, high])) = ranges.into_iter().chain(sides).find(|(_, [low, high])| low >= high)
        {
            return Err(fault(
                format!("{key} = [{low}, {high}]: the first number is below the second"),
                IN_ORDER,
            ));
        }
        let PadFile { radius, rc, .. } = *pad;
        if radius <= 0.0 || !(0.0..=radius).contains(&rc) {
            return Err(fault(
                format!(
                    "elastomer.R = {radius} and rc = {rc}: the ball's radius R is above 0, that of its contact rc from 0 to R"
                ),
                "choose R in mm, and for rc where the pad parts from the ball",
            ));
        }
        let [width, height] = camera.res;
        if [width, height].iter().any(|n| !(1..=MOST_PX).contains(n)) {
            return Err(fault(
                format!("camera.res = [{width}, {height}]: each is from 1 to {MOST_PX}"),
                "choose columns and rows of the picture, e.g. [640, 480]; `--size` changes them for one picture",
            ));
        }
        for light in &self.lights {
            let name = &light.name;
            for (key, size) in [("size_u_mm", light.size_u_mm), ("size_v_mm", light.size_v_mm)] {
                if size <= 0.0 {
                    return Err(fault(
                        format!("{key} = {size} of light \"{name}\": it is above 0"),
                        "choose the light's full extent along that side, in mm; to turn it off give it the radiance [0, 0, 0]",
                    ));
                }
            }
            let facing = light.u_dir.cross(light.v_dir).dot(light.normal).abs();
            if facing.is_nan() || facing < LEAST_FACING {
                return Err(fault(
                    format!(
                        "normal = {} of light \"{name}\": it points to either side of its u_dir and v_dir, which are {} and {}",
                        light.normal, light.u_dir, light.v_dir
                    ),
                    "choose three unit vectors at right angles, the normal towards what it lights",
                ));
            }
        }
        Ok(())
    }
}

/// A part of the file, by the name it has there.
fn part<T: serde::de::DeserializeOwned>(name: &str, value: serde_json::Value) -> Result<T, Error> {
    if value.is_null() {
        return Err(fault(format!("\"{name}\" is missing"), EXAMPLE));
    }
    serde_json::from_value(value).map_err(|e| fault(format!("\"{name}\": {e}"), EXAMPLE))
}

/// The next move where the file's shape is wrong, and no range.
const EXAMPLE: &str =
    "the format's example, tests/data/optics/tactile-bench-1.json, has every key as it should be";

/// A light's normal is that of its sides if their triple product, 1 where all are as they should be, is above this.
const LEAST_FACING: f32 = 0.99;

#[derive(Deserialize)]
struct PadFile {
    nx: usize,
    ny: usize,
    x_range: [f64; 2],
    y_range: [f64; 2],
    cx: f64,
    cy: f64,
    #[serde(rename = "R")]
    radius: f64,
    d: f64,
    rc: f64,
    hc: f64,
    k: f64,
    albedo_const: f32,
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

    fn mesh(&self) -> Mesh {
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
struct BoxFile {
    x: [f32; 2],
    y: [f32; 2],
    z: [f32; 2],
    albedo: f32,
}

impl BoxFile {
    /// Walls and ceiling; no floor, the pad closes the box.
    fn mesh(&self) -> Mesh {
        Mesh::open_box(Vec3::new(self.x[0], self.y[0], self.z[0]), Vec3::new(self.x[1], self.y[1], self.z[1]))
    }
}

#[derive(Deserialize)]
struct PlateFile {
    x: [f32; 2],
    y: [f32; 2],
    z: [f32; 2],
    ior: f32,
}

#[derive(Deserialize)]
struct EventsFile {
    #[serde(rename = "A")]
    a: u32,
    #[serde(rename = "B")]
    b: u32,
}

#[derive(Deserialize)]
struct LightFile {
    name: String,
    center_mm: Vec3,
    normal: Vec3,
    u_dir: Vec3,
    size_u_mm: f32,
    v_dir: Vec3,
    size_v_mm: f32,
    radiance_linear_rgb: Vec3,
}

impl LightFile {
    fn light(&self, albedo: f32) -> Light {
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
struct CameraFile {
    #[serde(rename = "type")]
    kind: String,
    origin: Vec3,
    look_dir: Vec3,
    up: Vec3,
    right: Vec3,
    hfov_deg: f64,
    res: [usize; 2],
}

/// The widest horizontal field of view, degrees.
const WIDEST_DEG: f64 = 179.0;

impl CameraFile {
    fn camera(&self) -> Result<Camera, Error> {
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
        Ok(camera::Camera {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_the_format_does_not_have_is_refused_by_name() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        assert!(parse(text, Variant::B).is_ok());
        for (from, to, place) in [
            ("\"cx\"", "\"cx_mm\"", "\"elastomer\" has an unknown key \"cx_mm\""),
            ("\"units\"", "\"unit\"", "the file has an unknown key \"unit\""),
            ("\"size_u_mm\"", "\"size_u\"", "\"lights\" has an unknown key \"size_u\""),
        ] {
            let told = parse(&text.replacen(from, to, 1), Variant::Ac).unwrap_err().to_string();
            assert!(told.contains(place), "{told}");
        }
    }

    #[test]
    fn numbers_that_make_no_scene_are_named_by_their_keys() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        let told = |change: fn(&mut serde_json::Value)| {
            let mut file: serde_json::Value = serde_json::from_str(text).expect("the scene");
            change(&mut file);
            parse(&file.to_string(), Variant::Ac).expect_err("no scene").to_string()
        };
        for (told, named) in [
            (
                told(|f| f["camera"]["res"] = serde_json::json!([1_000_000, 480])),
                "camera.res = [1000000, 480]",
            ),
            (told(|f| f["box"]["x"] = serde_json::json!([10.0, -10.0])), "box.x = [10, -10]"),
            (told(|f| f["elastomer"]["R"] = serde_json::json!(-4.0)), "elastomer.R = -4"),
            (told(|f| f["elastomer"]["rc"] = serde_json::json!(99.0)), "rc = 99"),
            (told(|f| f["lights"][0]["size_u_mm"] = serde_json::json!(-9.0)), "size_u_mm = -9 of light"),
            (told(|f| f["lights"][1]["normal"] = serde_json::json!([0.0, 0.0, 0.0])), "normal = [0, 0, 0]"),
        ] {
            assert!(told.contains(named), "{told}");
        }
    }

    #[test]
    fn walls_that_swallow_nothing_and_a_view_that_is_too_wide_are_named_by_their_keys() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        let told = |part: &str, key: &str, value: f64| {
            let mut file: serde_json::Value = serde_json::from_str(text).unwrap();
            file[part][key] = value.into();
            parse(&file.to_string(), Variant::Ac).unwrap_err().to_string()
        };
        let box_told = told("box", "albedo", 1.0);
        assert!(box_told.contains("box.albedo = 1: it is from 0 to below 1"), "{box_told}");
        let view_told = told("camera", "hfov_deg", 180.0);
        assert!(view_told.contains("camera.hfov_deg = 180: it is above 0 and below 179"), "{view_told}");
    }

    /// A next move that fits all mistakes helps with none.
    #[test]
    fn every_mistake_has_the_next_move_that_suits_its_key() {
        let text = include_str!("../../tests/data/optics/tactile-bench-1.json");
        let told = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut file: serde_json::Value = serde_json::from_str(text).unwrap();
            change(&mut file);
            parse(&file.to_string(), Variant::B).unwrap_err().to_string()
        };
        for (told, next) in [
            (told(&|f| f["camera"]["res"] = serde_json::json!([0, 480])), "e.g. [640, 480]"),
            (told(&|f| f["camera"]["hfov_deg"] = 180.0.into()), "the full horizontal angle"),
            (told(&|f| f["camera"]["type"] = "fisheye".into()), "sensor files"),
            (told(&|f| f["box"]["albedo"] = 1.0.into()), "e.g. 0.3"),
            (told(&|f| f["box"]["x"] = serde_json::json!([1.0, -1.0])), "the smaller coordinate first"),
            (told(&|f| f["plate"]["z"] = serde_json::json!([1.0, 1.0])), "the smaller coordinate first"),
            (told(&|f| f["elastomer"]["nx"] = 1.into()), "one point a pixel"),
            (told(&|f| f["elastomer"]["R"] = 0.0.into()), "choose R in mm"),
            (told(&|f| f["lights"][0]["size_v_mm"] = 0.0.into()), "the radiance [0, 0, 0]"),
            (told(&|f| f["name"] = "another".into()), "write that name"),
            (told(&|f| f["wall"] = 1.into()), "correct the key"),
            (parse("[]", Variant::Ac).unwrap_err().to_string(), "the format's example"),
            (parse("{", Variant::Ac).unwrap_err().to_string(), "that line and column"),
        ] {
            assert!(told.contains(next), "{told}");
        }
        // What is missing is told with where it is missing.
        let missing = told(&|f| _ = f["lights"][2].as_object_mut().unwrap().remove("normal"));
        assert!(missing.contains("\"lights[2]\": missing field `normal`"), "{missing}");
        let missing = told(&|f| _ = f.as_object_mut().unwrap().remove("camera"));
        assert!(missing.contains("\"camera\" is missing; the format's example"), "{missing}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.json");
        std::fs::write(&path, b"{\"name\": \"\xff\"}").unwrap();
        let told = load(&path, Variant::Ac).unwrap_err().to_string();
        assert!(told.contains("no UTF-8 text from byte 10 on") && !told.contains("permissions"), "{told}");
    }
}
