//! Geometry by hand, round trips, and what cannot be reached.

use super::*;
use proptest::prelude::*;

fn joint(axis: &str, xyz_mm: [f64; 3], about: [f64; 3], range: [f64; 2]) -> Joint {
    let origin = Place { xyz_mm, rpy_deg: [0.0; 3] };
    Joint { axis: axis.to_owned(), origin, about, zero_deg: 0.0, min_deg: range[0], max_deg: range[1] }
}

/// Two links of 100 and 80 mm in the plane y = 0, and a wrist that keeps the tool upright.
fn planar() -> Chain {
    Chain {
        base: Place { xyz_mm: [-150.0, 0.0, 60.0], rpy_deg: [0.0; 3] },
        joints: vec![
            joint("shoulder", [0.0; 3], [0.0, -1.0, 0.0], [-90.0, 90.0]),
            joint("elbow", [100.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-150.0, 150.0]),
            joint("wrist", [80.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-170.0, 170.0]),
        ],
        tip: Place { xyz_mm: [0.0, 0.0, -40.0], rpy_deg: [0.0; 3] },
        press: [0.0, 0.0, -1.0],
        turns: false,
    }
}

/// Five joints as SO-101 has them: pan, lift, elbow, wrist, roll; sizes rounded.
fn five() -> Chain {
    Chain {
        base: Place { xyz_mm: [-220.0, 0.0, -40.0], rpy_deg: [0.0; 3] },
        joints: vec![
            joint("pan", [0.0, 0.0, 55.0], [0.0, 0.0, 1.0], [-110.0, 110.0]),
            joint("lift", [30.0, 0.0, 60.0], [0.0, 1.0, 0.0], [-100.0, 100.0]),
            joint("elbow", [28.0, 0.0, 112.0], [0.0, 1.0, 0.0], [-97.0, 97.0]),
            joint("wrist", [135.0, 0.0, 5.0], [0.0, 1.0, 0.0], [-95.0, 95.0]),
            joint("roll", [60.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-160.0, 160.0]),
        ],
        tip: Place { xyz_mm: [40.0, 0.0, 0.0], rpy_deg: [0.0; 3] },
        press: [1.0, 0.0, 0.0],
        turns: true,
    }
}

#[test]
fn two_links_follow_the_law_of_cosines() {
    let arm = planar();
    let tool = arm.tool(&[90.0, -90.0, 0.0]);
    assert!((tool.tip_mm - DVec3::new(-70.0, 0.0, 120.0)).length() < 1e-9, "{tool:?}");
    // The wrist 40 mm above the tip, at (150, 0, 20) from the shoulder.
    let pose = Pose::new(0.0, 0.0, 40.0, 0.0);
    let joints = arm.joints(&pose, &[30.0, -60.0, 30.0]).unwrap();
    let reach = (150.0f64 * 150.0 + 20.0 * 20.0).sqrt();
    let elbow = 180.0 - ((100.0f64.powi(2) + 80.0f64.powi(2) - reach * reach) / 16000.0).acos().to_degrees();
    assert!((joints[1].abs() - elbow).abs() < 1e-3, "{joints:?}, {elbow}");
    assert!(joints.iter().sum::<f64>().abs() < 1e-3, "upright: {joints:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn the_angles_of_a_pose_lead_back_to_it(
        x in -30.0..30.0f64, y in -30.0..30.0f64, z in -1.0..40.0f64, theta in -40.0..40.0f64,
    ) {
        let arm = five();
        let pose = Pose::new(x, y, z, theta);
        let joints = arm.joints(&pose, &[0.0; 5]).unwrap();
        let tool = arm.tool(&joints);
        prop_assert!(arm.pose(&joints).distance_mm(&pose) <= NEAR_MM);
        prop_assert!((tool.frame * DVec3::X - DVec3::NEG_Z).length() < 1e-4);
        prop_assert!((arm.pose(&joints).theta_deg - theta).abs() < 1e-2);
        for (joint, angle) in arm.joints.iter().zip(&joints) {
            prop_assert!((joint.min_deg..=joint.max_deg).contains(angle));
        }
    }

    #[test]
    fn a_line_stays_within_its_tolerance(x in -20.0..20.0f64, y in -20.0..20.0f64, z in -1.0..30.0f64) {
        let arm = five();
        let from = Pose::new(0.0, 0.0, 20.0, 0.0);
        let to = Pose::new(x, y, z, 10.0);
        let begin = arm.joints(&from, &[0.0; 5]).unwrap();
        let points = arm.line(&begin, &to, 0.02).unwrap();
        prop_assert!(arm.pose(points.last().unwrap()).distance_mm(&to) <= NEAR_MM);
        let direction = DVec3::new(x, y, z - 20.0);
        let mut before = begin;
        for point in points {
            for t in 1..10 {
                let at: Vec<f64> =
                    before.iter().zip(&point).map(|(a, b)| a + (b - a) * f64::from(t) / 10.0).collect();
                let tip = arm.tool(&at).tip_mm - DVec3::new(0.0, 0.0, 20.0);
                let along = tip.dot(direction) / direction.length_squared();
                prop_assert!((tip - along * direction).length() < 0.025, "{tip} off {direction}");
            }
            before = point;
        }
    }
}

