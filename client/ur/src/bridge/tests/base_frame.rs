//! ROS's descriptions of Universal Robots arms: a base frame that is turned against the controller's.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;
use std::sync::Arc;

use foretrace_config::files::Files;
use foretrace_config::{Config, Draft, presets};

use super::super::check::{CheckRefusal, model};
use super::super::kinematics::{DhParameters, deviation};

const UR5: DhParameters = DhParameters {
    theta: [0.0; 6],
    a: [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0],
    d: [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823],
    alpha: [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0],
};

/// The embedded UR5 behind a link `base_link` that is turned by `yaw` \[rad\] against `inner`, the
/// controller's frame, and beside a leaf `base` with that frame as well, as ROS has it.
fn ros(inner: &str, yaw: f64, home: f64, robot: &str) -> Config {
    let more = format!(
        "<link name=\"base_link\"/><joint name=\"turn\" type=\"fixed\"><parent \
         link=\"base_link\"/><child link=\"{inner}\"/><origin \
         xyz=\"0 0 0\" rpy=\"0 0 {yaw}\"/></joint><link name=\"leaf\"/><joint name=\"side\" type=\"fixed\"><parent \
         link=\"base_link\"/><child link=\"leaf\"/><origin rpy=\"0 0 {yaw}\"/></joint></robot>"
    );
    let embedded = presets::robot("ur5").unwrap().replace("\"base_link\"", &format!("\"{inner}\""));
    let urdf = embedded.replace("</robot>", &more);
    let text = format!(
        "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\nhome_rad = [{home}, -1.3, 1.8, -2.0708, \
         -1.5708, 0.0]\n{robot}"
    );
    let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), urdf.into_bytes())].into()));
    Draft::text(&text, "t.toml", "/arm").files(files).finish().unwrap()
}

fn judged(dh: &DhParameters, config: &Config) -> Result<(), CheckRefusal> {
    model(deviation(dh, config).as_ref(), Some("a UR5"), config)
}

#[test]
fn a_turned_base_frame_is_refused_with_the_line_to_write_and_followed_where_it_is_written() {
    for (inner, yaw) in [("base", PI), ("base_link_inertia", -PI + 3e-6)] {
        let config = ros(inner, yaw, 0.0, "");
        let refusal = judged(&UR5, &config).unwrap_err();
        let text = refusal.to_string();
        for words in [
            "`base_link`, is turned by 180 degrees about z",
            "write `base_turned = true` under [robot.ur]",
            &format!("write `base_link = \"{inner}\"` under [robot]"),
        ] {
            assert!(text.contains(words), "{words}: {text}");
        }
        let note = config.notes().into_iter().find(|note| note.contains("180 degrees about z")).unwrap();
        assert!(note.contains(&format!("base_link = \"{inner}\"")), "{note}");
        // Either line ends it: the first keeps the settings' frame, the second takes the controller's.
        let said = ros(inner, yaw, 0.0, "[robot.ur]\nbase_turned = true\n");
        assert_eq!(judged(&UR5, &said), Ok(()));
        assert!(deviation(&UR5, &said).unwrap().most_mm < 0.01);
        assert!(!said.notes().iter().any(|note| note.contains("180 degrees")));
        let inside = ros(inner, yaw, PI, &format!("base_link = \"{inner}\"\n"));
        assert_eq!(judged(&UR5, &inside), Ok(()));
        assert!(!inside.notes().iter().any(|note| note.contains("180 degrees")));
    }
}

#[test]
fn only_a_half_turn_about_z_is_taken_for_one() {
    let mut other = UR5;
    other.a[1] = -0.612;
    other.a[2] = -0.5723;
    assert!(matches!(judged(&other, &ros("base", PI, 0.0, "")), Err(CheckRefusal::Model { .. })));
    // A quarter turn is somebody's own table: no line of ours makes that right.
    let quarter = ros("base", FRAC_PI_2, FRAC_PI_2, "");
    assert!(matches!(judged(&UR5, &quarter), Err(CheckRefusal::Model { .. })));
    // The settings say turned, and the model is not.
    let text = "preset = \"ur5\"\n[robot.ur]\nbase_turned = true\n";
    let config = Config::parse(text, "t.toml", ".").unwrap();
    let refusal = judged(&UR5, &config).unwrap_err().to_string();
    assert!(refusal.contains("`base_turned = false` under [robot.ur]"), "{refusal}");
}

/// A description without a link in the controller's frame: one line is left.
#[test]
fn a_half_turn_inside_the_first_joint_leaves_one_line_to_write() {
    let turned = presets::robot("ur5").unwrap().replacen(
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 0\"/>",
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 3.141592653589793\"/>",
        1,
    );
    let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), turned.into_bytes())].into()));
    let text = "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\nhome_rad = [0.0, -1.3, 1.8, \
                -2.0708, -1.5708, 0.0]\n";
    let load = |more: &str| {
        Draft::text(&format!("{text}{more}"), "t.toml", "/arm").files(files.clone()).finish().unwrap()
    };
    let refusal = judged(&UR5, &load("")).unwrap_err().to_string();
    assert!(
        refusal.contains("base_turned = true") && refusal.contains("no link in the controller's"),
        "{refusal}"
    );
    assert_eq!(judged(&UR5, &load("[robot.ur]\nbase_turned = true\n")), Ok(()));
}
