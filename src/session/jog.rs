//! Jogging: motion by hand, in steps, and for as long as a key is held.
//!
//! A touch of a key is one step, which is a move like any other: checked, carried out, measured. A key that is held
//! becomes a glide, a chain of short pieces of which each is sent only while the key's repeats arrive
//! ([`hold`]); when they do not, what was sent is cancelled, or has run out within a piece. So nothing moves that
//! nobody wants, whatever is lost: the release, the terminal, this program.
//!
//! Every motion ends inside the limits of its axis, and above the nominal contact unless pressing is allowed. Below
//! the surface nothing moves sideways: that is a slide of a plan, and of nothing else. Touches that come while a
//! step is under way are dropped, not queued.

pub mod hold;

use super::bench::{Bench, BenchError, Feeds, of_device};
use crate::device::link::StopHandle;
use crate::device::mover::{MoverError, Reference};
use crate::motion::Coordinate;
use crate::pose::Pose;
use crate::protocol::{Failure, StopKind};
pub use hold::{Direction, Hold, Touch};
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

/// What whoever jogs wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wish {
    /// A key of a direction, or the loss of all of them.
    Touch(Touch),
    /// Another step size and feed.
    Pace(Pace),
    /// Reference all axes.
    Home,
    /// Stop all devices now.
    Stop,
    /// Stop, and end.
    Quit,
}

/// Step sizes and feeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Length of a step, mm.
    pub step_mm: f64,
    /// Size of a turning step, degrees.
    pub step_deg: f64,
    /// Feeds; those of an axis that is slower are its own.
    pub feeds: Feeds,
}

/// What there is to see.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct View {
    /// Where the indenter is, as last measured at rest.
    pub pose: Option<Pose>,
    /// Whether every axis knows where it is.
    pub is_referenced: bool,
    /// What is going on.
    pub doing: Doing,
    /// What there is to say about the last wish.
    pub says: String,
}

/// What is going on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Doing {
    /// Nothing.
    #[default]
    Rest,
    /// One step.
    Step(Direction),
    /// A key is held.
    Glide(Direction),
    /// The axes are being referenced.
    Homing,
}

/// Length of a piece of a glide: what remains in motion when nobody goes on, where nothing can be cancelled.
const PIECE: Duration = Duration::from_millis(80);
/// The next piece is sent when this much of the one before is left.
const AHEAD: Duration = Duration::from_millis(50);
/// Asking a device where it is takes about half of this.
const TIME_TO_ASK: Duration = Duration::from_millis(20);
/// A repeat that comes at the last instant still counts.
const JUST_AFTER: Duration = Duration::from_millis(1);
/// How often a bench at rest is asked where it is.
const LOOK: Duration = Duration::from_millis(250);

/// Jogging on a bench.
pub struct Jog<'a> {
    bench: &'a mut Bench,
    pace: Pace,
    may_press: bool,
    hold: Hold,
    wishes: mpsc::UnboundedReceiver<Wish>,
    view: watch::Sender<View>,
    stops: Vec<StopHandle>,
    ending: bool,
}

