//! The pictures: real | simulated | difference, one strip a capture, with the contact box drawn over it.

use super::facts::{Facts, Shot, Where};
use super::page::{escape, fold, section};
use crate::dataset::Dataset;
use crate::image::{Picture, View, arithmetic, png};
use base64::Engine;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use image::{ExtendedColorType, RgbImage};
use rayon::prelude::*;

/// All pictures together stay below this, bytes of base64.
const BUDGET: usize = 22_000_000;
/// Widths a pane may have, pixels, and about how many bytes of base64 a strip then takes.
const SIZES: [(u32, usize); 6] =
    [(480, 60_000), (320, 30_000), (240, 18_000), (192, 12_500), (160, 9_500), (112, 5_500)];
/// Gain of the difference pane.
const GAIN: f64 = 2.0;
/// Strips in the opening selection.
const HIGHLIGHTS: usize = 4;

/// A few captures that tell the story, large.
pub fn highlights(dataset: &Dataset, facts: &Facts) -> String {
    let mut scored: Vec<(&Shot, f64)> = facts
        .shots
        .iter()
        .filter_map(|s| s.scores(Where::Contact).map(|(m, n)| (s, m.psnr_db - n.psnr_db)))
        .filter(|(_, gain)| gain.is_finite())
        .collect();
    scored.sort_by(|a, b| b.1.total_cmp(&a.1));
    if scored.len() < 2 * HIGHLIGHTS {
        return String::new();
    }
    // Evenly from the largest gain over the null predictor to the smallest.
    let at = |i: usize| scored[i * (scored.len() - 1) / (HIGHLIGHTS - 1)].0;
    let strips: String = (0..HIGHLIGHTS).map(|i| strip(dataset, at(i), 480)).collect();
    let words = "<p>Real, simulated, and their difference (real minus simulated, doubled, around grey). Four captures, from the one where the simulation gains most over the untouched picture to the one where it gains least; the box is the region that counts as contact.</p>";
    section("At a glance", &format!("{words}<div class=\"shots\">{strips}</div>"))
}

/// Every capture, folded up by indenter.
pub fn all(dataset: &Dataset, facts: &Facts) -> String {
    let count = facts.shots.len();
    let fits = SIZES.iter().find(|(_, bytes)| bytes * count <= BUDGET);
    let (width, bytes) = *fits.unwrap_or(&SIZES[SIZES.len() - 1]);
    // Beyond what even the smallest size allows, captures are shown evenly spread.
    let stride = (bytes * count).div_ceil(BUDGET).max(1);
    let mut text = String::new();
    if stride > 1 {
        text += &format!(
            "<p>Every {stride}th capture is shown, to keep the page small; all of them are in <code>data/</code>.</p>"
        );
    }
    let strips: Vec<String> =
        facts.shots.par_iter().step_by(stride).map(|s| strip(dataset, s, width)).collect();
    let shown: Vec<&Shot> = facts.shots.iter().step_by(stride).collect();
    for name in facts.indenters() {
        let own: String =
            shown.iter().zip(&strips).filter(|(s, _)| s.indenter == name).map(|(_, t)| t.as_str()).collect();
        if !own.is_empty() {
            let number = facts.of_indenter(name).count();
            let content = format!("<div class=\"shots\">{own}</div>");
            // A page without highlights shows what it has.
            text += &fold(&format!("{name}: {number} captures"), &content, count < 2 * HIGHLIGHTS);
        }
    }
    if count == 0 {
        text += "<p>Nothing was captured.</p>";
    }
    section("Every capture", &text)
}

