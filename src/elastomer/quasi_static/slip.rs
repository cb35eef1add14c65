//! What a slide or a turn without friction is known by: the pad keeps the work that is done on it and, where it is flat,
//! resists neither (a millimetre from its sides with up to 5 % of the normal force). What it loses or resists with tells of
//! a face that has caught on an edge, for between contact samples a sharp edge is not seen.

use super::newton::Outcome;
use crate::pose::Pose;
use glam::DVec3;

/// Normal forces of which one is more times the other: between such the mean of two does not tell the work.
const ALIKE: f64 = 1.3;

/// Force on the pad and its torque about the indenter's axis, N and N mm, and what the pad stores with them, N mm.
#[derive(Debug, Clone, Copy)]
pub struct Account {
    force_n: DVec3,
    torque_n_mm: f64,
    stored_n_mm: f64,
}

impl Account {
    /// Of an equilibrium that `ended` so.
    pub fn new((force_n, torque_n_mm): (DVec3, f64), ended: Outcome) -> Self {
        Self { force_n, torque_n_mm, stored_n_mm: ended.evaluation.energy }
    }

    /// Resistance over the normal force, a torque at this arm.
    pub fn resistance(&self, arm_mm: f64) -> f64 {
        let normal_n = self.force_n.z.abs();
        let along_n = self.force_n.truncate().length();
        let turning_n = if arm_mm > 0.0 { self.torque_n_mm.abs() / arm_mm } else { 0.0 };
        if normal_n > 0.0 { along_n.max(turning_n) / normal_n } else { 0.0 }
    }
}

/// Work and what became of it, since the pad was at rest.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ledger {
    missing_n_mm: f64,
    turnover_n_mm: f64,
    most_stored_n_mm: f64,
}

impl Ledger {
    /// Books a way along the face.
    pub fn book(&mut self, [from, to]: [&Pose; 2], [before, after]: [Account; 2]) {
        let way = DVec3::new(to.x_mm - from.x_mm, to.y_mm - from.y_mm, to.z_mm - from.z_mm);
        let turn = (to.theta_deg - from.theta_deg).to_radians();
        let (a, b) = (before.force_n.z.abs(), after.force_n.z.abs());
        if a.max(b) > ALIKE * a.min(b) {
            return;
        }
        let work = 0.5
            * ((before.force_n + after.force_n).dot(way) + (before.torque_n_mm + after.torque_n_mm) * turn);
        self.missing_n_mm += work - (after.stored_n_mm - before.stored_n_mm);
        self.turnover_n_mm += work.abs();
        self.most_stored_n_mm = self.most_stored_n_mm.max(before.stored_n_mm).max(after.stored_n_mm);
    }

    /// What is missing over all the work or, where that is more, the most that was stored.
    pub fn missing(&self) -> f64 {
        let missing = self.missing_n_mm.abs();
        if missing > 0.0 { missing / self.turnover_n_mm.max(self.most_stored_n_mm) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::quasi_static::operator::Evaluation;

    /// Of something that pulls back with this force at x, and stores this.
    fn at(force_n: f64, stored_n_mm: f64) -> Account {
        let evaluation = Evaluation { energy: stored_n_mm, least_volume: 1.0 };
        let ended = Outcome { converged: true, residual: 0.0, iterations: 1, evaluation, base_force: 0.0 };
        Account::new((DVec3::new(force_n, 0.0, -2.0), 0.0), ended)
    }

    fn slid(account: impl Fn(f64) -> Account) -> f64 {
        let mut ledger = Ledger::default();
        for n in 0..8 {
            let ways = [n, n + 1].map(|n| 0.25 * f64::from(n));
            let [from, to] = ways.map(|x| Pose::new(x, 0.0, -1.0, 0.0));
            ledger.book([&from, &to], ways.map(&account));
        }
        ledger.missing()
    }

    #[test]
    fn a_spring_keeps_what_is_done_on_it_and_a_brake_nothing() {
        assert!(slid(|x| at(3.0 * x, 1.5 * x * x)) < 1e-12);
        assert!((slid(|_| at(1.0, 0.0)) - 1.0).abs() < 1e-12);
        // Two thirds of the work are kept.
        assert!((slid(|x| at(3.0 * x, x * x)) - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_slide_resists_with_its_drag_and_a_turn_with_its_torque_at_the_arm_of_the_contact() {
        assert!((at(0.5, 0.0).resistance(1.5) - 0.25).abs() < 1e-12);
        let turned = Account { torque_n_mm: 0.9, ..at(0.1, 0.0) };
        assert!((turned.resistance(1.5) - 0.3).abs() < 1e-12);
        assert_eq!(turned.resistance(0.0), 0.05);
    }
}
