//! How groups of patches pass light on to each other, and what of it a place sees.
//!
//! What a place sees of power 1 that arrives at each group is asked for, for thousands of places and all groups. It is
//! followed backwards, from what a place sees to what that came from: then each place's row is done when the bounces
//! are, and no product of all groups with all places remains. (The adjoint of the light's transport; Christensen 2003, "Adjoints and
//! importance in rendering".) Sixteen rows go side by side, so that the exchange is read once for all of them.

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Vectors side by side, and rows in them.
const VECTORS: usize = 4;
const ROWS: usize = 4 * VECTORS;

/// Numbers that are not 0, with where they stand.
pub type Sparse = Vec<(u32, f32)>;

/// The groups.
pub struct Exchange {
    /// By group: the parts of what it reflects, by group that they reach.
    pub onward: Vec<Sparse>,
    /// Reflectance by group.
    pub albedos: Vec<Vec3>,
    /// Area by group, mm^2.
    pub areas: Vec<f32>,
}

impl Exchange {
    /// How many colours are worked out: one, where no group has a colour.
    pub fn colours(&self) -> usize {
        if self.albedos.iter().all(|a| a.x == a.y && a.y == a.z) { 1 } else { 3 }
    }

    /// By row, colour and group: what a row of weights of the groups' radiances sees of power 1 that arrives at the group, after
    /// 1 to `scatterings` of it.
    pub fn seen(&self, rows: &[Sparse], scatterings: u32) -> Vec<f32> {
        let (groups, colours) = (self.albedos.len(), self.colours());
        let mut out = vec![0.0; rows.len() * colours * groups];
        out.par_chunks_mut(ROWS * colours * groups).zip(rows.par_chunks(ROWS)).for_each(|(out, rows)| {
            for colour in 0..colours {
                let sums = self.traced_back(rows, colour, scatterings);
                for row in 0..rows.len() {
                    let out = &mut out[(row * colours + colour) * groups..][..groups];
                    for (out, sums) in out.iter_mut().zip(&sums) {
                        *out = sums[row / 4][row % 4];
                    }
                }
            }
        });
        out
    }

    /// The same of some rows in one colour: by group, rows side by side.
    fn traced_back(&self, rows: &[Sparse], colour: usize, scatterings: u32) -> Vec<[Vec4; VECTORS]> {
        let mut first = vec![[Vec4::ZERO; VECTORS]; self.albedos.len()];
        for (k, row) in rows.iter().enumerate() {
            for &(group, weight) in row {
                let group = group as usize;
                let sent = self.albedos[group][colour] * (FRAC_1_PI / self.areas[group].max(1e-6));
                first[group][k / 4][k % 4] = weight * sent;
            }
        }
        let (mut sums, mut before) = (first.clone(), Vec::new());
        for _ in 1..scatterings {
            before.clone_from(&sums);
            for (group, sum) in sums.iter_mut().enumerate() {
                let [mut a, mut b, mut c, mut d] = [Vec4::ZERO; VECTORS];
                for &(to, part) in &self.onward[group] {
                    let (sent, part) = (&before[to as usize], Vec4::splat(part));
                    a += sent[0] * part;
                    b += sent[1] * part;
                    c += sent[2] * part;
                    d += sent[3] * part;
                }
                let albedo = Vec4::splat(self.albedos[group][colour]);
                let first = &first[group];
                *sum = [
                    first[0] + a * albedo,
                    first[1] + b * albedo,
                    first[2] + c * albedo,
                    first[3] + d * albedo,
                ];
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Followed forwards, group by group, it is the same.
    #[test]
    fn backwards_is_as_forwards() {
        let n = 23;
        let number = |k: usize, seed: usize| ((k * 7919 + seed * 104_729) % 1000) as f32 * 1e-3;
        let parts = |from: usize| -> Sparse {
            (0..n)
                .filter(|to| (from * 5 + to * 3).is_multiple_of(4))
                .map(|to| (to as u32, number(from * n + to, 1) / 8.0))
                .collect()
        };
        let exchange = Exchange {
            onward: (0..n).map(parts).collect(),
            albedos: (0..n).map(|k| Vec3::new(number(k, 2), number(k, 3), 0.5)).collect(),
            areas: (0..n).map(|k| 1.0 + number(k, 4)).collect(),
        };
        let rows: Vec<Sparse> = (0..19)
            .map(|row| (row % 5..n).step_by(3).map(|k| (k as u32, number(row * n + k, 5) - 0.5)).collect())
            .collect();
        let scatterings = 4;
        let found = exchange.seen(&rows, scatterings);
        for from in 0..n {
            let mut arrived = vec![Vec3::ZERO; n];
            arrived[from] = Vec3::ONE;
            let mut total = arrived.clone();
            for _ in 1..scatterings {
                let mut next = vec![Vec3::ZERO; n];
                for ((sends, arrived), albedo) in exchange.onward.iter().zip(&arrived).zip(&exchange.albedos)
                {
                    for &(to, part) in sends {
                        next[to as usize] += *arrived * *albedo * part;
                    }
                }
                (0..n).for_each(|k| total[k] += next[k]);
                arrived = next;
            }
            for (k, row) in rows.iter().enumerate() {
                let mut truth = Vec3::ZERO;
                for &(group, weight) in row {
                    let g = group as usize;
                    truth += total[g] * exchange.albedos[g] * (FRAC_1_PI / exchange.areas[g] * weight);
                }
                for colour in 0..3 {
                    let value = found[(k * 3 + colour) * n + from];
                    assert!((value - truth[colour]).abs() < 1e-5, "{from} {k}: {value} {truth}");
                }
            }
        }
        // Without colours one number stands for three.
        let grey = Exchange { albedos: vec![Vec3::splat(0.5); n], ..exchange };
        let (one, few) = (grey.seen(&rows, 1), grey.colours());
        assert!(few == 1 && one.len() == rows.len() * n);
        let (group, weight) = rows[2][1];
        let truth = weight * 0.5 * FRAC_1_PI / grey.areas[group as usize];
        assert!((one[2 * n + group as usize] - truth).abs() < 1e-7);
    }
}
