//! Synthetic pen-up motion: a minimum-jerk hover from where one stroke ended to where the next begins.
//!
//! The pen leaves the surface with the speed of the stroke, slows down, and arrives with the speed it will
//! write with: position, velocity and the synthetic acceleration are continuous. Absent: the height of the
//! hover; only contact = false says so. Source: Flash & Hogan, J. Neurosci. 5(7), 1985 (the minimum-jerk
//! quintic).

use super::PathSample;

/// Shortest synthetic lift \[s\].
const LIFT_MIN_S: f64 = 0.3;
/// Time in which the speed of a stroke fades after the lift, and builds up before the next \[s\].
const FADE_S: f64 = 0.08;

/// How long a hand takes to lift and travel `distance_m` \[s\]: never under 0.3 s, growing with the distance.
///
/// The growth over centimetres is that of the recorded hovers of unipen-tos (medians 0.12 s over 1.5 mm to
/// 0.165 s over 8 mm on the tablet), scaled with the glyphs to 30 mm; 0.3 s is what nine out of ten of them
/// stay below. Beyond, the arm moves too, at up to about 0.7 m/s.
#[must_use]
pub fn travel_duration_s(distance_m: f64) -> f64 {
    let distance_m = distance_m.max(0.0);
    LIFT_MIN_S + 0.4 * distance_m.sqrt() + 0.8 * distance_m
}

/// Hover samples strictly between `from` and the arrival at `to`, which is one step of the rate after the
/// last.
///
/// Velocities in m/s; `at_least_s` is a recorded duration to fill where it is the longer one.
pub(super) fn travel(
    from: PathSample,
    leaving: [f64; 2],
    to: [f64; 2],
    arriving: [f64; 2],
    rate_hz: f64,
    at_least_s: f64,
) -> Vec<PathSample> {
    let distance_m = (to[0] - from.x_m).hypot(to[1] - from.y_m);
    let steps = (travel_duration_s(distance_m).max(at_least_s) * rate_hz).ceil().max(2.0);
    let duration_s = steps / rate_hz;
    let x = Hover::new(from.x_m, leaving[0], to[0], arriving[0], duration_s);
    let y = Hover::new(from.y_m, leaving[1], to[1], arriving[1], duration_s);
    (1..steps as u32)
        .map(|i| {
            let t_s = f64::from(i) / rate_hz;
            PathSample { t_s: from.t_s + t_s, x_m: x.at(t_s), y_m: y.at(t_s), contact: false }
        })
        .collect()
}

/// One axis: follow-through, minimum-jerk travel and run-up laid over each other.
///
/// A single quintic with end velocities would swing out by centimetres; this one by at most v·0.04 s.
struct Hover {
    start: f64,
    leaving_mps: f64,
    travel: f64,
    arriving_mps: f64,
    fade_s: f64,
    duration_s: f64,
}

impl Hover {
    fn new(start: f64, leaving_mps: f64, end: f64, arriving_mps: f64, duration_s: f64) -> Self {
        let fade_s = FADE_S.min(duration_s / 2.0);
        let travel = end - start - (leaving_mps + arriving_mps) * fade_s / 2.0;
        Self { start, leaving_mps, travel, arriving_mps, fade_s, duration_s }
    }

    fn at(&self, t_s: f64) -> f64 {
        let u = t_s / self.duration_s;
        let travelled = u * u * u * (10.0 + u * (-15.0 + 6.0 * u));
        let run_up = 0.5 - faded((self.duration_s - t_s) / self.fade_s);
        self.start
            + self.travel * travelled
            + self.fade_s * (self.leaving_mps * faded(t_s / self.fade_s) + self.arriving_mps * run_up)
    }
}

/// Distance covered while a unit speed fades smoothly to rest between u = 0 and 1: ∫ 1 − (3u² − 2u³).
fn faded(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u - u * u * u + u * u * u * u / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn travel_meets_both_ends_in_position_and_velocity() {
        let (duration_s, step_s) = (0.4, 1e-6);
        let h = Hover::new(0.01, 0.3, 0.05, -0.2, duration_s);
        let slope = |t: f64| (h.at(t + step_s) - h.at(t)) / step_s;
        assert!((h.at(0.0) - 0.01).abs() < 1e-15 && (h.at(duration_s) - 0.05).abs() < 1e-15);
        // One-sided difference over a microsecond at accelerations below 20 m/s².
        assert!((slope(0.0) - 0.3).abs() < 1e-4 && (slope(duration_s - step_s) + 0.2).abs() < 1e-4);
    }

    #[test]
    fn travel_takes_at_least_three_tenths_and_longer_over_distance() {
        assert!(travel_duration_s(0.0) >= 0.3);
        assert!(travel_duration_s(0.2) > travel_duration_s(0.1));
        let from = PathSample { t_s: 2.0, x_m: 0.0, y_m: 0.0, contact: true };
        let hover = travel(from, [0.0; 2], [0.0, 0.0], [0.0; 2], 200.0, 0.0);
        assert_eq!(hover.len(), 59);
        assert!(hover.iter().all(|s| !s.contact));
        assert_eq!(travel(from, [0.0; 2], [0.0, 0.0], [0.0; 2], 200.0, 1.0).len(), 199);
    }
}
