//! The shipped `gelsight_fots` against published presses of a real GelSight.
//!
//! The lab book tells how the sensor was fitted (`tests/measured/optics.md`, "Against published presses of a GelSight"). Pictures here are of
//! the half that it was not fitted to.

use std::path::{Path, PathBuf};
use std::process::Command;
use twinrig::image::{Mask, Picture, metrics, png};
use twinrig::optics::film::{linear_to_srgb, srgb_to_linear};

/// Pixels a millimetre, as published.
const PX_PER_MM: f64 = 19.58;
/// Circles were drawn by hand. What one differs from their mean, pixels, is the contact's to this part, the hand's for the rest.
const MEAN_CIRCLE_PX: f64 = 40.8;
const TRUST: f64 = 0.4;
/// Where the ball is as seen from a circle's centre, pixels: the hand's own bias.
const OFF_PX: [f64; 2] = [0.0, -2.0];
/// Radius of the contact of a ball of radius 2.35 mm on the sensor's pad at depths, as the elastomer has it, mm.
const CONTACT_AT_DEPTH: [(f64, f64); 14] = [
    (0.0, 0.0),
    (1.003, 0.4),
    (1.224, 0.6),
    (1.401, 0.8),
    (1.552, 1.0),
    (1.679, 1.2),
    (1.793, 1.4),
    (1.889, 1.6),
    (1.971, 1.8),
    (2.040, 2.0),
    (2.102, 2.2),
    (2.156, 2.4),
    (2.200, 2.6),
    (2.235, 2.8),
];
/// Half a contact box, and the radius beyond which a press is taken to change nothing, in circles.
const BOX: f64 = 1.6;
const FAR: f64 = 3.2;
/// Codes from here on may be clipped.
const CLIPPED: u8 = 254;

/// A published press with its circle, pixels.
struct Press {
    file: String,
    center: [f64; 2],
    radius: f64,
}

/// What is compared of one press.
struct Pair {
    press: Press,
    real: Picture,
    /// The untouched sensor in the white balance of the press.
    untouched: Picture,
    sim: Picture,
}

fn top() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn picture(path: &Path) -> Picture {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    png::decode(&bytes).expect("a PNG")
}

fn presses(folder: &Path) -> Vec<Press> {
    let text = std::fs::read_to_string(folder.join("circles.csv")).expect("circles");
    let press = |line: &str| {
        let words: Vec<&str> = line.split(',').collect();
        let number = |k: usize| words[k].trim().parse::<f64>().expect("a number");
        Press { file: words[0].to_owned(), center: [number(1), number(2)], radius: number(3) }
    };
    text.lines().skip(1).map(press).collect()
}

/// Linear light of a code value (sRGB).
fn light(code: u8) -> f64 {
    f64::from(srgb_to_linear(code))
}

fn code(light: f64) -> u8 {
    (255.0 * linear_to_srgb(light.clamp(0.0, 1.0) as f32)).round() as u8
}

impl Press {
    fn distance(&self, k: usize, width: u32) -> f64 {
        let (x, y) = ((k as u32 % width) as f64, (k as u32 / width) as f64);
        (x - self.center[0]).hypot(y - self.center[1])
    }

    /// The camera's white balance of this press as gains on the untouched picture's colours: medians over what is far from the press.
    fn gains(&self, real: &Picture, untouched: &Picture) -> [f64; 3] {
        let (real_at, still_at) = (real.rgb.chunks_exact(3), untouched.rgb.chunks_exact(3));
        let pixels: Vec<(&[u8], &[u8])> = real_at.zip(still_at).collect();
        std::array::from_fn(|c| {
            let mut ratios: Vec<f64> = (pixels.iter().enumerate())
                .filter(|(k, (a, b))| {
                    self.distance(*k, real.width) > FAR * self.radius && a[c].max(b[c]) < CLIPPED
                })
                .map(|(_, (a, b))| light(a[c]) / light(b[c]))
                .collect();
            ratios.sort_by(f64::total_cmp);
            ratios[ratios.len() / 2]
        })
    }

    fn contact_box(&self, width: u32, height: u32) -> Mask {
        let half = BOX * self.radius;
        let inside = |p: u32, center: f64| (f64::from(p) - center).abs() <= half;
        Mask::from_fn(width, height, |x, y| inside(x, self.center[0]) && inside(y, self.center[1]))
    }

    /// How deep the ball is, by the circle.
    fn depth_mm(&self) -> f64 {
        let circle = MEAN_CIRCLE_PX + TRUST * (self.radius - MEAN_CIRCLE_PX);
        let contact = circle / PX_PER_MM;
        let above = CONTACT_AT_DEPTH
            .iter()
            .position(|(radius, _)| *radius > contact)
            .expect("a contact of the table");
        let ((a, from), (b, to)) = (CONTACT_AT_DEPTH[above - 1], CONTACT_AT_DEPTH[above]);
        from + (to - from) * (contact.powi(2) - a.powi(2)) / (b.powi(2) - a.powi(2))
    }

