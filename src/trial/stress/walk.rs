//! A case of the quasi-static mode, followed and judged.
//!
//! At every waypoint, whatever the pad: numbers are finite; base and contact balance within 1 %; the face is not inside
//! the indenter, not below the tip, not folded; nothing pulls. On the way: the work that the indenter does is not less
//! than what the pad stores (and equal to it without friction), a slide and a turn are resisted, Coulomb's force is not
//! exceeded. At the end the released face is flat. The families add what they are about.
//!
//! Bounds grow with the *claim*: the error that the solver states, or its tolerance where that is larger.

use super::cases::{Case, Family};
use super::checks::Checks;
use super::thin::half_space_n;
use crate::elastomer::{self, Elastomer, ElastomerCapture, Error, Friction, PadShape};
use crate::indenter::Indenter;
use crate::pose::Pose;
use crate::trial::scene;
use glam::DVec3;
use std::sync::Arc;

/// Height above the pad's highest place at which a path begins and ends, mm.
const CLEAR_MM: f64 = 0.3;
/// Waypoints of a slide are not further apart than this, mm, but there are no more than [`MOST_WAYPOINTS`].
const STRIDE_MM: f64 = 0.25;
const MOST_WAYPOINTS: f64 = 12.0;
/// Height to which a body that drags the face along lifts it, and lets it sink, over the way dragged: 0.2 and 0.27 are
/// seen with a slab 0.1 mm deep that is dragged 1 mm, with cells of 1.2 and of 0.3 mm.
const DRAG_MOVES: f64 = 0.3;
/// Elastic force of a square millimetre at a strain of a thousandth, per MPa: forces below this are noise, N.
const LEAST_FORCE_PER_MPA: f64 = 1e-3;

/// Follows a case and judges every waypoint.
///
/// # Errors
/// What the solver answers.
pub fn follow(case: &Case, checks: &mut Checks) -> Result<(), Error> {
    follow_as(case, checks, |_| {})
}

/// As [`follow`], with every capture altered before it is judged: how the checks themselves are tested.
///
/// # Errors
/// As [`follow`].
pub fn follow_as(
    case: &Case,
    checks: &mut Checks,
    alter: impl Fn(&mut ElastomerCapture),
) -> Result<(), Error> {
    let mut walk = Walk::new(case, case.settings.tolerance, checks, &alter)?;
    match case.family {
        Family::Layer => layer(&mut walk),
        Family::Finer => finer(&mut walk, &alter),
        Family::Mirror => mirror(&mut walk),
        Family::Repeat => repeat(case, checks),
        Family::Cycles => cycles(&mut walk),
        _ => path(&mut walk),
    }
}

/// A solver on its way, with the checks that every waypoint goes through.
struct Walk<'a> {
    case: &'a Case,
    body: Arc<dyn Indenter>,
    solver: Box<dyn Elastomer>,
    pose: Pose,
    last: Option<ElastomerCapture>,
    /// Work of the indenter since the first waypoint that was counted, and the sum of its absolute values, N mm.
    work: [f64; 2],
    tolerance: f64,
    claim: f64,
    /// Way along the face that the outermost point of the body has gone in contact, mm.
    dragged_mm: f64,
    checks: &'a mut Checks,
    alter: &'a dyn Fn(&mut ElastomerCapture),
}

impl<'a> Walk<'a> {
    fn new(
        case: &'a Case,
        tolerance: f64,
        checks: &'a mut Checks,
        alter: &'a dyn Fn(&mut ElastomerCapture),
    ) -> Result<Self, Error> {
        let body = case.indenter();
        let pose = Pose::new(case.at_mm[0], case.at_mm[1], CLEAR_MM, case.askew_deg);
        let settings = elastomer::Settings { tolerance, ..case.settings.clone() };
        let solver = elastomer::solver(&case.pad, &settings, body.clone(), &pose)?;
        Ok(Self {
            case,
            body,
            solver,
            pose,
            last: None,
            work: [0.0; 2],
            tolerance,
            claim: tolerance,
            dragged_mm: 0.0,
            checks,
            alter,
        })
    }

    /// The tip this much above the face.
    fn at(&self, above_mm: f64) -> Pose {
        Pose { z_mm: self.rest_mm([self.pose.x_mm, self.pose.y_mm]) + above_mm, ..self.pose }
    }

