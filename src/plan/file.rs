//! The plan file as a user writes it, and what makes it sound in itself.
//!
//! What depends on the rig (limits, missing axes, the pad) is the matter of [`super::check`].

use super::depth_ladder::{DepthsTable, rounded, rungs};
use super::direction::{SpinDirection, WrittenDirection};
use super::{Contact, Feeds, Plan, PlannedIndenter, Rotate, Slide, Split, TouchOff};
use crate::motion::Primitive;
use crate::problem::Problems;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// The newest plan format this program writes about.
pub const SCHEMA: u32 = 1;

/// Most captures of one plan; far beyond any session, it catches a mistyped grid.
const MOST_CAPTURES: f64 = 1e6;

/// A plan file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// Format version, 1.
    pub schema: u32,
    /// What the plan is called.
    pub name: String,
    /// `press`, `slip` or `rotate`.
    pub primitive: Primitive,
    /// The sensor it is meant for: the stem of a file in `sensors/`.
    pub sensor: String,
    /// The indenters, in order of use.
    pub indenters: Vec<IndenterEntry>,
    /// Where to press; absent: once, at the pad's centre.
    pub locations: Option<LocationsTable>,
    /// How deep.
    pub depths: DepthsTable,
    /// The slide of a slip plan.
    pub slide: Option<SlideTable>,
    /// The rotation of a rotate plan.
    pub rotate: Option<RotateTable>,
    /// How fast.
    #[serde(default)]
    pub feeds: Feeds,
    /// Height of sideways travel above the contact zero, mm.
    #[serde(default = "default_clearance_mm")]
    pub clearance_mm: f64,
    /// Height above the contact zero at which the press begins, mm.
    #[serde(default = "default_approach_mm")]
    pub approach_mm: f64,
    /// How the contact zero is known.
    pub contact: ContactTable,
    /// How often everything is done.
    #[serde(default = "once")]
    pub repeats: u32,
    /// Training and test data.
    #[serde(default)]
    pub split: SplitTable,
}

fn default_clearance_mm() -> f64 {
    3.0
}

fn default_approach_mm() -> f64 {
    0.2
}

fn once() -> u32 {
    1
}

/// One indenter of the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IndenterEntry {
    /// The stem of a file in `indenters/`.
    pub name: String,
    /// Radius with which its edges are rounded, mm; absent: as its file says.
    pub edge_round_mm: Option<f64>,
}

/// Where to press: a grid around a centre, or a list of points.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocationsTable {
    /// Columns of the grid, along x.
    pub columns: Option<u32>,
    /// Rows of the grid, along y.
    pub rows: Option<u32>,
    /// Distance between neighbours, mm.
    pub pitch_mm: Option<f64>,
    /// Centre of the grid, mm; absent: the pad's centre.
    pub center_mm: Option<[f64; 2]>,
    /// The points one by one, mm.
    pub points_mm: Option<Vec<[f64; 2]>>,
}

/// The slide of a slip plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlideTable {
    /// Words of the image or degrees.
    pub directions: Vec<WrittenDirection>,
    /// How far, mm.
    pub distance_mm: f64,
    /// Distance between two captures, mm.
    pub step_mm: f64,
}

/// The rotation of a rotate plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotateTable {
    /// `cw` and `ccw`, as seen in the image.
    pub directions: Vec<SpinDirection>,
    /// How far, degrees.
    pub angle_deg: f64,
    /// Angle between two captures, degrees.
    pub step_deg: f64,
}

/// How the contact zero is known: `zero_mm` alone, or the rest for a touch-off.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactTable {
    /// Height of the contact zero above the rig's nominal contact, mm.
    pub zero_mm: Option<f64>,
    /// Start of the touch-off above the nominal contact, mm.
    pub start_mm: Option<f64>,
    /// Its coarse step, mm; the fine one is a tenth.
    pub step_mm: Option<f64>,
    /// Where it gives up below the nominal contact, mm.
    pub max_depth_mm: Option<f64>,
    /// Change of the picture that counts as contact, code values.
    pub threshold: Option<f64>,
}

/// Training and test data.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SplitTable {
    /// What stays together.
    pub by: SplitBy,
    /// Share of the groups that become test data; 0: everything is training data.
    pub test_fraction: f64,
    /// Seed of the division.
    pub seed: u64,
}

