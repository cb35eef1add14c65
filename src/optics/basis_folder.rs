//! One picture a light in a folder: `<light>.npy`, linear RGB float32 for radiance 1, and `basis.json`, which names the
//! lights in order with the radiances that the scene has for them and, where it is known, the relRMSE to expect of each picture
//! and of their sum in those radiances. Of a sensor there is `sensor.json`, too: its camera, and the energies in its file.

use super::light::is_radiance;
use super::sensor_basis::SensorCamera;
use super::{Error, Film, LightBasis};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The list beside the pictures.
const LIST: &str = "basis.json";
/// The camera beside the pictures of a sensor.
const SENSOR: &str = "sensor.json";

/// What a folder holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Contents {
    /// The pictures.
    pub basis: LightBasis,
    /// The radiances that the scene has for the lights.
    pub radiances: Vec<Vec3>,
    /// relRMSE to expect of each picture, where it is known.
    pub errors: Option<Vec<f64>>,
    /// relRMSE to expect of their sum in those radiances, where it is known.
    pub error_of_sum: Option<f64>,
    /// The camera of a sensor; a scene has none.
    pub camera: Option<SensorCamera>,
}

/// What stands in the list's file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    lights: Vec<Entry>,
    /// Of the sum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    estimated_error: Option<f64>,
}

impl List {
    /// A bare list of lights will do, which tells nothing of the sum.
    fn parse(bytes: &[u8]) -> serde_json::Result<Self> {
        match bytes.trim_ascii_start().first() {
            Some(b'[') => serde_json::from_slice(bytes).map(|lights| Self { lights, estimated_error: None }),
            _ => serde_json::from_slice(bytes),
        }
    }
}

/// A light of a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    light: String,
    file: String,
    radiance: [f32; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    estimated_error: Option<f64>,
}

/// Writes pictures, list and camera; the folder is made, and a basis that it held is removed. The list goes first and comes
/// last: what is cut short reads as no basis, never as one of two.
///
/// # Errors
/// When a file cannot be written, or an old one not removed.
pub fn write(folder: &Path, contents: &Contents) -> Result<(), Error> {
    let Contents { basis, radiances, errors, error_of_sum, camera } = contents;
    std::fs::create_dir_all(folder).map_err(|e| fault("write", folder, &e))?;
    // (Numbered pictures beside no list may be anybody's.)
    if folder.join(LIST).exists() {
        remove_files(folder)?;
    }
    // What was cut short may have left a camera, which would be taken for that of this one.
    remove_file(&folder.join(SENSOR))?;
    if let Some(camera) = camera {
        write_json(&folder.join(SENSOR), camera)?;
    }
    let entry = |(k, (light, radiance)): (usize, (&String, &Vec3))| {
        // Names come from files: what may stand in a file's name stays, the number keeps them apart.
        let plain = light.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
        let file = format!("{k}_{}.npy", plain.collect::<String>());
        let estimated_error = errors.as_ref().map(|errors| errors[k]);
        Entry { light: light.clone(), file, radiance: radiance.to_array(), estimated_error }
    };
    let lights: Vec<Entry> = basis.names.iter().zip(radiances).enumerate().map(entry).collect();
    for (entry, film) in lights.iter().zip(&basis.films) {
        film.write_npy(&folder.join(&entry.file))?;
    }
    write_json(&folder.join(LIST), &List { lights, estimated_error: *error_of_sum })
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let text = serde_json::to_string_pretty(value).map_err(|e| fault("write", path, &e))?;
    std::fs::write(path, text + "\n").map_err(|e| fault("write", path, &e))
}

fn read_camera(path: &Path) -> Result<Option<SensorCamera>, Error> {
    match std::fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|e| wrong(path, e.to_string())),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(fault("read", path, &e)),
    }
}

/// Removes what [`write`] wrote, and the folder if nothing else is in it.
///
/// # Errors
/// When something is there and cannot be removed.
pub fn remove(folder: &Path) -> Result<(), Error> {
    remove_files(folder)?;
    // (What is not ours stays, and its folder.)
    let _ = std::fs::remove_dir(folder);
    Ok(())
}

