//! The arm that settings and URDF describe, and the plane it has to reach.

use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::Vector3;

use super::over_ur5;
use crate::{Config, presets};

/// The preset's pen, written again for a description of one's own.
const TOOL: &str = "tool_m = [0.0, 0.0, 0.15]\n";

/// The UR5 preset with a URDF of its own next to the settings file.
pub(super) fn with_urdf(urdf: &str, more: &str) -> Result<Config, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.urdf"), urdf).unwrap();
    let path = folder.path().join("table.toml");
    std::fs::write(&path, format!("preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\n{TOOL}{more}")).unwrap();
    Config::load(&path).map_err(|error| error.to_string())
}

#[test]
fn home_of_each_preset_holds_the_pen_lifted_over_the_planes_origin() {
    for name in ["ur5", "ur5e"] {
        let config = Config::preset(name).unwrap();
        let (robot, plane) = (config.robot(), &config.settings().plane);
        let tool = robot.chain.forward(&robot.home);
        let wanted =
            Vector3::from(plane.origin_m) + plane.rotation() * Vector3::new(0.0, 0.0, plane.lift_height_m);
        // Home and origin are written with four digits.
        assert!((tool.position - wanted).norm() < 5e-4, "{name}: {} {}", tool.position, wanted);
        let axis = tool.rotation.column(2).into_owned();
        assert!((axis + plane.rotation() * Vector3::z()).norm() < 1e-3, "{name}: {axis}");
    }
}

#[test]
fn axes_of_the_plane_are_x_and_normal_made_orthonormal() {
    let config = over_ur5("[plane]\nx_axis = [0.0, -0.99999, 0.005]\n").unwrap();
    let rotation = config.settings().plane.rotation();
    let error = rotation.matrix().transpose() * rotation.matrix() - nalgebra::Matrix3::identity();
    assert!(error.norm() < 1e-14, "{error}");
    assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-14);
    assert_eq!(rotation * Vector3::z(), Vector3::z());
    // Hand-worked: with x to the robot's right and the normal up, y = normal × x points away from the base.
    assert!((rotation * Vector3::y() - Vector3::x()).norm() < 1e-2);
}

#[test]
fn unreachable_workspace_names_the_corner_and_what_to_do() {
    let error = over_ur5("[plane]\nworkspace_m = [[-0.1, 0.9], [-0.1, 0.1], [-0.005, 0.06]]\n").unwrap_err();
    let text = error.to_string();
    assert_eq!(error.problems().len(), 1, "{text}");
    assert!(text.contains("table.toml:3: key `plane.workspace_m`") && text.contains("x = 0.9"), "{text}");
    assert!(text.contains("out of reach") && text.contains("make the workspace smaller"), "{text}");
}

#[test]
fn plane_far_away_names_the_middle_and_where_the_tool_is() {
    let text = over_ur5("[plane]\norigin_m = [2.0, 0.0, 0.2]\n").unwrap_err().to_string();
    assert!(text.contains("key `plane.origin_m`") && text.contains("[2.000, 0.000, 0.210]"), "{text}");
    assert!(text.contains("home puts the tool at [0.553"), "{text}");
}

#[test]
fn corner_behind_a_narrowed_joint_limit_names_the_joint() {
    let narrow = "position_min_rad = [3.0, -2.5, 1.0, -3.0, -2.0, -3.0]\nposition_max_rad = [3.3, -0.5, 2.8, \
                  -1.0, -1.0, 3.0]\n";
    let text = over_ur5(&format!("[robot]\n{narrow}")).unwrap_err().to_string();
    assert!(text.contains("`plane.workspace_m`") && text.contains("shoulder_pan_joint"), "{text}");
}

#[test]
fn reachable_corners_are_reached_by_the_solver_that_judged_them() {
    let config = Config::preset("ur5").unwrap();
    let (robot, plane) = (config.robot(), &config.settings().plane);
    let corner = Vector3::from(plane.origin_m) + plane.rotation() * Vector3::new(0.15, -0.1, 0.0);
    let axis = -(plane.rotation() * Vector3::z());
    let q = solve_pose(&robot.chain, &robot.home, &ToolTarget::at_rest(corner, axis, None)).unwrap();
    assert!((robot.chain.forward(&q).position - corner).norm() < 1e-8);
}