    /// Height of the untouched face, mm.
    fn rest_mm(&self, at: [f64; 2]) -> f64 {
        let pad = &self.case.pad;
        pad.shape.face_height_mm([pad.size_x_mm, pad.size_y_mm], at)
    }

    /// How far the indenter reaches below the untouched face, mm.
    fn depth_mm(&self, now: &ElastomerCapture) -> f64 {
        if self.case.pad.shape == PadShape::Cuboid {
            return self.pose.depth_mm();
        }
        let s = &now.surface;
        let lattice = (0..s.ny).flat_map(|j| (0..s.nx).map(move |i| (i, j)));
        let inside = lattice.map(|(i, j)| {
            let [x, y] = s.rest_xy(i, j);
            let p = self.pose.to_indenter(DVec3::new(x, y, self.rest_mm([x, y])));
            self.body.lower_surface(p.x, p.y).map_or(0.0, |lower| p.z - lower)
        });
        inside.fold(0.0, f64::max)
    }

    fn frictionless(&self) -> bool {
        self.case.settings.friction == Friction::Coefficient(0.0)
    }

    /// Distance of the body's outermost points from its axis, mm.
    fn reach_mm(&self) -> f64 {
        let [hx, hy] = self.body.half_extent_mm();
        hx.max(hy)
    }

    /// Forces below this are noise, N.
    fn least_force(&self) -> f64 {
        LEAST_FORCE_PER_MPA * self.case.pad.material.youngs_modulus_mpa
    }

    fn go(&mut self, pose: Pose) -> Result<ElastomerCapture, Error> {
        self.solver.advance(&pose)?;
        let mut now = self.solver.capture(self.case.lattice, self.case.lattice)?;
        (self.alter)(&mut now);
        if let Some(before) = &self.last {
            // Forces are the pad's on the indenter, so the indenter's work has the other sign.
            let mean = |f: fn(&ElastomerCapture) -> f64| 0.5 * (f(before) + f(&now));
            let work = -mean(|c| c.forces.shear_force_n[0]) * (pose.x_mm - self.pose.x_mm)
                - mean(|c| c.forces.shear_force_n[1]) * (pose.y_mm - self.pose.y_mm)
                - mean(|c| c.forces.normal_force_n) * (pose.z_mm - self.pose.z_mm)
                - mean(|c| c.forces.torque_n_mm) * (pose.theta_deg - self.pose.theta_deg).to_radians();
            self.work = [self.work[0] + work, self.work[1] + work.abs()];
        }
        let turned = (pose.theta_deg - self.pose.theta_deg).abs().to_radians();
        self.dragged_mm += (pose.x_mm - self.pose.x_mm).hypot(pose.y_mm - self.pose.y_mm);
        self.dragged_mm += turned * self.reach_mm();
        self.pose = pose;
        self.judge(&now);
        self.last = Some(now.clone());
        Ok(now)
    }

