//! Other people's figures: `peers.csv`, built in, each with where it comes from.
//!
//! They were taken on another machine than ours (2 cores of a Zen 5, single precision, no GPU), so a ratio is meant to a
//! factor of two, not to a per cent.

use serde::Serialize;

/// A figure of another program. What is absent was not stated.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Peer {
    /// Program.
    pub name: String,
    /// What it did.
    pub work: String,
    /// With how many particles.
    pub particles: Option<f64>,
    /// Throughput.
    pub particle_steps_per_s: Option<f64>,
    /// Time to solution, s.
    pub seconds: Option<f64>,
    /// Error of the surface, um, or the lower end of its range.
    pub error_low_um: Option<f64>,
    /// The upper end.
    pub error_high_um: Option<f64>,
    /// Where the figure comes from.
    pub source: String,
}

/// All of them.
pub fn all() -> Vec<Peer> {
    include_str!("peers.csv").lines().skip(1).map(read).collect()
}

fn read(line: &str) -> Peer {
    // The last column may hold commas of its own; the others do not.
    let fields: Vec<&str> = line.splitn(8, ',').collect();
    let number = |n: usize| match fields[n] {
        "" => None,
        text => Some(text.parse().expect("the built-in table holds numbers")),
    };
    Peer {
        name: fields[0].into(),
        work: fields[1].into(),
        particles: number(2),
        particle_steps_per_s: number(3),
        seconds: number(4),
        error_low_um: number(5),
        error_high_um: number(6),
        source: fields[7].into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_read_and_says_where_it_comes_from() {
        let peers = all();
        assert_eq!(peers.len(), 14);
        let says = |p: &Peer| p.seconds.is_some() || p.particle_steps_per_s.is_some();
        assert!(peers.iter().all(|p| !p.source.is_empty() && says(p)));
        let best =
            peers.iter().filter(|p| p.name.starts_with("sparkl")).filter_map(|p| p.particle_steps_per_s);
        assert_eq!(best.fold(0.0, f64::max), 3.84e6);
    }
}
