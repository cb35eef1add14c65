//! Where the material of a pad that is not flat rests: a map from the box of the grid.
//!
//! A place of the box is (x, y, z), z from minus the thickness to 0 at the face. On domes and cylinders the fibres
//! stand upright on the face, X = p(x, y) + z n(x, y) with the face p and its normal n, so that the backing has the
//! face's shape and the pad is equally thick everywhere. Rounded edges press the fibres together above a flat
//! backing. Where the rounding falls by more than 45 degrees the body goes on at 45: a sliver at the pad's border, where
//! nothing may touch, in exchange for a map that is steep nowhere (an upright face takes several times the iterations).

use crate::elastomer::PadShape;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;

/// The map of a pad that is not a box.
#[derive(Debug, Clone, Copy)]
pub struct Chart {
    shape: PadShape,
    /// Extent of the box, mm.
    size_mm: [f64; 3],
}

impl Chart {
    /// The map of a pad's body; none for a box, which needs none.
    pub fn new(shape: PadShape, size_mm: [f64; 3]) -> Option<Self> {
        (shape != PadShape::Cuboid).then_some(Self { shape, size_mm })
    }

    /// Height of the face, mm.
    pub fn height_mm(&self, x: f64, y: f64) -> f64 {
        self.shape.face_height_mm([self.size_mm[0], self.size_mm[1]], [x, y])
    }

    /// Offset from where a rounding begins, along x and y, mm.
    fn over(&self, radius_mm: f64, [x, y]: [f64; 2]) -> [f64; 2] {
        let over = |at: f64, size: f64| at.signum() * (at.abs() - (size / 2.0 - radius_mm)).max(0.0);
        [over(x, self.size_mm[0]), over(y, self.size_mm[1])]
    }

    /// Height of the body that is solved, mm: the face's, but nowhere steeper than 45 degrees on a rounding.
    fn body_height_mm(&self, x: f64, y: f64) -> f64 {
        let PadShape::Rounded { radius_mm } = self.shape else { return self.height_mm(x, y) };
        let [ox, oy] = self.over(radius_mm, [x, y]);
        let away = ox.hypot(oy);
        let steep = away.min(radius_mm * FRAC_1_SQRT_2);
        (radius_mm * radius_mm - steep * steep).sqrt() - radius_mm - (away - steep)
    }

    /// Derivatives of the body's height along x and y.
    fn slope(&self, x: f64, y: f64) -> [f64; 2] {
        let cap = |radius: f64, along: [f64; 2]| {
            let w2 = radius * radius - along[0] * along[0] - along[1] * along[1];
            if w2 > 0.0 { along.map(|a| -a / w2.sqrt()) } else { [0.0; 2] }
        };
        match self.shape {
            PadShape::Cuboid => [0.0; 2],
            PadShape::Rounded { radius_mm } => {
                let over = self.over(radius_mm, [x, y]);
                let away = over[0].hypot(over[1]);
                if away > radius_mm * FRAC_1_SQRT_2 { over.map(|o| -o / away) } else { cap(radius_mm, over) }
            }
            PadShape::Dome { radius_mm } => cap(radius_mm, [x, y]),
            PadShape::Cylinder { radius_mm } => cap(radius_mm, [x, 0.0]),
        }
    }

