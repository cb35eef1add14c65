//! The mode: size, pixel format and rate, asked for and verified.
//!
//! Drivers adjust what they cannot do and say so only in their answer (641 x 481 became 640 x 480, MJPG
//! became YUYV, 30 frames a second became 25), so every answer is compared with the question.

use super::super::formats::PixelFormat;
use super::{CameraError, CameraMode, CameraSettings};
use ::v4l::frameinterval::FrameIntervalEnum;
use ::v4l::framesize::FrameSizeEnum;
use ::v4l::video::Capture;
use ::v4l::video::capture::Parameters;
use ::v4l::{Device, Format, FourCC, Fraction};
use std::io;

/// A rate this close to the one asked for is the same.
const SAME_RATE: f64 = 0.005;
/// The rate of a camera that tells none, 1/s.
const UNTOLD_RATE: f64 = 30.0;

/// What driver and settings agree on.
pub struct Agreed {
    /// Pixel format.
    pub format: PixelFormat,
    /// Its name.
    pub fourcc: String,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bytes a row.
    pub stride: u32,
    /// Rate, 1/s.
    pub frames_per_second: f64,
}

/// Asks the driver for the mode of the settings and refuses any other.
pub fn negotiate(device: &Device, settings: &CameraSettings, camera: &str) -> Result<Agreed, CameraError> {
    let failed = |e: io::Error| CameraError::Open {
        camera: camera.to_owned(),
        why: match e.kind() {
            io::ErrorKind::ResourceBusy => "another program uses it".to_owned(),
            _ => format!("mode: {e}"),
        },
    };
    let fourcc = match &settings.fourcc {
        Some(fourcc) => fourcc.clone(),
        None => preferred(device, camera)?,
    };
    let asked = format!("{} x {} {fourcc}", settings.width, settings.height);
    let refused = |asked: &str, given: String| CameraError::Format {
        camera: camera.to_owned(),
        asked: asked.to_owned(),
        given,
    };
    let code: &[u8; 4] = match fourcc.as_bytes().try_into() {
        Ok(code) => code,
        Err(_) => return Err(refused(&asked, "no format of such a name".into())),
    };
    let wanted = Format::new(settings.width, settings.height, FourCC::new(code));
    let given = device.set_format(&wanted).map_err(failed)?;
    let same = (given.width, given.height, given.fourcc) == (wanted.width, wanted.height, wanted.fourcc);
    let given_fourcc = given.fourcc.to_string();
    let format = match PixelFormat::from_fourcc(&given_fourcc) {
        Some(format) if same => format,
        _ => return Err(refused(&asked, format!("{} x {} {given_fourcc}", given.width, given.height))),
    };

    if let Some(fps) = settings.fps {
        let interval = Fraction::new(1000, (fps * 1000.0).round() as u32);
        device.set_params(&Parameters::new(interval)).map_err(failed)?;
    }
    let told = device.params().ok().map(|p| p.interval).filter(|i| i.numerator > 0 && i.denominator > 0);
    let rate = told.map(|i| f64::from(i.denominator) / f64::from(i.numerator));
    match (settings.fps, rate) {
        (Some(fps), Some(rate)) if (rate / fps - 1.0).abs() > SAME_RATE => {
            return Err(refused(&format!("{asked} at {fps}/s"), format!("{rate:.3}/s")));
        }
        (Some(fps), None) => return Err(refused(&format!("{asked} at {fps}/s"), "no rate at all".into())),
        _ => {}
    }
    Ok(Agreed {
        format,
        fourcc,
        width: given.width,
        height: given.height,
        stride: if format == PixelFormat::Mjpg { 0 } else { given.stride },
        frames_per_second: rate.unwrap_or(UNTOLD_RATE),
    })
}

/// The format that loses least among those the camera offers and we can decode.
fn preferred(device: &Device, camera: &str) -> Result<String, CameraError> {
    let offered: Vec<String> =
        device.enum_formats().unwrap_or_default().iter().map(|f| f.fourcc.to_string()).collect();
    let known = PixelFormat::names().into_iter().find(|name| offered.iter().any(|o| o == name));
    known.map(str::to_owned).ok_or_else(|| CameraError::Format {
        camera: camera.to_owned(),
        asked: format!("one of {}", PixelFormat::names().join(", ")),
        given: offered.join(", "),
    })
}

/// All modes of a device.
pub fn modes(device: &Device) -> io::Result<Vec<CameraMode>> {
    let mut modes = Vec::new();
    for format in device.enum_formats()? {
        let fourcc = format.fourcc.to_string();
        let decodable = PixelFormat::from_fourcc(&fourcc).is_some();
        for size in device.enum_framesizes(format.fourcc).unwrap_or_default() {
            let (width, height, up_to) = match size.size {
                FrameSizeEnum::Discrete(d) => (d.width, d.height, None),
                FrameSizeEnum::Stepwise(s) => (s.min_width, s.min_height, Some([s.max_width, s.max_height])),
            };
            let frames_per_second = rates(device, format.fourcc, width, height);
            let fourcc = fourcc.clone();
            modes.push(CameraMode { fourcc, decodable, width, height, up_to, frames_per_second });
        }
    }
    Ok(modes)
}

fn rates(device: &Device, fourcc: FourCC, width: u32, height: u32) -> Vec<f64> {
    let rate = |i: &Fraction| f64::from(i.denominator) / f64::from(i.numerator.max(1));
    let mut rates: Vec<f64> = device
        .enum_frameintervals(fourcc, width, height)
        .unwrap_or_default()
        .iter()
        .flat_map(|interval| match &interval.interval {
            FrameIntervalEnum::Discrete(i) => vec![rate(i)],
            FrameIntervalEnum::Stepwise(s) => vec![rate(&s.max), rate(&s.min)],
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    rates.dedup();
    rates
}