    /// What must hold at any waypoint.
    fn judge(&mut self, now: &ElastomerCapture) {
        let (f, stats) = (now.forces, &now.stats);
        let stated = stats.estimated_error.unwrap_or(0.0);
        self.checks.stated_error = Some(self.checks.stated_error.unwrap_or(0.0).max(stated));
        self.claim = self.tolerance.max(stated);
        let (depth, claim, least) = (self.depth_mm(now), self.claim, self.least_force());

        let numbers =
            [f.normal_force_n, f.shear_force_n[0], f.shear_force_n[1], f.torque_n_mm, stats.base_reaction_n];
        let finite = numbers.iter().all(|v| v.is_finite())
            && stats.elastic_energy_n_mm.is_finite()
            && claim.is_finite()
            && now.surface.positions.iter().all(|p| p.is_finite());
        self.checks.hold("finite", if finite { 0.0 } else { f64::NAN }, 1.0);
        if !finite {
            return;
        }
        let normal = f.normal_force_n.abs().max(least);
        self.checks.hold("balance", (stats.base_reaction_n - f.normal_force_n).abs() / normal, 0.01);
        self.checks.hold("pull, N", -f.normal_force_n, least);
        self.checks.hold("negative energy, N mm", -stats.elastic_energy_n_mm, 0.01 * least);

        // Where the face is. The claim is a root mean square; a single point may be off by more.
        let (mut inside, mut lowest, mut highest) = (0.0f64, 0.0f64, 0.0f64);
        let (mut squares, mut touching) = (0.0, 0u32);
        let nx = now.surface.nx;
        for (n, (p, contact)) in now.surface.positions.iter().zip(&now.contact).enumerate() {
            let p = p.as_dvec3();
            let rest_mm = self.rest_mm(now.surface.rest_xy(n % nx, n / nx));
            let d = -self.body.distance(self.pose.to_indenter(p));
            if *contact || d > 0.0 {
                squares += d.max(0.0).powi(2);
                touching += 1;
            }
            inside = inside.max(d);
            lowest = lowest.max(rest_mm - p.z);
            highest = highest.max(p.z - rest_mm);
        }
        let (mean, most) = (1.5 * claim * depth + 1e-3, 6.0 * claim * depth + 5e-3);
        self.checks.hold("penetration RMS, mm", (squares / f64::from(touching.max(1))).sqrt(), mean);
        self.checks.hold("penetration, mm", inside, most);
        // What drags the face along lifts it in front and lets it sink behind, whatever the depth.
        let dragged = if self.frictionless() { 0.0 } else { DRAG_MOVES * self.dragged_mm };
        self.checks.hold("below the tip, mm", lowest - depth, most + dragged);
        self.checks.hold("above the pad, mm", highest, depth + most + dragged);
        self.checks.hold("folded", folded(now), 5e-3);
    }

    /// Compares the work since the reset with the energy stored since then.
    fn judge_work(&mut self, energy_before: f64) {
        let Some(now) = &self.last else { return };
        let stored = now.stats.elastic_energy_n_mm - energy_before;
        let scale = self.work[1].max(now.stats.elastic_energy_n_mm).max(1e-3 * self.least_force());
        let bound = 0.05 + 0.5 * self.claim;
        self.checks.hold("more stored than worked", (stored - self.work[0]) / scale, bound);
        if self.frictionless() {
            self.checks.hold("dissipation without friction", (self.work[0] - stored).abs() / scale, bound);
        }
    }

    /// Lifts off and looks whether the face is flat again.
    fn release(&mut self) -> Result<(), Error> {
        let now = self.go(Pose { z_mm: CLEAR_MM, ..self.pose })?;
        let s = &now.surface;
        let mut off = 0.0f64;
        for j in 0..s.ny {
            for i in 0..s.nx {
                let [x, y] = s.rest_xy(i, j);
                off = off.max(
                    (s.positions[j * s.nx + i].as_dvec3() - DVec3::new(x, y, self.rest_mm([x, y]))).length(),
                );
            }
        }
        self.checks.hold("off rest when released, mm", off, 1e-3);
        self.checks.hold(
            "force when released, N",
            now.forces.normal_force_n.abs(),
            self.least_force() * 1e-3,
        );
        Ok(())
    }
}

/// Part of the face's triangles that look downwards.
fn folded(now: &ElastomerCapture) -> f64 {
    let s = &now.surface;
    let at = |i: usize, j: usize| s.positions[j * s.nx + i];
    let mut down = 0;
    for j in 1..s.ny {
        for i in 1..s.nx {
            let (a, b, c, d) = (at(i - 1, j - 1), at(i, j - 1), at(i - 1, j), at(i, j));
            down += usize::from((b - a).cross(c - a).z <= 0.0) + usize::from((c - d).cross(b - d).z <= 0.0);
        }
    }
    down as f64 / (2 * (s.nx - 1) * (s.ny - 1)) as f64
}

