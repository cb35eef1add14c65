//! Pixel formats: from what a camera sends to upright 8-bit RGB.
//!
//! YUV is taken as full-swing or studio-swing BT.601, as V4L2 prescribes for cameras: YUYV and NV12 are
//! studio swing (16 to 235), JPEG is full swing and decoded by the `image` crate. Bayer mosaics are
//! interpolated bilinearly in [`bayer`]. A buffer that is too short is an error, never a grey corner.
//! Rows may be padded (`stride`); no scaling, no colour correction happens here.

mod bayer;
mod huffman;

use bayer::Mosaic;
use image::ImageFormat;

/// The formats that can be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// Packed 4:2:2, two pixels in four bytes.
    Yuyv,
    /// Packed 4:2:2, chroma first.
    Uyvy,
    /// Motion JPEG: each frame one JPEG file, perhaps without its Huffman tables.
    Mjpg,
    /// One byte of luma.
    Grey,
    /// A luma plane, then interleaved chroma at half resolution.
    Nv12,
    /// Red, green, blue.
    Rgb3,
    /// Blue, green, red.
    Bgr3,
    /// 8-bit mosaic, first row red green.
    BayerRggb,
    /// 8-bit mosaic, first row green red.
    BayerGrbg,
    /// 8-bit mosaic, first row green blue.
    BayerGbrg,
    /// 8-bit mosaic, first row blue green.
    BayerBggr,
}

/// All formats with their fourccs, the one that loses least first.
const FOURCCS: [(&str, PixelFormat); 12] = [
    ("RGB3", PixelFormat::Rgb3),
    ("BGR3", PixelFormat::Bgr3),
    ("RGGB", PixelFormat::BayerRggb),
    ("GRBG", PixelFormat::BayerGrbg),
    ("GBRG", PixelFormat::BayerGbrg),
    ("BA81", PixelFormat::BayerBggr),
    ("YUYV", PixelFormat::Yuyv),
    ("UYVY", PixelFormat::Uyvy),
    ("NV12", PixelFormat::Nv12),
    ("MJPG", PixelFormat::Mjpg),
    ("JPEG", PixelFormat::Mjpg),
    ("GREY", PixelFormat::Grey),
];

impl PixelFormat {
    /// The format of a fourcc, if it can be decoded.
    pub fn from_fourcc(fourcc: &str) -> Option<Self> {
        FOURCCS.iter().find(|(name, _)| *name == fourcc).map(|(_, format)| *format)
    }

    /// The fourccs that can be decoded, the one that loses least first.
    pub fn names() -> Vec<&'static str> {
        FOURCCS.iter().map(|(name, _)| *name).collect()
    }

    /// Bytes of a row without padding; 0 where rows mean nothing.
    fn row_bytes(self, width: usize) -> usize {
        match self {
            PixelFormat::Yuyv | PixelFormat::Uyvy => width.div_ceil(2) * 4,
            PixelFormat::Rgb3 | PixelFormat::Bgr3 => width * 3,
            PixelFormat::Mjpg => 0,
            _ => width,
        }
    }
}

/// Why a buffer is no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The buffer ends before the picture does.
    #[error("{got} bytes where {needed} are needed")]
    TooShort {
        /// Bytes needed for the negotiated size.
        needed: usize,
        /// Bytes in the buffer.
        got: usize,
    },
    /// The rows cannot hold the pixels.
    #[error("rows of {stride} bytes cannot hold {width} pixels")]
    Stride {
        /// Bytes a row, as the driver says.
        stride: usize,
        /// Pixels a row.
        width: usize,
    },
    /// The JPEG is damaged.
    #[error("JPEG: {0}")]
    Jpeg(String),
    /// The JPEG has another size than the mode.
    #[error("JPEG of {got_width} x {got_height} where {width} x {height} was negotiated")]
    JpegSize {
        /// Negotiated width.
        width: u32,
        /// Negotiated height.
        height: u32,
        /// Width in the file.
        got_width: u32,
        /// Height in the file.
        got_height: u32,
    },
}