/// Removes a basis from a folder that stays, its list first.
fn remove_files(folder: &Path) -> Result<(), Error> {
    remove_file(&folder.join(LIST))?;
    let Ok(files) = std::fs::read_dir(folder) else { return Ok(()) };
    for path in files.flatten().map(|file| file.path()) {
        if path.file_name().and_then(|name| name.to_str()).is_some_and(is_of_basis) {
            remove_file(&path)?;
        }
    }
    Ok(())
}

/// Removes a file that may be there.
fn remove_file(path: &Path) -> Result<(), Error> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(fault("remove", path, &e)),
        _ => Ok(()),
    }
}

/// Whether a file's name is one that [`write`] gives: the list's, the sensor's, or that of a numbered picture.
fn is_of_basis(name: &str) -> bool {
    let numbered = |name: &str| name.split_once('_').is_some_and(|(k, _)| k.parse::<usize>().is_ok());
    name == LIST || name == SENSOR || (name.ends_with(".npy") && numbered(name))
}

/// Reads what [`write`] wrote.
///
/// # Errors
/// When a file is missing or is not what it should be; it is named.
pub fn read(folder: &Path) -> Result<Contents, Error> {
    let path = folder.join(LIST);
    let bytes = std::fs::read(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => no_basis(folder),
        _ => fault("read", &path, &e),
    })?;
    let wrong = |reason| wrong(&path, reason);
    let List { lights, estimated_error } = List::parse(&bytes).map_err(|e| wrong(e.to_string()))?;
    if let Some(entry) = lights.iter().find(|e| !is_radiance(Vec3::from_array(e.radiance))) {
        let Entry { light, radiance, .. } = entry;
        return Err(wrong(format!("the radiance of {light} is {radiance:?}, allowed are 0 to 1e12")));
    }
    let mut films = Vec::new();
    for entry in &lights {
        let path = folder.join(&entry.file);
        let bytes = std::fs::read(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                wrong(format!("{} is missing, its picture of light {:?}", entry.file, entry.light))
            }
            _ => fault("read", &path, &e),
        })?;
        films.push(Film::from_npy(&bytes, &path.display().to_string())?);
    }
    let size = |f: &Film| [f.width, f.height];
    if films.is_empty() || films.iter().any(|f| size(f) != size(&films[0])) {
        return Err(wrong("its pictures are none, or of several sizes".to_owned()));
    }
    let radiances = lights.iter().map(|e| Vec3::from_array(e.radiance)).collect();
    let errors = lights.iter().map(|e| e.estimated_error).collect();
    let basis = LightBasis { names: lights.into_iter().map(|e| e.light).collect(), films };
    let camera = read_camera(&folder.join(SENSOR))?;
    Ok(Contents { basis, radiances, errors, error_of_sum: estimated_error, camera })
}

/// A folder in which nothing was rendered light by light.
fn no_basis(folder: &Path) -> Error {
    let reason = match folder.is_dir() {
        true => format!("the folder holds no basis (no {LIST})"),
        false => "there is no such folder".to_owned(),
    };
    Error::Content {
        path: folder.display().to_string(),
        reason,
        next: "`twinrig render SCENE.json --out PICTURE --basis FOLDER`, or with a sensor for the scene, makes one, \
               `twinrig simulate RIG PLAN --out DIR --basis` one for each capture",
    }
}

fn wrong(path: &Path, reason: String) -> Error {
    Error::Content {
        path: path.display().to_string(),
        reason,
        next: "write the folder anew with `twinrig render` or `simulate --basis`",
    }
}

