//! Tables and a picture of a report: CSV for programs, SVG for people.

use super::Report;
use crate::image::palette::SERIES;
use plotters::prelude::*;
use std::path::{Path, PathBuf};

/// Why a file is missing.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The disk refused.
    #[error(
        "cannot write {path}: {source}; make room, mend permissions, or choose another folder with --out"
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The picture could not be drawn.
    #[error("cannot draw {path}: {why}; bench again without --out and keep the numbers")]
    Draw {
        /// The picture.
        path: PathBuf,
        /// What the drawing library says.
        why: String,
    },
}

/// Writes all files into a folder (made if needed) and answers their paths.
///
/// # Errors
/// When the folder or a file cannot be written.
pub fn write(report: &Report, folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| FileError::Write { path, source }
    };
    std::fs::create_dir_all(folder).map_err(failed(folder))?;
    let json = serde_json::to_string_pretty(report).map_err(std::io::Error::other).map_err(failed(folder))?;
    let picture = folder.join("error_vs_time.svg");
    let svg = error_vs_time(report).map_err(|e| FileError::Draw { path: picture, why: e.to_string() })?;
    let files = [
        ("report.json", json),
        ("throughput.csv", throughput_csv(report)),
        ("time_to_solution.csv", solution_csv(report)),
        ("error_vs_time.csv", error_csv(report)),
        ("skips.csv", skips_csv(report)),
        ("error_vs_time.svg", svg),
    ];
    let mut written = Vec::new();
    for (name, text) in files {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(failed(&path))?;
        written.push(path);
    }
    Ok(written)
}

/// A field that may hold commas.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

fn throughput_csv(report: &Report) -> String {
    let mut text = String::from(
        "who,mode,law,particles,threads,isa,steps,passes,computed,particle_steps_per_s,median,best,per_cpu_s,bytes_per_particle,bytes_per_node,bytes,flops_per_particle_step,peak_flops_per_s,bound,of_peak,bytes_per_particle_step,stream_bytes_per_s,of_stream\n",
    );
    for t in &report.throughput {
        text += &format!(
            "twinrig,{:?},{:?},{},{},{},{},{},{:.3},{:.4e},{:.4e},{:.4e},{:.4e},{:.1},{:.1},{},{},{:.4e},{:.4e},{:.4},{:.1},{:.4e},{:.4}\n",
            t.mode,
            t.law,
            t.particles,
            t.threads,
            t.isa,
            t.steps,
            t.passes,
            t.computed,
            t.particle_steps_per_s,
            t.median_particle_steps_per_s,
            t.best_particle_steps_per_s,
            t.particle_steps_per_cpu_s,
            t.bytes_per_particle,
            t.bytes_per_node,
            t.bytes,
            t.flops_per_particle_step,
            t.roofline.flops_per_s,
            t.bound_particle_steps_per_s,
            t.of_peak,
            t.bytes_per_particle_step,
            t.roofline.bytes_per_s,
            t.of_stream
        );
    }
    for p in &report.peers {
        if let Some(rate) = p.particle_steps_per_s {
            let name = quoted(&format!("{}, {}", p.name, p.work));
            text += &format!("{name},,,{},2,,,,,{rate:.4e},,,,,,,,,,,,,\n", optional(p.particles));
        }
    }
    text
}

fn solution_csv(report: &Report) -> String {
    let mut text = String::from(
        "scene,tolerance,repeats,min_s,median_s,cpu_s,stated_error,iterations,passes,normal_force_n,failure\n",
    );
    for s in &report.solutions {
        let time = s.time.map_or(",,,".to_owned(), |t| {
            format!("{},{:.5},{:.5},{:.5}", t.repeats, t.min_s, t.median_s, t.cpu_s)
        });
        text += &format!(
            "{},{},{time},{},{},{},{},{}\n",
            quoted(s.scene),
            s.tolerance,
            optional(s.stated_error),
            s.iterations,
            s.passes,
            optional(s.normal_force_n),
            quoted(s.error.as_deref().unwrap_or_default())
        );
    }
    text
}