/// Decodes one buffer to `height * width * 3` bytes of RGB. `stride` 0 means rows without padding.
pub fn decode(
    format: PixelFormat,
    bytes: &[u8],
    width: u32,
    height: u32,
    stride: u32,
) -> Result<Vec<u8>, DecodeError> {
    if format == PixelFormat::Mjpg {
        return decode_jpeg(bytes, width, height);
    }
    let (w, h) = (width as usize, height as usize);
    let row = format.row_bytes(w);
    let stride = if stride == 0 { row } else { stride as usize };
    if stride < row {
        return Err(DecodeError::Stride { stride, width: w });
    }
    // The last row needs no padding behind it.
    let luma_rows = h;
    let chroma_rows = if format == PixelFormat::Nv12 { h.div_ceil(2) } else { 0 };
    let needed = stride * (luma_rows + chroma_rows).saturating_sub(1) + row;
    if bytes.len() < needed {
        return Err(DecodeError::TooShort { needed, got: bytes.len() });
    }
    let mut rgb = vec![0; w * h * 3];
    let rows = rgb.chunks_exact_mut(w * 3).zip(bytes.chunks(stride));
    match format {
        PixelFormat::Yuyv => rows.for_each(|(out, line)| packed_yuv(out, line, [0, 1, 2, 3])),
        PixelFormat::Uyvy => rows.for_each(|(out, line)| packed_yuv(out, line, [1, 0, 3, 2])),
        PixelFormat::Grey => rows.for_each(|(out, line)| {
            out.chunks_exact_mut(3).zip(line).for_each(|(p, y)| p.fill(*y));
        }),
        PixelFormat::Rgb3 => rows.for_each(|(out, line)| out.copy_from_slice(&line[..row])),
        PixelFormat::Bgr3 => rows.for_each(|(out, line)| {
            for (p, q) in out.chunks_exact_mut(3).zip(line.chunks_exact(3)) {
                p.copy_from_slice(&[q[2], q[1], q[0]]);
            }
        }),
        PixelFormat::Nv12 => {
            let chroma = &bytes[stride * h..];
            for (y, (out, line)) in rows.enumerate() {
                let uv = &chroma[(y / 2) * stride..];
                for (x, (p, luma)) in out.chunks_exact_mut(3).zip(line).enumerate() {
                    p.copy_from_slice(&yuv_to_rgb(*luma, uv[x & !1], uv[(x & !1) + 1]));
                }
            }
        }
        PixelFormat::BayerRggb => bayer::interpolate(&mut rgb, bytes, w, h, stride, Mosaic { red: (0, 0) }),
        PixelFormat::BayerGrbg => bayer::interpolate(&mut rgb, bytes, w, h, stride, Mosaic { red: (1, 0) }),
        PixelFormat::BayerGbrg => bayer::interpolate(&mut rgb, bytes, w, h, stride, Mosaic { red: (0, 1) }),
        PixelFormat::BayerBggr => bayer::interpolate(&mut rgb, bytes, w, h, stride, Mosaic { red: (1, 1) }),
        PixelFormat::Mjpg => unreachable!("JPEG is decoded above"),
    }
    Ok(rgb)
}

/// One row of 4:2:2; `order` says where first luma, U, second luma and V stand.
fn packed_yuv(out: &mut [u8], line: &[u8], order: [usize; 4]) {
    for (two, q) in out.chunks_mut(6).zip(line.chunks_exact(4)) {
        let (u, v) = (q[order[1]], q[order[3]]);
        for (p, luma) in two.chunks_exact_mut(3).zip([q[order[0]], q[order[2]]]) {
            p.copy_from_slice(&yuv_to_rgb(luma, u, v));
        }
    }
}

