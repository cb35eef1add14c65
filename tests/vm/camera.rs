//! The camera sources against a real kernel: Linux's own test camera, vivid.
//!
//! Run by `tests/vm/run`, which brings a virtual machine with that camera; `cargo test` alone leaves these out.
//! vivid presses its own fault buttons: they are controls, known by number.

use std::sync::{Mutex, MutexGuard};
use std::time::Duration;
use twinrig::clock::{Clock, Timestamp};
use twinrig::device::camera::settings::CameraSettings;
use twinrig::device::camera::{Camera, CameraError, list, nokhwa::NokhwaCamera, open, v4l::V4lCamera};
use twinrig::frame::Frame;
use v4l::control::{Control, Value};

const NODE: &str = "/dev/video0";
const WITHIN: Duration = Duration::from_secs(10);

const BRIGHTNESS: u32 = 0x0098_0900;
const GAIN_AUTOMATIC: u32 = 0x0098_0912;
// vivid's own controls.
const TEST_PATTERN: u32 = 0x00f0_f000;
const WRAP_TIMESTAMP: u32 = 0x00f0_f027;
const PERCENTAGE_DROPPED: u32 = 0x00f0_f040;
const DISCONNECT: u32 = 0x00f0_f041;
const BUFFER_ERROR: u32 = 0x00f0_f042;
const REFUSE_BUFFERS: u32 = 0x00f0_f043;
const REFUSE_QUEUEING: u32 = 0x00f0_f044;
const REFUSE_STREAMING: u32 = 0x00f0_f045;
const FATAL_ERROR: u32 = 0x00f0_f046;
// Its test patterns.
const COLOUR_BARS: i64 = 0;
const BLACK: i64 = 5;
const WHITE: i64 = 6;

/// There is one camera: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static CAMERA: Mutex<()> = Mutex::new(());
    let guard = CAMERA.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    assert!(std::path::Path::new(NODE).exists(), "no test camera at {NODE}: run tests/vm/run");
    press(PERCENTAGE_DROPPED, 0);
    press(WRAP_TIMESTAMP, 0);
    press(TEST_PATTERN, COLOUR_BARS);
    press(BRIGHTNESS, 128);
    guard
}

/// Sets a control from outside, as another program would.
fn press(id: u32, value: i64) {
    let device = v4l::Device::with_path(NODE).expect("the test camera opens");
    device.set_control(Control { id, value: Value::Integer(value) }).expect("vivid has this control");
}

fn settings(more: &str) -> CameraSettings {
    toml::from_str(&format!("source = \"v4l\"\ndevice = \"{NODE}\"\n{more}")).expect("settings")
}

fn now() -> Timestamp {
    Clock::real_time().now()
}

async fn fresh(camera: &mut dyn Camera) -> Frame {
    let t = now();
    let frame = camera.frame_after(t, WITHIN).await.expect("a frame");
    assert!(frame.stamp.exposed_at >= t, "exposed after it was asked for");
    frame
}

/// A pixel below vivid's text overlay.
fn below_the_text(frame: &Frame, x: u32) -> [u8; 3] {
    frame.pixel(x, frame.height * 7 / 8)
}

#[test]
fn the_camera_is_listed_with_modes_and_controls() {
    let _alone = alone();
    let all = list::list();
    let camera = all.iter().find(|c| c.node == NODE).expect("listed");
    assert_eq!((camera.source.as_str(), camera.name.as_str()), ("v4l", "vivid"));
    let mode = camera.modes.iter().find(|m| m.fourcc == "YUYV" && m.width == 640 && m.height == 480);
    assert!(mode.is_some_and(|m| m.decodable && m.frames_per_second.contains(&25.0)), "{:?}", camera.modes);
    let pattern = camera.controls.iter().find(|c| c.id == TEST_PATTERN).expect("a control");
    assert_eq!((pattern.name.as_str(), pattern.value), ("test_pattern", Some(COLOUR_BARS)));
    assert!(pattern.menu.iter().any(|(value, name)| *value == BLACK && name.contains("Black")));
    assert!(camera.controls.iter().any(|c| c.name == "brightness" && c.max == 255));
}

#[tokio::test]
async fn frames_are_fresh_numbered_and_right() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("fourcc = \"RGB3\"")).expect("opens");
    assert_eq!(camera.description().fourcc, "RGB3");
    let mut last = fresh(&mut camera).await;
    for _ in 0..10 {
        let frame = fresh(&mut camera).await;
        assert!(frame.stamp.sequence > last.stamp.sequence && frame.stamp.exposed_at > last.stamp.exposed_at);
        last = frame;
    }
    // 75 % colour bars: white first, blue before last, black last.
    let [white, blue, black] = [20, 520, 620].map(|x| below_the_text(&last, x));
    assert!(white.iter().all(|c| *c > 170), "{white:?}");
    assert!(blue[2] > 150 && blue[0] < 60 && blue[1] < 60, "{blue:?}");
    assert!(black.iter().all(|c| *c < 40), "{black:?}");
}

