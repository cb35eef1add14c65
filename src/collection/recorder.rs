//! Stores what a session hands over, in order, on a thread of its own: the disk never holds up a port.

use super::{BACKGROUND, CollectionError, Progress};
use crate::dataset::{AxisRecord, Dataset, RealRecord};
use crate::frame::Frame;
use crate::image;
use crate::session::{Event, RealCapture};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::{mpsc, watch};

/// What every row of a run has in common.
#[derive(Debug, Clone)]
pub struct RunNotes {
    /// Name of the run, written in each row.
    pub session: String,
    /// Whether the frames are made up by the virtual bench.
    pub is_virtual: bool,
    /// `given` or `touch_off`.
    pub contact_method: String,
}

pub(super) struct Recorder {
    pub dataset: Arc<Dataset>,
    pub run: RunNotes,
    pub background: watch::Sender<Option<Arc<Vec<u8>>>>,
    pub measured: watch::Sender<BTreeSet<u32>>,
    /// Set when nothing more is to be stored; the session then ends at its next capture, retracted.
    pub end: Arc<AtomicBool>,
    pub progress: mpsc::UnboundedSender<Progress>,
}

impl Recorder {
    /// Stores events until the session has no more. The first failure ends it, and with it the session.
    pub fn run(self, mut events: mpsc::Receiver<Event>) -> Result<(), CollectionError> {
        while let Some(event) = events.blocking_recv() {
            if self.end.load(Ordering::Relaxed) {
                break;
            }
            self.store(event)?;
        }
        Ok(())
    }

    fn store(&self, event: Event) -> Result<(), CollectionError> {
        match event {
            Event::Identified { device, identity } => self.note(format!("{device}: {identity}")),
            Event::Homed => self.note("homed".into()),
            Event::Mounted { indenter } => self.tell(Progress::Indenter(indenter)),
            Event::Background { indenter, number, frame, drift_rms } => {
                self.store_background(&indenter, number, &frame, drift_rms)?;
            }
            Event::Touched { indenter, contact_zero_mm, frame } => {
                let name = format!("touch-off-{}-{indenter}", self.run.session);
                self.dataset.put_background(&name, &png(&frame)?)?;
                self.note(format!("{indenter}: contact at {contact_zero_mm:+.3} mm from the nominal height"));
            }
            Event::Captured(capture) => self.store_capture(&capture)?,
            Event::Episode { .. } | Event::Retracted => {}
        }
        Ok(())
    }

    fn store_background(
        &self,
        indenter: &str,
        number: u32,
        frame: &Frame,
        drift_rms: f64,
    ) -> Result<(), CollectionError> {
        let bytes = png(frame)?;
        if self.background.borrow().is_none() {
            self.dataset.put_background(BACKGROUND, &bytes)?;
            self.background.send_replace(Some(Arc::new(bytes.clone())));
        }
        let name = format!("{}-{number:03}-{indenter}", self.run.session);
        self.dataset.put_background(&name, &bytes)?;
        tracing::info!(indenter, number, drift_rms, "background");
        Ok(())
    }

    fn store_capture(&self, c: &RealCapture) -> Result<(), CollectionError> {
        let stamp = &c.frame.stamp;
        let record = RealRecord {
            session: self.run.session.clone(),
            is_virtual: self.run.is_virtual,
            commanded: c.commanded,
            measured: c.measured,
            contact_zero_mm: c.contact_zero_mm,
            contact_method: self.run.contact_method.clone(),
            axes: c
                .axes
                .iter()
                .map(|a| AxisRecord {
                    device: a.device.clone(),
                    axis: a.axis.clone(),
                    commanded: a.commanded,
                    measured: a.measured,
                })
                .collect(),
            departed: c.departed,
            exposed_mono_ns: stamp.exposed_at.0,
            settled_mono_ns: c.settled_at.0,
            utc_ns: c.utc_ns,
            settle_ms: c.settle.as_secs_f64() * 1e3,
            still_rms: c.still_rms,
            frame_sequence: stamp.sequence,
            frame_flags: stamp.flags,
            dropped_before: stamp.dropped_before,
            frames_averaged: stamp.averaged,
            exposure_us: stamp.exposure.map(|e| e.as_secs_f64() * 1e6),
            width: c.frame.width,
            height: c.frame.height,
            fourcc: stamp.fourcc.clone(),
            drift_rms: c.drift_rms,
        };
        self.dataset.append_real(c.capture, record, &png(&c.frame)?)?;
        self.measured.send_modify(|done| _ = done.insert(c.capture));
        self.tell(Progress::Real { capture: c.capture });
        if c.departed {
            let (to, at) = (c.commanded, c.measured);
            self.note(format!(
                "capture {}: measured ({at}) departs from commanded ({to}); the row is flagged",
                c.capture
            ));
        }
        Ok(())
    }

    fn note(&self, text: String) {
        self.tell(Progress::Note(text));
    }

    /// Nobody watching is no error.
    fn tell(&self, progress: Progress) {
        let _ = self.progress.send(progress);
    }
}

fn png(frame: &Frame) -> Result<Vec<u8>, CollectionError> {
    Ok(image::png::encode(frame)?)
}
