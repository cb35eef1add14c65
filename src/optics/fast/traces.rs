//! What tells of the error of pictures that are made at once: of each, and of several also of their sum in the scene's colours.

use glam::Vec3;

/// How many numbers that takes: of a single picture the sum is the picture itself.
pub fn count(films: usize) -> usize {
    if films > 1 { films + 1 } else { 1 }
}

/// Where the number of the sum stands.
pub fn of_sum(numbers: &[f64]) -> f64 {
    numbers.last().copied().unwrap_or(0.0)
}

/// Adds the squares of something that each picture has, one value after the other. `radiances` are those of the scene.
pub fn add_squares(numbers: &mut [f64], values: impl Iterator<Item = Vec3>, radiances: &[Vec3]) {
    let mut sum = Vec3::ZERO;
    for (k, value) in values.enumerate() {
        numbers[k] += f64::from(value.length_squared());
        sum += value * radiances[k];
    }
    if let [_, .., of_sum] = numbers {
        *of_sum += f64::from(sum.length_squared());
    }
}

/// Mean and mean square of what pieces of a pixel have, by picture and of the sum.
#[derive(Debug, Clone, PartialEq)]
pub struct Pieces {
    /// By picture, and of the sum after them.
    sums: Vec<Vec3>,
    squares: Vec<Vec3>,
}

impl Pieces {
    pub fn new(films: usize) -> Self {
        Self { sums: vec![Vec3::ZERO; count(films)], squares: vec![Vec3::ZERO; count(films)] }
    }

    /// Adds a piece that is this part of the pixel.
    #[inline(always)]
    pub fn add(&mut self, part: f32, values: impl Iterator<Item = Vec3>, radiances: &[Vec3]) {
        let mut sum = Vec3::ZERO;
        for (k, value) in values.enumerate() {
            self.put(k, part, value);
            sum += value * radiances[k];
        }
        if self.sums.len() > 1 {
            self.put(self.sums.len() - 1, part, sum);
        }
    }

    #[inline(always)]
    fn put(&mut self, k: usize, part: f32, value: Vec3) {
        self.sums[k] += value * part;
        self.squares[k] += value * value * part;
    }

    /// Adds this part of the variances, of pieces that are so much together.
    pub fn add_variances(&self, whole: f32, part: f64, numbers: &mut [f64]) {
        for ((number, sum), square) in numbers.iter_mut().zip(&self.sums).zip(&self.squares) {
            let variance = *square / whole - (*sum / whole) * (*sum / whole);
            *number += part * f64::from(variance.max(Vec3::ZERO).element_sum());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_has_what_its_parts_have_together() {
        let radiances = [Vec3::new(2.0, 0.0, 1.0), Vec3::splat(3.0)];
        let mut numbers = [0.0; 3];
        assert_eq!(count(2), numbers.len());
        // Where one gains what the other loses nothing is changed.
        add_squares(
            &mut numbers,
            [Vec3::new(3.0, 0.0, 3.0), Vec3::new(-2.0, 0.0, -1.0)].into_iter(),
            &radiances,
        );
        assert_eq!(numbers, [18.0, 5.0, 0.0]);
        let mut one = [0.0];
        add_squares(&mut one, std::iter::once(Vec3::X), &radiances);
        assert_eq!((of_sum(&one), of_sum(&numbers)), (1.0, 0.0));
        let mut pieces = Pieces::new(2);
        pieces.add(0.5, [Vec3::X, Vec3::ZERO].into_iter(), &radiances);
        pieces.add(0.5, [Vec3::ZERO, Vec3::X].into_iter(), &radiances);
        pieces.add_variances(1.0, 4.0, &mut numbers);
        assert_eq!(numbers, [19.0, 6.0, 1.0]);
    }
}
