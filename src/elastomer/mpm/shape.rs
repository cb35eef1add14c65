//! Whether the strain that the particles carry is still that of the pad's shape.
//!
//! F is not computed from where the particles are: every step multiplies it by I + C, while the particles move with v. Both
//! come from the grid, which smooths them differently, so F and the shape part company a little in every step. After
//! many steps a pad may have forgotten the strain that its shape demands, or carry strain that no deformation has;
//! its forces and its further motion are then those of another body, though every number is finite and the indenter's
//! work pays for every bit of energy (the transfers dissipate so much of it that no balance of energy would tell).
//!
//! So the strain of the shape is taken from differences of neighbours in the lattice that the particles form, and
//! compared with the strain carried, as a fit is with data: of the sum of squares of the shape's strain, how much does
//! the strain carried leave unexplained ([`Drift`]). 0 is perfect; 1 is what no strain at all would leave.

use super::body::Body;
use super::grid::tile_position;
use super::particles::Batch;
use crate::elastomer::settings::Base;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// A strain of this root mean square is none: positions are rounded to 6e-8 of the pad's size or of a cell a step.
const ROUNDING: f64 = 1e-5;

/// Sums of squares of F - I over the batches that are compared, less the particles that the base pins.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Drift {
    /// Of the strain of the shape.
    pub shape: f64,
    /// Of the difference between it and the strain carried.
    pub apart: f64,
}

impl Drift {
    /// The part of a strain whose sum of squares is `of` that the strain carried does not explain.
    pub fn unexplained(&self, of: f64) -> f64 {
        self.apart / of
    }
}

/// What [`Drift::shape`] is at least taken for.
pub fn least(body: &Body) -> f64 {
    (body.len() / stride(body)) as f64 * ROUNDING * ROUNDING
}

/// From so many particles on one in four batches is compared: the particles of a block are alike, and a comparison of
/// all costs as much as a pass.
const MANY: usize = 400_000;

/// One in how many batches is compared.
fn stride(body: &Body) -> usize {
    if body.len() > MANY { 4 } else { 1 }
}

/// Positions of all particles by index, mm. Atomics, because blocks fill them in parallel in no order of
/// indices; every index is written once.
struct Positions(Vec<[AtomicU32; 3]>);

impl Positions {
    fn of(body: &Body) -> Self {
        let mut all: Vec<[AtomicU32; 3]> = Vec::new();
        all.resize_with(body.scheme.particles.iter().product(), Default::default);
        let (lower, dx) = (body.grid.lower_mm, body.grid.dx_mm);
        body.blocks().for_each(|(bin, origin)| {
            let corner: [f64; 3] = std::array::from_fn(|d| lower[d] / dx + f64::from(origin[d]));
            for batch in &bin.batches {
                for i in 0..batch.len as usize {
                    let (at, to) = (tile_position(batch.node[i]), &all[batch.id[i] as usize]);
                    for d in 0..3 {
                        let x = (corner[d] + f64::from(at[d] as f32 + batch.offset[d].0[i])) * dx;
                        to[d].store((x as f32).to_bits(), Ordering::Relaxed);
                    }
                }
            }
        });
        Self(all)
    }

    fn at(&self, n: u32) -> [f32; 3] {
        self.0[n as usize].each_ref().map(|u| f32::from_bits(u.load(Ordering::Relaxed)))
    }

    /// Displacement gradient at a particle by central differences, one-sided at the faces; row by row.
    fn gradient(&self, n: u32, particles: [u32; 3], per_mm: [f32; 3]) -> [f32; 9] {
        let [nx, ny, _] = particles;
        let at = [n % nx, n / nx % ny, n / nx / ny];
        let stride = [1, nx, nx * ny];
        let mut g = [0.0; 9];
        for s in 0..3 {
            let (down, up) = (at[s].min(1), (particles[s] - 1 - at[s]).min(1));
            let (low, high) = (self.at(n - down * stride[s]), self.at(n + up * stride[s]));
            let per_mm = if down + up == 2 { 0.5 * per_mm[s] } else { per_mm[s] };
            for r in 0..3 {
                g[3 * r + s] = (high[r] - low[r]) * per_mm;
            }
            g[4 * s] -= 1.0;
        }
        g
    }
}

