//! Made-up pen-up motion: a minimum-jerk hover from where one stroke ended to where the next begins.
//!
//! The pen keeps the speed with which it left the surface and arrives with the one it will write with, so that
//! position and velocity are continuous. Absent: the height of the hover; only contact = false says so.
//! Source: Flash & Hogan, J. Neurosci. 5(7), 1985 (quintic minimum-jerk motion, here with end velocities).

use super::PathSample;

/// Shortest made-up lift [s].
const LIFT_MIN_S: f64 = 0.3;

/// How long a hand takes to lift and travel `distance_m` [s]: never under 0.3 s, growing with the root of the distance.
///
/// The growth is that of the recorded hovers of unipen-tos (medians 0.12 s over 1.5 mm to 0.165 s over 8 mm on the tablet), scaled
/// with the glyphs to 30 mm; 0.3 s is what nine out of ten of them stay below.
#[must_use]
pub fn travel_duration_s(distance_m: f64) -> f64 {
    LIFT_MIN_S + 0.4 * distance_m.max(0.0).sqrt()
}

/// Hover samples strictly between `from` and the arrival at `to`, which is one step of the rate after the last.
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
    let x = Quintic::new(from.x_m, leaving[0], to[0], arriving[0], duration_s);
    let y = Quintic::new(from.y_m, leaving[1], to[1], arriving[1], duration_s);
    (1..steps as u32)
        .map(|i| {
            let share = f64::from(i) / steps;
            PathSample {
                t_s: from.t_s + share * duration_s,
                x_m: x.at(share),
                y_m: y.at(share),
                contact: false,
            }
        })
        .collect()
}

/// Fifth-order polynomial in u = t/T with given end positions and velocities and no end accelerations.
struct Quintic {
    start: f64,
    leaving: f64,
    cubic: f64,
    quartic: f64,
    quintic: f64,
}

impl Quintic {
    fn new(start: f64, leaving_mps: f64, end: f64, arriving_mps: f64, duration_s: f64) -> Self {
        let (distance, leaving, arriving) =
            (end - start, leaving_mps * duration_s, arriving_mps * duration_s);
        Self {
            start,
            leaving,
            cubic: 10.0 * distance - 6.0 * leaving - 4.0 * arriving,
            quartic: -15.0 * distance + 8.0 * leaving + 7.0 * arriving,
            quintic: 6.0 * distance - 3.0 * leaving - 3.0 * arriving,
        }
    }

    fn at(&self, u: f64) -> f64 {
        self.start + u * (self.leaving + u * u * (self.cubic + u * (self.quartic + u * self.quintic)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn travel_meets_both_ends_in_position_and_velocity() {
        let q = Quintic::new(0.01, 0.3, 0.05, -0.2, 0.4);
        let slope = |u: f64| (q.at(u + 1e-6) - q.at(u - 1e-6)) / (2e-6 * 0.4);
        assert!((q.at(0.0) - 0.01).abs() < 1e-15 && (q.at(1.0) - 0.05).abs() < 1e-15);
        assert!((slope(0.0) - 0.3).abs() < 1e-6 && (slope(1.0) + 0.2).abs() < 1e-6);
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
