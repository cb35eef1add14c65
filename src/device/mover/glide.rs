//! Motion by hand: jogs that are cancelled, and glides that end by themselves.
//!
//! A *jog* is one long move that somebody must cancel. A *glide* is a chain of short moves, each sent while
//! the one before it is still being carried out: whoever drives it only has to go on, and when it does not
//! (a key was let go, a program was killed, a cable came off) the device stops at the end of the last piece.

use super::travel::check_targets;
use super::{Measured, Mover, MoverError};
use crate::protocol::{Request, Which};

impl Mover {
    /// Begins a move that will be cancelled: towards `target`, which must be inside the limits.
    /// Returns when the device has accepted it; [`Mover::jog_cancel`] ends it.
    pub async fn jog(&mut self, axis: &str, target: f64, feed: f64) -> Result<(), MoverError> {
        if !self.can_cancel() {
            let protocol = self.spec.protocol.name.clone();
            return Err(MoverError::NotSupported { protocol, what: "jog commands" });
        }
        self.accept(axis, target, feed).await
    }

    /// Ends a jog: decelerates, and returns the position once the device is at rest.
    pub async fn jog_cancel(&mut self) -> Result<Vec<Measured>, MoverError> {
        self.call(Request::Run(Which::JogCancel)).await?;
        self.settle(None).await?;
        let axes = self.read_positions().await?;
        Ok(self.with_tool(axes))
    }

    /// One piece of a glide: returns when the device has accepted it, long before it has arrived.
    /// Whoever sends the next one keeps it short: this is what remains when nobody does.
    pub async fn glide(&mut self, axis: &str, target: f64, feed: f64) -> Result<(), MoverError> {
        self.accept(axis, target, feed).await
    }

    /// Ends a glide: cancels what is left of it where the protocol can, and else lets it run out.
    pub async fn end_glide(&mut self) -> Result<Vec<Measured>, MoverError> {
        if self.stop_handle().is_stopped() {
            return self.position().await;
        }
        if self.can_cancel() {
            return self.jog_cancel().await;
        }
        self.settle(None).await?;
        let axes = self.read_positions().await?;
        Ok(self.with_tool(axes))
    }

    fn can_cancel(&self) -> bool {
        !self.spec.motion.jog.is_empty() && self.spec.motion.jog_cancel.is_some()
    }

    async fn accept(&mut self, axis: &str, target: f64, feed: f64) -> Result<(), MoverError> {
        self.end_of_stop().await?;
        let axes = self.settings.pose_axes();
        let targets = check_targets(&axes, &[(axis, target)])?;
        axes[axis].limits().check_feed(axis, feed)?;
        self.require_reference()?;
        if self.tool.is_some() {
            return self.glide_tool(&targets, feed).await;
        }
        self.resting = None;
        self.call(Request::Move { targets, feed, jog: self.can_cancel() }).await?;
        Ok(())
    }
}
