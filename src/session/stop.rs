//! Stopping: one switch that reaches every mover without waiting for any queue.
//!
//! Raising the switch calls each mover's stop in turn, on the caller's thread; a port that is dead
//! delays no other. The level is up before the first of these calls, so that nobody who sees a stopped
//! mover takes it for one that may go on.

use std::sync::{Arc, Mutex};
use tokio::sync::watch;

/// How hard to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum StopLevel {
    /// Keep going.
    #[default]
    Running,
    /// Decelerate, keep the position, retract, leave everything consistent.
    Controlled,
    /// At once, even at the price of the position.
    Emergency,
}

/// Sends the stop bytes of one mover.
pub type StopAction = Box<dyn Fn(StopLevel) + Send + Sync>;

/// The switch. Clones are the same switch.
#[derive(Clone)]
pub struct StopSwitch {
    actions: Arc<Mutex<Vec<(String, StopAction)>>>,
    level: Arc<watch::Sender<StopLevel>>,
}

impl std::fmt::Debug for StopSwitch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "StopSwitch({:?})", self.level())
    }
}

impl Default for StopSwitch {
    fn default() -> Self {
        Self { actions: Arc::default(), level: Arc::new(watch::Sender::new(StopLevel::Running)) }
    }
}

impl StopSwitch {
    /// A switch that stops nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a mover. If the switch is already up, the mover is stopped at once.
    pub fn register(&self, device: &str, stop: StopAction) {
        let mut actions = self.actions.lock().unwrap_or_else(|e| e.into_inner());
        let level = self.level();
        if level > StopLevel::Running {
            stop(level);
        }
        actions.push((device.to_owned(), stop));
    }

    /// Raises the switch; it can only go up. Every mover's stop has been called on return.
    pub fn raise(&self, level: StopLevel) {
        let higher = |now: &mut StopLevel| {
            let rises = level > *now;
            *now = level.max(*now);
            rises
        };
        if !self.level.send_if_modified(higher) {
            return;
        }
        for (_, stop) in self.actions.lock().unwrap_or_else(|e| e.into_inner()).iter() {
            stop(level);
        }
    }

    /// How hard it is being stopped now.
    pub fn level(&self) -> StopLevel {
        *self.level.borrow()
    }

    /// Whether anything was asked to stop.
    pub fn is_raised(&self) -> bool {
        self.level() > StopLevel::Running
    }

    /// Waits until the switch is at least this high.
    pub async fn raised_to(&self, level: StopLevel) {
        let mut watch = self.level.subscribe();
        // The sender lives as long as `self`, so waiting can only end with the level reached.
        let _ = watch.wait_for(|now| *now >= level).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[tokio::test]
    async fn raising_reaches_every_mover_once_and_wakes_who_waits() {
        let (switch, stopped) = (StopSwitch::new(), Arc::new(AtomicUsize::new(0)));
        for device in ["arm", "stage"] {
            let count = stopped.clone();
            switch.register(device, Box::new(move |_| _ = count.fetch_add(1, Ordering::SeqCst)));
        }
        let waiter = tokio::spawn({
            let switch = switch.clone();
            async move { switch.raised_to(StopLevel::Controlled).await }
        });
        switch.raise(StopLevel::Controlled);
        switch.raise(StopLevel::Controlled);
        waiter.await.expect("the waiter wakes");
        assert_eq!(stopped.load(Ordering::SeqCst), 2);
        switch.raise(StopLevel::Emergency);
        assert_eq!(stopped.load(Ordering::SeqCst), 4);
    }

    #[test]
    fn who_comes_late_is_stopped_too() {
        let (switch, stopped) = (StopSwitch::new(), Arc::new(AtomicUsize::new(0)));
        switch.raise(StopLevel::Controlled);
        let count = stopped.clone();
        switch.register("arm", Box::new(move |_| _ = count.fetch_add(1, Ordering::SeqCst)));
        assert_eq!(stopped.load(Ordering::SeqCst), 1);
    }
}