/// Studio-swing BT.601 (ITU-R BT.601-7, section 2.5) in 16.16 fixed point.
fn yuv_to_rgb(y: u8, u: u8, v: u8) -> [u8; 3] {
    // 255/219 for luma; 255/224 times 1.402, 0.344136, 0.714136, 1.772 for chroma.
    let y = 76_309 * (i32::from(y) - 16) + 32_768;
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let code = |x: i32| (x >> 16).clamp(0, 255) as u8;
    [code(y + 104_597 * v), code(y - 25_675 * u - 53_279 * v), code(y + 132_201 * u)]
}

fn decode_jpeg(bytes: &[u8], width: u32, height: u32) -> Result<Vec<u8>, DecodeError> {
    let complete = huffman::with_tables(bytes);
    let picture = image::load_from_memory_with_format(&complete, ImageFormat::Jpeg)
        .map_err(|e| DecodeError::Jpeg(e.to_string()))?
        .into_rgb8();
    if picture.dimensions() != (width, height) {
        let (got_width, got_height) = picture.dimensions();
        return Err(DecodeError::JpegSize { width, height, got_width, got_height });
    }
    Ok(picture.into_raw())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forward BT.601 by its definition, as truth for the inverse in fixed point.
    fn rgb_to_yuv(rgb: [u8; 3]) -> [u8; 3] {
        let [r, g, b] = rgb.map(|c| f64::from(c) / 255.0);
        let y = 0.299 * r + 0.587 * g + 0.114 * b;
        let (u, v) = ((b - y) / 1.772, (r - y) / 1.402);
        [16.0 + 219.0 * y, 128.0 + 224.0 * u, 128.0 + 224.0 * v].map(|c| c.round() as u8)
    }

    fn near(a: &[u8], b: &[u8], tolerance: i32) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (i32::from(*a) - i32::from(*b)).abs() <= tolerance)
    }

    #[test]
    fn yuv_formats_return_the_colours_they_were_made_from() {
        for colour in [[255, 255, 255], [0, 0, 0], [200, 40, 90], [10, 220, 30], [60, 70, 250]] {
            let [y, u, v] = rgb_to_yuv(colour);
            let expected: Vec<u8> = colour.repeat(8);
            let yuyv = [y, u, y, v].repeat(4);
            assert!(near(&decode(PixelFormat::Yuyv, &yuyv, 4, 2, 0).unwrap(), &expected, 3));
            let uyvy = [u, y, v, y].repeat(4);
            assert!(near(&decode(PixelFormat::Uyvy, &uyvy, 4, 2, 0).unwrap(), &expected, 3));
            let nv12 = [vec![y; 8], [u, v].repeat(2)].concat();
            assert!(near(&decode(PixelFormat::Nv12, &nv12, 4, 2, 0).unwrap(), &expected, 3));
        }
    }

    #[test]
    fn padding_is_skipped_and_channels_are_in_order() {
        let padded = [1, 2, 3, 4, 5, 6, 99, 99, 7, 8, 9, 10, 11, 12];
        assert_eq!(
            decode(PixelFormat::Rgb3, &padded, 2, 2, 8).unwrap(),
            [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
        );
        assert_eq!(
            decode(PixelFormat::Bgr3, &padded, 2, 2, 8).unwrap(),
            [3, 2, 1, 6, 5, 4, 9, 8, 7, 12, 11, 10]
        );
        assert_eq!(decode(PixelFormat::Grey, &[5, 0, 6], 1, 2, 2).unwrap(), [5, 5, 5, 6, 6, 6]);
    }

    #[test]
    fn a_short_or_misshapen_buffer_is_an_error() {
        for fourcc in PixelFormat::names() {
            let format = PixelFormat::from_fourcc(fourcc).unwrap();
            assert!(decode(format, &[0; 31], 8, 8, 0).is_err(), "{fourcc}");
        }
        assert_eq!(
            decode(PixelFormat::Yuyv, &[0; 64], 8, 4, 8),
            Err(DecodeError::Stride { stride: 8, width: 8 })
        );
        assert_eq!(
            decode(PixelFormat::Yuyv, &[0; 63], 8, 4, 0),
            Err(DecodeError::TooShort { needed: 64, got: 63 })
        );
    }

    #[test]
    fn a_jpeg_frame_must_have_the_negotiated_size() {
        let picture = image::RgbImage::from_pixel(16, 8, image::Rgb([180, 90, 40]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
        let bytes = bytes.into_inner();
        let rgb = decode(PixelFormat::Mjpg, &bytes, 16, 8, 0).unwrap();
        assert!(near(&rgb, picture.as_raw(), 4));
        assert!(matches!(decode(PixelFormat::Mjpg, &bytes, 8, 16, 0), Err(DecodeError::JpegSize { .. })));
        assert!(matches!(decode(PixelFormat::Mjpg, &bytes[..40], 16, 8, 0), Err(DecodeError::Jpeg(_))));
    }

    #[test]
    fn motion_jpeg_comes_without_huffman_tables_and_with_bytes_behind_it() {
        let picture =
            image::RgbImage::from_fn(32, 16, |x, y| image::Rgb([(x * 7) as u8, (y * 13) as u8, 90]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
        let whole = bytes.into_inner();
        let expected = decode(PixelFormat::Mjpg, &whole, 32, 16, 0).unwrap();
        // UVC cameras leave the standard tables out, and pad their buffers.
        let mut bare = huffman::without_tables(&whole);
        assert!(bare.len() < whole.len(), "there were tables");
        bare.extend([0; 64]);
        assert_eq!(decode(PixelFormat::Mjpg, &bare, 32, 16, 0).unwrap(), expected);
        assert!(decode(PixelFormat::Mjpg, &[], 32, 16, 0).is_err());
    }

    #[test]
    fn chroma_belongs_to_its_own_pixels() {
        let (red, blue) = ([200, 30, 40], [20, 50, 210]);
        let ([yr, ur, vr], [yb, ub, vb]) = (rgb_to_yuv(red), rgb_to_yuv(blue));
        // Two pixels of one colour, then two of the other, also in padded rows.
        let yuyv: Vec<u8> = [[yr, ur, yr, vr], [yb, ub, yb, vb]].concat();
        let expected = [red, red, blue, blue].concat();
        assert!(near(&decode(PixelFormat::Yuyv, &yuyv, 4, 1, 0).unwrap(), &expected, 3));
        // Red above, blue below, two rows each; rows of 4 pixels in 6 bytes.
        let row = |y: u8| [y, y, y, y, 0, 0];
        let luma = [row(yr), row(yr), row(yb), row(yb)].concat();
        let chroma = [[ur, vr, ur, vr, 0, 0], [ub, vb, ub, vb, 0, 0]].concat();
        let nv12 = [luma, chroma].concat();
        let expected = [red.repeat(8), blue.repeat(8)].concat();
        assert!(near(&decode(PixelFormat::Nv12, &nv12, 4, 4, 6).unwrap(), &expected, 3));
        // An odd width has half a chroma pair at its end.
        let odd = decode(PixelFormat::Yuyv, &[yr, ur, yr, vr, yb, ub, 0, vb], 3, 1, 0).unwrap();
        assert!(near(&odd, &[red, red, blue].concat(), 3), "{odd:?}");
    }

    #[test]
    fn every_mosaic_is_read_in_its_own_order() {
        // One 2 x 2 cell, repeated: red 200, green 100, blue 50, in the order of each name.
        let code = |c: char| match c {
            'R' => 200,
            'G' => 100,
            _ => 50,
        };
        for (fourcc, cell) in [("RGGB", "RGGB"), ("GRBG", "GRBG"), ("GBRG", "GBRG"), ("BA81", "BGGR")] {
            let c: Vec<u8> = cell.chars().map(code).collect();
            let rows = [[c[0], c[1]].repeat(3), [c[2], c[3]].repeat(3)].concat().repeat(2);
            let format = PixelFormat::from_fourcc(fourcc).unwrap();
            let rgb = decode(format, &rows, 6, 4, 0).unwrap();
            assert!(rgb.chunks_exact(3).all(|p| p == [200, 100, 50]), "{fourcc}: {rgb:?}");
        }
    }
}
