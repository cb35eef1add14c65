//! `twinrig drive RIG PLAN`: the motion alone.
//!
//! Homes the rig and visits every waypoint of the plan as `collect` would, with the same checks and the
//! same order of moves, but takes no picture, finds no contact and stores nothing: heights are relative to
//! the nominal contact of the rig file.

use super::at_bench::{AtBench, Wanted};
use super::exit::Exit;
use super::options::{RigAndPlan, Speed};
use super::screen;
use crate::config::PlanSetup;
use crate::pose::Pose;
use crate::session::perform::Operator;
use crate::session::{Bench, BenchError, SessionSettings, StopLevel};

/// Perform the motion of a plan, without camera and dataset
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  twinrig drive rig_configs/virtual.toml rig_configs/plans/small.toml --speed 10"
)]
pub struct Args {
    #[command(flatten)]
    pub files: RigAndPlan,
    #[command(flatten)]
    pub speed: Speed,
    /// Do not ask for confirmation
    #[arg(long)]
    pub yes: bool,
    /// Print the positions reached as one JSON document
    #[arg(long)]
    pub json: bool,
}

impl Args {
    /// Runs the subcommand.
    pub async fn run(self) -> Exit {
        let wanted = Wanted {
            command: "drive",
            rig: &self.files.rig,
            plan: Some(&self.files.plan),
            set: &self.files.overrides.set,
            speed: self.speed.speed,
        };
        let mut at = match AtBench::open(wanted).await {
            Ok(at) => at,
            Err(exit) => return exit,
        };
        let Some(plan) = at.setup.plan.clone() else { return Exit::Refused };
        if !at.setup.rig.is_virtual() && !self.yes && !console::user_attended() {
            screen::error(
                "this is a real bench and nobody is at the terminal; mount the indenters and add --yes",
            );
            return Exit::Refused;
        }
        let mut operator = super::collect::operator(&plan, at.assembled.world.clone(), self.yes);
        let settings = crate::assemble::session_settings(&at.setup, &plan);
        let mut reached = Vec::new();
        let driven = drive(&mut at.assembled.bench, &plan, &settings, &mut operator, &mut reached).await;
        if driven.is_err() {
            at.assembled.bench.stop.raise(StopLevel::Controlled);
        }
        let mut lifted = Ok(());
        if at.assembled.bench.may_retract() {
            lifted = at.assembled.bench.lift(settings.clearance_mm, settings.travel.mm_s).await;
        }
        if self.json {
            screen::json(&reached);
        } else {
            screen::result(format_args!(
                "{} of {} waypoints reached",
                reached.len(),
                plan.trajectory.waypoints.len()
            ));
        }
        at.finish(driven.and(lifted))
    }
}

/// One pose reached.
#[derive(Debug, serde::Serialize)]
struct Reached {
    waypoint: usize,
    commanded: Pose,
    measured: Pose,
}

async fn drive(
    bench: &mut Bench,
    plan: &PlanSetup,
    settings: &SessionSettings,
    operator: &mut Operator,
    reached: &mut Vec<Reached>,
) -> Result<(), BenchError> {
    if !bench.is_referenced() {
        bench.home().await?;
    }
    bench.lift(settings.clearance_mm, settings.travel.mm_s).await?;
    let bars = screen::bars();
    let bar = screen::bar(&bars, "waypoints", plan.trajectory.waypoints.len() as u64);
    let mut mounted = "";
    for (index, waypoint) in plan.trajectory.waypoints.iter().enumerate() {
        let indenter = &plan.trajectory.episodes[waypoint.episode as usize].indenter;
        if indenter != mounted {
            if !operator(indenter).await {
                return Err(BenchError::Stopped);
            }
            mounted = indenter;
            bar.set_message(indenter.clone());
        }
        bench.go(&waypoint.pose, settings.feeds(waypoint)).await?;
        let (measured, _) = bench.measured().await?;
        reached.push(Reached { waypoint: index, commanded: waypoint.pose, measured });
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}
