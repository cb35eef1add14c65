//! Texture mode `ratio`: the image of the untouched sensor, carried along by the material and multiplied by what the
//! light there became.
//!
//! A point seen at p that lay at q shows I0(q) E(p)/E0(q). Where the face is squeezed or leans away, a pixel sees more of
//! the image than one of its pixels: the image is averaged over that. Where nothing has changed each pixel is that of the
//! image, to the bit.
//!
//! Both lights are as the lens blurs them, as the image is: the ratio of sharp ones would draw rims that no camera sees. What
//! the lens darkens towards the corners cancels.

use super::reference::Sight;
use super::{Film, Texture};
use glam::Vec2;
use rayon::prelude::*;

/// What a sensor wears, and how it was when the image was taken.
pub struct Worn<'a> {
    /// The image, linear.
    pub image: &'a Texture,
    /// The light on the untouched face, on the camera's raster, blurred as the lens does.
    pub light: &'a Film,
    /// Where each pixel saw the untouched face.
    pub uv: &'a [Option<Vec2>],
}

/// Shifts below this are the rounding of positions, pixels (about a tenth of it): nothing has moved.
const STILL_PX: f32 = 1e-3;
/// Edges that are longer than a pixel by less than this need no averages: their variance is that of a pixel within 1/2000.
const SHARP_PX: f32 = 0.02;
/// Most pixels of the image along an edge of what one pixel sees: the face is almost on edge there.
const WIDEST_PX: f32 = 15.0;

impl Worn<'_> {
    /// The image under this light, which is blurred as the untouched one is; `sights` is where each pixel sees the face now.
    pub fn relit(&self, light: &Film, sights: &[Option<Sight>]) -> Film {
        let (width, height) = (light.width, light.height);
        let raster = Vec2::new(width as f32, height as f32);
        let flat = Texture { width, height, texels: self.light.pixels.clone() };
        // Where the untouched sensor is dark the ratio means nothing; a thousandth of the mean bounds it.
        let floor = (flat.mean() * 1e-3).max(glam::Vec3::splat(1e-12));
        let is_same_raster = (self.image.width, self.image.height) == (width, height);
        let shifts: Vec<Option<Vec2>> = (0..width * height).map(|k| self.shift(k, sights, raster)).collect();
        let mut relit = Film::new(width, height);
        relit.pixels.par_iter_mut().with_min_len(4096).enumerate().for_each(|(k, pixel)| {
            let now = light.pixels[k].max(floor);
            let shift = shifts[k].unwrap_or(Vec2::ZERO);
            let edges = edges(&shifts, width, k);
            let is_sharp = edges.iter().all(|edge| *edge == Vec2::ZERO);
            if shift == Vec2::ZERO && is_sharp && is_same_raster {
                *pixel = self.image.texels[k] * (now / flat.texels[k].max(floor));
                return;
            }
            let middle = Vec2::new((k % width) as f32 + 0.5, (k / width) as f32 + 0.5) + shift;
            let steps = edges.map(|edge| edge.length().ceil() as u32 + 1);
            if is_sharp {
                let at = middle / raster;
                *pixel = self.image.sharp(at) * (now / flat.sample(at).max(floor));
                return;
            }
            let offset = |i: u32, n: u32| (i as f32 + 0.5) / n as f32 - 0.5;
            for i in 0..steps[0] {
                for j in 0..steps[1] {
                    let at = middle + edges[0] * offset(i, steps[0]) + edges[1] * offset(j, steps[1]);
                    let at = at / raster;
                    *pixel += self.image.sample(at) * (now / flat.sample(at).max(floor));
                }
            }
            *pixel /= (steps[0] * steps[1]) as f32;
        });
        relit
    }

    /// How far in the image what a pixel sees lies from that pixel. Only the shift of the material counts: a lens or plate
    /// bends both views alike.
    fn shift(&self, k: usize, sights: &[Option<Sight>], raster: Vec2) -> Option<Vec2> {
        let shift = (sights[k]?.uv - self.uv[k]?) * raster;
        Some(if shift.abs().max_element() < STILL_PX { Vec2::ZERO } else { shift })
    }
}

