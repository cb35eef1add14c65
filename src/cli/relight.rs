//! `twinrig relight FOLDER`: other colours for a picture that was rendered light by light.
//!
//! The folder is what `twinrig render --basis FOLDER` wrote, or `twinrig simulate --basis` of a capture. Light is linear, so a picture in any colours is a sum of
//! those in the folder: nothing is rendered, it takes milliseconds. Lights that are not named keep the scene's colours;
//! `--json` prints how long the sum took, apart from reading and writing. In the scene's colours it has the error that was stated of
//! it; of others the errors of its parts tell a bound.
//!
//! `--fit PICTURE` calibrates: it finds the colours whose sum is nearest to a picture of the real sensor. Of a sensor's folder
//! the picture is taken as its camera's (response, exposure, vignetting, blur), and the lights are printed as its file writes
//! them; of a scene's, as radiances.

mod expected;

use super::exit::Exit;
use super::picture_file::{self, Read};
use super::screen;
use crate::optics::basis_folder::{self, Contents};
use crate::optics::light::is_radiance;
use crate::optics::sensor::MOST_ENERGY;
use crate::optics::sensor_basis::{SensorCamera, Written};
use crate::optics::{Error, Film, LightBasis};
use expected::Expected;
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Change the colours of a picture rendered light by light
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig render tests/data/optics/tactile-bench-1.json --mode fast --basis /tmp/basis --out /tmp/ac.npy\n  twinrig relight /tmp/basis --light blue=0,0,0 --light red=20,4,6 --out /tmp/red.png\n  twinrig relight /tmp/basis --fit untouched.png --out /tmp/fitted.png\nTo calibrate the lights of a sensor from a picture of it untouched:\n  twinrig render rig_configs/sensors/digit.toml --mode fast --basis /tmp/digit --out /tmp/digit.png\n  twinrig relight /tmp/digit --fit untouched.png --out /tmp/fitted.png\nOf a pressed sensor:\n  twinrig simulate rig_configs/virtual.toml rig_configs/plans/small.toml --out /tmp/small --basis\n  twinrig relight /tmp/small/basis/000003 --light red=0,0,0 --out /tmp/without_red.png"
)]
pub struct Args {
    /// Folder that `render --basis` wrote, or `simulate --basis` of a capture (DIR/basis/000003)
    pub folder: PathBuf,
    /// A light's radiance as NAME=R,G,B (linear; 0,0,0 turns it off); may be given several times
    #[arg(long = "light", value_name = "NAME=R,G,B", value_parser = parse_light)]
    pub lights: Vec<(String, Vec3)>,
    /// Find the colours whose picture is nearest to this one and print them (.npy is linear light; .png and .jpg are
    /// taken as the sensor's camera gives them, of a scene as sRGB; pixels at 255 do not count)
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
                let mut document = serde_json::json!({
                    "out": self.out,
                    "recolour_s": relit.seconds,
                    "estimated_error": relit.error.map(Expected::value),
                    "estimated_error_is_bound": relit.error.map(Expected::is_bound),
                });
                if let Some(fit) = relit.fit {
                    fit.warn();
                    fit.put_into(&mut document);
                }
                screen::json(&document);
                Exit::Done
            }
            Ok(relit) => {
                if let Some(fit) = relit.fit {
                    fit.warn();
                    fit.lines().into_iter().for_each(screen::result);
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
                if let Some(error) = relit.error {
                    screen::result(format_args!("expected error: {error}"));
                }
                Exit::Done
            }
            Err(e) => {
                screen::error(e);
                Exit::Refused
            }
        }
    }

    fn relight(&self) -> Result<Relit, Error> {
        let Contents { basis, radiances: rendered, errors, error_of_sum, camera } =
            basis_folder::read(&self.folder)?;
        let mut radiances = rendered.clone();
        let camera = camera.as_ref();
        for (n, (name, radiance)) in self.lights.iter().enumerate() {
            if self.lights[..n].iter().any(|(before, _)| before == name) {
                return Err(Error::Argument {
                    name: "--light",
                    value: format!("{name:?}"),
                    why: "it is given twice; give each light one colour".to_owned(),
                });
            }
            let Some(k) = basis.names.iter().position(|n| n == name) else {
                return Err(Error::Argument {
                    name: "--light",
                    value: format!("{name:?}"),
                    why: format!("the folder's lights are {}", basis.names.join(", ")),
                });
            };
            radiances[k] = *radiance;
        }
        let fit = self.fit.as_deref().map(|path| Fit::of(path, &basis, camera)).transpose()?;
        if let Some(fit) = &fit {
            radiances.clone_from(&fit.radiances);
        }
        let start = Instant::now();
        let picture = basis.combine(&radiances);
        let seconds = start.elapsed().as_secs_f64();
        picture_file::write(&self.out, &picture, camera)?;
        let error = match error_of_sum.filter(|_| radiances == rendered) {
            Some(stated) => Some(Expected::Stated(stated)),
            None => errors.map(|errors| Expected::AtMost(expected::most_of_sum(&basis, &radiances, &errors))),
        };
        Ok(Relit { seconds, error, fit })
    }
}

