//! The pen's test motion: gentle, around the tool's position, from rest to rest, hovering.
//!
//! Contract: begins at the tool's position, stays inside the workspace, and has frequencies from 0.7 to 4.1
//! Hz, so that a filter can be told from a pure delay. Peak speed is about 9 amplitudes per second and axis.

use std::f64::consts::TAU;

use foretrace_control::plane::Plane;
use foretrace_sim::path::PathSample;

use foretrace_failure::Failure;

/// Rate of the synthetic pen \[Hz\].
const RATE_HZ: f64 = 200.0;
/// Rest before, between and after [s]: the loop locks on to the pen, the arm settles, the last motion
/// arrives.
const REST_S: [f64; 3] = [0.4, 0.5, 0.8];
/// Time in which the motion fades in and out \[s\].
const FADE_S: f64 = 0.5;
/// Peak speed of the travel to where there is room \[m/s\].
const TRAVEL_MPS: f64 = 0.1;
/// Distance to the border of the workspace that is kept \[m\].
const MARGIN_M: f64 = 0.005;
/// Frequencies along x and y \[Hz\]; amplitudes fall with them, so that each has the same part in the speed.
const FREQUENCIES_HZ: [[f64; 3]; 2] = [[0.7, 1.9, 3.3], [1.1, 2.6, 4.1]];

/// Bounds of the motion, in the plane frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MotionSpace {
    /// The tool \[m\].
    pub(crate) tool: [f64; 2],
    /// The workspace, [[low, high] of x, of y] \[m\].
    pub(crate) workspace: [[f64; 2]; 2],
    /// Farthest from the middle of the motion along each axis \[m\].
    pub(crate) amplitude_m: f64,
}

/// The motion in the pen's own plane \[m\], times from 0; lasts `seconds` without rest and travel.
///
/// # Errors
///
/// The workspace has no room for the amplitude.
pub(crate) fn motion(space: &MotionSpace, seconds: f64, plane: &Plane) -> Result<Vec<PathSample>, Failure> {
    let [start, centre] = start_and_centre(space)?;
    let distance = (centre[0] - start[0]).hypot(centre[1] - start[1]);
    // A minimum-jerk travel is 1.875 times as fast at its peak as in the mean.
    let travel_s = (1.875 * distance / TRAVEL_MPS).max(if distance > 1e-6 { 0.5 } else { 0.0 });
    let [wave_x, wave_y] = FREQUENCIES_HZ.map(|frequencies| wave(frequencies, seconds));
    let begin_s = REST_S[0] + travel_s + REST_S[1];
    let end_s = begin_s + seconds + REST_S[2];
    let sample = |index: u32| {
        let t_s = f64::from(index) / RATE_HZ;
        let way = minimum_jerk((t_s - REST_S[0]) / travel_s.max(1e-9));
        let u = t_s - begin_s;
        let offset = [wave_x(u), wave_y(u)].map(|part| space.amplitude_m * part);
        let at: [f64; 2] = std::array::from_fn(|axis| {
            let metres = start[axis] + way * (centre[axis] - start[axis]) + offset[axis];
            metres / plane.pen_scale + plane.pen_origin[axis]
        });
        PathSample { t_s, x_m: at[0], y_m: at[1], contact: false }
    };
    Ok((0..(end_s * RATE_HZ) as u32).map(sample).collect())
}

/// The tool, inside the workspace, and the nearest point around which there is room.
fn start_and_centre(space: &MotionSpace) -> Result<[[f64; 2]; 2], Failure> {
    let room = space.amplitude_m + MARGIN_M;
    let mut both = [[0.0; 2]; 2];
    for (axis, [low, high]) in space.workspace.into_iter().enumerate() {
        if high - low < 2.0 * room {
            let most_mm = (0.5 * (high - low) - MARGIN_M) * 1e3;
            return Err(Failure::bad_input(
                format_args!(
                    "a motion of ±{} mm has no room in a workspace of {:.0} mm along {}",
                    space.amplitude_m * 1e3,
                    (high - low) * 1e3,
                    ["x", "y"][axis]
                ),
                format_args!("give --amplitude-mm of at most {:.0}", most_mm.max(0.0).floor()),
            ));
        }
        both[0][axis] = space.tool[axis].clamp(low, high);
        both[1][axis] = space.tool[axis].clamp(low + room, high - room);
    }
    Ok(both)
}

