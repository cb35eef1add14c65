//! The loader of benchmark scenes (the format of tactile-bench-1.json).
//!
//! The file gives every number of one sensor scene: a pad as a height field over a lattice, a box
//! without floor, four rectangular lights, a camera. Variants: `Ac` (constant albedo), `At` (analytic
//! texture), `B` (`Ac` plus a clear plate). Formulas given in words in the file (height, texture) are
//! implemented here; a file whose words differ is another format and is refused by its name.

mod check;
mod file;
mod keys;
mod texture;

use super::{Albedo, Error, Material, Mesh, Role, Scene, Surface};
use file::SceneFile;
use glam::Vec3;
use keys::unknown_key;
use serde::{Deserialize, Serialize};
use std::{path::Path, sync::Arc};
use texture::bench_texture;

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

/// What is wrong, in a text that has no path yet.
fn fault(reason: String, next: &str) -> Error {
    Error::SceneFormat { path: "<text>".to_owned(), reason, next: next.to_owned() }
}

/// The next move where an extent ends before it begins.
const IN_ORDER: &str = "write the smaller coordinate first, in mm";

/// The next move where the file's shape is wrong, and no range.
const EXAMPLE: &str =
    "the format's example, tests/data/optics/tactile-bench-1.json, has every key as it should be";

#[cfg(test)]
mod tests {
    use super::*;

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
