//! What can be set about an elastomer simulation: the `[elastomer]` table of a rig file.

use super::{Law, Pad, Skip};
use serde::{Deserialize, Serialize};

/// How the pad is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Explicit MLS-MPM without relative rest: the paper's baseline.
    Mpm,
    /// Explicit MLS-MPM with the paper's relative-rest loop.
    Impm,
    /// An equilibrium with unilateral contact and friction at each waypoint.
    QuasiStatic,
}

impl Mode {
    /// The word that a rig file has for it.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Mpm => "mpm",
            Mode::Impm => "impm",
            Mode::QuasiStatic => "quasi_static",
        }
    }
}

/// The keys of [`Settings`] that not every mode uses, each with the modes that do.
pub const OF_SOME_MODES: [(&str, &[Mode]); 9] = [
    ("tolerance", &[Mode::QuasiStatic]),
    ("particles", EXPLICIT),
    ("dx_mm", EXPLICIT),
    ("dt_s", EXPLICIT),
    ("speed_mm_s", EXPLICIT),
    ("rest_threshold", &[Mode::Impm]),
    ("rest_limit", &[Mode::Impm]),
    ("rest_floor_mm_s", &[Mode::Impm]),
    ("base", EXPLICIT),
];
/// See [`OF_SOME_MODES`].
const EXPLICIT: &[Mode] = &[Mode::Impm, Mode::Mpm];

/// Friction between indenter and pad: a coefficient, or the word `"infinite"`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Friction {
    /// What touches holds; in quasi-static mode until it has been dragged by twice its depth (at least 1 mm) and tears loose.
    Infinite,
    /// Coulomb's coefficient; 0 is frictionless.
    Coefficient(f64),
}

impl Serialize for Friction {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Friction::Infinite => s.serialize_str("infinite"),
            Friction::Coefficient(mu) => s.serialize_f64(*mu),
        }
    }
}

impl Friction {
    /// Largest coefficient. Found by experiment: a sphere of radius 4 mm, 0.3 mm deep and dragged by 1 mm with a coefficient of 10, drags
    /// by up to 10 % otherwise in other waypoints and states 0.3 %; with 2 a slide of 5 mm loses its symmetry.
    pub const MOST: f64 = 1.0;
}

impl<'de> Deserialize<'de> for Friction {
    fn deserialize<D: serde::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = Friction;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a friction coefficient (0 to 1) or \"infinite\"")
            }
            fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<Friction, E> {
                if (0.0..=Friction::MOST).contains(&v) {
                    Ok(Friction::Coefficient(v))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Float(v), &self))
                }
            }
            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<Friction, E> {
                self.visit_f64(v as f64)
            }
            fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<Friction, E> {
                self.visit_f64(v as f64)
            }
            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<Friction, E> {
                if v == "infinite" {
                    Ok(Friction::Infinite)
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Str(v), &self))
                }
            }
        }
        d.deserialize_any(Visitor)
    }
}

/// Settings of a simulation. What is absent takes the default of its mode or of the sensor's pad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Solver.
    pub mode: Mode,
    /// Overrides the pad's constitutive law.
    pub law: Option<Law>,
    /// Overrides the pad's Young's modulus, MPa.
    pub youngs_modulus_mpa: Option<f64>,
    /// Overrides the pad's Poisson ratio.
    pub poisson_ratio: Option<f64>,
    /// Friction at the contact.
    pub friction: Friction,
    /// Error asked for, relative to depth (quasi-static mode).
    pub tolerance: f64,
    /// Particles along x, y and z (explicit modes; the paper's are 201, 201, 41, its predecessor's 101, 101, 21).
    pub particles: [usize; 3],
    /// Grid spacing, mm (explicit modes); absent: 33/256, scaled with a coarser lattice.
    pub dx_mm: Option<f64>,
    /// Time step, s (explicit modes); absent: 1e-4, scaled with dx.
    pub dt_s: Option<f64>,
    /// Speed of the indenter, mm/s (explicit modes; the predecessor's is 200).
    pub speed_mm_s: f64,
    /// Relative-rest threshold (impm).
    pub rest_threshold: f64,
    /// Most passes of the relative-rest loop (impm).
    pub rest_limit: u32,
    /// Smallest reference speed in the rest test, mm/s (impm).
    pub rest_floor_mm_s: f64,
    /// How the base is held (explicit modes).
    pub base: Base,
    /// Points of the surface lattice along x and y.
    pub surface: [usize; 2],
    /// What is not skipped, though no scene needs it. (Not written down where it is nothing.)
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<Skip>,
}

/// How the explicit modes hold the base of the pad.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The bottom three particle layers are pinned (the predecessor's way).
    BondedLayers,
    /// The z velocity of the lower half layer is zeroed (the paper's text).
    LowerHalfVz,
}

impl Settings {
    /// Whether something that is not needed is left undone.
    pub fn skips(&self, skip: Skip) -> bool {
        !self.without.contains(&skip)
    }

    /// Young's modulus of a pad under these settings, MPa, and the key that says so.
    pub fn youngs_modulus_of(&self, pad: &Pad) -> (&'static str, f64) {
        match self.youngs_modulus_mpa {
            Some(value) => ("elastomer.youngs_modulus_mpa", value),
            None => ("pad.material.youngs_modulus_mpa", pad.material.youngs_modulus_mpa),
        }
    }

    /// Poisson's ratio of a pad under these settings, and the key that says so.
    pub fn poisson_ratio_of(&self, pad: &Pad) -> (&'static str, f64) {
        match self.poisson_ratio {
            Some(value) => ("elastomer.poisson_ratio", value),
            None => ("pad.material.poisson_ratio", pad.material.poisson_ratio),
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            mode: Mode::QuasiStatic,
            law: None,
            youngs_modulus_mpa: None,
            poisson_ratio: None,
            friction: Friction::Infinite,
            tolerance: 0.01,
            particles: [201, 201, 41],
            dx_mm: None,
            dt_s: None,
            speed_mm_s: 200.0,
            rest_threshold: 0.5,
            rest_limit: 20,
            rest_floor_mm_s: 1.0,
            base: Base::BondedLayers,
            surface: [401, 401],
            without: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_some_modes_are_keys_and_modes_are_called_as_files_call_them() {
        let all = serde_json::to_value(Settings::default()).expect("plain values");
        for (key, modes) in OF_SOME_MODES {
            assert!(all.get(key).is_some() && !modes.is_empty(), "{key}");
        }
        for mode in [Mode::Mpm, Mode::Impm, Mode::QuasiStatic] {
            assert_eq!(serde_json::to_value(mode).expect("a word"), mode.name());
        }
    }

    #[test]
    fn friction_is_a_coefficient_up_to_one_or_infinite() {
        let read = |value: serde_json::Value| serde_json::from_value::<Friction>(value);
        assert_eq!(read(1.into()).ok(), Some(Friction::Coefficient(1.0)));
        assert_eq!(read(0.5.into()).ok(), Some(Friction::Coefficient(0.5)));
        assert_eq!(read("infinite".into()).ok(), Some(Friction::Infinite));
        for value in [serde_json::Value::from(1.5), (-0.1).into(), "none".into()] {
            let told = read(value).expect_err("out of range").to_string();
            assert!(told.contains("(0 to 1) or \"infinite\""), "{told}");
        }
    }
}
