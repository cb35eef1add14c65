//! One picture a light: colours and intensities that change without rendering, and that can be fitted to a real picture.
//!
//! Light is linear, channel by channel: a picture is the sum over lights of what a light of radiance 1 gives, times the
//! light's radiance. Fitting asks for radiances of 0 or more whose picture is nearest to a given one in the sense of least
//! squares: three small problems, solved by Lawson and Hanson's active sets ("Solving Least Squares Problems", 1974,
//! chapter 23) on the normal equations.

use super::{Error, Film};
use glam::Vec3;
use rayon::prelude::*;

/// What each light gives for radiance 1.
#[derive(Debug, Clone, PartialEq)]
pub struct LightBasis {
    /// Names of the lights.
    pub names: Vec<String>,
    /// Their pictures.
    pub films: Vec<Film>,
}

/// relRMSE to expect of pictures that were rendered light by light.
#[derive(Debug, Clone, PartialEq)]
pub struct BasisError {
    /// By light.
    pub lights: Vec<f64>,
    /// Of their sum in the scene's colours.
    pub together: f64,
}

impl LightBasis {
    /// The picture for these radiances, one a light; lights without one are off.
    pub fn combine(&self, radiances: &[Vec3]) -> Film {
        let Some(first) = self.films.first() else { return Film::new(0, 0) };
        let mut out = Film::new(first.width, first.height);
        out.pixels.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for (film, radiance) in self.films.iter().zip(radiances) {
                let from = &film.pixels[chunk * CHUNK..][..out.len()];
                out.iter_mut().zip(from).for_each(|(sum, light)| *sum += *light * *radiance);
            }
        });
        out
    }

    /// The radiances, 0 or more, whose picture is nearest to `picture` over those pixels that `counts` accepts by index
    /// (a real camera's saturated pixels tell nothing).
    ///
    /// # Errors
    /// When the picture has another size.
    pub fn fit(&self, picture: &Film, counts: impl Fn(usize) -> bool) -> Result<Vec<Vec3>, Error> {
        let n = self.films.len();
        let differs = |f: &&Film| (f.width, f.height) != (picture.width, picture.height);
        if let Some(f) = self.films.iter().find(differs) {
            return Err(Error::Argument {
                name: "the picture to be fitted",
                value: format!("{} x {} pixels", picture.width, picture.height),
                why: format!("the simulated ones have {} x {}; scale or crop it to that", f.width, f.height),
            });
        }
        let pixels: Vec<usize> = (0..picture.pixels.len()).filter(|k| counts(*k)).collect();
        let mut radiances = vec![Vec3::ZERO; n];
        for channel in 0..3 {
            let product = |a: &Film, b: &Film| -> f64 {
                pixels
                    .iter()
                    .map(|&k| f64::from(a.pixels[k][channel]) * f64::from(b.pixels[k][channel]))
                    .sum()
            };
            let matrix: Vec<Vec<f64>> =
                self.films.iter().map(|a| self.films.iter().map(|b| product(a, b)).collect()).collect();
            let right: Vec<f64> = self.films.iter().map(|a| product(a, picture)).collect();
            for (radiance, value) in radiances.iter_mut().zip(non_negative(&matrix, &right)) {
                radiance[channel] = value as f32;
            }
        }
        Ok(radiances)
    }
}

/// Pixels a thread takes.
const CHUNK: usize = 16_384;