impl Default for SplitTable {
    fn default() -> Self {
        Self { by: SplitBy::Episode, test_fraction: 0.0, seed: 0 }
    }
}

/// What is never divided between training and test data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// One approach .. retract.
    Episode,
    /// Everything done with one indenter: test data then show unseen indenters.
    Indenter,
    /// Everything done at one location.
    Location,
}

impl PlanFile {
    /// The plan, sound when nothing was reported; `None` where what was reported leaves no plan to make.
    pub fn check(&self, problems: &mut Problems) -> Option<Plan> {
        if self.schema != SCHEMA {
            let next =
                format!("this program reads schema {SCHEMA}; rewrite the file or use a matching release");
            problems.push("schema", self.schema, SCHEMA.to_string(), next);
        }
        if self.name.trim().is_empty() {
            problems.push("name", "\"\"", "a name", "write e.g. `name = \"slip\"`");
        }
        self.check_indenters(problems);
        let locations_mm = match &self.locations {
            None => Some(vec![[0.0, 0.0]]),
            Some(table) => {
                let mut points = None;
                problems.within("locations", |p| points = table.check(p));
                points
            }
        };
        let mut depths_mm = None;
        problems.within("depths", |p| depths_mm = self.depths.check(p));
        let (slide, rotate) = self.check_experiment(problems);
        problems.within("feeds", |p| self.feeds.check(p));
        problems.range("clearance_mm", self.clearance_mm, 0.1, 100.0, "mm");
        if !(self.approach_mm >= 0.0 && self.approach_mm <= self.clearance_mm) {
            let allowed = format!("0 to clearance_mm = {} mm", self.clearance_mm);
            problems.push(
                "approach_mm",
                self.approach_mm,
                allowed,
                "begin the press below the clearance height",
            );
        }
        let mut contact = None;
        problems.within("contact", |p| contact = self.contact.check(self.clearance_mm, p));
        if !(1..=10_000).contains(&self.repeats) {
            problems.push("repeats", self.repeats, "1 to 10000", "choose how often everything is done");
        }
        problems.range("split.test_fraction", self.split.test_fraction, 0.0, 0.9, "");

        let plan = Plan {
            name: self.name.clone(),
            primitive: self.primitive,
            sensor: self.sensor.clone(),
            indenters: (self.indenters.iter())
                .map(|i| PlannedIndenter { name: i.name.clone(), edge_round_mm: i.edge_round_mm })
                .collect(),
            locations_mm: locations_mm?,
            depths_mm: depths_mm?,
            slide,
            rotate,
            feeds: self.feeds,
            clearance_mm: self.clearance_mm,
            approach_mm: self.approach_mm,
            contact: contact?,
            repeats: self.repeats,
            split: Split {
                by: self.split.by,
                test_fraction: self.split.test_fraction,
                seed: self.split.seed,
            },
        };
        let captures = plan.captures();
        if captures > MOST_CAPTURES {
            problems.push(
                "",
                format!("{captures} captures"),
                format!("at most {MOST_CAPTURES}"),
                "reduce repeats, locations or ladders, or divide the plan",
            );
        }
        Some(plan)
    }

    fn check_indenters(&self, problems: &mut Problems) {
        if self.indenters.is_empty() {
            let next = "write e.g. `indenters = [{ name = \"sphere\" }]`";
            problems.push("indenters", "[]", "at least one indenter", next);
        }
        let mut seen = BTreeSet::new();
        for (i, entry) in self.indenters.iter().enumerate() {
            problems.within("indenters", |p| {
                p.within(format!("[{i}]"), |p| {
                    if !seen.insert(&entry.name) {
                        let next = "remove it, or raise `repeats` to use everything again";
                        p.push("name", &entry.name, "each indenter once", next);
                    }
                    p.range("edge_round_mm", entry.edge_round_mm.unwrap_or(0.0), 0.0, 2.0, "mm");
                });
            });
        }
    }

