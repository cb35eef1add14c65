//! What is fixed in the picture: laid over the pad, and lit by what a press changes.

use super::Frame;
use crate::optics::Film;
use crate::optics::fast::cover::Laid;
use crate::optics::fast::traces;
use glam::Vec3;

impl<const N: usize> Frame<'_, N> {
    /// Lays what is fixed over the pictures of the pad, with what the press changes in the light on it, by picture and spot. What
    /// mixed pixels are means of is added to `spread`. Answers as [`Self::add_glow`].
    pub(super) fn lay_fixed(
        &self,
        films: &mut [Film],
        glows: &[Vec<Vec3>],
        spread: &mut [f64],
    ) -> [Vec<f64>; 3] {
        let (once, count, width) = (self.once, films.len(), self.once.view.camera.width);
        let covers = &once.tables.covers;
        let parts = covers.parts(|pixel| self.values(pixel % width, pixel / width));
        let lights = if count == 1 { std::slice::from_ref(&once.cover_total) } else { &covers.lights[..] };
        let veil = |k: usize, pixel: usize| once.veil(k, count, pixel % width, pixel / width);
        let laid = Laid { lights, parts: &parts, radiances: &once.radiances };
        covers.lay(films, &laid, veil, spread);
        self.add_glow(films, glows, &parts)
    }

    /// Adds what the press changes in the light on fixed parts, by picture and spot, to the pixels that show them. The sums over
    /// pixels and channels of the squares of what that is, of what is wrong at the feet of lamps, and of the light of walls and of what
    /// of lamps does not shine. `parts` are those of the covers.
    fn add_glow(&self, films: &mut [Film], glows: &[Vec<Vec3>], parts: &[[f32; 2]]) -> [Vec<f64>; 3] {
        let tables = &self.once.tables;
        let (columns, level) = (self.once.view.corners()[0], self.once.level());
        let radiances = &self.once.radiances;
        let [mut squares, mut feet, mut walls] = [(); 3].map(|()| vec![0.0; traces::count(films.len())]);
        // Both are in the order of pixels.
        let mut covered = tables.covers.pixels.iter().zip(parts).peekable();
        for &[pixel, spot] in &tables.glow.pixels {
            while covered.next_if(|(k, _)| **k < pixel).is_some() {}
            let (at, spot) = (pixel as usize, spot as usize);
            let (x, y) = (at % (columns - 1), at / (columns - 1));
            let part = match covered.peek() {
                Some((k, [_, fixed])) if **k == pixel => *fixed,
                _ => {
                    let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
                    0.25 * four.iter().filter(|(x, y)| self.corner(*x, *y).is_none()).count() as f32
                }
            };
            if !tables.glow.spots[spot].shines {
                traces::add_squares(&mut walls, films.iter().map(|film| film.pixels[at] * part), radiances);
            }
            let foot = tables.glow.spots[spot].foot_error(level);
            traces::add_squares(&mut feet, films.iter().map(|film| film.pixels[at] * foot), radiances);
            let added = films.iter_mut().zip(glows).map(|(film, glow)| {
                let add = (glow[spot] * (part * self.once.transmitted(x, y))).max(-film.pixels[at]);
                film.pixels[at] += add;
                add
            });
            traces::add_squares(&mut squares, added, radiances);
        }
        [squares, feet, walls]
    }
}
