//! How the simulated arm treats the commands it receives: which ones it refuses, and where its joints should
//! be.
//!
//! Contract: time is an argument, nothing here touches the shared memory. A command is refused when it is
//! malformed, of another boot, older than another one, past its validity, or more than 20 rad/s away from the
//! present target; then the target goes on as the last accepted command says: along it until it expires, then
//! braking to rest. Every command that may be ours is also judged against the limits by stamps, refused or
//! not.

use std::collections::VecDeque;

use foretrace_control::arm::limits::{JointLimits, JointMotion};
use foretrace_control::guard::{CommandStatistics, Commanded, consumer_state};
use foretrace_control::units::Stamp;
use foretrace_shm::{HeaderBounds, HeaderCheck, JointCommand, Validate, command_flags};
use foretrace_sim::arm::JOINTS;

use crate::judge::Judge;
use crate::refused::{CommandRefusal, JUMP_RADPS, RefusedCommands};

/// The arm's memory of commands.
#[derive(Debug)]
pub(crate) struct CommandIntake {
    cycle_s: f64,
    header: HeaderCheck,
    deceleration: [f64; JOINTS],
    judge: Judge,
    /// Accepted and not yet past, oldest first; never empty.
    held: VecDeque<HeldCommand>,
    /// The newest command taken, and when.
    newest: Option<(JointCommand, Stamp)>,
    accepted: u64,
    refused: RefusedCommands,
}

#[derive(Debug, Clone, Copy)]
struct HeldCommand {
    command: Commanded<JOINTS>,
    valid_until: Stamp,
}

impl CommandIntake {
    /// More commands than this between two cycles are more than a controller would keep.
    const KEPT: usize = 256;

    /// An arm at rest at `q` \[rad\], cycling every `cycle_s`, that judges by `limits` and accepts stamps of
    /// `boot_id`. `None` unless `q` is finite.
    pub(crate) fn new(
        boot_id: u64,
        limits: JointLimits<JOINTS>,
        cycle_s: f64,
        q: [f64; JOINTS],
    ) -> Option<Self> {
        let rest =
            HeldCommand { command: Commanded::at_rest(Stamp::default(), q)?, valid_until: Stamp::default() };
        Some(Self {
            cycle_s,
            header: HeaderCheck::new(boot_id, HeaderBounds { future_ns: 50_000_000, age_ns: u64::MAX }),
            deceleration: *limits.deceleration(),
            judge: Judge::new(limits),
            held: VecDeque::from([rest]),
            newest: None,
            accepted: 0,
            refused: RefusedCommands::default(),
        })
    }

    /// Takes or refuses a command read at `now` for the cycle due at `due` (earlier, where the machine
    /// slept); true when taken.
    pub(crate) fn receive(&mut self, command: &JointCommand, now: Stamp, due: Stamp) -> bool {
        if let Err(reason) = self.header.admit(&command.header, now.0) {
            self.refused.note(CommandRefusal::Header(reason));
            return false;
        }
        let (stamp, valid_until) = (Stamp(command.header.stamp_ns), Stamp(command.valid_until_ns));
        self.judge.see(command);
        let Some(held) = self.judged(command, stamp, valid_until, due) else { return false };
        self.accepted += 1;
        self.newest = Some((*command, now));
        if self.held.len() >= Self::KEPT {
            self.held.pop_front();
        }
        self.held.push_back(held);
        true
    }

    /// Where the joints ought to be at `now` \[rad\].
    pub(crate) fn target(&mut self, now: Stamp) -> [f64; JOINTS] {
        // Until a command's stamp the line to it holds; then the next one's.
        while self.held.len() > 1 && self.held.front().is_some_and(|held| held.command.stamp() < now) {
            self.held.pop_front();
        }
        self.held.front().map_or([0.0; JOINTS], |held| self.wanted(held, now).q)
    }

