//! Touch-off: where the pad begins, found by looking.
//!
//! The indenter descends in steps until the picture differs from the background, backs off, and
//! descends again in steps ten times finer. What counts as different is the largest change of any
//! block of pixels: a contact is small and sharp, noise averages out within a block, and a change of
//! the light is removed beforehand as the median of all blocks.
//!
//! A picture shows a contact only when the tip has pressed a little, a round one later than a flat one.
//! But the change grows in proportion to the depth (found by experiment, with round, flat and pointed tips),
//! so the line through the first few changes leads back to where it began.

use super::bench::{Bench, BenchError, Feeds};
use crate::frame::Frame;
use crate::pose::Pose;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How to look for the contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TouchOffSettings {
    /// Height of the first look above the nominal contact, mm.
    pub start_mm: f64,
    /// Coarse step, mm; the fine one is a tenth of it.
    pub step_mm: f64,
    /// Change of a block that counts as contact, code values.
    pub threshold: f64,
    /// Deepest descent below the nominal contact, mm.
    pub max_depth_mm: f64,
    /// Feed of the descent, mm/s.
    pub feed_mm_s: f64,
}

/// The contact as it was found.
#[derive(Debug, Clone)]
pub struct Contact {
    /// Height of the tip at contact in the frame of the nominal contact, mm.
    pub zero_mm: f64,
    /// The first frame that showed it.
    pub frame: Frame,
    /// How strongly it showed, code values.
    pub change: f64,
}

/// Why no contact was found.
#[derive(Debug, thiserror::Error)]
pub enum TouchOffError {
    /// The bench failed.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// Nothing changed on the whole way down.
    #[error(
        "no contact seen down to {deepest_mm:.3} mm below the nominal contact (largest change {change:.2} of {threshold} code values); check that the indenter is mounted over the pad, correct motion.z.origin, or raise contact.max_depth_mm"
    )]
    NotFound {
        /// Deepest position looked at.
        deepest_mm: f64,
        /// Largest change seen.
        change: f64,
        /// What was needed.
        threshold: f64,
    },
    /// The picture differed before the descent began.
    #[error(
        "the picture differs from the background by {change:.2} code values (threshold {threshold}) before the descent, {height_mm:.3} mm above the nominal contact; the indenter already touches, or the light changed: raise contact.start_mm or take a new background"
    )]
    AlreadyDifferent {
        /// Change seen.
        change: f64,
        /// What counts as contact.
        threshold: f64,
        /// Height of the tip.
        height_mm: f64,
    },
}

/// Fine steps below the first one that shows a contact.
const FURTHER_STEPS: u32 = 3;

/// How long a picture may take to come to rest.
const STILL_WITHIN: Duration = Duration::from_secs(5);

/// Finds the contact below (x, y) of `over`, where the indenter hovers; what travel is left to the first
/// look goes at the feeds of `travel`. The indenter is left in contact, a few fine steps deep.
pub async fn find_contact(
    bench: &mut Bench,
    over: &Pose,
    background: &Frame,
    settings: &TouchOffSettings,
    travel: Feeds,
    still_rms: f64,
) -> Result<Contact, TouchOffError> {
    let feeds = Feeds { mm_s: settings.feed_mm_s, ..travel };
    let search = Search { over: *over, background, settings, feeds, still_rms };

    bench.go(&Pose { z_mm: settings.start_mm, ..*over }, travel).await?;
    let (_, change) = search.look(bench).await?;
    if change > settings.threshold {
        let (threshold, height_mm) = (settings.threshold, settings.start_mm);
        return Err(TouchOffError::AlreadyDifferent { change, threshold, height_mm });
    }

    // Coarse descent, then again from one step higher in fine steps.
    let coarse = search.descend(bench, settings.start_mm, settings.step_mm).await?;
    let back = coarse.zero_mm + settings.step_mm;
    bench.go(&Pose { z_mm: back, ..*over }, feeds).await?;
    let fine_mm = settings.step_mm / 10.0;
    let seen = search.descend(bench, back, fine_mm).await?;

    // A little further, to see how fast the change grows.
    let mut changes = vec![(seen.zero_mm, seen.change)];
    for k in 1..=FURTHER_STEPS {
        let z_mm = seen.zero_mm - f64::from(k) * fine_mm;
        if z_mm < -settings.max_depth_mm {
            break;
        }
        bench.go(&Pose { z_mm, ..search.over }, search.feeds).await?;
        changes.push((z_mm, search.look(bench).await?.1));
    }
    let began = beginning(&changes).unwrap_or(seen.zero_mm);
    Ok(Contact { zero_mm: began.clamp(seen.zero_mm, back), ..seen })
}

/// Where the least-squares line through (height, change) reaches no change; `None` when it does not grow downwards.
fn beginning(changes: &[(f64, f64)]) -> Option<f64> {
    let n = changes.len() as f64;
    let mean_z = changes.iter().map(|(z, _)| z).sum::<f64>() / n;
    let mean_change = changes.iter().map(|(_, c)| c).sum::<f64>() / n;
    let along: f64 = changes.iter().map(|(z, c)| (z - mean_z) * (c - mean_change)).sum();
    let spread: f64 = changes.iter().map(|(z, _)| (z - mean_z).powi(2)).sum();
    let slope = along / spread;
    (slope < 0.0).then(|| mean_z - mean_change / slope)
}

