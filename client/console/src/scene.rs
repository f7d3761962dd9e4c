//! What a page is told once: the paper, the arm's shapes, what it keeps away from.
//!
//! Contract: the shapes are those that the clearance uses, in the frames that the page needs: it does no
//! kinematics of its own.

use foretrace_config::{Config, JOINTS};
use foretrace_control::arm::{Capsule, Chain, Kinematics};
use foretrace_control::predict::PredictorKind;
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

/// The scene of these settings. Lengths in metres, in the arm's base frame unless told otherwise.
pub(crate) fn scene(config: &Config) -> Value {
    let (settings, robot) = (config.settings(), config.robot());
    let plane = &settings.plane;
    let rotation = plane.rotation();
    let axes: Vec<[f64; 3]> = (0..3).map(|axis| rotation.matrix().column(axis).into_owned().into()).collect();
    let clearance = &settings.clearance;
    json!({
        "settings": config.name(),
        "radii": radii(&robot.chain),
        "home": placed(&robot.chain, &robot.home),
        "plane": {
            "origin": plane.origin_m,
            "axes": axes,
            "workspace": plane.workspace_m,
            "lift": plane.lift_height_m,
            "pen_origin": plane.pen_origin_m,
            "scale": plane.scale,
        },
        "keep_out": {
            "planes": clearance.planes_m,
            "boxes": clearance.boxes_m.iter().flatten().map(|[centre, size, rpy]| {
                let [roll, pitch, yaw] = *rpy;
                let turn = nalgebra::Rotation3::from_euler_angles(roll, pitch, yaw);
                json!({ "centre": centre, "size": size, "axes": columns(turn.matrix()) })
            }).collect::<Vec<_>>(),
        },
        "predictors": PredictorKind::LIVE.map(PredictorKind::name),
        "rate_hz": settings.control_loop.rate_hz,
    })
}

fn columns(matrix: &Matrix3<f64>) -> Vec<[f64; 3]> {
    matrix.column_iter().map(|column| column.into_owned().into()).collect()
}

/// Radius of the line that is drawn from the last joint to the tip [m]: it is for the eye, and has no part in
/// the clearance.
const PEN_RADIUS_M: f64 = 0.004;

/// The radius of each shape \[m\].
fn radii(chain: &Chain<JOINTS>) -> Vec<f64> {
    chain.capsules().iter().map(|capsule| capsule.radius).chain([PEN_RADIUS_M]).collect()
}

/// Both ends of each shape at joints `q`, in the base frame \[m\].
pub(crate) fn placed(chain: &Chain<JOINTS>, q: &[f64; JOINTS]) -> Vec<[f64; 6]> {
    let pose = chain.forward(q);
    let last = pose.origins.column(JOINTS - 1).into_owned();
    let pen = rounded(&last, &pose.position);
    chain.capsules().iter().map(|capsule| ends(&pose, capsule)).chain([pen]).collect()
}

fn ends(pose: &Kinematics<JOINTS>, capsule: &Capsule) -> [f64; 6] {
    let (rotation, origin) = match capsule.link.checked_sub(1) {
        None => (Matrix3::identity(), Vector3::zeros()),
        Some(joint) => (
            pose.frames.get(joint).copied().unwrap_or_else(Matrix3::identity),
            pose.origins.column(joint.min(JOINTS - 1)).into_owned(),
        ),
    };
    let [a, b] = [0.0, 1.0].map(|share| origin + rotation * capsule.segment.at(share));
    rounded(&a, &b)
}

/// Tenths of a millimetre are more than a screen shows.
fn rounded(a: &Vector3<f64>, b: &Vector3<f64>) -> [f64; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z].map(|m| (m * 1e4).round() * 1e-4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_has_the_arm_and_the_paper_and_the_tip_is_in_its_last_shape() {
        let config = Config::preset("ur5").unwrap();
        let scene = scene(&config);
        let chain = &config.robot().chain;
        let shapes = placed(chain, &config.robot().home);
        assert_eq!(scene["radii"].as_array().unwrap().len(), shapes.len());
        assert!(!shapes.is_empty() && scene["plane"]["axes"].as_array().unwrap().len() == 3);
        let tip = chain.forward(&config.robot().home).position;
        let [.., x, y, z] = *shapes.last().unwrap();
        assert!((Vector3::new(x, y, z) - tip).norm() < 1e-3, "{tip} {shapes:?}");
        // The first shape that moves hangs at the base, the others in a chain below each other.
        assert!(shapes.iter().flatten().all(|m| m.abs() < 1.5));
    }
}