/// What was done.
struct Relit {
    /// How long the sum took.
    seconds: f64,
    /// Where that of its parts is known.
    error: Option<Expected>,
    fit: Option<Fit>,
}

/// Colours that were found.
struct Fit {
    names: Vec<String>,
    radiances: Vec<Vec3>,
    /// Root mean square of what is left, over that of the picture, of the pixels that count.
    residual: f64,
    /// The camera of a sensor, whose file wants its own words.
    camera: Option<SensorCamera>,
}

impl Fit {
    fn of(path: &Path, basis: &LightBasis, camera: Option<&SensorCamera>) -> Result<Self, Error> {
        let Read { film: target, tells, is_on_chip } = picture_file::read(path, camera)?;
        if !tells.contains(&true) {
            return Err(Error::Argument {
                name: "--fit",
                value: format!("a picture of {} x {} pixels", target.width, target.height),
                why: "all of its pixels are at the end of the scale; take one with a shorter exposure (or, if it \
                      is black, a longer one)"
                    .to_owned(),
            });
        }
        if target.mean() == Vec3::ZERO {
            return Err(Error::Argument {
                name: "--fit",
                value: format!("a picture of {} x {} pixels", target.width, target.height),
                why: "it is black, which fits lights that are off; take one with a longer exposure"
                    .to_owned(),
            });
        }
        let on_chip = camera.filter(|_| is_on_chip).map(|camera| camera.basis_on_chip(basis));
        let basis = on_chip.as_ref().unwrap_or(basis);
        let radiances = basis.fit(&target, |k| tells[k])?;
        let residual = residual(&basis.combine(&radiances), &target, &tells);
        Ok(Self { names: basis.names.clone(), radiances, residual, camera: camera.cloned() })
    }

    /// The lights as a sensor's file writes them.
    fn written(&self) -> Vec<Written> {
        let all = self.camera.iter().flat_map(|camera| {
            self.radiances.iter().enumerate().map(|(k, radiance)| camera.written(k, *radiance))
        });
        all.collect()
    }

    /// What was found, for the file that it goes into.
    fn lines(&self) -> Vec<String> {
        let Some(camera) = &self.camera else {
            let line = |(name, v): (&String, &Vec3)| {
                format!("{name}: radiance = [{:.4}, {:.4}, {:.4}]", v.x, v.y, v.z)
            };
            return self.names.iter().zip(&self.radiances).map(line).collect();
        };
        let mut lines = Vec::new();
        for (name, Written { rgb, energy }) in self.names.iter().zip(self.written()) {
            lines.push(format!("# [[optics.lights]] {name:?}"));
            lines.push(format!("rgb = {rgb:?}"));
            lines.push(format!("energy = {energy:?}"));
        }
        if !camera.file_gives_exposure {
            lines.push("# [optics.image], which left this open; only exposure times energy shows".to_owned());
            lines.push(format!("exposure = {:?}", camera.written_exposure()));
        }
        lines
    }

    fn put_into(&self, document: &mut serde_json::Value) {
        let radiance =
            |(name, v): (&String, &Vec3)| serde_json::json!({ "light": name, "radiance": v.to_array() });
        let mut lights: Vec<_> = self.names.iter().zip(&self.radiances).map(radiance).collect();
        for (light, Written { rgb, energy }) in lights.iter_mut().zip(self.written()) {
            light["rgb"] = rgb.as_slice().into();
            light["energy"] = energy.into();
        }
        document["lights"] = lights.into();
        document["residual"] = self.residual.into();
        if let Some(camera) = &self.camera {
            document["exposure"] = camera.exposure().into();
        }
    }

