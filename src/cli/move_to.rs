//! `twinrig move RIG --z 5`: go to one pose.
//!
//! Coordinates are those of the pad frame, relative to the nominal contact of the rig file; what is not
//! given stays. The rig is homed first when it does not know where it is and `--home` allows it. Every
//! limit is checked before a byte is sent, and a pose below the surface needs `--press`.

use super::at_bench::{AtBench, Wanted, show, whereabouts};
use super::exit::Exit;
use super::options::{self, RigOptions, Speed};
use super::screen;
use crate::motion::Coordinate;
use crate::pose::Pose;
use crate::session::bench::Feeds;

/// Move to a pose in the pad frame
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  twinrig move rig_configs/virtual.toml --z 5 --home\n  twinrig move rig_configs/virtual.toml --x 1.5 --theta 10 --home"
)]
pub struct Args {
    #[command(flatten)]
    pub rig: RigOptions,
    /// To the right in the image, mm
    #[arg(long, value_parser = options::quantity("mm"))]
    pub x: Option<f64>,
    /// Down in the image, mm
    #[arg(long, value_parser = options::quantity("mm"))]
    pub y: Option<f64>,
    /// Height of the tip above the nominal contact, mm
    #[arg(long, value_parser = options::quantity("mm"))]
    pub z: Option<f64>,
    /// Rotation, clockwise in the image, degrees
    #[arg(long, value_parser = options::quantity("degrees"))]
    pub theta: Option<f64>,
    /// Feed along lines, mm/s
    #[arg(long, default_value_t = 2.0, value_parser = options::quantity("mm/s"))]
    pub feed: f64,
    /// Feed of the rotation, deg/s
    #[arg(long, default_value_t = 10.0, value_parser = options::quantity("deg/s"))]
    pub turn: f64,
    /// Home first if the position is not known
    #[arg(long)]
    pub home: bool,
    /// Allow a height below the nominal contact
    #[arg(long)]
    pub press: bool,
    #[command(flatten)]
    pub speed: Speed,
    /// Print the pose reached as one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Below the nominal contact a pose needs `--press`.
const SURFACE_MM: f64 = 0.0;

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        if [self.x, self.y, self.z, self.theta].iter().all(Option::is_none) {
            screen::error("no coordinate was given; add at least one of --x, --y, --z, --theta");
            return Exit::Refused;
        }
        if self.z.is_some_and(|z| z < SURFACE_MM) && !self.press {
            screen::error(format_args!(
                "--z {} is below the nominal contact; the indenter would press: add --press if that is meant",
                self.z.unwrap_or_default()
            ));
            return Exit::Refused;
        }
        let wanted = Wanted::by_hand("move", &self.rig, &self.speed);
        let mut at = match AtBench::open(wanted).await {
            Ok(at) => at,
            Err(exit) => return exit,
        };
        let bench = &mut at.assembled.bench;
        let wanted = [
            (Coordinate::X, self.x),
            (Coordinate::Y, self.y),
            (Coordinate::Z, self.z),
            (Coordinate::Theta, self.theta),
        ];
        for (coordinate, value) in wanted.into_iter().filter_map(|(c, v)| Some((c, v?))) {
            if bench.map.role(coordinate).is_none() {
                let name = coordinate.name();
                screen::error(format_args!(
                    "--{name} {value:?}: this rig has no axis for {name}; leave it out, or say in [motion] of the rig file which axis moves it; nothing was moved"
                ));
                return Exit::Refused;
            }
            // NaN is in no range.
            let range = bench.range(coordinate);
            if let Some([low, high]) = range.filter(|[low, high]| !(*low..=*high).contains(&value)) {
                let name = coordinate.name();
                screen::error(format_args!(
                    "--{name} {value:?} is outside {low} to {high}, what the axis of this rig allows; choose a value inside; nothing was moved"
                ));
                return Exit::Refused;
            }
        }
        for (name, feed) in [("feed", self.feed), ("turn", self.turn)] {
            if !(feed > 0.0 && feed.is_finite()) {
                screen::error(format_args!("--{name} {feed:?} is no speed; give a number above 0"));
                return Exit::Refused;
            }
        }
        for coordinate in Coordinate::ALL {
            let given = wanted.iter().any(|(c, v)| *c == coordinate && v.is_some());
            let (name, feed) =
                if coordinate == Coordinate::Theta { ("turn", self.turn) } else { ("feed", self.feed) };
            let fastest = bench.limits(coordinate).map_or(f64::INFINITY, |l| l.max_feed);
            if given && feed > fastest {
                screen::error(format_args!(
                    "--{name} {feed:?} is outside 0 to {fastest}, what the axis of {} allows; choose a slower one; nothing was moved",
                    coordinate.name()
                ));
                return Exit::Refused;
            }
        }
        if !bench.is_referenced() && !self.home {
            screen::error(
                "the axes are not homed: every `twinrig move` is a session of its own, and nobody knows what happened before it; add --home (it homes first), or use `twinrig jog`; nothing was moved",
            );
            return Exit::Refused;
        }
        let feeds = Feeds { mm_s: self.feed, deg_s: self.turn };
        let given = |coordinate| wanted.iter().find(|(c, _)| *c == coordinate).and_then(|(_, v)| *v);
        if !bench.is_referenced()
            && let Err(e) = bench.refuse_from_home(given, feeds).await
        {
            screen::error(format_args!("{e}; nothing was moved"));
            return Exit::Refused;
        }
        let moved = async {
            if !bench.is_referenced() {
                bench.home().await?;
            }
            let (from, _) = bench.measured().await?;
            let to = Pose::new(
                self.x.unwrap_or(from.x_mm),
                self.y.unwrap_or(from.y_mm),
                self.z.unwrap_or(from.z_mm),
                self.theta.unwrap_or(from.theta_deg),
            );
            // After a stop, or where a home switch lies low: sideways would drag whatever is touched.
            if self.z.is_none() && to.z_mm < SURFACE_MM && !self.press {
                return Ok(Some(to.z_mm));
            }
            bench.go(&to, feeds).await?;
            show(&whereabouts(bench).await?, self.json);
            Ok(None)
        };
        match moved.await {
            Ok(Some(z_mm)) => {
                screen::error(format_args!(
                    "the tip is at z = {z_mm:.3} mm, below the nominal contact, and would be dragged sideways: lift it first (e.g. --z 5), or add --press if that is meant; it was not moved"
                ));
                Exit::Failed
            }
            Ok(None) => at.finish(Ok(())),
            Err(e) => at.finish(Err(e)),
        }
    }
}
