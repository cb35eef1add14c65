//! What is still to be walked, and by how many it is walked now.

use super::branches::{Branch, Root};
use crate::elastomer::Elastomer;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A path that waits for a walker.
pub(super) enum Path<'a> {
    /// From rest.
    FromRest(&'a Root),
    /// From where another path forked.
    Forked(Box<dyn Elastomer>, &'a Branch),
}

/// Paths that wait, latest first: what has begun is ended before anything else begins, so few states are kept.
pub(super) struct Agenda<'a> {
    state: Mutex<State<'a>>,
    changed: Condvar,
}

struct State<'a> {
    waiting: Vec<Path<'a>>,
    walking: usize,
    is_stopped: bool,
}

/// A path handed to a walker. Dropping it tells the others that it has ended, however it did.
pub(super) struct Turn<'t, 'a> {
    agenda: &'t Agenda<'a>,
}

impl Drop for Turn<'_, '_> {
    fn drop(&mut self) {
        let mut state = self.agenda.locked();
        state.walking -= 1;
        if std::thread::panicking() {
            state.stop();
        }
        drop(state);
        self.agenda.changed.notify_all();
    }
}

impl State<'_> {
    fn stop(&mut self) {
        self.is_stopped = true;
        self.waiting.clear();
    }
}

impl<'a> Agenda<'a> {
    /// All roots wait, the first on top.
    pub fn of(roots: &'a [Root]) -> Self {
        let waiting = roots.iter().rev().map(Path::FromRest).collect();
        Self { state: Mutex::new(State { waiting, walking: 0, is_stopped: false }), changed: Condvar::new() }
    }

    /// The next path; waits while there is none and somebody walks, who may fork. `None` when all is done or stopped.
    pub fn next<'t>(&'t self) -> Option<(Turn<'t, 'a>, Path<'a>)> {
        let mut state = self.locked();
        loop {
            if let Some(path) = state.waiting.pop() {
                state.walking += 1;
                return Some((Turn { agenda: self }, path));
            }
            if state.walking == 0 || state.is_stopped {
                return None;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Adds forks, the first of which is taken first.
    pub fn add(&self, forks: Vec<Path<'a>>) {
        let mut state = self.locked();
        if !state.is_stopped {
            state.waiting.extend(forks.into_iter().rev());
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Nothing more is begun.
    pub fn stop(&self) {
        self.locked().stop();
        self.changed.notify_all();
    }

    /// How many walk.
    pub fn walking(&self) -> usize {
        self.locked().walking
    }

    /// Whether it was stopped before its end.
    pub fn is_stopped(&self) -> bool {
        self.locked().is_stopped
    }

    fn locked(&self) -> MutexGuard<'_, State<'a>> {
        // A walker that panicked leaves the agenda whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