    /// Tells of lights that no sensor's file takes.
    fn warn(&self) {
        for (name, Written { energy, .. }) in self.names.iter().zip(self.written()) {
            if energy > MOST_ENERGY {
                screen::warning(format_args!(
                    "{name}: energy = {energy}: a sensor's file takes up to {MOST_ENERGY}; multiply exposure in \
                     [optics.image] and divide all energies by the same factor"
                ));
            }
        }
    }
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
        [r, g, b] if is_radiance(Vec3::new(r, g, b)) => Ok((name.to_owned(), Vec3::new(r, g, b))),
        [_, _, _] => Err(format!("{text:?}: radiances are 0 to 1e12")),
        _ => Err(usage()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::render;
    use crate::optics::render_file::Mode;
    use clap::Parser;

    #[test]
    fn colours_as_rendered_have_the_error_that_was_stated_and_others_a_bound() {
        let folder = tempfile::tempdir().unwrap();
        let film = |light: f32| Film { width: 1, height: 1, pixels: vec![Vec3::splat(light)] };
        let names = ["blue", "red"].map(str::to_owned).to_vec();
        let mut contents = Contents {
            basis: LightBasis { names, films: vec![film(3.0), film(1.0)] },
            radiances: vec![Vec3::ONE; 2],
            errors: Some(vec![0.01, 0.03]),
            error_of_sum: Some(0.007),
            camera: None,
        };
        let error = |contents: &Contents, lights: &[(&str, Vec3)]| {
            basis_folder::write(folder.path(), contents).unwrap();
            let args = Args {
                folder: folder.path().to_owned(),
                lights: lights.iter().map(|(name, v)| ((*name).to_owned(), *v)).collect(),
                fit: None,
                out: folder.path().join("relit.npy"),
                json: false,
            };
            args.relight().unwrap().error.unwrap()
        };
        for lights in [&[][..], &[("red", Vec3::ONE)]] {
            assert_eq!(error(&contents, lights), Expected::Stated(0.007));
        }
        let other = error(&contents, &[("red", Vec3::ZERO)]);
        assert!(other.is_bound() && (other.value() - 0.01).abs() < 1e-9, "{other}");
        // Of a folder that does not tell it the parts do.
        contents.error_of_sum = None;
        let bound = error(&contents, &[]);
        assert!(bound.to_string().starts_with("at most 1.50 %"), "{bound}");
    }

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
        let radiances = vec![Vec3::ONE; 2];
        let contents = Contents { basis, radiances, errors: None, error_of_sum: None, camera: None };
        basis_folder::write(folder.path(), &contents).unwrap();
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
        assert!(fit.lines()[0].starts_with("blue: radiance = ["), "{:?}", fit.lines());
        // Nothing but white tells nothing.
        args(None, &[("blue", 99.0 * Vec3::ONE), ("red", 99.0 * Vec3::ONE)], "white.png").relight().unwrap();
        let refused = args(Some("white.png"), &[], "fitted.png").relight().err().unwrap().to_string();
        assert!(refused.contains("shorter exposure"), "{refused}");
        // Nor does nothing but black.
        args(None, &[("blue", Vec3::ZERO), ("red", Vec3::ZERO)], "black.png").relight().unwrap();
        let refused = args(Some("black.png"), &[], "fitted.png").relight().err().unwrap().to_string();
        assert!(refused.contains("longer exposure"), "{refused}");
    }

    /// A small sensor as a file: its camera does everything that one can.
    const SENSOR: &str = r#"
        schema = 1
        name = "small"
        [pad]
        shape = { kind = "dome", radius_mm = 40.0 }
        size_x_mm = 16.0
        size_y_mm = 16.0
        thickness_mm = 3.0
        [pad.material]
        law = "neo_hookean"
        youngs_modulus_mpa = 0.145
        poisson_ratio = 0.45
        density_g_mm3 = 1.0
        [optics.camera]
        width_px = 48
        height_px = 36
        mm_per_px = 0.25
        distance_mm = 12.0
        [optics.housing]
        x_mm = [-8.0, 8.0]
        y_mm = [-8.0, 8.0]
        height_mm = 14.0
        albedo = 0.4
        [optics.markers]
        pitch_mm = 3.0
        diameter_mm = 1.0
        [[optics.lights]]
        name = "blue"
        shape = { kind = "rectangle", center_mm = [-7.999, 0.0, -4.0], facing = [1.0, 0.0, 0.0], size_mm = [6.0, 2.0] }
        rgb = [25.0, 75.0, 255.0]
        energy = 1000.0
        [[optics.lights]]
        name = "red"
        shape = { kind = "disc", center_mm = [0.0, 7.999, -4.0], facing = [0.0, -1.0, 0.0], radius_mm = 2.0 }
        rgb = [255.0, 50.0, 75.0]
        energy = 1000.0
        [optics.image]
        exposure = 0.6
        gamma = 1.7
        vignetting = 0.6
        blur_px = 1.2
        full_well_electrons = 2000.0
        read_noise = 2.0
    "#;

    #[derive(Parser)]
    struct Render {
        #[command(flatten)]
        args: render::Args,
    }

