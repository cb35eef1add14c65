//! `twinrig relight FOLDER`: other colours for a picture that was rendered light by light.
//!
//! The folder is what `twinrig render --basis FOLDER` wrote. Light is linear, so a picture in any colours is a sum of
//! those in the folder: nothing is rendered, it takes milliseconds. Lights that are not named keep the scene's colours;
//! `--json` prints how long the sum took, apart from reading and writing.
//!
//! `--fit PICTURE` calibrates: it finds the colours whose sum is nearest to a picture of the real sensor, and prints them
//! for the sensor's file.

use super::exit::Exit;
use super::{picture_file, screen};
use crate::optics::{Error, Film, basis_folder};
use glam::Vec3;
use std::path::PathBuf;
use std::time::Instant;

/// Change the colours of a picture rendered light by light
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --mode fast --basis /tmp/basis --out /tmp/ac.npy\n  twinrig relight /tmp/basis --light blue=0,0,0 --light red=20,4,6 --out /tmp/red.png\n  twinrig relight /tmp/basis --fit untouched.png --out /tmp/fitted.png"
)]
pub struct Args {
    /// Folder that `render --basis` wrote
    pub folder: PathBuf,
    /// A light's radiance as NAME=R,G,B (linear; 0,0,0 turns it off); may be given several times
    #[arg(long = "light", value_name = "NAME=R,G,B", value_parser = parse_light)]
    pub lights: Vec<(String, Vec3)>,
    /// Find the colours whose picture is nearest to this one and print them (.npy is linear light; .png and .jpg are
    /// taken as sRGB, and pixels at 255 do not count)
    #[arg(long, value_name = "PICTURE", conflicts_with = "lights")]
    pub fit: Option<PathBuf>,
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
            Ok(relit) if self.json => {
                let mut document = serde_json::json!({ "out": self.out, "recolour_s": relit.seconds });
                if let Some(fit) = relit.fit {
                    let radiance = |(name, v): (&String, &Vec3)| serde_json::json!({ "light": name, "radiance": v.to_array() });
                    document["lights"] = fit.names.iter().zip(&fit.radiances).map(radiance).collect();
                    document["residual"] = fit.residual.into();
                }
                screen::json(&document);
                Exit::Done
            }
            Ok(relit) => {
                if let Some(fit) = relit.fit {
                    for (name, v) in fit.names.iter().zip(&fit.radiances) {
                        screen::result(format_args!(
                            "{name}: radiance = [{:.4}, {:.4}, {:.4}]",
                            v.x, v.y, v.z
                        ));
                    }
                    screen::result(format_args!(
                        "what no colours explain: {:.1} % of the picture",
                        100.0 * fit.residual
                    ));
                }
                screen::result(format_args!(
                    "{}: recoloured in {:.2} ms",
                    self.out.display(),
                    relit.seconds * 1e3
                ));
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Refused
            }
        }
    }

    fn relight(&self) -> Result<Relit, Error> {
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
        let target = self.fit.as_deref().map(picture_file::read).transpose()?;
        if let Some((target, tells)) = &target {
            if !tells.contains(&true) {
                return Err(Error::Setting {
                    key: "--fit",
                    value: format!("a picture of {} x {} pixels", target.width, target.height),
                    why: "all of its pixels are at the end of the scale; take one with a shorter exposure"
                        .to_owned(),
                });
            }
            radiances = basis.fit(target, |k| tells[k])?;
        }
        let start = Instant::now();
        let picture = basis.combine(&radiances);
        let seconds = start.elapsed().as_secs_f64();
        picture_file::write(&self.out, &picture)?;
        let fit = target.map(|(target, tells)| Fit {
            residual: residual(&picture, &target, &tells),
            names: basis.names,
            radiances,
        });
        Ok(Relit { seconds, fit })
    }
}

/// What was done.
struct Relit {
    /// How long the sum took.
    seconds: f64,
    fit: Option<Fit>,
}

/// Colours that were found.
struct Fit {
    names: Vec<String>,
    radiances: Vec<Vec3>,
    /// Root mean square of what is left, over that of the picture, of the pixels that count.
    residual: f64,
}

fn residual(found: &Film, target: &Film, tells: &[bool]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for ((found, target), _) in
        found.pixels.iter().zip(&target.pixels).zip(tells).filter(|(_, tells)| **tells)
    {
        left += f64::from((*found - *target).length_squared());
        all += f64::from(target.length_squared());
    }
    if all == 0.0 { 0.0 } else { (left / all).sqrt() }
}

fn parse_light(text: &str) -> Result<(String, Vec3), String> {
    let usage = || format!("{text:?} is no light's colour; write NAME=R,G,B, e.g. blue=2,6,20");
    let (name, colour) = text.split_once('=').ok_or_else(usage)?;
    let values: Vec<f32> =
        colour.split(',').map(|v| v.trim().parse().ok()).collect::<Option<_>>().ok_or_else(usage)?;
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
    use crate::optics::LightBasis;

    #[test]
    fn colours_that_were_given_are_found_again_and_what_is_cut_off_does_not_count() {
        let folder = tempfile::tempdir().unwrap();
        let film = |pixels: [f32; 4]| {
            let mut film = Film::new(4, 1);
            film.pixels = pixels.map(Vec3::splat).to_vec();
            film
        };
        let basis = LightBasis {
            names: ["blue", "red"].map(str::to_owned).to_vec(),
            films: vec![film([0.1, 0.2, 0.3, 9.0]), film([0.3, 0.1, 0.0, 9.0])],
        };
        basis_folder::write(folder.path(), &basis, &[Vec3::ONE; 2]).unwrap();
        let args = |fit: Option<&str>, lights: &[(&str, Vec3)], out: &str| Args {
            folder: folder.path().to_owned(),
            lights: lights.iter().map(|(name, v)| ((*name).to_owned(), *v)).collect(),
            fit: fit.map(|name| folder.path().join(name)),
            out: folder.path().join(out),
            json: false,
        };
        let (blue, red) = (Vec3::new(0.2, 0.5, 2.0), Vec3::new(1.5, 0.0, 0.4));
        args(None, &[("blue", blue), ("red", red)], "real.png").relight().unwrap();
        let fit = args(Some("real.png"), &[], "fitted.png").relight().unwrap().fit.unwrap();
        assert_eq!(fit.names, ["blue", "red"]);
        // To the rounding of 8 bit, of which there are three pixels.
        assert!((fit.radiances[0] - blue).abs().max_element() < 0.03, "{:?}", fit.radiances);
        assert!((fit.radiances[1] - red).abs().max_element() < 0.03, "{:?}", fit.radiances);
        assert!(fit.residual < 0.02, "{}", fit.residual);
        // Nothing but white tells nothing.
        args(None, &[("blue", 99.0 * Vec3::ONE), ("red", 99.0 * Vec3::ONE)], "white.png").relight().unwrap();
        let refused = args(Some("white.png"), &[], "fitted.png").relight().err().unwrap().to_string();
        assert!(refused.contains("shorter exposure"), "{refused}");
    }

    #[test]
    fn colours_are_three_numbers_from_0_up() {
        assert_eq!(parse_light("blue=1, 2.5,0").unwrap(), ("blue".to_owned(), Vec3::new(1.0, 2.5, 0.0)));
        for bad in ["blue", "blue=1,2", "blue=1,2,x", "blue=1,2,-3", "blue=1,2,NaN", "=1,2,3,4"] {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }
}
