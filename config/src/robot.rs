//! The arm: URDF and settings folded into one chain with one set of limits, and a writing plane it can reach.
//!
//! Contract: of two limits the narrower one holds. Every corner of the workspace, at both ends of its height,
//! is reached from home inside the joint limits, or the settings are refused. Lists are per joint, base to
//! tool.

use std::path::Path;

use foretrace_control::arm::{Chain, ChainError, JointLimits, LONGEST_BYTES, LimitError};
use foretrace_control::clearance::ClearanceSettings;
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::check::Findings;
use crate::clearance::{clearance, pressed};
use crate::presets;
use crate::settings::{PlaneSection, RobotSection, Settings};
use crate::written::SettingOrigin;

/// A home that is outside the joint limits by this much or less was written with three digits.
const HOME_ROUNDING_RAD: f64 = 0.5e-3 + 1e-9;

/// Frames that differ by no more than the digits of a half turn \[rad, m\].
const SAME_FRAME: f64 = 1e-3;

/// Joints that the wire carries.
pub const JOINTS: usize = 6;

/// An arm that the settings describe completely.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Kinematics from the base link to the tip of the tool.
    pub chain: Chain<JOINTS>,
    /// Limits of URDF and settings together, with the braking of a consumer without commands.
    pub limits: JointLimits<JOINTS>,
    /// Posture near the middle of the writing plane, in rad.
    pub home: [f64; JOINTS],
    /// What it keeps away from.
    pub clearance: Option<ClearanceSettings>,
}

impl Robot {
    /// A link that is fixed below the base link and turned by 180 degrees about z against it, at the same
    /// place: in ROS's descriptions of arms of Universal Robots the frame that their controller uses.
    #[must_use]
    pub fn turned_base(&self) -> Option<&str> {
        let half_turn = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        let turned = self.chain.still_links().iter().find(|link| {
            link.below
                && (link.rotation - half_turn).norm() < SAME_FRAME
                && link.translation.norm() < SAME_FRAME
        });
        turned.map(|link| link.name.as_str())
    }
}

impl PlaneSection {
    /// Columns: the plane's x, y and normal in the base frame. The normal is taken as it is; x is made
    /// exactly perpendicular to it.
    #[must_use]
    pub fn rotation(&self) -> Rotation3<f64> {
        let z = Vector3::from(self.normal).normalize();
        let y = z.cross(&Vector3::from(self.x_axis)).normalize();
        Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]))
    }
}

/// Builds the robot and checks that it reaches the plane; `None` when something was reported.
pub(crate) fn robot(settings: &Settings, report: &mut Findings<'_>) -> Option<Robot> {
    let before = report.problems.len();
    let section = &settings.robot;
    let chain = chain(section, report)?;
    tool_of_another(section, report);
    let hold_s =
        f64::from(settings.control_loop.valid_periods) / f64::from(settings.control_loop.rate_hz.max(1));
    let limits = limits(section, &chain, hold_s, report);
    let home = per_joint("robot.home_rad", &section.home_rad, &chain, report);
    let (limits, mut home) = (limits?, home?);
    for ((name, q), [low, high]) in chain.limits().names.iter().zip(&mut home).zip(limits.position()) {
        let inside = q.max(*low).min(*high);
        if (*q - inside).abs() <= HOME_ROUNDING_RAD {
            *q = inside;
        } else {
            report.conflict(
                "robot.home_rad",
                format!("puts joint `{name}` at {q} rad, outside its limits {low:.4} to {high:.4} rad"),
                "choose a posture inside the limits",
            );
        }
    }
    let clearance = clearance(settings, &chain, &limits, &home, report);
    // Reach is only checked from a legal home in a legal plane.
    if report.problems.len() == before {
        reach(&settings.plane, &chain, &limits, &home, report);
    }
    if let Some(wanted) = &clearance
        && settings.plane.press_m > 0.0
        && report.problems.len() == before
    {
        pressed(settings, wanted, &chain, &limits, &home, report);
    }
    (report.problems.len() == before).then_some(Robot { chain, limits, home, clearance })
}

