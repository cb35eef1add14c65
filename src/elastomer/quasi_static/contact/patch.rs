//! Where the face is pressed.

use super::Contacts;
use rayon::prelude::*;

impl Contacts {
    /// The pressed part of the face.
    pub fn patch(&self) -> Patch {
        let loaded = self.samples.iter().filter(|s| s.pressure > 0.0);
        let (sum, n) = loaded.fold((0.0, 0), |(sum, n), s| (sum + s.pressure, n + 1));
        let mean = sum / f64::from(n.max(1));
        let [nx, ny] = self.lattice.points();
        let mut sign = vec![-OUTSIDE; nx * ny];
        for s in self.samples.iter().filter(|_| mean > 0.0) {
            let [i, j] = self.lattice.place(s.cell, s.sub);
            sign[j * nx + i] = ((s.multiplier - self.stiffness * s.gap) / mean).clamp(-OUTSIDE, 1.0);
        }
        Patch { sign: Field::new([nx, ny], sign, |sign| sign > 0.0), area_mm2: self.lattice.area_mm2 }
    }
}

impl Contacts {
    /// What presses along z.
    pub fn loads(&self) -> Loads {
        let size = self.lattice.points();
        let mut pressure = vec![0.0; size[0] * size[1]];
        for a in &self.active {
            let [i, j] = self.lattice.place(a.cell, a.sub);
            pressure[j * size[0] + i] = -a.force.z / self.lattice.area_mm2;
        }
        Loads(Field::new(size, pressure, |pressure| pressure != 0.0))
    }
}

/// What presses the face along z, between the sample points, too: MPa on the flat.
#[derive(Debug)]
pub struct Loads(Field);

impl Loads {
    /// The pressure at a place given as parts of the face's sides, 0 to 1, MPa.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        self.0.at([x, y]).unwrap_or(0.0)
    }
}

/// Where the face is pressed, between the sample points, too.
#[derive(Debug)]
pub struct Patch {
    /// Positive where the face is pressed; at most 1 in size.
    sign: Field,
    /// Area of a sample on the flat, mm^2.
    area_mm2: f64,
}

impl Patch {
    /// Whether the face is pressed at a place given as parts of its sides, 0 to 1.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        self.sign.at([x, y]).is_some_and(|sign| sign > 0.0)
    }

    /// Its area at rest as it is seen along z, mm^2.
    pub fn area_mm2(&self) -> f64 {
        let [nx, ny] = self.sign.size.map(|n| FINER * n);
        let middle = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
        let in_row = |j: usize| (0..nx).filter(|i| self.contains(middle(*i, nx), middle(j, ny))).count();
        let pressed: usize = (0..ny).into_par_iter().map(in_row).sum();
        pressed as f64 * self.area_mm2 / (FINER * FINER) as f64
    }
}

/// Values in the middles of so many equal parts of a square.
#[derive(Debug)]
pub(super) struct Field {
    /// Along x and y.
    size: [usize; 2],
    values: Vec<f64>,
    /// The least and the greatest places along x and y that a value of interest has a part in.
    places: [[f64; 2]; 2],
}

impl Field {
    pub(super) fn new(size: [usize; 2], values: Vec<f64>, of_interest: impl Fn(f64) -> bool) -> Self {
        let mut places = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for (k, _) in values.iter().enumerate().filter(|(_, v)| of_interest(**v)) {
            for (axis, at) in [k % size[0], k / size[0]].into_iter().enumerate() {
                let [from, to] = [-0.5, 1.5].map(|off| (at as f64 + off) / size[axis] as f64);
                places[axis] = [places[axis][0].min(from), places[axis][1].max(to)];
            }
        }
        Self { size, values, places }
    }

    /// The bilinear interpolation at a place of the square; nothing where no value of interest has a part in it.
    pub(super) fn at(&self, place: [f64; 2]) -> Option<f64> {
        let [nx, _] = self.size;
        let within = |axis: usize| (self.places[axis][0]..=self.places[axis][1]).contains(&place[axis]);
        (within(0) && within(1)).then(|| {
            let [(i, a), (j, b)] = [0, 1].map(|axis| {
                let n = self.size[axis];
                let s = (place[axis] * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
                let i = (s as usize).min(n - 2);
                (i, s - i as f64)
            });
            let row = |j: usize| (1.0 - a) * self.values[j * nx + i] + a * self.values[j * nx + i + 1];
            (1.0 - b) * row(j) + b * row(j + 1)
        })
    }
}

/// What a sample off the indenter counts against the mean pressure where the edge of the contact is sought
/// between it and a loaded one. Found by experiment: the contact radius of a sphere, cells of 0.4 mm, is then
/// within 2 % of finite elements.
const OUTSIDE: f64 = 0.4;
/// Steps from sample to sample with which the area is measured.
const FINER: usize = 4;
