//! Arms with joints: where the tool is for given joint angles, and the angles for a given pose.
//!
//! A *chain* is a row of rotary joints from the base to the tool. *Forward* kinematics follows the row.
//! *Inverse* kinematics goes from a starting guess by damped least squares (Wampler 1986; Nakamura and
//! Hanafusa 1986): each step solves (J^T J + lambda^2 I) dq = J^T e, which stays tame where the arm is
//! stretched and J loses rank. Joint limits hold throughout: every step is clipped to them.
//!
//! What is asked for is the tip's position, and that the tool presses straight into the pad; the rotation
//! about the press direction is asked for where [`Chain::turns`] says so. (Arms with five joints, such as
//! SO-101 and Koch, can do the first two and no more.)
//!
//! *Straight lines*: joints that move evenly draw arcs. [`Chain::line`] halves a line until the arc between
//! neighbouring points stays within a tolerance of it.
//!
//! Lengths are mm, angles degrees. The base stands in the pad frame, as does everything that comes out.
//! Nothing here knows a device, masses or collisions.

use crate::pose::Pose;
use crate::problem::Problems;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// A serial chain of rotary joints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chain {
    /// Where the base stands in the pad frame.
    pub base: Place,
    /// From the base to the tool.
    pub joints: Vec<Joint>,
    /// The indenter's tip, seen from the last joint.
    pub tip: Place,
    /// Direction in the tip's frame that presses into the pad.
    pub press: [f64; 3],
    /// Whether the arm controls the rotation about the press direction.
    #[serde(default)]
    pub turns: bool,
}

/// A place relative to another: shifted, then turned about x, y and z of the other, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Place {
    /// Shift, mm.
    pub xyz_mm: [f64; 3],
    /// Roll, pitch and yaw, degrees.
    pub rpy_deg: [f64; 3],
}

/// One rotary joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// The device's axis that drives it.
    pub axis: String,
    /// Where it sits at angle 0, seen from the joint before it.
    pub origin: Place,
    /// What it turns about, in its own frame.
    pub about: [f64; 3],
    /// Lowest angle, degrees.
    pub min_deg: f64,
    /// Highest angle, degrees.
    pub max_deg: f64,
}

/// A pose that the arm cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReachError {
    /// Too far, too near, or not with the tool upright.
    #[error(
        "({pose}) is out of the arm's reach: the nearest it comes is {off_mm:.2} mm away, tilted by {tilt_deg:.2} deg; move the pad or the base of the arm, or choose another pose"
    )]
    OutOfReach {
        /// The pose asked for.
        pose: Pose,
        /// Distance that is left.
        off_mm: f64,
        /// Angle between the tool and the press direction that is left.
        tilt_deg: f64,
    },
    /// A joint would have to turn further than it may.
    #[error(
        "({pose}) needs joint {joint} at {value_deg:.2} deg, allowed are {min_deg} to {max_deg} deg; choose another pose, or correct the limits of the joint"
    )]
    BeyondJoint {
        /// The pose asked for.
        pose: Pose,
        /// The joint's axis.
        joint: String,
        /// The angle it would need.
        value_deg: f64,
        /// Lowest allowed.
        min_deg: f64,
        /// Highest allowed.
        max_deg: f64,
    },
    /// On a straight line the arm would have to fold over.
    #[error(
        "the straight line from ({from}) to ({to}) leads through a place where the arm would have to fold over; go there in two moves, through a pose further from its stretch"
    )]
    Folds {
        /// Where the line begins.
        from: Pose,
        /// Where it ends.
        to: Pose,
    },
}

/// Where the tool is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tool {
    /// The tip, pad frame, mm.
    pub tip_mm: DVec3,
    /// The tip's frame in the pad frame.
    pub frame: DMat3,
}

