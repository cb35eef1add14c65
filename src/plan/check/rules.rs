//! One test for each rule of the check, and the property that matters: what passes stays inside.

use super::stand_ins::{indenters, pad, rig, role};
use super::*;
use crate::motion::Coordinate;
use crate::plan::{Contact, PlanFile, expand};
use crate::problem::Problem;
use proptest::prelude::*;

fn plan(text: &str) -> Plan {
    let file: PlanFile = toml::from_str(text).unwrap();
    let mut problems = Problems::new();
    let plan = file.check(&mut problems);
    assert_eq!(problems.into_vec(), []);
    plan.unwrap()
}

fn slip() -> Plan {
    plan(include_str!("../../../rig_configs/plans/slip.toml"))
}

fn rotate() -> Plan {
    plan(include_str!("../../../rig_configs/plans/rotate.toml"))
}

fn found(plan: &Plan, rig: &RigFences, half_mm: f64) -> Vec<Problem> {
    let (pad, indenters) = (pad(), indenters(plan, half_mm));
    let mut problems = Problems::new();
    check(plan, &expand(plan), &Bench { rig, pad: &pad, indenters: &indenters }, &mut problems);
    problems.into_vec()
}

fn keys(problems: &[Problem]) -> Vec<&str> {
    problems.iter().map(|p| p.key.as_str()).collect()
}

fn axis<'a>(rig: &'a mut RigFences, device: &str, axis: &str) -> &'a mut Fence {
    rig.axes.get_mut(&(device.to_owned(), axis.to_owned())).unwrap()
}

#[test]
fn sound_plans_on_a_sound_rig_pass() {
    assert_eq!(found(&slip(), &rig(), 4.0), []);
    assert_eq!(found(&rotate(), &rig(), 4.0), []);
}

#[test]
fn a_slide_beyond_the_travel_names_the_axis_and_the_worst_target() {
    let mut rig = rig();
    axis(&mut rig, "arm", "x").limits.max = 53.0;
    let found = found(&slip(), &rig, 3.0);
    assert_eq!(keys(&found), ["slide.distance_mm"]);
    assert!(found[0].value.contains("axis arm.x at 55.0000 mm"), "{}", found[0].value);
    assert_eq!(found[0].allowed, "0 to 53 mm on axis arm.x");
}

#[test]
fn the_lowest_contact_zero_counts() {
    // 0.5 mm deep below a zero that may lie 0.5 mm below nominal: axis z (reversed) at 21.
    let mut rig = rig();
    axis(&mut rig, "arm", "z").limits.max = 20.99;
    let problems = found(&slip(), &rig, 4.0);
    assert_eq!(keys(&problems), ["depths"]);
    axis(&mut rig, "arm", "z").limits.max = 21.01;
    assert_eq!(found(&slip(), &rig, 4.0), []);
}

#[test]
fn the_descent_of_the_touch_off_counts() {
    let mut plan = slip();
    plan.contact = Contact::TouchOff(crate::plan::TouchOff {
        step_mm: 0.02,
        start_mm: 0.3,
        max_depth_mm: 30.0,
        threshold: None,
    });
    let mut rig = rig();
    axis(&mut rig, "arm", "z").limits.max = 49.0;
    assert!(keys(&found(&plan, &rig, 4.0)).contains(&"contact.max_depth_mm"));
}

#[test]
fn the_overshoot_of_a_one_sided_approach_counts() {
    let mut rig = rig();
    let x = axis(&mut rig, "arm", "x");
    (x.limits.min, x.overshoot) = (45.0, -0.2);
    let found = found(&slip(), &rig, 3.0);
    assert_eq!(keys(&found), ["slide.distance_mm"]);
    assert!(found[0].value.contains("approaching one-sided"), "{}", found[0].value);
}

