//! What a run was worth, from its recording: distances from the pen, the ghost's, commands against limits.
//!
//! Contract: pure but for the reading. What a forged file holds that is not finite is left out.

use std::path::Path;

use foretrace_control::arm::JointLimits;
use foretrace_control::guard::CommandChecker;
use foretrace_control::units::Stamp;
use foretrace_shm::{AXES, JOINTS, Mode, Rung, TickInput, TickRecord, health};
use serde::Serialize;

use crate::RecordError;
use crate::read::{Content, RecordingEntry, RecordingReader};

/// Figures of a run; keys are stable.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Figures {
    /// From the first input to the last \[s\].
    pub seconds: f64,
    /// Comparisons of arm and ghost with the pen.
    pub compared: u64,
    /// Root mean square distance of the measured tool from the pen over these, in the plane \[mm\].
    pub rms_mm: Option<f64>,
    /// The same of the ghost: feedback alone, behind an arm of the same lag \[mm\].
    pub ghost_rms_mm: Option<f64>,
    /// How much less the first is than the second \[mm\].
    pub saved_mm: Option<f64>,
    /// Commands that were judged.
    pub commands: u64,
    /// Commands that broke a joint limit, jumped, or were out of order.
    pub violations: u64,
    /// Largest jerk of the plan's setpoints along an axis, from tick to tick \[m/s³\].
    pub max_jerk_mps3: f64,
    /// Ticks whose input is not in the file, between the first and the last.
    pub missing_ticks: u64,
    /// Why the file ends early; `None`: it is whole.
    pub damage: Option<String>,
}

/// Reads all of `path`, and judges its commands by `limits`.
///
/// # Errors
///
/// It is not a recording of this program's layout, or the disk fails.
pub fn figures(path: &Path, limits: JointLimits<JOINTS>) -> Result<Figures, RecordError> {
    let mut reader = RecordingReader::open(path)?;
    let mut run = FigureSums::new(limits);
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        match reader.content(&message)? {
            Content::Input(input) if input.part == 0 => run.input(&input),
            Content::Tick(record) => run.tick(&record),
            _ => {}
        }
    }
    Ok(run.figures(reader.damage()))
}

/// What has been read so far.
struct FigureSums {
    checker: CommandChecker<JOINTS>,
    /// Daemon and number of the last tick.
    last: Option<(u64, u64)>,
    times_ns: Option<(u64, u64)>,
    /// Sums of squares of the arm and the ghost \[m²\], and their number.
    squares: ([f64; 2], u64),
    /// Number, stamp \[ns\] and acceleration \[m/s²\] of the last setpoint that a plan made.
    planned: Option<(u64, u64, [f64; AXES])>,
    max_jerk: f64,
    missing: u64,
}

impl FigureSums {
    fn new(limits: JointLimits<JOINTS>) -> Self {
        Self {
            checker: CommandChecker::new(limits),
            last: None,
            times_ns: None,
            squares: ([0.0; 2], 0),
            planned: None,
            max_jerk: 0.0,
            missing: 0,
        }
    }

    fn input(&mut self, input: &TickInput) {
        let follows = match self.last {
            Some((daemon, tick)) if daemon == input.daemon_id => {
                self.missing += input.tick.saturating_sub(tick.saturating_add(1));
                tick.checked_add(1) == Some(input.tick)
            }
            _ => false,
        };
        self.last = Some((input.daemon_id, input.tick));
        let begin = self.times_ns.map_or(input.now_ns, |(begin, _)| begin);
        self.times_ns = Some((begin, input.now_ns));
        // Two commands can only be compared when nothing lies between them.
        if !follows || input.command_ns == 0 {
            self.checker.restart();
        }
        if input.command_ns != 0 {
            let (stamp, valid_until) = (Stamp(input.command_ns), Stamp(input.valid_until_ns));
            self.checker.observe(stamp, valid_until, &input.q, &input.qd);
        }
    }

    fn tick(&mut self, record: &TickRecord) {
        let now = (record.tick, record.command_stamp_ns, record.setpoint_mps2);
        let before = self.planned.replace(now).filter(|_| is_planned(record));
        if !is_planned(record) {
            self.planned = None;
        }
        if let Some((tick, stamp_ns, setpoint)) = before
            && tick.checked_add(1) == Some(record.tick)
            && record.command_stamp_ns > stamp_ns
        {
            let dt = (record.command_stamp_ns - stamp_ns) as f64 * 1e-9;
            let jerks =
                record.setpoint_mps2.iter().zip(setpoint).map(|(now, before)| (now - before).abs() / dt);
            self.max_jerk = jerks.filter(|jerk| jerk.is_finite()).fold(self.max_jerk, f64::max);
        }
        let both = [record.error_m, record.ghost_error_m];
        if record.compared_ns != 0 && both.iter().all(|error| error.is_finite() && *error >= 0.0) {
            for (sum, error) in self.squares.0.iter_mut().zip(both) {
                *sum += error * error;
            }
            self.squares.1 += 1;
        }
    }

