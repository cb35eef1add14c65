//! What lights and baffles of a sensor file must hold alike: where they stand, and triangles that are some.

use super::HousingSpec;
use crate::problem::Problems;
use glam::DVec3;

/// What a check is about, in its messages: a light or a baffle.
pub(super) type Kind = &'static str;

/// Requires a finite point inside the sensor.
pub(super) fn point(p: &mut Problems, kind: Kind, key: &str, at: &[f64; 3]) {
    if !at.iter().all(|v| v.is_finite()) || at[2] >= 0.0 {
        p.push(
            key,
            format!("{at:?}"),
            "finite, z below 0 (inside the sensor)",
            format!("z points away from the camera: give {kind}s a negative z"),
        );
    }
}

/// Requires a direction.
pub(super) fn direction(p: &mut Problems, facing: &[f64; 3]) {
    let length = DVec3::from_array(*facing).length();
    if !(length.is_finite() && length > 1e-6) {
        p.push(
            "shape.facing",
            format!("{facing:?}"),
            "a direction",
            "e.g. [1.0, 0.0, 0.0] for the left wall",
        );
    }
}

/// Requires extents of a rectangle.
pub(super) fn size(p: &mut Problems, size_mm: [f64; 2]) {
    for (k, value) in size_mm.iter().enumerate() {
        p.range(&format!("shape.size_mm[{k}]"), *value, 1e-3, 200.0, "mm");
    }
}

/// Requires triangles of given corners, with an area.
pub(super) fn triangles(p: &mut Problems, vertices_mm: &[[f64; 3]], triangles: &[[u32; 3]]) {
    let beyond = |t: &&[u32; 3]| t.iter().any(|k| *k as usize >= vertices_mm.len());
    if let Some(triangle) = triangles.iter().find(beyond) {
        p.push(
            "shape.triangles",
            format!("{triangle:?}"),
            format!("numbers of the {} corners, from 0", vertices_mm.len()),
            "count the corners of shape.vertices_mm from 0",
        );
    } else if triangles.is_empty() {
        p.push("shape.triangles", "[]", "at least one triangle", "e.g. [[0, 1, 2]]");
    } else {
        let area: f64 = triangles.iter().map(|t| area(t.map(|k| vertices_mm[k as usize]))).sum();
        if area < LEAST_MESH_MM2 {
            p.push(
                "shape.triangles",
                format!("{area} mm^2 in all"),
                format!("{LEAST_MESH_MM2} mm^2 or more"),
                "give triangles whose corners do not lie on a line",
            );
        }
    }
}

/// The least area of triangles, mm^2.
const LEAST_MESH_MM2: f64 = 1e-6;

fn area(corners: [[f64; 3]; 3]) -> f64 {
    let [a, b, c] = corners.map(DVec3::from_array);
    (b - a).cross(c - a).length() / 2.0
}

/// Requires places (each at its key) between the walls.
pub(super) fn within_walls(
    p: &mut Problems,
    kind: Kind,
    housing: &HousingSpec,
    places: &[(&'static str, [f64; 3])],
) {
    let walls = [housing.x_mm, housing.y_mm, [-housing.height_mm, f64::INFINITY]];
    for (key, at) in places {
        if at.iter().zip(walls).any(|(v, [low, high])| *v < low || *v > high) {
            p.push(
                key,
                format!("{at:?}"),
                format!(
                    "within the walls: x in {:?}, y in {:?}, z from {} mm",
                    housing.x_mm, housing.y_mm, -housing.height_mm
                ),
                format!("move the {kind} in, or optics.housing out: walls hide what is behind them"),
            );
        }
    }
}
