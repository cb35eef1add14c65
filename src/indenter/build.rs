//! From a checked [`IndenterSpec`] to a solid.

use super::outline::{Outline, Piece};
use super::solid::Solid;
use super::spec::{IndenterSpec, Plan, Shape};
use glam::{DVec2, Vec2Swizzles};
use std::f64::consts::{PI, TAU};

/// Overlap of two layers that stand on one another, mm.
const JOINT_MM: f64 = 0.1;

/// The round does not fit into the solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoundTooLarge {
    /// The largest that does, mm.
    pub largest_mm: f64,
}

/// The solid of a parametric shape with edges rounded by `round`. Meshes never come here.
pub(super) fn solid(spec: &IndenterSpec, round: f64) -> Result<Solid, RoundTooLarge> {
    let height = spec.height_mm;
    let upright = |plan: &Outline, z0: f64, z1: f64| {
        let room = plan.inradius().min((z1 - z0) / 2.0);
        let core = erode(plan, round, room)?;
        Ok(Solid::Upright { core, z0, z1, round })
    };
    match &spec.shape {
        Shape::Dome { radius_mm, diameter_mm } => revolved(&dome(*radius_mm, *diameter_mm, height), round),
        Shape::Domes { radius_mm, count, centre_radius_mm } => {
            let one = revolved(&dome(*radius_mm, 2.0 * radius_mm, height), round)?;
            let place = |i: u32| Solid::Shifted {
                by: DVec2::from_angle(TAU * f64::from(i) / f64::from(*count)) * *centre_radius_mm,
                solid: Box::new(one.clone()),
            };
            Ok(Solid::Union((0..*count).map(place).collect()))
        }
        Shape::Cone { tip_diameter_mm, half_angle_deg } => {
            let tip = tip_diameter_mm / 2.0;
            let top = tip + height * half_angle_deg.to_radians().tan();
            let corners = [(-tip, 0.0), (tip, 0.0), (top, height), (-top, height)];
            revolved(&Outline::polygon(&corners.map(DVec2::from)), round)
        }
        Shape::Torus { tube_radius_mm, centre_radius_mm } => {
            let ring = |x: f64| Outline::disc(DVec2::new(x, *tube_radius_mm), *tube_radius_mm);
            revolved(&ring(*centre_radius_mm).beside(ring(-centre_radius_mm)), round)
        }
        Shape::LyingCylinder { radius_mm, length_mm } => {
            along(&Outline::disc(DVec2::new(0.0, *radius_mm), *radius_mm), *length_mm, round)
        }
        Shape::Wave { pitch_mm, count, depth_mm, steep_fraction, crest_radius_mm, length_mm } => {
            let section = wave(*pitch_mm, *count, *depth_mm, *steep_fraction, height);
            along(&section, *length_mm, round.max(*crest_radius_mm))
        }
        Shape::Flat { plan } => upright(&outline(plan), 0.0, height),
        Shape::Socket { plan, cavity_radius_mm } => {
            let face = outline(plan);
            let (low, high) = face.bounds();
            let beyond = low.length().max(high.length()) + 10.0;
            let cavity = revolved(&cavity(*cavity_radius_mm, beyond, height), round)?;
            Ok(Solid::Intersection(vec![upright(&face, 0.0, height)?, cavity]))
        }
        Shape::CrossedRidges { count, width_mm, length_mm, pitch_mm, ridge_height_mm } => {
            let touching = stripes(*count, *width_mm, *length_mm, *pitch_mm, false);
            let standing_on = stripes(*count, *width_mm, *length_mm, *pitch_mm, true);
            // The layers overlap a little, so that no false surface lies between them.
            let joint = (ridge_height_mm + JOINT_MM).min(height);
            let (lower, upper) =
                (upright(&touching, 0.0, joint)?, upright(&standing_on, *ridge_height_mm, height)?);
            Ok(Solid::Union(vec![lower, upper]))
        }
        Shape::Stl { .. } => unreachable!("from_spec loads meshes itself"),
    }
}

fn erode(outline: &Outline, round: f64, room: f64) -> Result<Outline, RoundTooLarge> {
    let core = outline.eroded(round);
    // All room taken leaves a point or a line, of which the half beside the axis may be nothing.
    if (round > 0.0 && round >= room - 1e-6) || core.is_empty() {
        Err(RoundTooLarge { largest_mm: room })
    } else {
        Ok(core)
    }
}

/// Erodes a section and puts its tip back to height 0, where rounding may have raised it.
fn section(outline: &Outline, round: f64) -> Result<Outline, RoundTooLarge> {
    let core = erode(outline, round, outline.inradius())?;
    let tip = core.bounds().0.y - round;
    Ok(core.shifted(DVec2::new(0.0, -tip)))
}

fn revolved(outline: &Outline, round: f64) -> Result<Solid, RoundTooLarge> {
    Ok(Solid::Revolved { core: section(outline, round)?.right_half(), round })
}

fn along(outline: &Outline, length: f64, round: f64) -> Result<Solid, RoundTooLarge> {
    if round > length / 2.0 {
        return Err(RoundTooLarge { largest_mm: length / 2.0 });
    }
    Ok(Solid::Along { core: section(outline, round)?, half_length: length / 2.0, round })
}

/// Lines from corner to corner, appended to `pieces`.
fn lines(pieces: &mut Vec<Piece>, corners: &[DVec2]) {
    pieces.extend(corners.windows(2).map(|w| Piece::Line { a: w[0], b: w[1] }));
}

