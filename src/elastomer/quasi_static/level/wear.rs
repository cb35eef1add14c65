//! How long the increments of a way are, and how what sticks wears along it until it tears loose.

use super::super::resolution::LONGEST_INCREMENT_MM;
use super::Level;
use super::way::{turn_of, way_between};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Longest way along the face in one increment with friction, mm.
const LONGEST_SLIDE_MM: f64 = 0.25;
/// The same with infinite friction over the width of a cell. Found by experiment: in increments of 0.25 mm over cells of 0.31 mm a
/// sphere of radius 4, pressed 0.5 mm and slid 1 mm, drags 5 % less than in shorter ones; in those it drags as hard as over cells
/// of 0.42 and 0.21 mm within 1 %.
const SLIDE_OVER_CELL: f64 = 0.625;
/// Part of what is pressed that may be let go and come back within an increment: what it held falls to its neighbours, which may
/// let go in turn. Found by experiment: a sphere of radius 4, infinite friction, 0.25 mm deep and slid 1 mm over cells of 0.31 mm,
/// loses half of its points and a third of its drag in an increment of 0.125 mm; in shorter ones it drags as over other cells.
const MOST_IDLE: f64 = 0.05;
/// So far along the face, over the depth, and at least so far, mm, what sticks holds, to and fro counted; over as much again it tears
/// loose. Found by experiment: up to three depths finer cells and shorter increments drag the same within 6 %; beyond, what holds
/// goes by how they fall. (The least is for presses so shallow that a usual waypoint would lie beyond.)
pub(super) const HELD_OVER_DEPTH: f64 = 2.0;
/// See [`HELD_OVER_DEPTH`].
const HELD_MM: f64 = 1.0;
/// A turn is as long along the face as the way of the contact's furthest point, but no longer than that of a point so far from the
/// axis, mm. Found by experiment: a crescent that sticks, whose tips are further away, turns on by 45 degrees with this.
const LONGEST_ARM_MM: f64 = 2.865;
/// Wear with which what sticks begins to tear, and with which it is loose.
const TEARS: [f64; 2] = [1.0, 2.0];
/// Wear that is added where no equilibrium is found for what holds.
const TORN_AT_ONCE: f64 = 0.5;
/// Length of increments over the usual while it tears. Found by experiment: what springs back in one of 0.25 mm lets the tips of the
/// moon dig into the face; in those of 0.03 to 0.125 mm it does not, and the drags agree within 2 %.
const TEARING_INCREMENT: f64 = 0.5;
/// Less than what rounding makes of a wear.
const WEAR_ROUNDING: f64 = 1e-9;
/// Largest turn in one increment, degrees.
const LARGEST_TURN_DEG: f64 = 5.0;
/// Part of an increment that rounding may add to a way of whole ones.
const WAY_ROUNDING: f64 = 1e-9;

impl Level {
    /// How many increments a way takes: a press may be long; what moves along the face with friction goes
    /// part of a cell at a time, so that points come and go a few at once, and half of that while it tears loose.
    pub fn increments(&self, indenter: &dyn Indenter, to: &Pose) -> f64 {
        let from = &self.at.pose;
        let along = (to.x_mm - from.x_mm).hypot(to.y_mm - from.y_mm);
        let down = (to.z_mm - from.z_mm).abs();
        let turn = (to.theta_deg - from.theta_deg).abs();
        let sticks = self.at.contacts.sticks();
        let worn = self.worn_after(indenter, to, &way_between(from, to));
        let tears = worn > TEARS[0] + WEAR_ROUNDING && self.at.worn < TEARS[1] - WEAR_ROUNDING;
        let part = if sticks && tears { TEARING_INCREMENT } else { 1.0 };
        let slide = if sticks { SLIDE_OVER_CELL * self.grid().hx } else { LONGEST_SLIDE_MM };
        let friction = [self.increment_mm, part * slide.min(LONGEST_SLIDE_MM)];
        let free = [self.free_increment_mm, LONGEST_INCREMENT_MM];
        let [deep, far] = if self.at.contacts.has_friction() { friction } else { free };
        let increments = (down / deep).max(along / far).max(turn / (part * LARGEST_TURN_DEG));
        (increments - WAY_ROUNDING).ceil().max(1.0)
    }

    /// How worn the contact is after a way to `pose`.
    pub(super) fn worn_after(&self, indenter: &dyn Indenter, pose: &Pose, way: &[f64; 4]) -> f64 {
        let held_mm = HELD_MM.max(HELD_OVER_DEPTH * self.at.contacts.depth_mm(indenter, pose));
        self.at.worn + self.dragged_by(way) / held_mm
    }

    /// How far along the face what touches goes on a way, mm.
    pub(super) fn dragged_by(&self, way: &[f64; 4]) -> f64 {
        let arm_mm = self.at.contacts.furthest_from_axis_mm().min(LONGEST_ARM_MM);
        way[0].hypot(way[1]).hypot(arm_mm * turn_of(way))
    }

    /// Tears loose some of what sticks and finds no equilibrium; whether there was any.
    pub fn tear(&mut self) -> bool {
        let holds = self.at.contacts.sticks() && !self.at.at_rest && self.at.worn < TEARS[1] - WEAR_ROUNDING;
        if holds {
            self.at.worn = self.at.worn.max(TEARS[0]) + TORN_AT_ONCE;
        }
        holds
    }

    /// Whether so much was let go and came back that what holds has come apart for the increment's length alone.
    pub(super) fn unzips(&self, worn: f64) -> bool {
        let contacts = &self.at.contacts;
        let holds = contacts.sticks() && worn <= TEARS[0] + WEAR_ROUNDING;
        !self.guesses && holds && contacts.idle_part() > MOST_IDLE
    }
}

/// How much of what sticks is loose with a wear: nothing up to 0, all from 1 on.
pub(super) fn torn(worn: f64) -> f64 {
    (worn - TEARS[0]) / (TEARS[1] - TEARS[0])
}
