//! What is read of an equilibrium: the face, what acts on it, and whether it lies well inside the pad.

use super::super::grid::Grid;
use super::Level;
use crate::elastomer::{ContactForces, ElastomerCapture, Error, SolverStats, Surface};
use crate::indenter::Indenter;
use glam::Vec3;
use rayon::prelude::*;

/// Smallest distance of the contact from the pad's edge, mm.
const EDGE_MARGIN_MM: f64 = 1.0;

impl Level {
    /// Refuses contact beside the pad or too close to its edge.
    pub fn check_margin(&self, indenter: &dyn Indenter) -> Result<(), Error> {
        let size = self.machine.operator.grid().size;
        let [hx, hy] = indenter.half_extent_mm();
        // A body that covers the pad has no contact edge on it.
        let covers = |at: f64, half: f64, size: f64| at.abs() + size / 2.0 <= half;
        let distance = |p: f64, at: f64, half: f64, size: f64| {
            if covers(at, half, size) { f64::INFINITY } else { size / 2.0 - p.abs() }
        };
        let mut least = f64::INFINITY;
        for p in self.at.contacts.touching_points() {
            least = least.min(distance(p.x, self.at.pose.x_mm, hx, size[0])).min(distance(
                p.y,
                self.at.pose.y_mm,
                hy,
                size[1],
            ));
        }
        if least < EDGE_MARGIN_MM {
            return Err(Error::OffPad { pose: self.at.pose, distance_mm: least, allowed_mm: EDGE_MARGIN_MM });
        }
        Ok(())
    }

    /// The face, sampled, and what acts on it.
    ///
    /// # Errors
    /// [`Error::Setting`] for a lattice with fewer than two points along a side.
    pub fn capture(&self, indenter: &dyn Indenter, nx: usize, ny: usize) -> Result<ElastomerCapture, Error> {
        Surface::can_have(nx, ny)?;
        let grid = self.machine.operator.grid();
        let tables = |n: usize, size: f64, cells: usize| -> Vec<(f64, usize, [f64; 3])> {
            (0..n)
                .map(|i| {
                    let x = -size / 2.0 + size * i as f64 / (n - 1) as f64;
                    let (cell, w) = Grid::trace(x, size, cells);
                    (x, cell, w)
                })
                .collect()
        };
        let (xs, ys) = (tables(nx, grid.size[0], grid.nx), tables(ny, grid.size[1], grid.ny));
        let patch = self.at.contacts.patch();
        let (mut positions, mut contact) = (vec![Vec3::ZERO; nx * ny], vec![false; nx * ny]);
        positions.par_chunks_exact_mut(nx).zip(contact.par_chunks_exact_mut(nx)).zip(&ys).for_each(
            |((positions, contact), (y, j, wy))| {
                for ((position, contact), (x, i, wx)) in positions.iter_mut().zip(contact).zip(&xs) {
                    let rest = [*x, *y, self.chart.map_or(0.0, |chart| chart.height_mm(*x, *y))];
                    let p = grid.moved(&self.at.u, rest, [(*i, *wx), (*j, *wy)]);
                    *position = Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32);
                    *contact = patch.contains(x / grid.size[0] + 0.5, y / grid.size[1] + 0.5);
                }
            },
        );
        let surface = Surface { nx, ny, size_x_mm: grid.size[0], size_y_mm: grid.size[1], positions };
        // The patch is known more finely than the lattice shows it: that tells how the face has stretched, or nothing where no point
        // of it is pressed.
        let seen_at_rest_mm2 = surface.seen_at_rest_mm2(&contact);
        let seen = if seen_at_rest_mm2 > 0.0 { surface.seen_mm2(&contact) / seen_at_rest_mm2 } else { 1.0 };
        let (force, torque) = self.at.contacts.resultant(&self.at.pose);
        let stats = SolverStats {
            iterations: self.newton.iterations,
            passes: self.newton.passes,
            passes_per_step: self.newton.passes as f64 / (self.newton.iterations as f64).max(1.0),
            limit_hits: 0,
            particles: grid.points() as u64,
            residual: self.at.outcome.map_or(0.0, |o| o.residual),
            estimated_error: self.estimated_error(indenter),
            elastic_energy_n_mm: self.at.outcome.map_or(0.0, |o| o.evaluation.energy),
            base_reaction_n: self.at.outcome.map_or(0.0, |o| o.base_force),
            contact_area_mm2: seen * patch.area_mm2(),
            held: self.at.contacts.sticks().then(|| self.held(indenter)),
        };
        Ok(ElastomerCapture {
            surface,
            contact,
            rim: Vec::new(),
            forces: ContactForces {
                normal_force_n: -force.z,
                shear_force_n: [-force.x, -force.y],
                torque_n_mm: -torque,
            },
            stats,
        })
    }
}
