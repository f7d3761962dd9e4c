//! What the arm keeps away from, and whether it is clear of it at home.

use foretrace_control::arm::{Chain, JointLimits};
use foretrace_control::clearance::{Clearance, ClearanceError, ClearanceSettings, Obstacle};
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::Vector3;

use crate::check::Findings;
use crate::robot::JOINTS;
use crate::settings::Settings;

/// What the settings forbid; `None` where nothing is forbidden, or something was reported.
pub(crate) fn clearance(
    settings: &Settings,
    chain: &Chain<JOINTS>,
    limits: &JointLimits<JOINTS>,
    home: &[f64; JOINTS],
    report: &mut Findings<'_>,
) -> Option<ClearanceSettings> {
    let section = &settings.clearance;
    let mut obstacles = Vec::new();
    for (i, [point, normal]) in section.planes_m.iter().flatten().enumerate() {
        match Obstacle::plane(*point, *normal) {
            Ok(plane) => obstacles.push(plane),
            Err(error) => {
                let remedy = "write [[x, y, z], [nx, ny, nz]] with a normal of length 1";
                report.conflict(
                    "clearance.planes_m",
                    format!("has a plane (number {i}, from 0) that is none: {error}"),
                    remedy,
                );
            }
        }
    }
    for (i, [centre, size, rpy]) in section.boxes_m.iter().flatten().enumerate() {
        match Obstacle::cuboid(*centre, *size, *rpy) {
            Ok(cuboid) => obstacles.push(cuboid),
            Err(error) => {
                let remedy = "write [[centre], [size], [roll, pitch, yaw]] with three positive sizes";
                report.conflict(
                    "clearance.boxes_m",
                    format!("has a box (number {i}, from 0) that is none: {error}"),
                    remedy,
                );
            }
        }
    }
    let key = if section.planes_m.is_some() { "clearance.planes_m" } else { "clearance.boxes_m" };
    let planes = section.planes_m.as_ref().map_or(0, Vec::len);
    if obstacles.is_empty() && !section.itself {
        return None;
    }
    let wanted = ClearanceSettings { margin_m: section.margin_m, itself: section.itself, obstacles };
    let period_s = settings.period_ns() as f64 * 1e-9;
    // One obstacle at a time, then the arm itself: the message can name it.
    let alone = |itself: bool, obstacle: Option<&Obstacle>| ClearanceSettings {
        itself,
        obstacles: obstacle.copied().into_iter().collect(),
        margin_m: section.margin_m,
    };
    let at_home = chain.forward(home);
    let parts = wanted.obstacles.iter().map(|one| alone(false, Some(one)));
    let parts = parts.chain(section.itself.then(|| alone(true, None)));
    let whole = Clearance::new(chain, limits, period_s, &wanted);
    if let Err(error) = whole {
        let remedy = match error {
            ClearanceError::NoShape { .. } => {
                "give the links of the URDF spheres, cylinders or boxes, or drop the key"
            }
            _ => "simplify the key or the URDF",
        };
        report.conflict(key, format!("cannot be kept away from: {error}"), remedy);
        return None;
    }
    for (i, part) in parts.enumerate() {
        let nearest =
            Clearance::new(chain, limits, period_s, &part).ok().and_then(|kept| kept.nearest(&at_home));
        let Some(nearest) = nearest.filter(|nearest| nearest.distance_m < section.margin_m) else { continue };
        let (key, what) = match &nearest.other {
            Some(other) => ("clearance.itself", format!("link `{other}`")),
            None if i < planes => ("clearance.planes_m", format!("plane number {i} (from 0)")),
            None => ("clearance.boxes_m", format!("box number {} (from 0)", i - planes)),
        };
        report.conflict(
            key,
            format!(
                "is not clear at robot.home_rad: link `{}` is {:.4} m from {what}, {:.4} m less than \
                 clearance.margin_m = {}",
                nearest.link,
                nearest.distance_m,
                section.margin_m - nearest.distance_m,
                section.margin_m
            ),
            "move the obstacle, choose another home, or correct the link's collision geometry",
        );
    }
    Some(wanted)
}

/// Reports a place of the paper, its middle or a corner, at which a pen that presses brings a link nearer to
/// a plane, a box or the arm than the margin: the tip would stay above the pressing depth.
pub(crate) fn pressed(
    settings: &Settings,
    wanted: &ClearanceSettings,
    chain: &Chain<JOINTS>,
    limits: &JointLimits<JOINTS>,
    home: &[f64; JOINTS],
    report: &mut Findings<'_>,
) {
    let plane = &settings.plane;
    let Ok(kept) = Clearance::new(chain, limits, settings.period_ns() as f64 * 1e-9, wanted) else { return };
    let (origin, rotation) = (Vector3::from(plane.origin_m), plane.rotation());
    let at = |seed: &[f64; JOINTS], x: f64, y: f64, z: f64| {
        let point = origin + rotation * Vector3::new(x, y, z);
        solve_pose(chain, seed, &ToolTarget::at_rest(point, -(rotation * Vector3::z()), None))
    };
    let [[x_min, x_max], [y_min, y_max], _] = plane.workspace_m;
    let (x, y) = (0.5 * (x_min + x_max), 0.5 * (y_min + y_max));
    let Some(over) = at(home, x, y, plane.lift_height_m) else { return };
    for (x, y) in [(x, y), (x_min, y_min), (x_min, y_max), (x_max, y_min), (x_max, y_max)] {
        let pressing =
            at(&over, x, y, plane.lift_height_m).and_then(|lifted| at(&lifted, x, y, -plane.press_m));
        let Some(nearest) = pressing.and_then(|q| kept.nearest(&chain.forward(&q))) else { continue };
        if nearest.distance_m < wanted.margin_m {
            let other =
                nearest.other.map_or_else(|| "a plane or box".to_owned(), |link| format!("link `{link}`"));
            report.conflict(
                "plane.press_m",
                format!(
                    "brings link `{}` at x = {x}, y = {y} m of the plane to {:.4} m from {other}, {:.4} m less than \
                     clearance.margin_m = {}",
                    nearest.link,
                    nearest.distance_m,
                    wanted.margin_m - nearest.distance_m,
                    wanted.margin_m
                ),
                "press less, let the tool's shape end higher above its tip, or lower the margin",
            );
            return;
        }
    }
}