/// A preset's tool belongs to the preset's arm: with another description or tip link it would be a second
/// pen.
fn tool_of_another(section: &RobotSection, report: &mut Findings<'_>) {
    let preset = |key: &str| {
        report
            .found
            .get(key)
            .is_none_or(|node| matches!(node.origin, SettingOrigin::Preset { .. } | SettingOrigin::Default))
    };
    let own = if presets::robot(&section.urdf).is_none() && !preset("robot.urdf") {
        "robot.urdf"
    } else if !preset("robot.tip_link") {
        "robot.tip_link"
    } else {
        return;
    };
    if section.tool_m != [0.0; 3] && preset("robot.tool_m") {
        report.conflict(
            own,
            format!("comes with the preset's robot.tool_m = {:?}, the pen of another arm", section.tool_m),
            "write where your pen's tip is, seen from robot.tip_link: robot.tool_m = [0.0, 0.0, 0.0] if that \
             link is the tip",
        );
    }
}

fn chain(section: &RobotSection, report: &mut Findings<'_>) -> Option<Chain<JOINTS>> {
    let text = match presets::robot(&section.urdf) {
        Some(text) => text.to_owned(),
        None => match report.files.read_xml(Path::new(&section.urdf), LONGEST_BYTES as u64) {
            Ok(text) => text,
            Err(error) => {
                report.conflict(
                    "robot.urdf",
                    format!(
                        "is neither an embedded robot ({}) nor a readable file ({error})",
                        presets::robot_names()
                    ),
                    "name an embedded robot, or a URDF file relative to the settings file",
                );
                return None;
            }
        },
    };
    match Chain::from_urdf(&text, section.base_link.as_deref(), section.tip_link.as_deref()) {
        Ok(chain) => Some(chain.with_tool(section.tool_m.into())),
        Err(error) => {
            let remedy = match error {
                ChainError::Count { found, .. } if found > JOINTS => {
                    "name a robot.tip_link before the gripper, if joints of that are counted; \
                     why six, and what seven would take: docs/extend/arm.md"
                }
                ChainError::Xacro { .. } => "name the expanded file",
                _ => "correct the description, or robot.base_link and robot.tip_link",
            };
            report.conflict("robot.urdf", format!("cannot be used: {error}"), remedy);
            None
        }
    }
}

fn limits(
    section: &RobotSection,
    chain: &Chain<JOINTS>,
    hold_s: f64,
    report: &mut Findings<'_>,
) -> Option<JointLimits<JOINTS>> {
    let optional = |key: &str, list: Option<&Vec<f64>>, report: &mut Findings<'_>| match list {
        Some(list) => per_joint(key, list, chain, report).map(Some),
        None => Some(None),
    };
    let velocity = per_joint("robot.velocity_radps", &section.velocity_radps, chain, report);
    let acceleration = per_joint("robot.acceleration_radps2", &section.acceleration_radps2, chain, report);
    let jerk = optional("robot.jerk_radps3", section.jerk_radps3.as_ref(), report);
    let decel =
        optional("robot.stale_deceleration_radps2", section.stale_deceleration_radps2.as_ref(), report);
    let lowest = optional("robot.position_min_rad", section.position_min_rad.as_ref(), report);
    let highest = optional("robot.position_max_rad", section.position_max_rad.as_ref(), report);
    let (mut velocity, acceleration, jerk, decel) = (velocity?, acceleration?, jerk?, decel?);
    let (lowest, highest) =
        (lowest?.unwrap_or([f64::NEG_INFINITY; JOINTS]), highest?.unwrap_or([f64::INFINITY; JOINTS]));

    for (ours, urdf) in velocity.iter_mut().zip(&chain.limits().velocity) {
        *ours = ours.min(*urdf);
    }
    let mut position = chain.limits().position;
    for (both, (low, high)) in position.iter_mut().zip(lowest.iter().zip(&highest)) {
        let [urdf_low, urdf_high] = *both;
        *both = [urdf_low.max(*low), urdf_high.min(*high)];
    }
    for ((name, [low, high]), [urdf_low, urdf_high]) in
        chain.limits().names.iter().zip(position).zip(chain.limits().position)
    {
        if low >= high {
            report.conflict(
                if section.position_min_rad.is_some() {
                    "robot.position_min_rad"
                } else {
                    "robot.position_max_rad"
                },
                format!(
                    "leaves joint `{name}` nothing: {low:.4} to {high:.4} rad (the URDF allows {urdf_low:.4} \
                     to {urdf_high:.4})"
                ),
                "position_min_rad stands below position_max_rad, and both inside the URDF's range",
            );
            return None;
        }
    }
    let decel = decel.unwrap_or(acceleration);
    let built = JointLimits::new(position, velocity, acceleration)
        .and_then(|limits| limits.with_stale_braking(hold_s, decel))
        .and_then(|limits| jerk.map_or(Ok(limits), |jerk| limits.with_jerk(jerk)));
    match built {
        Ok(limits) => Some(limits),
        Err(error) => {
            report.conflict(
                if section.stale_deceleration_radps2.is_some() {
                    "robot.stale_deceleration_radps2"
                } else {
                    "robot.urdf"
                },
                format!("gives joint limits that cannot be kept: {error}"),
                match error {
                    LimitError::Deceleration { .. } => {
                        "set it to what the arm really brakes with by itself when commands stay away, at \
                         most \
                         robot.acceleration_radps2"
                    }
                    _ => "correct the limits of the settings or of the URDF",
                },
            );
            None
        }
    }
}