/// Section of a dome: an arc below, upright walls, a flat top.
fn dome(radius: f64, diameter: f64, height: f64) -> Outline {
    let half = diameter / 2.0;
    let reach = (half / radius).min(1.0).asin();
    let centre = DVec2::new(0.0, radius);
    // Two halves, so that the piece on the axis belongs to one side.
    let mut pieces = Outline::arc(centre, radius, -PI / 2.0 - reach, -PI / 2.0);
    pieces.extend(Outline::arc(centre, radius, -PI / 2.0, -PI / 2.0 + reach));
    let rim = radius - radius * reach.cos();
    let corner = |x: f64, z: f64| DVec2::new(x, z);
    lines(&mut pieces, &[corner(half, rim), corner(half, height), corner(-half, height), corner(-half, rim)]);
    Outline::from_pieces(pieces)
}

/// Section of a wide slab with a hemispherical cavity in its lower face.
fn cavity(radius: f64, half_width: f64, height: f64) -> Outline {
    let at = |x: f64, z: f64| DVec2::new(x, z);
    let mut pieces = Outline::arc(DVec2::ZERO, radius, PI, PI / 2.0);
    pieces.extend(Outline::arc(DVec2::ZERO, radius, PI / 2.0, 0.0));
    let (w, h) = (half_width, height);
    lines(&mut pieces, &[at(radius, 0.0), at(w, 0.0), at(w, h), at(-w, h), at(-w, 0.0), at(-radius, 0.0)]);
    Outline::from_pieces(pieces)
}

/// Section of a saw tooth whose crests point down.
fn wave(pitch: f64, count: u32, depth: f64, steep_fraction: f64, height: f64) -> Outline {
    let start = -pitch * f64::from(count) / 2.0;
    let mut corners = vec![DVec2::new(start, depth)];
    for i in 0..count {
        let x = start + pitch * f64::from(i);
        corners.push(DVec2::new(x + pitch * steep_fraction, 0.0));
        corners.push(DVec2::new(x + pitch, depth));
    }
    corners.extend([DVec2::new(-start, height), DVec2::new(start, height)]);
    Outline::polygon(&corners)
}

fn stripes(count: u32, width: f64, length: f64, pitch: f64, along_x: bool) -> Outline {
    let stripe = |i: u32| {
        let offset = pitch * (f64::from(i) - f64::from(count - 1) / 2.0);
        let (centre, half) = (DVec2::new(offset, 0.0), DVec2::new(width / 2.0, length / 2.0));
        if along_x { Outline::rectangle(centre.yx(), half.yx()) } else { Outline::rectangle(centre, half) }
    };
    (1..count).map(stripe).fold(stripe(0), Outline::beside)
}

/// The region of a plan.
fn outline(plan: &Plan) -> Outline {
    match plan {
        Plan::Disc { diameter_mm } => Outline::disc(DVec2::ZERO, diameter_mm / 2.0),
        Plan::Ring { outer_diameter_mm, inner_diameter_mm } => {
            let disc = |d: f64| Outline::disc(DVec2::ZERO, d / 2.0);
            disc(*outer_diameter_mm).with_hole(&disc(*inner_diameter_mm))
        }
        Plan::Rectangle { x_mm, y_mm } => Outline::rectangle(DVec2::ZERO, DVec2::new(*x_mm, *y_mm) / 2.0),
        Plan::Regular { corners, across_corners_mm } => {
            let corner = |i: u32| {
                DVec2::from_angle(TAU * f64::from(i) / f64::from(*corners)) * *across_corners_mm / 2.0
            };
            Outline::polygon(&(0..*corners).map(corner).collect::<Vec<_>>())
        }
        Plan::Polygon { corners_mm } => {
            Outline::polygon(&corners_mm.iter().copied().map(DVec2::from).collect::<Vec<_>>())
        }
        Plan::Crescent { outer_diameter_mm, cut_diameter_mm, cut_offset_mm } => {
            crescent(outer_diameter_mm / 2.0, cut_diameter_mm / 2.0, *cut_offset_mm)
        }
        Plan::Pacman { diameter_mm, mouth_deg } => {
            let (radius, half_mouth) = (diameter_mm / 2.0, mouth_deg.to_radians() / 2.0);
            let mut pieces = Outline::arc(DVec2::ZERO, radius, half_mouth, TAU - half_mouth);
            let lip = |angle: f64| DVec2::from_angle(angle) * radius;
            lines(&mut pieces, &[lip(-half_mouth), DVec2::ZERO, lip(half_mouth)]);
            Outline::from_pieces(pieces)
        }
        Plan::Stripes { count, width_mm, length_mm, pitch_mm } => {
            stripes(*count, *width_mm, *length_mm, *pitch_mm, false)
        }
    }
}

fn crescent(outer: f64, cut: f64, offset: f64) -> Outline {
    // Where the circles cross: the tip of a horn at angle `a` on the disc and `b` on the bite.
    let x = (offset * offset + outer * outer - cut * cut) / (2.0 * offset);
    let y = (outer * outer - x * x).sqrt();
    let (a, b) = (y.atan2(x), y.atan2(x - offset));
    let mut pieces = Outline::arc(DVec2::ZERO, outer, a, TAU - a);
    pieces.extend(Outline::arc(DVec2::new(offset, 0.0), cut, TAU - b, b));
    let crescent = Outline::from_pieces(pieces);
    let (low, high) = crescent.bounds();
    crescent.shifted(-(low + high) / 2.0)
}
