//! How far away the pad's profile is looked at.

/// Distances looked at, in cells.
const DISTANCES: [f32; 32] = [
    1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.5, 16.0, 17.5, 19.0, 21.0, 23.0,
    25.0, 28.0, 31.0, 35.0, 39.0, 44.0, 50.0, 56.0, 62.0, 69.0, 77.0, 86.0, 96.0,
];
/// So far, in cells that are as large as they may be; of the finest ones as far as there are distances.
const REACH: f32 = 44.0;
/// The distances where little will do.
const FEW_DISTANCES: [f32; 12] = [1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 10.5, 14.0, 19.0, 25.0, 33.0, 44.0];

/// The distances to look at, in cells so many times finer than they may be, all of them or a few.
pub fn distances(closely: bool, finer: usize) -> &'static [f32] {
    let reach = REACH * finer as f32;
    match closely {
        true => &DISTANCES[..DISTANCES.partition_point(|distance| *distance <= reach)],
        false => &FEW_DISTANCES,
    }
}

/// Distances one after the other, in cells. Far ones have gaps between them, into which a narrow flank fits.
pub struct Walk<'a> {
    distances: &'a [f32],
    at: f32,
    last: f32,
    /// Up to here every cell is looked at.
    no_gap_until: f32,
}

impl<'a> Walk<'a> {
    /// At the place itself.
    pub fn over(distances: &'a [f32]) -> Self {
        Self { distances, at: 0.0, last: 0.0, no_gap_until: 0.0 }
    }

    /// The next one, unless there is none.
    #[inline(always)]
    pub fn step(&mut self) -> Option<f32> {
        self.last = self.at;
        if self.at < self.no_gap_until {
            self.at = (self.at + 1.0).min(self.no_gap_until);
        } else {
            let (first, rest) = self.distances.split_first()?;
            (self.at, self.distances) = (*first, rest);
        }
        Some(self.at)
    }

    /// Whether there is a gap before this one.
    #[inline(always)]
    pub fn leapt(&self) -> bool {
        self.at - self.last > 1.0
    }

    /// Goes back to look at every cell of the gap.
    #[inline(always)]
    pub fn go_back(&mut self) {
        (self.no_gap_until, self.at) = (self.at, self.last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_walked_cell_by_cell_once_and_then_it_goes_on() {
        let mut walk = Walk::over(&[1.0, 2.5, 5.5, 9.0]);
        let mut steps = Vec::new();
        while let Some(distance) = walk.step() {
            if distance == 5.5 && walk.leapt() {
                walk.go_back();
            } else {
                steps.push((distance, walk.leapt()));
            }
        }
        let truth = [(1.0, false), (2.5, true), (3.5, false), (4.5, false), (5.5, false), (9.0, true)];
        assert_eq!(steps, truth);
    }
}