fn per_joint(
    key: &str,
    list: &[f64],
    chain: &Chain<JOINTS>,
    report: &mut Findings<'_>,
) -> Option<[f64; JOINTS]> {
    let array = <[f64; JOINTS]>::try_from(list).ok();
    if array.is_none() {
        report.conflict(
            key,
            format!("has {} numbers for the {JOINTS} joints of the arm", list.len()),
            format!("write one per joint: {}", chain.limits().names.join(", ")),
        );
    }
    array
}

fn reach(
    plane: &PlaneSection,
    chain: &Chain<JOINTS>,
    limits: &JointLimits<JOINTS>,
    home: &[f64; JOINTS],
    report: &mut Findings<'_>,
) {
    let rotation = plane.rotation();
    let origin = Vector3::from(plane.origin_m);
    let axis = -(rotation * Vector3::z());
    let at = |seed: &[f64; JOINTS], point: [f64; 3]| {
        let target = ToolTarget::at_rest(origin + rotation * Vector3::from(point), axis, None);
        solve_pose(chain, seed, &target)
    };
    let outside = |q: &[f64; JOINTS]| {
        let joints = chain.limits().names.iter().zip(q).zip(limits.position());
        joints
            .filter(|((_, q), [low, high])| !(*low..=*high).contains(*q))
            .map(|((name, q), [low, high])| format!("joint `{name}` at {q:.3} rad ({low:.3} to {high:.3})"))
            .next()
    };

    let [x_range, y_range, z_range] = plane.workspace_m;
    let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
    let centre = [middle(x_range), middle(y_range), plane.lift_height_m];
    // Corners are reached via the lifted middle, as the arm itself would.
    let Some(over) = at(home, centre) else {
        report.conflict(
            "plane.origin_m",
            format!(
                "puts the middle of the workspace, {}, out of reach from robot.home_rad",
                in_base(&origin, &rotation, centre)
            ),
            format!(
                "move the plane, or choose a home near it (home puts the tool at {})",
                tool_at(chain, home)
            ),
        );
        return;
    };
    let mut out = Vec::new();
    let corners = x_range.into_iter().flat_map(|x| y_range.map(|y| (x, y)));
    for (x, y) in corners {
        let mut seed = over;
        for z in [plane.lift_height_m, 0.0, z_range[1], z_range[0]] {
            let corner = [x, y, z];
            let found = [&seed, &over, home].into_iter().find_map(|start| at(start, corner));
            match found.map(|q| (outside(&q), q)) {
                Some((None, q)) => seed = q,
                Some((Some(joint), _)) => {
                    out.push(format!("{} needs {joint}", named(corner, &origin, &rotation)))
                }
                None => out.push(format!("{} is out of reach", named(corner, &origin, &rotation))),
            }
        }
    }
    if let Some(first) = out.first() {
        let more =
            if out.len() > 1 { format!(" (and {} more corners)", out.len() - 1) } else { String::new() };
        report.conflict(
            "plane.workspace_m",
            format!("has a corner the arm cannot reach from robot.home_rad: {first}{more}"),
            "make the workspace smaller, move plane.origin_m nearer to the base, or choose another home",
        );
    }
}

fn named(corner: [f64; 3], origin: &Vector3<f64>, rotation: &Rotation3<f64>) -> String {
    let [x, y, z] = corner;
    format!("x = {x}, y = {y}, z = {z} m of the plane, {},", in_base(origin, rotation, corner))
}

fn in_base(origin: &Vector3<f64>, rotation: &Rotation3<f64>, point: [f64; 3]) -> String {
    let p = origin + rotation * Vector3::from(point);
    format!("[{:.3}, {:.3}, {:.3}] m of the base", p.x, p.y, p.z)
}

fn tool_at(chain: &Chain<JOINTS>, home: &[f64; JOINTS]) -> String {
    let p = chain.forward(home).position;
    format!("[{:.3}, {:.3}, {:.3}] m of the base", p.x, p.y, p.z)
}
