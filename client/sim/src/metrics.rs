//! How well a tool followed a pen, and how smooth a motion is.
//!
//! Pen and tool carry stamps of one clock in seconds and positions in one plane in metres. Between samples
//! both move linearly. Absent: orientation and the height above the plane.

use crate::path::PathSample;

/// Gaps in the pen longer than this are not interpolated: its position is unknown.
pub const PEN_GAP_MAX_S: f64 = 0.05;

const LAG_FIRST_MS: i32 = -50;
const LAG_LAST_MS: i32 = 200;

/// Where the tool was at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolSample {
    /// \[s\], same clock as the pen
    pub t_s: f64,
    /// \[m\]
    pub x_m: f64,
    /// \[m\]
    pub y_m: f64,
}

/// Tracking error at the tool's instants with the pen down.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TrackingErrors {
    /// Mean squared distance \[m²\].
    pub mse_m2: f64,
    /// Root of it \[m\].
    pub rmse_m: f64,
    /// Largest distance \[m\].
    pub max_m: f64,
    /// Shift s in \[−50, 200\] ms for which tool(t) fits pen(t − s) best; positive: the tool is late.
    pub lag_ms: f64,
    /// Mean squared distance that remains at that shift \[m²\].
    pub mse_at_lag_m2: f64,
    pub samples: usize,
}

/// Error at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSample {
    /// \[s\]
    pub t_s: f64,
    /// Distance between tool and pen \[m\].
    pub error_m: f64,
    /// The pen touched the surface.
    pub contact: bool,
}

/// Speed, acceleration and jerk of a motion, by differences between samples.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Smoothness {
    /// \[m/s\]
    pub peak_speed_mps: f64,
    /// \[m/s\]
    pub rms_speed_mps: f64,
    /// \[m/s²\]
    pub peak_acceleration_mps2: f64,
    /// \[m/s²\]
    pub rms_acceleration_mps2: f64,
    /// \[m/s³\]
    pub peak_jerk_mps3: f64,
    /// \[m/s³\]
    pub rms_jerk_mps3: f64,
}

/// Scores `tool` against `pen`: e(t) = |tool(t) − pen(t)| at every tool stamp where the pen was down.
///
/// Both are in order of time. Samples of the tool with no pen around them (before, after, in a gap, hovering)
/// do not count. `None` when nothing counts. The lag is the minimum of the mean squared error over a 1 ms
/// grid, refined by a parabola through its neighbours; at a border of the range the border is returned.
#[must_use]
pub fn tracking(pen: &[PathSample], tool: &[ToolSample]) -> Option<TrackingErrors> {
    let now = shifted_error(pen, tool, 0.0)?;
    let at = |ms: i32| shifted_error(pen, tool, f64::from(ms) * 1e-3).map(|e| e.mse);
    let curve: Vec<(i32, f64)> = (LAG_FIRST_MS..=LAG_LAST_MS).filter_map(|ms| Some((ms, at(ms)?))).collect();
    let &(best_ms, best) = curve.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let neighbour = |ms: i32| curve.iter().find(|(m, _)| *m == ms).map(|(_, e)| *e);
    let offset_ms = match (neighbour(best_ms - 1), neighbour(best_ms + 1)) {
        (Some(before), Some(after)) => vertex(before, best, after),
        _ => 0.0,
    };
    Some(TrackingErrors {
        mse_m2: now.mse,
        rmse_m: now.mse.sqrt(),
        max_m: now.max,
        lag_ms: f64::from(best_ms) + offset_ms,
        mse_at_lag_m2: best,
        samples: now.samples,
    })
}

/// The error at every tool stamp at which the pen is known, hovering or down.
#[must_use]
pub fn error_series(pen: &[PathSample], tool: &[ToolSample]) -> Vec<ErrorSample> {
    let mut cursor = Cursor::new(pen);
    tool.iter()
        .filter_map(|sample| {
            let at = cursor.at(sample.t_s)?;
            let error_m = (sample.x_m - at.x_m).hypot(sample.y_m - at.y_m);
            Some(ErrorSample { t_s: sample.t_s, error_m, contact: at.contact })
        })
        .collect()
}

