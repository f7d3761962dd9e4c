//! Descriptions as others write them: what is not used never refuses an arm, what is used is named with its
//! line.

use crate::arm::{Chain, DynamicsError, Payload};

/// An arm of two joints, a line for each part, with a place for more in the root, the link `l1` and the
/// joint `j1` (line 6).
fn arm(root: &str, link: &str, joint: &str) -> String {
    let inertial = "<inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";
    format!(
        r#"<?xml version="1.0"?>
<robot name="two">
<link name="base"/>
<link name="l1">{inertial}{link}</link>
<link name="l2">{inertial}<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="10"/>{joint}</joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="10"/></joint>
{root}
</robot>"#
    )
}

fn chain(text: &str) -> Result<Chain<2>, String> {
    Chain::from_urdf(text, Some("base"), Some("l2")).map_err(|error| error.to_string())
}

#[test]
fn what_is_not_used_never_refuses_an_arm_and_changes_nothing() {
    let plain = chain(&arm("", "", "")).unwrap();
    let unused_in_root = [
        "<material name=\"a\"/><material name=\"a\"/><material/>",
        "<material name=\"b\"><color rgba=\"1 0\"/><texture/></material>",
        "<gazebo reference=\"l1\"><mu1>0.2</mu1><material>Gazebo/Orange</material><link name=\"x\"/></gazebo>",
        "<gazebo><plugin name=\"p\" filename=\"a.so\"><ros:x>1</ros:x><q a=b c/></plugin></gazebo>",
        "<gazebo><sensor:camera x:y=\"1\"/><controller:gazebo_ros name=\"g\"/></gazebo>",
        "<transmission name=\"t\"><type>transmission_interface/SimpleTransmission</type><joint name=\"j1\"><hardwareInterface>h</hardwareInterface></joint><actuator name=\"m\"/></transmission>",
        "<transmission type=\"SimpleTransmission\" name=\"t\"><joint name=\"nowhere\"/></transmission>",
        "<ros2_control name=\"r\" type=\"system\"><hardware><plugin>x/Y</plugin><param name=\"p\">${a} $(b)</param></hardware><joint name=\"j1\"><command_interface name=\"position\"><param name=\"min\">{-1}</param></command_interface></joint></ros2_control>",
        "<!-- made from <xacro:arm prefix=\"${p}\"/> --><!-- <link name=\"l1\"/> - -- --->",
        "<gazebo><plugin filename=\"${p}\"/><![CDATA[ <xacro:arm/> </robot> ]]></gazebo>",
        "<?pi <xacro:arm/> ?>",
        "<sensor name=\"c\"><parent link=\"nowhere\"/><camera/></sensor><model_state model=\"x\"/>",
        "<link name=\"finger\"><collision/><visual/><inertial/></link><joint name=\"grip\" type=\"prismatic\"><parent link=\"l2\"/><child link=\"finger\"/><limit effort=\"1\"/></joint>",
        "<link name=\"finger\"/><joint name=\"grip\" type=\"revolute\"><parent link=\"l2\"/><child link=\"finger\"/><mimic joint=\"other\" multiplier=\"x\" offset=\"\"/><axis/><origin xyz=\"1\"/></joint>",
        "<link name=\"finger\"/><joint name=\"grip\" type=\"unheard_of\"><parent link=\"l2\"/><child link=\"finger\"/></joint>",
        "<link name=\"finger\"/><link name=\"finger\"/><joint name=\"grip\" type=\"continuous\"><parent link=\"l2\"/><child link=\"finger\"/></joint>",
        "<link name=\"a\u{1b}[31m\"/><joint name=\"\u{fffe}\" type=\"continuous\"><parent link=\"&#27;\"/><child link=\"b\"/></joint>",
        "<link/><link name=\"\"/><link name=\"a&deg;\"/><link name=\"a\" name=\"b\"/><link name=c/>",
        "<link name=\"eye\"/><joint type=\"fixed\"><parent link=\"l2\"/><child link=\"eye\"/></joint>",
        "<link name=\"eye\"/><joint name=\"on\" type=\"fixed\"><child link=\"eye\"/></joint>",
        "<link name=\"eye\"/><joint name=\"on\" type=\"fixed\"><parent link=\"l2\"/><child link=\"eye\"/><origin xyz=\"0 &deg; 0\"/></joint>",
        "<link name=\"lid\"><collision><geometry><box size=\"1 1\u{1}\"/></geometry></collision></link><joint name=\"by\" type=\"revolute\"><child link=\"lid\"/></joint>",
        "<loop_joint name=\"x\" type=\"spherical\"><link1 link=\"l1\"/></loop_joint>",
    ];
    let long = format!("<link name=\"{}\"/>", "n".repeat(1500));
    for unused in unused_in_root.into_iter().chain([long.as_str()]) {
        let found = chain(&arm(unused, "", "")).unwrap_or_else(|why| panic!("{unused}: {why}"));
        assert_eq!(found, plain, "{unused}");
    }
    for unused in [
        "<visual><geometry><box size=\"1 1 1\"/></geometry><material name=\"a\"/><material name=\"b\"/></visual>",
        "<visual/><visual><origin xyz=\"a b\"/><geometry/></visual><visual><geometry><teapot/></geometry></visual>",
        "<visual><geometry><mesh/></geometry></visual>",
        "<self_collision_checking/><contact><lateral_friction value=\"1\"/></contact><drake:x/>",
        "<sensor type=\"force\"/><origin xyz=\"9 9 9\"/>",
    ] {
        let found = chain(&arm("", unused, "")).unwrap_or_else(|why| panic!("{unused}: {why}"));
        assert_eq!(found, plain, "{unused}");
    }
    for unused in [
        "<safety_controller k_position=\"1\"/>",
        "<calibration rising=\"x\"/><calibration/>",
        "<limit_/><hardwareInterface>a</hardwareInterface><disable_default_limit/>",
        "<!-- <limit lower=\"0\"/> -->",
    ] {
        let found = chain(&arm("", "", unused)).unwrap_or_else(|why| panic!("{unused}: {why}"));
        assert_eq!(found, plain, "{unused}");
    }
    for (from, to) in [
        ("<?xml version=\"1.0\"?>\n", "\u{feff}<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"),
        ("<?xml version=\"1.0\"?>\n", "\n <!-- <robot> -->\n<?xml version=\"1.0\"?><!DOCTYPE robot>"),
        ("<robot name=\"two\">", "<robot name=\"two\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">"),
        ("<robot name=\"two\">", "<robot xmlns=\"http://www.ros.org\" xmlns:x=\"y\" x:z=\"${a}\">"),
        ("name=\"j1\" type=\"revolute\"", "type='revolute'\n  name = 'j1' x:y='&z;'"),
        ("name=\"j1\"", "name=\"j&#49;\""),
        ("</robot>", "</robot> <after/> &"),
    ] {
        let text = arm("", "", "");
        assert!(text.contains(from), "{from}");
        let found = chain(&text.replacen(from, to, 1)).unwrap_or_else(|why| panic!("{to}: {why}"));
        assert_eq!(found, plain, "{to}");
    }
}

#[test]
fn the_order_of_links_and_joints_does_not_matter() {
    let text = arm("", "", "");
    let lines: Vec<&str> = text.lines().collect();
    let [head, end] = [&lines[..2], &lines[8..]].map(|part| part.join("\n"));
    let turned: Vec<&str> = lines[2..8].iter().rev().copied().collect();
    assert_eq!(chain(&format!("{head}\n{}\n{end}", turned.join("\n"))), chain(&text));
}

#[test]
fn what_is_used_and_wrong_names_the_joint_or_link_and_its_line() {
    let says = |text: &str, words: &[&str]| {
        let why = chain(text).unwrap_err();
        assert!(words.iter().all(|word| why.contains(word)), "{words:?}: {why}");
    };
    for (from, to, words) in [
        (
            "<axis xyz=\"0 0 1\"/>",
            "<axis xyz=\"0 0\"/>",
            ["joint `j1` (line 6)", "cannot be read", "expected 3"],
        ),
        ("<axis xyz=\"0 0 1\"/>", "<axis/>", ["joint `j1` (line 6)", "cannot be read", "xyz"]),
        ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>", ["joint `j1` (line 6)", "axis", "direction"]),
        ("velocity=\"1\" effort", "effort", ["joint `j1` (line 6)", "velocity limit 0", "give <limit"]),
        ("effort=\"10\"", "effort=\"ten\"", ["joint `j1` (line 6)", "cannot be read", "float"]),
        ("lower=\"-1\"", "lower=\"1\"", ["joint `j1` (line 6)", "upper position limit", "lower < upper"]),
        ("type=\"revolute\"", "type=\"hinge\"", ["joint `j1` (line 6)", "cannot be read", "hinge"]),
        ("type=\"revolute\"", "type=\"prismatic\"", ["joint `j1` (line 6)", "prismatic", "followed"]),
        ("<parent link=\"base\"/>", "", ["joint `j1` (line 6)", "has no <parent", "URDF"]),
        ("<sphere radius=\"0.1\"/>", "<sphere/>", ["link `l2` (line 5)", "cannot be read", "radius"]),
        (
            "<sphere radius=\"0.1\"/>",
            "<sphere radius=\"0\"/>",
            ["link `l2` (line 5)", "not positive", "shape"],
        ),
        ("<sphere radius=\"0.1\"/>", "<teapot/>", ["link `l2` (line 5)", "cannot be read", "URDF"]),
        ("<child link=\"l2\"/>", "<child link=\"l1\"/>", ["link `l2` (line 5)", "is not below", "base"]),
    ] {
        let text = arm("", "", "");
        assert!(text.contains(from), "{from}");
        says(&text.replacen(from, to, 1), &words);
    }
    let again = "<axis xyz=\"0 0 1\"/>";
    says(&arm("", "", again), &["joint `j1` (line 6)", "duplicate"]);
    says(&arm("", "", "<mimic joint=\"j2\"/>"), &["joint `j1` (line 6)", "mimics `j2`"]);
    says(&arm("<link name=\"l1\"/>", "", ""), &["link `l1` (line 4)", "again in line 8"]);
    // A camera that is fixed to the arm belongs to it.
    let camera = "<link name=\"eye\"><collision/></link>\n<joint name=\"on\" type=\"fixed\"><parent link=\"l2\"/><child link=\"eye\"/></joint>";
    says(&arm(camera, "", ""), &["link `eye` (line 8)", "geometry"]);
    let ball = "<collision><geometry><sphere radius=\"1\"/></geometry></collision>";
    let place = camera.replace("<collision/>", ball).replace("</joint>", "<origin xyz=\"\"/></joint>");
    says(&arm(&place, "", ""), &["joint `on` (line 9)", "cannot be read"]);
    // The line of the attribute, where it is not that of the link or joint.
    let far = "\n\n<collision><geometry><sphere radius=\"&deg;\"/></geometry></collision>";
    says(&arm("", far, ""), &["link `l1` (line 4)", "line 6: <sphere radius>"]);
    let escape = arm("", "", "").replacen("name=\"j1\"", "name=\"j\u{1b}1\"", 1);
    says(&escape, &["joint without a name that can be used (line 6)", "<joint name>: U+001B"]);
    assert!(!chain(&escape).unwrap_err().contains('\u{1b}'));
}

#[test]
fn numbers_that_a_type_of_joint_does_not_use_are_not_read() {
    let fixed = "<link name=\"eye\"/><joint name=\"on\" type=\"fixed\"><parent link=\"l2\"/><child link=\"eye\"/><axis/><limit/><mimic/><dynamics damping=\"\"/></joint>";
    assert!(chain(&arm(fixed, "", "")).is_ok());
    let endless = arm("", "", "").replacen("revolute", "continuous", 1).replacen(
        "lower=\"-1\" upper=\"1\"",
        "lower=\"-inf\" upper=\"none\"",
        1,
    );
    assert_eq!(chain(&endless).unwrap().limits().position[0], [-f64::INFINITY, f64::INFINITY]);
    let why = chain(&endless.replacen("velocity=\"1\"", "", 1)).unwrap_err();
    assert!(why.contains("joint `j1` (line 6)") && why.contains("velocity limit"), "{why}");
}

#[test]
fn meshes_are_no_shapes_and_their_files_are_not_looked_at() {
    let meshed = "<collision><geometry><mesh/></geometry></collision><collision><geometry><mesh filename=\"package://a/${b}.dae\" scale=\"1\"/></geometry></collision>";
    assert_eq!(chain(&arm("", meshed, "")).unwrap().mesh_links(), ["l1"]);
    // Whoever opens them needs them right.
    let why = crate::arm::description(&arm("", "<collision><geometry><mesh/></geometry></collision>", ""));
    let why = why.map(|_| ()).unwrap_err().to_string();
    assert!(why.contains("link `l1` (line 4)") && why.contains("filename"), "{why}");
    let shown = "<visual/><visual><origin xyz=\"0 0\"/></visual><visual><geometry><mesh filename=\"a.stl\"/></geometry><material/><material/></visual>";
    let robot = crate::arm::description(&arm("<material/>", shown, "")).unwrap();
    assert_eq!(robot.links[1].visual.len(), 1);
    // Where a link has collision geometry its visuals are not used, whatever they are.
    let both = format!(
        "{shown}<visual><geometry/></visual><collision><geometry><sphere radius=\"1\"/></geometry></collision>"
    );
    assert!(crate::arm::description(&arm("", &both, "")).unwrap().links[1].visual.is_empty());
}

/// The arm follows; only what is asked about torques says which link has no masses, and why.
#[test]
fn inertials_that_cannot_be_read_leave_the_torques_unknown_and_nothing_else() {
    let whole = arm("", "", "");
    let plain = chain(&whole).unwrap();
    let good = "<inertial><mass value=\"1\"/>";
    for (from, to, words) in [
        (good, "<inertial>", "mass"),
        ("<mass value=\"1\"/>", "<mass/>", "value"),
        ("ixx=\"1\" ", "", "ixx"),
        ("izz=\"1\"", "izz=\"a\"", "float"),
        (good, "<inertial/><inertial><mass value=\"1\"/>", "2 times"),
        ("<mass value=\"1\"/>", "<mass value=\"-1\"/>", "below 0"),
        ("<inertia ixx", "<inertia_ ixx", "inertia"),
    ] {
        let found = chain(&whole.replacen(from, to, 1)).unwrap_or_else(|why| panic!("{to}: {why}"));
        assert_eq!(
            (found.forward(&[0.3, 0.4]), found.limits()),
            (plain.forward(&[0.3, 0.4]), plain.limits())
        );
        let error = found.dynamics(&Payload::NONE).unwrap_err();
        assert!(
            matches!(&error, DynamicsError::Inertial { link, .. } if link.name == "l1" && link.line == 4)
        );
        assert!(error.to_string().contains(words), "{words}: {error}");
    }
}

#[test]
fn a_file_of_macros_is_recognised_where_xacro_itself_would_act() {
    for (root, line) in [
        ("<xacro:include filename=\"a\"/>", 8),
        ("\n<gazebo><xacro:insert_block name=\"a\"/></gazebo>", 9),
        ("<link name=\"${prefix}base\"/>", 8),
        ("<link name='$(arg prefix)base'/>", 8),
        ("<link name=\"tool_${n}\"/>", 8),
    ] {
        let why = chain(&arm(root, "", "")).unwrap_err();
        assert!(why.contains("xacro FILE > robot.urdf") && why.contains(&format!("line {line})")), "{why}");
    }
    // Under any prefix that is bound to its namespace, where it is bound.
    for (root, refused) in [
        ("<x:include xmlns:x=\"http://www.ros.org/wiki/xacro\" filename=\"a\"/>", true),
        ("<a xmlns:x=\"http://ros.org/wiki/xacro/\"><b><x:if value=\"1\"/></b></a>", true),
        ("<include xmlns=\"http://wiki.ros.org/xacro\" filename=\"a\"/>", true),
        ("<a xmlns:x=\"http://www.ros.org/wiki/xacro\"/><x:if value=\"1\"/>", false),
        ("<a xmlns:x=\"http://www.ros.org/wiki/xacro\"><x:if xmlns:x=\"http://a.org/b\"/></a>", false),
        ("<a xmlns:x=\"http://www.ros.org/wiki/xacro\"><xx:if/><if/></a>", false),
    ] {
        let found = chain(&arm(root, "", ""));
        assert_eq!(found.is_err(), refused, "{root}");
        assert!(found.err().is_none_or(|why| why.contains("xacro FILE > robot.urdf")), "{root}");
    }
}

#[test]
fn still_links_are_those_before_the_first_joint_with_their_frames() {
    let world = "<link name=\"world\"/><joint name=\"w\" type=\"fixed\"><parent link=\"world\"/><child link=\"base\"/><origin xyz=\"1 0 0\" rpy=\"0 0 3.14159265358979\"/></joint>";
    let found = Chain::<2>::from_urdf(&arm(world, "", ""), Some("world"), Some("l2")).unwrap();
    let names: Vec<&str> = found.still_links().iter().map(|link| link.name.as_str()).collect();
    assert_eq!(names, ["world", "base"]);
    let base = &found.still_links()[1];
    assert_eq!((base.translation.x, base.rotation[(0, 0)]), (1.0, -1.0));
}
