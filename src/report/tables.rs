//! Words and tables: what was done, how well the simulation did, how the session went, where it all comes from.

use super::facts::{Facts, Shot, Where};
use super::page::{escape, fold, section, table};
use crate::dataset::ImageScores;
use crate::image::bootstrap::{Interval, grouped_mean_interval};
use crate::motion::Primitive;

/// Draws of the bootstrap; its seed is fixed, so that a report can be made again.
pub(super) const RESAMPLES: usize = 2000;

type Pick = fn(ImageScores) -> f64;

/// Name, value, digits, and whether more is better.
const SCORES: [(&str, Pick, usize, bool); 3] =
    [("PSNR, dB", |s| s.psnr_db, 2, true), ("SSIM", |s| s.ssim, 4, true), ("MSE", |s| s.mse, 1, false)];

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let finite: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    (!finite.is_empty()).then(|| finite.iter().sum::<f64>() / finite.len() as f64)
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".to_owned(), |v| format!("{v:.digits$}"))
}

/// Title paragraph and the numbers that matter most.
pub fn opening(facts: &Facts) -> String {
    let p = &facts.provenance;
    let count = |primitive: Primitive| facts.shots.iter().filter(|s| s.primitive == primitive).count();
    let kinds = [(Primitive::Press, "presses"), (Primitive::Slip, "slides"), (Primitive::Rotate, "turns")];
    let kinds: Vec<String> = kinds
        .into_iter()
        .filter(|(k, _)| count(*k) > 0)
        .map(|(k, name)| format!("{} captures of {name}", count(k)))
        .collect();
    let indenters = facts.indenters();
    let (has_real, has_sim) =
        (facts.shots.iter().any(|s| s.real.is_some()), facts.shots.iter().any(|s| s.sim.is_some()));
    let sides = match (has_real, has_sim) {
        (true, false) => "Only the bench has run",
        (false, true) => "Only the simulation has run",
        _ => "Bench and simulation followed the identical trajectory",
    };
    let mut text = format!(
        "<p>Plan <b>{}</b> on rig <b>{}</b> with sensor <b>{}</b>, begun {}. {} with {} indenter{}: {}. {sides}; each row below is one capture mark.</p>\n",
        escape(&p.plan),
        escape(&p.rig),
        escape(&p.sensor),
        escape(&to_the_second(&p.created_utc)),
        if kinds.is_empty() { "Nothing was captured".into() } else { kinds.join(", ") },
        indenters.len(),
        if indenters.len() == 1 { "" } else { "s" },
        escape(&indenters.join(", ")),
    );
    if p.real_is_virtual {
        text += "<p class=\"note\"><b>The real side is virtual.</b> It was made by an emulated bench whose camera model differs from the simulation, to exercise the whole line without hardware. The numbers below compare two models; they are no measurement of a sensor.</p>\n";
    }
    let scored = |place: Where, pick: Pick| {
        let ours = mean(facts.shots.iter().filter_map(|s| s.scores(place)).map(|(m, _)| pick(m)));
        let null = mean(facts.shots.iter().filter_map(|s| s.scores(place)).map(|(_, n)| pick(n)));
        (ours, null)
    };
    let tile = |value: String, label: String| {
        format!("<div class=\"tile\"><b>{value}</b><span>{label}</span></div>")
    };
    let mut tiles =
        tile(format!("{} / {}", facts.shots.len(), facts.planned), "captures stored / planned".into());
    for (place, name) in [(Where::Contact, "at the contact"), (Where::Full, "whole picture")] {
        for (score, pick, digits, _) in &SCORES[..2] {
            let (ours, null) = scored(place, *pick);
            if ours.is_some() {
                let label =
                    format!("{score} {name}; showing the untouched sensor: {}", number(null, *digits));
                tiles += &tile(number(ours, *digits), label);
            }
        }
    }
    text += &format!("<div class=\"tiles\">{tiles}</div>\n");
    if !facts.pairing.refused.is_empty() {
        let list: String = facts
            .pairing
            .refused
            .iter()
            .map(|(c, why)| format!("<li>capture {c}: {}</li>", escape(why)))
            .collect();
        text += &format!("<div class=\"note\">Could not be compared:<ul>{list}</ul></div>\n");
    }
    text
}

