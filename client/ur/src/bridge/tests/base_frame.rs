//! ROS's descriptions of Universal Robots arms: a base frame that is turned against the controller's.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;
use std::sync::Arc;

use foretrace_config::files::Files;
use foretrace_config::{Config, Draft, presets};

use super::super::check::{CheckRefusal, model};
use super::super::kinematics::{DhParameters, deviation, tool_from_flange};

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
    model(Some(dh), deviation(dh, config).as_ref(), Some("a UR5"), config)
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
    // A quarter turn is somebody's own table: only the link inside is right.
    let quarter = ros("base", FRAC_PI_2, FRAC_PI_2, "");
    let refusal = judged(&UR5, &quarter).unwrap_err();
    assert!(
        matches!(&refusal, CheckRefusal::AnotherBase { link, turned: false, .. } if link == "base"),
        "{refusal}"
    );
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
        refusal.contains("base_turned = true") && refusal.contains("no link that is fixed to it stands as"),
        "{refusal}"
    );
    assert_eq!(judged(&UR5, &load("[robot.ur]\nbase_turned = true\n")), Ok(()));
}

/// The embedded UR5 with `change` made to its text and `more` at its end, in settings over the preset.
fn changed(change: (&str, &str), more: &str, robot: &str) -> Config {
    let embedded = presets::robot("ur5").unwrap();
    assert!(embedded.contains(change.0), "{}", change.0);
    let urdf = embedded.replace(change.0, change.1).replace("</robot>", &format!("{more}</robot>"));
    let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), urdf.into_bytes())].into()));
    let text = format!("preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\n{robot}");
    Draft::text(&text, "t.toml", "/arm").files(files).finish().unwrap()
}

fn fixed(parent: &str, child: &str, origin: &str) -> String {
    format!(
        "<joint name=\"to_{child}\" type=\"fixed\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin \
         {origin}/></joint>"
    )
}

const HOME: [&str; 2] = [
    "home_rad = [0.0, -1.3, 1.8, -2.0708, -1.5708, 0.0]\n",
    "home_rad = [3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0]\n",
];
const TOOL: &str = "tool_m = [0.0, 0.0, 0.15]\n";

/// A table below the arm, whatever is turned above it: the link that fits is named, and is taken then.
#[test]
fn a_base_that_stands_elsewhere_is_refused_with_the_link_that_is_the_controllers() {
    let below = "<link name=\"world\"/>".to_owned() + &fixed("world", "base_link", "xyz=\"0 0 0.3\"");
    let high = "[plane]\norigin_m = [0.553, 0.109, 0.368]\n";
    let ros = "<link name=\"base_link\"/><link name=\"base\"/>".to_owned()
        + &fixed("base_link", "inner", "rpy=\"0 0 3.14159265\"")
        + &fixed("base_link", "base", "rpy=\"0 0 3.14159265\"");
    let inner = ("\"base_link\"", "\"inner\"");
    let same = ("\"base_link\"", "\"base_link\"");
    let inside = (
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 0\"/>",
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 3.14159265\"/>",
    );
    for (change, more, home, link, turned) in [
        (inner, ros + &below, HOME[0], "inner", false),
        (same, below.clone(), HOME[1], "base_link", false),
        (inside, below, HOME[0], "base_link", true),
    ] {
        let load = |base: &str, home: &str, rest: &str| {
            changed(change, &more, &format!("{TOOL}{home}base_link = \"{base}\"\n{rest}"))
        };
        for said in ["", "[robot.ur]\nbase_turned = true\n"] {
            let refusal = judged(&UR5, &load("world", home, &format!("{said}{high}"))).unwrap_err();
            let words = refusal.to_string();
            assert!(matches!(refusal, CheckRefusal::AnotherBase { .. }), "{words}");
            for word in [
                "link `world`, is not the controller's".to_owned(),
                format!("write `base_link = \"{link}\"` under [robot], `base_turned = {turned}`"),
            ] {
                assert!(words.contains(&word), "{word}: {words}");
            }
        }
        let (home, said) = if turned { (HOME[0], "[robot.ur]\nbase_turned = true\n") } else { (HOME[1], "") };
        let followed = load(link, home, said);
        assert_eq!(judged(&UR5, &followed), Ok(()), "{link}");
        assert!(deviation(&UR5, &followed).unwrap().most_mm < 0.1);
    }
}

/// The leaf `base` of ROS's descriptions, without the link inside that has the arm below it.
#[test]
fn a_leaf_in_the_controllers_frame_can_be_the_base() {
    let change = (
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 0\"/>",
        "<origin xyz=\"0 0 0.089159\" rpy=\"0 0 3.14159265\"/>",
    );
    let more = "<link name=\"base\"/>".to_owned() + &fixed("base_link", "base", "rpy=\"0 0 -3.14159265\"");
    let plain = changed(change, &more, &format!("{TOOL}{}", HOME[0]));
    let refusal = judged(&UR5, &plain).unwrap_err().to_string();
    assert!(refusal.contains("write `base_link = \"base\"` under [robot]"), "{refusal}");
    assert!(plain.notes().iter().any(|note| note.contains("base_link = \"base\"")));
    let leaf = changed(change, &more, &format!("{TOOL}{}base_link = \"base\"\n", HOME[1]));
    assert_eq!(judged(&UR5, &leaf), Ok(()));
    assert!(deviation(&UR5, &leaf).unwrap().most_mm < 0.1);
    // The other way round `base_link` is turned, but not below: nobody is told to go there.
    assert!(!leaf.notes().iter().any(|note| note.contains("180 degrees")), "{:?}", leaf.notes());
}

/// A pen as a link of the description is no other model of arm, and is not lost.
#[test]
fn a_tool_that_is_a_link_is_seen_from_the_flange() {
    let same = ("\"base_link\"", "\"base_link\"");
    let pen = |parent: &str, origin: &str| "<link name=\"pen\"/>".to_owned() + &fixed(parent, "pen", origin);
    let load =
        |more: &str, tool: &str| changed(same, more, &format!("{tool}{}tip_link = \"pen\"\n", HOME[1]));
    for (more, tool) in [
        (pen("tool0", "xyz=\"0 0 0.15\""), "tool_m = [0.0, 0.0, 0.0]\n"),
        (pen("tool0", "xyz=\"0 0 0.1\" rpy=\"0 0 1\""), "tool_m = [0.0, 0.0, 0.05]\n"),
        // Beside tool0, which then is no link on the way.
        (pen("wrist_3", "xyz=\"0 0 0.15\""), "tool_m = [0.0, 0.0, 0.0]\n"),
    ] {
        let config = load(&more, tool);
        let off = deviation(&UR5, &config).unwrap().most_mm;
        assert!(off < 1.0, "{more}: {off} mm");
        let [x, y, z] = tool_from_flange(&UR5, &config, 30.0).unwrap();
        assert!(x.abs() < 1e-3 && y.abs() < 1e-3 && (z - 0.15).abs() < 1e-3, "{more}: {x} {y} {z}");
        // An arm of another length stays one.
        let mut other = UR5;
        other.a[1] -= 0.1;
        assert!(matches!(judged(&other, &config), Err(CheckRefusal::Model { .. })));
        assert_eq!(tool_from_flange(&other, &config, 30.0), None);
    }
}
