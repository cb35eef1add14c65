//! Means and differences of pictures.

use super::{Error, Picture, View, same_size};

/// Mean of several pictures, rounded to the nearest code value.
///
/// # Errors
/// When there is none, or sizes differ.
pub fn mean<'a>(pictures: impl IntoIterator<Item = View<'a>>) -> Result<Picture, Error> {
    let mut pictures = pictures.into_iter();
    let first = pictures.next().ok_or(Error::Nothing)?;
    let mut sums: Vec<u32> = first.rgb.iter().map(|&v| u32::from(v)).collect();
    let mut count = 1u32;
    for picture in pictures {
        same_size("a picture", (first.width, first.height), (picture.width, picture.height))?;
        sums.iter_mut().zip(picture.rgb).for_each(|(s, &v)| *s += u32::from(v));
        count += 1;
    }
    let rgb = sums.into_iter().map(|s| ((s + count / 2) / count) as u8).collect();
    Ok(Picture { width: first.width, height: first.height, rgb })
}

/// `a - b` around mid-grey 128, multiplied by `gain`.
///
/// # Errors
/// When sizes differ.
pub fn difference<'a>(a: impl Into<View<'a>>, b: impl Into<View<'a>>, gain: f64) -> Result<Picture, Error> {
    let (a, b) = (a.into(), b.into());
    same_size("the second picture", (a.width, a.height), (b.width, b.height))?;
    let value =
        |(&x, &y): (&u8, &u8)| (128.0 + gain * (f64::from(x) - f64::from(y))).round().clamp(0.0, 255.0) as u8;
    Ok(Picture { width: a.width, height: a.height, rgb: a.rgb.iter().zip(b.rgb).map(value).collect() })
}

/// Root mean square of the code value difference: the drift of a background, for one.
///
/// # Errors
/// When sizes differ.
pub fn rms_difference<'a>(a: impl Into<View<'a>>, b: impl Into<View<'a>>) -> Result<f64, Error> {
    let (a, b) = (a.into(), b.into());
    same_size("the second picture", (a.width, a.height), (b.width, b.height))?;
    let sum: u64 = a.rgb.iter().zip(b.rgb).map(|(&x, &y)| u64::from(x.abs_diff(y)).pow(2)).sum();
    Ok((sum as f64 / a.rgb.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(v: u8) -> Picture {
        Picture { width: 2, height: 2, rgb: vec![v; 12] }
    }

    #[test]
    fn means_round_and_differences_are_signed() {
        let (a, b) = (flat(10), flat(13));
        assert_eq!(mean([View::from(&a), View::from(&b)]).unwrap(), flat(12));
        assert_eq!(difference(&a, &b, 4.0).unwrap(), flat(116));
        assert_eq!(difference(&flat(255), &flat(0), 1.0).unwrap(), flat(255));
        assert_eq!(rms_difference(&a, &b).unwrap(), 3.0);
        assert!(mean([]).is_err());
        assert!(difference(&a, &Picture { width: 1, height: 1, rgb: vec![0; 3] }, 1.0).is_err());
    }
}
