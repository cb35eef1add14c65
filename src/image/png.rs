//! PNG in memory: 8-bit RGB and masks, in both directions.

use super::{Error, Mask, Picture, View};
use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder, ImageFormat};

/// Encodes a picture, losslessly.
///
/// # Errors
/// When the buffer does not match the size.
pub fn encode<'a>(picture: impl Into<View<'a>>) -> Result<Vec<u8>, Error> {
    let view = picture.into();
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive).write_image(
        view.rgb,
        view.width,
        view.height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// Decodes a PNG or JPEG of any depth into 8-bit RGB.
///
/// # Errors
/// When the bytes are no such picture.
pub fn decode(bytes: &[u8]) -> Result<Picture, Error> {
    let format = ::image::guess_format(bytes).unwrap_or(ImageFormat::Png);
    let decoded = ::image::load_from_memory_with_format(bytes, format)?.into_rgb8();
    Ok(Picture { width: decoded.width(), height: decoded.height(), rgb: decoded.into_raw() })
}

/// Encodes a mask: 255 inside, 0 outside, 8-bit grey.
///
/// # Errors
/// When the buffer does not match the size.
pub fn encode_mask(mask: &Mask) -> Result<Vec<u8>, Error> {
    let grey: Vec<u8> = mask.inside.iter().map(|&i| if i { 255 } else { 0 }).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(&grey, mask.width, mask.height, ExtendedColorType::L8)?;
    Ok(bytes)
}

/// Decodes a mask: every pixel of at least half brightness is inside.
///
/// # Errors
/// When the bytes are no picture.
pub fn decode_mask(bytes: &[u8]) -> Result<Mask, Error> {
    let grey = ::image::load_from_memory(bytes)?.into_luma8();
    let inside = grey.as_raw().iter().map(|&v| v >= 128).collect();
    Ok(Mask { width: grey.width(), height: grey.height(), inside })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_in_comes_out() {
        let picture = Picture { width: 5, height: 7, rgb: (0..105).map(|i| (i * 37 % 251) as u8).collect() };
        assert_eq!(decode(&encode(&picture).unwrap()).unwrap(), picture);
        let mask = Mask::from_fn(9, 4, |x, y| (x + y) % 3 == 0);
        assert_eq!(decode_mask(&encode_mask(&mask).unwrap()).unwrap(), mask);
        assert!(decode(b"no picture at all").is_err());
    }
}
