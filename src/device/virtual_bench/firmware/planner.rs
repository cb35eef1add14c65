//! A queue of straight moves that run one after another, each from rest to rest.
//!
//! Real planners join blocks without stopping; here only the times differ, never the positions.

use super::motors::Motors;
use crate::clock::Timestamp;
use std::collections::VecDeque;

/// One move.
#[derive(Debug, Clone)]
pub struct Block {
    /// Where all axes go, in counter positions.
    pub target: Vec<f64>,
    /// Feed along the path, per second.
    pub feed: f64,
}

/// The queue. The first block is the one that moves.
#[derive(Debug)]
pub struct Planner {
    blocks: VecDeque<Block>,
    ends: Option<Timestamp>,
    held: bool,
    capacity: usize,
}

impl Planner {
    /// An empty queue for so many blocks.
    pub fn new(capacity: usize) -> Self {
        Self { blocks: VecDeque::new(), ends: None, held: false, capacity }
    }

    /// Whether nothing is left to do.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Blocks that still fit.
    pub fn free(&self) -> usize {
        self.capacity - self.blocks.len()
    }

    /// Where the last block ends: what a classic firmware calls its position.
    pub fn target(&self) -> Option<&[f64]> {
        self.blocks.back().map(|b| b.target.as_slice())
    }

    /// Queues a move at `t`; it starts at once when nothing else moves.
    pub fn push(&mut self, motors: &mut Motors, t: Timestamp, block: Block) {
        self.blocks.push_back(block);
        if self.blocks.len() == 1 && !self.held {
            self.start(motors, t);
        }
    }

    fn start(&mut self, motors: &mut Motors, t: Timestamp) {
        self.ends = self.blocks.front().map(|b| motors.line(t, &b.target, b.feed));
    }

    /// When the moving block ends.
    pub fn ends(&self) -> Option<Timestamp> {
        self.ends
    }

    /// Ends the moving block and starts the next one.
    pub fn next(&mut self, motors: &mut Motors) {
        if let Some(t) = self.ends.take() {
            self.blocks.pop_front();
            self.start(motors, t);
        }
    }

    /// Decelerates and keeps the queue; returns when the axes rest.
    pub fn hold(&mut self, motors: &mut Motors, t: Timestamp) -> Timestamp {
        self.held = true;
        self.ends = None;
        motors.stop(t)
    }

    /// Goes on after a hold.
    pub fn resume(&mut self, motors: &mut Motors, t: Timestamp) {
        self.held = false;
        self.start(motors, t);
    }

    /// Drops everything; the axes are not touched.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.ends = None;
        self.held = false;
    }
}