/// Millimetres that weigh as much as a radian of tilt: about the length of such an arm.
const MM_PER_RAD: f64 = 100.0;
/// Near enough: a hundredth of what a servo of 4096 counts resolves at 200 mm.
const NEAR_MM: f64 = 1e-3;
/// Upright enough, radians.
const UPRIGHT_RAD: f64 = 1e-5;
/// Steps from one guess.
const MOST_STEPS: usize = 200;
/// A joint that turns further than this between neighbours of a line has changed its configuration.
const FOLD_DEG: f64 = 45.0;
/// Halvings of a line at most: 4096 pieces.
const MOST_HALVINGS: u32 = 12;

impl Place {
    fn turn(&self) -> DMat3 {
        let [r, p, y] = self.rpy_deg.map(f64::to_radians);
        DMat3::from_rotation_z(y) * DMat3::from_rotation_y(p) * DMat3::from_rotation_x(r)
    }
}

impl Chain {
    /// Reports everything that cannot be right.
    pub fn check(&self, problems: &mut Problems) {
        if self.joints.is_empty() {
            problems.push(
                "joints",
                "[]",
                "at least one joint",
                "describe the joints from the base to the tool",
            );
        }
        for (i, joint) in self.joints.iter().enumerate() {
            problems.within("joints", |p| {
                p.within(format!("[{i}]"), |p| {
                    // Not a number is not above anything.
                    let is_ordered = joint.min_deg < joint.max_deg;
                    if !is_ordered {
                        let allowed = format!("more than min_deg = {}", joint.min_deg);
                        p.push("max_deg", joint.max_deg, allowed, "set max_deg above min_deg");
                    }
                    if !is_direction(joint.about) {
                        p.push("about", format!("{:?}", joint.about), "a direction", "write e.g. [0, 0, 1]");
                    }
                });
            });
        }
        if !is_direction(self.press) {
            problems.push("press", format!("{:?}", self.press), "a direction", "write e.g. [0, 0, -1]");
        }
    }

    /// Where the tool is for these joint angles.
    pub fn tool(&self, joints_deg: &[f64]) -> Tool {
        self.walk(joints_deg, |_, _| {})
    }

    /// The pose for these joint angles; the tilt out of the press direction is lost in it.
    pub fn pose(&self, joints_deg: &[f64]) -> Pose {
        let tool = self.tool(joints_deg);
        let x = self.upright().mul_vec3(DVec3::X);
        let seen = tool.frame * x;
        let theta = if self.turns { seen.y.atan2(seen.x).to_degrees() } else { 0.0 };
        Pose::new(tool.tip_mm.x, tool.tip_mm.y, tool.tip_mm.z, theta)
    }

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
        })
    }

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

    /// Follows the chain; `visit` gets each joint's place and what it turns about, pad frame.
    fn walk(&self, joints_deg: &[f64], mut visit: impl FnMut(DVec3, DVec3)) -> Tool {
        let (mut at, mut frame) = (DVec3::from(self.base.xyz_mm), self.base.turn());
        for (joint, angle) in self.joints.iter().zip(joints_deg) {
            at += frame * DVec3::from(joint.origin.xyz_mm);
            frame *= joint.origin.turn();
            let about = DVec3::from(joint.about).normalize();
            visit(at, frame * about);
            frame *= DMat3::from_axis_angle(about, angle.to_radians());
        }
        at += frame * DVec3::from(self.tip.xyz_mm);
        Tool { tip_mm: at, frame: frame * self.tip.turn() }
    }

    /// Turns the tip's frame so that it presses along -z of the pad frame, at theta 0.
    fn upright(&self) -> DMat3 {
        let press = DVec3::from(self.press).normalize();
        let turn = glam::DQuat::from_rotation_arc(DVec3::NEG_Z, press);
        DMat3::from_quat(turn)
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
        let share = |s: f64| self.joints.iter().map(|j| j.min_deg + (j.max_deg - j.min_deg) * s).collect();
        let middle: Vec<f64> = share(0.5);
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
                    if within_limits { moved.clamp(joint.min_deg, joint.max_deg) } else { moved }
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

struct Line<'a> {
    from: &'a Pose,
    to: &'a Pose,
    tolerance_mm: f64,
}