#[test]
fn a_one_sided_approach_from_inside_the_pad_counts_as_depth() {
    let mut rig = rig();
    // z runs the other way: from above on the axis is from below in the pad frame.
    axis(&mut rig, "arm", "z").overshoot = 2.0;
    assert_eq!(keys(&found(&slip(), &rig, 4.0)), ["depths"]);
    axis(&mut rig, "arm", "z").overshoot = -2.0;
    assert_eq!(found(&slip(), &rig, 4.0), []);
}

#[test]
fn a_plan_that_turns_needs_an_axis_that_turns() {
    let mut rig = rig();
    rig.map.theta = None;
    let problems = found(&rotate(), &rig, 4.0);
    assert_eq!(keys(&problems), ["rotate.angle_deg"]);
    assert!(problems[0].next.contains("[motion.theta]"));
    assert_eq!(found(&slip(), &rig, 4.0), []);
}

#[test]
fn a_feed_beyond_the_axis_is_refused() {
    let mut rig = rig();
    axis(&mut rig, "stage", "turn").limits.max_feed = 5.0;
    assert_eq!(keys(&found(&rotate(), &rig, 4.0)), ["feeds.rotate_deg_s"]);
}

#[test]
fn a_press_deeper_than_most_of_the_pad_is_refused() {
    let mut plan = slip();
    plan.depths_mm = vec![2.5];
    let found = found(&plan, &rig(), 4.0);
    assert_eq!(keys(&found), ["depths"]);
    assert!(found[0].allowed.contains("2.400 mm (60 % of the 4 mm thick pad"), "{}", found[0].allowed);
}

#[test]
fn a_press_deeper_than_the_indenter_is_high_is_refused_as_the_twin_refuses_it() {
    use crate::{elastomer, indenter};
    let mut plan = slip();
    plan.indenters.truncate(1);
    plan.depths_mm = vec![0.4, 0.7];
    let name = plan.indenters[0].name.clone();
    let found = |height_mm: f64| {
        let shape = "[shape]\nkind = \"flat\"\nplan = { kind = \"disc\", diameter_mm = 4 }";
        let spec = toml::from_str(&format!("height_mm = {height_mm}\n{shape}")).unwrap();
        let indenters = [(name.clone(), indenter::from_spec(&name, &spec, None).unwrap())].into();
        let (rig, pad, mut problems) = (rig(), pad(), Problems::new());
        check(&plan, &expand(&plan), &Bench { rig: &rig, pad: &pad, indenters: &indenters }, &mut problems);
        problems.into_vec()
    };
    assert_eq!(found(0.71), []);
    let low = found(0.6);
    assert_eq!(keys(&low), ["indenters[0]"]);
    let twin = elastomer::Error::Low { indenter: name.clone(), height_mm: 0.6, depth_mm: 0.7 }.to_string();
    assert_eq!(twin, format!("{}; {}", low[0].value, low[0].next));
}

#[test]
fn an_indenter_that_leaves_or_misses_the_pad_is_refused() {
    let mut plan = slip();
    plan.indenters.truncate(1);
    let leaves = found(&plan, &rig(), 4.3);
    assert_eq!(keys(&leaves), ["indenters[0]"]);
    assert!(leaves[0].value.contains("too near"), "{}", leaves[0].value);
    plan.locations_mm = vec![[30.0, 0.0]];
    let misses = found(&plan, &rig(), 4.0);
    assert!(misses[0].value.contains("misses the pad"), "{}", misses[0].value);
}

#[test]
fn sliding_without_contact_is_refused() {
    let mut plan = slip();
    plan.depths_mm = vec![0.0];
    assert_eq!(keys(&found(&plan, &rig(), 4.0)), ["depths"]);
}

#[test]
fn two_devices_cannot_slide_along_an_oblique_line() {
    let mut plan = slip();
    plan.slide.as_mut().unwrap().directions = vec![crate::motion::SlideDirection { deg: 30.0 }];
    let mut rig = rig();
    assert_eq!(found(&plan, &rig, 3.0), []);
    let linear = *axis(&mut rig, "arm", "y");
    rig.axes.insert(("stage".into(), "y".into()), linear);
    rig.map.y = Some(role("stage", "y", 1.0, 50.0));
    assert_eq!(keys(&found(&plan, &rig, 3.0)), ["slide.directions"]);
}