#[tokio::test]
async fn every_format_decodes_to_the_same_picture() {
    let _alone = alone();
    let mut reference = None;
    let offered: Vec<String> = list::list()[0].modes.iter().map(|m| m.fourcc.clone()).collect();
    let mut tried = Vec::new();
    for fourcc in ["RGB3", "BGR3", "YUYV", "UYVY", "NV12", "RGGB", "GRBG", "GBRG", "BA81", "GREY"] {
        if !offered.iter().any(|o| o == fourcc) {
            continue;
        }
        let mut camera = V4lCamera::open(&settings(&format!("fourcc = \"{fourcc}\""))).expect(fourcc);
        let frame = fresh(&mut camera).await;
        let bars: Vec<[u8; 3]> = (0..8).map(|i| below_the_text(&frame, 40 + 80 * i)).collect();
        let reference = reference.get_or_insert_with(|| bars.clone());
        for (bar, expected) in bars.iter().zip(reference.iter()) {
            let expected = match fourcc {
                "GREY" => [bar[0]; 3],
                _ => *expected,
            };
            let off = bar.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(255);
            assert!(off <= 12, "{fourcc}: {bars:?} instead of {reference:?}");
        }
        tried.push(fourcc);
    }
    println!("formats compared: {}", tried.join(" "));
    assert!(tried.len() >= 6, "{tried:?} of {offered:?}");
}

#[tokio::test]
async fn no_frame_from_before_the_change_is_ever_taken() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("fourcc = \"YUYV\"\nfps = 25")).expect("opens");
    let mut waits = Vec::new();
    for i in 0..10 {
        let (pattern, expected) = if i % 2 == 0 { (BLACK, 0) } else { (WHITE, 255) };
        // Buffers fill with the old pattern meanwhile.
        tokio::time::sleep(Duration::from_millis(300)).await;
        press(TEST_PATTERN, pattern);
        let changed = now();
        let frame = camera.frame_after(changed, WITHIN).await.expect("a frame");
        waits.push(now().since(changed).as_millis());
        let seen = below_the_text(&frame, 300);
        assert!(seen.iter().all(|c| c.abs_diff(expected) < 40), "round {i}: {seen:?} for {expected}");
    }
    println!("stale frames: 0 of 10; waits in ms: {waits:?}");
}

#[tokio::test]
async fn damaged_and_dropped_frames_are_discarded_and_counted() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("")).expect("opens");
    fresh(&mut camera).await;
    press(BUFFER_ERROR, 1);
    let mut lost = 0;
    for _ in 0..10 {
        let frame = fresh(&mut camera).await;
        assert_eq!(frame.stamp.flags & 0x40, 0, "no frame with the ERROR flag");
        lost += frame.stamp.dropped_before;
    }
    assert!(lost >= 1, "the damaged frame counts as lost");

    press(PERCENTAGE_DROPPED, 50);
    let (mut got, mut lost) = (0, 0);
    for _ in 0..20 {
        lost += fresh(&mut camera).await.stamp.dropped_before;
        got += 1;
    }
    println!("with 50 % dropped: {got} taken, {lost} reported lost in between");
    assert!(lost >= 5, "{lost}");
}

#[tokio::test]
async fn a_silent_camera_stalls_and_recovers() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("stall_ms = 700")).expect("opens");
    fresh(&mut camera).await;
    press(PERCENTAGE_DROPPED, 100);
    tokio::time::sleep(Duration::from_millis(200)).await;
    let stalled = camera.frame_after(now(), Duration::from_secs(2)).await;
    assert!(matches!(stalled, Err(CameraError::Stalled { .. })), "{:?}", stalled.map(|f| f.stamp));
    press(PERCENTAGE_DROPPED, 0);
    let mut back = camera.frame_after(now(), WITHIN).await;
    if matches!(back, Err(CameraError::Lost { .. })) {
        back = camera.frame_after(now(), WITHIN).await;
    }
    assert!(back.is_ok(), "{:?}", back.map(|f| f.stamp));
}

#[tokio::test]
async fn a_fatal_stream_error_is_survived() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("")).expect("opens");
    fresh(&mut camera).await;
    press(FATAL_ERROR, 1);
    let frame = camera.frame_after(now(), WITHIN).await.expect("the stream is restarted");
    println!("after a fatal error: sequence {}, lost {}", frame.stamp.sequence, frame.stamp.dropped_before);
    fresh(&mut camera).await;
}