struct Search<'a> {
    over: Pose,
    background: &'a Frame,
    settings: &'a TouchOffSettings,
    feeds: Feeds,
    still_rms: f64,
}

impl Search<'_> {
    /// A still frame and how much it differs from the background.
    async fn look(&self, bench: &mut Bench) -> Result<(Frame, f64), TouchOffError> {
        let frame = bench.still_frame(self.still_rms, STILL_WITHIN).await?.frame;
        let change = largest_block_change(self.background, &frame);
        Ok((frame, change))
    }

    async fn descend(&self, bench: &mut Bench, from_mm: f64, step_mm: f64) -> Result<Contact, TouchOffError> {
        let TouchOffSettings { max_depth_mm, threshold, .. } = *self.settings;
        let mut largest = 0.0_f64;
        // A whole number of steps is not lost to rounding.
        let steps = ((from_mm + max_depth_mm) / step_mm + 1e-6).floor() as u64;
        for k in 1..=steps {
            let z_mm = from_mm - k as f64 * step_mm;
            bench.go(&Pose { z_mm, ..self.over }, self.feeds).await?;
            let (frame, change) = self.look(bench).await?;
            largest = largest.max(change);
            if change > threshold {
                return Ok(Contact { zero_mm: z_mm, frame, change });
            }
        }
        Err(TouchOffError::NotFound { deepest_mm: max_depth_mm, change: largest, threshold })
    }
}

/// Side of a block, pixels: a contact of a few tenths of a millimetre fills one.
const BLOCK: usize = 16;

/// Side of a cell of a block, pixels: many enough that noise averages out, few enough to lie on one flank of a dent.
const CELL: usize = 4;

/// Largest change of any block and channel: the root mean square of the changes of its cells' means, after the
/// median change of the picture is taken off. Between lights that face each other a dent is as bright on one flank
/// as it is dark on the other: the mean of a whole block would see nothing.
pub fn largest_block_change(a: &Frame, b: &Frame) -> f64 {
    if (a.width, a.height) != (b.width, b.height) {
        return f64::INFINITY;
    }
    let (w, h) = (a.width as usize, a.height as usize);
    let columns = w.div_ceil(CELL);
    let mut largest = 0.0_f64;
    for channel in 0..3 {
        // 1. Changes of the cells, less what the whole picture changed.
        let mut cells = Vec::with_capacity(columns * h.div_ceil(CELL));
        for cy in (0..h).step_by(CELL) {
            for cx in (0..w).step_by(CELL) {
                let (mut sum, mut count) = (0_i64, 0_i64);
                for y in cy..(cy + CELL).min(h) {
                    for x in cx..(cx + CELL).min(w) {
                        let i = (y * w + x) * 3 + channel;
                        sum += i64::from(b.rgb[i]) - i64::from(a.rgb[i]);
                        count += 1;
                    }
                }
                cells.push(sum as f64 / count as f64);
            }
        }
        let mut sorted = cells.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);

        // 2. Root mean square over each block.
        let rows = cells.len() / columns.max(1);
        const ACROSS: usize = BLOCK / CELL;
        for by in (0..rows).step_by(ACROSS) {
            for bx in (0..columns).step_by(ACROSS) {
                let (mut squares, mut count) = (0.0, 0);
                for y in by..(by + ACROSS).min(rows) {
                    for x in bx..(bx + ACROSS).min(columns) {
                        squares += (cells[y * columns + x] - median).powi(2);
                        count += 1;
                    }
                }
                largest = largest.max((squares / f64::from(count)).sqrt());
            }
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Timestamp;
    use crate::frame::FrameStamp;

    fn frame(f: impl Fn(usize, usize) -> u8) -> Frame {
        let stamp = FrameStamp {
            exposed_at: Timestamp(0),
            exposure: None,
            sequence: 0,
            dropped_before: 0,
            flags: 0,
            fourcc: "RGB3".into(),
            averaged: 1,
        };
        let rgb = (0..64 * 64).flat_map(|i| [f(i % 64, i / 64); 3]).collect();
        Frame { width: 64, height: 64, rgb, stamp }
    }

    #[test]
    fn the_beginning_of_a_line_is_where_it_is_zero_and_a_flat_one_has_none() {
        let line: Vec<_> =
            (0..4).map(|k| 0.05 - 0.01 * f64::from(k)).map(|z| (z, 80.0 * (0.07 - z))).collect();
        assert!((beginning(&line).unwrap() - 0.07).abs() < 1e-9);
        assert_eq!(beginning(&[(0.05, 2.0), (0.04, 2.0)]), None);
        assert_eq!(beginning(&[(0.05, 2.0)]), None);
    }

    #[test]
    fn a_dimmer_light_is_no_contact_but_a_small_spot_is() {
        let background = frame(|_, _| 100);
        let noise = |x: usize, y: usize| if (x * 7 + y * 13).is_multiple_of(2) { 3 } else { 0 };
        let dimmer = frame(|x, y| 93 + noise(x, y));
        assert!(largest_block_change(&background, &dimmer) < 0.5);
        let spot =
            frame(|x, y| if (20..28).contains(&x) && (20..28).contains(&y) { 140 } else { 93 + noise(x, y) });
        assert!(largest_block_change(&background, &spot) > 5.0);
    }
}
