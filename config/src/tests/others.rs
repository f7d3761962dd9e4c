//! Descriptions of arms as others write them, and homes with few digits.

use std::path::PathBuf;
use std::sync::Arc;

use super::arm::with_urdf;
use crate::files::Files;
use crate::{Draft, presets};

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
    assert_eq!(turned(3.1412).unwrap().robot().home[5], 3.1412);
    let text = turned(3.1409).unwrap_err();
    assert!(text.contains("`robot.home_rad`") && text.contains("wrist_3_joint"), "{text}");
}

/// A post beside the foot of an arm that ROS describes: refused from whichever base the settings name, with
/// the paper and the home written for that base.
#[test]
fn a_keep_out_beside_the_foot_is_one_from_every_base() {
    let post = |place: &str| {
        format!(
            "<link name=\"base_link\"/><link name=\"post\"><collision><geometry><sphere \
             radius=\"0.1\"/></geometry></collision></link><joint name=\"t\" type=\"fixed\"><parent \
             link=\"base_link\"/><child link=\"inner\"/><origin rpy=\"0 0 3.14159265\"/></joint><joint \
             name=\"p\" type=\"fixed\"><parent link=\"base_link\"/><child link=\"post\"/><origin xyz=\"{place}\"/></joint></robot>"
        )
    };
    let inner = presets::robot("ur5").unwrap().replace("\"base_link\"", "\"inner\"");
    let of = |place: &str, settings: &str| with_urdf(&inner.replace("</robot>", &post(place)), settings);
    let outside = "home_rad = [0.0, -1.3, 1.8, -2.0708, -1.5708, 0.0]\n";
    let inside = "base_link = \"inner\"\nhome_rad = [0.0, -1.3, 1.8, -2.0708, -1.5708, 0.0]\n[plane]\norigin_m = \
                  [-0.5526, -0.1092, 0.0683]\nx_axis = [0.0, 1.0, 0.0]\n";
    for settings in [outside, inside] {
        let text = of("0.4 0.11 0.45", settings).unwrap_err();
        assert!(text.contains("not clear at robot.home_rad") && text.contains("`post`"), "{text}");
        assert!(of("0.4 1.5 0.45", settings).is_ok());
    }
}

#[test]
fn limits_that_look_like_degrees_and_efforts_that_nobody_stated_are_noted() {
    let notes = |from: &str, to: &str| {
        let text = six("", "");
        assert!(text.contains(from));
        load(&text.replacen(from, to, 1)).unwrap().notes().join("\n")
    };
    let plain = notes("lower=\"-3.1\"", "lower=\"-3.0\"");
    assert!(!plain.contains("degrees") && !plain.contains("effort limit"), "{plain}");
    let far = notes("lower=\"-3.1\" upper=\"3.1\"", "lower=\"-170\" upper=\"170\"");
    assert!(far.contains("look like degrees") && far.contains("`j1` turns to -170 rad"), "{far}");
    let fast = notes("velocity=\"3\"", "velocity=\"360\"");
    assert!(fast.contains("`j1` turns with 360 rad/s"), "{fast}");
    for stated in ["effort=\"0\"", ""] {
        let note = notes("effort=\"100\"", stated);
        assert!(
            note.contains("not known, and contact is not judged") && note.contains("joint `j1`"),
            "{note}"
        );
    }
}

#[test]
fn a_description_in_latin_1_is_read_as_it_declares() {
    let text = six("<!-- Größe in Metern -->", "").replacen("1.0\"?", "1.0\" encoding=\"ISO-8859-1\"?", 1);
    let bytes: Vec<u8> = text.chars().map(|character| u8::try_from(u32::from(character)).unwrap()).collect();
    assert!(std::str::from_utf8(&bytes).is_err());
    let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), bytes)].into()));
    let settings =
        format!("preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.1]\n{WALL}");
    Draft::text(&settings, "t.toml", "/arm").files(files).finish().unwrap_or_else(|why| panic!("{why}"));
}
