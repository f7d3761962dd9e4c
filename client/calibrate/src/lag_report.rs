//! The report of a calibration: text, settings, JSON.

use std::path::Path;

use foretrace_sim::lag::{Identified, LagModel, Servo, Shift, Spread};
use serde::Serialize;

use crate::listener::MessageCounts;

/// The cost of compensating for the filter: it commands ahead of the planned motion, with more acceleration.
const HEADROOM: &str = "needs acceleration to spare: where fast writing saturates the arm's \
                        acceleration, the pure shift follows better";

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct CalibrationReport {
    /// From a command's instant to its motion at low frequency, by the chosen model.
    pub lag_ms: f64,
    /// Interquartile range of that over blocks of the motion.
    pub lag_interquartile_ms: f64,
    pub verdict: LagModel,
    /// The verdict for people.
    pub words: String,
    pub pure_delay: PureDelay,
    pub servo: ServoReport,
    pub settings: SettingsReport,
    /// Joints that counted, the one that moved most first.
    pub joints: Vec<JointReport>,
    pub heard: MessageCounts,
}

#[derive(Debug, Serialize)]
pub struct PureDelay {
    pub delay_ms: f64,
    /// Residual.
    pub rms_mrad: f64,
    pub spread: SpreadReport,
}

#[derive(Debug, Serialize)]
pub struct ServoReport {
    pub delay_ms: f64,
    /// Group delay of the critically damped second order.
    pub filter_ms: f64,
    /// First order behind it; 0 if it cannot be identified.
    pub joint_loop_ms: f64,
    /// Sum of the three.
    pub lag_ms: f64,
    pub rms_mrad: f64,
    /// Ratio of the pure delay's residual to this one.
    pub times_better: f64,
    /// Of `lag_ms`.
    pub spread: SpreadReport,
}

#[derive(Debug, Serialize)]
pub struct SpreadReport {
    pub median_ms: f64,
    pub interquartile_ms: f64,
    pub blocks_ms: Vec<f64>,
}

/// Values for the section `[timing]` of the settings.
#[derive(Debug, Serialize)]
pub struct SettingsReport {
    /// For a loop that only shifts: the shift with the smallest residual.
    pub dead_time_ms: f64,
    /// For a loop that compensates the servo's filter, where there is one.
    pub compensated: Option<Compensated>,
}

/// As [`SettingsReport`].
#[derive(Debug, Serialize)]
pub struct Compensated {
    /// The whole lag, filter included.
    pub dead_time_ms: f64,
    /// The part of it that the loop compensates for.
    pub servo_filter_ms: f64,
    /// What that requires.
    pub condition: &'static str,
}

impl Compensated {
    /// The part is never more than the whole, which the settings would refuse.
    fn of(servo: &Servo) -> Self {
        let dead_time_ms = tenth(ms(servo.lag_s()));
        let servo_filter_ms = tenth(ms(servo.filter_s)).min(dead_time_ms);
        Self { dead_time_ms, servo_filter_ms, condition: HEADROOM }
    }
}

#[derive(Debug, Serialize)]
pub struct JointReport {
    /// From 1, at the base.
    pub joint: usize,
    /// How far it was commanded, peak to peak.
    pub moved_mrad: f64,
}

impl CalibrationReport {
    pub(crate) fn new(found: &Identified, heard: MessageCounts) -> Self {
        let Identified { shift, servo, .. } = found;
        let times_better = shift.rms_rad / servo.rms_rad.max(1e-12);
        let (lag_s, spread) = match found.verdict {
            LagModel::PureDelay => (shift.delay_s, &found.shift_spread),
            LagModel::Servo => (servo.lag_s(), &found.lag_spread),
        };
        Self {
            lag_ms: ms(lag_s),
            lag_interquartile_ms: ms(spread.interquartile_s),
            verdict: found.verdict,
            words: words(found, times_better),
            pure_delay: PureDelay {
                delay_ms: ms(shift.delay_s),
                rms_mrad: ms(shift.rms_rad),
                spread: SpreadReport::of(&found.shift_spread),
            },
            servo: ServoReport {
                delay_ms: ms(servo.delay_s),
                filter_ms: ms(servo.filter_s),
                joint_loop_ms: ms(servo.joint_loop_s),
                lag_ms: ms(servo.lag_s()),
                rms_mrad: ms(servo.rms_rad),
                times_better,
                spread: SpreadReport::of(&found.lag_spread),
            },
            settings: SettingsReport {
                dead_time_ms: tenth(ms(shift.delay_s)),
                compensated: (found.verdict == LagModel::Servo).then(|| Compensated::of(servo)),
            },
            joints: found
                .joints
                .iter()
                .map(|joint| JointReport { joint: joint + 1, moved_mrad: ms(found.moved_rad[*joint]) })
                .collect(),
            heard,
        }
    }

