//! Kinematics of the shipped robots against Denavit-Hartenberg matrices multiplied here, and against finite
//! differences.

use foretrace_control::arm::{Chain, ChainError, Kinematics};
use nalgebra::{Matrix3, Matrix4, Vector3, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

const UR5: &str = include_str!("../../../../config/robots/ur5.urdf");
const UR5E: &str = include_str!("../../../../config/robots/ur5e.urdf");

/// a2, a3, d1, d4, d5, d6 \[m\] (../shared/research/ur-interface.md section 6).
const UR5_DH: [f64; 6] = [-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823];
const UR5E_DH: [f64; 6] = [-0.425, -0.3922, 0.1625, 0.1333, 0.0997, 0.0996];

/// Product of Rz(θ) Tz(d) Tx(a) Rx(α), written out element by element.
fn dh_pose([a2, a3, d1, d4, d5, d6]: [f64; 6], q: &[f64; 6]) -> Matrix4<f64> {
    let a = [0.0, a2, a3, 0.0, 0.0, 0.0];
    let d = [d1, 0.0, 0.0, d4, d5, d6];
    let alpha = [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0];
    let mut pose = Matrix4::identity();
    for i in 0..6 {
        let ((s, c), (sa, ca)) = (q[i].sin_cos(), alpha[i].sin_cos());
        #[rustfmt::skip]
        let link = Matrix4::new(
            c, -s * ca,  s * sa, a[i] * c,
            s,  c * ca, -c * sa, a[i] * s,
            0.0,    sa,      ca,     d[i],
            0.0,   0.0,     0.0,      1.0,
        );
        pose *= link;
    }
    pose
}

fn arms() -> &'static [(Chain<6>, [f64; 6]); 2] {
    // Reading them for every case takes longer than all that is tested.
    static ARMS: LazyLock<[(Chain<6>, [f64; 6]); 2]> = LazyLock::new(|| {
        [(UR5, UR5_DH), (UR5E, UR5E_DH)].map(|(text, dh)| (Chain::from_urdf(text, None, None).unwrap(), dh))
    });
    &ARMS
}

fn distance(k: &Kinematics<6>, pose: &Matrix4<f64>) -> f64 {
    let position = (k.position - pose.fixed_view::<3, 1>(0, 3)).norm();
    let rotation = (k.rotation - pose.fixed_view::<3, 3>(0, 0)).norm();
    position.max(rotation)
}

fn joints() -> impl Strategy<Value = [f64; 6]> {
    prop::array::uniform6(-2.0 * PI..2.0 * PI)
}

fn rates() -> impl Strategy<Value = [f64; 6]> {
    prop::array::uniform6(-PI..PI)
}

fn moved(q: &[f64; 6], qd: &[f64; 6], t: f64) -> [f64; 6] {
    std::array::from_fn(|i| q[i] + qd[i] * t)
}

/// By hand, all joints zero: the links lie along x, α₁ = π/2 turns y up and z to −y, and d4, d6 point along
/// −y, d5 down. p = (a2 + a3, −(d4 + d6), d1 − d5); the tool's x stays x, its y is up, its z is −y.
#[test]
fn zero_pose_is_the_one_worked_by_hand() {
    let expected = [Vector3::new(-0.81725, -0.19145, -0.005491), Vector3::new(-0.8172, -0.2329, 0.0628)];
    for ((chain, _), expected) in arms().iter().zip(expected) {
        let k = chain.forward(&[0.0; 6]);
        assert!((k.position - expected).norm() < 1e-12, "{}", k.position);
        let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        assert!((k.rotation - rotation).norm() < 1e-12, "{}", k.rotation);
    }
}

/// By hand, shoulder lifted by −π/2: both arm links stand upright, p = (−d5, −(d4 + d6), d1 − a2 − a3).
#[test]
fn upright_pose_is_the_one_worked_by_hand() {
    let (chain, _) = &arms()[0];
    let k = chain.forward(&[0.0, -FRAC_PI_2, 0.0, 0.0, 0.0, 0.0]);
    assert!((k.position - Vector3::new(-0.09465, -0.19145, 0.906409)).norm() < 1e-12, "{}", k.position);
}

#[test]
fn limits_and_names_are_those_of_the_description() {
    for (chain, _) in arms() {
        let limits = chain.limits();
        assert_eq!(limits.names[0], "shoulder_pan_joint");
        assert_eq!(limits.names[5], "wrist_3_joint");
        assert_eq!(limits.position[2], [-PI, PI]);
        assert_eq!(limits.position[5], [-2.0 * PI, 2.0 * PI]);
        assert_eq!(limits.velocity, [PI; 6]);
        assert_eq!(limits.effort, [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]);
        assert_eq!(chain.ends(), ("base_link", "tool0"));
    }
}

