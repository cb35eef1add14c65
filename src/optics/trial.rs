//! Scenes to try renderers on: the benchmark scene with other pads, what indenters leave, and what none should.

use super::bench_scene::{self, Variant};
use super::{Error, Mesh, Scene};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The benchmark scene's file, built in.
pub const SCENE: &str = include_str!("../../tests/data/optics/tactile-bench-1.json");

/// Extent of its pad, mm.
const PAD_MM: [f32; 2] = [20.0, 15.0];

/// What was done to the pad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Press {
    /// Nothing.
    Untouched,
    /// A ball of radius 4 mm, half a millimetre deep, with the tail of the benchmark scene.
    Sphere,
    /// A flat round punch of radius 2.5 mm, 1.5 mm deep.
    Punch,
    /// A flat round plug of radius 2.5 mm, 1.2 mm deep, its flanks as upright as the lattice has them.
    Plug,
    /// A flat square stamp of 6 mm, 1 mm deep, its flanks steep.
    Stamp,
    /// A cone, 1.2 mm deep.
    Cone,
    /// A sharp ridge across the pad, 0.8 mm high.
    Ridge,
    /// A pyramid turned by 30 degrees, 1 mm deep.
    Pyramid,
    /// The rim of a tube of radius 3 mm, 0.8 mm deep.
    Ring,
    /// A post of radius half a millimetre, 1.5 mm deep.
    Post,
    /// A step of 1 mm, upright.
    Cliff,
    /// Nine small domes.
    Dots,
    /// The pad sucked away from the camera.
    Dent,
    /// A ball pressed in and dragged by this much, mm.
    Drag(f32),
    /// Dragged until the face lies over itself.
    Fold,
}

impl Press {
    /// Height of the face where a point of it lay, mm, towards the camera.
    fn height(self, x: f32, y: f32) -> f32 {
        let ball = |x: f32, y: f32| {
            let r = x.hypot(y);
            if r < 2.0 { (16.0 - r * r).sqrt() - 3.0 } else { 0.4641 * (-1.244 * (r - 2.0)).exp() }
        };
        let outside = |r: f32, depth: f32, steep: f32| depth * (-steep * r.max(0.0)).exp();
        match self {
            Press::Untouched => 0.0,
            Press::Sphere => ball(x - 1.5, y + 1.0),
            Press::Punch => outside((x + 3.0).hypot(y - 2.0) - 2.5, 1.5, 1.6),
            Press::Plug => 1.2 * f32::from(u8::from((x - 1.5).hypot(y + 1.0) < 2.5)),
            Press::Stamp => outside((x.abs() - 3.0).max(y.abs() - 3.0), 1.0, 6.0),
            Press::Cone => {
                let r = (x - 0.5).hypot(y - 0.7);
                if r < 1.5 { 1.2 - 0.6 * r } else { 0.3 * (-2.0 * (r - 1.5)).exp() }
            }
            Press::Ridge => 0.8 * (-1.5 * (x * 0.94 + y * 0.34 - 1.0).abs()).exp(),
            Press::Pyramid => {
                let (u, v) = (0.866 * x + 0.5 * y + 1.0, 0.866 * y - 0.5 * x);
                let r = u.abs().max(v.abs());
                if r < 2.0 { 1.0 - 0.4 * r } else { 0.2 * (-2.0 * (r - 2.0)).exp() }
            }
            Press::Ring => 0.8 * (-2.5 * ((x + 1.0).hypot(y) - 3.0).abs()).exp(),
            Press::Post => outside((x - 2.0).hypot(y - 1.0) - 0.5, 1.5, 3.0),
            Press::Cliff => f32::from(u8::from(x > 0.5)),
            Press::Dots => (0..9)
                .map(|k| {
                    let (dx, dy) = (x - 3.0 * ((k % 3) as f32 - 1.0), y - 3.0 * ((k / 3) as f32 - 1.0));
                    0.6 * (-(dx * dx + dy * dy) / 0.35).exp()
                })
                .sum(),
            Press::Dent => -0.6 * (-((x - 1.0).powi(2) + y * y) / 4.0).exp(),
            Press::Drag(_) | Press::Fold => 0.8 * (-(x * x + y * y) / 3.0).exp(),
        }
    }

