use super::*;
use crate::indenter::{self, spec::IndenterSpec};

fn indenter(toml: &str) -> Arc<dyn Indenter> {
    let spec: IndenterSpec = toml::from_str(toml).expect("spec");
    indenter::from_spec("test", &spec, None).expect("indenter")
}

fn ball() -> Arc<dyn Indenter> {
    indenter("shape = { kind = \"dome\", radius_mm = 4.0, diameter_mm = 8.0 }")
}

fn small(look: fn(u32, u32, f64) -> SensorLook) -> Picture {
    Picture::new(look(160, 120, 0.12), [0.0, 0.0], 3)
}

/// Mean of a channel in a box around a pixel.
fn mean(rgb: &[f32], w: usize, at: (f64, f64), half: usize, channel: usize) -> f32 {
    let (x, y) = (at.0 as usize, at.1 as usize);
    let n = (2 * half + 1).pow(2) as f32;
    let boxed = (y - half..=y + half).flat_map(|y| (x - half..=x + half).map(move |x| (x, y)));
    boxed.map(|(x, y)| rgb[(y * w + x) * 3 + channel]).sum::<f32>() / n
}

#[test]
fn nothing_that_does_not_touch_is_seen() {
    let picture = small(SensorLook::gelsight);
    let untouched = picture.draw(&Pose::default(), None, &Drag::default());
    for pose in
        [Pose::new(0.0, 0.0, 0.5, 0.0), Pose::new(0.0, 0.0, 0.0, 0.0), Pose::new(99.0, 0.0, -1.0, 0.0)]
    {
        assert_eq!(untouched, picture.draw(&pose, Some(&ball()), &Drag::default()), "{pose}");
    }
    assert!(untouched.iter().all(|v| *v > 20.0 && *v < 245.0), "an untouched gel is well exposed");
}

#[test]
fn each_flank_takes_the_colour_of_the_light_it_faces() {
    let picture = small(SensorLook::gelsight);
    let untouched = picture.draw(&Pose::default(), None, &Drag::default());
    let pressed = picture.draw(&Pose::new(0.0, 0.0, -0.6, 0.0), Some(&ball()), &Drag::default());
    // The contact's radius is 2.1 mm, 17 px: 10 px from the centre is well on the flank.
    let change = |dx: f64, dy: f64, channel| {
        let at = (80.0 + dx, 60.0 + dy);
        mean(&pressed, 160, at, 2, channel) - mean(&untouched, 160, at, 2, channel)
    };
    let (red, green, blue) = (0, 1, 2);
    assert!(change(-10.0, 0.0, blue) > 10.0 && change(10.0, 0.0, blue) < -10.0);
    assert!(change(10.0, 0.0, green) > 5.0 && change(-10.0, 0.0, green) < -5.0);
    assert!(change(0.0, 10.0, red) > 10.0 && change(0.0, -10.0, red) < -10.0);
}

#[test]
fn a_white_lit_gel_is_bright_where_it_faces_the_nearer_light() {
    let picture = small(SensorLook::white_skin);
    let untouched = picture.draw(&Pose::default(), None, &Drag::default());
    // 4 mm left of the middle the left strip is nearer: the flank that faces it outshines the other.
    let pressed = picture.draw(&Pose::new(-4.0, 0.0, -0.6, 0.0), Some(&ball()), &Drag::default());
    let ratio = |dx: f64| {
        let at = (80.0 - 33.3 + dx, 60.0);
        mean(&pressed, 160, at, 2, 1) / mean(&untouched, 160, at, 2, 1)
    };
    assert!(ratio(-10.0) > ratio(10.0) + 0.05, "{} {}", ratio(-10.0), ratio(10.0));
    let floor = (-0.6 * picture.look().brightness_per_mm).exp();
    assert!((ratio(0.0) - floor).abs() < 0.04, "the floor lies deeper in the light: {}", ratio(0.0));
}

