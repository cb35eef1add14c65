//! The plots, as SVG that takes its ink from the page, so that they are legible on light and on dark.
//!
//! Series have mid-tone colours; solid is the simulation, hollow or dashed the null predictor.

use super::facts::{Facts, Shot, Where};
use super::page::{escape, section};
use crate::image::palette::SERIES;
use crate::motion::Primitive;
use plotters::prelude::*;
use std::collections::BTreeMap;

const NULL: RGBColor = RGBColor(140, 145, 150);
/// Stand-ins that are replaced by the page's own colours.
const INK: RGBColor = RGBColor(1, 2, 3);
const GRID: RGBColor = RGBColor(3, 2, 1);
/// More indenters than this are shown as one mean.
const MOST_LINES: usize = 6;

/// One line of points.
struct Series {
    name: String,
    colour: RGBColor,
    points: Vec<(f64, f64)>,
    null: bool,
}

/// All plots that the data supports.
pub fn sections(facts: &Facts) -> String {
    let mut text = String::new();
    for (primitive, title, axis, x) in [
        (Primitive::Press, "Over depth", "depth, mm", (|s: &Shot| s.mark.depth_mm) as fn(&Shot) -> f64),
        (
            Primitive::Slip,
            "Over slide distance",
            "slid to the right, mm (left negative)",
            Shot::signed_slip_mm,
        ),
        (Primitive::Rotate, "Over rotation", "turned clockwise, degrees", |s| s.mark.rotation_deg),
    ] {
        let shots: Vec<&Shot> = facts.shots.iter().filter(|s| s.primitive == primitive).collect();
        let figures = along(&shots, axis, x);
        if !figures.is_empty() {
            text += &section(title, &format!("<div class=\"plots\">{figures}</div>"));
        }
    }
    let mut figures = by_indenter(facts);
    figures += &over_time(facts);
    if !figures.is_empty() {
        text += &section("Spread, timing, drift", &format!("<div class=\"plots\">{figures}</div>"));
    }
    text
}

/// Scores and forces over what the plan varies.
fn along(shots: &[&Shot], axis: &str, x: fn(&Shot) -> f64) -> String {
    let mut text = String::new();
    type Score = fn(&Shot, bool) -> Option<f64>;
    let score: [(&str, Score); 3] = [
        ("PSNR at the contact, dB", |s, null| pick(s, null).map(|m| m.psnr_db)),
        ("SSIM at the contact", |s, null| pick(s, null).map(|m| m.ssim)),
        ("MSE at the contact", |s, null| pick(s, null).map(|m| m.mse)),
    ];
    for (title, value) in score {
        let mut series = lines(shots, x, |s| value(s, false), false);
        series.extend(lines(shots, x, |s| value(s, true), true));
        text +=
            &figure(title, "Solid: simulation. Dashed: null predictor (untouched sensor).", axis, &series);
    }
    type Force = fn(&Shot) -> Option<f64>;
    let force: [(&str, Force); 3] = [
        ("Simulated normal force, N", |s| s.sim.as_ref().map(|l| l.record.normal_force_n)),
        ("Simulated shear force along x, N", |s| s.sim.as_ref().map(|l| l.record.shear_force_n[0])),
        ("Simulated torque, N mm", |s| s.sim.as_ref().map(|l| l.record.torque_n_mm)),
    ];
    for (title, value) in force {
        let series = lines(shots, x, value, false);
        // A quantity that stays zero says nothing.
        if series.iter().flat_map(|s| &s.points).any(|p| p.1.abs() > 1e-6) {
            text += &figure(title, "Of the pad on the indenter.", axis, &series);
        }
    }
    text
}

fn pick(shot: &Shot, null: bool) -> Option<crate::dataset::ImageScores> {
    shot.scores(Where::Contact).map(|(m, n)| if null { n } else { m })
}