impl<'a> Jog<'a> {
    /// Begins to jog; `may_press` allows heights below the nominal contact.
    pub fn new(
        bench: &'a mut Bench,
        pace: Pace,
        may_press: bool,
        hold: Hold,
        wishes: mpsc::UnboundedReceiver<Wish>,
        view: watch::Sender<View>,
    ) -> Jog<'a> {
        let stops = bench.movers.values().map(|m| m.stop_handle()).collect();
        Jog { bench, pace, may_press, hold, wishes, view, stops, ending: false }
    }

    /// Fulfils wishes until one is to quit, or nobody has any more. Everything is at rest afterwards.
    pub async fn run(mut self) -> Result<(), BenchError> {
        let mut looked: Option<Instant> = None;
        while !self.ending {
            self.bench.check_stop()?;
            if let Some(direction) = self.hold.gliding(Instant::now()) {
                let ended = self.glide(direction).await;
                self.judge(ended)?;
                looked = None;
            } else if let Some(direction) = self.hold.take_step() {
                self.doing(Doing::Step(direction));
                let ended = self.step(direction).await;
                self.judge(ended)?;
                // What was touched meanwhile was meant for then.
                self.hold.forget_step();
                looked = None;
            } else {
                self.doing(Doing::Rest);
                if looked.is_none_or(|at| at.elapsed() >= LOOK) {
                    self.look().await?;
                    looked = Some(Instant::now());
                }
                let stop = self.bench.stop.clone();
                tokio::select! {
                    wish = self.wishes.recv() => self.fulfil(wish).await?,
                    () = stop.raised_to(super::StopLevel::Controlled) => {}
                    () = tokio::time::sleep(LOOK) => {}
                }
            }
        }
        Ok(())
    }

    /// At rest, every wish is fulfilled at once.
    async fn fulfil(&mut self, wish: Option<Wish>) -> Result<(), BenchError> {
        if wish == Some(Wish::Home) {
            self.doing(Doing::Homing);
            self.say(String::new());
            let Jog { bench, wishes, hold, pace, stops, .. } = self;
            let (ended, ending) = attended(bench.home(), wishes, hold, pace, stops).await;
            self.ending |= ending;
            self.judge(ended)
        } else {
            self.ending |= take(wish, &mut self.hold, &mut self.pace, &self.stops);
            Ok(())
        }
    }

    /// One step, or as much of it as the limits leave.
    async fn step(&mut self, direction: Direction) -> Result<(), BenchError> {
        let from = self.measured().await?;
        let here = direction.coordinate.of(&from);
        let size = match direction.coordinate {
            Coordinate::Theta => self.pace.step_deg,
            _ => self.pace.step_mm,
        };
        let Some(to) = self.allowed(&from, direction, here + direction.sign() * size) else { return Ok(()) };
        let feeds = self.feeds(direction.coordinate);
        let mut pose = from;
        *of_mut(direction.coordinate, &mut pose) = to;
        let Jog { bench, wishes, hold, pace, stops, .. } = self;
        let (ended, ending) = attended(bench.go(&pose, feeds), wishes, hold, pace, stops).await;
        self.ending |= ending;
        ended
    }

    /// Moves while the key is held, piece after piece, and comes to rest.
    async fn glide(&mut self, direction: Direction) -> Result<(), BenchError> {
        let from = self.measured().await?;
        let role = match self.bench.map.role(direction.coordinate) {
            Some(role) => role.clone(),
            None => {
                self.hold.let_go();
                return Ok(());
            }
        };
        let end = if direction.positive { f64::INFINITY } else { f64::NEG_INFINITY };
        let here = direction.coordinate.of(&from);
        let Some(end) = self.allowed(&from, direction, end) else {
            self.hold.let_go();
            return Ok(());
        };
        self.doing(Doing::Glide(direction));
        let feeds = self.feeds(direction.coordinate);
        let feed = if direction.coordinate == Coordinate::Theta { feeds.deg_s } else { feeds.mm_s };
        let clock = self.bench.clock;

        // Pieces of bench time; the last of them has been carried out at `until`.
        let (mut at, mut until) = (here, Instant::now());
        let mut sent = Ok(());
        let others = self.bench.trusted_but(&role.device);
        while others.iter().all(|(_, other)| other.look().reference == Reference::Referenced)
            && at != end
            && self.hold.gliding(Instant::now()) == Some(direction)
        {
            let length = feed * PIECE.as_secs_f64() * clock.speed();
            let next = at + direction.sign() * length;
            at = if direction.positive { next.min(end) } else { next.max(end) };
            let mover = self.bench.movers.get_mut(&role.device).expect("a role names a device of the rig");
            let piece = mover.glide(&role.axis, role.to_axis(at), feed);
            let ending;
            (sent, ending) =
                attended(piece, &mut self.wishes, &mut self.hold, &mut self.pace, &self.stops).await;
            self.ending |= ending;
            if sent.is_err() {
                break;
            }
            until = until.max(Instant::now()) + PIECE;
            // Whoever watches sees where it is on the way, as long as that keeps no piece waiting.
            if (until - AHEAD).saturating_duration_since(Instant::now()) >= TIME_TO_ASK {
                let asked = mover.position();
                let (told, ending) =
                    attended(asked, &mut self.wishes, &mut self.hold, &mut self.pace, &self.stops).await;
                self.ending |= ending;
                if let Err(e) = told {
                    sent = Err(e);
                    break;
                }
            }
            // Listen until the next piece is due, or nobody wants one any more.
            while self.hold.gliding(Instant::now()) == Some(direction) {
                let due = until - AHEAD;
                if due <= Instant::now() {
                    break;
                }
                let silence = self.hold.heard_until().map_or(due, |at| at + JUST_AFTER);
                tokio::select! {
                    wish = self.wishes.recv() => {
                        self.ending |= take(wish, &mut self.hold, &mut self.pace, &self.stops);
                    }
                    () = tokio::time::sleep_until(due.min(silence)) => {}
                }
            }
        }
        let mover = self.bench.movers.get_mut(&role.device).expect("a role names a device of the rig");
        // Between two pieces a stop ends no request, and yet it is what happened.
        let stopped = mover.stop_handle().is_stopped();
        let rest = mover.end_glide();
        let (ended, ending) =
            attended(rest, &mut self.wishes, &mut self.hold, &mut self.pace, &self.stops).await;
        self.ending |= ending;
        if stopped && sent.is_ok() && ended.is_ok() {
            self.say_stopped();
        }
        if at == end {
            self.say(format!("{} is at its limit", direction.coordinate.name()));
            // A key that is still held does not begin again from here.
            self.hold.let_go();
        }
        sent.and(ended.map(drop)).map_err(of_device(&role.device))?;
        // What ended it may have been the loss of another device.
        self.bench.require_kept(&others)
    }

    /// A target inside the limits, or `None` (and words for it) when there is nothing to move.
    fn allowed(&mut self, from: &Pose, direction: Direction, target: f64) -> Option<f64> {
        let name = direction.coordinate.name();
        let Some([mut low, high]) = self.bench.range(direction.coordinate) else {
            self.say(format!("this rig has no axis for {name}"));
            return None;
        };
        if !self.bench.is_referenced() {
            self.say("the position is not known: press h to home".to_owned());
            return None;
        }
        let here = direction.coordinate.of(from);
        if direction.coordinate == Coordinate::Z {
            if !self.may_press {
                low = low.max(SURFACE_MM);
            }
        } else if from.z_mm < SURFACE_MM - AT_REST_MM {
            self.say("the indenter is below the surface: raise it before it moves sideways".to_owned());
            return None;
        }
        let to = target.clamp(low.min(here), high.max(here));
        let goes = (to - here) * direction.sign();
        if goes < SMALLEST {
            let floor = direction.coordinate == Coordinate::Z && low == SURFACE_MM && !direction.positive;
            self.say(match floor {
                true => "z is at the nominal contact; start with --press to go below".to_owned(),
                false => format!("{name} is at its limit"),
            });
            return None;
        }
        self.say(String::new());
        Some(to)
    }

    /// The feeds of the pace, as far as the axis goes along.
    fn feeds(&self, coordinate: Coordinate) -> Feeds {
        let Pace { feeds, .. } = self.pace;
        let fastest = self.bench.limits(coordinate).map_or(f64::INFINITY, |l| l.max_feed);
        Feeds { mm_s: feeds.mm_s.min(fastest), deg_s: feeds.deg_s.min(fastest) }
    }

    /// Where the indenter is. A device that keeps everybody waiting keeps no stop waiting.
    async fn measured(&mut self) -> Result<Pose, BenchError> {
        let Jog { bench, wishes, hold, pace, stops, .. } = self;
        let (measured, ending) = attended(bench.measured(), wishes, hold, pace, stops).await;
        self.ending |= ending;
        measured.map(|(pose, _)| pose)
    }

    async fn look(&mut self) -> Result<(), BenchError> {
        // The bench is at rest: a wish to home it is for after the look.
        let mut homes = false;
        let Jog { bench, wishes, hold, pace, stops, ending, .. } = self;
        let mut measuring = Box::pin(bench.measured());
        let measured = loop {
            tokio::select! {
                measured = &mut measuring => break measured,
                wish = wishes.recv(), if !*ending => {
                    homes |= wish == Some(Wish::Home);
                    *ending |= take(wish, hold, pace, stops);
                }
            }
        };
        drop(measuring);
        match measured {
            Ok((pose, _)) => {
                let is_referenced = self.bench.is_referenced();
                self.view.send_modify(|v| (v.pose, v.is_referenced) = (Some(pose), is_referenced));
            }
            Err(e) => self.judge(Err(e))?,
        }
        if homes && !self.ending { self.fulfil(Some(Wish::Home)).await } else { Ok(()) }
    }

    /// What a motion's end means: a refusal or a stop is told, a lost link ends the jogging.
    fn judge(&mut self, ended: Result<(), BenchError>) -> Result<(), BenchError> {
        let is_referenced = self.bench.is_referenced();
        self.view.send_modify(|v| v.is_referenced = is_referenced);
        let Err(error) = ended else { return Ok(()) };
        self.hold.let_go();
        match &error {
            BenchError::Stopped => Err(error),
            BenchError::Mover { source, .. }
                if matches!(**source, MoverError::Device(Failure::LinkLost(_))) =>
            {
                Err(error)
            }
            BenchError::Mover { source, .. } if source.is_stop() => {
                self.say_stopped();
                Ok(())
            }
            _ => {
                self.say(error.to_string());
                Ok(())
            }
        }
    }

    fn doing(&self, doing: Doing) {
        self.view.send_if_modified(|v| std::mem::replace(&mut v.doing, doing) != doing);
    }

    fn say_stopped(&self) {
        let home = if self.bench.is_referenced() { "" } else { "; press h to home" };
        self.say(format!("stopped{home}"));
    }

    fn say(&self, text: String) {
        self.view.send_modify(|v| v.says = text);
    }
}