    /// How a flat layer is laid here, as the columns of its axes, so that its inverse is nearly this pad's: turned to
    /// the normal on domes and cylinders; made stiffer where a rounding has pressed the fibres together (by the part of
    /// the thickness that is left, over the stretch; found by experiment: half the iterations).
    pub fn frame(&self, x: f64, y: f64) -> DMat3 {
        match self.shape {
            PadShape::Cuboid => DMat3::IDENTITY,
            PadShape::Rounded { .. } => {
                let left = 1.0 + self.body_height_mm(x, y) / self.size_mm[2];
                DMat3::IDENTITY * (left / self.stretch(x, y))
            }
            PadShape::Dome { .. } | PadShape::Cylinder { .. } => {
                DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, self.normal(x, y)))
            }
        }
    }

    /// Outward normal of the face.
    pub fn normal(&self, x: f64, y: f64) -> DVec3 {
        let [sx, sy] = self.slope(x, y);
        DVec3::new(-sx, -sy, 1.0).normalize()
    }

    /// Area of the face over the area of the box's.
    pub fn stretch(&self, x: f64, y: f64) -> f64 {
        let [sx, sy] = self.slope(x, y);
        (1.0 + sx * sx + sy * sy).sqrt()
    }

    /// Derivatives of the resting place along x, y and z of the box, as columns.
    pub fn jacobian(&self, x: f64, y: f64, z: f64) -> DMat3 {
        let [sx, sy] = self.slope(x, y);
        let (along_x, along_y) = (DVec3::new(1.0, 0.0, sx), DVec3::new(0.0, 1.0, sy));
        match self.shape {
            PadShape::Cuboid => DMat3::IDENTITY,
            PadShape::Rounded { .. } => {
                let thickness = self.size_mm[2];
                let up = 1.0 + z / thickness;
                let left = 1.0 + self.body_height_mm(x, y) / thickness;
                DMat3::from_cols(
                    DVec3::new(1.0, 0.0, up * sx),
                    DVec3::new(0.0, 1.0, up * sy),
                    DVec3::Z * left,
                )
            }
            // Below a face of radius R everything is (R + z) / R as long, along the directions that bend.
            PadShape::Dome { radius_mm } => {
                let shrink = 1.0 + z / radius_mm;
                DMat3::from_cols(along_x * shrink, along_y * shrink, self.normal(x, y))
            }
            PadShape::Cylinder { radius_mm } => {
                let shrink = 1.0 + z / radius_mm;
                DMat3::from_cols(along_x * shrink, along_y, self.normal(x, y))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a place of the box rests, from the definitions alone.
    fn place(shape: PadShape, size: [f64; 3], x: f64, y: f64, z: f64) -> DVec3 {
        let height = shape.face_height_mm([size[0], size[1]], [x, y]);
        match shape {
            PadShape::Cuboid => DVec3::new(x, y, z),
            PadShape::Rounded { .. } => {
                let body = Chart::new(shape, size).unwrap().body_height_mm(x, y);
                // The body is the face's up to 45 degrees, and above it beyond.
                let steep = body > height + 1e-12;
                assert!(
                    body >= height - 1e-12
                        && (!steep || Chart::new(shape, size).unwrap().stretch(x, y) > 1.4)
                );
                DVec3::new(x, y, -size[2] + (z + size[2]) * (size[2] + body) / size[2])
            }
            PadShape::Dome { radius_mm: r } => {
                let middle = DVec3::NEG_Z * r;
                middle + (DVec3::new(x, y, height) - middle) * (1.0 + z / r)
            }
            PadShape::Cylinder { radius_mm: r } => {
                let middle = DVec3::new(0.0, y, -r);
                middle + (DVec3::new(x, y, height) - middle) * (1.0 + z / r)
            }
        }
    }

    #[test]
    fn the_derivatives_are_those_of_the_place() {
        let size = [18.0, 16.0, 3.0];
        for shape in [
            PadShape::Rounded { radius_mm: 1.5 },
            PadShape::Dome { radius_mm: 13.5 },
            PadShape::Cylinder { radius_mm: 11.0 },
        ] {
            let chart = Chart::new(shape, size).unwrap();
            for [x, y, z] in [[0.3, -0.2, -0.4], [7.9, -5.0, -1.0], [-8.2, 7.1, -2.5], [4.0, 7.6, 0.0]] {
                let step = 1e-5;
                let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|d| {
                    let at = |s: f64| place(shape, size, x + s * d.x, y + s * d.y, z + s * d.z);
                    (at(step) - at(-step)) / (2.0 * step)
                });
                let jacobian = chart.jacobian(x, y, z);
                let error = jacobian.sub_mat3(&DMat3::from_cols(columns[0], columns[1], columns[2]));
                assert!(
                    error.x_axis.length() + error.y_axis.length() + error.z_axis.length() < 1e-7,
                    "{shape:?}"
                );
                let face = chart.jacobian(x, y, 0.0);
                let area = face.x_axis.cross(face.y_axis);
                assert!((area.length() - chart.stretch(x, y)).abs() < 1e-12);
                assert!((area.normalize() - chart.normal(x, y)).length() < 1e-12);
            }
        }
    }
}