#[test]
fn a_pose_out_of_an_arms_reach_is_named_with_the_reach() {
    use crate::motion::{Arm, Chain, Joint, Place};
    let joint = |axis: &str, xyz_mm, about, range: [f64; 2]| {
        let origin = Place { xyz_mm, rpy_deg: [0.0; 3] };
        Joint { axis: axis.into(), origin, about, zero_deg: 0.0, min_deg: range[0], max_deg: range[1] }
    };
    // Five joints, as SO-101 has them: 247 mm from the second to the wrist.
    let chain = Chain {
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
    };
    let mut rig = rig();
    for (coordinate, name) in [(&mut rig.map.x, "x"), (&mut rig.map.y, "y"), (&mut rig.map.theta, "theta")] {
        *coordinate = Some(role("arm", name, 1.0, 0.0));
    }
    rig.map.z = role("arm", "z", 1.0, 0.0);
    for fence in rig.axes.values_mut() {
        (fence.limits.min, fence.limits.max) = (-100.0, 100.0);
    }
    let turn = rig.axes.remove(&("stage".into(), "turn".into())).unwrap();
    rig.axes.insert(("arm".into(), "theta".into()), turn);
    rig.arms.insert("arm".into(), Arm { chain, line_mm: 0.05 });
    assert_eq!(found(&slip(), &rig, 3.0), [], "within reach");

    let base = &mut rig.arms.get_mut("arm").unwrap().chain.base;
    base.xyz_mm = [-300.0, 0.0, -40.0];
    let far = found(&slip(), &rig, 3.0);
    let keys = keys(&far);
    assert!(keys.contains(&"slide.distance_mm") && !keys.iter().any(|k| k.starts_with("feeds")), "{far:?}");
    let slide = far.iter().find(|p| p.key == "slide.distance_mm").unwrap();
    for part in ["episode 1", "(x 5.000", "out of the arm's reach", "mm long", "the worst of "] {
        assert!(slide.value.contains(part), "{part} is not in {}", slide.value);
    }
    assert!(slide.next.contains("[devices.arm.kinematics]"), "{}", slide.next);
}

#[test]
fn everything_is_reported_at_once() {
    let mut plan = slip();
    plan.depths_mm = vec![3.0];
    let mut rig = rig();
    axis(&mut rig, "arm", "x").limits.max = 53.0;
    axis(&mut rig, "arm", "y").limits.min = 51.0;
    axis(&mut rig, "arm", "z").limits.max_feed = 0.1;
    let found = found(&plan, &rig, 9.0);
    let keys = keys(&found);
    for key in ["slide.distance_mm", "locations", "feeds.press_mm_s", "depths", "indenters[3]"] {
        assert!(keys.contains(&key), "{key} is not among {keys:?}");
    }
}

