//! Planes as sums and differences of points that mirror each other in the middle.
//!
//! A wave is the same on both sides of the middle, but for its sign perhaps ([`super::waves`]): to it one half of such a plane is all
//! there is.

use super::lanes::{Isa, Kernel, Lanes, best_isa, dispatch_on};

/// Points along x and y of a plane; rows are along x.
#[derive(Debug, Clone, Copy)]
pub struct Plane(pub [usize; 2]);

impl Plane {
    /// Folds a plane along both axes: of n points along an axis sums come first, ceil(n/2) of them, the last of an odd number
    /// that of the middle alone, then differences.
    pub fn fold(self, points: &[f32], folded: &mut [f32]) {
        self.fold_on(best_isa(), points, folded);
    }

    /// The transpose of [`Self::fold`]: of two points that mirror each other the first is the sum of the two numbers that stand for them,
    /// the second their difference.
    pub fn unfold(self, folded: &[f32], points: &mut [f32]) {
        self.unfold_on(best_isa(), folded, points);
    }

    fn fold_on(self, isa: Isa, points: &[f32], folded: &mut [f32]) {
        dispatch_on(isa, Fold { size: self.0, points, folded });
    }

    fn unfold_on(self, isa: Isa, folded: &[f32], points: &mut [f32]) {
        dispatch_on(isa, Unfold { size: self.0, folded, points });
    }
}

struct Fold<'a> {
    size: [usize; 2],
    points: &'a [f32],
    folded: &'a mut [f32],
}

impl Kernel for Fold<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let [nx, ny] = self.size;
        let (sums, differences) = self.folded.split_at_mut(ny.div_ceil(2) * nx);
        for j in 0..ny.div_ceil(2) {
            let (a, b) = (&self.points[j * nx..][..nx], &self.points[(ny - 1 - j) * nx..][..nx]);
            if 2 * j + 1 == ny {
                fold_row::<L>(a, b, 0.0, &mut sums[j * nx..][..nx]);
            } else {
                fold_row::<L>(a, b, 1.0, &mut sums[j * nx..][..nx]);
                fold_row::<L>(a, b, -1.0, &mut differences[j * nx..][..nx]);
            }
        }
    }
}

/// Folds the row a + sign b.
#[inline(always)]
fn fold_row<L: Lanes>(a: &[f32], b: &[f32], sign: f32, folded: &mut [f32]) {
    let (n, half) = (a.len(), a.len() / 2);
    let (sums, differences) = folded.split_at_mut(n - half);
    let mut i = 0;
    while half >= L::COUNT && i < half {
        // The last register reaches back.
        i = i.min(half - L::COUNT);
        let mirrored = n - L::COUNT - i;
        let front = L::splat(sign).fma(L::load(&b[i..]), L::load(&a[i..]));
        let behind = L::splat(sign).fma(L::load(&b[mirrored..]), L::load(&a[mirrored..])).reversed();
        front.add(behind).store(&mut sums[i..]);
        front.sub(behind).store(&mut differences[i..]);
        i += L::COUNT;
    }
    for i in i..half {
        let [front, behind] = [i, n - 1 - i].map(|at| a[at] + sign * b[at]);
        (sums[i], differences[i]) = (front + behind, front - behind);
    }
    if n % 2 == 1 {
        sums[half] = a[half] + sign * b[half];
    }
}

struct Unfold<'a> {
    size: [usize; 2],
    folded: &'a [f32],
    points: &'a mut [f32],
}

impl Kernel for Unfold<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let [nx, ny] = self.size;
        let (sums, differences) = self.folded.split_at(ny.div_ceil(2) * nx);
        for j in 0..ny.div_ceil(2) {
            let s = &sums[j * nx..][..nx];
            if 2 * j + 1 == ny {
                unfold_row::<L>(s, s, 0.0, &mut self.points[j * nx..][..nx]);
            } else {
                let d = &differences[j * nx..][..nx];
                unfold_row::<L>(s, d, 1.0, &mut self.points[j * nx..][..nx]);
                unfold_row::<L>(s, d, -1.0, &mut self.points[(ny - 1 - j) * nx..][..nx]);
            }
        }
    }
}

/// Unfolds the row s + sign d.
#[inline(always)]
fn unfold_row<L: Lanes>(s: &[f32], d: &[f32], sign: f32, row: &mut [f32]) {
    let (n, half) = (s.len(), s.len() / 2);
    let behind = n - half;
    let mut i = 0;
    while half >= L::COUNT && i < half {
        i = i.min(half - L::COUNT);
        let sum = L::splat(sign).fma(L::load(&d[i..]), L::load(&s[i..]));
        let difference = L::splat(sign).fma(L::load(&d[behind + i..]), L::load(&s[behind + i..]));
        sum.add(difference).store(&mut row[i..]);
        sum.sub(difference).reversed().store(&mut row[n - L::COUNT - i..]);
        i += L::COUNT;
    }
    for i in i..half {
        let [sum, difference] = [i, behind + i].map(|at| s[at] + sign * d[at]);
        (row[i], row[n - 1 - i]) = (sum + difference, sum - difference);
    }
    if n % 2 == 1 {
        row[half] = s[half] + sign * d[half];
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::of_this_machine;
    use super::*;

    #[test]
    fn a_plane_is_sums_and_differences_and_back_on_every_instruction_set() {
        for [nx, ny] in [[1, 1], [5, 6], [18, 7], [34, 34], [51, 33]] {
            let points: Vec<f32> = (0..nx * ny).map(|k| ((k * 37) % 11) as f32 - 5.0).collect();
            let at = |i: usize, j: usize| points[j * nx + i];
            for isa in of_this_machine() {
                let (mut folded, mut back) = (vec![f32::NAN; nx * ny], vec![f32::NAN; nx * ny]);
                Plane([nx, ny]).fold_on(isa, &points, &mut folded);
                // What is at place k of n, and with which sign what mirrors it; that is no other in the middle.
                let part = |k: usize, n: usize| match k.checked_sub(n.div_ceil(2)) {
                    Some(k) => (k, -1.0),
                    None => (k, if 2 * k + 1 == n { 0.0 } else { 1.0 }),
                };
                for (k, got) in folded.iter().enumerate() {
                    let ((i, along), (j, across)) = (part(k % nx, nx), part(k / nx, ny));
                    let in_row = |j: usize| at(i, j) + along * at(nx - 1 - i, j);
                    let truth = in_row(j) + across * in_row(ny - 1 - j);
                    assert_eq!(*got, truth, "{isa:?}, {nx} {ny}: {k}");
                }
                Plane([nx, ny]).unfold_on(isa, &folded, &mut back);
                for (k, got) in back.iter().enumerate() {
                    let twice = |k: usize, n: usize| if 2 * k + 1 == n { 1.0 } else { 2.0 };
                    let truth = twice(k % nx, nx) * twice(k / nx, ny) * points[k];
                    assert_eq!(*got, truth, "{isa:?}, {nx} {ny}: {k}");
                }
            }
        }
    }
}
