//! The shipped servo arm against its emulator: what is told of the tool, and where the world says that it is.

use super::*;
use crate::device::virtual_bench::serve::{SharedDevice, serve, with};
use crate::device::virtual_bench::{Emulator, EmulatorOptions, FaultPlan, Faulty, World};
use crate::motion::{AxisRole, PoseMap, ReachError};
use crate::pose::Pose;
use crate::protocol::conformance::tests::shipped;
use std::sync::Mutex;

struct ArmBench {
    mover: Mover,
    device: SharedDevice,
    world: World,
    clock: Clock,
}

/// The arm of the shipped rig file.
pub(super) fn servo_arm() -> MoverSettings {
    #[derive(serde::Deserialize)]
    struct Devices {
        arm: MoverSettings,
    }
    #[derive(serde::Deserialize)]
    struct Rig {
        devices: Devices,
    }
    let rig: Rig = toml::from_str(include_str!("../../../rig_configs/servo_arm.toml")).unwrap();
    rig.devices.arm
}

async fn homed() -> ArmBench {
    let (settings, clock) = (servo_arm(), Clock::real_time());
    let role = |axis: &str| AxisRole { device: "arm".into(), axis: axis.into(), sign: 1.0, origin: 0.0 };
    let map = PoseMap { x: Some(role("x")), y: Some(role("y")), z: role("z"), theta: Some(role("theta")) };
    let arms = [("arm".to_owned(), settings.arm().unwrap())].into();
    let world = World::with_arms(map, arms, 0.0);
    let spec = shipped(&settings.protocol);
    let (table, options) = (spec.emulator.as_ref().unwrap(), EmulatorOptions::default());
    let emulator = Emulator::new(table, "arm", &settings.axes, &options, world.clone(), clock.now()).unwrap();
    let device = Arc::new(Mutex::new(Faulty::new(emulator, FaultPlan::none(), clock.now())));
    let (near, far) = tokio::io::duplex(4096);
    let served = device.clone();
    tokio::spawn(async move { serve(far, &served, clock).await });
    let mut mover = Mover::connect(near, spec, settings, clock).await.unwrap();
    mover.home().await.unwrap();
    ArmBench { mover, device, world, clock }
}

impl ArmBench {
    fn truth(&self) -> Pose {
        self.world.scene_at(self.clock.now()).pose
    }

    async fn told(&mut self) -> Pose {
        let told = self.mover.position().await.unwrap();
        let of = |axis: &str| told.iter().find(|m| m.axis == axis).unwrap().position;
        Pose::new(of("x"), of("y"), of("z"), of("theta"))
    }
}

#[tokio::test(start_paused = true)]
async fn homing_ends_at_the_ready_pose_and_the_joints_prove_it() {
    let mut b = homed().await;
    let truth = b.truth();
    assert!(
        truth.distance_mm(&Pose::new(0.0, 0.0, 40.0, 0.0)) < 0.02 && truth.theta_deg.abs() < 0.02,
        "{truth}"
    );
    let told = b.told().await;
    assert!(told.distance_mm(&truth) < 1e-6, "{told}, in truth {truth}");
    let names: Vec<String> = b.mover.position().await.unwrap().into_iter().map(|m| m.axis).collect();
    assert_eq!(names, ["x", "y", "z", "theta", "elbow", "pan", "roll", "shoulder", "wrist"]);
}

#[tokio::test(start_paused = true)]
async fn a_press_is_straight_all_the_way_in_truth() {
    let mut b = homed().await;
    b.mover.move_to(&[("x", 5.0), ("y", -4.0)], 10.0).await.unwrap();
    b.mover.move_to(&[("z", 1.0)], 10.0).await.unwrap();
    let begun = b.clock.now();
    b.mover.move_to(&[("z", -0.5)], 0.5).await.unwrap();
    let took = b.clock.now().since(begun);
    let (mut deepest, mut aside) = (0.0f64, 0.0f64);
    for k in 0..=2000 {
        let at = b.world.scene_at(begun.after(took.mul_f64(f64::from(k) / 2000.0))).pose;
        deepest = deepest.min(at.z_mm);
        aside = aside.max((at.x_mm - 5.0).hypot(at.y_mm + 4.0));
    }
    assert!(aside < 0.06, "the tip went {aside} mm aside");
    assert!((deepest + 0.5).abs() < 0.01, "deepest {deepest}");
    assert!((b.told().await.z_mm + 0.5).abs() < 0.01);
    // 1.5 mm at 0.5 mm/s, and the ends of its pieces.
    assert!(took > Duration::from_secs(3) && took < Duration::from_secs(12), "{took:?}");
}