    /// Where the arm rests at `now` \[rad\]; `None` while a command is in force, or it still brakes.
    pub(crate) fn rest(&self, now: Stamp) -> Option<[f64; JOINTS]> {
        let held = self.held.back()?;
        let motion = self.wanted(held, now);
        (now > held.valid_until && motion.qd == [0.0; JOINTS]).then_some(motion.q)
    }

    /// Lets an arm at rest rest at `q` instead \[rad\]; without an effect where `q` is not finite.
    pub(crate) fn put(&mut self, q: [f64; JOINTS]) {
        if let Some(command) = Commanded::at_rest(Stamp::default(), q) {
            self.held = VecDeque::from([HeldCommand { command, valid_until: Stamp::default() }]);
        }
    }

    /// The newest command taken, and when.
    pub(crate) fn newest(&self) -> Option<&(JointCommand, Stamp)> {
        self.newest.as_ref()
    }

    pub(crate) fn accepted(&self) -> u64 {
        self.accepted
    }

    pub(crate) fn refused(&self) -> &RefusedCommands {
        &self.refused
    }

    /// Commands missing in the sender's sequence.
    pub(crate) fn lost(&self) -> u64 {
        self.header.dropped()
    }

    pub(crate) fn statistics(&self) -> &CommandStatistics {
        self.judge.statistics()
    }

    fn judged(
        &mut self,
        command: &JointCommand,
        stamp: Stamp,
        valid_until: Stamp,
        due: Stamp,
    ) -> Option<HeldCommand> {
        if let Err(reason) = command.validate() {
            self.refused.note(CommandRefusal::Malformed(reason));
            return None;
        }
        if valid_until < due {
            self.refused.note(CommandRefusal::Stale { late_s: due.seconds_since(valid_until) });
            return None;
        }
        let newest = *self.held.back()?;
        let wanted = self.wanted(&newest, stamp);
        let elapsed = stamp.seconds_since(newest.command.stamp()).clamp(0.0, self.cycle_s);
        let reach = JUMP_RADPS * elapsed.max(self.cycle_s);
        let away = wanted.q.iter().zip(&command.q).map(|(a, b)| (a - b).abs());
        if let Some((joint, away)) = away.enumerate().find(|(_, away)| !(*away <= reach)) {
            self.refused.note(CommandRefusal::Jump { joint, away, reach });
            return None;
        }
        let enabled = command.flags & command_flags::ENABLED != 0;
        let qd = if enabled { command.qd } else { [0.0; JOINTS] };
        let motion = JointMotion { q: command.q, qd, qdd: [0.0; JOINTS] };
        Some(HeldCommand { command: Commanded::new(stamp, motion)?, valid_until })
    }