    /// The tables of the experiment: exactly the one that the primitive needs.
    fn check_experiment(&self, problems: &mut Problems) -> (Option<Slide>, Option<Rotate>) {
        let wanted = |key: &str, present: bool, needed: bool, problems: &mut Problems| {
            let name = primitive_name(self.primitive);
            if needed && !present {
                let next = format!("add a table [{key}]");
                problems.push(key, "missing", format!("a [{key}] table in a {name} plan"), next);
            } else if present && !needed {
                let next = format!("remove [{key}], or change the primitive");
                problems.push(key, "a table", format!("no [{key}] in a {name} plan"), next);
            }
        };
        wanted("slide", self.slide.is_some(), self.primitive == Primitive::Slip, problems);
        wanted("rotate", self.rotate.is_some(), self.primitive == Primitive::Rotate, problems);
        let (mut slide, mut rotate) = (None, None);
        if let Some(table) = &self.slide {
            problems.within("slide", |p| slide = table.check(p));
        }
        if let Some(table) = &self.rotate {
            problems.within("rotate", |p| rotate = table.check(p));
        }
        (slide, rotate)
    }
}

/// The primitive as files write it.
pub fn primitive_name(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::Press => "press",
        Primitive::Slip => "slip",
        Primitive::Rotate => "rotate",
    }
}

impl LocationsTable {
    fn check(&self, problems: &mut Problems) -> Option<Vec<[f64; 2]>> {
        let points = match (self.columns, self.rows, self.pitch_mm, &self.points_mm) {
            (Some(columns), Some(rows), pitch, None) => self.grid(columns, rows, pitch, problems)?,
            (None, None, None, Some(points)) if self.center_mm.is_none() => points.clone(),
            _ => {
                problems.push(
                    "",
                    "an incomplete or doubled description",
                    "columns, rows, pitch_mm (and center_mm), or points_mm alone",
                    "write `columns = 3`, `rows = 3`, `pitch_mm = 1.0`, or `points_mm = [[0.0, 0.0]]`",
                );
                return None;
            }
        };
        if points.is_empty() {
            problems.push("points_mm", "[]", "at least one point", "write e.g. `points_mm = [[0.0, 0.0]]`");
            return None;
        }
        for (i, point) in points.iter().enumerate() {
            if self.points_mm.is_some() && points[..i].contains(point) {
                let next = "remove it, or raise `repeats`";
                problems.push(&format!("points_mm.[{i}]"), format!("{point:?}"), "each point once", next);
            }
        }
        Some(points)
    }

    fn grid(
        &self,
        columns: u32,
        rows: u32,
        pitch: Option<f64>,
        problems: &mut Problems,
    ) -> Option<Vec<[f64; 2]>> {
        let mut sound = true;
        for (key, count) in [("columns", columns), ("rows", rows)] {
            if !(1..=200).contains(&count) {
                problems.push(key, count, "1 to 200", "choose the number of grid points along this side");
                sound = false;
            }
        }
        let pitch = match pitch {
            Some(pitch) if !(1e-3..=50.0).contains(&pitch) => {
                problems.range("pitch_mm", pitch, 1e-3, 50.0, "mm");
                return None;
            }
            None if columns > 1 || rows > 1 => {
                problems.push(
                    "pitch_mm",
                    "missing",
                    "0.001 to 50 mm",
                    "say how far apart the grid points are",
                );
                return None;
            }
            pitch => pitch.unwrap_or(0.0),
        };
        let [cx, cy] = self.center_mm.unwrap_or_default();
        let along = |center: f64, i: u32, n: u32| {
            rounded(center + (f64::from(i) - (f64::from(n) - 1.0) / 2.0) * pitch)
        };
        // Row by row from the top left of the image, as one reads.
        sound.then(|| {
            (0..rows)
                .flat_map(|j| (0..columns).map(move |i| [along(cx, i, columns), along(cy, j, rows)]))
                .collect()
        })
    }
}

impl SlideTable {
    fn check(&self, problems: &mut Problems) -> Option<Slide> {
        check_directions(&self.directions, "[\"left\", \"right\"]", problems);
        problems.range("distance_mm", self.distance_mm, 1e-3, 50.0, "mm");
        let distances = rungs("step_mm", 0.0, self.distance_mm, self.step_mm, "mm", problems)?;
        let directions = self.directions.iter().map(|d| d.0).collect();
        Some(Slide { directions, distances_mm: distances[1..].to_vec() })
    }
}

