//! The Huffman tables that motion JPEG leaves out.
//!
//! Cameras (UVC among them) send frames without tables and mean those of ITU-T T.81, annex K.3. A decoder of JPEG files
//! wants them in the file, so they are put in. The tables themselves are taken from what a baseline encoder
//! writes that uses the annex's; a test compares them with the standard's.

use image::codecs::jpeg::JpegEncoder;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::LazyLock;

const TABLES: u8 = 0xc4;
const SCAN: u8 = 0xda;

/// All four standard tables, as segments of a file.
static STANDARD: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut file = Vec::new();
    // A picture in colour has all of them. Writing into memory cannot fail.
    let encoded = JpegEncoder::new(&mut file).encode(&[128; 8 * 8 * 3], 8, 8, image::ExtendedColorType::Rgb8);
    match encoded {
        Ok(()) => {
            segments(&file).filter(|(m, _)| *m == TABLES).flat_map(|(_, at)| file[at].to_vec()).collect()
        }
        Err(_) => Vec::new(),
    }
});

/// The frame with Huffman tables: as it is, if it has some.
pub(super) fn with_tables(jpeg: &[u8]) -> Cow<'_, [u8]> {
    let begins = jpeg.starts_with(&[0xff, 0xd8]);
    if !begins || segments(jpeg).any(|(marker, _)| marker == TABLES) {
        return Cow::Borrowed(jpeg);
    }
    Cow::Owned([&jpeg[..2], &STANDARD, &jpeg[2..]].concat())
}

/// The segments before the first scan: their markers, and where they are.
fn segments(jpeg: &[u8]) -> impl Iterator<Item = (u8, Range<usize>)> {
    let mut at = 2;
    std::iter::from_fn(move || {
        let head = jpeg.get(at..at + 4)?;
        let (marker, length) = (head[1], usize::from(u16::from_be_bytes([head[2], head[3]])));
        if head[0] != 0xff || marker == SCAN {
            return None;
        }
        let range = at..at + 2 + length;
        at = range.end;
        (at <= jpeg.len()).then_some((marker, range))
    })
}

/// A file as a camera would send it.
#[cfg(test)]
pub(super) fn without_tables(jpeg: &[u8]) -> Vec<u8> {
    let mut out = jpeg.to_vec();
    let tables: Vec<_> = segments(jpeg).filter(|(m, _)| *m == TABLES).map(|(_, at)| at).collect();
    tables.into_iter().rev().for_each(|at| drop(out.drain(at)));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_those_of_the_standard() {
        let tables: Vec<&[u8]> =
            segments(&[&[0xff, 0xd8], STANDARD.as_slice(), &[0xff, SCAN, 0, 2]].concat())
                .map(|(_, at)| &STANDARD[at.start - 2..at.end - 2])
                .collect();
        // T.81 tables K.3 to K.6: class and id, sixteen counts, values.
        let body: Vec<u8> = tables.iter().flat_map(|t| t[4..].to_vec()).collect();
        let is_there = |part: &[u8]| body.windows(part.len()).any(|w| w == part);
        let dc_luma =
            [&[0x00, 0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0][..], &(0..12).collect::<Vec<u8>>()]
                .concat();
        let dc_chroma =
            [&[0x01, 0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0][..], &(0..12).collect::<Vec<u8>>()]
                .concat();
        assert!(is_there(&dc_luma) && is_there(&dc_chroma), "{body:02x?}");
        let ac_luma =
            [0x10, 0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d, 0x01, 0x02, 0x03, 0x00, 0x04, 0x11];
        let ac_chroma =
            [0x11, 0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77, 0x00, 0x01, 0x02, 0x03, 0x11, 0x04];
        assert!(is_there(&ac_luma) && is_there(&ac_chroma), "{body:02x?}");
        assert_eq!(body.len(), 2 * (1 + 16 + 12) + 2 * (1 + 16 + 162));
    }

    #[test]
    fn what_is_no_jpeg_or_has_its_tables_stays_as_it_is() {
        for bytes in [&[][..], &[0xff], &[0xff, 0xd8, 0xff, TABLES, 0, 2, 0xff, SCAN, 0, 2], b"not a picture"]
        {
            assert_eq!(with_tables(bytes).as_ref(), bytes);
        }
    }
}