    fn figures(&self, damage: Option<String>) -> Figures {
        let (sums, compared) = self.squares;
        let [rms, ghost] = sums.map(|sum| (compared > 0).then(|| (sum / compared as f64).sqrt() * 1e3));
        let statistics = self.checker.statistics();
        Figures {
            seconds: self.times_ns.map_or(0.0, |(begin, end)| end.saturating_sub(begin) as f64 * 1e-9),
            compared,
            rms_mm: rms,
            ghost_rms_mm: ghost,
            saved_mm: rms.zip(ghost).map(|(rms, ghost)| ghost - rms),
            commands: statistics.count,
            violations: statistics.limit_violations,
            max_jerk_mps3: self.max_jerk,
            missing_ticks: self.missing,
            damage,
        }
    }
}

/// Whether a plan, fresh or of a moment ago, made the setpoint, going on from the one before.
fn is_planned(record: &TickRecord) -> bool {
    let follows = matches!(Mode::try_from(record.mode), Ok(Mode::Following | Mode::Holding));
    let plan = matches!(Rung::try_from(record.rung), Ok(Rung::FreshPlan | Rung::PreviousPlan));
    follows && plan && record.health & health::RESYNCHRONISED == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run() -> FigureSums {
        FigureSums::new(JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [20.0; JOINTS]).unwrap())
    }

    fn input(tick: u64, q: f64) -> TickInput {
        let now_ns = 1_000_000_000 + 2_000_000 * tick;
        TickInput {
            daemon_id: 5,
            tick,
            now_ns,
            command_ns: now_ns + 2_000_000,
            valid_until_ns: now_ns + 12_000_000,
            q: [q; JOINTS],
            ..TickInput::default()
        }
    }

    fn compared(error_m: f64, ghost_error_m: f64) -> TickRecord {
        TickRecord { compared_ns: 7, error_m, ghost_error_m, ..TickRecord::default() }
    }

    #[test]
    fn distances_are_root_mean_squares_of_what_was_compared_with_both() {
        assert_eq!(run().figures(None).rms_mm, None);
        let mut run = run();
        for record in [compared(0.003, 0.005), compared(0.004, 0.005)] {
            run.tick(&record);
        }
        for unknown in [compared(0.1, -1.0), compared(-1.0, 0.1), compared(f64::NAN, 0.1)] {
            run.tick(&unknown);
        }
        run.tick(&TickRecord { error_m: 0.1, ghost_error_m: 0.1, ..TickRecord::default() });
        let reported = run.figures(None);
        let near = |value: Option<f64>, wanted: f64| (value.unwrap() - wanted).abs() < 1e-9;
        assert_eq!(reported.compared, 2);
        assert!(near(reported.rms_mm, 12.5_f64.sqrt()) && near(reported.ghost_rms_mm, 5.0), "{reported:?}");
        assert!(near(reported.saved_mm, 5.0 - 12.5_f64.sqrt()), "{reported:?}");
    }

    #[test]
    fn a_jump_is_a_violation_but_not_over_a_gap_or_a_pause_and_the_largest_jerk_counts_with_its_sign_gone() {
        let mut run = run();
        run.input(&input(1, 0.0));
        run.input(&input(2, 0.5));
        run.input(&input(7, 1.0));
        run.input(&TickInput { command_ns: 0, ..input(8, 1.0) });
        run.input(&input(9, 2.0));
        run.input(&TickInput { daemon_id: 6, ..input(10, 3.0) });
        let planned = |tick: u64, acceleration: f64| TickRecord {
            tick,
            mode: Mode::Following.into(),
            rung: Rung::FreshPlan.into(),
            command_stamp_ns: 2_000_000 * tick,
            setpoint_mps2: [acceleration, 0.0, f64::NAN],
            ..TickRecord::default()
        };
        // 0.015 m/s² in 2 ms; over a gap, a stop and a leap of its own nothing counts.
        for (tick, acceleration) in [(1, 0.0), (2, -0.015), (3, -0.02), (5, 9.0)] {
            run.tick(&planned(tick, acceleration));
        }
        run.tick(&TickRecord { rung: Rung::Stop.into(), ..planned(6, 20.0) });
        run.tick(&planned(7, 50.0));
        run.tick(&TickRecord { health: health::RESYNCHRONISED, ..planned(8, 90.0) });
        let reported = run.figures(Some("cut".to_owned()));
        assert_eq!(
            (reported.commands, reported.violations, reported.missing_ticks),
            (5, 1, 4),
            "{reported:?}"
        );
        assert!((reported.max_jerk_mps3 - 7.5).abs() < 1e-9, "{reported:?}");
        assert_eq!(reported.damage.as_deref(), Some("cut"));
        assert!((reported.seconds - 0.018).abs() < 1e-12, "{reported:?}");
    }
}
