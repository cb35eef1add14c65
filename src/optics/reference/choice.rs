//! Which light a point is picked of.

/// Makes the lights' weights their probabilities, the part `uniform` of which is the same for each that shines, and chooses one
/// with `pick`, which is from 0 to 1. What is left of that is as good a number as it was. Where no weight tells them apart
/// all that shine are alike; None where none does. What does not shine must have no weight.
pub fn choose(
    weights: &mut [f32],
    shines: impl Fn(usize) -> bool,
    uniform: f32,
    pick: f32,
) -> Option<(usize, f32)> {
    let total: f32 = weights.iter().sum();
    let lit = (0..weights.len()).filter(|k| shines(*k)).count();
    let (uniform, scale) = if total > 0.0 { (uniform, (1.0 - uniform) / total) } else { (1.0, 0.0) };
    let floor = uniform / lit.max(1) as f32;
    let (mut chosen, mut running) = (None, 0.0);
    for (k, p) in weights.iter_mut().enumerate() {
        *p = if shines(k) { *p * scale + floor } else { 0.0 };
        if *p > 0.0 && (chosen.is_none() || pick >= running) {
            chosen = Some((k, running, *p));
        }
        running += *p;
    }
    chosen.map(|(k, below, p)| (k, ((pick - below) / p).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::noise::uniform;
    use crate::optics::pearson::{UNLIKELY, chance};

    #[test]
    fn lights_are_chosen_with_the_probability_told_and_what_is_left_is_even() {
        const N: u32 = 100_000;
        const PARTS: usize = 16;
        // Weights, the part that is alike, and which shine. (A light beyond the horizon has no weight: of several such, as behind
        // a frosted plate, each has its share.)
        let shines = |dark: usize| move |k: usize| k != dark;
        for (weights, alike, dark) in [
            ([1.0, 3.0, 0.5, 2.0], 0.0, 9),
            ([1.0, 3.0, 0.5, 2.0], 0.1, 9),
            ([1.0, 0.0, 0.5, 2.0], 0.1, 9),
            ([1.0, 0.0, 0.5, 2.0], 0.1, 1),
            ([0.0, 4.0, 0.0, 0.0], 0.0, 9),
            ([0.0; 4], 0.0, 9),
            ([0.0; 4], 0.1, 9),
            ([0.0; 4], 0.1, 3),
        ] {
            let mut seen = [0.0; 4 * PARTS];
            let mut told = weights;
            for i in 0..N {
                told = weights;
                let (k, left) = choose(&mut told, shines(dark), alike, uniform(1, i) as f32).unwrap();
                seen[k * PARTS + ((left * PARTS as f32) as usize).min(PARTS - 1)] += 1.0;
            }
            assert!((told.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{weights:?} {alike} {dark}: {told:?}");
            let expected: Vec<f64> = (0..seen.len())
                .map(|bin| f64::from(N) * f64::from(told[bin / PARTS]) / PARTS as f64)
                .collect();
            let likely = chance(&seen, &expected);
            assert!(likely > UNLIKELY, "{weights:?} {alike} {dark}: {told:?}, {likely}");
            let off: Vec<f64> = expected.iter().map(|e| 1.05 * e).collect();
            assert!(chance(&seen, &off) < UNLIKELY, "{weights:?} {alike} {dark}");
        }
        assert_eq!(choose(&mut [0.0; 3], |_| false, 0.1, 0.5), None);
    }
}