/// Compares the strain carried with that of the shape.
pub fn drift(body: &Body) -> Drift {
    let positions = Positions::of(body);
    let scheme = &body.scheme;
    let (every, particles) = (stride(body), scheme.particles.map(|n| n as u32));
    let per_mm = scheme.spacing_mm.map(|s| 1.0 / s as f32);
    let pinned = |batch: &Batch| if body.base == Base::BondedLayers { batch.held } else { 0 };
    let parts: Vec<Drift> = body
        .blocks()
        .map(|(bin, _)| {
            let mut sum = Drift::default();
            for batch in bin.batches.iter().step_by(every) {
                let (mut shape, mut apart) = (0.0, 0.0);
                for i in (0..batch.len as usize).filter(|i| pinned(batch) >> i & 1 == 0) {
                    let g = positions.gradient(batch.id[i], particles, per_mm);
                    for k in 0..9 {
                        let d = g[k] - batch.strain[k].0[i];
                        shape += g[k] * g[k];
                        apart += d * d;
                    }
                }
                sum.shape += f64::from(shape);
                sum.apart += f64::from(apart);
            }
            sum
        })
        .collect();
    let add = |a: Drift, b: &Drift| Drift { shape: a.shape + b.shape, apart: a.apart + b.apart };
    parts.iter().fold(Drift::default(), add)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::mpm::lanes::Isa;
    use crate::elastomer::mpm::scheme::Scheme;
    use crate::elastomer::{Law, Material, Mode, Pad, Settings};
    use glam::{DMat3, DVec3};

    /// A free lattice deformed by `f` that carries the strain of `carried`.
    fn deformed(f: DMat3, carried: DMat3) -> Body {
        let material = Material {
            law: Law::FixedCorotated,
            youngs_modulus_mpa: 0.145,
            poisson_ratio: 0.45,
            density_g_mm3: 1.0,
        };
        let settings = Settings { mode: Mode::Mpm, particles: [11, 12, 13], ..Settings::default() };
        let scheme = Scheme::new(&Pad::slab([5.0, 5.5, 6.0], material), &settings).expect("a sound scheme");
        let mut body = Body::empty(scheme.clone(), Base::BondedLayers, Isa::best());
        let h = carried - DMat3::IDENTITY;
        let mut all = Vec::new();
        for id in 0..11 * 12 * 13 {
            let rest = scheme.rest_position_mm(id % 11, id / 11 % 12, id / 11 / 12);
            let mut m = body.at_rest((f * DVec3::from_array(rest)).to_array(), id as u32, false);
            m.particle.strain = std::array::from_fn(|k| h.col(k % 3)[k / 3] as f32);
            all.push(m);
        }
        body.fill(&all);
        body
    }

    #[test]
    fn what_is_unexplained_is_what_was_taken_away() {
        let f = DMat3::from_cols(
            DVec3::new(1.10, 0.05, -0.02),
            DVec3::new(0.03, 0.92, 0.04),
            DVec3::new(0.20, -0.01, 0.85),
        );
        let part = |a: f64| DMat3::IDENTITY + (f - DMat3::IDENTITY) * a;
        for (carried, unexplained) in [(1.0, 0.0), (0.0, 1.0), (2.0, 1.0), (0.5, 0.25)] {
            let d = drift(&deformed(f, part(carried)));
            let got = d.unexplained(d.shape);
            assert!((got - unexplained).abs() < 1e-4, "{carried}: {got}");
        }
    }

    #[test]
    fn a_pad_at_rest_or_turned_has_not_drifted() {
        let body = deformed(DMat3::IDENTITY, DMat3::IDENTITY);
        assert!(drift(&body).unexplained(least(&body)) < 0.1);
        let turned = DMat3::from_rotation_z(0.7);
        let d = drift(&deformed(turned, turned));
        assert!(d.unexplained(d.shape) < 1e-8);
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let body = deformed(DMat3::from_diagonal(DVec3::new(1.1, 1.0, 0.9)), DMat3::IDENTITY);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool");
            pool.install(|| drift(&body))
        };
        assert_eq!(on(1), on(3));
    }
}