#[test]
fn a_press_of_a_millimetre_is_straight_to_a_hundredth() {
    let arm = five();
    let begin = arm.joints(&Pose::new(5.0, -5.0, 0.5, 0.0), &[0.0; 5]).unwrap();
    let points = arm.line(&begin, &Pose::new(5.0, -5.0, -0.5, 0.0), 0.01).unwrap();
    for point in &points {
        let at = arm.pose(point);
        assert!((at.x_mm - 5.0).abs() < 0.011 && (at.y_mm + 5.0).abs() < 0.011, "{at}");
    }
}

#[test]
fn what_is_too_far_and_what_a_joint_forbids_are_told_apart() {
    let mut arm = planar();
    let far = arm.joints(&Pose::new(100.0, 0.0, 40.0, 0.0), &[0.0; 3]).unwrap_err();
    let ReachError::OutOfReach { off_mm, reach_mm, distance_mm, .. } = far else { panic!("{far}") };
    assert_eq!(reach_mm, 220.0, "100 + 80 and the tip");
    assert!((distance_mm - (250.0f64.powi(2) + 20.0f64.powi(2)).sqrt()).abs() < 1e-9, "{distance_mm}");
    // At (250, 0, 20) from the shoulder, with 180 mm of arm; what tilting could gain costs as much.
    assert!(off_mm > 10.0 && off_mm < 71.0, "{off_mm}");
    arm.joints[1].min_deg = -20.0;
    arm.joints[1].max_deg = 20.0;
    let bent = arm.joints(&Pose::new(0.0, 0.0, 40.0, 0.0), &[0.0; 3]).unwrap_err();
    let ReachError::BeyondJoint { joint, value_deg, max_deg, .. } = &bent else { panic!("{bent}") };
    assert_eq!((joint.as_str(), *max_deg), ("elbow", 20.0));
    assert!(value_deg.abs() > 20.0, "{bent}");
    // Sideways it cannot go at all.
    assert!(matches!(
        arm.joints(&Pose::new(-20.0, 30.0, 40.0, 0.0), &[0.0; 3]),
        Err(ReachError::OutOfReach { .. })
    ));
}

#[test]
fn settings_that_cannot_be_are_all_reported() {
    let mut arm = five();
    arm.joints[2].max_deg = -100.0;
    arm.joints[3].about = [0.0; 3];
    arm.press = [f64::NAN, 0.0, 0.0];
    let mut problems = Problems::new();
    arm.check(&mut problems);
    let keys: Vec<String> = problems.into_vec().into_iter().map(|p| p.key).collect();
    assert_eq!(keys, ["joints[2].max_deg", "joints[3].about", "press"]);
}

#[test]
fn angles_count_as_the_axis_does() {
    let straight = five();
    let mut shifted = five();
    for (joint, zero) in shifted.joints.iter_mut().zip([180.0, 90.0, -10.0, 0.0, 45.0]) {
        (joint.zero_deg, joint.min_deg, joint.max_deg) = (zero, joint.min_deg + zero, joint.max_deg + zero);
    }
    let pose = Pose::new(3.0, -4.0, 5.0, 6.0);
    let (a, b) =
        (straight.joints(&pose, &[0.0; 5]).unwrap(), shifted.joints(&pose, &shifted.middle_deg()).unwrap());
    assert!(shifted.pose(&b).distance_mm(&straight.pose(&a)) < 2.0 * NEAR_MM);
    for ((a, b), joint) in a.iter().zip(&b).zip(&shifted.joints) {
        assert!((b - a - joint.zero_deg).abs() < 0.01, "{a} and {b}, {}", joint.axis);
    }
}