/// Simulation against null predictor, whole and at the contact, for all and by indenter.
pub fn scores(facts: &Facts) -> String {
    if facts.shots.iter().all(|s| s.metrics.is_none()) {
        let why = "<p>Only one side was captured, so there is nothing to compare yet.</p>";
        return section("How well the simulation does", why);
    }
    let mut text = "<p>Each picture is compared with the real one. The <i>null predictor</i> shows the untouched sensor instead of a simulation: most of a tactile image never changes, so it scores high over the whole picture, and a simulation is worth what it gains over it <i>at the contact</i> (the box drawn in the pictures). The difference is paired, capture by capture; its 95 % interval resamples whole episodes. Means leave out captures where both pictures are equal (infinite PSNR).</p>\n".to_owned();
    let mut rows = Vec::new();
    for (place, name) in [(Where::Contact, "at the contact"), (Where::Full, "whole picture")] {
        for (score, pick, digits, more_is_better) in SCORES {
            let shots: Vec<(&Shot, ImageScores, ImageScores)> =
                facts.shots.iter().filter_map(|s| s.scores(place).map(|(m, n)| (s, m, n))).collect();
            let differences: Vec<f64> = shots.iter().map(|(_, m, n)| pick(*m) - pick(*n)).collect();
            let groups: Vec<usize> = shots.iter().map(|(s, ..)| s.mark.episode as usize).collect();
            let interval = grouped_mean_interval(&differences, &groups, 0.95, RESAMPLES, 1);
            let better =
                differences.iter().filter(|d| d.is_finite() && (**d > 0.0) == more_is_better && **d != 0.0);
            rows.push(vec![
                format!("{score}, {name}"),
                number(mean(shots.iter().map(|(_, m, _)| pick(*m))), digits),
                number(mean(shots.iter().map(|(.., n)| pick(*n))), digits),
                interval.map_or("–".into(), |i| {
                    // Resampling one or two episodes would feign certainty.
                    let episodes: std::collections::BTreeSet<usize> = groups.iter().copied().collect();
                    if episodes.len() < 3 {
                        format!("{:+.digits$} (too few episodes for an interval)", i.mean)
                    } else {
                        gain(i, digits, more_is_better)
                    }
                }),
                format!("{} of {}", better.count(), shots.len()),
            ]);
        }
    }
    text += &table(&["", "simulation", "null predictor", "difference (95 % interval)", "better in"], &rows);

    let mut rows = Vec::new();
    for name in facts.indenters() {
        let of = |place: Where, pick: Pick, null: bool| {
            let scored = facts.of_indenter(name).filter_map(|s| s.scores(place));
            mean(scored.map(|(m, n)| pick(if null { n } else { m })))
        };
        let mut row = vec![escape(name), facts.of_indenter(name).count().to_string()];
        for (place, pick, digits) in [
            (Where::Contact, SCORES[0].1, 2),
            (Where::Contact, SCORES[1].1, 4),
            (Where::Full, SCORES[0].1, 2),
            (Where::Full, SCORES[1].1, 4),
        ] {
            row.push(number(of(place, pick, false), digits));
            row.push(format!("<span class=\"soft\">{}</span>", number(of(place, pick, true), digits)));
        }
        rows.push(row);
    }
    let head = [
        "indenter",
        "captures",
        "PSNR contact",
        "null",
        "SSIM contact",
        "null",
        "PSNR whole",
        "null",
        "SSIM whole",
        "null",
    ];
    text += &table(&head, &rows);
    if let Some(shift) = facts.pairing.shift {
        text += &format!(
            "<p class=\"soft\">What touching changes lies {:+.2} px to the right and {:+.2} px below in the simulation, relative to the real pictures (median over captures). {}</p>\n",
            shift.dx_px,
            shift.dy_px,
            if facts.pairing.removed.is_some() {
                "This shift was removed before comparing."
            } else {
                "It was not removed: pictures are compared as they are."
            },
        );
    }
    section("How well the simulation does", &text)
}

fn gain(i: Interval, digits: usize, more_is_better: bool) -> String {
    let sure = i.low > 0.0 || i.high < 0.0;
    let class = match (sure, (i.mean > 0.0) == more_is_better) {
        (false, _) => "soft",
        (true, true) => "good",
        (true, false) => "bad",
    };
    format!(
        "<span class=\"{class}\">{:+.digits$} ({:+.digits$} to {:+.digits$})</span>",
        i.mean, i.low, i.high
    )
}