/// What a pixel sees of the image, as the two edges of a parallelogram around its middle, beyond what one pixel of the image
/// holds: squares of widths add up. Zero where the face is not squeezed.
fn edges(shifts: &[Option<Vec2>], width: usize, k: usize) -> [Vec2; 2] {
    let (x, y) = (k % width, k / width);
    let Some(here) = shifts[k] else { return [Vec2::ZERO; 2] };
    let edge = |axis: Vec2, before: Option<usize>, after: Option<usize>| {
        let shift_at = |k: Option<usize>| k.and_then(|k| shifts.get(k).copied().flatten());
        let backward = shift_at(before).map(|before| axis + here - before);
        let forward = shift_at(after).map(|after| axis + after - here);
        // Beside a fold one of the neighbours is far away in the image: the nearer one is of the same part of the face.
        let seen = match (backward, forward) {
            (Some(a), Some(b)) if b.length_squared() < a.length_squared() => b,
            (Some(a), _) => a,
            (None, Some(b)) => b,
            (None, None) => axis,
        };
        let beyond = (seen.length_squared() - 1.0).max(0.0).sqrt().min(WIDEST_PX);
        if beyond < SHARP_PX { Vec2::ZERO } else { seen.normalize() * beyond }
    };
    [
        edge(Vec2::X, (x > 0).then(|| k - 1), (x + 1 < width).then_some(k + 1)),
        edge(Vec2::Y, (y > 0).then(|| k - width), Some(k + width)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const SIZE: [usize; 2] = [40, 12];

    fn raster() -> Vec2 {
        Vec2::new(SIZE[0] as f32, SIZE[1] as f32)
    }

    fn middle(k: usize) -> Vec2 {
        Vec2::new((k % SIZE[0]) as f32 + 0.5, (k / SIZE[0]) as f32 + 0.5)
    }

    /// What is seen of an image under even light where pixels show the image's points `seen`.
    fn shown(image: impl Fn(usize, usize) -> f32, seen: impl Fn(Vec2) -> Vec2) -> Film {
        let [width, height] = SIZE;
        let all = 0..width * height;
        let texels = all.clone().map(|k| Vec3::splat(image(k % width, k / width))).collect();
        let light = Film { width, height, pixels: vec![Vec3::splat(0.3); width * height] };
        let uv: Vec<Option<Vec2>> = all.clone().map(|k| Some(middle(k) / raster())).collect();
        let sight = |k: usize| Some(Sight { point: Vec3::ZERO, uv: seen(middle(k)) / raster() });
        let sights: Vec<Option<Sight>> = all.map(sight).collect();
        let image = Texture { width, height, texels };
        Worn { image: &image, light: &light, uv: &uv }.relit(&light, &sights)
    }

    fn stripes(x: usize, _: usize) -> f32 {
        f32::from(u8::from(x % 3 == 1))
    }

    #[test]
    fn a_face_that_is_squeezed_shows_means_of_its_image_and_one_that_is_moved_or_stretched_does_not() {
        // Pixels that see a period each see its mean; one sample of them would be white or black everywhere.
        let squeezed = shown(stripes, |p| Vec2::new(20.5 + 3.0 * (p.x - 20.5), p.y));
        for x in 15..26 {
            assert!((squeezed.at(x, 6).x - 1.0 / 3.0).abs() < 0.03, "{x} {}", squeezed.at(x, 6).x);
        }
        // In both directions, and on the other axis.
        let both = shown(|x, y| stripes(x + y, 0), |p| 6.5 + 1.5 * (p - 6.5));
        let one = shown(|_, y| stripes(y, 0), |p| Vec2::new(p.x, 6.5 + 3.0 * (p.y - 6.5)));
        assert!((one.at(20, 6).x - 1.0 / 3.0).abs() < 0.03, "{}", one.at(20, 6).x);
        let spread = |film: &Film| {
            (4..9).map(|x| film.at(x, 6).x).fold([1.0f32, 0.0f32], |[low, high], v| [low.min(v), high.max(v)])
        };
        let [low, high] = spread(&both);
        assert!(low > 0.05 && high < 0.75, "{low} {high}");
        // A shift by whole pixels, and a stretch where it meets pixels' middles, keep what is sharp.
        let moved = shown(stripes, |p| p + Vec2::new(4.0, 0.0));
        let stretched = shown(stripes, |p| Vec2::new(20.5 + (p.x - 20.5) / 3.0, p.y));
        for x in 3..33 {
            assert!((moved.at(x, 5).x - stripes(x + 4, 0)).abs() < 1e-4);
        }
        for step in 0..5 {
            assert!((stretched.at(20 - 3 * step, 5).x - stripes(20 - step, 0)).abs() < 1e-4, "{step}");
        }
    }

    #[test]
    fn beside_a_fold_the_image_stays_sharp_and_at_rest_it_is_itself() {
        let folded = shown(stripes, |p| p + Vec2::new(if p.x > 20.0 { 9.0 } else { 0.0 }, 0.0));
        for x in 0..30 {
            let at = if x < 20 { x } else { x + 9 };
            assert!((folded.at(x, 3).x - stripes(at, 0)).abs() < 1e-4, "{x}");
        }
        let specks = |x: usize, y: usize| ((x * 7 + y * 13) % 5) as f32 / 4.0;
        let still = shown(specks, |p| p + Vec2::splat(1e-4));
        assert!((0..480).all(|k| still.pixels[k].x == specks(k % 40, k / 40)));
    }
}