fn strip(dataset: &Dataset, shot: &Shot, pane: u32) -> String {
    let caption = escape(&shot.caption());
    let mut scores = String::new();
    for (place, name) in [(Where::Contact, "contact"), (Where::Full, "whole")] {
        if let Some((m, n)) = shot.scores(place) {
            let psnr = |v: f64| if v.is_finite() { format!("{v:.1} dB") } else { "∞ (equal)".into() };
            scores += &format!(
                "<br>{name}: PSNR {} (null {}), SSIM {:.3} (null {:.3})",
                psnr(m.psnr_db),
                psnr(n.psnr_db),
                m.ssim,
                n.ssim
            );
        }
    }
    match picture(dataset, shot, pane) {
        Ok((jpeg, names, aspect)) => {
            let data = base64::engine::general_purpose::STANDARD.encode(jpeg);
            let boxes = boxes(shot, names.len());
            let panes: String = names.iter().map(|n| format!("<span>{n}</span>")).collect();
            let columns = names.len();
            format!(
                "<figure><div class=\"strip\"><img loading=\"lazy\" alt=\"{caption}\" style=\"aspect-ratio:{aspect:.4}\" src=\"data:image/jpeg;base64,{data}\">{boxes}</div><div class=\"panes\" style=\"grid-template-columns:repeat({columns},1fr)\">{panes}</div><figcaption>{caption}{scores}</figcaption></figure>\n"
            )
        }
        Err(why) => {
            format!("<figure><figcaption class=\"bad\">{caption}: {}</figcaption></figure>\n", escape(&why))
        }
    }
}

/// The contact box over each pane, in percent of the strip.
fn boxes(shot: &Shot, panes: usize) -> String {
    let size = shot.real.as_ref().map(|l| (f64::from(l.record.width), f64::from(l.record.height)));
    let (Some(b), Some((w, h))) = (shot.region, size) else { return String::new() };
    let one = |i: usize| {
        let left = (i as f64 + f64::from(b.x0) / w) / panes as f64 * 100.0;
        let width = f64::from(b.x1 - b.x0) / w / panes as f64 * 100.0;
        let (top, height) = (f64::from(b.y0) / h * 100.0, f64::from(b.y1 - b.y0) / h * 100.0);
        format!("<i style=\"left:{left:.2}%;top:{top:.2}%;width:{width:.2}%;height:{height:.2}%\"></i>")
    };
    (0..panes).map(one).collect()
}

/// The panes side by side as JPEG, their names, and the aspect ratio of the whole.
fn picture(dataset: &Dataset, shot: &Shot, pane: u32) -> Result<(Vec<u8>, Vec<&'static str>, f64), String> {
    let load = |file: &crate::dataset::StoredFile| -> Result<Picture, String> {
        png::decode(&dataset.read_file(file).map_err(|e| e.to_string())?).map_err(|e| e.to_string())
    };
    let mut panes: Vec<(&'static str, Picture)> = Vec::new();
    if let Some(line) = &shot.real {
        panes.push(("real", load(&line.files[0])?));
    }
    if let Some(line) = &shot.sim {
        panes.push(("simulated", load(&line.files[0])?));
    }
    if let [(_, real), (_, sim)] = &panes[..] {
        let difference = arithmetic::difference(real, sim, GAIN).map_err(|e| e.to_string())?;
        panes.push(("difference", difference));
    }
    let Some((_, first)) = panes.first() else { return Err("no picture".into()) };
    let width = pane.min(first.width);
    let height = (first.height * width).div_ceil(first.width);
    let mut strip = RgbImage::new(width * panes.len() as u32, height);
    for (i, (_, picture)) in panes.iter().enumerate() {
        let small = scaled(View::from(picture), width, height)?;
        image::imageops::replace(&mut strip, &small, i64::from(width) * i as i64, 0);
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 82)
        .encode(strip.as_raw(), strip.width(), strip.height(), ExtendedColorType::Rgb8)
        .map_err(|e| e.to_string())?;
    let aspect = f64::from(strip.width()) / f64::from(strip.height());
    Ok((jpeg, panes.into_iter().map(|(name, _)| name).collect(), aspect))
}

fn scaled(view: View<'_>, width: u32, height: u32) -> Result<RgbImage, String> {
    let whole = RgbImage::from_raw(view.width, view.height, view.rgb.to_vec());
    let whole = whole.ok_or("the picture's size does not match its pixels")?;
    Ok(if (view.width, view.height) == (width, height) {
        whole
    } else {
        resize(&whole, width, height, FilterType::Triangle)
    })
}