/// Timing, motion, frames, drift, as numbers.
pub fn course(facts: &Facts) -> String {
    let mut rows = Vec::new();
    let mut add = |what: &str, values: Vec<f64>, unit: &str, digits: usize| {
        let mut values: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        if let (Some(low), Some(high)) = (values.first(), values.last()) {
            let middle = values[values.len() / 2];
            let cell = |v: f64| format!("{v:.digits$} {unit}");
            rows.push(vec![what.to_owned(), cell(*low), cell(middle), cell(*high)]);
        }
    };
    let real = || facts.shots.iter().filter_map(|s| s.real.as_ref().map(|l| &l.record));
    let sim = || facts.shots.iter().filter_map(|s| s.sim.as_ref().map(|l| &l.record));
    add("from motion complete to exposure", real().map(|r| r.settle_ms).collect(), "ms", 0);
    add("change between the last two frames", real().map(|r| r.still_rms).collect(), "code values", 2);
    add("drift of the background", real().map(|r| r.drift_rms).collect(), "code values", 2);
    let apart = |r: &crate::dataset::RealRecord| r.measured.distance_mm(&r.commanded);
    add("measured from commanded position", real().map(apart).collect(), "mm", 4);
    let turned = |r: &crate::dataset::RealRecord| (r.measured.theta_deg - r.commanded.theta_deg).abs();
    add("measured from commanded rotation", real().map(turned).collect(), "°", 3);
    add("contact height found", real().map(|r| r.contact_zero_mm).collect(), "mm", 3);
    add("elastomer, per capture", sim().map(|r| r.elastomer_ms / 1e3).collect(), "s", 2);
    add("rendering, per capture", sim().map(|r| r.render_ms / 1e3).collect(), "s", 2);
    add("normal force, simulated", sim().map(|r| r.normal_force_n).collect(), "N", 3);
    add(
        "estimated error of the surface",
        sim().filter_map(|r| r.estimated_error).collect(),
        "of the depth",
        4,
    );
    add(
        "estimated error of the light",
        sim().filter_map(|r| r.light_error.map(|e| 1e2 * e)).collect(),
        "%",
        2,
    );

    let dropped: u32 = real().map(|r| r.dropped_before).sum();
    let departed = real().filter(|r| r.departed).count();
    let limit_hits: u64 = sim().map(|r| r.limit_hits).sum();
    let above = sim().filter(|r| r.light_meets_tolerance == Some(false)).count();
    let torn = sim().filter(|r| r.held.is_some_and(|held| held < 1.0)).count();
    let seconds: f64 = sim().map(|r| (r.elastomer_ms + r.render_ms) / 1e3).sum();
    let span = |pick: fn(i64, i64) -> i64| real().map(|r| r.utc_ns).reduce(pick);
    let bench = span(i64::max).zip(span(i64::min)).map_or(0.0, |(b, a)| (b - a) as f64 * 1e-9);
    let text = format!(
        "<p>First to last real capture: {bench:.0} s. Work of the simulation: {seconds:.0} s of elapsed time summed over captures. Frames dropped before a capture: {dropped}. Captures whose measured pose departs from the commanded one beyond tolerance: {departed}. Relative-rest loops that ran into their limit: {limit_hits}. Simulated pictures whose light is estimated to be above its tolerance: {above}. Captures whose contact, meant to stick, may have lost some of its grip: {torn}.</p>{}",
        table(&["", "least", "median", "most"], &rows)
    );
    section("How the session went", &text)
}

/// Where everything comes from.
pub fn provenance(facts: &Facts) -> String {
    let p = &facts.provenance;
    let sim = facts.shots.iter().find_map(|s| s.sim.as_ref().map(|l| &l.record));
    let mut rows: Vec<(&str, String)> = vec![
        ("program", format!("twinrig {}", p.tool_version)),
        ("dataset schema", p.schema.clone()),
        ("trajectory", p.trajectory_hash.clone()),
        ("devices and motion", p.rig_hash.clone()),
        ("simulation", p.simulation_hash.clone()),
        ("seed", p.seed.to_string()),
        ("overrides", if p.overrides.is_empty() { "none".into() } else { p.overrides.join("; ") }),
    ];
    if let Some(s) = sim {
        let friction = s.friction.map_or("infinite".into(), |f| f.to_string());
        rows.push((
            "elastomer",
            format!(
                "{}, {}, E {} MPa, nu {}, friction {friction}, {} particles or points",
                s.elastomer_mode, s.law, s.youngs_modulus_mpa, s.poisson_ratio, s.particles
            ),
        ));
        let spp = s.spp.map_or(String::new(), |n| format!(", {n} samples per pixel"));
        rows.push(("optics", format!("{}{spp}", s.optics_mode)));
        rows.push(("poses followed", s.poses.clone()));
    }
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(k, v)| vec![k.to_owned(), escape(&v)]).collect();
    let mut text = format!("<div class=\"text\">{}</div>", table(&["", ""], &rows));
    for (title, toml) in
        [("Rig file", &p.rig_toml), ("Plan file", &p.plan_toml), ("Sensor file", &p.sensor_toml)]
    {
        if !toml.is_empty() {
            text += &fold(title, &format!("<pre>{}</pre>", escape(toml)), false);
        }
    }
    if !facts.sessions.is_empty() {
        let notes: Vec<String> =
            facts.sessions.iter().filter_map(|v| serde_json::to_string_pretty(v).ok()).collect();
        text += &fold(
            "Runs: devices, firmware, how each ended",
            &format!("<pre>{}</pre>", escape(&notes.join("\n"))),
            false,
        );
    }
    section("Settings and provenance", &text)
}
/// A time of RFC 3339 without its fractions of a second.
fn to_the_second(time: &str) -> String {
    match time.split_once('.') {
        Some((seconds, rest)) => {
            format!("{seconds}{}", rest.trim_start_matches(|c: char| c.is_ascii_digit()))
        }
        None => time.to_owned(),
    }
}