/// Sines that add up to at most 1, faded in and out, over time since the beginning \[s\]; 0 outside.
fn wave(frequencies: [f64; 3], seconds: f64) -> impl Fn(f64) -> f64 {
    let fade_s = FADE_S.min(0.25 * seconds);
    let raw = move |u: f64| {
        let window = minimum_jerk(u.min(seconds - u) / fade_s);
        window * frequencies.iter().map(|f| (TAU * f * u).sin() / f).sum::<f64>()
    };
    let count = (seconds * RATE_HZ) as u32;
    let peak = (0..count).map(|k| raw(f64::from(k) / RATE_HZ).abs()).fold(1e-9, f64::max);
    move |u| raw(u) / peak
}

/// 0 to 1 with velocity and acceleration 0 at both ends (Flash & Hogan 1985); clamped outside.
fn minimum_jerk(part: f64) -> f64 {
    let s = part.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_sim::path::PenPath;
    use nalgebra::{Rotation3, Vector3};

    fn plane() -> Plane {
        Plane {
            origin: Vector3::zeros(),
            rotation: Rotation3::identity(),
            pen_scale: 2.0,
            pen_origin: [0.1, -0.2],
            lift_height: 0.02,
            press_depth: 0.0,
        }
    }

    fn space(tool: [f64; 2]) -> MotionSpace {
        MotionSpace { tool, workspace: [[-0.15, 0.15], [-0.1, 0.1]], amplitude_m: 0.01 }
    }

    #[test]
    fn the_motion_begins_at_the_tool_rests_at_both_ends_and_stays_inside() {
        for tool in [[0.02, -0.03], [0.149, 0.099], [0.3, -0.3], [0.0, 0.0]] {
            let space = space(tool);
            let path = motion(&space, 6.0, &plane()).unwrap();
            let points: Vec<[f64; 2]> = path.iter().map(|s| plane().from_pen([s.x_m, s.y_m])).collect();
            let inside = [tool[0].clamp(-0.15, 0.15), tool[1].clamp(-0.1, 0.1)];
            assert!((0..2).all(|axis| (points[0][axis] - inside[axis]).abs() < 1e-12));
            assert_eq!(points[0], points[70]);
            assert!(points[points.len() - 150..].windows(2).all(|w| w[0] == w[1]));
            for [x, y] in &points {
                assert!(x.abs() <= 0.15 + 1e-12 && y.abs() <= 0.1 + 1e-12);
            }
            assert!(path.iter().all(|sample| !sample.contact));
            let pen = PenPath::from_samples(path).motion();
            // Half a metre of pen is a metre of plane here.
            assert!(2.0 * pen.peak_speed_mps < 0.15, "{pen:?}");
            assert!(2.0 * pen.peak_acceleration_mps2 < 3.0, "{pen:?}");
        }
    }

    #[test]
    fn the_amplitude_is_what_was_asked_for_on_both_axes() {
        let path = motion(&space([0.0, 0.0]), 6.0, &plane()).unwrap();
        let points: Vec<[f64; 2]> = path.iter().map(|s| plane().from_pen([s.x_m, s.y_m])).collect();
        for axis in 0..2 {
            let most = points.iter().map(|p| p[axis].abs()).fold(0.0, f64::max);
            assert!((most - 0.01).abs() < 1e-9, "{axis}: {most}");
        }
    }

    #[test]
    fn a_workspace_without_room_is_refused_with_the_largest_amplitude() {
        let narrow = MotionSpace { workspace: [[-0.15, 0.15], [-0.012, 0.012]], ..space([0.0, 0.0]) };
        let refused = motion(&narrow, 6.0, &plane()).unwrap_err().to_string();
        assert!(refused.contains("along y") && refused.contains("at most 7"), "{refused}");
    }
}
