//! A case of the explicit modes, followed and judged.
//!
//! Their answers are transients and carry the grid's known gap, so what is checked is exact or wide: numbers are finite,
//! no volume is lost or blown up, momentum changes by what contact and base give (to round-off), the face is neither
//! inside the indenter nor more than two cells away from it where it must touch, and a pad that is moved for 1e5 steps
//! gains no energy.

use super::cases::{Case, Family};
use super::checks::Checks;
use crate::elastomer::mpm::scheme::Scheme;
use crate::elastomer::mpm::stress::left_strain;
use crate::elastomer::{Elastomer, ElastomerCapture, Error, ExplicitSolver};
use crate::indenter::Indenter;
use crate::pose::Pose;

/// Steps over which momentum is balanced: as many as a capture's forces are a mean of.
const STEPS: usize = 10;
/// Way of one step in which the indenter as good as rests, mm.
const STAND_MM: f64 = 1e-9;

/// Follows a case and judges every waypoint.
///
/// # Errors
/// What the solver answers.
pub fn follow(case: &Case, checks: &mut Checks) -> Result<(), Error> {
    let body = case.indenter();
    let scheme = Scheme::new(&case.pad, &case.settings)?;
    let clear = 3.0 * scheme.dx_mm + 0.01;
    let start = Pose::new(case.at_mm[0], case.at_mm[1], clear, 0.0);
    let mut solver = ExplicitSolver::new(&case.pad, &case.settings, body.clone(), &start)?;
    let (particles, grid) = solver.body().memory_bytes();
    checks.hold("memory, GB", (particles + grid) as f64 / 1e9, 8.0);

    let mut pose = Pose { z_mm: -case.depth_mm, ..start };
    solver.advance(&pose)?;
    judge(case, checks, &body, &mut solver, pose)?;
    if case.family == Family::Long {
        return endure(case, checks, &mut solver, pose);
    }
    if case.slide_mm != 0.0 {
        let (sin, cos) = case.direction_deg.to_radians().sin_cos();
        pose = Pose { x_mm: pose.x_mm + case.slide_mm * cos, y_mm: pose.y_mm + case.slide_mm * sin, ..pose };
        solver.advance(&pose)?;
        judge(case, checks, &body, &mut solver, pose)?;
    }
    if case.turn_deg != 0.0 {
        pose.theta_deg = case.turn_deg;
        solver.advance(&pose)?;
        judge(case, checks, &body, &mut solver, pose)?;
    }
    balance(case, checks, &mut solver, pose)?;
    solver.advance(&Pose { z_mm: clear, ..pose })?;
    let released = solver.capture(case.lattice, case.lattice)?;
    finite(checks, &released);
    Ok(())
}

fn finite(checks: &mut Checks, now: &ElastomerCapture) -> bool {
    let f = now.forces;
    let numbers = [
        f.normal_force_n,
        f.shear_force_n[0],
        f.shear_force_n[1],
        f.torque_n_mm,
        now.stats.base_reaction_n,
        now.stats.residual,
        now.stats.elastic_energy_n_mm,
    ];
    let finite = numbers.iter().all(|v| v.is_finite()) && now.surface.positions.iter().all(|p| p.is_finite());
    checks.hold("finite", if finite { 0.0 } else { f64::NAN }, 1.0);
    finite
}

fn judge(
    case: &Case,
    checks: &mut Checks,
    body: &std::sync::Arc<dyn Indenter>,
    solver: &mut ExplicitSolver,
    pose: Pose,
) -> Result<(), Error> {
    let now = solver.capture(case.lattice, case.lattice)?;
    if !finite(checks, &now) {
        return Ok(());
    }
    let dx = solver.body().scheme.dx_mm;
    let mut nearest = f64::INFINITY;
    for p in &now.surface.positions {
        nearest = nearest.min(body.distance(pose.to_indenter(p.as_dvec3())));
    }
    checks.hold("penetration, cells", -nearest / dx, 1.0);
    if pose.depth_mm() > 2.0 * dx {
        checks.hold("gap, cells", nearest / dx, 2.0);
    }
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for particle in solver.body().particles() {
        let (_, e3) = left_strain(&particle.strain.map(f64::from));
        least = least.min(1.0 + e3);
        most = most.max(1.0 + e3);
    }
    checks.hold("least volume ratio, inverse", 1.0 / least, 1e3);
    checks.hold("largest volume ratio", most, 10.0);
    checks.hold(
        "negative energy",
        -now.stats.elastic_energy_n_mm,
        1e-6 * case.pad.material.youngs_modulus_mpa,
    );
    Ok(())
}

/// Over some steps in which the indenter stands, momentum changes by what contact and base gave.
fn balance(case: &Case, checks: &mut Checks, solver: &mut ExplicitSolver, pose: Pose) -> Result<(), Error> {
    let (before, _) = solver.body().momentum();
    for n in 1..=STEPS {
        let away = if n % 2 == 1 { STAND_MM } else { 0.0 };
        solver.advance(&Pose { z_mm: pose.z_mm + away, ..pose })?;
    }
    let (after, _) = solver.body().momentum();
    let now = solver.capture(2, 2)?;
    if !finite(checks, &now) {
        return Ok(());
    }
    let unit = solver.body().scheme.unit_force_n() / STEPS as f64;
    let gained = (after[2] - before[2]) * unit;
    let (contact, base) = (-now.forces.normal_force_n, now.stats.base_reaction_n);
    // Sums of single-precision numbers: a part in 1e4 of what passes through.
    let scale = contact.abs().max(base.abs()).max((before[2] * unit).abs());
    let scale = scale.max(1e-4 * case.pad.material.youngs_modulus_mpa);
    checks.hold("momentum", (gained - contact - base).abs() / scale, 0.01);
    Ok(())
}

/// Moves the indenter up and down for as many steps as the case asks for.
fn endure(case: &Case, checks: &mut Checks, solver: &mut ExplicitSolver, pose: Pose) -> Result<(), Error> {
    let mut steps = 0;
    let mut first = None;
    let mut round = 0u32;
    while steps < u64::from(case.times) {
        solver.advance(&Pose { z_mm: 0.5 * pose.z_mm, ..pose })?;
        solver.advance(&pose)?;
        round += 1;
        if round % 32 == 1 || case.times == 1 {
            let now = solver.capture(case.lattice, case.lattice)?;
            if !finite(checks, &now) {
                return Ok(());
            }
            steps += now.stats.iterations;
            let energy = now.stats.elastic_energy_n_mm * (1.0 + now.stats.residual);
            let first = *first.get_or_insert(energy);
            checks.hold("energy gained", energy / first.max(f64::MIN_POSITIVE), 3.0);
        }
    }
    Ok(())
}
