//! What is wrong with the numbers of a file.

use super::file::{PadFile, SceneFile};
use super::{IN_ORDER, fault};
use crate::optics::Error;

/// Most pixels along an edge of the picture.
const MOST_PX: usize = 16_384;

/// A light's normal is that of its sides if their triple product, 1 where all are as they should be, is above this.
const LEAST_FACING: f32 = 0.9999;
/// How far the length of a unit vector that is written with three decimals may be from 1.
const ROUNDED: f32 = 2e-3;

impl SceneFile {
    /// What is wrong with its numbers, the first of all: key, value, what is allowed, and the next move.
    pub(super) fn check(&self) -> Result<(), Error> {
        let Self { elastomer: pad, walls, camera, .. } = self;
        let ranges = [("elastomer.x_range", pad.x_range), ("elastomer.y_range", pad.y_range)];
        let sides = [("box.x", walls.x), ("box.y", walls.y), ("box.z", walls.z)];
        let sides = sides.map(|(key, range)| (key, range.map(f64::from)));
        if let Some((key, [low, high])) = ranges.into_iter().chain(sides).find(|(_, [low, high])| low >= high)
        {
            return Err(fault(
                format!("{key} = [{low}, {high}]: the first number is below the second"),
                IN_ORDER,
            ));
        }
        let PadFile { radius, rc, .. } = *pad;
        if radius <= 0.0 || !(0.0..=radius).contains(&rc) {
            return Err(fault(
                format!(
                    "elastomer.R = {radius} and rc = {rc}: the ball's radius R is above 0, that of its contact rc from 0 to R"
                ),
                "choose R in mm, and for rc where the pad parts from the ball",
            ));
        }
        let [width, height] = camera.res;
        if [width, height].iter().any(|n| !(1..=MOST_PX).contains(n)) {
            return Err(fault(
                format!("camera.res = [{width}, {height}]: each is from 1 to {MOST_PX}"),
                "choose columns and rows of the picture, e.g. [640, 480]; `--size` changes them for one picture",
            ));
        }
        for light in &self.lights {
            let name = &light.name;
            for (key, size) in [("size_u_mm", light.size_u_mm), ("size_v_mm", light.size_v_mm)] {
                if size <= 0.0 {
                    return Err(fault(
                        format!("{key} = {size} of light \"{name}\": it is above 0"),
                        "choose the light's full extent along that side, in mm; to turn it off give it the radiance [0, 0, 0]",
                    ));
                }
            }
            for (key, length) in [("u_dir", light.u_dir.length()), ("v_dir", light.v_dir.length())] {
                if !((1.0 - ROUNDED)..=(1.0 + ROUNDED)).contains(&length) {
                    return Err(fault(
                        format!("{key} of light \"{name}\" is {length} long: it is a unit vector"),
                        "divide it by its length; how large the light is tell size_u_mm and size_v_mm",
                    ));
                }
            }
            let [u, v, normal] = [light.u_dir, light.v_dir, light.normal].map(|d| d.normalize_or_zero());
            let facing = u.cross(v).dot(normal).abs();
            if facing.is_nan() || facing < LEAST_FACING {
                return Err(fault(
                    format!(
                        "normal = {} of light \"{name}\": it points to either side of its u_dir and v_dir, which are {} and {}",
                        light.normal, light.u_dir, light.v_dir
                    ),
                    "choose three unit vectors at right angles, the normal towards what it lights",
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Variant, parse};

    #[test]
    fn numbers_that_make_no_scene_are_named_by_their_keys() {
        let text = include_str!("../../../tests/data/optics/tactile-bench-1.json");
        let told = |change: fn(&mut serde_json::Value)| {
            let mut file: serde_json::Value = serde_json::from_str(text).expect("the scene");
            change(&mut file);
            parse(&file.to_string(), Variant::Ac).expect_err("no scene").to_string()
        };
        for (told, named) in [
            (
                told(|f| f["camera"]["res"] = serde_json::json!([1_000_000, 480])),
                "camera.res = [1000000, 480]",
            ),
            (told(|f| f["box"]["x"] = serde_json::json!([10.0, -10.0])), "box.x = [10, -10]"),
            (told(|f| f["elastomer"]["R"] = serde_json::json!(-4.0)), "elastomer.R = -4"),
            (told(|f| f["elastomer"]["rc"] = serde_json::json!(99.0)), "rc = 99"),
            (told(|f| f["lights"][0]["size_u_mm"] = serde_json::json!(-9.0)), "size_u_mm = -9 of light"),
            (told(|f| f["lights"][1]["normal"] = serde_json::json!([0.0, 0.0, 0.0])), "normal = [0, 0, 0]"),
            // Four degrees askew.
            (told(|f| f["lights"][1]["normal"][2] = serde_json::json!(0.07)), "of its u_dir and v_dir"),
            (told(|f| f["lights"][1]["u_dir"] = serde_json::json!([0.0, 2.0, 0.0])), "u_dir of light"),
        ] {
            assert!(told.contains(named), "{told}");
        }
        // As one would write it.
        let mut file: serde_json::Value = serde_json::from_str(text).expect("the scene");
        file["lights"][1]["u_dir"] = serde_json::json!([0.707, 0.707, 0.0]);
        file["lights"][1]["normal"] = serde_json::json!([0.707, -0.707, 0.0]);
        assert!(parse(&file.to_string(), Variant::Ac).is_ok());
    }
}