#[tokio::test]
async fn wrapped_timestamps_do_not_make_frames_look_fresh() {
    let _alone = alone();
    press(WRAP_TIMESTAMP, 1);
    let mut camera = V4lCamera::open(&settings("fourcc = \"YUYV\"")).expect("opens");
    for i in 0..6 {
        let (pattern, expected) = if i % 2 == 0 { (BLACK, 0) } else { (WHITE, 255) };
        tokio::time::sleep(Duration::from_millis(200)).await;
        press(TEST_PATTERN, pattern);
        let changed = now();
        let frame = camera.frame_after(changed, WITHIN).await.expect("a frame");
        let seen = below_the_text(&frame, 300);
        assert!(seen.iter().all(|c| c.abs_diff(expected) < 40), "round {i}: {seen:?} for {expected}");
    }
}

#[test]
fn what_the_driver_changes_silently_is_refused() {
    let _alone = alone();
    for more in ["width = 641\nheight = 481", "fourcc = \"MJPG\"", "fourcc = \"YUYV\"\nfps = 7"] {
        match V4lCamera::open(&settings(more)) {
            Err(error @ CameraError::Format { .. }) => println!("{error}"),
            other => panic!("{more}: {:?}", other.err()),
        }
    }
    let camera = V4lCamera::open(&settings("fps = 25")).expect("25/s is real");
    assert_eq!(camera.description().frames_per_second, 25.0);
}

#[test]
fn controls_are_locked_in_order_and_read_back() {
    let _alone = alone();
    let more = "controls = { gain = 77, gain_automatic = 0, brightness = 120, 0x00f0f000 = 7 }";
    let camera = V4lCamera::open(&settings(more)).expect("opens");
    let controls = &camera.description().controls;
    let expected = [("gain_automatic", 0), ("gain", 77), ("brightness", 120), ("test_pattern", 7)];
    assert_eq!(controls, &expected.map(|(name, value)| (name.to_owned(), value)));
    drop(camera);

    for (more, part) in [
        ("controls = { brightness = 100000 }", "brightness"),
        ("controls = { exposure_absolute = 100 }", "no such control"),
        ("controls = { 0x00f0f0f0 = 1 }", "no such control"),
    ] {
        let error = V4lCamera::open(&settings(more)).err().expect("refused");
        assert!(matches!(error, CameraError::Control { .. }), "{error}");
        assert!(error.to_string().contains(part), "{error}");
        println!("{error}");
    }
}

#[test]
fn a_camera_in_use_and_a_camera_that_is_not_there_are_told_apart() {
    let _alone = alone();
    let first = V4lCamera::open(&settings("")).expect("opens");
    let error = V4lCamera::open(&settings("")).err().expect("busy");
    assert!(error.to_string().contains("another program uses it"), "{error}");
    drop(first);
    assert!(V4lCamera::open(&settings("")).is_ok(), "free again");

    let text = "source = \"v4l\"\ndevice = \"No Such Camera\"";
    let error = V4lCamera::open(&toml::from_str(text).expect("settings")).err().expect("missing");
    assert!(error.to_string().contains("vivid"), "names what is there: {error}");
    let text = "source = \"v4l\"\ndevice = \"vivid\"";
    assert!(V4lCamera::open(&toml::from_str(text).expect("settings")).is_ok(), "by name");
}

#[tokio::test]
async fn an_unplugged_camera_is_lost_and_comes_back() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("controls = { brightness = 99 }")).expect("opens");
    fresh(&mut camera).await;
    press(DISCONNECT, 1);
    let lost = camera.frame_after(now(), WITHIN).await;
    assert!(matches!(lost, Err(CameraError::Lost { .. })), "{:?}", lost.map(|f| f.stamp));
    println!("{}", lost.err().expect("lost"));
    // vivid registers itself again when the last handle is closed: that is its plugging in.
    let frame = camera.frame_after(now(), WITHIN).await.expect("opened anew");
    assert_eq!(frame.width, 640);
    assert_eq!(camera.description().controls, [("brightness".to_owned(), 99)], "locked again");
}

#[tokio::test]
async fn opening_warms_up_and_averages() {
    let _alone = alone();
    let settings = settings("warmup_frames = 3\nmean_of = 4");
    let mut camera = open::open(&settings, Clock::real_time()).await.expect("opens");
    let frame = fresh(camera.as_mut()).await;
    assert_eq!(frame.stamp.averaged, 4);
    assert!(frame.stamp.sequence >= 3);
}

