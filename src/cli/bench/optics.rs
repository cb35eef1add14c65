//! `twinrig bench optics`: error against run time.
//!
//! Renders the benchmark scene's variants Ac, At and B in the reference mode over samples a pixel and in the fast mode over
//! tolerances, each error taken against two long reference pictures; beside them stand the peers' published points. Then
//! what is skipped where a scene does not need it is done nevertheless, and the times compared, and it is told how many
//! pixels a press that goes deeper leaves as they were: pictures are reused whole or not at all. `--cases` measures the fast
//! mode's error in hard cases instead. `--out NAME` writes NAME.csv, NAME.svg and NAME.json.

use super::{load::cpu_seconds, optics_plot};
use crate::cli::exit::Exit;
use crate::cli::{options, screen};
use crate::config::sensor_file;
use crate::optics::bench::cases::{self, Case};
use crate::optics::bench::{Effect, Point, Report, Settings, StillLight, run};
use crate::optics::bench_scene::Variant;
use crate::optics::imager::Notice;
use crate::trial;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Measure the optics: error against run time, the effect of each skip
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig bench optics --out bench/optics\n  twinrig bench optics --quick --json"
)]
pub struct Args {
    /// Small pictures, few samples: whether it runs, not how fast
    #[arg(long)]
    pub quick: bool,
    /// Raster of the pictures
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = |text: &str| options::raster(text, 8..=4096))]
    pub size: [usize; 2],
    /// Samples a pixel of each of the two judging pictures
    #[arg(long, default_value_t = 64, value_parser = options::whole::<u32>(2..=65_536))]
    pub judge_spp: u32,
    /// Measure the fast mode's error in hard cases instead: all, or those whose name contains this
    #[arg(long, value_name = "WHICH", num_args = 0..=1, default_missing_value = "")]
    pub cases: Option<String>,
    /// Tolerance of the hard cases; from 0.002 to 0.01 it picks the work
    #[arg(long, default_value_t = 0.005, value_parser = options::tolerance, requires = "cases")]
    pub tolerance: f64,
    /// Write NAME.csv, NAME.svg and NAME.json
    #[arg(long, value_name = "NAME")]
    pub out: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the benchmark.
    pub fn run(self) -> Exit {
        if let Some(which) = &self.cases {
            Notice::of_tolerance(self.tolerance).into_iter().for_each(screen::warning);
            let names = cases::names();
            if !names.iter().any(|name| name.contains(which)) {
                screen::error(format_args!(
                    "--cases {which:?} is part of no case's name; they are:\n  {}",
                    names.join("\n  ")
                ));
                return Exit::Refused;
            }
        }
        if let Some(Err(e)) = self.out.as_deref().and_then(Path::parent).map(super::prepare) {
            screen::error(e);
            return Exit::Refused;
        }
        let cases = self.cases.clone().map(|which| (which, self.tolerance));
        let settings = match (self.quick, cases.is_some()) {
            (_, true) => Settings {
                scenes: vec![],
                effects: false,
                size: self.size,
                judge_samples: self.judge_spp,
                samples: vec![],
                tolerances: vec![],
                repeat: 8,
                cases,
            },
            (true, false) => Settings {
                scenes: vec![Variant::Ac],
                effects: true,
                size: [48, 36],
                judge_samples: 8,
                samples: vec![1, 4],
                tolerances: vec![0.01, 0.005],
                repeat: 1,
                cases,
            },
            (false, false) => Settings {
                scenes: vec![Variant::Ac, Variant::At, Variant::B],
                effects: true,
                size: self.size,
                judge_samples: self.judge_spp,
                samples: vec![1, 4, 16, 64],
                tolerances: vec![0.02, 0.01, 0.005, 0.0025],
                repeat: 8,
                cases,
            },
        };
        let mut report = match run(&settings, &cpu_seconds, |what| screen::note(what)) {
            Ok(report) => report,
            Err(e) => {
                screen::error(e);
                return Exit::Failed;
            }
        };
        if settings.effects {
            let (features, rows) = match on_gelsight(self.quick, &settings) {
                Ok(measured) => measured,
                Err(e) => {
                    screen::error(e);
                    return Exit::Failed;
                }
            };
            report.effects.extend(features);
            report.still_light = rows;
        }
        if let Some(name) = &self.out
            && let Err(e) = keep(name, &report)
        {
            screen::error(e);
            return Exit::Failed;
        }
        match self.json {
            true => screen::json(&report),
            false => show(&report),
        }
        Exit::Done
    }
}