#[test]
fn the_narrower_of_urdf_and_settings_counts() {
    let config = over_ur5(
        "[robot]\nvelocity_radps = [1, 9, 1, 1, 1, 1]\nposition_min_rad = [-6.3, -2.5, -6.3, -6.3, -6.3, \
         -6.3]\n",
    )
    .unwrap();
    let limits = config.robot().limits;
    assert_eq!(limits.velocity()[0], 1.0);
    assert_eq!(limits.velocity()[1], std::f64::consts::PI);
    assert_eq!(limits.position()[1][0], -2.5);
    assert_eq!(limits.position()[2], [-std::f64::consts::PI, std::f64::consts::PI]);
}

#[test]
fn consumers_brake_after_the_valid_periods_at_the_configured_deceleration() {
    let limits = over_ur5("[loop]\nvalid_periods = 10\n").unwrap().robot().limits;
    assert!((limits.hold_s() - 0.02).abs() < 1e-15);
    assert_eq!(limits.deceleration(), &[20.0; 6]);
    let slower =
        over_ur5("[robot]\nstale_deceleration_radps2 = [5, 5, 5, 5, 5, 5]\n").unwrap().robot().limits;
    assert_eq!(slower.deceleration(), &[5.0; 6]);
    let text =
        over_ur5("[robot]\nstale_deceleration_radps2 = [50, 5, 5, 5, 5, 5]\n").unwrap_err().to_string();
    assert!(text.contains("`robot.stale_deceleration_radps2`"), "{text}");
    // A lower acceleration alone: the preset's braking would be more than the arm may.
    let text = over_ur5("[robot]\nacceleration_radps2 = [5, 5, 5, 5, 5, 5]\n").unwrap_err().to_string();
    for wanted in ["`robot.stale_deceleration_radps2`", "really brakes", "at most robot.acceleration_radps2"]
    {
        assert!(text.contains(wanted), "{wanted}: {text}");
    }
}

#[test]
fn lists_of_another_length_than_the_arm_name_its_joints() {
    let text = over_ur5("[robot]\nhome_rad = [0, 0, 0]\nvelocity_radps = [1]\n").unwrap_err().to_string();
    assert!(text.contains("has 3 numbers for the 6 joints") && text.contains("wrist_3_joint"), "{text}");
    assert!(text.contains("has 1 numbers for the 6 joints"), "{text}");
}

#[test]
fn home_outside_the_limits_names_the_joint() {
    let text =
        over_ur5("[robot]\nhome_rad = [3.1416, -1.5, 4.0, -2.1708, -1.5708, 0.0]\n").unwrap_err().to_string();
    assert!(
        text.contains("`robot.home_rad`") && text.contains("elbow_joint") && text.contains("3.1416 rad"),
        "{text}"
    );
}

#[test]
fn empty_range_of_a_joint_is_refused() {
    let text = over_ur5("[robot]\nposition_max_rad = [6, 6, -6, 6, 6, 6]\n").unwrap_err().to_string();
    assert!(text.contains("`robot.position_max_rad`") && text.contains("elbow_joint"), "{text}");
}

#[test]
fn urdf_is_found_beside_the_settings_file_and_shown_with_its_whole_path() {
    let config = with_urdf(presets::robot("ur5").unwrap(), "").unwrap();
    assert!(config.settings().robot.urdf.ends_with("arm.urdf"));
    assert!(std::path::Path::new(&config.settings().robot.urdf).is_absolute());
    assert_eq!(config.robot(), Config::preset("ur5").unwrap().robot());
}