/// One line for each indenter (mean where several captures share x), or one for all of many.
fn lines(shots: &[&Shot], x: fn(&Shot) -> f64, y: impl Fn(&Shot) -> Option<f64>, null: bool) -> Vec<Series> {
    let mut names: Vec<&str> = shots.iter().map(|s| s.indenter.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let together = names.len() > MOST_LINES;
    let groups: Vec<(String, Vec<&&Shot>)> = if together {
        vec![(format!("mean of {} indenters", names.len()), shots.iter().collect())]
    } else {
        names.iter().map(|n| ((*n).to_owned(), shots.iter().filter(|s| s.indenter == *n).collect())).collect()
    };
    let line = |(i, (name, shots)): (usize, (String, Vec<&&Shot>))| {
        // Keyed by the thousandth, so that equal abscissae meet.
        let mut sums: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
        for shot in shots {
            if let Some(v) = y(shot).filter(|v| v.is_finite()) {
                let sum = sums.entry((x(shot) * 1000.0).round() as i64).or_default();
                *sum = (sum.0 + v, sum.1 + 1.0);
            }
        }
        let points = sums.into_iter().map(|(k, (sum, n))| (k as f64 / 1000.0, sum / n)).collect();
        Series { name, colour: SERIES[i % SERIES.len()], points, null }
    };
    groups.into_iter().enumerate().map(line).filter(|s| !s.points.is_empty()).collect()
}

/// Gain over the null predictor, every capture a dot, one row an indenter.
fn by_indenter(facts: &Facts) -> String {
    let names = facts.indenters();
    let mut dots: Vec<(f64, usize, bool)> = Vec::new();
    for (row, name) in names.iter().enumerate() {
        for (m, n) in facts.of_indenter(name).filter_map(|s| s.scores(Where::Contact)) {
            dots.extend(
                [(n.psnr_db, row, true), (m.psnr_db, row, false)].into_iter().filter(|d| d.0.is_finite()),
            );
        }
    }
    if dots.is_empty() {
        return String::new();
    }
    let (low, high) = limits(dots.iter().map(|d| d.0));
    let height = 90 + 26 * names.len() as u32;
    let mut svg = String::new();
    let draw = |svg: &mut String| -> Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(svg, (620, height)).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .x_label_area_size(42)
            .y_label_area_size(118)
            .build_cartesian_2d(low..high, -0.6..names.len() as f64 - 0.4)?;
        let label = |y: &f64| {
            let row = (names.len() as f64 - 1.0 - y).round();
            if (y - y.round()).abs() < 1e-6 {
                names.get(row as usize).map_or(String::new(), |n| (*n).to_owned())
            } else {
                String::new()
            }
        };
        chart
            .configure_mesh()
            .x_desc("PSNR at the contact, dB")
            .y_labels(names.len().max(2))
            .y_label_formatter(&label)
            .disable_y_mesh()
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(INK)
            .label_style(("sans-serif", 13).into_font().color(&INK))
            .draw()?;
        let y = |row: usize| (names.len() - 1 - row) as f64;
        let spread = |i: usize| (i % 7) as f64 * 0.06 - 0.18;
        chart.draw_series(dots.iter().enumerate().map(|(i, &(v, row, null))| {
            let (colour, shift) = if null { (NULL, 0.08) } else { (SERIES[0], -0.08) };
            Circle::new((v, y(row) + shift + spread(i)), 3, colour.mix(0.7).filled())
        }))?;
        area.present()?;
        Ok(())
    };
    wrap(
        "Spread by indenter",
        "Every capture in contact. Blue: simulation. Grey: null predictor.",
        draw(&mut svg).map(|()| svg),
    )
}

/// What went on while the session ran.
fn over_time(facts: &Facts) -> String {
    let curve = |name: &str, i: usize, y: fn(&Shot) -> Option<f64>| {
        let points: Vec<(f64, f64)> =
            facts.shots.iter().filter_map(|s| y(s).map(|v| (f64::from(s.capture), v))).collect();
        Series { name: name.to_owned(), colour: SERIES[i], points, null: false }
    };
    let sim = vec![
        curve("elastomer", 0, |s| s.sim.as_ref().map(|l| l.record.elastomer_ms / 1e3)),
        curve("rendering", 1, |s| s.sim.as_ref().map(|l| l.record.render_ms / 1e3)),
    ];
    let drift = vec![
        curve("background since the beginning", 0, |s| s.real.as_ref().map(|l| l.record.drift_rms)),
        curve("last two frames before a capture", 1, |s| s.real.as_ref().map(|l| l.record.still_rms)),
    ];
    let apart = vec![curve("distance", 0, |s| {
        s.real.as_ref().map(|l| l.record.measured.distance_mm(&l.record.commanded) * 1e3)
    })];
    let mut text =
        figure("Time of the simulation, s", "Since the capture before on the same path.", "capture", &sim);
    text += &figure(
        "Drift and stillness, code values RMS",
        "How much pictures changed that should not.",
        "capture",
        &drift,
    );
    text += &figure("Measured from commanded position, µm", "As the devices report it.", "capture", &apart);
    text
}

