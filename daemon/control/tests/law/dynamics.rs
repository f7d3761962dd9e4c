//! Torques and mass matrix of the shipped arms against Pinocchio's numbers (`fixtures/dynamics/make.py`), and
//! against each other.

use foretrace_control::arm::{Chain, DynamicsError, Payload};
use nalgebra::{Matrix6, Vector3, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use serde::Deserialize;

const UR5: &str = include_str!("../../../../config/robots/ur5.urdf");
const UR5E: &str = include_str!("../../../../config/robots/ur5e.urdf");

#[derive(Deserialize)]
struct Case {
    arm: String,
    mass: f64,
    centre: [f64; 3],
    q: [f64; 6],
    qd: [f64; 6],
    qdd: [f64; 6],
    torque: [f64; 6],
    gravity: [f64; 6],
    matrix: [[f64; 6]; 6],
}

fn cases() -> Vec<Case> {
    serde_json::from_str(include_str!("fixtures/dynamics/torques.json")).unwrap()
}

fn arm(text: &str) -> Chain<6> {
    Chain::from_urdf(text, None, None).unwrap()
}

/// Largest difference, relative to the largest of the expected numbers.
fn off<'a>(found: impl IntoIterator<Item = &'a f64>, expected: impl IntoIterator<Item = &'a f64>) -> f64 {
    let pairs: Vec<(f64, f64)> = found.into_iter().copied().zip(expected.into_iter().copied()).collect();
    let size = pairs.iter().fold(0.0, |size: f64, (_, expected)| size.max(expected.abs()));
    pairs.iter().fold(0.0, |worst: f64, (found, expected)| worst.max((found - expected).abs())) / size
}

#[test]
fn torques_gravity_and_mass_matrix_are_pinocchios() {
    let cases = cases();
    assert_eq!(cases.len(), 48);
    for (n, case) in cases.iter().enumerate() {
        let chain = arm(if case.arm == "ur5" { UR5 } else { UR5E });
        // A pen's length moves the tip, not the masses.
        let chain = chain.with_tool(Vector3::new(0.01, 0.0, 0.15));
        let dynamics = chain.dynamics(&Payload { mass: case.mass, centre: case.centre }).unwrap();
        let matrix = dynamics.mass_matrix(&case.q);
        for (what, worst) in [
            ("torque", off(&dynamics.torque(&case.q, &case.qd, &case.qdd), &case.torque)),
            ("gravity", off(&dynamics.gravity(&case.q), &case.gravity)),
            ("matrix", off(matrix.iter(), case.matrix.as_flattened())),
        ] {
            assert!(worst < 1e-9, "{what} of case {n} ({} kg): off by {worst:e} of its size", case.mass);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(27), ..ProptestConfig::with_cases(200) })]

    #[test]
    fn the_mass_matrix_is_what_accelerations_add_to_the_torque(
        q in prop::array::uniform6(-6.3..6.3),
        qd in prop::array::uniform6(-3.1..3.1),
        qdd in prop::array::uniform6(-40.0..40.0),
        mass in 0.0..10.0,
    ) {
        let dynamics = arm(UR5E).dynamics(&Payload { mass, centre: [0.02, 0.01, 0.1] }).unwrap();
        let matrix: Matrix6<f64> = dynamics.mass_matrix(&q);
        let with = Vector6::from(dynamics.torque(&q, &qd, &qdd));
        let without = Vector6::from(dynamics.torque(&q, &qd, &[0.0; 6]));
        let added = matrix * Vector6::from(qdd);
        prop_assert!((with - without - added).norm() <= 1e-11 * (with.norm() + added.norm()));
        prop_assert_eq!(matrix, matrix.transpose());
        prop_assert!(matrix.symmetric_eigenvalues().min() > 0.0);
    }

    #[test]
    fn a_payloads_own_torques_are_the_difference_that_it_makes(
        q in prop::array::uniform6(-6.3..6.3),
        qd in prop::array::uniform6(-3.1..3.1),
        qdd in prop::array::uniform6(-40.0..40.0),
    ) {
        let payload = Payload { mass: 2.0, centre: [0.0, 0.03, 0.08] };
        let with = Vector6::from(arm(UR5).dynamics(&payload).unwrap().torque(&q, &qd, &qdd));
        let without = Vector6::from(arm(UR5).dynamics(&Payload::NONE).unwrap().torque(&q, &qd, &qdd));
        let alone = Vector6::from(arm(UR5).payload_dynamics(&payload).torque(&q, &qd, &qdd));
        prop_assert!((with - without - alone).norm() <= 1e-12 * with.norm());
    }
}