#[tokio::test]
async fn the_portable_source_takes_fresh_frames() {
    let _alone = alone();
    let text = "source = \"nokhwa\"\ndevice = \"0\"\nfourcc = \"YUYV\"";
    let settings: CameraSettings = toml::from_str(text).expect("settings");
    let mut camera = NokhwaCamera::open(&settings).expect("opens");
    assert_eq!((camera.description().source.as_str(), camera.description().width), ("nokhwa", 640));
    let mut waits = Vec::new();
    for i in 0..6 {
        let (pattern, expected) = if i % 2 == 0 { (BLACK, 0) } else { (WHITE, 255) };
        tokio::time::sleep(Duration::from_millis(300)).await;
        press(TEST_PATTERN, pattern);
        let changed = now();
        let frame = camera.frame_after(changed, WITHIN).await.expect("a frame");
        waits.push(now().since(changed).as_millis());
        let seen = below_the_text(&frame, 300);
        assert!(seen.iter().all(|c| c.abs_diff(expected) < 40), "round {i}: {seen:?} for {expected}");
    }
    println!("nokhwa: stale frames 0 of 6; waits in ms: {waits:?}");
}

#[tokio::test]
async fn a_driver_that_refuses_to_begin_is_told_and_works_the_next_time() {
    let _alone = alone();
    for (button, what) in
        [(REFUSE_BUFFERS, "buffers"), (REFUSE_QUEUEING, "queueing"), (REFUSE_STREAMING, "streaming")]
    {
        press(button, 1);
        let said = match V4lCamera::open(&settings("stall_ms = 700")) {
            Err(error @ CameraError::Open { .. }) => error.to_string(),
            Err(other) => panic!("{what}: {other}"),
            // What is refused once while streaming begins is tried again.
            Ok(mut camera) => {
                fresh(&mut camera).await;
                "tried again, and streams".to_owned()
            }
        };
        println!("refused {what}: {said}");
        let mut camera = V4lCamera::open(&settings("")).unwrap_or_else(|e| panic!("{what}, afterwards: {e}"));
        fresh(&mut camera).await;
    }
}

#[tokio::test]
async fn the_queue_refused_in_mid_stream_is_survived() {
    let _alone = alone();
    let mut camera = V4lCamera::open(&settings("")).expect("opens");
    fresh(&mut camera).await;
    press(REFUSE_QUEUEING, 1);
    for _ in 0..5 {
        fresh(&mut camera).await;
    }
}

#[tokio::test]
async fn a_format_changed_by_another_program_is_refused_while_streaming_and_renegotiated_afterwards() {
    let _alone = alone();
    use v4l::video::Capture;
    let other = v4l::Device::with_path(NODE).expect("another program opens it");
    let larger = v4l::Format::new(1280, 720, v4l::FourCC::new(b"RGB3"));
    {
        let mut camera = V4lCamera::open(&settings("fourcc = \"YUYV\"")).expect("opens");
        fresh(&mut camera).await;
        // The kernel keeps the format of a camera that streams.
        let changed = other.set_format(&larger);
        println!("while streaming: {:?}", changed.as_ref().map(|f| (f.width, f.fourcc)));
        let frame = fresh(&mut camera).await;
        assert_eq!((frame.width, frame.height, frame.stamp.fourcc.as_str()), (640, 480, "YUYV"));
    }
    // Between two sessions it may be anything: opening asks for its own again.
    let given = other.set_format(&larger).expect("nobody streams");
    assert_eq!(given.width, 1280);
    let mut camera = V4lCamera::open(&settings("fourcc = \"YUYV\"")).expect("opens again");
    let frame = fresh(&mut camera).await;
    assert_eq!((frame.width, frame.height, frame.stamp.fourcc.as_str()), (640, 480, "YUYV"));
}

#[tokio::test]
async fn automatics_are_frozen_at_what_they_found() {
    let _alone = alone();
    press(GAIN_AUTOMATIC, 1);
    let listing = list::list().into_iter().find(|c| c.node == NODE).expect("listed");
    let frozen = twinrig::device::camera::freeze::freeze(&listing.controls);
    println!("frozen: {frozen:?}");
    assert_eq!(frozen.get("gain_automatic"), Some(&0));
    assert!(frozen.contains_key("gain"));
    let left = twinrig::device::camera::freeze::left_on(&listing.controls, &Default::default());
    assert_eq!(left, ["gain_automatic"]);
    let lines: Vec<String> = frozen.iter().map(|(k, v)| format!("{k} = {v}")).collect();
    let camera =
        V4lCamera::open(&settings(&format!("controls = {{ {} }}", lines.join(", ")))).expect("locks");
    for (name, value) in &camera.description().controls {
        assert_eq!(frozen.get(name), Some(value), "{name} reads back");
    }
    press(GAIN_AUTOMATIC, 0);
}
