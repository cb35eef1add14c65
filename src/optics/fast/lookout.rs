//! Where in the picture's cells a place of the pad is found: what is high is seen farther from the middle than it stands.

use glam::{Vec2, Vec3};

/// Part of a cell by which what is high must have moved in the picture to be looked for elsewhere.
const TELLING: f32 = 0.25;

/// A place from where others are looked for.
pub struct Lookout {
    /// Height, mm.
    height: f32,
    /// How far what is 1 mm higher is moved in the picture, mm on level ground.
    lean: Vec2,
    eye_height: f32,
    edge_mm: f32,
}

impl Lookout {
    /// At a place of the pad, under an eye so high above the middle, mm.
    pub fn new(stands: Vec3, eye_height: f32, edge_mm: f32) -> Self {
        let lean = stands.truncate() / (eye_height - stands.z);
        Self { height: stands.z, lean, eye_height, edge_mm }
    }

    /// Whether what is so much higher or lower stands elsewhere in the picture. (Where nothing is, it is infinitely low.)
    #[inline(always)]
    pub fn tells(&self, higher: f32) -> bool {
        let moved = higher * self.lean.abs().max_element();
        moved > TELLING * self.edge_mm && higher < f32::INFINITY
    }

    /// Cells aside and down to what is so far ahead on the pad, mm, if it is that high.
    #[inline(always)]
    pub fn cells_to(&self, ahead_mm: Vec2, height: f32) -> (isize, isize) {
        let magnified = self.eye_height / ((self.eye_height - height) * self.edge_mm);
        let away = (ahead_mm + self.lean * (height - self.height)) * magnified;
        // In the picture y runs downwards, on the pad upwards.
        let q = (Vec2::new(away.x, -away.y) + 0.5).floor();
        (q.x as isize, q.y as isize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_high_is_looked_for_where_it_is_seen() {
        let lookout = Lookout::new(Vec3::new(6.0, -3.0, 0.0), 20.0, 0.25);
        let ahead = Vec2::new(1.0, 0.5);
        assert_eq!(lookout.cells_to(ahead, 0.0), (4, -2));
        // From the eye the place (7, -2.5, 2) hides the level's (7, -2.5) / 0.9.
        let seen = (Vec2::new(7.0, -2.5) / 0.9 - Vec2::new(6.0, -3.0)) / 0.25;
        assert_eq!(lookout.cells_to(ahead, 2.0), ((seen.x + 0.5) as isize, (-seen.y + 0.5).floor() as isize));
        assert!(lookout.tells(0.5) && !lookout.tells(0.1) && !lookout.tells(f32::INFINITY));
    }
}