#[test]
fn wrong_urdfs_say_what_is_wrong_with_them() {
    let text = over_ur5("[robot]\nurdf = \"ur55\"\n").unwrap_err().to_string();
    assert!(
        text.contains("table.toml:3") && text.contains("\"ur5e\"") && text.contains("readable file"),
        "{text}"
    );
    let text = with_urdf("<robot", "").unwrap_err();
    assert!(text.contains("`robot.urdf`") && text.contains("cannot be used"), "{text}");
    let text = with_urdf(presets::robot("ur5").unwrap(), "tip_link = \"tool\"\n").unwrap_err();
    assert!(text.contains("`tool`") && text.contains("tool0"), "{text}");
    let text = with_urdf(presets::robot("ur5").unwrap(), "tip_link = \"wrist_1\"\n").unwrap_err();
    assert!(text.contains("4 moving joints") && text.contains("6 are needed"), "{text}");
}

#[test]
fn a_seventh_joint_is_refused_with_where_the_reason_stands_and_a_xacro_file_is_recognised() {
    let joint = r#"<link name="l7"/><joint name="j7" type="revolute"><parent link="tool0"/><child link="l7"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"#;
    let seven = presets::robot("ur5").unwrap().replace("</robot>", joint);
    let text = with_urdf(&seven, "tip_link = \"l7\"\n").unwrap_err();
    assert!(text.contains("7 moving joints") && text.contains("docs/extend/arm.md"), "{text}");
    for macros in ["<xacro:include filename=\"a\"/>", "<link name=\"${prefix}base\"/>"] {
        let text = with_urdf(&format!("<robot name=\"a\">{macros}</robot>"), "").unwrap_err();
        assert!(text.contains("xacro FILE > robot.urdf") && !text.contains("the links are"), "{text}");
    }
    let text = with_urdf("<robot name=\"a\"/>", "").unwrap_err();
    assert!(text.contains("no links"), "{text}");
}

#[test]
fn links_with_meshes_only_are_named_although_nothing_else_is_kept_away_from() {
    let whole = presets::robot("ur5").unwrap();
    let meshed = |count: usize| {
        // Its head is a comment that speaks of collision geometry.
        let (head, body) = whole.split_once("-->").unwrap();
        let (mut left, mut out) = (body.to_owned(), format!("{head}-->"));
        for _ in 0..count {
            let (Some(begin), Some(end)) = (left.find("<collision"), left.find("</collision>")) else {
                break;
            };
            out += &left[..begin];
            out += "<collision><geometry><mesh filename=\"a.stl\"/></geometry></collision>";
            left = left[end + "</collision>".len()..].to_owned();
        }
        out + &left
    };
    let remark = |urdf: &str, more: &str| {
        let remarks = with_urdf(urdf, more).unwrap().remarks();
        remarks.into_iter().find(|remark| remark.contains("clearance.itself"))
    };
    assert_eq!(remark(whole, ""), None);
    let base = whole.split_once("-->").and_then(|(_, body)| body.split("</link>").next()).unwrap();
    let some = remark(&meshed(base.matches("<collision>").count()), "").unwrap();
    assert!(
        some.contains("base_link") && !some.contains("forearm") && some.contains("config shapes"),
        "{some}"
    );
    let all = remark(&meshed(99), "").unwrap();
    assert!(all.contains("have only meshes") && all.contains("forearm, wrist_1"), "{all}");
    assert_eq!(remark(&meshed(99), "[clearance]\nitself = false\n"), None);
    let bare =
        meshed(99).replace("<collision><geometry><mesh filename=\"a.stl\"/></geometry></collision>", "");
    assert!(remark(&bare, "").unwrap().contains("no link of the URDF has collision geometry"));
}

#[test]
fn a_changed_urdf_file_needs_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let (urdf, path) = (folder.path().join("arm.urdf"), folder.path().join("table.toml"));
    std::fs::write(&path, format!("preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\n{TOOL}")).unwrap();
    std::fs::write(&urdf, presets::robot("ur5").unwrap()).unwrap();
    let before = Config::load(&path).unwrap();
    std::fs::write(&urdf, presets::robot("ur5").unwrap().replace("0.0823", "0.0833")).unwrap();
    let refused = before.live_diff(&Config::load(&path).unwrap()).unwrap_err();
    assert_eq!(refused.len(), 1);
    assert!(refused[0].to_string().contains("robot.urdf"), "{}", refused[0]);
}