/// Press in three strides, then slide, then turn, then release: as much of it as the case wants.
fn path(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    let depth = case.depth_mm;
    let low = walk.go(walk.at(-0.8 * depth))?;
    let middle = walk.go(walk.at(-0.9 * depth))?;
    let deep = walk.go(walk.at(-depth))?;
    let energy = |c: &ElastomerCapture| c.stats.elastic_energy_n_mm;
    let least = walk.least_force();
    if middle.forces.normal_force_n > least {
        // dE/dd = F, by a central difference of second order.
        let slope = (energy(&deep) - energy(&low)) / (0.2 * depth);
        let off = (slope - middle.forces.normal_force_n) / middle.forces.normal_force_n;
        let bound = 0.03 + walk.claim;
        // Where points slip, some of the work is lost.
        let sticks_or_slides = !matches!(case.settings.friction, Friction::Coefficient(mu) if mu > 0.0);
        walk.checks.hold("dE/dd against force", if sticks_or_slides { off.abs() } else { off }, bound);
        let falls = |a: &ElastomerCapture, b: &ElastomerCapture| {
            (a.forces.normal_force_n - b.forces.normal_force_n) / middle.forces.normal_force_n
        };
        walk.checks.hold("force falls in a press", falls(&low, &middle).max(falls(&middle, &deep)), 1e-3);
    }
    if case.family == Family::Thin {
        // The pad is deformed far, and it may be less stiff then than at first.
        let missing = half_space_n(case) / deep.forces.normal_force_n.max(0.0);
        walk.checks.hold("force of a half-space over that of a thin body", missing, 2.0);
    }
    let centred = case.at_mm == [0.0; 2];
    if case.family == Family::Press && centred && is_mirrored(walk.body.as_ref()) {
        let bound = 0.5 * walk.claim * depth + 5e-4;
        walk.checks.hold("asymmetry, mm", asymmetry_mm(&deep), bound);
        let shear = deep.forces.shear_force_n[0].hypot(deep.forces.shear_force_n[1]);
        walk.checks.hold("shear of a symmetric press, N", shear, 0.005 * deep.forces.normal_force_n + least);
    }
    if case.slide_mm > 0.0 {
        slide(walk, case.slide_mm, case.direction_deg)?;
    }
    if case.turn_deg != 0.0 {
        let (energy, start) = (walk.last.as_ref().map_or(0.0, energy), walk.pose);
        walk.work = [0.0; 2];
        for n in 1..=4 {
            let theta_deg = start.theta_deg + case.turn_deg * f64::from(n) / 4.0;
            let now = walk.go(Pose { theta_deg, ..walk.pose })?;
            let normal = now.forces.normal_force_n;
            if walk.frictionless() {
                // None but what errors of the pressure make of the walls, at the arm of the contact.
                let arm_mm = (now.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
                let bound = walk.claim * normal * arm_mm + walk.least_force();
                walk.checks.hold("torque without friction, N mm", now.forces.torque_n_mm.abs(), bound);
                continue;
            }
            // The pad's torque has the other sign than the turn, unless there is hardly any.
            let with = now.forces.torque_n_mm * case.turn_deg.signum();
            walk.checks.hold("torque along the turn, N mm", with, 0.05 * normal + walk.least_force());
        }
        walk.judge_work(energy);
    }
    walk.release()
}

/// Slides, and hands over what was captured on the way.
fn slide(walk: &mut Walk<'_>, way_mm: f64, direction_deg: f64) -> Result<Vec<ElastomerCapture>, Error> {
    let mut captures = Vec::new();
    let start = walk.pose;
    let energy = walk.last.as_ref().map_or(0.0, |c| c.stats.elastic_energy_n_mm);
    walk.work = [0.0; 2];
    let (sin, cos) = direction_deg.to_radians().sin_cos();
    let [hx, hy] = walk.body.half_extent_mm();
    let narrowest = hx.min(hy);
    let parts = (way_mm / STRIDE_MM).ceil().clamp(4.0, MOST_WAYPOINTS) as u32;
    for n in 1..=parts {
        let s = way_mm * f64::from(n) / f64::from(parts);
        let now = walk.go(Pose { x_mm: start.x_mm + s * cos, y_mm: start.y_mm + s * sin, ..start })?;
        let f = now.forces;
        captures.push(now.clone());
        let normal = f.normal_force_n.max(walk.least_force());
        let along = f.shear_force_n[0] * cos + f.shear_force_n[1] * sin;
        if walk.case.pad.shape != PadShape::Cuboid {
            // On a slope the normal pushes along the slide as well.
            continue;
        }
        walk.checks.hold("force along the slide", along / normal, 0.05);
        let shear = f.shear_force_n[0].hypot(f.shear_force_n[1]) / normal;
        match walk.case.settings.friction {
            Friction::Coefficient(0.0) => {
                walk.checks.hold("shear without friction", shear, 0.03 + walk.claim)
            }
            // Stretched material and, where they are shallow, slopes raise the force above mu N by less than half; steep
            // flanks plough.
            Friction::Coefficient(mu) if mu <= 0.5 && walk.case.depth_mm <= 0.2 * narrowest => {
                let ploughing = shear_of_ploughing(&now, mu, [cos, sin]) + 0.05;
                walk.checks.hold("shear against Coulomb", shear, ploughing.max(1.5 * mu + 0.05));
            }
            _ => {}
        }
    }
    walk.judge_work(energy);
    Ok(captures)
}

/// Most that a slide may pull, over the normal force, were the same pressure on all that touches: friction along the face and the
/// push of what stands in front, where friction takes from the normal force; what stands behind pushes nothing forwards. (Of a
/// cone of half angle a that touches all around (1 / pi) cot a without friction.)
fn shear_of_ploughing(now: &ElastomerCapture, mu: f64, direction: [f64; 2]) -> f64 {
    let s = &now.surface;
    let at = |n: usize| s.positions[n].as_dvec3();
    let way = DVec3::new(direction[0], direction[1], 0.0);
    let [mut along, mut up, mut level] = [0.0f64; 3];
    for corner in (1..s.ny).flat_map(|j| (1..s.nx).map(move |i| j * s.nx + i)) {
        let [a, b, c, d] = [corner - s.nx - 1, corner - s.nx, corner - 1, corner];
        if ![a, b, c, d].iter().any(|&n| now.contact[n]) {
            continue;
        }
        let area = 0.5 * (at(d) - at(a)).cross(at(c) - at(b));
        let normal = area.normalize_or(DVec3::Z);
        let rubs = mu * area.length() * way.reject_from_normalized(normal).normalize_or_zero();
        along += rubs.dot(way) + (-area.dot(way)).max(0.0);
        up += area.z - rubs.z.max(0.0);
        level += area.z;
    }
    if level > 0.0 { along / up.max(0.5 * level) } else { 0.0 }
}

/// Whether a body is its own mirror image in x and in y.
fn is_mirrored(body: &dyn Indenter) -> bool {
    let [hx, hy] = body.half_extent_mm();
    let at = |k: u32, half: f64, step: f64| half * ((f64::from(k) * step).fract() * 2.2 - 1.1);
    (0..200).all(|k| {
        let p = DVec3::new(at(k, hx, 0.618), at(k, hy, 0.414), 0.3 * f64::from(k % 7));
        let d = body.distance(p);
        [[-1.0, 1.0], [1.0, -1.0]]
            .iter()
            .all(|m| (body.distance(DVec3::new(m[0] * p.x, m[1] * p.y, p.z)) - d).abs() < 1e-9)
    })
}

/// Largest difference between the heights of a surface and of its mirror images, mm, away from the edge of the contact:
/// there a point that touches or not moves the face by itself, and errors are not counted.
fn asymmetry_mm(now: &ElastomerCapture) -> f64 {
    let s = &now.surface;
    let z = |i: usize, j: usize| s.positions[j * s.nx + i].z;
    let edge = edge_of_contact(now);
    let mut most = 0.0f32;
    for j in 0..s.ny {
        for i in 0..s.nx {
            for (p, q) in [(s.nx - 1 - i, j), (i, s.ny - 1 - j)] {
                if !edge[j * s.nx + i] && !edge[q * s.nx + p] {
                    most = most.max((z(i, j) - z(p, q)).abs());
                }
            }
        }
    }
    f64::from(most)
}

/// The points within [`EDGE_BAND_MM`] of one that touches where they do not, or does not where they do; at least their
/// neighbours.
fn edge_of_contact(now: &ElastomerCapture) -> Vec<bool> {
    let s = &now.surface;
    let pitch = [s.size_x_mm / (s.nx - 1) as f64, s.size_y_mm / (s.ny - 1) as f64];
    let reach = pitch.map(|p| ((scene::EDGE_BAND_MM / p) as usize).max(1));
    let near = |at: usize, reach: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
    let touches = |i: usize, j: usize| now.contact[j * s.nx + i];
    (0..s.nx * s.ny)
        .map(|n| (n % s.nx, n / s.nx))
        .map(|(i, j)| {
            let mut around =
                near(j, reach[1], s.ny).flat_map(|q| near(i, reach[0], s.nx).map(move |p| (p, q)));
            around.any(|(p, q)| touches(p, q) != touches(i, j))
        })
        .collect()
}

/// Dimitriadis et al. 2002, equation 13, for a bonded layer; within 0.5 % of the exact solution where
/// sqrt(R d) / h is below 0.17 (checked against the Fredholm equation at nu = 0.45).
fn bonded_layer_n(case: &Case, radius_mm: f64) -> f64 {
    use std::f64::consts::PI;
    let (m, d, h) = (&case.pad.material, case.depth_mm, case.pad.thickness_mm);
    let nu = m.poisson_ratio;
    let a0 = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let b0 = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let x = (radius_mm * d).sqrt() / h;
    let hertz = 4.0 / 3.0 * m.youngs_modulus_mpa / (1.0 - nu * nu) * radius_mm.sqrt() * d.powf(1.5);
    hertz
        * (1.0 - 2.0 * a0 / PI * x + 4.0 * (a0 / PI).powi(2) * x * x
            - 8.0 / PI.powi(3) * (a0.powi(3) + 4.0 * PI * PI / 15.0 * b0) * x.powi(3)
            + 16.0 * a0 / PI.powi(4) * (a0.powi(3) + 3.0 * PI * PI / 5.0 * b0) * x.powi(4))
}

fn layer(walk: &mut Walk<'_>) -> Result<(), Error> {
    let now = walk.go(walk.at(-walk.case.depth_mm))?;
    let [radius_mm, _] = walk.body.half_extent_mm();
    let exact = bonded_layer_n(walk.case, radius_mm);
    let off = (now.forces.normal_force_n - exact).abs() / exact;
    // The formula is of small strains and of a paraboloid: a sphere of 2 mm is 4.7 % softer at 0.23 mm with any cells.
    let strain = 0.4 * walk.case.depth_mm / radius_mm;
    walk.checks.hold("force against the exact layer", off, 0.02 + strain + 2.0 * walk.claim);
    walk.release()
}

/// The same path with a third of the tolerance.
fn finer(walk: &mut Walk<'_>, alter: &dyn Fn(&mut ElastomerCapture)) -> Result<(), Error> {
    let case = walk.case;
    let depth = case.depth_mm;
    let target = Pose { x_mm: case.slide_mm, ..walk.at(-depth) };
    walk.go(walk.at(-depth))?;
    let coarse = walk.go(target)?;
    let mut own = Checks::default();
    let mut other = Walk::new(case, case.settings.tolerance / 3.0, &mut own, alter)?;
    other.go(other.at(-depth))?;
    let fine = other.go(target)?;
    let claims = walk.claim + other.claim;
    let radius = (fine.stats.contact_area_mm2 / std::f64::consts::PI).sqrt();
    let [rmse_um, _] =
        scene::height_difference_um(&coarse.surface, &fine.surface, (2.0 * radius).max(3.0), f64::MAX);
    walk.checks.hold("RMSE against finer, of the depth", 1e-3 * rmse_um / depth, claims);
    let normal = fine.forces.normal_force_n.max(walk.least_force());
    let off = (coarse.forces.normal_force_n - normal).abs() / normal;
    walk.checks.hold("force against finer", off, 3.0 * claims);
    Ok(())
}

/// A slide to the left mirrors one to the right, at every waypoint.
fn mirror(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    walk.go(walk.at(-case.depth_mm))?;
    let forked = walk.solver.fork();
    let (start, pressed) = (walk.pose, walk.last.clone());
    let right = slide(walk, case.slide_mm, 0.0)?;
    (walk.solver, walk.pose, walk.last) = (forked, start, pressed);
    let left = slide(walk, case.slide_mm, 180.0)?;
    for (right, left) in right.iter().zip(&left) {
        let s = &right.surface;
        let mut most = 0.0f32;
        for j in 0..s.ny {
            for i in 0..s.nx {
                let (a, b) = (s.positions[j * s.nx + i], left.surface.positions[j * s.nx + s.nx - 1 - i]);
                most = most.max((a.z - b.z).abs()).max((a.x + b.x).abs()).max((a.y - b.y).abs());
            }
        }
        let claim = left.stats.estimated_error.unwrap_or(0.0).max(walk.tolerance);
        walk.checks.hold("left against right, mm", f64::from(most), claim * case.depth_mm + 1e-3);
        let normal = right.forces.normal_force_n.max(walk.least_force());
        let off = (right.forces.normal_force_n - left.forces.normal_force_n).abs() / normal;
        walk.checks.hold("left force against right", off, 0.01 + 0.5 * claim);
        let drag = right.forces.shear_force_n[0] + left.forces.shear_force_n[0];
        walk.checks.hold("left drag against right", drag.abs() / normal, 0.02 + claim);
    }
    walk.release()
}

/// The same path twice, on one thread and on three: the same bytes.
fn repeat(case: &Case, checks: &mut Checks) -> Result<(), Error> {
    let captures = |threads: usize, checks: &mut Checks| -> Result<Vec<ElastomerCapture>, Error> {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| Error::Setting {
                key: "threads",
                value: threads.to_string(),
                allowed: format!("as many as the system makes ({e})"),
                next: "ask for fewer".to_owned(),
            })?;
        pool.install(|| {
            let alter = |_: &mut ElastomerCapture| {};
            let mut walk = Walk::new(case, case.settings.tolerance, checks, &alter)?;
            let press = walk.go(walk.at(-case.depth_mm))?;
            let slid = walk.go(Pose { x_mm: case.slide_mm, ..walk.pose })?;
            let turned = walk.go(Pose { theta_deg: case.turn_deg, ..walk.pose })?;
            Ok(vec![press, slid, turned])
        })
    };
    // An error is an answer, too, and must be the same one.
    let (one, three) = (captures(1, checks), captures(3, checks));
    checks.hold("differs when repeated", if one == three { 0.0 } else { 2.0 }, 1.0);
    one.map(drop)
}

