//! Where the indenter holds the face.

use super::Contacts;
use super::patch::Field;
use crate::pose::Pose;
use glam::DVec2;

/// What pulls the face along itself, and where the points that hold stay.
#[derive(Debug)]
pub struct Grip {
    /// Traction on the face along x and y, MPa on the flat.
    traction: [Field; 2],
    /// Sample points along x and y.
    size: [usize; 2],
    /// By sample point, of those that hold: how far from its place at rest it is on the indenter, in the indenter's frame whose axis
    /// is where the pad's is, mm, and its pressure, MPa.
    holds: Vec<Option<(DVec2, f64)>>,
}

impl Contacts {
    /// What holds, the indenter at `pose`.
    pub fn grip(&self, pose: &Pose) -> Grip {
        let size = self.lattice.points();
        let (sin, cos) = pose.theta_deg.to_radians().sin_cos();
        let mut traction = [vec![0.0; size[0] * size[1]], vec![0.0; size[0] * size[1]]];
        let mut holds = vec![None; size[0] * size[1]];
        for s in self.samples.iter().filter(|s| s.pressure > 0.0) {
            let Some(anchor) = &s.anchor else { continue };
            let [i, j] = self.lattice.place(s.cell, s.sub);
            let pull = anchor.trial(s.seen, self.tangential).clamp_length_max(anchor.bound);
            traction[0][j * size[0] + i] = cos * pull.x - sin * pull.y;
            traction[1][j * size[0] + i] = sin * pull.x + cos * pull.y;
            holds[j * size[0] + i] = Some((anchor.side.at.truncate() - s.rest.truncate(), s.pressure));
        }
        let traction = traction.map(|along| Field::new(size, along, |pull| pull != 0.0));
        Grip { traction, size, holds }
    }
}

/// Standard deviation of the weights of points around a place, sample points.
const NEAR: f64 = 1.0;
/// Further away none counts.
const FAR: f64 = 4.0;

impl Grip {
    /// What part of the face holds.
    pub fn part(&self) -> f64 {
        self.holds.iter().flatten().count() as f64 / self.holds.len() as f64
    }

    /// Traction at a place given as parts of the face's sides, 0 to 1, MPa.
    pub fn traction(&self, x: f64, y: f64) -> DVec2 {
        let [along_x, along_y] = [0, 1].map(|axis: usize| self.traction[axis].at([x, y]).unwrap_or(0.0));
        DVec2::new(along_x, along_y)
    }

    /// How far from its place at rest a point would be on the indenter, in the indenter's frame, mm, if it held as those around it do; nothing
    /// where none does. Those under little pressure slip, and count for little.
    pub fn held_at(&self, x: f64, y: f64) -> Option<DVec2> {
        let [px, py] = [x * self.size[0] as f64 - 0.5, y * self.size[1] as f64 - 0.5];
        let near = |p: f64, n: usize| {
            let from = (p - FAR).ceil().max(0.0) as usize;
            from..((p + FAR).floor().max(-1.0) + 1.0).min(n as f64) as usize
        };
        let weight = |p: f64, i: usize| (-0.5 * ((p - i as f64) / NEAR).powi(2)).exp();
        let (mut sum, mut all) = (DVec2::ZERO, 0.0);
        for j in near(py, self.size[1]) {
            let of_row = weight(py, j);
            for i in near(px, self.size[0]) {
                if let Some((offset, pressure)) = self.holds[j * self.size[0] + i] {
                    let weight = of_row * weight(px, i) * pressure;
                    sum += weight * offset;
                    all += weight;
                }
            }
        }
        (all > 0.0).then(|| sum / all)
    }
}