fn error_csv(report: &Report) -> String {
    let mut text = String::from(
        "kind,scene,series,resolution,repeats,min_s,median_s,cpu_s,rmse_um,rmse_high_um,of_depth,force_error,stated_error,source\n",
    );
    for p in &report.curves.points {
        let t = p.time;
        let truth = report.curves.truths.iter().find(|(s, _)| *s == p.scene).map_or("", |(_, t)| t.as_str());
        text += &format!(
            "twinrig,{},{},{},{},{:.5},{:.5},{:.5},{:.3},{:.3},{:.5},{:.5},{},{}\n",
            quoted(p.scene),
            quoted(&p.series),
            quoted(&p.resolution),
            t.repeats,
            t.min_s,
            t.median_s,
            t.cpu_s,
            p.rmse_um,
            p.rmse_um,
            p.of_depth,
            p.force_error,
            optional(p.stated_error),
            quoted(truth)
        );
    }
    for p in &report.peers {
        if let (Some(seconds), Some(low)) = (p.seconds, p.error_low_um) {
            text += &format!(
                "peer,{},{},,,{seconds},,,{low},{},,,,{}\n",
                quoted(&p.work),
                quoted(&p.name),
                optional(p.error_high_um),
                quoted(&p.source)
            );
        }
    }
    text
}

fn skips_csv(report: &Report) -> String {
    let mut text = String::from("skip,work,with_cpu_s,without_cpu_s,factor,surface_apart,stated\n");
    for s in &report.skips {
        let (skip, work, factor) = (quoted(s.skip), quoted(s.work), s.factor());
        let [apart, stated] = [0, 1].map(|n| optional(s.apart_and_stated.map(|pair| pair[n])));
        text += &format!("{skip},{work},{:.5},{:.5},{factor:.2},{apart},{stated}\n", s.with_s, s.without_s);
    }
    text
}

const PEERS: RGBColor = RGBColor(110, 115, 120);

/// One line of the picture.
struct Line {
    name: String,
    points: Vec<(f64, f64)>,
}

fn lines(report: &Report) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for p in &report.curves.points {
        let name = format!("{} ({})", p.series, p.scene);
        // Nothing is faster than a millisecond nor better than 10 nm: a logarithm must not run away.
        let point = (p.time.min_s.max(1e-3), p.rmse_um.max(1e-2));
        match lines.iter_mut().find(|l| l.name == name) {
            Some(line) => line.points.push(point),
            None => lines.push(Line { name, points: vec![point] }),
        }
    }
    for line in &mut lines {
        line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    lines
}

fn error_vs_time(report: &Report) -> Result<String, Box<dyn std::error::Error>> {
    let lines = lines(report);
    let peer = |p: &super::peers::Peer| Some((p.seconds?, p.error_low_um?, p.error_high_um?, p.name.clone()));
    let peers: Vec<(f64, f64, f64, String)> = report.peers.iter().filter_map(peer).collect();
    let all = || {
        let ours = lines.iter().flat_map(|l| l.points.iter().copied());
        ours.chain(peers.iter().flat_map(|p| [(p.0, p.1), (p.0, p.2)]))
    };
    let range = |of: fn((f64, f64)) -> f64| {
        let values = all().map(of);
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        low / 1.6..high * 1.6
    };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (960, 600)).into_drawing_area();
        area.fill(&WHITE)?;
        let m = &report.machine;
        let caption = format!("Error against run time: {}, {} cores, {}", m.cpu, m.cores, m.simd);
        let mut chart = ChartBuilder::on(&area)
            .caption(caption, ("sans-serif", 15))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(range(|p| p.0).log_scale(), range(|p| p.1).log_scale())?;
        chart
            .configure_mesh()
            .x_desc("time to solution, s (least of the repeats)")
            .y_desc("error of the surface, RMSE, um")
            .label_style(("sans-serif", 13))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (line, colour) in lines.iter().zip(SERIES.iter().cycle().copied()) {
            chart
                .draw_series(LineSeries::new(line.points.iter().copied(), colour.stroke_width(2)))?
                .label(&line.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
            chart.draw_series(line.points.iter().map(|&p| Circle::new(p, 4, colour.filled())))?;
        }
        for (seconds, low, high, name) in &peers {
            let bar = [(*seconds, *low), (*seconds, *high)];
            chart.draw_series([PathElement::new(bar, PEERS.stroke_width(2))])?;
            chart.draw_series([TriangleMarker::new((*seconds, *high), 6, PEERS.filled())])?;
            let at = (*seconds * 1.08, *high * 1.05);
            chart.draw_series([Text::new(name.clone(), at, ("sans-serif", 11))])?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerLeft)
            .background_style(WHITE.mix(0.85))
            .border_style(PEERS)
            .label_font(("sans-serif", 12))
            .draw()?;
        area.present()?;
    }
    Ok(svg)
}