/// Pressed and let go (not quite) again and again: the force at the bottom does not wander.
fn cycles(walk: &mut Walk<'_>) -> Result<(), Error> {
    let case = walk.case;
    let mut first = None;
    for n in 0..case.times {
        let pose = walk.at(-case.depth_mm);
        if n % 50 != 1 {
            walk.solver.advance(&pose)?;
            walk.pose = pose;
        } else {
            let force = walk.go(pose)?.forces.normal_force_n;
            let first = *first.get_or_insert(force);
            let off = (force - first).abs() / force.max(walk.least_force());
            walk.checks.hold("force wanders over cycles", off, 0.01 + 0.5 * walk.claim);
        }
        let pose = walk.at(-0.3 * case.depth_mm);
        walk.solver.advance(&pose)?;
        walk.pose = pose;
    }
    walk.release()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastomer::Law;

    #[test]
    fn the_formula_of_the_layer_agrees_with_the_exact_solution() {
        let shape = crate::indenter::spec::Shape::Dome { radius_mm: 4.0, diameter_mm: 8.0 };
        let body = super::super::Body { name: "sphere".into(), spec: scene::spec(shape, 0.0) };
        let mut case = super::super::case(7, 1, &[body]);
        case.pad = scene::pad(Law::NeoHookean);
        // Fredholm equation: R 4, h 4, E 0.145, nu 0.45.
        for (d, force, within) in [(0.05, 0.0061411, 0.003), (0.1, 0.0183889, 0.005)] {
            case.depth_mm = d;
            let formula = bonded_layer_n(&case, 4.0);
            assert!((formula - force).abs() < within * force, "{d}: {formula} {force}");
        }
    }

    #[test]
    fn a_sphere_is_its_own_mirror_image_and_a_skew_body_is_not() {
        assert!(is_mirrored(scene::sphere(3.0).as_ref()));
        let plan =
            crate::indenter::spec::Plan::Polygon { corners_mm: vec![[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]] };
        let shape = crate::indenter::spec::Shape::Flat { plan };
        let skew = crate::indenter::from_spec("skew", &scene::spec(shape, 0.0), None).expect("a triangle");
        assert!(!is_mirrored(skew.as_ref()));
    }
}
