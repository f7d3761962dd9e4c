//! Remarks on legal settings: what they cost or lack, or what will refuse them later; one line each.

use std::f64::consts::PI;

use foretrace_control::arm::Chain;
use foretrace_control::follower::FollowerSettings;
use foretrace_control::predict::{Models, PredictorKind};

use crate::config::Config;
use crate::models::shipped;
use crate::predictor::NO_NETWORK;
use crate::robot::JOINTS;
use crate::settings::Settings;

/// A limit that is lowered by less than this share is not reported.
const WORTH: f64 = 0.01;
/// Below the presets' rate, plans are coarser.
const USUAL_HZ: u32 = 500;

pub(crate) fn remarks(config: &Config) -> Vec<String> {
    let mut remarks: Vec<String> =
        network(config.settings(), config.models()).into_iter().chain(rate(config.settings())).collect();
    remarks.extend(shapeless(config.settings(), &config.robot().chain));
    remarks.extend(torque(config, true));
    remarks
}

pub(crate) fn notes(config: &Config) -> Vec<String> {
    let law = config.follower_settings();
    let mut notes: Vec<String> = lowered(config.settings(), &law).into_iter().chain(turned(config)).collect();
    notes.extend(torque(config, false).into_iter().chain(degrees(&config.robot().chain)));
    notes
}

/// Farthest that a joint turns, and fastest, before somebody asks whether these are degrees \[rad, rad/s\]:
/// two turns, and the fastest wrists of small arms.
const MOST_TURNED_RAD: f64 = 4.0 * PI;
const MOST_RADPS: f64 = 10.0 * PI;

/// Tells of limits of the description that look like degrees.
fn degrees(chain: &Chain<JOINTS>) -> Option<String> {
    let limits = chain.limits();
    let mut found = Vec::new();
    for ((name, position), velocity) in limits.names.iter().zip(limits.position).zip(limits.velocity) {
        let far = position.into_iter().find(|end| end.is_finite() && end.abs() > MOST_TURNED_RAD + 1e-3);
        found.extend(far.map(|end| format!("`{name}` turns to {end} rad")));
        found.extend((velocity > MOST_RADPS).then(|| format!("`{name}` turns with {velocity} rad/s")));
    }
    (!found.is_empty())
        .then(|| format!("limits of the URDF look like degrees, and count as radians: {}", found.join(", ")))
}

/// Tells of the two base frames of ROS's descriptions of arms of Universal Robots.
fn turned(config: &Config) -> Option<String> {
    let turned = config.robot().turned_base().filter(|_| !config.settings().robot.ur.base_turned)?;
    let (base, _) = config.robot().chain.ends();
    Some(format!(
        "the frames of the links `{base}` (the base link here) and `{turned}` of the URDF are turned by 180 \
         degrees about z against each other; [plane] and [clearance] are read in that of `{base}`. For \
         `foretrace arm ur`: the pendant of a Universal Robots arm shows coordinates in that of `{turned}`; \
         write base_turned = true under [robot.ur], or base_link = \"{turned}\" under [robot] and coordinates as the pendant shows them"
    ))
}

/// Reports limits of the joints that their effort does not leave at some poses of the plane. A description
/// without masses, which the law does not need, is noted.
fn torque(config: &Config, serious: bool) -> Vec<String> {
    match config.headroom() {
        Ok(room) => room
            .exceeded()
            .into_iter()
            .filter(|remark| remark.serious == serious)
            .map(|remark| remark.text)
            .collect(),
        Err(_) if serious => Vec::new(),
        Err(error) => {
            vec![format!(
                "whether the joints have the torque for these limits is not known, and contact is not judged: \
                 {error}"
            )]
        }
    }
}

/// Reports the cost of a slow loop.
fn rate(settings: &Settings) -> Option<String> {
    let rate_hz = settings.control_loop.rate_hz;
    (rate_hz < USUAL_HZ).then(|| {
        let (period_ms, step_ms) = (1e3 / f64::from(rate_hz), settings.plan_step_s() * 1e3);
        format!(
            "loop.rate_hz = {rate_hz}: a command every {period_ms} ms and plans in steps of {step_ms} ms \
             answer the hand later than \
             {USUAL_HZ} Hz do; recorded handwriting is followed with about twice the squared error at 125 Hz"
        )
    })
}

/// Reports limits of the plan that are lowered to what the joints allow, all in one line.
fn lowered(settings: &Settings, law: &FollowerSettings<JOINTS>) -> Option<String> {
    let limits = match settings.mpc.horizon {
        10 => law.plan_limits::<10>(),
        20 => law.plan_limits::<20>(),
        _ => law.plan_limits::<30>(),
    };
    let mut lowered_limits = Vec::new();
    for ((name, limits), asked) in ["x", "y", "z"].iter().zip(&limits).zip(&law.mpc.axes) {
        let pairs = [
            ("velocity_mps", limits.velocity_mps, asked.velocity_mps),
            ("acceleration_mps2", limits.acceleration_mps2, asked.acceleration_mps2),
            ("jerk_mps3", limits.jerk_mps3, asked.jerk_mps3),
        ];
        let lowered = pairs.into_iter().filter(|(_, counts, asked)| *counts < asked * (1.0 - WORTH));
        lowered_limits
            .extend(lowered.map(|(key, counts, asked)| format!("{name}.{key} {asked} to {counts:.3}")));
    }
    (!lowered_limits.is_empty()).then(|| {
        format!(
            "mpc.limits are lowered to what the joints give, or to what a plan of {} ms sees a stop from: {}",
            settings.plan_step_s() * 1e3 * f64::from(settings.mpc.horizon),
            lowered_limits.join(", ")
        )
    })
}

/// Reports a `mixture` without a network that the settings did not switch off.
fn network(settings: &Settings, models: &Models) -> Option<String> {
    let Settings { predictor, pen, .. } = settings;
    let renounced = predictor.mixture.network.is_some();
    if predictor.kind != PredictorKind::MIXTURE || renounced || models.networks().mixture.is_some() {
        return None;
    }
    let with: Vec<String> = (4..=20)
        .filter(|ms| shipped(&format!("mixture-{ms}ms")).is_some())
        .map(|ms: u32| ms.to_string())
        .collect();
    Some(format!(
        "predictor \"mixture\" runs without its trained network: none is shipped for pen.step_ms = {} (there \
         are for {} ms); \
         take such a step, or name a network of your own in predictor.mixture.network (\"{NO_NETWORK}\" \
         silences this)",
        pen.step_ms,
        with.join(", "),
    ))
}

/// Reports self-clearance that is on while some or all links have no shape.
fn shapeless(settings: &Settings, chain: &Chain<JOINTS>) -> Option<String> {
    if !settings.clearance.itself {
        return None;
    }
    let meshes = chain.mesh_links();
    let what = match (meshes, chain.capsules()) {
        ([], []) => "no link of the URDF has collision geometry".to_owned(),
        ([], _) => return None,
        (_, []) => {
            format!("the links of the URDF have only meshes as collision geometry ({})", meshes.join(", "))
        }
        _ => format!("these links of the URDF have only meshes as collision geometry: {}", meshes.join(", ")),
    };
    Some(format!(
        "clearance.itself is on, but {what}: for keeping clear they have no shape, and the arm may run into \
         itself there; \
         give them cylinders, spheres or boxes (`foretrace config shapes {}` proposes some), or set \
         clearance.itself = false",
        settings.robot.urdf
    ))
}