#[test]
fn the_picture_follows_the_pose_by_the_scale_of_the_sensor() {
    // Lights that no side is nearer to change the picture as evenly as the tip is round.
    let picture = small(|w, h, scale| {
        let mut look = SensorLook::white_skin(w, h, scale);
        look.lights.iter_mut().for_each(|l| l.falloff = 0.0);
        look
    });
    let untouched = picture.draw(&Pose::default(), None, &Drag::default());
    let centroid = |pose: Pose| {
        let pressed = picture.draw(&pose, Some(&ball()), &Drag::default());
        let (mut sum, mut sx, mut sy) = (0.0f64, 0.0, 0.0);
        for (i, (a, b)) in untouched.chunks(3).zip(pressed.chunks(3)).enumerate() {
            let weight = f64::from(a[1] - b[1]).powi(2);
            sum += weight;
            sx += weight * ((i % 160) as f64 + 0.5);
            sy += weight * ((i / 160) as f64 + 0.5);
        }
        (sx / sum, sy / sum)
    };
    let ((x0, y0), (x1, y1)) =
        (centroid(Pose::new(0.0, 0.0, -0.5, 0.0)), centroid(Pose::new(2.4, -1.2, -0.5, 0.0)));
    assert!((x0 - 80.0).abs() < 0.4 && (y0 - 60.0).abs() < 0.4, "pad origin is the middle: {x0}, {y0}");
    assert!((x1 - x0 - 20.0).abs() < 0.4, "2.4 mm right are 20 px: {}", x1 - x0);
    assert!((y1 - y0 + 10.0).abs() < 0.4, "1.2 mm up are 10 px: {}", y1 - y0);
}

#[test]
fn a_positive_rotation_turns_the_picture_clockwise() {
    let bar = indenter("shape = { kind = \"lying_cylinder\", radius_mm = 1.0, length_mm = 8.0 }");
    let picture = small(SensorLook::white_skin);
    let untouched = picture.draw(&Pose::default(), None, &Drag::default());
    // The bar lies along y; turned by +45 degrees its lower end (y > 0) goes to the left.
    let turned = picture.draw(&Pose::new(0.0, 0.0, -0.4, 45.0), Some(&bar), &Drag::default());
    let change = |x: f64, y: f64| {
        let pixel = |i: i32, j: i32| ((y as i32 + j) * 160 + x as i32 + i) as usize * 3 + 1;
        let near = (-6..=6).flat_map(|j| (-6..=6).map(move |i| pixel(i, j)));
        near.map(|at| (turned[at] - untouched[at]).abs()).sum::<f32>() / 169.0
    };
    let arm = 16.0;
    assert!(change(80.0 - arm, 60.0 + arm) > 4.0 && change(80.0 + arm, 60.0 - arm) > 4.0);
    assert!(change(80.0 + arm, 60.0 + arm) < 1.0 && change(80.0 - arm, 60.0 - arm) < 1.0);
}

#[test]
fn drag_sticks_then_slips_and_ends_with_the_contact() {
    let pressed = Pose::new(0.0, 0.0, -1.0, 0.0);
    let step = |from: &Pose, by: f64| Pose { x_mm: from.x_mm + by, ..*from };
    let first = step(&pressed, 0.3);
    let drag = Drag::default().followed(&pressed, &first);
    assert!((drag.x_mm - 0.3).abs() < 1e-12);
    let far = step(&first, 5.0);
    let drag = drag.followed(&first, &far);
    assert!((drag.x_mm - LARGEST_DRAG_PER_DEPTH).abs() < 1e-12, "slips at the limit");
    let back = drag.followed(&far, &step(&far, -0.2));
    assert!((back.x_mm - (LARGEST_DRAG_PER_DEPTH - 0.2)).abs() < 1e-12, "sticks again on the way back");
    assert_eq!(back.followed(&far, &Pose::new(0.0, 0.0, 1.0, 0.0)), Drag::default());
}

#[test]
fn a_dragged_contact_looks_different_from_a_fresh_one() {
    let picture = small(SensorLook::gelsight);
    let pose = Pose::new(0.0, 0.0, -0.8, 0.0);
    let fresh = picture.draw(&pose, Some(&ball()), &Drag::default());
    let dragged = picture.draw(&pose, Some(&ball()), &Drag { x_mm: 0.4, y_mm: 0.0, twist_deg: 0.0 });
    let difference: f32 =
        fresh.iter().zip(&dragged).map(|(a, b)| (a - b).abs()).sum::<f32>() / fresh.len() as f32;
    assert!(difference > 0.05, "{difference}");
}
