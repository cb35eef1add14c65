//! The sensor file: the pad and the optics around it.

use super::builtin;
use crate::elastomer::{Pad, PadShape};
use crate::image::{Picture, png};
use crate::optics::sensor::SensorOptics;
use crate::optics::{DisplacedSurface, sensor_scene};
use crate::problem::Problems;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The newest sensor format.
pub const SCHEMA: u32 = 1;

/// A file of `rig_configs/sensors/`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Format version, 1.
    pub schema: u32,
    /// What it is called: the stem of its file.
    pub name: String,
    /// What it is, for people.
    #[serde(default)]
    pub description: String,
    /// The elastomer.
    pub pad: Pad,
    /// Camera, lights, walls, coating.
    pub optics: SensorOptics,
    /// A PNG of the untouched sensor, beside this file: worn where no session has taken one.
    #[serde(default)]
    pub untouched: Option<PathBuf>,
}

/// A checked sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorConfig {
    /// What it is called.
    pub name: String,
    /// The elastomer.
    pub pad: Pad,
    /// Camera, lights, walls, coating.
    pub optics: SensorOptics,
    /// The sensor untouched, in the camera's size.
    pub untouched: Option<Picture>,
}

impl SensorFile {
    /// The checked sensor; meaningless when problems were reported. `stem` is the file's name where the sensor was asked for by
    /// that, `folder` the one that it lies in (none for the program's own copy).
    pub fn check(&self, stem: Option<&str>, folder: Option<&Path>, problems: &mut Problems) -> SensorConfig {
        if self.schema != SCHEMA {
            let next =
                format!("this program reads schema {SCHEMA}; rewrite the file or use a matching release");
            problems.push("schema", self.schema, SCHEMA.to_string(), next);
        }
        if let Some(stem) = stem.filter(|stem| *stem != self.name) {
            let next = "plans and rigs name a sensor by its file: make the two agree";
            problems.push(
                "name",
                format!("{:?}", self.name),
                format!("\"{stem}\", as the file is called"),
                next,
            );
        }
        let before = problems.len();
        problems.within("pad", |p| check_pad(&self.pad, p));
        problems.within("optics", |p| self.optics.check(p));
        if problems.len() == before && problems.is_certain("pad") && problems.is_certain("optics") {
            problems.within("optics", |p| sensor_scene::check(&self.optics, &self.untouched_face(), p));
        }
        let untouched = self.untouched.as_ref().and_then(|path| self.picture(path, folder, problems));
        SensorConfig {
            name: self.name.clone(),
            pad: self.pad.clone(),
            optics: self.optics.clone(),
            untouched,
        }
    }

    /// The pad's face as no indenter has touched it, coarsely.
    fn untouched_face(&self) -> DisplacedSurface {
        let size = [self.pad.size_x_mm, self.pad.size_y_mm];
        let height = |x: f64, y: f64| self.pad.shape.face_height_mm(size, [x, y]);
        DisplacedSurface::resting(FACE_POINTS, FACE_POINTS, size, height)
    }

    fn picture(&self, path: &Path, folder: Option<&Path>, problems: &mut Problems) -> Option<Picture> {
        let shipped = if folder.is_none() { builtin::picture(path) } else { None };
        let path = folder.map_or_else(|| path.to_owned(), |folder| folder.join(path));
        let camera = &self.optics.camera;
        let wanted = format!("a PNG of {} x {} pixels", camera.width_px, camera.height_px);
        let mut refuse = |what: String| {
            let next = "take it with `twinrig camera RIG --preview`, or leave the key out";
            problems.push(
                "untouched",
                format!("{:?}: {what}", path.display().to_string()),
                wanted.clone(),
                next,
            );
        };
        let bytes = match shipped {
            Some(bytes) => bytes.to_vec(),
            None => std::fs::read(&path).map_err(|e| refuse(e.to_string())).ok()?,
        };
        let picture = png::decode(&bytes).map_err(|e| refuse(e.to_string())).ok()?;
        if [picture.width as usize, picture.height as usize] != [camera.width_px, camera.height_px] {
            refuse(format!("{} x {} pixels", picture.width, picture.height));
            return None;
        }
        Some(picture)
    }
}

/// Points along each edge of the face that is looked at: its highest and lowest are among them.
const FACE_POINTS: usize = 21;

