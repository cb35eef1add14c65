//! Inverse kinematics: the joint angles that put the tool somewhere.

use super::{Chain, Joint, MM_PER_RAD, MOST_STEPS, NEAR_MM, ReachError, UPRIGHT_RAD};
use crate::pose::Pose;
use glam::DVec3;

impl Chain {
    /// Joint angles for a pose, sought from `guess_deg` first, then from elsewhere.
    ///
    /// # Errors
    /// When there are none within the limits: which joint is in the way, or how near the arm comes.
    pub fn joints(&self, pose: &Pose, guess_deg: &[f64]) -> Result<Vec<f64>, ReachError> {
        let mut nearest: Option<(f64, Vec<f64>)> = None;
        for guess in self.guesses(guess_deg) {
            let found = self.seek(pose, guess, true);
            let left = self.weighed_error(pose, &found);
            if self.is_there(pose, &found) {
                return Ok(found);
            }
            if nearest.as_ref().is_none_or(|(least, _)| left < *least) {
                nearest = Some((left, found));
            }
        }
        // Without limits there may be an answer: then a joint is what is in the way.
        for guess in self.guesses(guess_deg) {
            let free = self.seek(pose, guess, false);
            let beyond = |(j, q): &(&Joint, &f64)| **q < j.min_deg || **q > j.max_deg;
            if self.is_there(pose, &free)
                && let Some((joint, value)) = self.joints.iter().zip(&free).find(beyond)
            {
                return Err(ReachError::BeyondJoint {
                    pose: *pose,
                    joint: joint.axis.clone(),
                    value_deg: *value,
                    min_deg: joint.min_deg,
                    max_deg: joint.max_deg,
                });
            }
        }
        let best = nearest.map_or_else(|| guess_deg.to_vec(), |(_, joints)| joints);
        let (off, tilt) = self.error(pose, &best);
        Err(ReachError::OutOfReach {
            pose: *pose,
            off_mm: off.length(),
            tilt_deg: tilt.length().to_degrees(),
            reach_mm: self.reach_mm(),
            distance_mm: (DVec3::new(pose.x_mm, pose.y_mm, pose.z_mm) - self.shoulder_mm()).length(),
        })
    }

    /// What is left to the pose: of the tip in mm, and as a rotation vector in radians.
    fn error(&self, pose: &Pose, joints_deg: &[f64]) -> (DVec3, DVec3) {
        let tool = self.tool(joints_deg);
        let off = DVec3::new(pose.x_mm, pose.y_mm, pose.z_mm) - tool.tip_mm;
        let press = tool.frame * DVec3::from(self.press).normalize();
        // From where it presses to where it should: the shortest turn, about what is perpendicular to both.
        let (sine, cosine) = (press.cross(DVec3::NEG_Z), press.dot(DVec3::NEG_Z));
        let angle = sine.length().atan2(cosine);
        let axis = if sine.length() > 1e-12 { sine.normalize() } else { press.any_orthonormal_vector() };
        let mut turn = axis * angle;
        if self.turns {
            let seen = tool.frame * self.upright().mul_vec3(DVec3::X);
            let theta = pose.theta_deg.to_radians() - seen.y.atan2(seen.x);
            turn += DVec3::Z * theta.sin().atan2(theta.cos());
        }
        (off, turn)
    }

    fn weighed_error(&self, pose: &Pose, joints_deg: &[f64]) -> f64 {
        let (off, turn) = self.error(pose, joints_deg);
        off.length_squared() + (turn * MM_PER_RAD).length_squared()
    }

    fn is_there(&self, pose: &Pose, joints_deg: &[f64]) -> bool {
        let (off, turn) = self.error(pose, joints_deg);
        off.length() <= NEAR_MM && turn.length() <= UPRIGHT_RAD
    }

    /// Where the search begins: where the arm is, the middle of all ranges, and each joint bent both ways.
    fn guesses(&self, first_deg: &[f64]) -> Vec<Vec<f64>> {
        let middle = self.middle_deg();
        let mut guesses = vec![first_deg.to_vec(), middle.clone()];
        for i in 0..self.joints.len() {
            for s in [0.2, 0.8] {
                let mut bent = middle.clone();
                bent[i] = self.joints[i].min_deg + (self.joints[i].max_deg - self.joints[i].min_deg) * s;
                guesses.push(bent);
            }
        }
        guesses
    }

    /// Damped least squares from a guess; the damping falls while it helps and rises where it does not.
    fn seek(&self, pose: &Pose, mut joints: Vec<f64>, within_limits: bool) -> Vec<f64> {
        let n = self.joints.len();
        let mut damping = 1e-2 * MM_PER_RAD;
        let mut left = self.weighed_error(pose, &joints);
        for _ in 0..MOST_STEPS {
            if self.is_there(pose, &joints) {
                break;
            }
            let (off, turn) = self.error(pose, &joints);
            let tip = self.tool(&joints).tip_mm;
            let mut columns: Vec<[f64; 6]> = Vec::with_capacity(n);
            self.walk(&joints, |at, about| {
                let (v, w) = (about.cross(tip - at), self.asked_turn(about) * MM_PER_RAD);
                columns.push([v.x, v.y, v.z, w.x, w.y, w.z]);
            });
            let turn = turn * MM_PER_RAD;
            let error = [off.x, off.y, off.z, turn.x, turn.y, turn.z];
            let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            let mut matrix: Vec<Vec<f64>> =
                columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
            (0..n).for_each(|i| matrix[i][i] += damping * damping);
            let step = solve(matrix, columns.iter().map(|c| dot(c, &error)).collect());
            let trial: Vec<f64> = (joints.iter().zip(&step).zip(&self.joints))
                .map(|((q, dq), joint)| {
                    let moved = q + dq.clamp(-0.5, 0.5).to_degrees();
                    // Not clamp: limits that are no range are told elsewhere, and must not panic here.
                    if within_limits { moved.max(joint.min_deg).min(joint.max_deg) } else { moved }
                })
                .collect();
            let then = self.weighed_error(pose, &trial);
            if then < left {
                (joints, left, damping) = (trial, then, (damping * 0.3).max(1e-6));
            } else {
                damping = (damping * 4.0).max(1e-3);
                if damping > 1e6 {
                    break;
                }
            }
        }
        joints
    }

    /// The part of a rotation that is asked for: without `turns`, what is about z does not matter.
    fn asked_turn(&self, about: DVec3) -> DVec3 {
        if self.turns { about } else { DVec3::new(about.x, about.y, 0.0) }
    }
}

/// Solves a symmetric positive definite system by Cholesky; damping makes it definite.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
            a[i][j] = if i == j { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum / a[j][j] };
        }
    }
    for i in 0..n {
        b[i] = (b[i] - (0..i).map(|k| a[i][k] * b[k]).sum::<f64>()) / a[i][i];
    }
    for i in (0..n).rev() {
        b[i] = (b[i] - (i + 1..n).map(|k| a[k][i] * b[k]).sum::<f64>()) / a[i][i];
    }
    b
}