    fn render(mode: Mode, sensor: &Path, out: &str) {
        let words = match mode {
            Mode::Fast => ["--mode", "fast", "--tolerance", "0.01"],
            Mode::Reference => ["--mode", "reference", "--spp", "16"],
        };
        let folder = sensor.parent().unwrap();
        let (out, basis) = (folder.join(out), folder.join("basis"));
        let words = ["render"].into_iter().chain(words).map(PathBuf::from);
        let places = [sensor.to_owned(), PathBuf::from("--out"), out, PathBuf::from("--basis"), basis];
        Render::parse_from(words.chain(places)).args.render().unwrap();
    }

    /// Another pair of lights, photographed, is found again with the basis of the file as it was; so it is where the file
    /// leaves the exposure open, with the exposure that is printed, and from linear light.
    #[test]
    fn lights_of_a_sensor_are_found_from_a_picture_of_it_untouched_in_the_words_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small.toml");
        let write = |text: &str| std::fs::write(&path, text).unwrap();
        let open = SENSOR.replace("exposure = 0.6", "");
        let blue = "rgb = [40.0, 255.0, 130.0]\n        energy = 1700.0";
        let red = "rgb = [255.0, 110.0, 0.0]\n        energy = 600.0";
        let lit = |text: &str| {
            text.replace("rgb = [25.0, 75.0, 255.0]\n        energy = 1000.0", blue)
                .replace("rgb = [255.0, 50.0, 75.0]\n        energy = 1000.0", red)
        };
        let product = |rgb: [f64; 3], energy: f64| rgb.map(|v| v * energy);
        let truth = [product([40.0, 255.0, 130.0], 1700.0), product([255.0, 110.0, 0.0], 600.0)];
        let found = |picture: &str| {
            let args = Args {
                folder: folder.path().join("basis"),
                lights: Vec::new(),
                fit: Some(folder.path().join(picture)),
                out: folder.path().join("fitted.png"),
                json: false,
            };
            args.relight().unwrap().fit.unwrap()
        };
        let check = |fit: &Fit, truth: [[f64; 3]; 2], picture: &str| {
            for (Written { rgb, energy }, truth) in fit.written().iter().zip(truth) {
                let most = truth.into_iter().fold(0.0, f64::max);
                for (found, truth) in product(*rgb, *energy).into_iter().zip(truth) {
                    assert!((found - truth).abs() < 0.01 * most, "{picture}: {found} {truth} of {most}");
                }
                assert_eq!(rgb.iter().copied().fold(0.0, f64::max), 255.0);
            }
        };
        for mode in [Mode::Reference, Mode::Fast] {
            write(&lit(SENSOR));
            render(mode, &path, "other.png");
            render(mode, &path, "other.npy");
            for (text, picture) in [(SENSOR, "other.png"), (SENSOR, "other.npy")] {
                write(text);
                render(mode, &path, "untouched.png");
                let fit = found(picture);
                check(&fit, truth, picture);
                assert!(fit.residual < 0.01, "{}", fit.residual);
                // The picture in the colours found is the picture.
                let codes = |name: &str| {
                    crate::image::png::decode(&std::fs::read(folder.path().join(name)).unwrap()).unwrap().rgb
                };
                let apart =
                    codes("other.png").iter().zip(codes("fitted.png")).map(|(a, b)| a.abs_diff(b)).max();
                assert!(apart.is_some_and(|codes| codes <= 2), "{apart:?}");
            }
        }
        // What is printed can be put into the file.
        let fit = found("other.png");
        let lines = fit.lines();
        assert_eq!(lines[0], "# [[optics.lights]] \"blue\"");
        assert!(lines[1].parse::<toml::Table>().is_ok_and(|table| table.contains_key("rgb")), "{lines:?}");
        assert!(lines.len() == 6, "the file gives the exposure: {lines:?}");
        let mut document = serde_json::json!({});
        fit.put_into(&mut document);
        assert_eq!(document["lights"][1]["rgb"][0], 255.0);
        write(&open);
        render(Mode::Fast, &path, "untouched.png");
        let fit = found("other.png");
        let printed = fit.lines().join("\n").parse::<toml::Table>();
        assert!(printed.is_err(), "the keys of several tables");
        let share = 0.6 / fit.camera.as_ref().unwrap().exposure();
        check(&fit, truth.map(|truth| truth.map(|v| v * share)), "open");
        let exposure = fit.lines().last().unwrap().parse::<toml::Table>().unwrap()["exposure"].as_float();
        assert!((exposure.unwrap() * share / 0.6 - 1.0).abs() < 1e-4);
    }

    #[test]
    fn colours_are_three_numbers_from_0_up() {
        assert_eq!(parse_light("blue=1, 2.5,0").unwrap(), ("blue".to_owned(), Vec3::new(1.0, 2.5, 0.0)));
        for bad in
            ["blue", "blue=1,2", "blue=1,2,x", "blue=1,2,-3", "blue=1,2,NaN", "blue=1,2,1e13", "=1,2,3,4"]
        {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }
}
