//! Whether points of a pixel lie evenly, and over pixels and seeds like random ones.

use super::*;
use crate::optics::pearson::{UNLIKELY, chance};

/// All ways to cut some dimensions into 2^m elementary intervals: by dimension so many halvings, m together.
fn cuts(dimensions: usize, m: u32) -> Vec<Vec<u32>> {
    match dimensions {
        1 => vec![vec![m]],
        _ => (0..=m)
            .flat_map(|first| {
                let rest = cuts(dimensions - 1, m - first);
                rest.into_iter().map(move |rest| [vec![first], rest].concat())
            })
            .collect(),
    }
}

/// Dimensions of a group that are looked at together, and by how many halvings the intervals have to be larger than points are many for each
/// to hold as many points: none where the two are a (0, m, 2)-net, and the sum of the degrees of their polynomials less one each
/// in general (Niederreiter 1988).
const NETS: [(&[usize], u32); 11] = [
    (&[0], 0),
    (&[1], 0),
    (&[2], 0),
    (&[3], 0),
    (&[0, 1], 0),
    (&[0, 2], 1),
    (&[1, 2], 1),
    (&[0, 3], 2),
    (&[1, 3], 2),
    (&[2, 3], 3),
    (&[0, 1, 2, 3], 3),
];

/// Whether each elementary interval holds as many of these points as its size says.
fn is_net(points: &[[f32; 4]], dimensions: &[usize], coarser: u32) -> bool {
    let m = points.len().ilog2();
    let Some(halvings) = m.checked_sub(coarser) else { return true };
    cuts(dimensions.len(), halvings).iter().all(|cut| {
        let mut seen = vec![0u32; 1 << halvings];
        for p in points {
            let interval = dimensions
                .iter()
                .zip(cut)
                .fold(0, |at, (&d, &bits)| (at << bits) | (p[d] * (1u32 << bits) as f32) as usize);
            seen[interval] += 1;
        }
        seen.iter().all(|&n| n == 1 << coarser)
    })
}

#[test]
fn every_elementary_interval_of_a_pixel_holds_its_points() {
    let few = [(7, 0), (7, 1), (7, 19), (8, 0), (0, 3)];
    let many = (0..20).map(|group| (7, group, 8..=8));
    for (seed, group, sizes) in few.map(|(seed, group)| (seed, group, 0..=10)).into_iter().chain(many) {
        for m in sizes {
            let count = 1 << m;
            let sampler = Sampler::new(seed, 3, 9, count);
            let points: Vec<_> = (0..count).map(|i| sampler.group(i, group)).collect();
            for (dimensions, coarser) in NETS {
                assert!(
                    is_net(&points, dimensions, coarser),
                    "{dimensions:?} of {count} points, group {group}"
                );
                // So does any part of them that is a power of two long and begins at a multiple of that.
                let half = points.len().div_ceil(2);
                assert!(
                    points.chunks(half).all(|half| is_net(half, dimensions, coarser)),
                    "{dimensions:?}, half of {count}"
                );
            }
        }
    }
}

#[test]
fn points_without_order_or_of_other_dimensions_are_no_net() {
    // Dimensions 2 and 3 are no (0, 8, 2)-net, and two groups have nothing to do with each other.
    let sampler = Sampler::new(7, 3, 9, 256);
    let points: Vec<_> = (0..256).map(|i| sampler.group(i, 0)).collect();
    assert!(!is_net(&points, &[2, 3], 0));
    let of_two: Vec<_> =
        (0..256).map(|i| [sampler.group(i, 0)[0], sampler.group(i, 1)[0], 0.0, 0.0]).collect();
    assert!(!is_net(&of_two, &[0, 1], 0));
}

/// A point of a pixel by itself is like a random one: over seeds, over pixels beside each other, and over groups. (Of pixels of at most
/// four samples it is not: the seeds of dimensions 0 and 2, and of 1 and 3, have something in common, which is gone from 16 on.)
#[test]
fn one_point_is_uniform_over_seeds_pixels_and_groups() {
    const N: u32 = 1 << 16;
    const SIDE: usize = 12;
    type Point = fn(u32) -> [f32; 4];
    let ways: [(&str, Point); 4] = [
        ("seeds of few samples", |i| Sampler::new(i, 3, 9, 16).group(5, 0)),
        ("seeds", |i| Sampler::new(i, 3, 9, 64).group(5, 0)),
        ("pixels", |i| Sampler::new(1, i % 256, i / 256, 64).group(0, 1)),
        ("groups", |i| Sampler::new(1, 3, 9, 64).group(63, i)),
    ];
    for (name, point) in ways {
        let points: Vec<[f32; 4]> = (0..N).map(point).collect();
        for [d, e] in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            let mut seen = [0.0; SIDE * SIDE];
            for p in &points {
                let [a, b] = [p[d], p[e]].map(|x| (x * SIDE as f32) as usize);
                seen[a * SIDE + b] += 1.0;
            }
            let even = f64::from(N) / (SIDE * SIDE) as f64;
            let likely = chance(&seen, &[even; SIDE * SIDE]);
            assert!(likely > UNLIKELY, "dimensions {d} and {e} over {name}: {likely}");
            let tilted: Vec<f64> =
                (0..seen.len()).map(|k| even * if k < seen.len() / 2 { 1.05 } else { 0.95 }).collect();
            assert!(chance(&seen, &tilted) < UNLIKELY, "dimensions {d} and {e} over {name}");
        }
    }
}

#[test]
fn all_four_dimensions_together_integrate_better_than_random() {
    // f = product of (1 + (x - 1/2)); the mean is 1, and independent samples of N = 1024
    // have a standard error of about 0.019.
    let rms = |samples: u32| {
        let square: f64 = (0..64u32)
            .map(|pixel| {
                let s = Sampler::new(1, pixel, 0, samples);
                let sum: f64 = (0..samples)
                    .map(|i| s.group(i, 2).iter().map(|x| 0.5 + f64::from(*x)).product::<f64>())
                    .sum();
                (sum / f64::from(samples) - 1.0).powi(2)
            })
            .sum();
        (square / 64.0).sqrt()
    };
    assert!(rms(1024) < 0.002, "{}", rms(1024));
    assert!(rms(1024) < rms(256) / 2.5);
}

#[test]
fn pixels_and_groups_are_uncorrelated() {
    let mean = |f: &dyn Fn(u32) -> f64| (0..4096).map(f).sum::<f64>() / 4096.0;
    let a = |i: u32| Sampler::new(1, i, 5, 64);
    let pixel_mean = mean(&|i| f64::from(a(i).group(0, 0)[0]));
    assert!((pixel_mean - 0.5).abs() < 0.02);
    let across = mean(&|i| (f64::from(a(i).group(0, 0)[0]) - 0.5) * (f64::from(a(i).group(0, 1)[0]) - 0.5));
    assert!(across.abs() < 0.006, "{across}");
    let neighbours =
        mean(&|i| (f64::from(a(i).group(0, 0)[0]) - 0.5) * (f64::from(a(i + 1).group(0, 0)[0]) - 0.5));
    assert!(neighbours.abs() < 0.006, "{neighbours}");
}
