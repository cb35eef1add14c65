//! What a sensor looks like: size, scale, lights, and the gel untouched.
//!
//! Light directions are those of the image: x right, y down, and towards the camera. Colours and
//! brightnesses are code values of the finished picture; there is no radiometry in this model.

use super::noise::Random;

/// One light at the side of the gel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SideLight {
    /// Where it shines from: to the right, down, and up from the gel (any length).
    pub from: [f32; 3],
    /// What it adds to a picture where it shines square on the gel, code values.
    pub rgb: [f32; 3],
    /// How much brighter its own side of the picture is than the middle, as a fraction.
    pub falloff: f32,
}

/// The look of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorLook {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Scale on the gel's face, mm per px.
    pub mm_per_px: f64,
    /// Light that comes from everywhere, code values.
    pub ambient: [f32; 3],
    /// The lights.
    pub lights: Vec<SideLight>,
    /// How far the membrane (and light scattered in the gel) rounds edges: standard deviation, mm.
    pub membrane_mm: f64,
    /// Phong's specular part relative to the diffuse one.
    pub specular: f32,
    /// What the picture loses in brightness (a logarithm) per mm that the gel is pressed in. Lights at the side, at
    /// a height h below the face, shine on it ever more flatly the nearer it comes: 1 / h to first order.
    pub brightness_per_mm: f32,
    /// Darkening towards the corners, as a fraction.
    pub vignette: f32,
    /// Strength of texture and dirt, 1 for an ordinary gel.
    pub dirt: f32,
}

impl SensorLook {
    /// A GelSight with four colours: white at the top, green right, red at the bottom, blue left
    /// (the places of blue and red are the paper's).
    pub fn gelsight(width: u32, height: u32, mm_per_px: f64) -> Self {
        let light = |x, y, rgb| SideLight { from: [x, y, 0.75], rgb, falloff: 0.38 };
        Self {
            width,
            height,
            mm_per_px,
            ambient: [26.0, 26.0, 30.0],
            lights: vec![
                light(-1.0, 0.0, [24.0, 54.0, 128.0]),
                light(1.0, 0.0, [26.0, 112.0, 44.0]),
                light(0.0, 1.0, [136.0, 30.0, 46.0]),
                light(0.0, -1.0, [60.0, 60.0, 62.0]),
            ],
            membrane_mm: 0.09,
            specular: 0.25,
            brightness_per_mm: 0.0,
            vignette: 0.12,
            dirt: 1.0,
        }
    }

    /// A compact skin, painted like the GelSight, with white strips: bright ones at the left and right, weaker
    /// ones at the top and bottom.
    pub fn white_skin(width: u32, height: u32, mm_per_px: f64) -> Self {
        let light = |x, y, bright: f32, warm: f32| SideLight {
            from: [x, y, 0.25],
            rgb: [bright + warm, bright, bright - 1.0 - warm],
            falloff: 0.75,
        };
        Self {
            width,
            height,
            mm_per_px,
            ambient: [18.0, 20.0, 20.0],
            lights: vec![
                light(-1.0, 0.0, 170.0, 1.5),
                light(1.0, 0.0, 170.0, 0.5),
                light(0.0, 1.0, 85.0, 0.0),
                light(0.0, -1.0, 85.0, 1.0),
            ],
            membrane_mm: 0.14,
            specular: 0.05,
            brightness_per_mm: 0.3,
            vignette: 0.22,
            dirt: 0.5,
        }
    }
}

/// The gel's own pattern: a factor on the brightness of every pixel.
#[derive(Debug, Clone)]
pub struct Gel {
    /// Factor by pixel, texture and dirt.
    pub albedo: Vec<f32>,
    /// Factor by pixel, vignette: it belongs to the lens and is never dragged along.
    pub vignette: Vec<f32>,
}

