//! When was this buffer exposed? From the driver's stamp to the earliest instant the exposure can have begun.
//!
//! The kernel stamps a buffer with the monotonic clock at the start of exposure (SOE) or at the end of the
//! frame (EOF), as its flags say. What drivers really do is looser, so the answer is always the *earliest*
//! the exposure can have begun:
//! - SOE: the stamp less the lead; EOF: the stamp less one frame period and the lead.
//! - A stamp later than the buffer's arrival (vivid's are) counts as the arrival.
//! - Another clock, or a stamp more than [`BELIEVABLE`] away: the buffer was empty when it was given to
//!   the driver, so the exposure began at most one period before that.
//!
//! `uvcvideo` claims SOE but stamps the arrival of the first data, so its lead is the exposure and one frame
//! period, and another period for MJPG, which the camera compresses first.

use crate::clock::Timestamp;
use ::v4l::buffer::Flags;
use std::time::Duration;

/// A stamp farther from now is of another clock, or wrapped.
pub const BELIEVABLE: Duration = Duration::from_secs(5);

/// The rule for one opened camera.
#[derive(Debug, Clone, Copy)]
pub struct StampRule {
    /// Frame period.
    pub period: Duration,
    /// How long before its stamp an exposure can have begun.
    pub lead: Duration,
}

impl StampRule {
    /// The lead that a driver needs.
    pub fn lead_of(driver: &str, exposure: Option<Duration>, period: Duration, compressed: bool) -> Duration {
        if driver != "uvcvideo" {
            return Duration::ZERO;
        }
        exposure.unwrap_or(period) + period + if compressed { period } else { Duration::ZERO }
    }

    /// The earliest instant at which the exposure can have begun.
    pub fn exposed_at(
        &self,
        stamp: Timestamp,
        flags: Flags,
        arrived: Timestamp,
        queued: Timestamp,
    ) -> Timestamp {
        let off = arrived.since(stamp).max(stamp.since(arrived));
        let monotonic = flags & Flags::TIMESTAMP_MASK == Flags::TIMESTAMP_MONOTONIC;
        if !monotonic || off > BELIEVABLE {
            return queued.before(self.period + self.lead);
        }
        let stamp = stamp.min(arrived);
        let starts = flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE;
        stamp.before(self.lead + if starts { Duration::ZERO } else { self.period })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn the_answer_is_the_earliest_possible_instant() {
        let rule = StampRule { period: 40 * MS, lead: 5 * MS };
        let now = Timestamp(100_000_000_000);
        let (queued, stamp) = (now.before(160 * MS), now.before(30 * MS));
        let monotonic = Flags::TIMESTAMP_MONOTONIC;
        let soe = monotonic | Flags::TSTAMP_SRC_SOE;
        assert_eq!(rule.exposed_at(stamp, soe, now, queued), now.before(35 * MS));
        assert_eq!(rule.exposed_at(stamp, monotonic, now, queued), now.before(75 * MS));
        // In the future: as arrived.
        assert_eq!(rule.exposed_at(now.after(35 * MS), soe, now, queued), now.before(5 * MS));
        // Unknown clock, wrapped stamp: bounded by when the buffer was queued.
        for (stamp, flags) in
            [(stamp, Flags::empty()), (Timestamp(0), soe), (now.after(600 * 1000 * MS), soe)]
        {
            assert_eq!(rule.exposed_at(stamp, flags, now, queued), queued.before(45 * MS));
        }
    }

    #[test]
    fn uvc_needs_a_lead_and_vivid_none() {
        let exposure = Some(10 * MS);
        assert_eq!(StampRule::lead_of("vivid", exposure, 33 * MS, true), Duration::ZERO);
        assert_eq!(StampRule::lead_of("uvcvideo", exposure, 33 * MS, false), 43 * MS);
        assert_eq!(StampRule::lead_of("uvcvideo", None, 33 * MS, true), 99 * MS);
    }
}
