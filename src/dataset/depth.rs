//! Depth maps: single-channel float32 TIFF, mm, pad-frame height, negative when pressed.
//!
//! Float because a press of a millimetre would be one step of the usual 16-bit millimetres; TIFF because
//! every image library reads it losslessly (PIL's mode F).

use super::Error;
use std::io::Cursor;
use std::path::Path;
use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype::Gray32Float};

/// Encodes a depth map, row 0 on top.
pub fn encode(width: u32, height: u32, depth_mm: &[f32]) -> Result<Vec<u8>, Error> {
    let failed = |e: tiff::TiffError| Error::Encode { what: "depth map", why: e.to_string() };
    let mut bytes = Cursor::new(Vec::new());
    TiffEncoder::new(&mut bytes)
        .map_err(failed)?
        .with_compression(Compression::Deflate(DeflateLevel::Fast))
        .write_image::<Gray32Float>(width, height, depth_mm)
        .map_err(failed)?;
    Ok(bytes.into_inner())
}

/// Decodes a depth map: width, height, values.
pub fn decode(bytes: &[u8], path: &Path) -> Result<(u32, u32, Vec<f32>), Error> {
    let failed = |why: String| Error::Decode { path: path.to_owned(), why };
    let mut decoder = tiff::decoder::Decoder::new(Cursor::new(bytes)).map_err(|e| failed(e.to_string()))?;
    let (width, height) = decoder.dimensions().map_err(|e| failed(e.to_string()))?;
    match decoder.read_image().map_err(|e| failed(e.to_string()))? {
        tiff::decoder::DecodingResult::F32(values) => Ok((width, height, values)),
        _ => Err(failed("the samples are not float32".into())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_survives_to_the_last_bit() {
        let values: Vec<f32> = (0..640 * 48).map(|i| -1e-3 * (i as f32).sqrt()).collect();
        let bytes = encode(640, 48, &values).expect("encodes");
        assert!(bytes.len() < values.len() * 4);
        assert_eq!(decode(&bytes, Path::new("x")).expect("decodes"), (640, 48, values));
    }
}
