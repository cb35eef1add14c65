//! The virtual camera: sees the virtual world, with the timing of a real one.
//!
//! It runs freely: frame k is exposed over [start + k period, + exposure] of bench time and arrives after
//! its readout. What moves during an exposure is blurred, because the picture is the mean of several
//! instants in it. A frame is drawn only when somebody waits for it; that those in between are never drawn
//! cannot be noticed from outside. Time is the bench's clock, never the wall's.
//!
//! It also remembers how far the gel is carried along ([`Drag`]): between two frames it follows the
//! indenter in steps, since the world keeps the recent past.
//!
//! [`CameraFaults`] makes it fail as real ones do: silent, dropping, serving old buffers first, unplugged.

use super::picture::look::SensorLook;
use super::picture::noise::SensorNoise;
use super::picture::{Drag, Picture};
use super::world::{World, WorldScene};
use crate::clock::{Clock, Timestamp};
use crate::device::camera::settings::CameraSettings;
use crate::device::camera::{Camera, CameraDescription, CameraError, FrameFuture};
use crate::frame::{Frame, FrameStamp};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use tokio::task::JoinHandle;

/// Frame rate where the rig file asks for none, 1/s.
const DEFAULT_FPS: f64 = 30.0;
/// From the end of an exposure to the frame's arrival.
const READOUT: Duration = Duration::from_millis(4);
/// Frames that wait for a taker who is late, as with the camera sources of a kernel.
const BUFFERED: u32 = 3;
/// Instants of an exposure that a blurred frame is the mean of.
const BLUR_SAMPLES: i64 = 4;
/// A pose that changes by less than this during an exposure is not blurred, mm and degrees.
const STILL: f64 = 1e-3;
/// The indenter is followed in steps of this length at least, and in so many at most.
const FOLLOW_STEP: Duration = Duration::from_millis(20);
const FOLLOW_STEPS: u32 = 400;

/// What a camera can do wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFault {
    /// No frame begins for so long.
    Stall(Duration),
    /// The next so many frames are lost on the way; sequence numbers go on.
    Drop(u32),
    /// So many old buffers, exposed before they were asked for, are offered before fresh ones.
    Stale(u32),
    /// Gone until [`CameraFaults::plug_in`].
    Unplug,
}

/// Spoils a virtual camera; clones are handles to the same one.
#[derive(Debug, Clone, Default)]
pub struct CameraFaults(Arc<Mutex<FaultState>>);

#[derive(Debug, Default)]
struct FaultState {
    /// Faults to come: after how many served frames, and which.
    planned: Vec<(u32, CameraFault)>,
    served: u32,
    stall: Option<Duration>,
    drop: u32,
    stale: u32,
    unplugged: bool,
    stale_refused: u32,
}

impl CameraFaults {
    /// Happens now.
    pub fn inject(&self, fault: CameraFault) {
        self.state().strike(fault);
    }

    /// Happens when so many frames have been served.
    pub fn after_frames(&self, served: u32, fault: CameraFault) {
        let mut state = self.state();
        if state.served >= served {
            state.strike(fault);
        } else {
            state.planned.push((served, fault));
        }
    }

    /// Ends [`CameraFault::Unplug`].
    pub fn plug_in(&self) {
        self.state().unplugged = false;
    }

    /// Frames served so far.
    pub fn served(&self) -> u32 {
        self.state().served
    }

    /// Old buffers that were offered and, rightly, not taken.
    pub fn stale_refused(&self) -> u32 {
        self.state().stale_refused
    }