/// A tool given as an offset is the same arm as a description with a fixed joint to the pen's tip, on a tip
/// link that is turned as well: pose, Jacobian and its rate.
#[test]
fn a_tool_is_a_fixed_joint_below_the_tip() {
    let joint = r#"<link name="tool0"/><link name="holder"/>
        <joint name="a" type="fixed"><parent link="tool0"/><child link="holder"/><origin xyz="0.01 0 0.02" rpy="0.3 -0.2 0.5"/></joint>
        <link name="pen"/>
        <joint name="b" type="fixed"><parent link="holder"/><child link="pen"/><origin xyz="0.03 -0.02 0.15" rpy="0 0 0"/></joint>"#;
    let text = UR5.replace("<link name=\"tool0\"/>", joint);
    let described = Chain::<6>::from_urdf(&text, None, Some("pen")).unwrap();
    let bare = Chain::<6>::from_urdf(&text, None, Some("holder")).unwrap();
    let offset = bare.clone().with_tool(Vector3::new(0.03, -0.02, 0.15));
    let (q, qd) = ([0.3, -1.2, 1.9, -2.0, -1.4, 0.6], [0.5, -1.0, 0.8, 2.0, -1.5, 0.7]);
    let (a, b) = (described.forward(&q), offset.forward(&q));
    assert!((a.position - b.position).norm() < 1e-14 && (a.rotation - b.rotation).norm() < 1e-14);
    assert!((a.jacobian - b.jacobian).norm() < 1e-14);
    assert!((a.jacobian_dot_qd(&qd) - b.jacobian_dot_qd(&qd)).norm() < 1e-13);
    assert!((bare.forward(&q).position - b.position).norm() > 0.15);
}

/// The same cases on every run.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn pose_is_the_product_of_the_dh_matrices(q in joints()) {
        for (chain, dh) in arms() {
            let k = chain.forward(&q);
            prop_assert!(distance(&k, &dh_pose(*dh, &q)) < 1e-13);
            prop_assert!((k.rotation.transpose() * k.rotation - Matrix3::identity()).norm() < 1e-14);
        }
    }

    /// Central differences with step 1e-5: truncation about 1e-10, rounding about 1e-11.
    #[test]
    fn jacobian_is_the_derivative_of_the_pose(q in joints(), qd in rates()) {
        for (chain, _) in arms() {
            let k = chain.forward(&q);
            let t = 1e-5;
            let (ahead, behind) = (chain.forward(&moved(&q, &qd, t)), chain.forward(&moved(&q, &qd, -t)));
            let linear = (ahead.position - behind.position) / (2.0 * t);
            // Ṙ Rᵀ is the cross-product matrix of ω.
            let spin = (ahead.rotation - behind.rotation) / (2.0 * t) * k.rotation.transpose();
            let [x, y, z] = [spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]];
            let expected = Vector6::new(linear.x, linear.y, linear.z, x, y, z);
            prop_assert!((k.twist(&qd) - expected).norm() < 1e-7, "{} {}", k.twist(&qd), expected);
        }
    }

    #[test]
    fn jacobian_rate_is_the_derivative_of_the_twist(q in joints(), qd in rates()) {
        for (chain, _) in arms() {
            let t = 1e-5;
            let ahead = chain.forward(&moved(&q, &qd, t)).twist(&qd);
            let behind = chain.forward(&moved(&q, &qd, -t)).twist(&qd);
            let expected = (ahead - behind) / (2.0 * t);
            let rate = chain.forward(&q).jacobian_dot_qd(&qd);
            prop_assert!((rate - expected).norm() < 1e-6, "{rate} {expected}");
        }
    }

    #[test]
    fn tool_motion_is_that_of_the_path(q in joints(), qd in rates(), qdd in rates()) {
        let (chain, _) = &arms()[0];
        let motion = chain.forward(&q).tool_motion(&qd, &qdd);
        let t = 1e-4;
        let at = |t: f64| {
            let q: [f64; 6] = std::array::from_fn(|i| q[i] + t * (qd[i] + 0.5 * t * qdd[i]));
            chain.forward(&q).position
        };
        prop_assert!(((at(t) - at(-t)) / (2.0 * t) - motion.velocity).norm() < 1e-5);
        prop_assert!(((at(t) + at(-t) - 2.0 * at(0.0)) / (t * t) - motion.acceleration).norm() < 1e-4);
    }

    #[test]
    fn huge_and_broken_positions_do_not_panic(q in prop::array::uniform6(any::<f64>())) {
        let k = arms()[0].0.forward(&q);
        if q.iter().all(|x| x.is_finite()) {
            prop_assert!(distance(&k, &dh_pose(UR5_DH, &q)) < 1e-12);
        }
    }
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn damaged_descriptions_are_refused_without_panic(share in 0.0..1.0f64, with in "\\PC{0,12}") {
        let end = UR5.find("</robot>").unwrap();
        let cut = (0..=(share * end as f64) as usize).rev().find(|i| UR5.is_char_boundary(*i)).unwrap();
        let text = format!("{}{}", &UR5[..cut], with);
        prop_assert!(Chain::<6>::from_urdf(&text, None, None).is_err());
    }
}