    fn wanted(&self, held: &HeldCommand, now: Stamp) -> JointMotion<JOINTS> {
        consumer_state(&held.command, held.valid_until, &self.deceleration, now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::{Header, Mode};

    const BOOT: u64 = 7;
    const TICK_NS: u64 = 2_000_000;

    fn receive(intake: &mut CommandIntake, command: &JointCommand, now: Stamp) -> bool {
        intake.receive(command, now, now)
    }

    fn intake() -> CommandIntake {
        let limits = JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [20.0; JOINTS]).unwrap();
        CommandIntake::new(BOOT, limits, 0.002, [0.0; JOINTS]).unwrap()
    }

    fn command(sequence: u64, q: f64, qd: f64) -> JointCommand {
        let stamp_ns = (sequence + 1) * TICK_NS;
        JointCommand {
            header: Header { sequence, stamp_ns, boot_id: BOOT },
            tick: sequence,
            valid_until_ns: stamp_ns + 5 * TICK_NS,
            q: [q; JOINTS],
            qd: [qd; JOINTS],
            mode: Mode::Following.into(),
            flags: command_flags::ENABLED,
            ..JointCommand::default()
        }
    }

    fn at(sequence: u64) -> Stamp {
        Stamp(sequence * TICK_NS)
    }

    #[test]
    fn arm_without_commands_wants_to_stay() {
        assert_eq!(intake().target(at(1000)), [0.0; JOINTS]);
    }

    #[test]
    fn between_commands_the_target_moves_along_the_line() {
        let mut intake = intake();
        let speed = 0.04;
        for k in 1..=10 {
            assert!(receive(&mut intake, &command(k, speed * 0.002 * k as f64, speed), at(k)));
            // Half a tick before the stamp of the newest command.
            let target = intake.target(Stamp(at(k).0 + TICK_NS / 2))[0];
            assert!((target - speed * 0.002 * (k as f64 - 0.5)).abs() < 1e-12, "{target}");
        }
        assert_eq!(intake.statistics().limit_violations, 0);
        assert!(intake.newest().is_some_and(|(command, taken)| command.tick == 10 && *taken == at(10)));
    }

    #[test]
    fn silence_is_answered_by_extrapolation_then_braking_to_rest() {
        let mut intake = intake();
        assert!(receive(&mut intake, &command(1, 0.0, 1.0), at(1)));
        let stamp = at(2);
        assert!((intake.target(stamp.plus_ns(10_000_000))[0] - 0.01).abs() < 1e-12);
        // 1 rad/s at 20 rad/s² stops within 50 ms and 25 mrad.
        let rest = intake.target(stamp.plus_ns(1_000_000_000))[0];
        assert!((rest - 0.035).abs() < 1e-12, "{rest}");
        assert_eq!(intake.target(stamp.plus_ns(2_000_000_000))[0], rest);
    }

    #[test]
    fn foreign_stale_malformed_and_jumping_commands_are_refused_and_counted_apart() {
        let mut intake = intake();
        let foreign = JointCommand {
            header: Header { boot_id: 8, ..command(1, 0.0, 0.0).header },
            ..command(1, 0.0, 0.0)
        };
        assert!(!receive(&mut intake, &foreign, at(1)));
        assert!(!receive(&mut intake, &command(2, 0.0, 0.0), at(100)));
        let malformed = JointCommand { mode: 99, ..command(3, 0.0, 0.0) };
        assert!(!receive(&mut intake, &malformed, at(3)));
        assert!(!receive(&mut intake, &command(4, 0.5, 0.0), at(4)));
        let refused = *intake.refused();
        assert_eq!([refused.header, refused.malformed, refused.stale, refused.jump], [1; 4]);
        let told = refused.to_string();
        assert!(told.contains("newest: joint 0 is commanded 0.5000 rad away from"), "{told}");
        assert_eq!(intake.target(at(5)), [0.0; JOINTS]);
        assert!(receive(&mut intake, &command(6, 0.0, 0.0), at(6)));
    }

    #[test]
    fn illegal_command_is_counted_even_when_it_is_taken() {
        let mut intake = intake();
        assert!(receive(&mut intake, &command(1, 0.0, 0.0), at(1)));
        assert!(receive(&mut intake, &command(2, 0.008, 4.0), at(2)));
        let seen = intake.statistics();
        assert_eq!((seen.count, seen.limit_violations), (2, 1));
        assert!((seen.max_velocity_radps - 4.0).abs() < 1e-9);
    }

    #[test]
    fn catching_up_uses_the_command_that_was_due_then() {
        // Ten commands arrive at once after a stall: each cycle in the past sees the line it would have seen.
        let mut intake = intake();
        let speed = 0.04;
        for k in 1..=10 {
            assert!(receive(&mut intake, &command(k, speed * 0.002 * k as f64, speed), at(5)));
        }
        for k in 1..=10_u64 {
            let target = intake.target(at(k + 1))[0];
            assert!((target - speed * 0.002 * k as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn disabled_command_stops_the_arm_where_it_says() {
        let mut intake = intake();
        let stop = JointCommand { flags: 0, ..command(1, 0.001, 1.0) };
        assert!(receive(&mut intake, &stop, at(1)));
        assert_eq!(intake.target(at(500)), [0.001; JOINTS]);
    }
}
