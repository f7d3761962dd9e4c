//! Descriptions of arms as others write them, and homes with few digits.

use super::arm::with_urdf;
use crate::presets;

/// The arm of [`six`] writes on a wall: its pen is horizontal at home.
const WALL: &str = "home_rad = [0.0, 0.6, 1.2, -1.8, 0.0, 0.0]\n[plane]\norigin_m = [0.567, 0.44, 0.451]\n\
                    x_axis = [1.0, 0.0, 0.0]\nnormal = [0.0, -1.0, 0.0]\n\
                    workspace_m = [[-0.05, 0.05], [-0.05, 0.05], [-0.0005, 0.05]]\n";

/// A simple arm of six joints whose links have `inside`, under `head`.
fn six(head: &str, inside: &str) -> String {
    let joints = [
        ("0 0 0.1", "0 0 1"),
        ("0 0.1 0", "0 1 0"),
        ("0 0 0.4", "0 1 0"),
        ("0 0 0.35", "0 1 0"),
        ("0 0.1 0", "0 0 1"),
        ("0 0 0.1", "0 1 0"),
    ];
    let mut text =
        format!("<?xml version=\"1.0\"?>\n<robot name=\"six\">\n{head}\n<link name=\"base_link\"/>\n");
    for (i, (origin, axis)) in joints.iter().enumerate() {
        let parent = if i == 0 { "base_link".to_owned() } else { format!("l{i}") };
        let n = i + 1;
        text += &format!(
            "<link name=\"l{n}\">{inside}</link><joint name=\"j{n}\" type=\"revolute\"><parent \
             link=\"{parent}\"/><child link=\"l{n}\"/><origin xyz=\"{origin}\"/><axis \
             xyz=\"{axis}\"/><limit lower=\"-3.1\" upper=\"3.1\" velocity=\"3\" effort=\"100\"/></joint>\n"
        );
    }
    text + "<link name=\"tool0\"/><joint name=\"jt\" type=\"fixed\"><parent \
            link=\"l6\"/><child link=\"tool0\"/><origin xyz=\"0 0.08 0\" rpy=\"-1.5708 0 0\"/></joint>\n</robot>\n"
}

#[test]
fn what_is_not_used_of_a_description_refuses_no_settings() {
    let plain = load(&six("", ""));
    let config = plain.as_ref().unwrap_or_else(|why| panic!("{why}"));
    for (head, inside) in [
        ("<!-- made from <xacro:arm prefix=\"${p}\"/> -->", ""),
        (
            "",
            "<visual><geometry><box size=\"1 1 1\"/></geometry><material name=\"a\"/><material name=\"b\"/></visual>",
        ),
        ("<gazebo><ignition:plugin/></gazebo>", "<inertial><mass value=\"1\"/></inertial>"),
    ] {
        let found = load(&six(head, inside)).unwrap_or_else(|why| panic!("{head}{inside}: {why}"));
        let (robot, same) = (found.robot(), config.robot());
        assert_eq!(
            (robot.chain.forward(&robot.home), robot.limits),
            (same.chain.forward(&same.home), same.limits)
        );
    }
    // That nobody can judge the torques is noted with the link.
    let bare = load(&six("", "<inertial><mass value=\"1\"/></inertial>")).unwrap();
    let note = bare.notes().into_iter().find(|note| note.contains("torque")).unwrap();
    assert!(note.contains("link `l1` (line 5)"), "{note}");
}

fn load(urdf: &str) -> Result<crate::Config, String> {
    with_urdf(urdf, WALL)
}

#[test]
fn what_is_used_is_refused_with_joint_or_link_and_line_under_its_key() {
    let text = load(&six("", "").replacen("velocity=\"3\"", "velocity=\"fast\"", 1)).unwrap_err();
    assert!(text.contains("`robot.urdf`") && text.contains("joint `j1` (line 5)"), "{text}");
    let text = load("<mujoco/>").unwrap_err();
    assert!(text.contains("line 1: its root is <mujoco>"), "{text}");
    let text = load(&six("<xacro:property name=\"a\" value=\"1\"/>", "")).unwrap_err();
    assert!(text.contains("xacro FILE > robot.urdf") && text.contains("line 3)"), "{text}");
}

/// π has no end: with four digits half a turn is beyond a limit of half a turn.
#[test]
fn a_home_outside_its_limits_by_rounding_is_taken_as_the_limit_and_by_more_is_refused() {
    // The last joint turns the pen about itself: no place on the paper needs it.
    let turned = |high: f64| {
        let urdf = presets::robot("ur5").unwrap();
        let (before, after) = urdf.rsplit_once("upper=\"6.283185307179586\"").unwrap();
        let home = "home_rad = [3.1416, -1.3, 1.8, -2.0708, -1.5708, 3.1416]\n";
        with_urdf(&format!("{before}upper=\"{high}\"{after}"), home)
    };
    let config = turned(std::f64::consts::PI).unwrap();
    assert_eq!(config.robot().home[5], std::f64::consts::PI);
    assert!(config.settings().robot.home_rad[5] > config.robot().home[5], "as it was written");
    assert_eq!(turned(3.1407).unwrap().robot().home[5], 3.1407);
    let text = turned(3.1405).unwrap_err();
    assert!(text.contains("`robot.home_rad`") && text.contains("wrist_3_joint"), "{text}");
}