impl Gel {
    /// The gel of a sensor, grown from a seed.
    pub fn new(look: &SensorLook, seed: u64) -> Self {
        let (w, h) = (look.width as usize, look.height as usize);
        let px_per_mm = 1.0 / look.mm_per_px as f32;
        let mut random = Random::new(seed, 0x6e1);
        let mut albedo = vec![1.0; w * h];

        // Texture: cloudiness of the paint at three sizes (mm), then its grain.
        for (size_mm, strength) in [(4.0, 0.012), (1.1, 0.010), (0.25, 0.008)] {
            add_clouds(&mut albedo, w, h, size_mm * px_per_mm, strength * look.dirt, &mut random);
        }
        for a in &mut albedo {
            *a += 0.006 * look.dirt * random.normal();
        }
        // Dirt: specks, and fibres as short curved chains of specks.
        for _ in 0..28 {
            let centre = [random.uniform() * w as f32, random.uniform() * h as f32];
            let radius = (0.03 + 0.10 * random.uniform()) * px_per_mm;
            add_speck(&mut albedo, w, h, centre, radius, look.dirt * (0.03 + 0.09 * random.uniform()));
        }
        for _ in 0..6 {
            let mut at = [random.uniform() * w as f32, random.uniform() * h as f32];
            let mut heading = random.uniform() * std::f32::consts::TAU;
            let (bend, radius) = (0.12 * random.normal(), 0.035 * px_per_mm);
            for _ in 0..24 {
                add_speck(&mut albedo, w, h, at, radius.max(0.8), 0.02 * look.dirt);
                heading += bend + 0.05 * random.normal();
                at = [at[0] + radius * heading.cos(), at[1] + radius * heading.sin()];
            }
        }

        // The lens: dark towards the corners by the fourth power of the field's radius.
        let (cx, cy) = (0.5 * w as f32, 0.5 * h as f32);
        let corner = cx.hypot(cy);
        let vignette = (0..w * h)
            .map(|i| {
                let r = ((i % w) as f32 - cx).hypot((i / w) as f32 - cy) / corner;
                1.0 - look.vignette * (0.35 * r * r + 0.65 * r.powi(4))
            })
            .collect();
        Self { albedo, vignette }
    }
}

/// Smooth random values on a lattice of `size` px, interpolated.
fn add_clouds(albedo: &mut [f32], w: usize, h: usize, size: f32, strength: f32, random: &mut Random) {
    let size = size.max(2.0);
    let (columns, rows) = ((w as f32 / size) as usize + 3, (h as f32 / size) as usize + 3);
    let lattice: Vec<f32> = (0..columns * rows).map(|_| strength * random.normal()).collect();
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    for (y, row) in albedo.chunks_exact_mut(w).enumerate() {
        let v = y as f32 / size;
        let (j, fy) = (v as usize, smooth(v.fract()));
        for (x, a) in row.iter_mut().enumerate() {
            let u = x as f32 / size;
            let (i, fx) = (u as usize, smooth(u.fract()));
            let at = |i: usize, j: usize| lattice[j * columns + i];
            let top = at(i, j) + (at(i + 1, j) - at(i, j)) * fx;
            let bottom = at(i, j + 1) + (at(i + 1, j + 1) - at(i, j + 1)) * fx;
            *a += top + (bottom - top) * fy;
        }
    }
}

/// Darkens a soft round spot.
fn add_speck(albedo: &mut [f32], w: usize, h: usize, centre: [f32; 2], radius: f32, strength: f32) {
    let reach = (3.0 * radius).ceil() as isize + 1;
    let (cx, cy) = (centre[0] as isize, centre[1] as isize);
    for y in (cy - reach).max(0)..(cy + reach + 1).min(h as isize) {
        for x in (cx - reach).max(0)..(cx + reach + 1).min(w as isize) {
            let r2 = (x as f32 - centre[0]).powi(2) + (y as f32 - centre[1]).powi(2);
            albedo[y as usize * w + x as usize] *= 1.0 - strength * (-0.5 * r2 / (radius * radius)).exp();
        }
    }
}
