//! What the joints' effort leaves: against the figures of others, and what is reported of it.

use super::arm::with_urdf;
use crate::{Config, Draft, Headroom, presets};

fn with(preset: &str, sets: &[(&str, &str)]) -> Config {
    let draft = Draft::preset(preset);
    sets.iter().fold(draft, |draft, (key, value)| draft.set(key, value)).finish().unwrap()
}

fn carrying(preset: &str, kg: &str) -> Config {
    with(preset, &[("robot.payload.mass_kg", kg), ("robot.payload.centre_m", "[0.0, 0.0, 0.07]")])
}

fn least(room: &Headroom) -> [f64; 6] {
    std::array::from_fn(|joint| room.joints[joint].alone[0])
}

/// The same sweep with Pinocchio, by others, over 400 poses at the paper, friction left out: one joint alone,
/// the least over the poses, joints 0 to 5, and all at once, least and median [rad/s²].
#[test]
fn without_friction_the_figures_are_those_of_a_sweep_with_pinocchio() {
    let frictionless = |name: &str, more: &str| {
        let urdf = presets::robot(name).unwrap().replace("<axis ", "<dynamics friction=\"1e-9\"/><axis ");
        let tool = "\n[robot.payload]\ncentre_m = [0.0, 0.0, 0.07]\n";
        with_urdf(&urdf, &format!("{tool}{more}")).unwrap().headroom().unwrap()
    };
    let ur5 = |kg: &str| frictionless("ur5", &format!("mass_kg = {kg}\n"));
    for (room, alone, together) in [
        (ur5("0.3"), [69.0, 40.0, 112.0, 204.0, 251.0, 280.0], [27.0, 39.2]),
        (ur5("5"), [34.0, 16.0, 33.0, 76.0, 122.0, 279.0], [9.9, 16.1]),
    ] {
        assert!(room.poses > 380 && room.joints.iter().all(|joint| !joint.friction_assumed));
        for (found, expected) in
            least(&room).into_iter().chain(room.together).zip(alone.into_iter().chain(together))
        {
            // Their poses are others, so their last digit is not ours.
            assert!((found / expected - 1.0).abs() < 0.06, "{found} for {expected}: {:?}", least(&room));
        }
    }
}

/// Notes about the joints' torque.
fn of_torque(config: &Config) -> Vec<String> {
    config.notes().into_iter().filter(|note| !note.starts_with("mpc.limits are lowered")).collect()
}

#[test]
fn shipped_settings_with_a_pen_are_noted_and_not_warned_of() {
    for name in ["ur5", "ur5e"] {
        for kg in ["0.3", "1"] {
            let config = carrying(name, kg);
            assert_eq!(config.remarks(), Vec::<String>::new());
            let notes = of_torque(&config);
            assert!(notes.len() == 1, "{notes:?}");
            for wanted in
                ["robot.acceleration_radps2 = 40 of joint `shoulder_lift_joint`", "m of the plane", "poses"]
            {
                assert!(notes.iter().all(|note| note.contains(wanted)), "{wanted}: {notes:?}");
            }
        }
    }
    assert_eq!(of_torque(&Config::preset("ur5-first-run").unwrap()), Vec::<String>::new());
}

#[test]
fn a_load_that_the_limits_forget_is_warned_of_with_the_line_to_write() {
    let config = carrying("ur5e", "5");
    let remarks = config.remarks();
    assert_eq!(remarks.len(), 2, "{remarks:?}");
    let lines: Vec<(&str, &str)> = remarks
        .iter()
        .map(|remark| remark.rsplit_once("to stay below: ").unwrap().1.split_once(" = ").unwrap())
        .collect();
    assert_eq!(lines[0].0, "robot.acceleration_radps2");
    assert_eq!(lines[1].0, "robot.stale_deceleration_radps2");
    // Written as they are printed, they leave nothing to say.
    let mut sets = vec![("robot.payload.mass_kg", "5"), ("robot.payload.centre_m", "[0.0, 0.0, 0.07]")];
    sets.extend(&lines);
    let obeyed = with("ur5e", &sets);
    assert!(obeyed.headroom().unwrap().exceeded().is_empty() && of_torque(&obeyed).is_empty());
    let [acceleration, deceleration] = config.headroom().unwrap().proposed();
    assert!(acceleration[1] >= 10.0 && acceleration[1] < 16.0, "{acceleration:?}");
    assert_eq!((acceleration[5], deceleration[5]), (40.0, 20.0), "a joint that can is left alone");
}

#[test]
fn the_arms_own_payload_wins_over_the_bridges_and_hangs_at_the_middle_of_the_pen() {
    let payload = |sets: &[(&str, &str)]| with("ur5e", sets).headroom().unwrap().payload;
    assert_eq!(payload(&[]).mass, 0.0);
    let bridge = ("robot.ur.payload_kg", "0.4");
    assert_eq!((payload(&[bridge]).mass, payload(&[bridge]).centre), (0.4, [0.0, 0.0, 0.075]));
    let both =
        payload(&[bridge, ("robot.payload.mass_kg", "3"), ("robot.payload.centre_m", "[0.1, 0.0, 0.0]")]);
    assert_eq!((both.mass, both.centre), (3.0, [0.1, 0.0, 0.0]));
}

#[test]
fn a_description_without_masses_is_noted_and_still_followed() {
    let bare = presets::robot("ur5").unwrap().replace("inertial>", "inertial_>");
    let config = with_urdf(&bare, "").unwrap();
    assert_eq!(config.remarks(), Vec::<String>::new());
    let notes = config.notes();
    assert!(notes.len() == 1 && notes[0].contains("`shoulder_pan_joint`"), "{notes:?}");
}

#[test]
fn friction_of_the_description_counts_and_an_arm_too_weak_to_hold_itself_is_reported() {
    let urdf = presets::robot("ur5").unwrap();
    let damped = urdf.replace("<axis ", "<dynamics friction=\"8\" damping=\"2\"/><axis ");
    let room = with_urdf(&damped, "").unwrap().headroom().unwrap();
    let first = &room.joints[0];
    assert!(!first.friction_assumed && (first.friction - (8.0 + std::f64::consts::PI)).abs() < 1e-9);
    let weak = urdf.replace("effort=\"150\"", "effort=\"20\"");
    let config = with_urdf(&weak, "").unwrap();
    let remarks = config.remarks();
    assert!(remarks.iter().any(|remark| remark.contains("can hardly hold itself")), "{remarks:?}");
}

#[test]
fn it_takes_far_less_than_a_second() {
    let config = Config::preset("ur5e").unwrap();
    let begun = std::time::Instant::now();
    let room = config.headroom().unwrap();
    let took = begun.elapsed();
    assert!(room.poses > 380);
    assert!(took.as_secs_f64() < 1.0, "{took:?}");
}