/// Peak and RMS of the derivatives of a sampled motion; stretches across a gap (more than 4 median steps) are
/// left out.
///
/// Derivatives are divided differences over each sample's own stamps; noise in positions grows with every
/// order.
#[must_use]
pub fn motion(samples: &[ToolSample]) -> Smoothness {
    let mut steps: Vec<f64> = samples
        .windows(2)
        .filter_map(|w| Some(w.get(1)?.t_s - w.first()?.t_s))
        .filter(|d| *d > 0.0)
        .collect();
    steps.sort_by(f64::total_cmp);
    let longest = steps.get(steps.len() / 2).map_or(0.0, |median| 4.0 * median);
    let mut sums = [Peak::default(); 3];
    // Newest derivative of each order with its time; a gap clears them all.
    let mut held: [Option<(f64, [f64; 2])>; 3] = [None; 3];
    for sample in samples {
        if held[0].is_some_and(|(t, _)| !(sample.t_s - t <= longest && sample.t_s > t)) {
            held = [None; 3];
        }
        let mut level = (sample.t_s, [sample.x_m, sample.y_m]);
        for (slot, sum) in held.iter_mut().zip(&mut sums) {
            let before = slot.replace(level);
            let Some((t, value)) = before else { break };
            let elapsed = level.0 - t;
            let derivative = [(level.1[0] - value[0]) / elapsed, (level.1[1] - value[1]) / elapsed];
            sum.take(derivative[0].hypot(derivative[1]));
            level = ((level.0 + t) / 2.0, derivative);
        }
    }
    let [speed, acceleration, jerk] = sums;
    Smoothness {
        peak_speed_mps: speed.peak,
        rms_speed_mps: speed.rms(),
        peak_acceleration_mps2: acceleration.peak,
        rms_acceleration_mps2: acceleration.rms(),
        peak_jerk_mps3: jerk.peak,
        rms_jerk_mps3: jerk.rms(),
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Peak {
    peak: f64,
    square_sum: f64,
    count: usize,
}

impl Peak {
    fn take(&mut self, value: f64) {
        self.peak = self.peak.max(value);
        self.square_sum += value * value;
        self.count += 1;
    }

    fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.square_sum / self.count as f64).sqrt() }
    }
}

struct Shifted {
    mse: f64,
    max: f64,
    samples: usize,
}

fn shifted_error(pen: &[PathSample], tool: &[ToolSample], shift_s: f64) -> Option<Shifted> {
    let mut cursor = Cursor::new(pen);
    let mut sum = Peak::default();
    for sample in tool {
        if let Some(at) = cursor.at(sample.t_s - shift_s).filter(|at| at.contact) {
            sum.take((sample.x_m - at.x_m).hypot(sample.y_m - at.y_m));
        }
    }
    let mse = sum.square_sum / sum.count as f64;
    (sum.count > 0).then_some(Shifted { mse, max: sum.peak, samples: sum.count })
}

/// Offset in (−1, 1) of the lowest point of the parabola through three neighbours, the middle one lowest.
fn vertex(before: f64, middle: f64, after: f64) -> f64 {
    let curvature = before - 2.0 * middle + after;
    let offset = (before - after) / (2.0 * curvature);
    if curvature > 0.0 && offset.is_finite() { offset } else { 0.0 }
}

/// The pen at rising instants, in one pass over its samples.
struct Cursor<'p> {
    pen: &'p [PathSample],
    index: usize,
}

impl<'p> Cursor<'p> {
    fn new(pen: &'p [PathSample]) -> Self {
        Self { pen, index: 0 }
    }