fn fault(action: &'static str, path: &Path, reason: &impl ToString) -> Error {
    Error::File { action, path: path.display().to_string(), reason: reason.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::sensor::ImageSpec;

    #[test]
    fn only_what_was_written_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["0_blue.npy", "12_.npy", LIST, SENSOR, "without_red.npy", "a_b.npy", "0_blue.png"];
        for name in names {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        remove(folder.path()).unwrap();
        let left = |name: &&str| folder.path().join(name).exists();
        assert_eq!(names.into_iter().filter(left).collect::<Vec<_>>(), &names[4..]);
    }

    #[test]
    fn a_basis_takes_the_place_of_another_and_half_of_one_reads_as_none() {
        let folder = tempfile::tempdir().unwrap();
        let of = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            let films = vec![Film { width: 1, height: 1, pixels: vec![Vec3::ONE] }; names.len()];
            let radiances = vec![Vec3::ONE; names.len()];
            let basis = LightBasis { names, films };
            Contents { basis, radiances, errors: None, error_of_sum: None, camera: None }
        };
        let files = || {
            let names = std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name());
            let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
            names.sort();
            names
        };
        for name in ["notes.txt", "3_mine.npy"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        write(folder.path(), &of(&["blue"])).unwrap();
        assert_eq!(files(), ["0_blue.npy", "3_mine.npy", LIST, "notes.txt"]);
        write(folder.path(), &of(&["blue", "red", "white"])).unwrap();
        write(folder.path(), &of(&["green"])).unwrap();
        assert_eq!(files(), ["0_green.npy", LIST, "notes.txt"]);
        // What is in a picture's way stops it: neither basis is there.
        std::fs::create_dir(folder.path().join("1_left.npy")).unwrap();
        write(folder.path(), &of(&["right", "left"])).unwrap_err();
        let told = read(folder.path()).unwrap_err().to_string();
        assert!(told.contains("holds no basis"), "{told}");
    }

    #[test]
    fn a_folder_gives_back_what_was_written_and_names_what_it_lacks() {
        let folder = std::env::temp_dir().join(format!("twinrig-basis-{}", std::process::id()));
        let film = |v: f32| Film { width: 3, height: 2, pixels: vec![Vec3::splat(v); 6] };
        let names = ["left / upper", "right"].map(str::to_owned).to_vec();
        let basis = LightBasis { names, films: vec![film(0.25), film(2.0)] };
        let radiances = vec![Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO];
        let image = ImageSpec { exposure: Some(0.4), gamma: Some(1.8), ..ImageSpec::default() };
        let camera = SensorCamera { image, file_gives_exposure: true, energies: vec![100.0, 7.5] };
        // A scene's basis in the folder of a sensor's leaves no camera behind.
        for (camera, errors, error_of_sum) in
            [(Some(camera), None, None), (None, Some(vec![0.004, 0.0025]), Some(0.003))]
        {
            let basis = basis.clone();
            let contents = Contents { basis, radiances: radiances.clone(), errors, error_of_sum, camera };
            write(&folder, &contents).unwrap();
            assert_eq!(read(&folder).unwrap(), contents);
        }
        // What is there but wrong is no matter of paths and permissions.
        let list = std::fs::read_to_string(folder.join(LIST)).unwrap();
        for (from, to, what) in [
            ("2.0", "-2.0", "allowed are 0 to 1e12"),
            ("2.0", "2e13", "allowed are 0 to 1e12"),
            ("radiance", "radience", "radience"),
        ] {
            std::fs::write(folder.join(LIST), list.replacen(from, to, 1)).unwrap();
            let told = read(&folder).unwrap_err().to_string();
            assert!(told.contains(what) && !told.contains("permissions"), "{told}");
        }
        // A list of nothing but lights is one.
        let mut lights: serde_json::Value = serde_json::from_str(&list).unwrap();
        std::fs::write(folder.join(LIST), lights["lights"].take().to_string()).unwrap();
        let alone = read(&folder).unwrap();
        assert_eq!((alone.errors, alone.error_of_sum), (Some(vec![0.004, 0.0025]), None));
        std::fs::write(folder.join(LIST), list).unwrap();
        let picture = folder.join("1_right.npy");
        let doubles = String::from_utf8_lossy(&film(2.0).to_npy()).replace("<f4", "<f8");
        std::fs::write(&picture, doubles).unwrap();
        let told = read(&folder).unwrap_err().to_string();
        assert!(told.contains("1_right.npy") && !told.contains("permissions"), "{told}");
        std::fs::remove_file(picture).unwrap();
        let told = read(&folder).unwrap_err().to_string();
        assert!(told.contains("1_right.npy is missing") && !told.contains("permissions"), "{told}");
        std::fs::remove_file(folder.join(LIST)).unwrap();
        let told = read(&folder).unwrap_err().to_string();
        assert!(told.contains("holds no basis") && told.contains("--basis FOLDER"), "{told}");
        std::fs::remove_dir_all(&folder).unwrap();
        let told = read(&folder).unwrap_err().to_string();
        assert!(told.contains("no such folder") && !told.contains("permissions"), "{told}");
    }
}
