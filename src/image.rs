//! Pictures: comparing them, aligning them, averaging them, and PNG.
//!
//! Everything here works on 8-bit RGB code values, row 0 on top, as sensors deliver them and as the
//! literature compares them. [`metrics`] has MSE, PSNR and SSIM, whole or within a [`Mask`]; [`align`]
//! finds and removes a global shift; [`bootstrap`] says how sure a mean difference is; [`arithmetic`]
//! averages and subtracts; [`png`] encodes and decodes; [`npy`] writes what is not 8 bit. It knows no dataset and no sensor.

pub mod align;
pub mod arithmetic;
pub mod bootstrap;
pub mod metrics;
pub mod npy;
pub mod palette;
pub mod png;

use crate::frame::Frame;

/// An 8-bit RGB picture that belongs to no camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `height * width * 3` code values.
    pub rgb: Vec<u8>,
}

/// Borrowed pixels: what every function here reads.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `height * width * 3` code values.
    pub rgb: &'a [u8],
}

impl<'a> From<&'a Frame> for View<'a> {
    fn from(f: &'a Frame) -> Self {
        View { width: f.width, height: f.height, rgb: &f.rgb }
    }
}

impl<'a> From<&'a Picture> for View<'a> {
    fn from(p: &'a Picture) -> Self {
        View { width: p.width, height: p.height, rgb: &p.rgb }
    }
}

impl View<'_> {
    /// An owned copy.
    pub fn to_picture(self) -> Picture {
        Picture { width: self.width, height: self.height, rgb: self.rgb.to_vec() }
    }

    /// The code values of one pixel.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let i = (y as usize * self.width as usize + x as usize) * 3;
        [self.rgb[i], self.rgb[i + 1], self.rgb[i + 2]]
    }

    /// A copy of the rectangle of `width` by `height` whose top left corner is (`x`, `y`).
    ///
    /// # Errors
    /// When the rectangle is empty or leaves the picture.
    pub fn crop(&self, x: u32, y: u32, width: u32, height: u32) -> Result<Picture, Error> {
        let fits = |start: u32, length: u32, all: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
        };
        if !fits(x, width, self.width) || !fits(y, height, self.height) {
            return Err(Error::Crop { x, y, width, height, picture: (self.width, self.height) });
        }
        let row = |j: u32| {
            let i = ((y + j) as usize * self.width as usize + x as usize) * 3;
            &self.rgb[i..i + width as usize * 3]
        };
        Ok(Picture { width, height, rgb: (0..height).flat_map(row).copied().collect() })
    }
}

/// A set of pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Row by row, whether the pixel belongs to it.
    pub inside: Vec<bool>,
}

/// A rectangle of pixels: columns x0 to x1 and rows y0 to y1, the upper ends excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct PixelBox {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// One past the last column.
    pub x1: u32,
    /// One past the last row.
    pub y1: u32,
}

impl Mask {
    /// The pixels for which `inside(x, y)` holds.
    pub fn from_fn(width: u32, height: u32, mut inside: impl FnMut(u32, u32) -> bool) -> Mask {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            pixels.extend((0..width).map(|x| inside(x, y)));
        }
        Mask { width, height, inside: pixels }
    }

    /// The pixels of a rectangle, as far as it lies in the picture.
    pub fn from_box(width: u32, height: u32, b: PixelBox) -> Mask {
        Self::from_fn(width, height, |x, y| (b.x0..b.x1).contains(&x) && (b.y0..b.y1).contains(&y))
    }

    /// Number of pixels.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&i| i).count()
    }

    /// The smallest rectangle around all its pixels; `None` when it has none.
    pub fn bounds(&self) -> Option<PixelBox> {
        let mut bounds: Option<PixelBox> = None;
        for (i, _) in self.inside.iter().enumerate().filter(|(_, inside)| **inside) {
            let (x, y) = ((i % self.width as usize) as u32, (i / self.width as usize) as u32);
            let b = bounds.get_or_insert(PixelBox { x0: x, y0: y, x1: x + 1, y1: y + 1 });
            *b = PixelBox { x0: b.x0.min(x), y0: b.y0.min(y), x1: b.x1.max(x + 1), y1: b.y1.max(y + 1) };
        }
        bounds
    }

    /// This set and every pixel within `margin` rows and columns of it.
    pub fn grown(&self, margin: u32) -> Mask {
        let (w, h, m) = (self.width as usize, self.height as usize, margin as usize);
        // Rows first, then columns: a square neighbourhood is separable.
        let spread = |source: &[bool], length: usize, stride: usize, lines: usize, line_stride: usize| {
            let mut out = vec![false; source.len()];
            for line in 0..lines {
                for i in (0..length).filter(|i| source[line * line_stride + i * stride]) {
                    for k in i.saturating_sub(m)..(i + m + 1).min(length) {
                        out[line * line_stride + k * stride] = true;
                    }
                }
            }
            out
        };
        let wide = spread(&self.inside, w, 1, h, w);
        Mask { width: self.width, height: self.height, inside: spread(&wide, h, w, w, 1) }
    }
}