    fn state(&self) -> MutexGuard<'_, FaultState> {
        // Every change is one assignment: a panic elsewhere leaves nothing half done.
        self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl FaultState {
    fn strike(&mut self, fault: CameraFault) {
        match fault {
            CameraFault::Stall(length) => self.stall = Some(length),
            CameraFault::Drop(frames) => self.drop += frames,
            CameraFault::Stale(frames) => self.stale += frames,
            CameraFault::Unplug => self.unplugged = true,
        }
    }

    fn count_served(&mut self) {
        self.served += 1;
        let due = self.planned.extract_if(.., |(after, _)| *after <= self.served).collect::<Vec<_>>();
        for (_, fault) in due {
            self.strike(fault);
        }
    }
}

/// The camera of the virtual bench.
pub struct VirtualCamera {
    description: CameraDescription,
    clock: Clock,
    world: World,
    studio: Arc<Studio>,
    faults: CameraFaults,
    start: Timestamp,
    period: Duration,
    exposure: Duration,
    /// No frame begins before this instant.
    silent_until: Timestamp,
    next_sequence: u32,
    drag: Drag,
    seen: Option<(Timestamp, WorldScene)>,
}

/// What draws, shared with the thread that does it.
struct Studio {
    picture: Picture,
    noise: SensorNoise,
    /// The last picture of a scene at rest, before noise: the next frame very often sees the same.
    last: Mutex<Option<(WorldScene, Drag, Arc<Vec<f32>>)>>,
}

impl Studio {
    /// The scene without noise.
    fn draw(&self, scene: &WorldScene, drag: &Drag) -> Arc<Vec<f32>> {
        let last = || self.last.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some((seen, carried, picture)) = &*last()
            && seen.is(scene)
            && carried == drag
        {
            return picture.clone();
        }
        let picture = Arc::new(self.picture.draw(&scene.pose, scene.indenter.as_ref(), drag));
        *last() = Some((scene.clone(), *drag, picture.clone()));
        picture
    }
}

impl VirtualCamera {
    /// A camera with this look that sees `world` on `clock`. Size and scale are those of the look.
    pub fn new(settings: &CameraSettings, look: SensorLook, world: World, clock: Clock) -> Self {
        let made_up = settings.made_up.clone().unwrap_or_default();
        let period = Duration::from_secs_f64(1.0 / settings.fps.unwrap_or(DEFAULT_FPS));
        let exposure = Duration::from_secs_f64(made_up.exposure_ms * 1e-3).min(period);
        let description = CameraDescription {
            source: "virtual".into(),
            name: format!("virtual camera, seed {}", made_up.seed),
            width: look.width,
            height: look.height,
            fourcc: "RGB3".into(),
            frames_per_second: 1.0 / period.as_secs_f64(),
            controls: vec![("exposure_absolute".into(), (exposure.as_micros() / 100) as i64)],
            is_virtual: true,
        };
        Self {
            description,
            world,
            studio: Arc::new(Studio {
                picture: Picture::new(look, made_up.shift_px, made_up.seed),
                noise: SensorNoise::new(&made_up),
                last: Mutex::default(),
            }),
            faults: CameraFaults::default(),
            start: clock.now(),
            period,
            exposure,
            silent_until: Timestamp(i64::MIN),
            next_sequence: 0,
            drag: Drag::default(),
            seen: None,
            clock,
        }
    }

    /// The handle that makes this camera fail.
    pub fn faults(&self) -> CameraFaults {
        self.faults.clone()
    }

    fn begins(&self, sequence: u32) -> Timestamp {
        self.start.after(self.period * sequence)
    }

    /// The first frame that begins at `t` or later.
    fn first_from(&self, t: Timestamp) -> u32 {
        let periods = t.since(self.start).as_nanos().div_ceil(self.period.as_nanos());
        u32::try_from(periods).unwrap_or(u32::MAX)
    }

    async fn next_after(&mut self, t: Timestamp, within: Duration) -> Result<Frame, CameraError> {
        let asked = self.clock.now();
        let deadline = asked.after(within);
        let mut dropped = 0;
        loop {
            if self.faults.state().unplugged {
                let why = "No such device (os error 19)".to_owned();
                return Err(CameraError::Lost { camera: self.description.name.clone(), why });
            }
            if let Some(length) = self.faults.state().stall.take() {
                self.silent_until = self.clock.now().after(length);
            }
            self.refuse_stale(t);

            // Frames that arrived before the call wait in the driver's buffers, the last few of them.
            let oldest = asked.before(self.exposure + READOUT + self.period * BUFFERED);
            let earliest = t.max(oldest).max(self.silent_until).max(self.start);
            let sequence = self.first_from(earliest).max(self.next_sequence);
            let begins = self.begins(sequence);
            let arrives = begins.after(self.exposure + READOUT);
            if arrives > deadline {
                self.clock.sleep_until(deadline).await;
                let waited = self.clock.now().since(asked);
                return Err(CameraError::Stalled { camera: self.description.name.clone(), waited });
            }
            // What happened during the exposure is known at its end; a real sensor's picture is read out from then on.
            self.clock.sleep_until(begins.after(self.exposure)).await;
            let drawing = self.draw(begins, sequence);
            self.clock.sleep_until(arrives).await;
            self.next_sequence = sequence + 1;

            // Whatever was injected during the wait strikes this very frame.
            let spoiled = {
                let mut state = self.faults.state();
                let lost = state.drop > 0;
                state.drop = state.drop.saturating_sub(1);
                lost || state.unplugged || state.stall.is_some()
            };
            if spoiled {
                dropped += 1;
                continue;
            }
            let rgb = match drawing.await {
                Ok(rgb) => rgb,
                Err(panic) => std::panic::resume_unwind(panic.into_panic()),
            };
            self.faults.state().count_served();
            return Ok(self.frame(rgb, sequence, begins, dropped));
        }
    }

