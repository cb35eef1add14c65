//! From a camera's thread to whoever waits: a bounded queue that drops its oldest frame.
//!
//! Frames wait undecoded, since most are never looked at; the one that is taken is decoded on a blocking
//! thread. The choice of the frame, *the first whose exposure began at or after t*, is made here for all
//! threaded sources.

use super::CameraError;
use super::formats::{self, PixelFormat};
use crate::clock::Timestamp;
use crate::frame::{Frame, FrameStamp};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Frames kept for a taker who is late.
const CAPACITY: usize = 4;

/// A frame as the camera sent it.
pub struct RawFrame {
    /// How its bytes are to be read.
    pub format: PixelFormat,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bytes a row, 0 for rows without padding.
    pub stride: u32,
    /// The bytes used.
    pub bytes: Vec<u8>,
    /// When and how it was taken.
    pub stamp: FrameStamp,
}

impl RawFrame {
    fn decode(self, camera: &str) -> Result<Frame, CameraError> {
        let RawFrame { format, width, height, stride, bytes, stamp } = self;
        match formats::decode(format, &bytes, width, height, stride) {
            Ok(rgb) => Ok(Frame { width, height, rgb, stamp }),
            Err(why) => Err(CameraError::Decode {
                camera: camera.to_owned(),
                sequence: stamp.sequence,
                fourcc: stamp.fourcc,
                why: why.to_string(),
            }),
        }
    }
}

/// The queue; clones are handles to the same one.
#[derive(Clone, Default)]
pub struct FrameQueue(Arc<Shared>);

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    news: Notify,
}

#[derive(Default)]
struct State {
    frames: VecDeque<RawFrame>,
    lost: Option<String>,
}

impl FrameQueue {
    /// Adds a frame, throwing the oldest away when full.
    pub fn push(&self, frame: RawFrame) {
        let mut state = self.state();
        if state.frames.len() == CAPACITY {
            state.frames.pop_front();
        }
        state.frames.push_back(frame);
        drop(state);
        self.0.news.notify_one();
    }

    /// Says that no frame will come any more, and why.
    pub fn lose(&self, why: String) {
        self.state().lost.get_or_insert(why);
        self.0.news.notify_one();
    }

    /// The first frame whose exposure began at or after `t`.
    pub async fn first_after(
        &self,
        camera: &str,
        t: Timestamp,
        within: Duration,
    ) -> Result<Frame, CameraError> {
        let asked = Instant::now();
        let deadline = asked + within;
        loop {
            // Frames that arrived before the camera was lost are still good.
            while let Some(frame) = self.pop() {
                if frame.stamp.exposed_at >= t {
                    let name = camera.to_owned();
                    return match tokio::task::spawn_blocking(move || frame.decode(&name)).await {
                        Ok(decoded) => decoded,
                        Err(panic) => std::panic::resume_unwind(panic.into_panic()),
                    };
                }
            }
            if let Some(why) = self.state().lost.clone() {
                return Err(CameraError::Lost { camera: camera.to_owned(), why });
            }
            if tokio::time::timeout_at(deadline, self.0.news.notified()).await.is_err() {
                return Err(CameraError::Stalled { camera: camera.to_owned(), waited: asked.elapsed() });
            }
        }
    }

    fn pop(&self) -> Option<RawFrame> {
        self.state().frames.pop_front()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Nothing between lock and unlock can leave the queue half changed.
        self.0.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: u8, exposed_at: i64) -> RawFrame {
        let stamp = FrameStamp {
            exposed_at: Timestamp(exposed_at),
            exposure: None,
            sequence: exposed_at as u32,
            dropped_before: 0,
            flags: 0,
            fourcc: "GREY".into(),
            averaged: 1,
        };
        RawFrame { format: PixelFormat::Grey, width: 1, height: 1, stride: 0, bytes: vec![value], stamp }
    }

    #[tokio::test(start_paused = true)]
    async fn pitfall_22_frames_exposed_before_the_instant_are_passed_over() {
        let queue = FrameQueue::default();
        for i in 0..3 {
            queue.push(grey(i, i64::from(i) * 10));
        }
        let frame = queue.first_after("c", Timestamp(15), Duration::from_secs(1)).await.unwrap();
        assert_eq!(frame.rgb, [2; 3]);
        let stalled = queue.first_after("c", Timestamp(15), Duration::from_secs(1)).await;
        assert!(matches!(stalled, Err(CameraError::Stalled { .. })));
    }

    #[tokio::test(start_paused = true)]
    async fn the_oldest_is_dropped_and_the_taker_is_woken() {
        let queue = FrameQueue::default();
        for i in 0..10 {
            queue.push(grey(i, i64::from(i)));
        }
        let oldest = queue.first_after("c", Timestamp(0), Duration::from_secs(1)).await.unwrap();
        assert_eq!(oldest.stamp.sequence, 10 - CAPACITY as u32);

        let feeder = queue.clone();
        tokio::spawn(async move {
            tokio::time::sleep(Duration::from_millis(300)).await;
            feeder.push(grey(77, 100));
        });
        let fresh = queue.first_after("c", Timestamp(50), Duration::from_secs(1)).await.unwrap();
        assert_eq!(fresh.rgb, [77; 3]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_lost_camera_and_a_bad_frame_are_typed_errors() {
        let queue = FrameQueue::default();
        queue.push(RawFrame { width: 9, ..grey(1, 5) });
        queue.push(grey(2, 6));
        queue.lose("unplugged".into());
        let within = Duration::from_secs(1);
        assert!(matches!(
            queue.first_after("c", Timestamp(0), within).await,
            Err(CameraError::Decode { .. })
        ));
        assert!(queue.first_after("c", Timestamp(0), within).await.is_ok(), "what had arrived is served");
        assert!(matches!(queue.first_after("c", Timestamp(0), within).await, Err(CameraError::Lost { .. })));
    }
}
