//! The mean of several exposures, from any camera.
//!
//! All of them begin at or after the instant asked for, so the mean is as fresh as a single frame. Its stamp
//! is that of the first; drops and flags of all are gathered in it.

use super::{Camera, CameraDescription, CameraError, FrameFuture};
use crate::clock::Timestamp;
use crate::frame::Frame;
use std::time::Duration;

/// A camera whose frames are means of `of` exposures of another.
pub struct Averaged {
    inner: Box<dyn Camera>,
    of: u16,
}

impl Averaged {
    /// Averages `of` exposures (at least 1) into each frame.
    pub fn new(inner: Box<dyn Camera>, of: u16) -> Self {
        Self { inner, of: of.max(1) }
    }

    async fn mean_after(&mut self, t: Timestamp, within: Duration) -> Result<Frame, CameraError> {
        let mut mean = self.inner.frame_after(t, within).await?;
        let mut sums: Vec<u32> = mean.rgb.iter().map(|v| u32::from(*v)).collect();
        let mut last = mean.stamp.exposed_at;
        for _ in 1..self.of {
            let frame = self.inner.frame_after(last.after(Duration::from_nanos(1)), within).await?;
            sums.iter_mut().zip(&frame.rgb).for_each(|(s, v)| *s += u32::from(*v));
            last = frame.stamp.exposed_at;
            mean.stamp.dropped_before += frame.stamp.dropped_before;
            mean.stamp.flags |= frame.stamp.flags;
        }
        let n = u32::from(self.of);
        mean.rgb.iter_mut().zip(sums).for_each(|(v, s)| *v = ((s + n / 2) / n) as u8);
        mean.stamp.averaged = self.of;
        Ok(mean)
    }
}

impl Camera for Averaged {
    fn description(&self) -> &CameraDescription {
        self.inner.description()
    }

    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_> {
        Box::pin(self.mean_after(t, within))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameStamp;

    /// Serves 1 x 1 frames of the given brightness, one a millisecond, and one drop before each.
    struct Steps(CameraDescription, Vec<u8>, u32);

    impl Camera for Steps {
        fn description(&self) -> &CameraDescription {
            &self.0
        }

        fn frame_after(&mut self, t: Timestamp, _: Duration) -> FrameFuture<'_> {
            let (value, sequence) = (self.1.remove(0), self.2);
            self.2 += 1;
            let stamp = FrameStamp {
                exposed_at: t.after(Duration::from_millis(1)),
                exposure: None,
                sequence,
                dropped_before: 1,
                flags: 1 << sequence,
                fourcc: "RGB3".into(),
                averaged: 1,
            };
            Box::pin(async move { Ok(Frame { width: 1, height: 1, rgb: vec![value; 3], stamp }) })
        }
    }

    #[tokio::test]
    async fn the_mean_is_rounded_and_gathers_what_happened() {
        let steps = Steps(CameraDescription::default(), vec![10, 11, 11, 99], 0);
        let mut camera = Averaged::new(Box::new(steps), 3);
        let frame = camera.frame_after(Timestamp(0), Duration::from_secs(1)).await.unwrap();
        assert_eq!(frame.rgb, [11; 3]);
        assert_eq!((frame.stamp.averaged, frame.stamp.dropped_before, frame.stamp.flags), (3, 3, 0b111));
        assert_eq!(frame.stamp.exposed_at, Timestamp(1_000_000));
    }
}