    /// Old buffers are told by their stamps, as with a real driver; they cost no time.
    fn refuse_stale(&self, t: Timestamp) {
        let mut state = self.faults.state();
        while state.stale > 0 {
            let old = self.clock.now().before(self.period * (state.stale + 1));
            state.stale -= 1;
            if old < t {
                state.stale_refused += 1;
            }
        }
    }

    /// Begins to draw what an exposure has seen.
    fn draw(&mut self, begins: Timestamp, sequence: u32) -> JoinHandle<Vec<u8>> {
        // 1. The instants seen: one if all is still, else several spread over the exposure.
        let ends = begins.after(self.exposure);
        let (first, last) = (self.world.scene_at(begins), self.world.scene_at(ends));
        let still = first.pose.distance_mm(&last.pose) < STILL
            && (first.pose.theta_deg - last.pose.theta_deg).abs() < STILL;
        let samples = if still { 1 } else { BLUR_SAMPLES };
        let step = self.exposure.as_nanos() as i64 / samples;
        let mut scenes = Vec::new();
        for i in 0..samples {
            let at = Timestamp(begins.0 + step * i + step / 2);
            scenes.push((self.follow(at), self.drag));
        }

        // 2. Draw and expose, away from the threads that talk to devices.
        let studio = Arc::clone(&self.studio);
        let draw = move || {
            let mut pictures = scenes.iter().map(|(scene, drag)| studio.draw(scene, drag));
            let first = pictures.next().expect("an exposure has at least one instant");
            if samples == 1 {
                return studio.noise.expose(&first, sequence);
            }
            let mut mean = first.to_vec();
            for other in pictures {
                mean.iter_mut().zip(other.iter()).for_each(|(m, o)| *m += o);
            }
            mean.iter_mut().for_each(|m| *m /= samples as f32);
            studio.noise.expose(&mean, sequence)
        };
        tokio::task::spawn_blocking(draw)
    }

    fn frame(&self, rgb: Vec<u8>, sequence: u32, begins: Timestamp, dropped_before: u32) -> Frame {
        let stamp = FrameStamp {
            exposed_at: begins,
            exposure: Some(self.exposure),
            sequence,
            dropped_before,
            flags: 0,
            fourcc: self.description.fourcc.clone(),
            averaged: 1,
        };
        let (width, height) = (self.description.width, self.description.height);
        Frame { width, height, rgb, stamp }
    }

    /// The scene at `to`, after following the indenter there since the last look.
    fn follow(&mut self, to: Timestamp) -> WorldScene {
        let now = self.world.scene_at(to);
        if let Some((from, mut before)) = self.seen.take() {
            let steps = (to.since(from).as_nanos() / FOLLOW_STEP.as_nanos()) as u32;
            let steps = steps.clamp(1, FOLLOW_STEPS);
            for i in 1..=steps {
                let at = from.0 + (to.0 - from.0) / i64::from(steps) * i64::from(i);
                let scene = self.world.scene_at(Timestamp(at));
                self.drag = self.drag.followed(&before.pose, &scene.pose);
                before = scene;
            }
        }
        if now.indenter.is_none() {
            self.drag = Drag::default();
        }
        self.seen = Some((to, now.clone()));
        now
    }
}

impl Camera for VirtualCamera {
    fn description(&self) -> &CameraDescription {
        &self.description
    }

    fn frame_after(&mut self, t: Timestamp, within: Duration) -> FrameFuture<'_> {
        Box::pin(self.next_after(t, within))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::camera::settings::CameraSource;
    use crate::indenter::{self, Indenter, spec::IndenterSpec};
    use crate::motion::{AxisRole, PoseMap, Profile};

    const WITHIN: Duration = Duration::from_secs(2);

    fn ball() -> Arc<dyn Indenter> {
        let text = "shape = { kind = \"dome\", radius_mm = 4.0, diameter_mm = 8.0 }";
        let spec: IndenterSpec = toml::from_str(text).expect("spec");
        indenter::from_spec("ball", &spec, None).expect("indenter")
    }

    /// An arm whose position is the height of the indenter.
    fn bench(speed: f64) -> (VirtualCamera, World, Clock) {
        let role = AxisRole { device: "arm".into(), axis: "z".into(), sign: 1.0, origin: 0.0 };
        let world = World::new(PoseMap { x: None, y: None, z: role, theta: None }, 0.0);
        world.mount(Some(ball()));
        world.place("arm", "z", 5.0);
        let clock = Clock::with_speed(speed);
        let text = "source = \"virtual\"\nfps = 25\nvirtual = { read_noise = 0, shot_noise = 0 }";
        let settings: CameraSettings = toml::from_str(text).expect("settings");
        assert_eq!(settings.source, CameraSource::Virtual);
        let look = SensorLook::white_skin(96, 72, 0.2);
        (VirtualCamera::new(&settings, look, world.clone(), clock), world, clock)
    }

