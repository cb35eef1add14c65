//! Press, slide and turn: the path of most families.

use super::super::cases::Family;
use super::super::thin::half_space_n;
use super::Walk;
use super::slide::slide;
use super::symmetry::{asymmetry_mm, is_mirrored};
use crate::elastomer::{ElastomerCapture, Error, Friction};
use crate::pose::Pose;

/// Press in three strides, then slide, then turn, then release: as much of it as the case wants.
pub(super) fn path(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    let depth = case.depth_mm;
    let low = walk.go(walk.at(-0.8 * depth))?;
    let middle = walk.go(walk.at(-0.9 * depth))?;
    let deep = walk.go(walk.at(-depth))?;
    let energy = |c: &ElastomerCapture| c.stats.elastic_energy_n_mm;
    let least = walk.least_force();
    if middle.forces.normal_force_n > least {
        // dE/dd = F, by a central difference of second order.
        let slope = (energy(&deep) - energy(&low)) / (0.2 * depth);
        let off = (slope - middle.forces.normal_force_n) / middle.forces.normal_force_n;
        let bound = 0.03 + walk.claim;
        // Where points slip, some of the work is lost.
        let sticks_or_slides = !matches!(case.settings.friction, Friction::Coefficient(mu) if mu > 0.0);
        walk.checks.hold("dE/dd against force", if sticks_or_slides { off.abs() } else { off }, bound);
        let falls = |a: &ElastomerCapture, b: &ElastomerCapture| {
            (a.forces.normal_force_n - b.forces.normal_force_n) / middle.forces.normal_force_n
        };
        walk.checks.hold("force falls in a press", falls(&low, &middle).max(falls(&middle, &deep)), 1e-3);
    }
    if case.family == Family::Thin {
        // The pad is deformed far, and it may be less stiff then than at first.
        let missing = half_space_n(case) / deep.forces.normal_force_n.max(0.0);
        walk.checks.hold("force of a half-space over that of a thin body", missing, 2.0);
    }
    let centred = case.at_mm == [0.0; 2];
    if case.family == Family::Press && centred && is_mirrored(walk.body.as_ref()) {
        let bound = 0.5 * walk.claim * depth + 5e-4;
        walk.checks.hold("asymmetry, mm", asymmetry_mm(&deep), bound);
        let shear = deep.forces.shear_force_n[0].hypot(deep.forces.shear_force_n[1]);
        walk.checks.hold("shear of a symmetric press, N", shear, 0.005 * deep.forces.normal_force_n + least);
    }
    if case.slide_mm > 0.0 {
        slide(walk, case.slide_mm, case.direction_deg)?;
    }
    if case.turn_deg != 0.0 {
        let (energy, start) = (walk.last.as_ref().map_or(0.0, energy), walk.pose);
        walk.work = [0.0; 2];
        // Without friction torques are but what errors make of the walls, one way and the other: the work of a crescent turned by 15
        // degrees is 3.4 % of what it stores by the torques of 4 waypoints, and -1.8, -1.3 % by those of 16 and 64.
        let parts = if walk.frictionless() { 16 } else { 4 };
        for n in 1..=parts {
            let theta_deg = start.theta_deg + case.turn_deg * f64::from(n) / f64::from(parts);
            let now = walk.go(Pose { theta_deg, ..walk.pose })?;
            let normal = now.forces.normal_force_n;
            if walk.frictionless() {
                // None but what errors of the pressure make of the walls, at the arm of the contact.
                let arm_mm = (now.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
                let bound = walk.claim * normal * arm_mm + walk.least_force();
                walk.checks.hold("torque without friction, N mm", now.forces.torque_n_mm.abs(), bound);
                continue;
            }
            // The pad's torque has the other sign than the turn, unless there is hardly any.
            let with = now.forces.torque_n_mm * case.turn_deg.signum();
            walk.checks.hold("torque along the turn, N mm", with, 0.05 * normal + walk.least_force());
        }
        walk.judge_work(energy);
    }
    walk.release()
}