    /// Interpolated; down only where both neighbours are down. `None` outside the path and in gaps.
    fn at(&mut self, t_s: f64) -> Option<PathSample> {
        while self.pen.get(self.index + 1).is_some_and(|next| next.t_s < t_s) {
            self.index += 1;
        }
        let (before, after) = (self.pen.get(self.index)?, self.pen.get(self.index + 1)?);
        let elapsed = after.t_s - before.t_s;
        let known = before.t_s <= t_s && t_s <= after.t_s && elapsed > 0.0 && elapsed <= PEN_GAP_MAX_S;
        let share = (t_s - before.t_s) / elapsed;
        known.then_some(PathSample {
            t_s,
            x_m: before.x_m + share * (after.x_m - before.x_m),
            y_m: before.y_m + share * (after.y_m - before.y_m),
            contact: before.contact && after.contact,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pen(f: impl Fn(f64) -> ([f64; 2], bool)) -> Vec<PathSample> {
        (0..400)
            .map(|i| {
                let t_s = f64::from(i) * 0.005;
                let ([x_m, y_m], contact) = f(t_s);
                PathSample { t_s, x_m, y_m, contact }
            })
            .collect()
    }

    fn tool(f: impl Fn(f64) -> [f64; 2]) -> Vec<ToolSample> {
        (0..1000)
            .map(|i| {
                let t_s = f64::from(i) * 0.002;
                let [x_m, y_m] = f(t_s);
                ToolSample { t_s, x_m, y_m }
            })
            .collect()
    }

    fn wave(t: f64) -> [f64; 2] {
        [0.03 * (9.0 * t).sin(), 0.02 * (14.0 * t).cos()]
    }

    #[test]
    fn a_tool_off_by_three_four_is_five_off_everywhere() {
        let t = tracking(&pen(|_| ([0.0, 0.0], true)), &tool(|_| [0.003, 0.004])).unwrap();
        assert!((t.rmse_m - 0.005).abs() < 1e-15 && (t.max_m - 0.005).abs() < 1e-15);
        assert!((t.mse_m2 - 2.5e-5).abs() < 1e-18);
    }

    #[test]
    fn lag_is_found_with_its_sign_and_below_the_grid() {
        for late_ms in [-37.4, 0.0, 12.3, 35.0, 140.7] {
            let t = tracking(&pen(|t| (wave(t), true)), &tool(|t| wave(t - late_ms * 1e-3))).unwrap();
            // Linear interpolation between 5 ms samples bends the error curve by less than 0.1 ms.
            assert!((t.lag_ms - late_ms).abs() < 0.1, "{late_ms}: {}", t.lag_ms);
        }
    }

    #[test]
    fn a_lag_beyond_the_range_ends_at_its_border() {
        let slow = |t: f64| [0.05 * t, 0.0];
        let t = tracking(&pen(|t| (slow(t), true)), &tool(|t| slow(t - 0.3))).unwrap();
        assert!((t.lag_ms - 200.0).abs() < 1e-9);
    }

    #[test]
    fn hover_is_not_scored() {
        let pen = pen(|t| (if t < 1.0 { [0.0, 0.0] } else { [1.0, 1.0] }, t < 1.0));
        let t = tracking(&pen, &tool(|_| [0.001, 0.0])).unwrap();
        assert!((t.max_m - 0.001).abs() < 1e-15);
        assert!(error_series(&pen, &tool(|_| [0.0, 0.0])).iter().any(|e| !e.contact && e.error_m > 1.0));
    }

    #[test]
    fn nothing_is_invented_inside_a_gap_of_the_pen() {
        let mut pen = pen(|t| ([t, 0.0], true));
        pen.retain(|s| !(0.5..0.7).contains(&s.t_s));
        let series = error_series(&pen, &tool(|t| [t, 0.0]));
        assert!(series.iter().all(|e| e.t_s <= 0.4951 || e.t_s >= 0.7));
        assert!(series.iter().all(|e| e.error_m < 1e-12));
    }

    #[test]
    fn without_overlap_there_is_no_score() {
        assert_eq!(tracking(&[], &tool(wave)), None);
        assert_eq!(tracking(&pen(|t| (wave(t), false)), &tool(wave)), None);
        let late: Vec<_> = tool(wave).iter().map(|s| ToolSample { t_s: s.t_s + 100.0, ..*s }).collect();
        assert_eq!(tracking(&pen(|t| (wave(t), true)), &late), None);
    }

    #[test]
    fn derivatives_of_a_sine_are_the_analytic_ones() {
        let (amplitude, omega) = (0.02, 12.0);
        let m = motion(&tool(|t| [amplitude * (omega * t).sin(), 0.0]));
        for (got, order) in [(m.peak_speed_mps, 1), (m.peak_acceleration_mps2, 2), (m.peak_jerk_mps3, 3)] {
            let exact = amplitude * omega.powi(order);
            assert!((got / exact - 1.0).abs() < 1e-3, "order {order}: {got} {exact}");
        }
        assert!((m.rms_jerk_mps3 / (amplitude * omega.powi(3) / 2f64.sqrt()) - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_gap_is_not_a_fast_motion() {
        let mut samples = tool(|t| [0.1 * t, 0.0]);
        samples.retain(|s| !(0.5..1.0).contains(&s.t_s));
        for s in samples.iter_mut().filter(|s| s.t_s >= 1.0) {
            s.y_m += 5.0;
        }
        let m = motion(&samples);
        assert!((m.peak_speed_mps - 0.1).abs() < 1e-9 && m.peak_acceleration_mps2 < 1e-6, "{m:?}");
    }
}
