//! The contact face, sampled on any lattice from the top layer of particles.
//!
//! The displacement of the top layer is interpolated by Catmull-Rom splines along x and y, which pass through
//! the particles and have a continuous slope, so a finer lattice shows no facets. Beyond the
//! edge the layer is continued linearly. What is returned is the position of material points, with their
//! lateral displacement, not a height map.

use super::body::Body;
use crate::elastomer::Surface;
use glam::{DVec3, Vec3};

/// Displacement of the top layer's particles from rest, mm; x inner.
pub fn top_displacement(body: &Body) -> Vec<DVec3> {
    let [nx, ny, nz] = body.scheme.particles;
    let first = (nx * ny * (nz - 1)) as u32;
    let mut out = vec![DVec3::ZERO; nx * ny];
    for (bin, place) in body.bins.iter().zip(&body.grid.places) {
        for batch in &bin.batches {
            for i in 0..batch.len as usize {
                if let Some(n) = batch.id[i].checked_sub(first) {
                    let p = batch.get(i, place.origin());
                    let now = DVec3::from_array(body.grid.position_mm(p.cell, p.offset));
                    let n = n as usize;
                    out[n] = now - DVec3::from_array(body.scheme.rest_position_mm(n % nx, n / nx, nz - 1));
                }
            }
        }
    }
    out
}

/// Four neighbours and their Catmull-Rom weights at a place along a line of `n` points; indices beyond the
/// ends stand for linear continuation.
fn stencil(n: usize, place: f64) -> (isize, [f64; 4]) {
    let cell = (place.floor() as isize).clamp(0, n as isize - 2);
    let t = place - cell as f64;
    let (t2, t3) = (t * t, t * t * t);
    let w = [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ];
    (cell - 1, w)
}

fn interpolate(n: usize, place: f64, at: impl Fn(usize) -> DVec3) -> DVec3 {
    let (first, w) = stencil(n, place);
    (0..4).fold(DVec3::ZERO, |sum, k| {
        let i = first + k as isize;
        let value = if i < 0 {
            at(0) * 2.0 - at(1)
        } else if i >= n as isize {
            at(n - 1) * 2.0 - at(n - 2)
        } else {
            at(i as usize)
        };
        sum + value * w[k]
    })
}

/// The surface on an `nx` by `ny` lattice, edges included.
pub fn sample(body: &Body, nx: usize, ny: usize) -> Surface {
    let [px, py, _] = body.scheme.particles;
    let [size_x_mm, size_y_mm, _] = body.scheme.size_mm;
    let top = top_displacement(body);
    let place = |k: usize, n: usize, p: usize| k as f64 * (p - 1) as f64 / (n - 1) as f64;
    // Along x first, for every row of particles; then along y.
    let rows: Vec<DVec3> = (0..py)
        .flat_map(|j| {
            let top = &top;
            (0..nx).map(move |i| interpolate(px, place(i, nx, px), |k| top[j * px + k]))
        })
        .collect();
    let mut surface = Surface { nx, ny, size_x_mm, size_y_mm, positions: Vec::with_capacity(nx * ny) };
    for j in 0..ny {
        for i in 0..nx {
            let u = interpolate(py, place(j, ny, py), |k| rows[k * nx + i]);
            let [x, y] = surface.rest_xy(i, j);
            surface.positions.push(Vec3::new((x + u.x) as f32, (y + u.y) as f32, u.z as f32));
        }
    }
    surface
}