/// What features of the shipped GelSight cost, and what stays between two pictures of it.
fn on_gelsight(
    is_quick: bool,
    settings: &Settings,
) -> Result<(Vec<Effect>, Vec<StillLight>), Box<dyn std::error::Error>> {
    let mut sensor = sensor_file(Path::new("gelsight"))?;
    let tolerance = if is_quick { 0.05 } else { 0.005 };
    screen::note("features of the GelSight ...");
    let of = (&sensor.pad, &sensor.optics);
    let features = trial::features::measure(of, settings.size, tolerance, &cpu_seconds, settings.repeat)?;
    screen::note("pixels that stay when a press goes deeper ...");
    if is_quick {
        let camera = &mut sensor.optics.camera;
        camera.mm_per_px *= 10.0;
        (camera.width_px, camera.height_px) = (camera.width_px / 10, camera.height_px / 10);
    }
    Ok((features, trial::still_light::measure(&sensor.pad, &sensor.optics, tolerance)?))
}

fn show(report: &Report) {
    screen::result(format_args!("{} threads", report.threads));
    if !report.cases.is_empty() {
        show_cases(&report.cases);
        return;
    }
    screen::result("scene method               raster    setting   CPU-s     wall s    relRMSE  (estimated)");
    for p in report.points.iter().chain(&report.peers) {
        let [w, h] = p.size;
        screen::result(format_args!(
            "{:5} {:20} {:>4}x{:<4} {:>8} {:>9.4} {:>9} {:>8.3} %  {}",
            p.scene,
            p.method,
            w,
            h,
            p.setting,
            p.cpu_s,
            p.wall_s.map_or_else(|| "-".to_owned(), |s| format!("{s:.4}")),
            1e2 * p.error,
            p.estimated.map_or_else(String::new, |e| format!("({:.3} %)", 1e2 * e)),
        ));
    }
    for (scene, floor) in &report.floors {
        screen::result(format_args!("{scene}: errors below {:.3} % are not told from none", 1e2 * floor));
    }
    for e in &report.effects {
        let difference =
            e.difference.map_or_else(String::new, |d| format!(", pictures {:.4} % apart", 1e2 * d));
        screen::result(format_args!(
            "{:62} x {:5.2}  ({:.4} s without, {:.4} s with{difference})",
            e.what, e.ratio, e.without_s, e.with_s
        ));
    }
    for s in &report.still_light {
        screen::result(format_args!(
            "{:40} same to the bit: {:.2} % of the face's points, {:.2} % of the pixels; within 1e-4: {:.2} %",
            s.what,
            1e2 * s.same_points,
            1e2 * s.same_pixels,
            1e2 * s.nearly_same_pixels
        ));
    }
    screen::result(format_args!(
        "rays through the reference's tree: {:.1} M a CPU-s, camera rays alone, one a pixel; {:.1} M a CPU-s in a picture, all kinds, \
         with the scattering between them ({:.1} a sample)",
        report.camera_rays_per_s / 1e6,
        report.rays_per_s / 1e6,
        report.rays_per_sample
    ));
}

fn show_cases(cases: &[Case]) {
    screen::result("case                                 relRMSE  (floor)    estimated   CPU-s    wall s");
    for Case { name, outcome } in cases {
        match outcome {
            Ok(m) => screen::result(format_args!(
                "{name:34} {:>7.3} % ({:.2} %) {:>9.3} % {:>8.4} {:>8.4}",
                1e2 * m.error,
                1e2 * m.floor,
                1e2 * m.estimated,
                m.cpu_s,
                m.wall_s
            )),
            Err(why) => screen::result(format_args!("{name:34} by the reference mode: {why}")),
        }
    }
}

fn keep(name: &Path, report: &Report) -> Result<(), String> {
    let json = serde_json::to_string_pretty(report).map_err(|e| e.to_string())?;
    for (ending, text) in [("csv", csv(report)), ("svg", optics_plot::svg(report)?), ("json", json)] {
        let path = name.with_extension(ending);
        std::fs::write(&path, text)
            .map_err(|e| format!("cannot write {}: {e}; choose another --out", path.display()))?;
    }
    Ok(())
}

fn csv(report: &Report) -> String {
    let mut text =
        "scene,method,width,height,setting,cpu_s,wall_s,once_s,relrmse,estimated_relrmse\n".to_owned();
    let number = |v: Option<f64>| v.map_or_else(String::new, |v| v.to_string());
    for p in report.points.iter().chain(&report.peers) {
        let Point { scene, method, size: [w, h], setting, cpu_s, error, .. } = p;
        let (wall, once, estimated) = (number(p.wall_s), number(p.once_s), number(p.estimated));
        // Writing to a string does not fail.
        let _ =
            writeln!(text, "{scene},{method},{w},{h},{setting},{cpu_s},{wall},{once},{error},{estimated}");
    }
    for Case { name, outcome } in &report.cases {
        let _ = match outcome {
            Ok(m) => {
                writeln!(text, "\"{name}\",fast,,,,{},{},,{},{}", m.cpu_s, m.wall_s, m.error, m.estimated)
            }
            Err(_) => writeln!(text, "\"{name}\",reference,,,,,,,,"),
        };
    }
    text
}
