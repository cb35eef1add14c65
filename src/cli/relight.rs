//! `twinrig relight FOLDER`: other colours for a picture that was rendered light by light.
//!
//! The folder is what `twinrig render --basis FOLDER` wrote. Light is linear, so a picture in any colours is a sum of
//! those in the folder: nothing is rendered, it takes milliseconds. Lights that are not named keep the scene's colours;
//! `--json` prints how long the sum took, apart from reading and writing.

use super::exit::Exit;
use super::{picture_file, screen};
use crate::optics::{Error, basis_folder};
use glam::Vec3;
use std::path::PathBuf;
use std::time::Instant;

/// Change the colours of a picture rendered light by light
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --mode fast --basis /tmp/basis --out /tmp/ac.npy\n  twinrig relight /tmp/basis --light blue=0,0,0 --light red=20,4,6 --out /tmp/red.png"
)]
pub struct Args {
    /// Folder that `render --basis` wrote
    pub folder: PathBuf,
    /// A light's radiance as NAME=R,G,B (linear; 0,0,0 turns it off); may be given several times
    #[arg(long = "light", value_name = "NAME=R,G,B", value_parser = parse_light)]
    pub lights: Vec<(String, Vec3)>,
    /// Where to write the picture (.npy, or .png for a look)
    #[arg(long, value_name = "FILE", value_parser = picture_file::parse)]
    pub out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        match self.relight() {
            Ok(seconds) if self.json => {
                screen::json(&serde_json::json!({ "out": self.out, "recolour_s": seconds }));
                Exit::Done
            }
            Ok(seconds) => {
                screen::result(format_args!("{}: recoloured in {:.2} ms", self.out.display(), seconds * 1e3));
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Refused
            }
        }
    }

    fn relight(&self) -> Result<f64, Error> {
        let (basis, mut radiances) = basis_folder::read(&self.folder)?;
        for (name, radiance) in &self.lights {
            let Some(k) = basis.names.iter().position(|n| n == name) else {
                return Err(Error::Setting {
                    key: "lights",
                    value: format!("{name:?}"),
                    why: format!("the folder's lights are {}", basis.names.join(", ")),
                });
            };
            radiances[k] = *radiance;
        }
        let start = Instant::now();
        let picture = basis.combine(&radiances);
        let seconds = start.elapsed().as_secs_f64();
        picture_file::write(&self.out, &picture)?;
        Ok(seconds)
    }
}

fn parse_light(text: &str) -> Result<(String, Vec3), String> {
    let usage = || format!("{text:?} is no light's colour; write NAME=R,G,B, e.g. blue=2,6,20");
    let (name, colour) = text.split_once('=').ok_or_else(usage)?;
    let values: Vec<f32> = colour.split(',').filter_map(|v| v.trim().parse().ok()).collect();
    match values[..] {
        [r, g, b] if values.iter().all(|v| v.is_finite() && *v >= 0.0) => {
            Ok((name.to_owned(), Vec3::new(r, g, b)))
        }
        [_, _, _] => Err(format!("{text:?}: radiances are finite and 0 or more")),
        _ => Err(usage()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_three_numbers_from_0_up() {
        assert_eq!(parse_light("blue=1, 2.5,0").unwrap(), ("blue".to_owned(), Vec3::new(1.0, 2.5, 0.0)));
        for bad in ["blue", "blue=1,2", "blue=1,2,x", "blue=1,2,-3", "blue=1,2,NaN", "=1,2,3,4"] {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }
}
