//! Error over processor time as SVG, both logarithmic: ours as lines, peers as points.

use crate::image::palette::SERIES;
use crate::optics::bench::{Point, Report};
use plotters::prelude::*;
use std::collections::BTreeMap;

const SIZE: (u32, u32) = (900, 560);

/// The plot.
pub(super) fn svg(report: &Report) -> Result<String, String> {
    let mut series: BTreeMap<(bool, String), Vec<&Point>> = BTreeMap::new();
    for (peer, p) in report.points.iter().map(|p| (false, p)).chain(report.peers.iter().map(|p| (true, p))) {
        series.entry((peer, format!("{} {}", p.method, p.scene))).or_default().push(p);
    }
    let mut text = String::new();
    draw(&mut text, &series).map_err(|e| format!("the plot cannot be drawn: {e}"))?;
    Ok(text)
}

fn draw(
    text: &mut String,
    series: &BTreeMap<(bool, String), Vec<&Point>>,
) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption("Error against run time", ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d((0.001..200.0_f64).log_scale(), (0.0005..1.0_f64).log_scale())?;
    chart.configure_mesh().x_desc("processor seconds a frame").y_desc("relRMSE").draw()?;
    for (k, ((peer, name), points)) in series.iter().enumerate() {
        let colour = SERIES[k % SERIES.len()];
        let at = |p: &&Point| (p.cpu_s.clamp(0.001, 200.0), p.error.clamp(0.0005, 1.0));
        let mut along: Vec<(f64, f64)> = points.iter().map(at).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        if *peer {
            chart
                .draw_series(along.iter().map(|p| TriangleMarker::new(*p, 5, colour.filled())))?
                .label(name.as_str())
                .legend(move |p| TriangleMarker::new(p, 5, colour.filled()));
        } else {
            chart.draw_series(along.iter().map(|p| Circle::new(*p, 3, colour.filled())))?;
            chart
                .draw_series(LineSeries::new(along, colour.stroke_width(2)))?
                .label(name.as_str())
                .legend(move |(x, y)| PathElement::new([(x - 8, y), (x + 8, y)], colour.stroke_width(2)));
        }
    }
    chart.configure_series_labels().border_style(BLACK.mix(0.3)).background_style(WHITE.mix(0.8)).draw()?;
    root.present()?;
    Ok(())
}
