//! `foretrace config torque`: what the effort of each joint leaves for acceleration over the writing plane.

use foretrace_config::{FRICTION_SHARE, Headroom, ROTOR_KGM2};

use crate::failure::{Cause, Failure};
use crate::output::say;
use crate::settings::SettingsArgs;

pub(crate) fn run(settings: &SettingsArgs) -> Result<(), Failure> {
    let config = settings.load()?;
    let room = config.headroom().map_err(|error| {
        Failure::new(
            Cause::BadInput,
            format!("the torques of this arm cannot be computed: {error}"),
            "give the moving links of robot.urdf an <inertial>, and its joints their effort limit",
        )
    })?;
    say!("{}", table(config.name(), &room));
    for excess in room.exceeded() {
        say!("\n{}: {}", if excess.serious { "warning" } else { "note" }, excess.text);
    }
    Ok(())
}

fn table(name: &str, room: &Headroom) -> String {
    let [x, y, z] = room.payload.centre;
    let mut text = format!(
        "{name}: {} kg at [{x}, {y}, {z}] m of the tip link, {} poses of the pen over plane.workspace_m, at rest\n\n\
         {:<22}{:>8}{:>9}{:>10}{:>9}   {:>17}   {:>11}   {:>11}\n\
         {:<22}{:>8}{:>9}{:>10}{:>9}   {:>17}   {:>11}   {:>11}\n",
        room.payload.mass,
        room.poses,
        "",
        "effort",
        "gravity",
        "friction",
        "inertia",
        "alone",
        "limit",
        "brake",
        "joint",
        "Nm",
        "Nm",
        "Nm",
        "kg m²",
        "least, median",
        "rad/s², at",
        "rad/s², at",
    );
    let share = |[limit, share]: [f64; 2]| format!("{limit:.0}, {:.0} %", 100.0 * share);
    for joint in &room.joints {
        text += &format!(
            "{:<22}{:>8.0}{:>9.1}{:>10.1}{:>9.2}   {:>17}   {:>11}   {:>11}\n",
            joint.name,
            joint.effort,
            joint.gravity,
            joint.friction,
            joint.inertia,
            format!("{:.1}, {:.1}", joint.alone[0], joint.alone[1]),
            share(joint.acceleration),
            share(joint.deceleration),
        );
    }
    let [least, median] = room.together;
    text +=
        &format!("\nall joints at once, in any directions: least {least:.1}, median {median:.1} rad/s²\n");
    let assumed = room.joints.iter().any(|joint| joint.friction_assumed);
    if assumed {
        text += &format!(
            "friction where the URDF states none: {:.0} % of the effort, assumed; ",
            100.0 * FRICTION_SHARE
        );
    }
    text + &format!("rotors: {ROTOR_KGM2} kg m² a joint, assumed")
}