    fn green_in_the_middle(frame: &Frame) -> u8 {
        frame.pixel(frame.width / 2, frame.height / 2)[1]
    }

    #[tokio::test(start_paused = true)]
    async fn the_frame_was_exposed_after_the_instant_and_shows_what_was_there() {
        let (mut camera, world, clock) = bench(1.0);
        let before = camera.frame_after(clock.now(), WITHIN).await.unwrap();
        clock.sleep(Duration::from_millis(17)).await;
        let moved = clock.now();
        world.place("arm", "z", -1.0);
        let after = camera.frame_after(moved, WITHIN).await.unwrap();
        assert!(before.stamp.exposed_at < moved && after.stamp.exposed_at >= moved);
        assert!(green_in_the_middle(&after) + 20 < green_in_the_middle(&before), "the press is seen");
        // It arrives when the exposure is over and read out, not before.
        let ends = after.stamp.exposed_at.after(Duration::from_millis(15));
        assert!(clock.now() >= ends && clock.now().since(ends) < Duration::from_millis(6));
        assert_eq!(after.stamp.sequence, before.stamp.sequence + 1);
    }

    #[tokio::test(start_paused = true)]
    async fn an_instant_to_come_is_waited_for_on_the_clock() {
        let (mut camera, _, clock) = bench(50.0);
        let t = clock.now().after(Duration::from_secs(7));
        let frame = camera.frame_after(t, Duration::from_secs(9)).await.unwrap();
        assert!(frame.stamp.exposed_at >= t && frame.stamp.exposed_at < t.after(Duration::from_millis(41)));
        assert!(clock.now() >= t);
    }

    #[tokio::test(start_paused = true)]
    async fn what_moves_during_the_exposure_is_blurred() {
        let (mut camera, world, clock) = bench(1.0);
        world.place("arm", "z", -0.2);
        let up = camera.frame_after(clock.now(), WITHIN).await.unwrap();
        // Down by 1.2 mm at 80 mm/s: exactly the 15 ms of an exposure, which begins with the next frame.
        let next = up.stamp.exposed_at.after(Duration::from_millis(40));
        world.follow("arm", "z", next, Profile::new(-0.2, -1.4, 80.0, 1e6));
        let moving = camera.frame_after(next, WITHIN).await.unwrap();
        assert_eq!(moving.stamp.exposed_at, next);
        let down = camera.frame_after(clock.now(), WITHIN).await.unwrap();
        let [up, moving, down] = [up, moving, down].map(|f| f64::from(green_in_the_middle(&f)));
        let middle = 0.5 * (up + down);
        assert!((moving - middle).abs() < 0.25 * (up - down), "{up} {moving} {down}");
    }

    #[tokio::test(start_paused = true)]
    async fn faults_are_those_of_real_cameras() {
        let (mut camera, _, clock) = bench(1.0);
        let faults = camera.faults();
        let first = camera.frame_after(clock.now(), WITHIN).await.unwrap();

        faults.inject(CameraFault::Drop(3));
        let frame = camera.frame_after(clock.now(), WITHIN).await.unwrap();
        assert_eq!(frame.stamp.dropped_before, 3);
        assert_eq!(frame.stamp.sequence, first.stamp.sequence + 4);

        faults.inject(CameraFault::Stale(5));
        let t = clock.now();
        let frame = camera.frame_after(t, WITHIN).await.unwrap();
        assert!(frame.stamp.exposed_at >= t);
        assert_eq!(faults.stale_refused(), 5);

        faults.inject(CameraFault::Stall(Duration::from_secs(3)));
        let t = clock.now();
        let stalled = camera.frame_after(t, WITHIN).await;
        assert!(matches!(stalled, Err(CameraError::Stalled { .. })), "{stalled:?}");
        assert_eq!(clock.now().since(t).as_secs_f64().round(), 2.0);
        assert!(camera.frame_after(t, WITHIN).await.is_ok(), "it comes back");

        faults.after_frames(faults.served() + 1, CameraFault::Unplug);
        assert!(camera.frame_after(clock.now(), WITHIN).await.is_ok());
        let lost = camera.frame_after(clock.now(), WITHIN).await;
        assert!(matches!(lost, Err(CameraError::Lost { .. })), "{lost:?}");
        faults.plug_in();
        assert!(camera.frame_after(clock.now(), WITHIN).await.is_ok());
    }

    #[tokio::test(start_paused = true)]
    async fn the_same_seed_sees_the_same() {
        let mut pictures = Vec::new();
        for _ in 0..2 {
            let (mut camera, world, clock) = bench(1.0);
            world.place("arm", "z", -0.7);
            pictures.push(camera.frame_after(clock.now(), WITHIN).await.unwrap().rgb);
        }
        assert_eq!(pictures[0], pictures[1]);
    }
}
