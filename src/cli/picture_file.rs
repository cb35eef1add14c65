//! Where a linear picture goes and comes from: `.npy` keeps it as it is, `.png` shows it, as the sensor's camera does where
//! there is one.

use crate::image::{Picture, png};
use crate::optics::film::srgb_to_linear;
use crate::optics::sensor_basis::SensorCamera;
use crate::optics::{Error, Film};
use glam::Vec3;
use std::fs::OpenOptions;
use std::io;
use std::path::{Path, PathBuf};

/// Exposure of a picture for a look: that of the benchmark scene's 8-bit metric.
const PREVIEW_EXPOSURE: f32 = 0.573_248_4;

/// A file's name whose ending says a format that can be written.
pub(super) fn parse(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("npy" | "png") => Ok(path),
        Some(other) => Err(format!(
            "pictures are not written as .{other}; end the name with .npy (linear float32) or .png (a look)"
        )),
        None => Err("it has no ending; end the name with .npy (linear float32) or .png (a look)".to_owned()),
    }
}

/// A picture that was read.
pub(super) struct Read {
    /// Its light.
    pub film: Film,
    /// By pixel, whether it tells how bright its light was: one at the end of the scale does not.
    pub tells: Vec<bool>,
    /// Whether the light is that on a sensor's chip: a photograph tells of no other.
    pub is_on_chip: bool,
}

/// Reads a picture: `.npy` as it is; 8 bit as the sensor's camera gives it, or without one as a camera with the sRGB
/// response, exposed as [`write`] exposes.
pub(super) fn read(path: &Path, camera: Option<&SensorCamera>) -> Result<Read, Error> {
    let failed = |reason: String| Error::File { action: "read", path: path.display().to_string(), reason };
    let bytes = std::fs::read(path).map_err(|e| failed(e.to_string()))?;
    if path.extension().is_some_and(|e| e == "npy") {
        let film = Film::from_npy(&bytes, &path.display().to_string())?;
        let tells = film.pixels.iter().map(|p| p.is_finite()).collect();
        return Ok(Read { film, tells, is_on_chip: false });
    }
    let picture = png::decode(&bytes).map_err(|e| Error::Content {
        path: path.display().to_string(),
        reason: e.to_string(),
        next: "give a picture as .npy (linear float32), .png or .jpg",
    })?;
    let [width, height] = [picture.width as usize, picture.height as usize];
    if let Some(camera) = camera {
        let (film, tells) = camera.undone(width, height, &picture.rgb);
        return Ok(Read { film, tells, is_on_chip: true });
    }
    let mut film = Film::new(width, height);
    let mut tells = Vec::with_capacity(film.pixels.len());
    for (pixel, codes) in film.pixels.iter_mut().zip(picture.rgb.chunks_exact(3)) {
        let light = |c: usize| srgb_to_linear(codes[c]) / PREVIEW_EXPOSURE;
        *pixel = Vec3::new(light(0), light(1), light(2));
        tells.push(!codes.contains(&u8::MAX));
    }
    Ok(Read { film, tells, is_on_chip: false })
}

/// Whether a picture can be written there: told before the work of rendering it. Nothing is left behind.
///
/// # Errors
/// What writing it would end with.
pub(super) fn can_be_written(path: &Path) -> Result<(), Error> {
    let tried = match path.metadata() {
        Ok(there) if there.is_file() => OpenOptions::new().append(true).open(path).map(drop),
        Ok(there) if there.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
        // Opening a pipe to look at it would end what reads from it.
        Ok(_) => Ok(()),
        Err(_) => made_and_removed(path),
    };
    tried.map_err(|e| unwritable(path, &e))
}

/// The same of a folder that may have to be made first.
///
/// # Errors
/// What filling it would end with.
pub(super) fn can_be_filled(folder: &Path) -> Result<(), Error> {
    let there = folder.ancestors().find(|a| a.exists()).unwrap_or(Path::new("."));
    let probe = there.join(format!(".twinrig-{}", std::process::id()));
    made_and_removed(&probe).map_err(|e| unwritable(folder, &e))
}

fn made_and_removed(path: &Path) -> io::Result<()> {
    OpenOptions::new().write(true).create_new(true).open(path).map(drop)?;
    std::fs::remove_file(path)
}

fn unwritable(path: &Path, error: &io::Error) -> Error {
    Error::File { action: "write", path: path.display().to_string(), reason: error.to_string() }
}

/// Writes the picture in the format that the ending says.
pub(super) fn write(path: &Path, film: &Film, camera: Option<&SensorCamera>) -> Result<(), Error> {
    if path.extension().is_none_or(|e| e != "png") {
        return film.write_npy(path);
    }
    let failed = |reason: String| Error::File { action: "write", path: path.display().to_string(), reason };
    let rgb = camera.map_or_else(|| film.to_srgb8(PREVIEW_EXPOSURE), |camera| camera.picture(film));
    let picture = Picture { width: film.width as u32, height: film.height as u32, rgb };
    let bytes = png::encode(&picture).map_err(|e| failed(e.to_string()))?;
    std::fs::write(path, bytes).map_err(|e| failed(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_for_a_look_reads_as_the_same_light_but_where_it_was_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("look.png");
        let mut film = Film::new(3, 1);
        film.pixels = vec![Vec3::new(0.2, 0.5, 1.0), Vec3::splat(5.0), Vec3::ZERO];
        write(&path, &film, None).unwrap();
        let found = read(&path, None).unwrap();
        assert_eq!(found.tells, [true, false, true]);
        let pixels = found.film.pixels;
        // Half a code value near 1 is 1 % of the light.
        assert!((pixels[0] / film.pixels[0] - 1.0).abs().max_element() < 0.01, "{}", pixels[0]);
        assert_eq!(pixels[2], Vec3::ZERO);
    }

    #[test]
    fn places_that_take_no_picture_are_told_beforehand_and_those_that_do_are_left_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("there.npy"), "what was there").unwrap();
        for good in ["there.npy", "new.npy"] {
            can_be_written(&at(good)).unwrap();
        }
        for bad in ["", "none/a.npy", "there.npy/a.npy"] {
            assert!(can_be_written(&at(bad)).unwrap_err().to_string().contains("cannot write"), "{bad}");
        }
        for good in ["", "new", "new/inner"] {
            can_be_filled(&at(good)).unwrap();
        }
        for bad in ["there.npy", "there.npy/inner"] {
            assert!(can_be_filled(&at(bad)).unwrap_err().to_string().contains("cannot write"), "{bad}");
        }
        can_be_filled(Path::new("no-such-folder")).unwrap();
        let left: Vec<_> =
            std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, ["there.npy"]);
        assert_eq!(std::fs::read_to_string(at("there.npy")).unwrap(), "what was there");
    }

    #[test]
    fn endings_that_cannot_be_written_are_refused_with_those_that_can() {
        assert!(super::parse("a/b.npy").is_ok() && super::parse("b.png").is_ok());
        for name in ["x.jpg", "x.exr", "x", "npy"] {
            let message = super::parse(name).unwrap_err();
            assert!(message.contains(".npy") && message.contains(".png"), "{message}");
        }
    }
}