/// The nominal contact.
const SURFACE_MM: f64 = 0.0;
/// What one step of the finest stage moves.
const AT_REST_MM: f64 = 1e-3;
/// Less is no motion.
const SMALLEST: f64 = 1e-3;

fn of_mut(coordinate: Coordinate, pose: &mut Pose) -> &mut f64 {
    match coordinate {
        Coordinate::X => &mut pose.x_mm,
        Coordinate::Y => &mut pose.y_mm,
        Coordinate::Z => &mut pose.z_mm,
        Coordinate::Theta => &mut pose.theta_deg,
    }
}

/// Takes in a wish that asks for no motion of its own; answers whether the jogging ends.
fn take(wish: Option<Wish>, hold: &mut Hold, pace: &mut Pace, stops: &[StopHandle]) -> bool {
    match wish {
        Some(Wish::Touch(touch)) => hold.take(touch, Instant::now()),
        Some(Wish::Pace(new)) => *pace = new,
        // Homing is asked for at rest.
        Some(Wish::Home) => {}
        Some(Wish::Stop) => {
            hold.let_go();
            stops.iter().for_each(|s| _ = s.stop(StopKind::Controlled));
        }
        Some(Wish::Quit) | None => {
            hold.let_go();
            stops.iter().for_each(|s| _ = s.stop(StopKind::Controlled));
            return true;
        }
    }
    false
}

/// Waits for the end of a motion and listens meanwhile. Answers how it ended, and whether all is to end.
async fn attended<T>(
    motion: impl Future<Output = T>,
    wishes: &mut mpsc::UnboundedReceiver<Wish>,
    hold: &mut Hold,
    pace: &mut Pace,
    stops: &[StopHandle],
) -> (T, bool) {
    let mut ending = false;
    let mut motion = std::pin::pin!(motion);
    loop {
        tokio::select! {
            ended = &mut motion => return (ended, ending),
            wish = wishes.recv(), if !ending => ending |= take(wish, hold, pace, stops),
        }
    }
}