/// A skew arm of 7 joints, axes not along z, a fixed joint between, a gripper beside the tip.
const SKEW: &str = r#"<robot name="skew">
  <link name="b"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="m"/><link name="l4"/><link name="l5"/>
  <link name="l6"/><link name="l7"/><link name="t"/><link name="finger"/>
  <joint name="j1" type="continuous"><parent link="b"/><child link="l1"/><origin xyz="0.1 0 0.2" rpy="0.1 0.2 0.3"/>
    <axis xyz="1 2 3"/><limit lower="0" upper="0" velocity="2" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 -0.2 0.2"/>
    <axis xyz="0 0 -1"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0 0.3 0" rpy="0 -1 0"/>
    <axis xyz="0 -1 0"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="f" type="fixed"><parent link="l3"/><child link="m"/><origin xyz="0.05 0 0" rpy="0.5 0 0"/></joint>
  <joint name="j4" type="revolute"><parent link="m"/><child link="l4"/><origin xyz="0 0.1 0.2"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="j5" type="revolute"><parent link="l4"/><child link="l5"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 1 1"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="j6" type="revolute"><parent link="l5"/><child link="l6"/><origin xyz="0.2 0.1 0" rpy="0 0 2"/>
    <axis xyz="-1 0 0.3"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="j7" type="revolute"><parent link="l6"/><child link="l7"/><origin xyz="0 0.1 0"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>
  <joint name="tip" type="fixed"><parent link="l7"/><child link="t"/><origin xyz="0 0.03 0.1" rpy="0.1 -0.4 0"/></joint>
  <joint name="g" type="prismatic"><parent link="l7"/><child link="finger"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
</robot>"#;

/// The same arm by plain homogeneous matrices: origin, then Rodrigues about the axis.
fn skew_pose(q: &[f64; 7]) -> Matrix4<f64> {
    use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion};
    let fixed = |x: [f64; 3], r: [f64; 3]| {
        Isometry3::from_parts(
            Translation3::new(x[0], x[1], x[2]),
            UnitQuaternion::from_euler_angles(r[0], r[1], r[2]),
        )
    };
    let turn = |axis: [f64; 3], angle: f64| {
        let axis = Unit::new_normalize(Vector3::from(axis));
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&axis, angle))
    };
    let none = [0.0; 3];
    (fixed([0.1, 0.0, 0.2], [0.1, 0.2, 0.3])
        * turn([1.0, 2.0, 3.0], q[0])
        * fixed([0.1, -0.2, 0.2], none)
        * turn([0.0, 0.0, -1.0], q[1])
        * fixed([0.0, 0.3, 0.0], [0.0, -1.0, 0.0])
        * turn([0.0, -1.0, 0.0], q[2])
        * fixed([0.05, 0.0, 0.0], [0.5, 0.0, 0.0])
        * fixed([0.0, 0.1, 0.2], none)
        * turn([1.0, 0.0, 0.0], q[3])
        * fixed([0.2, 0.0, 0.0], none)
        * turn([0.0, 1.0, 1.0], q[4])
        * fixed([0.2, 0.1, 0.0], [0.0, 0.0, 2.0])
        * turn([-1.0, 0.0, 0.3], q[5])
        * fixed([0.0, 0.1, 0.0], none)
        * turn([0.0, 0.0, 1.0], q[6])
        * fixed([0.0, 0.03, 0.1], [0.1, -0.4, 0.0]))
    .to_homogeneous()
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn any_axes_and_seven_joints_work(
        q in prop::array::uniform7(-3.0..3.0f64),
        qd in prop::array::uniform7(-2.0..2.0f64)) {
        let chain = Chain::<7>::from_urdf(SKEW, Some("b"), Some("t")).unwrap();
        let k = chain.forward(&q);
        let pose = skew_pose(&q);
        prop_assert!((k.position - pose.fixed_view::<3, 1>(0, 3)).norm() < 1e-13);
        prop_assert!((k.rotation - pose.fixed_view::<3, 3>(0, 0)).norm() < 1e-13);
        let ahead: [f64; 7] = std::array::from_fn(|i| q[i] + 1e-5 * qd[i]);
        let behind: [f64; 7] = std::array::from_fn(|i| q[i] - 1e-5 * qd[i]);
        let (ahead, behind) = (chain.forward(&ahead), chain.forward(&behind));
        let linear = (ahead.position - behind.position) / 2e-5;
        prop_assert!((k.twist(&qd).fixed_rows::<3>(0) - linear).norm() < 1e-7);
        prop_assert!(((ahead.twist(&qd) - behind.twist(&qd)) / 2e-5 - k.jacobian_dot_qd(&qd)).norm() < 1e-6);
    }
}