/// Two links of the same body, one turned and displaced by a fixed joint, weigh what one link does; an axis
/// that is not z changes nothing.
#[test]
fn fixed_links_are_merged_and_axes_may_point_anywhere() {
    let split = UR5E.replace(
        "<link name=\"tool0\"/>",
        "<link name=\"tool0\"><inertial><origin xyz=\"0.01 0.02 0.1\"/><mass value=\"5\"/>\
             <inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/></inertial></link>",
    );
    let payload = Payload { mass: 5.0, centre: [0.01, 0.02, 0.1] };
    let (merged, carried) =
        (arm(&split).dynamics(&Payload::NONE).unwrap(), arm(UR5E).dynamics(&payload).unwrap());
    // The elbow's frame turned by a right angle about x, so that its axis is y; what hangs on it turned back.
    let turned = UR5E
        .replace(
            "<origin xyz=\"-0.425 0 0\" rpy=\"0 0 0\"/>\n    <axis xyz=\"0 0 1\"/>",
            "<origin xyz=\"-0.425 0 0\" rpy=\"1.5707963267948966 0 0\"/>\n    <axis xyz=\"0 1 0\"/>",
        )
        .replace(
            "<origin xyz=\"-0.3922 0 0.1333\" rpy=\"0 0 0\"/>",
            "<origin xyz=\"-0.3922 0.1333 0\" rpy=\"-1.5707963267948966 0 0\"/>",
        )
        .replace(
            "<origin xyz=\"-0.2422 0 0.0265\" rpy=\"0 1.5707963267948966 0\"/>",
            "<origin xyz=\"-0.2422 0.0265 0\" rpy=\"0 0 0\"/>",
        )
        .replace(
            "<inertia ixx=\"0.03121\" ixy=\"0\" ixz=\"0\" iyy=\"0.03121\" iyz=\"0\" izz=\"0.0041\"/>",
            "<inertia ixx=\"0.0041\" ixy=\"0\" ixz=\"0\" iyy=\"0.03121\" iyz=\"0\" izz=\"0.03121\"/>",
        );
    assert_ne!(turned, UR5E);
    let turned = arm(&turned).dynamics(&Payload::NONE).unwrap();
    for case in cases() {
        let [merged, carried, turned, plain] =
            [&merged, &carried, &turned, &arm(UR5E).dynamics(&Payload::NONE).unwrap()]
                .map(|dynamics| dynamics.torque(&case.q, &case.qd, &case.qdd));
        assert!(off(&merged, &carried) < 1e-12);
        assert!(off(&turned, &plain) < 1e-12, "{turned:?} {plain:?}");
    }
}

#[test]
fn a_description_without_masses_or_with_impossible_ones_names_what_is_wrong() {
    let gone = UR5E.replace("inertial>", "inertial_>");
    let error = arm(&gone).dynamics(&Payload::NONE).unwrap_err();
    assert!(error.to_string().contains("`shoulder_pan_joint`"), "{error}");
    for (from, to, what) in [
        ("mass value=\"1.37\"", "mass value=\"-1\"", "below 0"),
        ("mass value=\"1.37\"", "mass value=\"NaN\"", "not finite"),
        ("ixx=\"0.00256\"", "ixx=\"-0.1\"", "principal moment"),
    ] {
        let error = arm(&UR5E.replacen(from, to, 1)).dynamics(&Payload::NONE).unwrap_err();
        let named = matches!(&error, DynamicsError::Inertial { link, .. } if link.name == "wrist_1");
        assert!(named && error.to_string().contains(what), "{error}");
    }
    for payload in [
        Payload { mass: -0.1, centre: [0.0; 3] },
        Payload { mass: f64::NAN, centre: [0.0; 3] },
        Payload { mass: 1.0, centre: [f64::INFINITY, 0.0, 0.0] },
    ] {
        assert!(matches!(arm(UR5).dynamics(&payload), Err(DynamicsError::Payload { .. })));
    }
}