#[test]
fn a_table_under_the_arm_and_a_box_beside_it_are_kept_away_from() {
    let written = "[clearance]\nplanes_m = [[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]\nboxes_m = [[[0.0, 0.8, \
                   0.2], [0.2, 0.2, 0.4], [0.0, 0.0, 0.3]]]\n";
    let config = over_ur5(written).unwrap();
    let clearance = config.robot().clearance.clone().unwrap();
    assert_eq!((clearance.obstacles.len(), clearance.itself, clearance.margin_m), (2, true, 0.01));
    let preset = Config::preset("ur5e").unwrap();
    assert!(preset.robot().clearance.as_ref().unwrap().obstacles.is_empty());
    let none = over_ur5("[clearance]\nitself = false\n").unwrap();
    assert_eq!(none.robot().clearance, None);
}

#[test]
fn a_home_that_is_not_clear_names_the_link_and_by_how_much() {
    let before = over_ur5("[clearance]\nplanes_m = [[[0.47, 0.0, 0.0], [-1.0, 0.0, 0.0]]]\n").unwrap_err();
    let text = before.to_string();
    assert!(text.contains("key `clearance.planes_m`") && text.contains("plane number 0"), "{text}");
    assert!(text.contains("link `wrist_") && text.contains("less than clearance.margin_m"), "{text}");
}

#[test]
fn a_plane_without_direction_and_an_arm_without_shape_are_refused() {
    let text =
        over_ur5("[clearance]\nplanes_m = [[[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]]\n").unwrap_err().to_string();
    assert!(text.contains("key `clearance.planes_m`") && text.contains("length 2.0000"), "{text}");
    let bare = presets::robot("ur5").unwrap().replace("collision>", "visual>");
    let plane = "[clearance]\nplanes_m = [[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]\n";
    let text = with_urdf(&bare, plane).unwrap_err();
    assert!(text.contains("key `clearance.planes_m`") && text.contains("collision geometry"), "{text}");
    assert!(with_urdf(&bare, "").is_ok(), "without planes or boxes a bare description still does");
}

#[test]
fn a_tool_moves_the_tip_along_the_pen_and_has_to_leave_the_plane_in_reach() {
    let config =
        over_ur5("[robot]\ntool_m = [0.0, 0.0, 0.05]\n[plane]\norigin_m = [0.5526, 0.1092, 0.1683]\n")
            .unwrap();
    let preset = Config::preset("ur5").unwrap();
    let (short, long) = (config.robot(), preset.robot());
    let [a, b] = [short, long].map(|robot| robot.chain.forward(&robot.home));
    let along = a.position - b.position;
    assert!((along + b.rotation.column(2) * 0.1).norm() < 1e-12, "{along}");
    assert_eq!(a.rotation, b.rotation);
    let text = over_ur5("[robot]\ntool_m = [0.0, 0.0, 0.6]\n").unwrap_err().to_string();
    assert!(text.contains("`robot.tool_m[2]` = 0.6") && text.contains("-0.5 to 0.5"), "{text}");
}

#[test]
fn an_arm_of_ones_own_does_not_inherit_the_presets_pen() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.urdf"), presets::robot("ur5").unwrap()).unwrap();
    let path = folder.path().join("table.toml");
    let load = |robot: &str| {
        std::fs::write(&path, format!("preset = \"ur5\"\n[robot]\n{robot}")).unwrap();
        Config::load(&path).map(|_| ()).map_err(|error| error.to_string())
    };
    for (robot, key) in [("urdf = \"arm.urdf\"\n", "urdf"), ("tip_link = \"tool0\"\n", "tip_link")] {
        let text = load(robot).unwrap_err();
        assert!(text.contains(&format!("table.toml:3: key `robot.{key}`")), "{text}");
        assert!(
            text.contains("the preset's robot.tool_m = [0.0, 0.0, 0.15]")
                && text.contains("if that link is the tip"),
            "{text}"
        );
        assert_eq!(load(&format!("{robot}{TOOL}")), Ok(()));
    }
    assert_eq!(load("urdf = \"ur5\"\n"), Ok(()), "an embedded arm has the same flange");
}