/// A random plan, a random rig, and a random zero within what touch-off can result in.
fn any_case() -> impl Strategy<Value = (Plan, RigFences, f64)> {
    let motion = (
        prop_oneof![Just("press"), Just("slip"), Just("rotate")],
        (-3.0..3.0f64, -3.0..3.0f64),
        (0.05..2.0f64, 0.5..6.0f64, 1.0..90.0f64, 0.0..360.0f64),
        (0.01..1.0f64, 0.0..1.0f64, 0.0..=1.0f64),
    );
    let axes = proptest::collection::vec(
        (-60.0..0.0f64, 0.0..60.0f64, prop_oneof![Just(1.0), Just(-1.0)], -20.0..20.0f64, -1.0..1.0f64),
        4,
    );
    (motion, axes).prop_map(|((primitive, at, (depth, way, angle, heading), (above, below, s)), axes)| {
        let mut plan = if primitive == "rotate" { rotate() } else { slip() };
        plan.indenters.truncate(1);
        plan.locations_mm = vec![[0.0, 0.0], [at.0, at.1]];
        plan.depths_mm = vec![depth / 2.0, depth];
        if primitive == "press" {
            plan.slide = None;
        }
        if let Some(slide) = &mut plan.slide {
            slide.directions = vec![crate::motion::SlideDirection { deg: heading }];
            slide.distances_mm = vec![way / 2.0, way];
        }
        if let Some(rotate) = &mut plan.rotate {
            rotate.angles_deg = vec![angle];
        }
        plan.contact = Contact::TouchOff(crate::plan::TouchOff {
            step_mm: 0.02,
            start_mm: above,
            max_depth_mm: below,
            threshold: None,
        });
        let mut rig = rig();
        let names = [("arm", "x"), ("arm", "y"), ("arm", "z"), ("stage", "turn")];
        for ((min, max, _, _, overshoot), (device, name)) in axes.iter().zip(names) {
            let fence = axis(&mut rig, device, name);
            (fence.limits.min, fence.limits.max, fence.overshoot) = (*min, *max, *overshoot);
        }
        let of = |i: usize, device, name| role(device, name, axes[i].2, axes[i].3);
        rig.map.x = Some(of(0, "arm", "x"));
        rig.map.y = Some(of(1, "arm", "y"));
        rig.map.z = of(2, "arm", "z");
        rig.map.theta = Some(of(3, "stage", "turn"));
        (plan, rig, -below + s * (above + below))
    })
}

/// Every axis position that performing the plan can command: start, touch-off, waypoints, points
/// between them, each with the beginning of its one-sided approach.
fn commanded(plan: &Plan, rig: &RigFences, zero: f64) -> Vec<(Fence, f64)> {
    let mut poses = vec![crate::pose::Pose::new(0.0, 0.0, plan.clearance_mm, 0.0)];
    if let Contact::TouchOff(touch) = &plan.contact {
        let mut z = touch.start_mm;
        while z > zero {
            poses.push(crate::pose::Pose::new(0.0, 0.0, z, 0.0));
            z = (z - touch.step_mm).max(zero);
        }
    }
    let lifted = |mut p: crate::pose::Pose| {
        p.z_mm += zero;
        p
    };
    let mut before = lifted(crate::pose::Pose::new(0.0, 0.0, plan.clearance_mm, 0.0));
    for waypoint in expand(plan).waypoints {
        let to = lifted(waypoint.pose);
        poses.extend([0.25, 0.5, 1.0].map(|s| before.lerp(&to, s)));
        before = to;
    }
    let mut targets = vec![];
    for pose in poses {
        for coordinate in Coordinate::ALL {
            if let Some(role) = rig.map.role(coordinate) {
                let fence = *rig.fence(role).unwrap();
                let target = role.to_axis(coordinate.of(&pose));
                targets.extend([(fence, target), (fence, target + fence.overshoot)]);
            }
        }
    }
    targets
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]
    #[test]
    fn no_plan_that_passes_can_command_a_target_outside_the_limits((plan, rig, zero) in any_case()) {
        let passes = !found(&plan, &rig, 1.0).iter().any(|p| p.allowed.contains("on axis"));
        let outside = commanded(&plan, &rig, zero)
            .into_iter()
            .find(|(fence, target)| *target < fence.limits.min - 1e-9 || *target > fence.limits.max + 1e-9);
        prop_assert!(!(passes && outside.is_some()), "{outside:?}");
    }
}

#[test]
fn the_property_sees_passing_and_failing_plans() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let mut passing = 0;
    for _ in 0..300 {
        let (plan, rig, _) = any_case().new_tree(&mut runner).unwrap().current();
        passing += usize::from(!found(&plan, &rig, 1.0).iter().any(|p| p.allowed.contains("on axis")));
    }
    assert!((30..270).contains(&passing), "{passing} of 300 plans pass");
}
