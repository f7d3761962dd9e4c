//! The picture of a calibration: the joint that moves most, commanded, measured and explained.

use std::path::Path;

use foretrace_sim::lag::{Identified, Sample, Servo, modelled};
use foretrace_sim::plot::{ChartPanel, Line, Mark, PlotError, panels_and_curve};

/// Length of the motion that is shown [s]: short enough to see milliseconds.
const SHOWN_S: f64 = 2.0;
/// Shifts farther from the best are not shown \[s\].
const NEAR_S: f64 = 0.08;

/// Draws the middle of the motion, the residuals of both models, and the error against the shift.
///
/// # Errors
///
/// [`PlotError`].
pub(crate) fn draw(
    file: &Path,
    words: &str,
    found: &Identified,
    commands: &[Sample],
    states: &[Sample],
) -> Result<(), PlotError> {
    let joint = found.joints.first().copied().unwrap_or_default();
    let middle_s = 0.5 * (found.window_s.0 + found.window_s.1);
    let shown = |samples: &[Sample]| -> Vec<(f64, f64)> {
        let inside = samples.iter().filter(|sample| (sample.t_s - middle_s).abs() <= 0.5 * SHOWN_S);
        inside.map(|sample| (sample.t_s, sample.q[joint])).collect()
    };
    let (commanded, measured) = (shown(commands), shown(states));
    let times: Vec<f64> = measured.iter().map(|(t_s, _)| *t_s).collect();
    let delay = Servo {
        delay_s: found.shift.delay_s,
        filter_s: 0.0,
        joint_loop_s: 0.0,
        rms_rad: found.shift.rms_rad,
    };
    let shifted = modelled(commands, joint, &delay, &times);
    let filtered = modelled(commands, joint, &found.servo, &times);

    // Each model was fitted with a free constant offset, which is subtracted here too.
    let offset = |model: &[f64]| {
        let sum: f64 = measured.iter().zip(model).map(|((_, q), model)| q - model).sum();
        sum / measured.len().max(1) as f64
    };
    let middle = measured.iter().map(|(_, q)| q).sum::<f64>() / measured.len().max(1) as f64;
    let about = |points: &[(f64, f64)], by: f64| -> Vec<(f64, f64)> {
        points.iter().map(|(t_s, q)| (*t_s, (q - middle + by) * 1e3)).collect()
    };
    let timed =
        |model: &[f64]| -> Vec<(f64, f64)> { times.iter().copied().zip(model.iter().copied()).collect() };
    let left = |model: &[f64]| -> Vec<(f64, f64)> {
        let by = offset(model);
        measured.iter().zip(model).map(|((t_s, q), model)| (*t_s, (q - model - by) * 1e3)).collect()
    };
    let (by_shift, by_servo) = (offset(&shifted), offset(&filtered));
    let command_line = about(&commanded, by_servo);
    let measured_line = about(&measured, 0.0);
    let shifted_line = about(&timed(&shifted), by_shift);
    let servo_line = about(&timed(&filtered), by_servo);
    let (shift_left, servo_left) = (left(&shifted), left(&filtered));
    let near = |shift_s: &f64| (shift_s - found.shift.delay_s).abs() <= NEAR_S;
    let curve: Vec<(f64, f64)> = found
        .curve
        .iter()
        .filter(|(shift_s, _)| near(shift_s))
        .map(|(shift_s, rad)| (shift_s * 1e3, rad * 1e3))
        .collect();
    let floor: Vec<(f64, f64)> = [curve.first(), curve.last()]
        .into_iter()
        .flatten()
        .map(|(ms, _)| (*ms, found.servo.rms_rad * 1e3))
        .collect();

    let line = |label, points, mark| Line { label, points, mark };
    let moved = [
        line("commanded", command_line.as_slice(), Mark::Solid),
        line("measured", measured_line.as_slice(), Mark::Solid),
    ];
    let overlay = [
        line("measured", measured_line.as_slice(), Mark::Solid),
        line("commands, shifted", shifted_line.as_slice(), Mark::Thin),
        line("commands through delay and servo", servo_line.as_slice(), Mark::Thin),
    ];
    let rest = [
        line("commands, shifted", shift_left.as_slice(), Mark::Solid),
        line("commands through delay and servo", servo_left.as_slice(), Mark::Solid),
    ];
    let number = joint + 1;
    let (moved_label, rest_label) = (format!("joint {number} [mrad]"), "measured − model [mrad]");
    let panels = [
        ChartPanel { y_label: &moved_label, y_range: None, lines: &moved },
        ChartPanel { y_label: &moved_label, y_range: None, lines: &overlay },
        ChartPanel { y_label: rest_label, y_range: None, lines: &rest },
    ];
    let error = [
        line("commands, shifted", curve.as_slice(), Mark::Solid),
        line("commands through delay and servo", floor.as_slice(), Mark::Thin),
    ];
    let curve = ChartPanel { y_label: "left unexplained, RMS [mrad]", y_range: None, lines: &error };
    panels_and_curve(
        file,
        "How late the arm is",
        words,
        ("time [s]", "shift of the commands [ms]"),
        &panels,
        &curve,
    )
}
