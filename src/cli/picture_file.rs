//! Where a linear picture goes: `.npy` keeps it as it is, `.png` shows it.

use crate::image::{Picture, png};
use crate::optics::{Error, Film};
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

/// Writes the picture in the format that the ending says.
pub(super) fn write(path: &Path, film: &Film) -> Result<(), Error> {
    if path.extension().is_none_or(|e| e != "png") {
        return film.write_npy(path);
    }
    let failed = |reason: String| Error::File { action: "write", path: path.display().to_string(), reason };
    let rgb = film.to_srgb8(PREVIEW_EXPOSURE);
    let picture = Picture { width: film.width as u32, height: film.height as u32, rgb };
    let bytes = png::encode(&picture).map_err(|e| failed(e.to_string()))?;
    std::fs::write(path, bytes).map_err(|e| failed(e.to_string()))
}

#[cfg(test)]
mod tests {
    #[test]
    fn endings_that_cannot_be_written_are_refused_with_those_that_can() {
        assert!(super::parse("a/b.npy").is_ok() && super::parse("b.png").is_ok());
        for name in ["x.jpg", "x.exr", "x", "npy"] {
            let message = super::parse(name).unwrap_err();
            assert!(message.contains(".npy") && message.contains(".png"), "{message}");
        }
    }
}