    /// The press as the twin has it, over this picture of the untouched sensor.
    fn simulated(&self, background: &Path, folder: &Path) -> Picture {
        let half = [120.0, 160.0];
        let at: [f64; 2] = std::array::from_fn(|k| (self.center[k] + 0.5 + OFF_PX[k] - half[k]) / PX_PER_MM);
        let plan = format!(
            "schema = 1\nname = \"ball\"\nprimitive = \"press\"\nsensor = \"gelsight_fots\"\nindenters = [{{ name = \"ball\" }}]\n\
             clearance_mm = 3.0\n[locations]\npoints_mm = [[{:.4}, {:.4}]]\n[depths]\nlist_mm = [{:.4}]\n[contact]\nzero_mm = 0.0\n",
            at[0],
            at[1],
            self.depth_mm()
        );
        let ball = "[shape]\nkind = \"dome\"\nradius_mm = 2.35\ndiameter_mm = 4.7\n";
        std::fs::create_dir_all(folder.join("indenters")).unwrap();
        std::fs::write(folder.join("indenters/ball.toml"), ball).unwrap();
        std::fs::write(folder.join("plan.toml"), plan).unwrap();
        let out = folder.join("sim").join(&self.file).join(background.file_stem().unwrap());
        let run = Command::new(env!("CARGO_BIN_EXE_twinrig"))
            .current_dir(top())
            .args(["simulate", "rig_configs/virtual.toml"])
            .arg(folder.join("plan.toml"))
            .arg("--out")
            .arg(&out)
            .arg("--background")
            .arg(background)
            .env("TWINRIG_CACHE", folder.join("cache"))
            .output()
            .unwrap();
        assert!(run.status.success(), "{}: {}", self.file, String::from_utf8_lossy(&run.stderr));
        picture(&out.join("sim/000000.png"))
    }

    /// Light as a part of the untouched sensor's, at a place in circles from the centre: mean over a disc of 0.1 circles.
    fn ratio(&self, shown: &Picture, untouched: &Picture, at: [f64; 2], channel: usize) -> f64 {
        let middle: [f64; 2] = std::array::from_fn(|k| self.center[k] + at[k] * self.radius);
        let part = 0.1 * self.radius;
        let (mut now, mut still) = (0.0, 0.0);
        let range = |k: usize, size: u32| {
            let least = (middle[k] - part).ceil().max(0.0) as u32;
            least..size.min((middle[k] + part + 1.0).max(0.0) as u32)
        };
        for y in range(1, shown.height) {
            for x in range(0, shown.width) {
                if (f64::from(x) - middle[0]).hypot(f64::from(y) - middle[1]) <= part {
                    let at = 3 * (y * shown.width + x) as usize + channel;
                    now += light(shown.rgb[at]);
                    still += light(untouched.rgb[at]);
                }
            }
        }
        if still > 0.0 { now / still } else { f64::NAN }
    }
}

/// The untouched picture in another white balance.
fn balanced(untouched: &Picture, gains: [f64; 3]) -> Picture {
    let codes = untouched.rgb.iter().enumerate().map(|(k, c)| code(light(*c) * gains[k % 3]));
    Picture { rgb: codes.collect(), ..*untouched }
}

fn pairs(presses: Vec<Press>, pictures: &Path, folder: &Path) -> Vec<Pair> {
    let published = picture(&top().join("rig_configs/sensors/gelsight_fots.png"));
    let pair = |press: Press| {
        let real = picture(&pictures.join(&press.file));
        let untouched = balanced(&published, press.gains(&real, &published));
        let background = folder.join("balanced.png");
        std::fs::write(&background, png::encode(&untouched).unwrap()).unwrap();
        let sim = press.simulated(&background, folder);
        Pair { press, real, untouched, sim }
    };
    presses.into_iter().map(pair).collect()
}

/// What scores a picture against a real one in the contact box, and in the whole.
fn scores(press: &Press, real: &Picture, shown: &Picture) -> [metrics::Metrics; 2] {
    let part = press.contact_box(real.width, real.height);
    let (whole, near) = metrics::compare_whole_and_within(real, shown, Some(&part)).unwrap();
    [near.expect("a contact in the picture"), whole]
}

/// Where each colour's light comes from, in the picture.
const TOWARDS: [[f64; 2]; 3] = [[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]];

/// The mean profile of a colour along the line to its light: 51 places from 2.5 circles behind the centre to 2.5 before it.
fn profile(pairs: &[Pair], channel: usize, of: impl Fn(&Pair) -> &Picture, along: [f64; 2]) -> Vec<f64> {
    let place = |i: usize| {
        let far = (i as f64 - 25.0) / 10.0;
        let ratio =
            |pair: &Pair| pair.press.ratio(of(pair), &pair.untouched, along.map(|a| a * far), channel);
        let seen: Vec<f64> = pairs.iter().map(ratio).filter(|r| r.is_finite()).collect();
        seen.iter().sum::<f64>() / seen.len() as f64
    };
    (0..51).map(place).collect()
}

