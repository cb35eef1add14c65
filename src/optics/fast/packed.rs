//! Where nothing in a sensor has a colour, the light of one white lamp is alike in all channels. So the bounce takes the pictures of
//! three lamps as the channels of one, and what it costs for three is what it costs for one.

use glam::Vec3;

/// Lamps that go into one picture.
pub const CHANNELS: usize = 3;

/// Which of the pictures of lamps are taken together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// Each has colours of its own.
    Apart,
    /// This many lamps, three to a picture.
    Grey(usize),
}

impl Packing {
    /// The number of a channel of a picture, from those of the pictures before. What has no lamp is dark.
    #[inline(always)]
    pub fn number(self, picture: usize, channel: usize, of: impl Fn(usize) -> f32) -> f32 {
        match self {
            Packing::Apart => 0.0,
            Packing::Grey(lamps) => {
                let lamp = CHANNELS * picture + channel;
                if lamp < lamps { of(lamp) } else { 0.0 }
            }
        }
    }

    /// Takes pictures together, of which each has a value for each cell, in all channels alike.
    pub fn pack(self, pictures: &[Vec<Vec3>]) -> Vec<Vec<Vec3>> {
        let Packing::Grey(_) = self else { return pictures.to_vec() };
        let length = pictures.first().map_or(0, Vec::len);
        let of = |picture: usize, k: usize| {
            Vec3::from_array([0, 1, 2].map(|c| self.number(picture, c, |lamp| pictures[lamp][k].x)))
        };
        let packed = pictures.len().div_ceil(CHANNELS);
        (0..packed).map(|picture| (0..length).map(|k| of(picture, k)).collect()).collect()
    }

    /// Takes them apart again.
    pub fn unpack(self, packed: Vec<Vec<Vec3>>) -> Vec<Vec<Vec3>> {
        let Packing::Grey(lamps) = self else { return packed };
        let lamp = |l: usize| packed[l / CHANNELS].iter().map(|v| Vec3::splat(v[l % CHANNELS])).collect();
        (0..lamps).map(lamp).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_together_comes_apart_as_it_was() {
        let picture = |l: usize| (0..5).map(|k| Vec3::splat((10 * l + k) as f32)).collect::<Vec<_>>();
        let pictures: Vec<Vec<Vec3>> = (0..4).map(picture).collect();
        let packing = Packing::Grey(4);
        let packed = packing.pack(&pictures);
        assert_eq!(packed.len(), 2);
        assert_eq!((packed[0][3], packed[1][3]), (Vec3::new(3.0, 13.0, 23.0), Vec3::new(33.0, 0.0, 0.0)));
        assert_eq!(packing.unpack(packed), pictures);
        let coloured = vec![vec![Vec3::new(1.0, 2.0, 3.0)]];
        assert_eq!(Packing::Apart.unpack(Packing::Apart.pack(&coloured)), coloured);
    }
}