/// A line chart; nothing for no points.
fn figure(title: &str, caption: &str, x_axis: &str, series: &[Series]) -> String {
    let points = || series.iter().flat_map(|s| &s.points);
    if points().count() == 0 {
        return String::new();
    }
    let (x0, x1) = limits(points().map(|p| p.0));
    let (y0, y1) = limits(points().map(|p| p.1));
    let mut svg = String::new();
    let draw = |svg: &mut String| -> Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(svg, (620, 360)).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(10)
            .x_label_area_size(42)
            .y_label_area_size(58)
            .build_cartesian_2d(x0..x1, y0..y1)?;
        chart
            .configure_mesh()
            .x_desc(x_axis)
            .x_labels(8)
            .y_labels(6)
            .x_label_formatter(&|v| tidy(*v, x1 - x0))
            .y_label_formatter(&|v| tidy(*v, y1 - y0))
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(INK)
            .label_style(("sans-serif", 13).into_font().color(&INK))
            .draw()?;
        for s in series {
            let style = s.colour.stroke_width(if s.null { 1 } else { 2 });
            if s.null {
                chart.draw_series(DashedLineSeries::new(s.points.iter().copied(), 5, 4, style))?;
            } else {
                let line = chart.draw_series(LineSeries::new(s.points.iter().copied(), style))?;
                let colour = s.colour;
                line.label(&s.name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
                if s.points.len() <= 60 {
                    chart.draw_series(s.points.iter().map(|&p| Circle::new(p, 3, s.colour.filled())))?;
                }
            }
        }
        chart
            .configure_series_labels()
            .border_style(TRANSPARENT)
            .label_font(("sans-serif", 13).into_font().color(&INK))
            .draw()?;
        area.present()?;
        Ok(())
    };
    wrap(title, caption, draw(&mut svg).map(|()| svg))
}

/// A plot of values that do not spread is so wide nevertheless, on either side of them: nothing here means anything
/// below a thousandth, and ticks that are closer could not be told apart.
const LEAST_MARGIN: f64 = 1e-3;

/// A little more than the range of the values.
fn limits(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let margin = ((high - low) * 0.06).max(high.abs() * 1e-3).max(LEAST_MARGIN);
    (low - margin, high + margin)
}

/// A label with as many digits as the range needs.
fn tidy(value: f64, range: f64) -> String {
    let digits = (1.0 - range.log10()).ceil().clamp(0.0, 6.0) as usize;
    let text = format!("{value:.digits$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { "0".into() } else { text }
}

fn wrap(title: &str, caption: &str, svg: Result<String, Box<dyn std::error::Error>>) -> String {
    let (title, caption) = (escape(title), escape(caption));
    match svg {
        Ok(svg) => {
            let svg = svg.replace("#010203", "currentColor").replace("#030201", "var(--grid)");
            let size = svg
                .split_once("width=\"")
                .and_then(|(_, r)| r.split_once('"'))
                .map_or("620", |(w, _)| w)
                .to_owned();
            // Scales with its figure: the viewBox stays, the fixed size goes.
            let svg = svg.replacen(&format!("width=\"{size}\""), "", 1);
            format!("<figure><b>{title}</b>{svg}<figcaption>{caption}</figcaption></figure>\n")
        }
        Err(why) => format!(
            "<figure><b>{title}</b><figcaption class=\"bad\">{}</figcaption></figure>\n",
            escape(&why.to_string())
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_of_values_without_spread_are_told_apart() {
        for values in [&[0.0, 0.0][..], &[3.0], &[-2e5, -2e5], &[1e-9, 2e-9], &[0.0, 10.0], &[163.2, 163.9]] {
            let (low, high) = limits(values.iter().copied());
            // Never more than ten of them, as plotters puts them.
            let ticks: Vec<String> =
                (0..=10).map(|i| tidy(low + (high - low) * f64::from(i) / 10.0, high - low)).collect();
            let mut distinct = ticks.clone();
            distinct.dedup();
            assert_eq!(ticks, distinct, "{values:?}");
        }
    }
}
