//! Whether the arm's joints have the torque for the limits of the settings.

use foretrace_config::Config;

use crate::finding::CheckResult;

const NAME: &str = "torque";

/// Never makes a machine unfit: it is about the arm.
pub(crate) fn judge(config: &Config) -> CheckResult {
    let room = match config.headroom() {
        Ok(room) => room,
        Err(error) => {
            let fix = "give the links of robot.urdf their <inertial> and its joints their effort limit, or know that nobody checks this";
            return CheckResult::warning(NAME, format!("not known: {error}"), fix);
        }
    };
    let least = room.joints.iter().map(|joint| format!("{:.0}", joint.alone[0]));
    let value = format!(
        "with {} kg each joint alone can give {} rad/s² everywhere, all at once {:.0} ({} poses)",
        room.payload.mass,
        least.collect::<Vec<_>>().join(" "),
        room.together[0],
        room.poses
    );
    let exceeded = room.exceeded();
    if exceeded.iter().any(|excess| excess.serious) {
        let all: Vec<String> = exceeded.into_iter().map(|excess| excess.text).collect();
        return CheckResult::warning(NAME, value, all.join("; "));
    }
    // What the shipped settings ask beyond this at the far edge is no reason to change them.
    let notes: String = exceeded.iter().map(|excess| format!("; {}", excess.text)).collect();
    CheckResult::ok(NAME, value + &notes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use foretrace_config::Draft;

    #[test]
    fn a_loaded_arm_whose_brake_is_a_promise_it_cannot_keep_is_a_warning_and_a_pen_is_not() {
        let pen = judge(&Draft::preset("ur5e").set("robot.payload.mass_kg", "0.3").finish().unwrap());
        assert_eq!(pen.level, Level::Ok, "{}", pen.value);
        assert!(pen.value.contains("with 0.3 kg") && pen.value.contains("rad/s²"), "{}", pen.value);
        let heavy = judge(&Draft::preset("ur5e").set("robot.payload.mass_kg", "5").finish().unwrap());
        assert_eq!(heavy.level, Level::Warning, "{}", heavy.value);
        assert!(heavy.fix.contains("robot.stale_deceleration_radps2 = ["), "{}", heavy.fix);
    }
}
