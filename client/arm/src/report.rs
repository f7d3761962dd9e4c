//! The report of a run of the simulated arm.

use foretrace_control::guard::CommandStatistics;
use foretrace_report::extent::ExtentFigures;
use serde::Serialize;

use crate::refused::RefusedCommands;

/// The result; keys are stable.
#[derive(Debug, Serialize)]
pub struct SimReport {
    pub commands: CommandReport,
    pub arm: ArmReport,
    /// Where the tool was, by forward kinematics of the joints; none before the first command.
    pub envelope: Option<ExtentFigures>,
}

#[derive(Debug, Serialize)]
pub struct CommandReport {
    pub count: u64,
    pub limit_violations: u64,
    pub max_step_rad: f64,
    pub max_velocity_radps: f64,
    pub max_acceleration_radps2: f64,
    pub accepted: u64,
    pub refused: RefusedCommands,
    pub lost: u64,
    pub violations: ViolationReport,
}

impl CommandReport {
    /// What `seen` counted, and what became of the commands.
    pub(crate) const fn of(
        seen: &CommandStatistics,
        accepted: u64,
        lost: u64,
        refused: RefusedCommands,
    ) -> Self {
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
pub struct ViolationReport {
    pub not_finite: u64,
    pub stamp: u64,
    pub position: u64,
    pub velocity: u64,
    pub acceleration: u64,
    pub continuity: u64,
    pub viability: u64,
}

#[derive(Debug, Serialize)]
pub struct ArmReport {
    pub rate_hz: f64,
    pub cycles: u64,
    /// Cycles that the machine missed and that were made up for.
    pub late_cycles: u64,
    /// Longest that a cycle came late because others had the CPU \[ms\].
    pub starved_ms: f64,
    /// Why it had no real-time priority; none where it had.
    pub not_real_time: Option<String>,
    pub daemons: u64,
    /// From a target to its motion at low frequency, without jitter, when the run began and when it ended
    /// \[ms\]; none where speed scaling is 0.
    pub lag_ms: Option<f64>,
    pub lag_at_end_ms: Option<f64>,
    /// The pure delay as it was, jitter included \[ms\].
    pub delay_ms: DelayReport,
}

#[derive(Debug, Serialize)]
pub struct DelayReport {
    pub mean: f64,
    pub min: f64,
    pub max: f64,
}

/// The pure delays that occurred.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DelaySeen {
    sum_s: f64,
    count: u64,
    range_s: Option<(f64, f64)>,
}

impl DelaySeen {
    pub(crate) fn add(&mut self, delay_s: f64) {
        self.sum_s += delay_s;
        self.count += 1;
        let (low, high) = self.range_s.unwrap_or((delay_s, delay_s));
        self.range_s = Some((low.min(delay_s), high.max(delay_s)));
    }

    pub(crate) fn report(&self) -> DelayReport {
        let (low, high) = self.range_s.unwrap_or_default();
        DelayReport { mean: 1e3 * self.sum_s / self.count.max(1) as f64, min: 1e3 * low, max: 1e3 * high }
    }
}

impl SimReport {
    /// The report for people.
    pub fn lines(&self) -> Vec<String> {
        let Self { commands, arm, envelope } = self;
        let mut lines = vec![
            format!(
                "cycles      {} at {} Hz, {} made up for, at most {:.1} ms without a CPU",
                arm.cycles, arm.rate_hz, arm.late_cycles, arm.starved_ms
            ),
            format!(
                "commands    {} received, {} taken, {} refused, {} lost on the way",
                commands.count,
                commands.accepted,
                commands.refused.total(),
                commands.lost
            ),
        ];
        if commands.refused.total() > 0 {
            lines.push(format!("refused     {}", commands.refused));
        }
        let DelayReport { mean, min, max } = arm.delay_ms;
        lines.push(format!("delay       {mean:.1} ms before the servo ({min:.1} to {max:.1})"));
        lines.extend(envelope.map(|envelope| format!("tool        {envelope}")));
        lines.push(format!("violations  {}", commands.limit_violations));
        lines.push(format!(
            "largest     step {:.6} rad, velocity {:.4} rad/s, acceleration {:.3} rad/s²",
            commands.max_step_rad, commands.max_velocity_radps, commands.max_acceleration_radps2
        ));
        lines
    }
}