fn refused(text: &str, base: Option<&str>, tip: Option<&str>) -> ChainError {
    Chain::<7>::from_urdf(text, base, tip).expect_err("must be refused")
}

#[test]
fn every_unusable_description_is_refused_by_name() {
    let says = |error: ChainError, words: &[&str]| {
        let text = error.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{text}");
    };
    let with = |from: &str, to: &str| {
        assert!(SKEW.contains(from), "{from}");
        SKEW.replacen(from, to, 1)
    };
    says(refused("not xml", None, None), &["URDF"]);
    says(refused("<robot name=\"x\"></robot>", None, None), &["no links"]);
    says(refused(SKEW, Some("b"), None), &["branches", "`l7`", "`tip`", "`g`"]);
    says(refused(SKEW, Some("b"), Some("finger")), &["`g`", "prismatic"]);
    says(refused(SKEW, Some("nowhere"), Some("t")), &["`nowhere`", "`l1`"]);
    says(refused(SKEW, Some("t"), Some("b")), &["`b` is not below link `t`"]);
    says(refused(SKEW, Some("l1"), Some("t")), &["6 moving joints", "7 are needed"]);
    says(
        refused(&with("<axis xyz=\"1 2 3\"/>", "<axis xyz=\"0 0 0\"/>"), None, Some("t")),
        &["`j1`", "axis"],
    );
    says(refused(&with("xyz=\"0.1 0 0.2\"", "xyz=\"nan 0 0.2\""), None, Some("t")), &["`j1`", "origin"]);
    says(refused(&with("lower=\"-1\"", "lower=\"2\""), None, Some("t")), &["`j2`", "upper"]);
    says(refused(&with("lower=\"-1\"", "lower=\"nan\""), None, Some("t")), &["`j2`", "lower"]);
    says(refused(&with("velocity=\"2\"", "velocity=\"-2\""), None, Some("t")), &["`j1`", "velocity", "-2"]);
    says(
        refused(&with("<limit lower=\"-1\" upper=\"1\" velocity=\"2\" effort=\"1\"/>", ""), None, Some("t")),
        &["`j2`", "limit"],
    );
    says(
        refused(
            &with("<axis xyz=\"0 0 -1\"/>", "<axis xyz=\"0 0 -1\"/><mimic joint=\"j1\"/>"),
            None,
            Some("t"),
        ),
        &["`j2`", "mimics", "`j1`"],
    );
    let looped = with("<parent link=\"b\"/>", "<parent link=\"l2\"/>");
    says(refused(&looped, Some("b"), Some("t")), &["of itself"]);
    let ring = r#"<robot name="ring"><link name="a"/><link name="c"/>
        <joint name="j1" type="fixed"><parent link="a"/><child link="c"/></joint>
        <joint name="j2" type="fixed"><parent link="c"/><child link="a"/></joint></robot>"#;
    says(refused(ring, Some("a"), None), &["`a`", "of itself"]);
    says(
        refused(&with("<child link=\"t\"/>", "<child link=\"l7\"/>"), Some("b"), Some("l7")),
        &["`l7`", "parent"],
    );
    says(refused(&with("type=\"continuous\"", "type=\"floating\""), None, Some("t")), &["`j1`", "floating"]);
}
