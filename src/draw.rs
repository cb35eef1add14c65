//! Numbers that look random and are the same for ever: case 137 of seed 1 is always the same case.

/// A stream of draws (splitmix64; Steele, Lea and Flood 2014).
#[derive(Debug, Clone)]
pub struct Draw(u64);

impl Draw {
    /// The stream of one case.
    pub fn new(seed: u64, number: u32) -> Self {
        let mut draw = Draw(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ u64::from(number) << 32);
        draw.next();
        draw
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// A number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// One of several.
    pub fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_repeatable_and_reaches_every_value() {
        let take = |seed, number| {
            let mut draw = Draw::new(seed, number);
            (0..200).map(|_| draw.below(7)).collect::<Vec<_>>()
        };
        assert_eq!(take(1, 137), take(1, 137));
        assert_ne!(take(1, 137), take(1, 138));
        assert_ne!(take(1, 137), take(2, 137));
        assert!((0..7).all(|k| take(3, 0).contains(&k)));
    }
}
