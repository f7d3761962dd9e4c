//! Whether an arm that stands at home can be armed there: home, tool and paper have to fit together.

use foretrace_control::follower::Refusal;

use crate::config::Config;
use crate::problem::{Problem, ProblemKind, ValueFlaw};

pub(crate) fn at_home(config: &Config) -> Option<Problem> {
    const KEY: &str = "robot.home_rad";
    let (law, home) = (config.follower_settings(), &config.robot().home);
    let refusal = law.may_arm_at(home).err()?;
    let kinematics = law.chain.forward(home);
    let why = match refusal {
        Refusal::ToolNotAligned => {
            let tilt = kinematics.rotation.column(2).dot(&law.plane.tool_axis()).clamp(-1.0, 1.0).acos();
            let most = law.safety.arm_max_tilt;
            format!("puts the pen's tip tilted by {tilt:.3} rad, more than safety.arm_max_tilt_rad = {most}")
        }
        Refusal::ToolOutsideWorkspace => {
            let [x, y, z] = law.plane.point_from_base(&kinematics.position).into();
            let [bx, by, bz] = kinematics.position.into();
            let margin = law.safety.arm_workspace_margin;
            format!(
                "puts the pen's tip at [{bx:.3}, {by:.3}, {bz:.3}] m of the base frame, [{x:.3}, {y:.3}, {z:.3}] \
                 m in the plane's frame: outside of plane.workspace_m by more than \
                 safety.arm_workspace_margin_m = {margin}"
            )
        }
        // Home outside the joint limits is reported where the limits are read.
        _ => return None,
    };
    let origin = config.origin(KEY).cloned()?;
    let flaw = ValueFlaw::Conflict {
        conflict: format!("{why}, so that an arm at home, as the simulated one, can never be armed"),
        remedy: "choose robot.home_rad, robot.tool_m and plane.origin_m together".to_owned(),
    };
    let kind = ProblemKind::Value { key: KEY.to_owned(), value: format!("{home:?}"), flaw };
    Some(Problem { origin, kind })
}
