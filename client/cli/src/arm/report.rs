//! The report of a run of the simulated arm.

use foretrace_control::guard::CommandStatistics;
use serde::Serialize;

use super::refused::Refused;
use crate::extent::ExtentFigures;
use crate::output::say;

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub(super) struct SimReport {
    pub(super) commands: CommandReport,
    pub(super) arm: ArmReport,
    /// Where the tool was, by forward kinematics of the joints; none before the first command.
    pub(super) envelope: Option<ExtentFigures>,
}

#[derive(Debug, Serialize)]
pub(super) struct CommandReport {
    pub(super) count: u64,
    pub(super) limit_violations: u64,
    pub(super) max_step_rad: f64,
    pub(super) max_velocity_radps: f64,
    pub(super) max_acceleration_radps2: f64,
    pub(super) accepted: u64,
    pub(super) refused: Refused,
    pub(super) lost: u64,
    pub(super) violations: ViolationReport,
}

impl CommandReport {
    /// What `seen` counted, and what became of the commands.
    pub(super) const fn of(seen: &CommandStatistics, accepted: u64, lost: u64, refused: Refused) -> Self {
        let broken = seen.violations;
        Self {
            count: seen.count,
            limit_violations: seen.limit_violations,
            max_step_rad: seen.max_step_rad,
            max_velocity_radps: seen.max_velocity_radps,
            max_acceleration_radps2: seen.max_acceleration_radps2,
            accepted,
            refused,
            lost,
            violations: ViolationReport {
                not_finite: broken.not_finite,
                stamp: broken.stamp,
                position: broken.position,
                velocity: broken.velocity,
                acceleration: broken.acceleration,
                continuity: broken.continuity,
                viability: broken.viability,
            },
        }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct ViolationReport {
    pub(super) not_finite: u64,
    pub(super) stamp: u64,
    pub(super) position: u64,
    pub(super) velocity: u64,
    pub(super) acceleration: u64,
    pub(super) continuity: u64,
    pub(super) viability: u64,
}

#[derive(Debug, Serialize)]
pub(super) struct ArmReport {
    pub(super) rate_hz: f64,
    pub(super) cycles: u64,
    /// Cycles that the machine missed and that were made up for.
    pub(super) late_cycles: u64,
    /// Longest that a cycle came late because others had the CPU [ms].
    pub(super) starved_ms: f64,
    /// Why it had no real-time priority; none where it had.
    pub(super) not_real_time: Option<String>,
    pub(super) daemons: u64,
    /// From a target to its motion at low frequency, without jitter, when the run began and when it ended
    /// [ms]; none where speed scaling is 0.
    pub(super) lag_ms: Option<f64>,
    pub(super) lag_at_end_ms: Option<f64>,
    /// The pure delay as it was, jitter included [ms].
    pub(super) delay_ms: DelayReport,
}

#[derive(Debug, Serialize)]
pub(super) struct DelayReport {
    pub(super) mean: f64,
    pub(super) min: f64,
    pub(super) max: f64,
}

/// The pure delays that occurred.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DelaySeen {
    sum_s: f64,
    count: u64,
    range_s: Option<(f64, f64)>,
}

impl DelaySeen {
    pub(super) fn add(&mut self, delay_s: f64) {
        self.sum_s += delay_s;
        self.count += 1;
        let (low, high) = self.range_s.unwrap_or((delay_s, delay_s));
        self.range_s = Some((low.min(delay_s), high.max(delay_s)));
    }

    pub(super) fn report(&self) -> DelayReport {
        let (low, high) = self.range_s.unwrap_or_default();
        DelayReport { mean: 1e3 * self.sum_s / self.count.max(1) as f64, min: 1e3 * low, max: 1e3 * high }
    }
}

/// The report for people.
pub(super) fn summary(report: &SimReport) {
    let SimReport { commands, arm, envelope } = report;
    say!(
        "cycles      {} at {} Hz, {} made up for, at most {:.1} ms without a CPU",
        arm.cycles,
        arm.rate_hz,
        arm.late_cycles,
        arm.starved_ms
    );
    say!(
        "commands    {} received, {} taken, {} refused, {} lost on the way",
        commands.count,
        commands.accepted,
        commands.refused.total(),
        commands.lost
    );
    if commands.refused.total() > 0 {
        say!("refused     {}", commands.refused);
    }
    let delay = &arm.delay_ms;
    say!("delay       {:.1} ms before the servo ({:.1} to {:.1})", delay.mean, delay.min, delay.max);
    if let Some(envelope) = envelope {
        say!("tool        {envelope}");
    }
    say!("violations  {}", commands.limit_violations);
    say!(
        "largest     step {:.6} rad, velocity {:.4} rad/s, acceleration {:.3} rad/s²",
        commands.max_step_rad,
        commands.max_velocity_radps,
        commands.max_acceleration_radps2
    );
}