#[test]
fn a_home_where_the_arm_can_never_be_armed_is_refused() {
    let refused = |text: &str| over_ur5(text).unwrap_err().to_string();
    let below = refused("[robot]\ntool_m = [0.0, 0.0, 0.4]\n");
    for words in ["key `robot.home_rad`", "-0.240] m in the plane's frame", "can never be armed"] {
        assert!(below.contains(words), "{words}: {below}");
    }
    let tilted = refused(
        "[robot]\ntool_m = [0.0, 0.0, 0.15]\n[safety]\narm_max_tilt_rad = 0.3\n[plane]\nnormal = [0.0, 0.35, \
         0.93675]\nx_axis = [0.0, -0.93675, 0.35]\n",
    );
    assert!(tilted.contains("tilted by 0.358 rad"), "{tilted}");
    // A paper beside the arm that the settings were written for.
    let beside = refused("[plane]\norigin_m = [0.416, -0.114, 0.068]\n");
    assert!(beside.contains("choose robot.home_rad, robot.tool_m and plane.origin_m together"), "{beside}");
}

#[test]
fn a_pen_presses_no_deeper_than_the_workspace_and_the_message_says_how_deep_that_must_be() {
    let deep = "[plane]\npress_m = 0.001\n";
    let text = over_ur5(deep).unwrap_err().to_string();
    assert!(text.contains("key `plane.press_m`") && text.contains("0.0005 m below it"), "{text}");
    assert!(text.contains("z range begin at -0.0015 m"), "{text}");
    let reached = format!("{deep}workspace_m = [[-0.15, 0.15], [-0.1, 0.1], [-0.0015, 0.06]]\n");
    assert!(over_ur5(&reached).is_ok());
    // As deep as the workspace is, and not a hundredth of a millimetre more.
    assert!(over_ur5("[plane]\npress_m = 0.0005\n").is_ok());
    assert!(over_ur5("[plane]\npress_m = 0.00051\n").is_err());
    let text = over_ur5("[plane]\npress_m = 0.5\n").unwrap_err().to_string();
    assert!(text.contains("outside 0 to 0.005 m") && text.contains("looks like mm"), "{text}");
}

/// The pen of `config/robots/ur5.urdf` has no shape. This one ends 15 mm above its tip, 10.3 mm above a ledge
/// when the tip is on the paper.
#[test]
fn a_pen_that_would_press_its_shape_into_a_keep_out_names_the_link_and_by_how_much() {
    let shape = "<link name=\"pen\"><collision><origin xyz=\"0 0 0.13\"/><geometry><sphere radius=\"0.005\"/></geometry>\
                 </collision></link><joint name=\"held\" type=\"fixed\"><parent link=\"tool0\"/><child \
                 link=\"pen\"/></joint></robot>";
    let urdf = presets::robot("ur5").unwrap().replace("</robot>", shape);
    let paper_m = Config::preset("ur5").unwrap().settings().plane.origin_m[2];
    let ledge_m = paper_m + 0.015 - 0.0103;
    let pressing = |press_m: f64| {
        let ledge = format!("planes_m = [[[0.0, 0.0, {ledge_m}], [0.0, 0.0, 1.0]]]\n");
        with_urdf(&urdf, &format!("[plane]\npress_m = {press_m}\n[clearance]\nmargin_m = 0.01\n{ledge}"))
    };
    pressing(0.0).unwrap();
    pressing(0.0002).unwrap();
    let text = pressing(0.0005).unwrap_err();
    assert!(text.contains("key `plane.press_m`") && text.contains("brings link `pen`"), "{text}");
    assert!(text.contains("0.0002 m less than clearance.margin_m = 0.01"), "{text}");
}
