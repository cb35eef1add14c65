//! One picture a light in a folder: `<light>.npy`, linear RGB float32 for radiance 1, and `basis.json`, which names the
//! lights in order with the radiances that the scene has for them.

use super::{Error, Film, LightBasis};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The list beside the pictures.
const LIST: &str = "basis.json";

/// A light of a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    light: String,
    file: String,
    radiance: [f32; 3],
}

/// Writes pictures and list; the folder is made.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, basis: &LightBasis, radiances: &[Vec3]) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(|e| fault("write", folder, &e))?;
    let entry = |(k, (light, radiance)): (usize, (&String, &Vec3))| {
        // Names come from files: what may stand in a file's name stays, the number keeps them apart.
        let plain = light.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
        let file = format!("{k}_{}.npy", plain.collect::<String>());
        Entry { light: light.clone(), file, radiance: radiance.to_array() }
    };
    let list: Vec<Entry> = basis.names.iter().zip(radiances).enumerate().map(entry).collect();
    for (entry, film) in list.iter().zip(&basis.films) {
        film.write_npy(&folder.join(&entry.file))?;
    }
    let path = folder.join(LIST);
    let text = serde_json::to_string_pretty(&list).map_err(|e| fault("write", &path, &e))?;
    std::fs::write(&path, text + "\n").map_err(|e| fault("write", &path, &e))
}

/// Reads what [`write`] wrote: the pictures, and the scene's radiances.
///
/// # Errors
/// When a file is missing or is not what it should be; it is named.
pub fn read(folder: &Path) -> Result<(LightBasis, Vec<Vec3>), Error> {
    let path = folder.join(LIST);
    let text = std::fs::read_to_string(&path).map_err(|e| fault("read", &path, &e))?;
    let list: Vec<Entry> = serde_json::from_str(&text).map_err(|e| fault("read", &path, &e))?;
    let mut films = Vec::new();
    for entry in &list {
        let path = folder.join(&entry.file);
        let bytes = std::fs::read(&path).map_err(|e| fault("read", &path, &e))?;
        films.push(Film::from_npy(&bytes, &path.display().to_string())?);
    }
    let size = |f: &Film| [f.width, f.height];
    if films.is_empty() || films.iter().any(|f| size(f) != size(&films[0])) {
        return Err(fault("read", &path, &"its pictures are none, or of several sizes"));
    }
    let radiances = list.iter().map(|e| Vec3::from_array(e.radiance)).collect();
    Ok((LightBasis { names: list.into_iter().map(|e| e.light).collect(), films }, radiances))
}

fn fault(action: &'static str, path: &Path, reason: &impl ToString) -> Error {
    Error::File { action, path: path.display().to_string(), reason: reason.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_gives_back_what_was_written_and_names_what_it_lacks() {
        let folder = std::env::temp_dir().join(format!("twinrig-basis-{}", std::process::id()));
        let film = |v: f32| Film { width: 3, height: 2, pixels: vec![Vec3::splat(v); 6] };
        let names = ["left / upper", "right"].map(str::to_owned).to_vec();
        let basis = LightBasis { names, films: vec![film(0.25), film(2.0)] };
        let radiances = [Vec3::new(1.0, 2.0, 3.0), Vec3::ZERO];
        write(&folder, &basis, &radiances).unwrap();
        assert_eq!(read(&folder).unwrap(), (basis, radiances.to_vec()));
        std::fs::remove_file(folder.join("1_right.npy")).unwrap();
        assert!(read(&folder).unwrap_err().to_string().contains("1_right.npy"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
