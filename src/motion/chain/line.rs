//! Straight lines of the tip, as joint angles between which joints move evenly.

use super::{Chain, FOLD_DEG, MOST_HALVINGS, ReachError};
use crate::pose::Pose;

impl Chain {
    /// Joint angles along the straight line from one pose to another, without the first and with the last;
    /// between neighbours, joints moving evenly keep the tip within `tolerance_mm` of the line.
    ///
    /// # Errors
    /// When a pose on the way cannot be taken, or not without folding over.
    pub fn line(&self, from_deg: &[f64], to: &Pose, tolerance_mm: f64) -> Result<Vec<Vec<f64>>, ReachError> {
        let from = self.pose(from_deg);
        let end = self.joints(to, from_deg)?;
        let mut points = Vec::new();
        let line = Line { from: &from, to, tolerance_mm };
        self.halve(&line, (0.0, from_deg), (1.0, &end), 0, &mut points)?;
        Ok(points)
    }

    fn halve(
        &self,
        line: &Line<'_>,
        (s0, q0): (f64, &[f64]),
        (s1, q1): (f64, &[f64]),
        depth: u32,
        points: &mut Vec<Vec<f64>>,
    ) -> Result<(), ReachError> {
        let folds = || ReachError::Folds { from: *line.from, to: *line.to };
        let jump = q0.iter().zip(q1).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // An arc may cross its chord in the middle: three places on it are looked at.
        let stays = [0.25, 0.5, 0.75].into_iter().all(|t| {
            let between: Vec<f64> = q0.iter().zip(q1).map(|(a, b)| a + (b - a) * t).collect();
            let wanted = line.from.lerp(line.to, s0 + (s1 - s0) * t);
            self.pose(&between).distance_mm(&wanted) <= line.tolerance_mm
        });
        if stays && jump <= FOLD_DEG {
            points.push(q1.to_vec());
            return Ok(());
        }
        if depth >= MOST_HALVINGS {
            return Err(folds());
        }
        let s = 0.5 * (s0 + s1);
        let middle = self.joints(&line.from.lerp(line.to, s), q0)?;
        self.halve(line, (s0, q0), (s, &middle), depth + 1, points)?;
        self.halve(line, (s, &middle), (s1, q1), depth + 1, points)
    }
}

struct Line<'a> {
    from: &'a Pose,
    to: &'a Pose,
    tolerance_mm: f64,
}
