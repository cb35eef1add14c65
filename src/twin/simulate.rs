//! Walks the tree of paths with an elastomer, and stops at every capture.

use super::branches::{Branch, Root};
use crate::elastomer::{self, Elastomer, ElastomerCapture, Material, Pad, Settings};
use crate::indenter::Indenter;
use crate::pose::Pose;
use std::collections::BTreeMap;
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
    /// A pose on the way could not be simulated; none of these captures has a simulated side.
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
    /// Set to end the walk early.
    pub cancel: &'a Arc<AtomicBool>,
    /// Receives every outcome, in the order of the walk; answers whether to go on.
    pub emit: &'a mut (dyn FnMut(Outcome) -> bool + Send),
}

impl Walk<'_> {
    /// Walks everything below the roots. Answers whether it went to the end.
    pub fn run(&mut self, roots: &[Root]) -> bool {
        roots.iter().all(|root| self.root(root))
    }

    fn root(&mut self, root: &Root) -> bool {
        let indenter =
            self.model.indenters.get(&root.indenter).expect("a checked plan names known indenters");
        let begun = Instant::now();
        match elastomer::solver(&self.model.pad, &self.model.settings, indenter.clone(), &root.start) {
            Ok(mut state) => {
                state.interrupt_by(self.cancel.clone());
                self.branches(state, &root.next, begun)
            }
            Err(error) => self.fail(&root.next, error),
        }
    }

    /// The last branch takes the state itself, the others a copy.
    fn branches(&mut self, state: Box<dyn Elastomer>, branches: &[Branch], begun: Instant) -> bool {
        let Some((last, others)) = branches.split_last() else { return true };
        for branch in others {
            if !self.branch(state.fork(), branch, begun) {
                return false;
            }
        }
        self.branch(state, last, begun)
    }

    fn branch(&mut self, mut state: Box<dyn Elastomer>, branch: &Branch, mut begun: Instant) -> bool {
        if self.cancel.load(Ordering::Relaxed) {
            return false;
        }
        match state.advance(&branch.pose) {
            Ok(()) => {}
            Err(elastomer::Error::Interrupted) => return false,
            Err(error) => return self.fail(std::slice::from_ref(branch), error),
        }
        if !branch.captures.is_empty() {
            let [nx, ny] = self.lattice;
            let pad = match state.capture(nx, ny) {
                Ok(pad) => pad,
                Err(error) => return self.fail(std::slice::from_ref(branch), error),
            };
            let (captures, took) = (branch.captures.clone(), begun.elapsed());
            let deformed = Deformed { captures, pose: branch.pose, pad, took };
            if !(self.emit)(Outcome::Deformed(Box::new(deformed))) {
                return false;
            }
            begun = Instant::now();
        }
        self.branches(state, &branch.next, begun)
    }

    fn fail(&mut self, branches: &[Branch], error: elastomer::Error) -> bool {
        let mut captures = Vec::new();
        collect_captures(branches, &mut captures);
        (self.emit)(Outcome::Failed { captures, error })
    }
}

fn collect_captures(branches: &[Branch], captures: &mut Vec<u32>) {
    for branch in branches {
        captures.extend(&branch.captures);
        collect_captures(&branch.next, captures);
    }
}