fn check_pad(pad: &Pad, problems: &mut Problems) {
    problems.range("size_x_mm", pad.size_x_mm, 1.0, 200.0, "mm");
    problems.range("size_y_mm", pad.size_y_mm, 1.0, 200.0, "mm");
    problems.range("thickness_mm", pad.thickness_mm, 0.2, 50.0, "mm");
    problems.within("material", |p| {
        p.range("youngs_modulus_mpa", pad.material.youngs_modulus_mpa, 1e-4, 1e4, "MPa");
        p.range("poisson_ratio", pad.material.poisson_ratio, 0.0, 0.499, "");
        p.range("density_g_mm3", pad.material.density_g_mm3, 1e-6, 100.0, "g/mm^3");
    });
    if let Some(coating) = &pad.coating {
        problems.within("coating", |p| {
            p.range("thickness_mm", coating.thickness_mm, 1e-3, pad.thickness_mm / 2.0, "mm");
            p.range("youngs_modulus_mpa", coating.youngs_modulus_mpa, 1e-4, 1e4, "MPa");
            p.range("poisson_ratio", coating.poisson_ratio, 0.0, 0.499, "");
        });
    }
    let half = pad.size_x_mm.min(pad.size_y_mm) / 2.0;
    problems.within("shape", |p| match pad.shape {
        PadShape::Cuboid => {}
        PadShape::Rounded { radius_mm } => p.range("radius_mm", radius_mm, 1e-3, half, "mm"),
        PadShape::Dome { radius_mm } | PadShape::Cylinder { radius_mm } => {
            p.range("radius_mm", radius_mm, half, 1e4, "mm");
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_under_a_domed_pad_and_hoods_beside_the_camera_are_sound() {
        let text = include_str!("../../rig_configs/sensors/domed.toml");
        let parts = "[optics.lens]\ngap_mm = 1.0\nthickness_mm = 4.0\ndiameter_mm = 14.0\nfront_radius_mm = 12.5\n\
                     back_radius_mm = -8.5\nior = 1.49\n[[optics.baffles]]\nname = \"hood\"\nshape = { kind = \"rectangle\", \
                     center_mm = [0.0, -3.0, -10.8], facing = [0.0, 1.0, 0.0], size_mm = [4.0, 1.0] }\n[[optics.baffles]]\n\
                     name = \"sill\"\nshape = { kind = \"box\", from_mm = [-9.1, -3.0, -8.0], to_mm = [-8.0, 3.0, -7.0] }\n";
        let check = |parts: &str| {
            let file: SensorFile = toml::from_str(&format!("{text}\n{parts}")).unwrap();
            let mut problems = Problems::new();
            file.check(Some("domed"), None, &mut problems);
            problems.into_vec()
        };
        assert_eq!(check(parts), Vec::new());
        // In the shell it is not.
        let inside = check(
            &parts
                .replace("[-9.1, -3.0, -8.0]", "[-6.0, -3.0, -8.0]")
                .replace("[-8.0, 3.0, -7.0]", "[-5.0, 3.0, -3.0]"),
        );
        assert_eq!(
            inside.iter().map(|p| p.key.as_str()).collect::<Vec<_>>(),
            ["optics.baffles[1].shape"],
            "{inside:?}"
        );
        assert!(inside[0].value.contains("in the lens"), "{inside:?}");
    }

    #[test]
    fn a_sensor_that_is_asked_for_by_its_name_is_called_as_its_file() {
        let file: SensorFile =
            toml::from_str(include_str!("../../rig_configs/sensors/gelsight.toml")).unwrap();
        for (stem, keys) in [(Some("gelsight"), &[][..]), (Some("mine"), &["name"]), (None, &[])] {
            let mut problems = Problems::new();
            file.check(stem, None, &mut problems);
            let found: Vec<String> = problems.into_vec().into_iter().map(|p| p.key).collect();
            assert_eq!(found, keys, "{stem:?}");
        }
    }

    #[test]
    fn the_untouched_picture_is_read_beside_the_file_and_has_the_cameras_size() {
        let folder = tempfile::tempdir().unwrap();
        let text = include_str!("../../rig_configs/sensors/gelsight.toml");
        let text = text.replace("name = \"gelsight\"", "name = \"gelsight\"\nuntouched = \"rest.png\"");
        let file: SensorFile = toml::from_str(&text).unwrap();
        let check = || {
            let mut problems = Problems::new();
            let sensor = file.check(Some("gelsight"), Some(folder.path()), &mut problems);
            (sensor.untouched, problems.into_vec())
        };
        let (untouched, problems) = check();
        assert!(untouched.is_none() && problems[0].key == "untouched", "{problems:?}");
        for (size, is_right) in [([640, 480], true), ([480, 480], false)] {
            let [width, height] = size;
            let grey = Picture { width, height, rgb: vec![90; (3 * width * height) as usize] };
            std::fs::write(folder.path().join("rest.png"), png::encode(&grey).unwrap()).unwrap();
            let (untouched, problems) = check();
            assert_eq!((untouched.is_some(), problems.is_empty()), (is_right, is_right), "{problems:?}");
        }
    }
}