    /// How far a point of the face went aside.
    fn aside(self, x: f32, y: f32) -> Vec2 {
        match self {
            Press::Drag(by) => Vec2::new(by, 0.25 * by) * (-(x * x + y * y) / (2.0 * by * by).max(8.0)).exp(),
            Press::Fold => Vec2::new(1.6 * (-(x * x + y * y) / 1.2).exp(), 0.0),
            _ => Vec2::ZERO,
        }
    }
}

/// A scene and what it was before the press.
#[derive(Debug, Clone)]
pub struct Trial {
    /// To be rendered.
    pub scene: Scene,
    /// Untouched.
    pub untouched: Scene,
}

impl Trial {
    /// The benchmark scene with this press on a lattice of so many points, seen in a raster.
    ///
    /// # Errors
    /// When the scene cannot be read.
    pub fn new(variant: Variant, press: Press, size: [usize; 2], lattice: [usize; 2]) -> Result<Self, Error> {
        let mut scene = bench_scene::parse(SCENE, variant)?;
        scene.camera = scene.camera.with_raster(size[0], size[1]);
        let mut untouched = scene.clone();
        scene.surfaces[0].mesh = Arc::new(pad(press, lattice));
        untouched.surfaces[0].mesh = Arc::new(pad(Press::Untouched, lattice));
        Ok(Self { scene, untouched })
    }

    /// The benchmark scene as it is, with its own pad.
    ///
    /// # Errors
    /// When the scene cannot be read.
    pub fn own(variant: Variant, size: [usize; 2]) -> Result<Self, Error> {
        let mut scene = bench_scene::parse(SCENE, variant)?;
        scene.camera = scene.camera.with_raster(size[0], size[1]);
        let mut untouched = scene.clone();
        let mesh = Arc::make_mut(&mut untouched.surfaces[0].mesh);
        mesh.positions.iter_mut().for_each(|p| p.z = 0.0);
        Ok(Self { scene, untouched })
    }

    /// The same change to both.
    pub fn changed(mut self, change: impl Fn(&mut Scene)) -> Self {
        change(&mut self.scene);
        change(&mut self.untouched);
        self
    }
}

fn pad(press: Press, [nx, ny]: [usize; 2]) -> Mesh {
    let share = |k: usize| Vec2::new((k % nx) as f32 / (nx - 1) as f32, (k / nx) as f32 / (ny - 1) as f32);
    let position = |k: usize| {
        let p = (share(k) - 0.5) * Vec2::from_array(PAD_MM);
        (p + press.aside(p.x, p.y)).extend(press.height(p.x, p.y))
    };
    Mesh::from_lattice(nx, ny, (0..nx * ny).map(position).collect(), (0..nx * ny).map(share).collect())
}

/// The most that any pixel can show: light that everything around sends, reflected for ever.
pub fn bound(scene: &Scene) -> Vec3 {
    use super::{Albedo, Material};
    let light = scene.lights.iter().fold(Vec3::ZERO, |most, l| most.max(l.radiance));
    let mut albedo = scene.lights.iter().fold(Vec3::ZERO, |most, l| most.max(l.albedo));
    for surface in &scene.surfaces {
        albedo = albedo.max(match &surface.material {
            Material::Lambert { albedo: Albedo::Constant(a) } => *a,
            Material::Lambert { albedo: Albedo::Texture(t) } => {
                t.texels.iter().fold(Vec3::ZERO, |m, a| m.max(*a))
            }
            _ => Vec3::ZERO,
        });
    }
    light / (Vec3::ONE - albedo).max(Vec3::splat(1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presses_are_finite_and_as_deep_as_they_say() {
        for (press, depth) in [
            (Press::Punch, 1.5),
            (Press::Plug, 1.2),
            (Press::Cone, 1.2),
            (Press::Cliff, 1.0),
            (Press::Drag(5.0), 0.8),
            (Press::Untouched, 0.0),
        ] {
            let mesh = pad(press, [201, 151]);
            let highest = mesh.positions.iter().fold(0.0f32, |h, p| h.max(p.z));
            assert!((highest - depth).abs() < 0.05 && mesh.check("pad").is_ok(), "{press:?} {highest}");
        }
    }
}