/// Centre, brightest and darkest of a profile.
fn extremes(profile: &[f64]) -> [f64; 3] {
    let brightest = profile.iter().copied().fold(0.0, f64::max);
    let darkest = profile.iter().copied().fold(f64::INFINITY, f64::min);
    [profile[25], brightest, darkest]
}

/// Where all of the published pictures are with their `circles.csv`, 2.6 MB that are not shipped. Those that are held out of them are
/// judged then, not the four shipped ones, and the table of the lab book is printed.
const ALL: &str = "TWINRIG_PUBLISHED_PRESSES";

/// Of all the presses those that take part: those that the sensor was fitted to, and those held out.
fn halves(all: Vec<Press>) -> [Vec<Press>; 2] {
    // (Those whose number is a multiple of four were not at hand when it was.)
    let takes_part = |press: &Press| {
        let number: u32 = press.file.trim_end_matches(".png").parse().expect("a number");
        !number.is_multiple_of(4)
    };
    let mut halves = [Vec::new(), Vec::new()];
    for (k, press) in all.into_iter().filter(takes_part).enumerate() {
        halves[k % 2].push(press);
    }
    halves
}

#[test]
fn a_fitted_gelsight_shows_presses_that_it_was_not_fitted_to() {
    let folder = tempfile::tempdir().unwrap();
    let shipped = top().join("tests/data/fots");
    let held_out = match std::env::var_os(ALL).map(PathBuf::from) {
        None => pairs(presses(&shipped), &shipped, folder.path()),
        Some(all) => {
            let [fitted_to, held_out] = halves(presses(&all)).map(|half| pairs(half, &all, folder.path()));
            print_table("fitted to", &fitted_to, folder.path());
            print_table("held out", &held_out, folder.path());
            held_out
        }
    };
    let of_shipped = presses(&shipped);
    let mut gained_db = 0.0;
    for Pair { press, real, untouched, sim } in &held_out {
        let [near, whole] = scores(press, real, sim);
        let [null_near, null_whole] = scores(press, real, untouched);
        gained_db += (near.psnr_db - null_near.psnr_db) / held_out.len() as f64;
        if !of_shipped.iter().any(|shipped| shipped.file == press.file) {
            continue;
        }
        let told =
            format!("{}: contact {near:?}, {null_near:?}; whole {whole:?}, {null_whole:?}", press.file);
        assert!(near.psnr_db > null_near.psnr_db + 11.0, "{told}");
        assert!(near.ssim > null_near.ssim + 0.04, "{told}");
        assert!(whole.psnr_db > null_whole.psnr_db + 9.5, "{told}");
    }
    assert!(held_out.len() >= of_shipped.len() && of_shipped.len() == 4);
    assert!(gained_db > 12.6, "{gained_db} dB in the mean");
    for (channel, towards) in TOWARDS.into_iter().enumerate() {
        let real = extremes(&profile(&held_out, channel, |pair| &pair.real, towards));
        let sim = extremes(&profile(&held_out, channel, |pair| &pair.sim, towards));
        let told =
            format!("colour {channel}: real {real:.3?}, simulated {sim:.3?} (centre, brightest, darkest)");
        for (real, sim, off) in [(real[0], sim[0], 0.12), (real[1], sim[1], 0.25), (real[2], sim[2], 0.06)] {
            assert!((sim - real).abs() < off, "{told}");
        }
    }
}

/// Prints what the lab book tells of these presses.
#[expect(clippy::print_stdout, reason = "the table is what it is for")]
fn print_table(name: &str, pairs: &[Pair], folder: &Path) {
    let published = top().join("rig_configs/sensors/gelsight_fots.png");
    let still = picture(&published);
    println!(
        "{name}: press, depth (mm), gains; PSNR (dB) and SSIM of sim and null: contact box, whole picture; without gains: contact box"
    );
    let mut sums = [0.0; 12];
    for Pair { press, real, untouched, sim } in pairs {
        let plain = press.simulated(&published, folder);
        let pictures = [sim, untouched, &plain, &still].map(|shown| scores(press, real, shown));
        let [sim, null, plain, plain_null] = pictures;
        let row: Vec<f64> = [sim[0], null[0], sim[1], null[1], plain[0], plain_null[0]]
            .iter()
            .flat_map(|m| [m.psnr_db, m.ssim])
            .collect();
        sums.iter_mut().zip(&row).for_each(|(sum, value)| *sum += value);
        println!("{} {:.2} {:.2?} {row:.3?}", press.file, press.depth_mm(), press.gains(real, &still));
    }
    println!("mean {:.3?}", sums.map(|sum| sum / pairs.len() as f64));
    for (channel, towards) in TOWARDS.into_iter().enumerate() {
        for (across, along) in [("along", towards), ("across", [-towards[1], towards[0]])] {
            let real = profile(pairs, channel, |pair| &pair.real, along);
            let sim = profile(pairs, channel, |pair| &pair.sim, along);
            println!("colour {channel} {across} real {:.2?} {real:.2?}", extremes(&real));
            println!("colour {channel} {across} sim  {:.2?} {sim:.2?}", extremes(&sim));
        }
    }
}