    /// The report for people.
    pub fn lines(&self, plot: &Path) -> Vec<String> {
        let Self { pure_delay, servo, heard, .. } = self;
        let mut lines = vec![self.words.clone(), String::new()];
        lines.push(format!(
            "pure delay    {:.1} ms (blocks: median {:.1}, interquartile range {:.2} ms), leaves {:.3} mrad",
            pure_delay.delay_ms,
            pure_delay.spread.median_ms,
            pure_delay.spread.interquartile_ms,
            pure_delay.rms_mrad
        ));
        let joint_loop = match servo.joint_loop_ms {
            ms if ms > 0.05 => format!(" + joint loop {ms:.1}"),
            _ => String::new(),
        };
        lines.push(format!(
            "with servo    delay {:.1} + filter {:.1}{joint_loop} = {:.1} ms (interquartile range {:.2} ms), \
             leaves {:.3} mrad",
            servo.delay_ms, servo.filter_ms, servo.lag_ms, servo.spread.interquartile_ms, servo.rms_mrad
        ));
        let joints: Vec<String> = self
            .joints
            .iter()
            .map(|joint| format!("{} by {:.1} mrad", joint.joint, joint.moved_mrad))
            .collect();
        lines.push(format!("joints        {}", joints.join(", ")));
        lines.push(format!(
            "received      {} commands ({} lost), {} joint states ({} lost)",
            heard.commands, heard.commands_lost, heard.states, heard.states_lost
        ));
        lines.push(format!("plot          {}", plot.display()));
        lines.push(String::new());
        lines.push("For the settings file:".to_owned());
        lines.push("  [timing]".to_owned());
        lines.push(format!("  dead_time_ms = {:.1}", self.settings.dead_time_ms));
        if let Some(compensated) = &self.settings.compensated {
            lines.push("or, with the servo's filter made up for, a part of the whole:".to_owned());
            lines.push("  [timing]".to_owned());
            lines.push(format!("  dead_time_ms = {:.1}", compensated.dead_time_ms));
            lines.push(format!("  servo_filter_ms = {:.1}", compensated.servo_filter_ms));
            lines.push(format!("This {}.", compensated.condition));
        }
        lines
    }
}

impl SpreadReport {
    fn of(spread: &Spread) -> Self {
        Self {
            median_ms: ms(spread.median_s),
            interquartile_ms: ms(spread.interquartile_s),
            blocks_ms: spread.blocks_s.iter().map(|s| ms(*s)).collect(),
        }
    }
}

fn words(found: &Identified, times_better: f64) -> String {
    let Identified { shift: Shift { delay_s, .. }, servo, .. } = found;
    let plus_minus = |value_s: f64, spread: &Spread| {
        format!("{:.1} ms ± {:.2}", ms(value_s), ms(0.5 * spread.interquartile_s))
    };
    match found.verdict {
        LagModel::PureDelay => format!("pure delay {}", plus_minus(*delay_s, &found.shift_spread)),
        LagModel::Servo => {
            let Servo { delay_s, filter_s, joint_loop_s, .. } = *servo;
            format!(
                "delay {:.1} ms + servo filter {:.1} ms, together {}, explain the motion {times_better:.1} \
                 times better than a pure delay",
                ms(delay_s + joint_loop_s),
                ms(filter_s),
                plus_minus(servo.lag_s(), &found.lag_spread)
            )
        }
    }
}

fn ms(seconds: f64) -> f64 {
    seconds * 1e3
}

/// Rounded to what a settings file needs; never below 0, which is its range.
fn tenth(ms: f64) -> f64 {
    (ms.max(0.0) * 10.0).round() / 10.0
}

#[cfg(test)]
mod tests {
    use super::{Compensated, Servo};

    #[test]
    fn the_dead_time_is_the_whole_and_the_filter_a_part_of_it() {
        let servo =
            |delay_s, filter_s, joint_loop_s| Servo { delay_s, filter_s, joint_loop_s, rms_rad: 1e-4 };
        let found = Compensated::of(&servo(0.0081, 0.0302, 0.0021));
        assert_eq!((found.dead_time_ms, found.servo_filter_ms), (40.4, 30.2));
        assert!(found.condition.contains("acceleration"));
        // A fit may put the delay a little below 0; the settings would refuse a part that exceeds the whole.
        let found = Compensated::of(&servo(-0.0006, 0.030, 0.0));
        assert_eq!((found.dead_time_ms, found.servo_filter_ms), (29.4, 29.4));
    }
}
