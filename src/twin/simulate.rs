//! Walks the tree of paths with an elastomer, several paths at a time, and stops at every capture.

use super::agenda::{Agenda, Path};
use super::branches::{Branch, Root};
use super::crew::Crew;
use crate::elastomer::{self, Elastomer, ElastomerCapture, Material, Mode, Pad, Settings};
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What is simulated: a pad, how, and the indenters that may be mounted.
#[derive(Debug, Clone)]
pub struct Model {
    /// The pad.
    pub pad: Pad,
    /// How it is solved.
    pub settings: Settings,
    /// Indenters by name.
    pub indenters: BTreeMap<String, Arc<dyn Indenter>>,
}

impl Model {
    /// The pad's material with the overrides of the settings.
    pub fn material(&self) -> Material {
        let (own, set) = (self.pad.material, &self.settings);
        Material {
            law: set.law.unwrap_or(own.law),
            youngs_modulus_mpa: set.youngs_modulus_mpa.unwrap_or(own.youngs_modulus_mpa),
            poisson_ratio: set.poisson_ratio.unwrap_or(own.poisson_ratio),
            ..own
        }
    }
}

/// The pad at a pose that captures want.
#[derive(Debug, Clone)]
pub struct Deformed {
    /// All captures that share this state, in plan order.
    pub captures: Vec<u32>,
    /// The pose that was followed.
    pub pose: Pose,
    /// Surface, forces, statistics.
    pub pad: ElastomerCapture,
    /// Time spent on the way here since the last capture of this path.
    pub took: Duration,
}

/// What becomes of wanted captures.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// Simulated.
    Deformed(Box<Deformed>),
    /// A pose on the way, or these captures' own, could not be simulated; none of them has a simulated side.
    Failed {
        /// The captures concerned.
        captures: Vec<u32>,
        /// Why.
        error: elastomer::Error,
    },
}

/// What the walk needs besides the tree.
pub struct Walk<'a> {
    /// What is simulated.
    pub model: &'a Model,
    /// Points of the surface lattice along x and y.
    pub lattice: [usize; 2],
    /// Who walks.
    pub crew: &'a Crew,
    /// Set to end the walk early.
    pub cancel: &'a Arc<AtomicBool>,
    /// Receives every outcome and answers whether to go on. Those of one path come in its order; those of paths that are
    /// walked side by side come as they are ready, also at the same time.
    pub emit: &'a (dyn Fn(Outcome) -> bool + Sync),
}

impl Walk<'_> {
    /// Walks everything below the roots. Answers whether it went to the end.
    pub fn run(&self, roots: &[Root]) -> bool {
        let agenda = Agenda::of(roots);
        std::thread::scope(|scope| {
            for walker in 0..self.walkers() {
                let agenda = &agenda;
                scope.spawn(move || self.walk(agenda, walker));
            }
        });
        !agenda.is_stopped()
    }

    /// The explicit modes keep every core busy with one path, and their particles fill the memory.
    fn walkers(&self) -> usize {
        match self.model.settings.mode {
            Mode::QuasiStatic => self.crew.walkers(),
            Mode::Mpm | Mode::Impm => 1,
        }
    }

    fn walk<'r>(&self, agenda: &Agenda<'r>, walker: usize) {
        while let Some((turn, path)) = agenda.next() {
            let walked = Walker { walk: self, agenda, walker }.path(path);
            if walked.is_break() {
                agenda.stop();
            }
            drop(turn);
        }
    }
}

/// One of those who walk.
struct Walker<'w, 'r> {
    walk: &'w Walk<'w>,
    agenda: &'w Agenda<'r>,
    walker: usize,
}

impl<'r> Walker<'_, 'r> {
    /// Walks one path to its end and leaves its forks to others. Breaks when all are to stop.
    fn path(&self, path: Path<'r>) -> ControlFlow<()> {
        let mut begun = Instant::now();
        let (mut state, mut branch) = match path {
            Path::Forked(state, branch) => (state, branch),
            Path::FromRest(root) => {
                let state = match self.at_rest(root) {
                    Ok(state) => state,
                    Err(error) => return self.fail(&root.next, error),
                };
                match self.forked(state, &root.next) {
                    Some(first) => first,
                    None => return ControlFlow::Continue(()),
                }
            }
        };
        loop {
            if self.walk.cancel.load(Ordering::Relaxed) {
                return ControlFlow::Break(());
            }
            let ([nx, ny], captures) = (self.walk.lattice, branch.captures.clone());
            let is_wanted = !captures.is_empty();
            let told = self.step(|| {
                state.advance(&branch.pose)?;
                is_wanted.then(|| state.capture(nx, ny)).transpose()
            });
            match told {
                Ok(Some(pad)) => {
                    let (pose, took) = (branch.pose, begun.elapsed());
                    self.emit(Outcome::Deformed(Box::new(Deformed { captures, pose, pad, took })))?;
                    begun = Instant::now();
                }
                Ok(None) => (),
                Err(elastomer::Error::Interrupted) => return ControlFlow::Break(()),
                // Nobody asks how well a place on the way is known.
                Err(error) if error.goes_on() && !is_wanted => (),
                Err(error) if error.goes_on() => self.emit(Outcome::Failed { captures, error })?,
                Err(error) => return self.fail(std::slice::from_ref(branch), error),
            }
            match self.forked(state, &branch.next) {
                Some(next) => (state, branch) = next,
                None => return ControlFlow::Continue(()),
            }
        }
    }

    fn at_rest(&self, root: &Root) -> Result<Box<dyn Elastomer>, elastomer::Error> {
        let Model { pad, settings, indenters } = self.walk.model;
        let indenter = indenters.get(&root.indenter).expect("a checked plan names known indenters");
        let mut state = self.step(|| elastomer::solver(pad, settings, indenter.clone(), &root.start))?;
        state.interrupt_by(self.walk.cancel.clone());
        Ok(state)
    }

    /// The first branch takes the state itself and goes on with it; the others wait with a copy.
    fn forked(
        &self,
        state: Box<dyn Elastomer>,
        branches: &'r [Branch],
    ) -> Option<(Box<dyn Elastomer>, &'r Branch)> {
        let (first, others) = branches.split_first()?;
        self.agenda.add(others.iter().map(|branch| Path::Forked(state.fork(), branch)).collect());
        Some((state, first))
    }

    fn fail(&self, branches: &[Branch], error: elastomer::Error) -> ControlFlow<()> {
        let mut captures = Vec::new();
        collect_captures(branches, &mut captures);
        if captures.is_empty() {
            // Nobody asks what becomes of a retract.
            return ControlFlow::Continue(());
        }
        self.emit(Outcome::Failed { captures, error })
    }

    fn emit(&self, outcome: Outcome) -> ControlFlow<()> {
        match self.step(|| (self.walk.emit)(outcome)) {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        }
    }

    fn step<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.walk.crew.step(self.walker, self.agenda.walking(), work)
    }
}

fn collect_captures(branches: &[Branch], captures: &mut Vec<u32>) {
    for branch in branches {
        captures.extend(&branch.captures);
        collect_captures(&branch.next, captures);
    }
}

#[cfg(test)]
mod tests;
