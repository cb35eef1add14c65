//! The process that is stopped, again and again.

use super::Args;
use crate::cli::bench::load::{Load, cpu_seconds};
use crate::cli::exit::Exit;
use crate::cli::{screen, signals};
use crate::clock::Clock;
use crate::device::link::StopHandle;
use crate::device::mover::{Mover, Reference};
use crate::device::port;
use crate::protocol::StopKind;
use crate::session::{StopLevel, StopSwitch};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Emulated time passes faster, so that the bench is homed again soon after a stop; stopping takes no emulated time.
pub(super) const SPEED: f64 = 20.0;

/// What the witness is told, a line each; it answers with a line when it wants the next round.
pub(super) const READY: &str = "ready";

/// Keeps axes moving, stops at every signal, and begins anew, until it is killed.
pub(super) async fn run(args: &Args) -> Exit {
    match serve(args).await {
        Ok(()) => Exit::Done,
        Err(e) => {
            screen::error(e);
            Exit::Failed
        }
    }
}

async fn serve(args: &Args) -> Result<(), Box<dyn std::error::Error>> {
    let setup = crate::config::load(&args.rig, Some(&args.plan), &[]).map_err(|e| e.to_string())?;
    let clock = Clock::with_speed(SPEED);
    let mut stops = Vec::new();
    let mut moves = Vec::new();
    for (path, settings) in args.victim.iter().zip(super::witness::devices(&setup)) {
        let spec = setup.protocols[&settings.protocol].clone();
        let mover = port::connect(path, spec, settings, clock, None).await?;
        stops.push(mover.stop_handle());
        let count = Arc::new(AtomicU64::new(0));
        moves.push(count.clone());
        tokio::spawn(keep_moving(mover, clock, count));
    }

    // One switch for each round, raised by the thread of signals as in any session.
    let arm = || {
        let switch = StopSwitch::new();
        for handle in &stops {
            let handle: StopHandle = handle.clone();
            let kind = |level| {
                if level == StopLevel::Emergency { StopKind::Emergency } else { StopKind::Controlled }
            };
            switch.register("port", Box::new(move |level| _ = handle.stop(kind(level))));
        }
        switch
    };
    let current = Arc::new(Mutex::new(StopSwitch::new()));
    let (stopped, mut stamps) = tokio::sync::mpsc::unbounded_channel();
    let raised = current.clone();
    signals::on_each(move |_| {
        raised.lock().unwrap_or_else(PoisonError::into_inner).raise(StopLevel::Controlled);
        _ = stopped.send(Clock::real_time().now());
    })?;

    let load = match args.idle {
        true => None,
        false => Some(Load::start(&setup, &args.scratch)?),
    };
    let (begun, cpu) = (Instant::now(), cpu_seconds());
    loop {
        let switch = arm();
        *current.lock().unwrap_or_else(PoisonError::into_inner) = switch;
        // The last port may be dead; the others must be in motion again.
        let before: Vec<u64> = moves.iter().map(|m| m.load(Ordering::Relaxed)).collect();
        let is_moving = |(now, before): (&Arc<AtomicU64>, &u64)| now.load(Ordering::Relaxed) > before + 1;
        while !moves.iter().zip(&before).take(moves.len() - 1).all(is_moving) {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        screen::result(READY);
        let Some(stamp) = stamps.recv().await else { break };
        let cores = (cpu_seconds() - cpu) / begun.elapsed().as_secs_f64();
        screen::result(format_args!("{} {cores}", stamp.0));
        let asked = tokio::task::spawn_blocking(|| std::io::stdin().read_line(&mut String::new()));
        if asked.await?? == 0 {
            break;
        }
    }
    drop(load);
    Ok(())
}

/// Back and forth, whatever happens, counting the moves that ended well.
async fn keep_moving(mut mover: Mover, clock: Clock, count: Arc<AtomicU64>) {
    let Some((axis, settings)) = mover.settings().axes.iter().next().map(|(n, a)| (n.clone(), a.clone()))
    else {
        return;
    };
    let middle = (settings.min + settings.max) / 2.0;
    // A tenth of a second of this machine's time each.
    let length = (settings.max_feed * 0.1 * SPEED).min((settings.max - settings.min) / 4.0);
    let mut side = 1.0;
    loop {
        if mover.reference() != Reference::Referenced {
            if let Err(e) = mover.home().await {
                tracing::debug!("homing: {e}");
                clock.sleep(Duration::from_millis(500)).await;
            }
            continue;
        }
        side = -side;
        match mover.move_to(&[(axis.as_str(), middle + side * length)], settings.max_feed).await {
            Ok(_) => _ = count.fetch_add(1, Ordering::Relaxed),
            Err(e) => tracing::debug!("moving: {e}"),
        }
    }
}