impl RotateTable {
    fn check(&self, problems: &mut Problems) -> Option<Rotate> {
        check_directions(&self.directions, "[\"cw\", \"ccw\"]", problems);
        problems.range("angle_deg", self.angle_deg, 1e-3, 360.0, "deg");
        let angles = rungs("step_deg", 0.0, self.angle_deg, self.step_deg, "deg", problems)?;
        Some(Rotate { directions: self.directions.clone(), angles_deg: angles[1..].to_vec() })
    }
}

fn check_directions<T: PartialEq + std::fmt::Debug>(
    directions: &[T],
    example: &str,
    problems: &mut Problems,
) {
    let doubled = (1..directions.len()).find(|i| directions[..*i].contains(&directions[*i]));
    if directions.is_empty() || doubled.is_some() {
        let value = if directions.is_empty() { "[]" } else { "a direction twice" };
        problems.push(
            "directions",
            value,
            "one or more directions, each once",
            format!("write e.g. `directions = {example}`"),
        );
    }
}

impl ContactTable {
    fn check(&self, clearance_mm: f64, problems: &mut Problems) -> Option<Contact> {
        let touch = [self.start_mm, self.step_mm, self.max_depth_mm, self.threshold];
        match (self.zero_mm, touch.iter().any(Option::is_some)) {
            (Some(zero_mm), false) => {
                problems.range("zero_mm", zero_mm, -50.0, 50.0, "mm");
                Some(Contact::Given { zero_mm })
            }
            (None, true) => {
                let usual = TouchOff::default();
                let touch_off = TouchOff {
                    start_mm: self.start_mm.unwrap_or(usual.start_mm),
                    step_mm: self.step_mm.unwrap_or(usual.step_mm),
                    max_depth_mm: self.max_depth_mm.unwrap_or(usual.max_depth_mm),
                    threshold: self.threshold,
                };
                touch_off.check(clearance_mm, problems);
                Some(Contact::TouchOff(touch_off))
            }
            _ => {
                problems.push(
                    "",
                    "neither or both",
                    "either zero_mm, or start_mm, step_mm and max_depth_mm of a touch-off",
                    "write `zero_mm = 0.0` where the height is known, else `step_mm = 0.1`",
                );
                None
            }
        }
    }
}

impl TouchOff {
    fn check(&self, clearance_mm: f64, problems: &mut Problems) {
        problems.range("step_mm", self.step_mm, 0.01, 0.5, "mm");
        problems.range("max_depth_mm", self.max_depth_mm, 0.0, 5.0, "mm");
        if !(self.start_mm > 0.0 && self.start_mm <= clearance_mm) {
            // Sideways travel happens before the zero is known, at clearance over the nominal contact.
            problems.push(
                "start_mm",
                self.start_mm,
                format!("more than 0, up to clearance_mm = {clearance_mm} mm"),
                "start the descent at or below the clearance height, above any possible contact",
            );
        }
        if let Some(threshold) = self.threshold {
            problems.range("threshold", threshold, 0.1, 255.0, "code values");
        }
    }
}

impl Feeds {
    fn check(&self, problems: &mut Problems) {
        problems.range("travel_mm_s", self.travel_mm_s, 1e-3, 500.0, "mm/s");
        problems.range("press_mm_s", self.press_mm_s, 1e-3, 20.0, "mm/s");
        problems.range("slide_mm_s", self.slide_mm_s, 1e-3, 50.0, "mm/s");
        problems.range("rotate_deg_s", self.rotate_deg_s, 1e-3, 720.0, "deg/s");
        problems.range("accel_mm_s2", self.accel_mm_s2, 1e-2, 1e5, "mm/s^2");
        problems.range("accel_deg_s2", self.accel_deg_s2, 1e-2, 1e6, "deg/s^2");
    }
}

impl Plan {
    /// How many captures the plan has, before it is expanded.
    pub(super) fn captures(&self) -> f64 {
        let presses = (self.indenters.len() * self.locations_mm.len() * self.depths_mm.len()) as f64;
        let slides = self.slide.as_ref().map_or(1, |s| s.directions.len() * (s.distances_mm.len() + 1));
        let turns = self.rotate.as_ref().map_or(1, |r| r.directions.len() * (r.angles_deg.len() + 1));
        f64::from(self.repeats) * presses * (slides * turns) as f64
    }
}