#[tokio::test(start_paused = true)]
async fn coordinates_that_were_to_stay_do_not_wander() {
    let mut b = homed().await;
    b.mover.move_to(&[("x", 3.0), ("y", 2.0)], 10.0).await.unwrap();
    for k in 0..20 {
        let z = if k % 2 == 0 { 2.0 } else { 12.0 };
        b.mover.move_to(&[("z", z)], 15.0).await.unwrap();
        b.mover.move_to(&[("theta", f64::from(k))], 30.0).await.unwrap();
    }
    let truth = b.truth();
    assert!(truth.distance_mm(&Pose::new(3.0, 2.0, 12.0, 0.0)) < 0.01, "{truth}");
    assert!((truth.theta_deg - 19.0).abs() < 0.01, "{truth}");
}

#[tokio::test(start_paused = true)]
async fn it_arrives_from_the_air() {
    let mut b = homed().await;
    b.mover.move_to(&[("z", -0.5)], 5.0).await.unwrap();
    let begun = b.clock.now();
    b.mover.move_to(&[("z", 0.0)], 5.0).await.unwrap();
    let took = b.clock.now().since(begun);
    let highest = (0..=500)
        .map(|k| b.world.scene_at(begun.after(took.mul_f64(f64::from(k) / 500.0))).pose.z_mm)
        .fold(f64::MIN, f64::max);
    assert!((highest - 0.1).abs() < 0.01, "{highest}");
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_for_a_pose_out_of_reach() {
    let mut settings = servo_arm();
    // A box that is larger than the reach.
    settings.kinematics.as_mut().unwrap().tool.x.max = 400.0;
    let mut b = homed().await;
    b.mover.settings = settings.clone();
    b.mover.tool = Tool::new(&settings);
    let before = with(&b.device, |d| d.request_bytes());
    let refused = b.mover.move_to(&[("x", 300.0)], 10.0).await.unwrap_err();
    let MoverError::Reach(ReachError::OutOfReach { off_mm, .. }) = &refused else { panic!("{refused}") };
    assert!(*off_mm > 50.0, "{refused}");
    assert_eq!(with(&b.device, |d| d.request_bytes()), before);
    let beyond = b.mover.move_to(&[("x", 401.0)], 10.0).await;
    assert!(matches!(beyond, Err(MoverError::Limit(_))), "{beyond:?}");
}

#[tokio::test(start_paused = true)]
async fn a_joint_that_was_pushed_is_seen_in_the_tool() {
    let mut b = homed().await;
    b.mover.move_to(&[("z", 10.0)], 10.0).await.unwrap();
    let (clock, before) = (b.clock, b.told().await);
    with(&b.device, |d| d.emulator().lose_steps("2", 0.1, clock.now()));
    // An absolute encoder sees where the joint is: what was pushed is measured.
    with(&b.device, |d| d.emulator().reseat("2"));
    let after = b.told().await;
    assert!(before.distance_mm(&after) > 0.5, "{before} and {after}");
    assert!(after.distance_mm(&b.truth()) < 0.005, "a count or two");
}

#[tokio::test(start_paused = true)]
async fn a_controlled_stop_holds_the_arm_where_it_is() {
    let mut b = homed().await;
    let stop = b.mover.stop_handle();
    let clock = b.clock;
    let moving = b.mover.move_to(&[("z", 5.0)], 5.0);
    let stopping = async {
        clock.sleep(Duration::from_secs(2)).await;
        stop.stop(StopKind::Controlled);
    };
    let (moved, ()) = tokio::join!(moving, stopping);
    assert!(moved.unwrap_err().is_stop());
    let at = b.told().await;
    assert!(at.z_mm > 10.0 && at.z_mm < 38.0, "{at}");
    clock.sleep(Duration::from_secs(5)).await;
    assert!(b.truth().distance_mm(&at) < 0.005, "it moved on");
    assert_eq!(b.mover.reference(), Reference::Referenced);
    // It goes on from there, straight up.
    b.mover.move_to(&[("z", 40.0)], 10.0).await.unwrap();
    assert!((b.truth().z_mm - 40.0).abs() < 0.01);
}

#[test]
fn a_preview_is_the_bytes_of_all_joints() {
    let settings = servo_arm();
    let spec = shipped(&settings.protocol);
    let here = [("x", 0.0), ("y", 0.0), ("z", 5.0), ("theta", 0.0)].map(|(n, v)| (n.to_owned(), v)).into();
    let bytes = preview_move(&spec, &settings, &here, &[("z", 4.9)], 1.0).unwrap();
    // A short line is one piece: a speed with its goal for each of five joints.
    assert_eq!(bytes.len(), 5, "{bytes:?}");
    assert!(matches!(preview_move(&spec, &settings, &here, &[("z", 61.0)], 1.0), Err(MoverError::Limit(_))));
}
