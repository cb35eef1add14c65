//! Blocks some of whose nodes see no pad: halved until all of a part's do.

use super::{Desk, NOWHERE, Rectangle};
use crate::optics::fast::slots::POSITION;

impl<const N: usize> Desk<'_, N> {
    /// A block some of whose nodes see no pad is halved until all of a part's do, or it is a single pixel. What is
    /// interpolated must not come from elsewhere: beside a lamp the light changes several times over within a block.
    #[inline(never)]
    pub(super) fn partial(&mut self, rectangle: Rectangle, four: [&[f32]; 4]) {
        let [x0, y0, x1, y1] = rectangle;
        let mut corners = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        if corners.all(|(x, y)| self.point(x, y).x == NOWHERE) {
            (y0..y1).for_each(|y| (x0..x1).for_each(|x| self.mixed(x, y, rectangle, false)));
            return;
        }
        let is_seen = |n: &&[f32]| !n[POSITION].is_nan();
        let (wide, high) = (x1 - x0, y1 - y0);
        let supposed;
        let whole = match four.into_iter().find(is_seen) {
            _ if four.iter().all(is_seen) => Some(four),
            Some(seen) if (wide, high) == (1, 1) => {
                // The others are where they would see the pad if it went on as high.
                let z = seen[POSITION + 2];
                supposed = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| {
                    let [start, along] = self.frame.once.view.row(y)[x];
                    let mut node = vec![0.0; self.frame.slots.stride()];
                    self.frame.fill(&[start + along * ((z - start.z) / along.z)], &mut node);
                    node
                });
                Some([0, 1, 2, 3].map(|k| if is_seen(&four[k]) { four[k] } else { &supposed[k][..] }))
            }
            _ => None,
        };
        if let Some(four) = whole {
            self.divide(rectangle, four);
            return;
        }
        let [a, b, c, d] = four;
        if wide >= high {
            let x = (x0 + x1) / 2;
            let [top, bottom] = [y0, y1].map(|y| self.node(x, y));
            self.partial([x0, y0, x, y1], [a, &top, c, &bottom]);
            self.partial([x, y0, x1, y1], [&top, b, &bottom, d]);
        } else {
            let y = (y0 + y1) / 2;
            let [left, right] = [x0, x1].map(|x| self.node(x, y));
            self.partial([x0, y0, x1, y], [a, b, &left, &right]);
            self.partial([x0, y, x1, y1], [&left, &right, c, d]);
        }
    }

    /// The node at a corner of pixels; its position is no number where the pad is not seen.
    fn node(&self, x: usize, y: usize) -> Vec<f32> {
        let mut node = vec![0.0; self.frame.slots.stride()];
        match self.point(x, y) {
            p if p.x == NOWHERE => node[POSITION] = f32::NAN,
            p => self.frame.fill(&[p], &mut node),
        }
        node
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::fast::tests::scene;
    use crate::optics::fast::{Precomputed, Renderer};
    use crate::optics::{LightShape, bench_scene::Variant};
    use glam::Vec3;

    #[test]
    fn beside_a_lamp_that_stands_in_the_view_both_sides_are_alike() {
        // One upright lamp alone, left or right of the middle: its blocks see the pad in part.
        let standing = |side: f32| {
            let mut scene = scene(Variant::Ac, |_, _| 0.0);
            scene.lights.truncate(1);
            scene.lights[0].shape = LightShape::Rectangle {
                center: Vec3::new(6.03 * side, 0.0, 1.3),
                half_u: Vec3::Y * -4.5 * side,
                half_v: Vec3::Z,
            };
            let once = Precomputed::new(&scene).unwrap();
            let film = Renderer::new(&once, &scene, 0.005).unwrap().render();
            // (Samples of a pixel are not mirror images of each other: of its own edges the lamp is many times as bright.)
            let whole: Vec<bool> =
                (0..film.pixels.len()).map(|k| once.tables.covers.at(k).is_none()).collect();
            (film, whole)
        };
        let ((left, whole_left), (right, whole_right)) = (standing(-1.0), standing(1.0));
        let mirrored = |k: usize| k / left.width * left.width + left.width - 1 - k % left.width;
        let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
        for k in (0..right.pixels.len()).filter(|k| whole_right[*k] && whole_left[mirrored(*k)]) {
            squares += (left.pixels[mirrored(k)] - right.pixels[k]).length_squared();
            sum += right.pixels[k].element_sum();
            count += 3.0;
        }
        let departs = (squares * count).sqrt() / sum;
        assert!(departs < 0.01 && count > 8000.0, "{departs} of {count}");
    }
}