/// The x >= 0 that minimises x^T A x / 2 - b^T x.
fn non_negative(a: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut free = vec![false; n];
    let mut x = vec![0.0; n];
    let scale = (0..n).map(|k| a[k][k]).fold(0.0, f64::max).max(1e-300);
    for _ in 0..3 * n + 3 {
        let slope: Vec<f64> = (0..n).map(|i| b[i] - (0..n).map(|j| a[i][j] * x[j]).sum::<f64>()).collect();
        let best = (0..n).filter(|&i| !free[i]).max_by(|&i, &j| slope[i].total_cmp(&slope[j]));
        let Some(best) = best.filter(|&i| slope[i] > 1e-12 * scale) else { break };
        free[best] = true;
        loop {
            let trial = solve(a, b, &free);
            let blocking = (0..n)
                .filter(|&i| free[i] && trial[i] <= 0.0)
                .map(|i| (x[i] / (x[i] - trial[i]), i))
                .min_by(|p, q| p.0.total_cmp(&q.0));
            let Some((step, _)) = blocking else {
                x = trial;
                break;
            };
            for i in 0..n {
                x[i] += step * (trial[i] - x[i]);
                if free[i] && x[i] <= 1e-15 {
                    (free[i], x[i]) = (false, 0.0);
                }
            }
            if free.iter().all(|f| !f) {
                break;
            }
        }
    }
    x
}

/// Solves the free rows by Gauss' elimination; a light that gives nothing new gets nothing.
fn solve(a: &[Vec<f64>], b: &[f64], free: &[bool]) -> Vec<f64> {
    let ids: Vec<usize> = (0..b.len()).filter(|&i| free[i]).collect();
    let mut m: Vec<Vec<f64>> =
        ids.iter().map(|&i| ids.iter().map(|&j| a[i][j]).chain([b[i]]).collect()).collect();
    let n = ids.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| m[i][k].abs().total_cmp(&m[j][k].abs())).unwrap_or(k);
        m.swap(k, pivot);
        if m[k][k].abs() <= 1e-12 * a[ids[k]][ids[k]].abs() {
            m[k].fill(0.0);
            m[k][k] = 1.0;
            continue;
        }
        let row = m[k].clone();
        for i in (0..n).filter(|&i| i != k) {
            let factor = m[i][k] / row[k];
            m[i].iter_mut().zip(&row).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    let mut x = vec![0.0; b.len()];
    for (row, &i) in ids.iter().enumerate() {
        x[i] = m[row][n] / m[row][row];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn basis() -> LightBasis {
        let film = |f: &dyn Fn(f32, f32) -> f32| Film {
            width: 40,
            height: 30,
            pixels: (0..1200)
                .map(|k| Vec3::splat(f((k % 40) as f32 / 40.0, (k / 40) as f32 / 30.0)))
                .collect(),
        };
        LightBasis {
            names: ["left", "right", "top"].map(str::to_owned).to_vec(),
            films: vec![film(&|x, _| 1.0 - x), film(&|x, _| x * x), film(&|_, y| 0.3 + y)],
        }
    }

    #[test]
    fn a_fit_finds_the_radiances_of_a_combination() {
        let basis = basis();
        let truth = [Vec3::new(2.0, 0.5, 0.0), Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.7, 0.1, 0.2)];
        let fitted = basis.fit(&basis.combine(&truth), |_| true).unwrap();
        for (f, t) in fitted.iter().zip(&truth) {
            assert!((*f - *t).abs().max_element() < 1e-4, "{fitted:?}");
        }
    }

    #[test]
    fn no_light_becomes_negative_and_uncounted_pixels_do_not_matter() {
        let basis = basis();
        let mut picture = basis.combine(&[Vec3::ONE, Vec3::ZERO, Vec3::ZERO]);
        // Darker on the right than light can make it.
        picture.pixels.iter_mut().enumerate().for_each(|(k, p)| *p -= Vec3::splat((k % 40) as f32 / 100.0));
        assert!(basis.fit(&picture, |_| true).unwrap().iter().all(|r| r.cmpge(Vec3::ZERO).all()));
        let mut broken = basis.combine(&[Vec3::ONE; 3]);
        broken.pixels[7] = Vec3::splat(1e9);
        let fitted = basis.fit(&broken, |k| k != 7).unwrap();
        assert!(fitted.iter().all(|r| (*r - Vec3::ONE).abs().max_element() < 1e-4));
        assert!(basis.fit(&Film::new(3, 3), |_| true).is_err());
    }
}