/// Why pictures could not be worked on.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Two pictures (or a picture and a mask) of different sizes.
    #[error(
        "{what} is {found_width} x {found_height} pixels, expected {width} x {height}; compare pictures of one sensor and one resolution"
    )]
    Size {
        /// Which of the two.
        what: &'static str,
        /// Expected width.
        width: u32,
        /// Expected height.
        height: u32,
        /// Width found.
        found_width: u32,
        /// Height found.
        found_height: u32,
    },
    /// Too small for an 11 x 11 window.
    #[error(
        "a picture of {width} x {height} pixels is too small for SSIM; at least {least} x {least} are needed"
    )]
    TooSmall {
        /// Width.
        width: u32,
        /// Height.
        height: u32,
        /// Smallest side that works.
        least: u32,
    },
    /// A mask without pixels to average over.
    #[error("the region holds no pixel at least 5 pixels from the border; choose a larger region")]
    EmptyRegion,
    /// A crop outside the picture.
    #[error("a crop of {width} x {height} at ({x}, {y}) leaves the picture of {} x {}; choose a smaller one", .picture.0, .picture.1)]
    Crop {
        /// Left column.
        x: u32,
        /// Top row.
        y: u32,
        /// Width.
        width: u32,
        /// Height.
        height: u32,
        /// Size of the picture.
        picture: (u32, u32),
    },
    /// No picture to average.
    #[error("there is no picture to average; give at least one")]
    Nothing,
    /// PNG trouble.
    #[error("PNG: {0}")]
    Png(#[from] ::image::ImageError),
}

/// Requires equal sizes.
pub fn same_size(what: &'static str, expected: (u32, u32), found: (u32, u32)) -> Result<(), Error> {
    if expected == found {
        return Ok(());
    }
    let ((width, height), (found_width, found_height)) = (expected, found);
    Err(Error::Size { what, width, height, found_width, found_height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_grow_and_know_their_bounds() {
        let mask = Mask::from_fn(20, 10, |x, y| (x, y) == (4, 5));
        assert_eq!(mask.bounds(), Some(PixelBox { x0: 4, y0: 5, x1: 5, y1: 6 }));
        let grown = mask.grown(2);
        assert_eq!(grown, Mask::from_box(20, 10, PixelBox { x0: 2, y0: 3, x1: 7, y1: 8 }));
        assert_eq!(grown.count(), 25);
        assert_eq!(Mask::from_fn(3, 3, |_, _| false).bounds(), None);
    }

    #[test]
    fn crops_are_checked() {
        let p = Picture { width: 3, height: 2, rgb: (0..18).collect() };
        let view = View::from(&p);
        assert_eq!(view.crop(1, 1, 2, 1).unwrap().rgb, [12, 13, 14, 15, 16, 17]);
        assert!(view.crop(2, 0, 2, 1).unwrap_err().to_string().contains("leaves the picture of 3 x 2"));
    }
}