fn is_direction(v: [f64; 3]) -> bool {
    let length = DVec3::from(v).length();
    length.is_finite() && length > 1e-9
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn joint(axis: &str, xyz_mm: [f64; 3], about: [f64; 3], range: [f64; 2]) -> Joint {
        let origin = Place { xyz_mm, rpy_deg: [0.0; 3] };
        Joint { axis: axis.to_owned(), origin, about, min_deg: range[0], max_deg: range[1] }
    }

    /// Two links of 100 and 80 mm in the plane y = 0, and a wrist that keeps the tool upright.
    fn planar() -> Chain {
        Chain {
            base: Place { xyz_mm: [-150.0, 0.0, 60.0], rpy_deg: [0.0; 3] },
            joints: vec![
                joint("shoulder", [0.0; 3], [0.0, -1.0, 0.0], [-90.0, 90.0]),
                joint("elbow", [100.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-150.0, 150.0]),
                joint("wrist", [80.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-170.0, 170.0]),
            ],
            tip: Place { xyz_mm: [0.0, 0.0, -40.0], rpy_deg: [0.0; 3] },
            press: [0.0, 0.0, -1.0],
            turns: false,
        }
    }

    /// Five joints as SO-101 has them: pan, lift, elbow, wrist, roll; sizes rounded.
    fn five() -> Chain {
        Chain {
            base: Place { xyz_mm: [-220.0, 0.0, -40.0], rpy_deg: [0.0; 3] },
            joints: vec![
                joint("pan", [0.0, 0.0, 55.0], [0.0, 0.0, 1.0], [-110.0, 110.0]),
                joint("lift", [30.0, 0.0, 60.0], [0.0, 1.0, 0.0], [-100.0, 100.0]),
                joint("elbow", [28.0, 0.0, 112.0], [0.0, 1.0, 0.0], [-97.0, 97.0]),
                joint("wrist", [135.0, 0.0, 5.0], [0.0, 1.0, 0.0], [-95.0, 95.0]),
                joint("roll", [60.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-160.0, 160.0]),
            ],
            tip: Place { xyz_mm: [40.0, 0.0, 0.0], rpy_deg: [0.0; 3] },
            press: [1.0, 0.0, 0.0],
            turns: true,
        }
    }

    #[test]
    fn two_links_follow_the_law_of_cosines() {
        let arm = planar();
        let tool = arm.tool(&[90.0, -90.0, 0.0]);
        assert!((tool.tip_mm - DVec3::new(-70.0, 0.0, 120.0)).length() < 1e-9, "{tool:?}");
        // The wrist 40 mm above the tip, at (150, 0, 20) from the shoulder.
        let pose = Pose::new(0.0, 0.0, 40.0, 0.0);
        let joints = arm.joints(&pose, &[30.0, -60.0, 30.0]).unwrap();
        let reach = (150.0f64 * 150.0 + 20.0 * 20.0).sqrt();
        let elbow =
            180.0 - ((100.0f64.powi(2) + 80.0f64.powi(2) - reach * reach) / 16000.0).acos().to_degrees();
        assert!((joints[1].abs() - elbow).abs() < 1e-3, "{joints:?}, {elbow}");
        assert!(joints.iter().sum::<f64>().abs() < 1e-3, "upright: {joints:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn the_angles_of_a_pose_lead_back_to_it(
            x in -30.0..30.0f64, y in -30.0..30.0f64, z in -1.0..40.0f64, theta in -40.0..40.0f64,
        ) {
            let arm = five();
            let pose = Pose::new(x, y, z, theta);
            let joints = arm.joints(&pose, &[0.0; 5]).unwrap();
            let tool = arm.tool(&joints);
            prop_assert!(arm.pose(&joints).distance_mm(&pose) <= NEAR_MM);
            prop_assert!((tool.frame * DVec3::X - DVec3::NEG_Z).length() < 1e-4);
            prop_assert!((arm.pose(&joints).theta_deg - theta).abs() < 1e-2);
            for (joint, angle) in arm.joints.iter().zip(&joints) {
                prop_assert!((joint.min_deg..=joint.max_deg).contains(angle));
            }
        }

        #[test]
        fn a_line_stays_within_its_tolerance(x in -20.0..20.0f64, y in -20.0..20.0f64, z in -1.0..30.0f64) {
            let arm = five();
            let from = Pose::new(0.0, 0.0, 20.0, 0.0);
            let to = Pose::new(x, y, z, 10.0);
            let begin = arm.joints(&from, &[0.0; 5]).unwrap();
            let points = arm.line(&begin, &to, 0.02).unwrap();
            prop_assert!(arm.pose(points.last().unwrap()).distance_mm(&to) <= NEAR_MM);
            let direction = DVec3::new(x, y, z - 20.0);
            let mut before = begin;
            for point in points {
                for t in 1..10 {
                    let at: Vec<f64> =
                        before.iter().zip(&point).map(|(a, b)| a + (b - a) * f64::from(t) / 10.0).collect();
                    let tip = arm.tool(&at).tip_mm - DVec3::new(0.0, 0.0, 20.0);
                    let along = tip.dot(direction) / direction.length_squared();
                    prop_assert!((tip - along * direction).length() < 0.025, "{tip} off {direction}");
                }
                before = point;
            }
        }
    }

    #[test]
    fn a_press_of_a_millimetre_is_straight_to_a_hundredth() {
        let arm = five();
        let begin = arm.joints(&Pose::new(5.0, -5.0, 0.5, 0.0), &[0.0; 5]).unwrap();
        let points = arm.line(&begin, &Pose::new(5.0, -5.0, -0.5, 0.0), 0.01).unwrap();
        for point in &points {
            let at = arm.pose(point);
            assert!((at.x_mm - 5.0).abs() < 0.011 && (at.y_mm + 5.0).abs() < 0.011, "{at}");
        }
    }

    #[test]
    fn what_is_too_far_and_what_a_joint_forbids_are_told_apart() {
        let mut arm = planar();
        let far = arm.joints(&Pose::new(100.0, 0.0, 40.0, 0.0), &[0.0; 3]).unwrap_err();
        let ReachError::OutOfReach { off_mm, .. } = far else { panic!("{far}") };
        // At (250, 0, 20) from the shoulder, with 180 mm of arm; what tilting could gain costs as much.
        assert!(off_mm > 10.0 && off_mm < 71.0, "{off_mm}");
        arm.joints[1].min_deg = -20.0;
        arm.joints[1].max_deg = 20.0;
        let bent = arm.joints(&Pose::new(0.0, 0.0, 40.0, 0.0), &[0.0; 3]).unwrap_err();
        let ReachError::BeyondJoint { joint, value_deg, max_deg, .. } = &bent else { panic!("{bent}") };
        assert_eq!((joint.as_str(), *max_deg), ("elbow", 20.0));
        assert!(value_deg.abs() > 20.0, "{bent}");
        // Sideways it cannot go at all.
        assert!(matches!(
            arm.joints(&Pose::new(-20.0, 30.0, 40.0, 0.0), &[0.0; 3]),
            Err(ReachError::OutOfReach { .. })
        ));
    }

    #[test]
    fn settings_that_cannot_be_are_all_reported() {
        let mut arm = five();
        arm.joints[2].max_deg = -100.0;
        arm.joints[3].about = [0.0; 3];
        arm.press = [f64::NAN, 0.0, 0.0];
        let mut problems = Problems::new();
        arm.check(&mut problems);
        let keys: Vec<String> = problems.into_vec().into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["joints[2].max_deg", "joints[3].about", "press"]);
    }
}
