//! Judges joint commands as a hardware interface would, from the messages alone.
//!
//! Contract: shares no code with the guard, the arm or `CommandChecker`: limits, stamps and the consumer's
//! rule are defined here independently. Counts and keeps the first examples, never alters. Absent: jerk,
//! which the preset does not limit.

use std::collections::VecDeque;

use foretrace_shm::{JOINTS, JointCommand, JointState, command_flags, host_boot_id};
use serde_json::{Value, json};

use crate::tool::Tip;

/// Joint limits of the preset `ur5`: URDF positions \[rad\], `robot.velocity_radps`,
/// `robot.acceleration_radps2`.
const POSITION_RAD: [f64; JOINTS] = [TURN, TURN, TURN / 2.0, TURN, TURN, TURN];
const TURN: f64 = std::f64::consts::TAU;
/// \[rad/s\]
pub const VELOCITY: f64 = 3.1;
/// \[rad/s²\]
pub const ACCELERATION: f64 = 40.0;
/// Deceleration of an arm without commands [rad/s²]: `robot.stale_deceleration_radps2`.
const DECELERATION: f64 = 20.0;
/// A command may begin this far from where the arm was measured last before it was sent \[rad\].
const BEGIN_RAD: f64 = 0.02;
/// Rounding: relative for rates, absolute for positions \[rad\].
const RELATIVE: f64 = 1e-6;
const ROUNDING_RAD: f64 = 1e-9;
/// A stamp lies at most this far after the moment of sending \[ns\], and validity at most so far after the
/// stamp.
const AHEAD_NS: u64 = 20_000_000;
const VALID_NS: u64 = 1_000_000_000;
const EXAMPLES: usize = 5;
/// States kept: as many as a recorder may find after a second without CPU time.
const STATES: usize = 1024;
/// Longest gap in the states across which the arm's position counts as known \[ns\].
const GAP_NS: u64 = 50_000_000;

/// Memory and findings of one judge.
#[derive(Debug, Default)]
pub struct Judge {
    last: Option<JointCommand>,
    /// Stamps and positions, oldest first.
    measured: VecDeque<(u64, [f64; JOINTS])>,
    begins_unjudged: u64,
    seen: u64,
    missed: u64,
    before: u64,
    streams: u64,
    begins: u64,
    largest_jump_rad: f64,
    largest_velocity: f64,
    largest_acceleration: f64,
    tip: Tip,
    violations: u64,
    examples: Vec<String>,
}

impl Judge {
    /// Records the arm's state, for the next first command.
    pub fn state(&mut self, state: &JointState) {
        let stamp_ns = state.header.stamp_ns;
        if state.q.iter().any(|q| !q.is_finite()) {
            return self.measured.clear();
        }
        // Before the first command the arm had no commands.
        if self.seen > 0 {
            self.tip.see(&state.q);
        }
        while self.measured.back().is_some_and(|(newest, _)| *newest >= stamp_ns) {
            self.measured.pop_back();
        }
        if self.measured.len() >= STATES {
            self.measured.pop_front();
        }
        self.measured.push_back((stamp_ns, state.q));
    }

    /// Judges the next command as it lies in shared memory.
    pub fn command(&mut self, command: &JointCommand) {
        self.seen += 1;
        let mut broken: Vec<&str> = Vec::new();
        let before = self.neighbour(command, &mut broken);
        self.alone(command, &mut broken);
        if command.flags & command_flags::BEGINS != 0 {
            self.begins += 1;
            self.begin(command, &mut broken);
        } else if let Some(before) = before {
            self.pair(&before, command, &mut broken);
        }
        if !broken.is_empty() {
            self.violations += 1;
            if self.examples.len() < EXAMPLES {
                self.examples.push(format!("{}: {command:?} after {before:?}", broken.join(", ")));
            }
        }
        self.last = Some(*command);
    }

    /// The command directly before this one, if it was seen.
    fn neighbour(&mut self, command: &JointCommand, broken: &mut Vec<&str>) -> Option<JointCommand> {
        let sequence = command.header.sequence;
        match self.last {
            Some(last) if sequence > last.header.sequence => {
                let missing = sequence - last.header.sequence - 1;
                self.missed += missing;
                (missing == 0).then_some(last)
            }
            // Another daemon, whose first command must say that it begins.
            found => {
                self.streams += 1;
                if sequence == 1 && command.flags & command_flags::BEGINS == 0 {
                    broken.push("a stream without a beginning");
                }
                if found.is_some_and(|last| command.header.stamp_ns <= last.header.stamp_ns) {
                    broken.push("a new stream in the past");
                }
                self.before += sequence.saturating_sub(1);
                None
            }
        }
    }

    fn alone(&mut self, command: &JointCommand, broken: &mut Vec<&str>) {
        if !command.q.iter().chain(&command.qd).all(|x| x.is_finite()) {
            broken.push("not finite");
        }
        if command.q.iter().zip(POSITION_RAD).any(|(q, limit)| q.abs() > limit + ROUNDING_RAD) {
            broken.push("position");
        }
        for qd in command.qd {
            self.largest_velocity = self.largest_velocity.max(qd.abs());
        }
        if command.qd.iter().any(|qd| qd.abs() > VELOCITY * (1.0 + RELATIVE)) {
            broken.push("velocity");
        }
        if ends_outside(command) {
            broken.push("no stop inside");
        }
        let stamp = command.header.stamp_ns;
        if stamp > command.published_ns + AHEAD_NS
            || !(stamp..=stamp + VALID_NS).contains(&command.valid_until_ns)
        {
            broken.push("times");
        }
        if command.header.boot_id != host_boot_id() {
            broken.push("boot");
        }
    }

    /// A first command stands where the arm stands.
    fn begin(&mut self, command: &JointCommand, broken: &mut Vec<&str>) {
        // A delayed recorder reads states that are newer than the command: they already show its effect.
        let sent_ns = command.published_ns;
        let Some(place) = self.measured.iter().rposition(|(stamp_ns, _)| *stamp_ns <= sent_ns) else {
            self.begins_unjudged += 1;
            return;
        };
        let (stamp_ns, measured) = self.measured[place];
        if self.measured.get(place + 1).is_some_and(|(next_ns, _)| next_ns - stamp_ns > GAP_NS) {
            self.begins_unjudged += 1;
            return;
        }
        if command.q.iter().zip(measured).any(|(q, m)| !((q - m).abs() <= BEGIN_RAD)) {
            broken.push("begins elsewhere");
        }
        if command.qd.iter().any(|qd| qd.abs() > ACCELERATION * 0.01) {
            broken.push("begins in motion");
        }
    }

    fn pair(&mut self, a: &JointCommand, b: &JointCommand, broken: &mut Vec<&str>) {
        if b.header.stamp_ns <= a.header.stamp_ns || b.published_ns < a.published_ns {
            broken.push("time does not go on");
            return;
        }
        let seconds = |from: u64, to: u64| to.wrapping_sub(from).cast_signed() as f64 * 1e-9;
        let span = seconds(a.header.stamp_ns, b.header.stamp_ns);
        let (to_switch, left) =
            (seconds(a.header.stamp_ns, b.published_ns), seconds(b.published_ns, b.header.stamp_ns));
        let expired = b.header.stamp_ns > a.valid_until_ns;
        let (mut fast, mut hard, mut torn, mut jump) = (false, false, false, false);
        for joint in 0..JOINTS {
            let (v0, v1) = (a.qd[joint], b.qd[joint]);
            let way = b.q[joint] - a.q[joint];
            let change = (v1 - v0).abs() / span;
            self.largest_acceleration = self.largest_acceleration.max(change);
            fast |= !(way.abs() <= VELOCITY * span * (1.0 + RELATIVE) + ROUNDING_RAD);
            hard |= !(change <= ACCELERATION * (1.0 + RELATIVE));
            // On the way from one line to the other: nothing faster than the faster, nothing slower than the
            // slower.
            let rest = if expired { 0.0 } else { v0 };
            let slow = v0.min(v1).min(rest) * span - ROUNDING_RAD;
            let quick = v0.max(v1).max(rest) * span + ROUNDING_RAD;
            torn |= !(slow <= way && way <= quick);
            // As the consumer sees it: at the moment of sending, the old line and the new one are this far
            // apart.
            let apart = (way - v1 * left - v0 * to_switch).abs();
            let allowed = ACCELERATION * span * (to_switch.abs() + span) + ROUNDING_RAD;
            jump |= !(apart <= allowed);
            if span < 0.01 {
                self.largest_jump_rad = self.largest_jump_rad.max(apart);
            }
        }
        let rules = [(fast, "way"), (hard, "acceleration"), (torn, "continuity"), (jump, "jump")];
        broken.extend(rules.iter().filter(|(is, _)| *is).map(|(_, rule)| *rule));
    }

    /// Number of the newest command in its daemon's sequence; 0: none.
    #[must_use]
    pub fn sequence(&self) -> u64 {
        self.last.map_or(0, |last| last.header.sequence)
    }

    /// Everything found.
    #[must_use]
    pub fn report(&self) -> Value {
        json!({
            "seen": self.seen, "missed": self.missed, "before": self.before,
            "streams": self.streams, "begins": self.begins,
            "begins_unjudged": self.begins_unjudged, "last_sequence": self.sequence(),
            "largest_jump_rad": self.largest_jump_rad, "largest_velocity_radps": self.largest_velocity,
            "largest_acceleration_radps2": self.largest_acceleration,
            "envelope": self.tip.report(),
            "violations": self.violations, "examples": self.examples,
        })
    }
}

/// True when an arm without further commands would leave its position limits: it goes on until the command is
/// no longer valid, then brakes. A joint that is beyond a limit already is not judged by that one again.
fn ends_outside(command: &JointCommand) -> bool {
    let gliding = command.valid_until_ns.saturating_sub(command.header.stamp_ns) as f64 * 1e-9;
    command.q.iter().zip(command.qd).zip(POSITION_RAD).any(|((q, qd), limit)| {
        let way = qd * gliding + qd * qd.abs() / (2.0 * DECELERATION);
        let (now, end) = if qd > 0.0 { (*q, q + way) } else { (-q, -q - way) };
        now <= limit + ROUNDING_RAD && end > limit + ROUNDING_RAD + RELATIVE * way.abs()
    })
}

#[cfg(test)]
mod tests {
    use foretrace_shm::Header;

    use super::*;

    const TICK_NS: u64 = 2_000_000;

    /// Command `k` of a joint at `q` with velocity `qd`.
    fn command(k: u64, q: f64, qd: f64) -> JointCommand {
        let stamp_ns = (1000 + k) * TICK_NS;
        JointCommand {
            header: Header { sequence: k, stamp_ns, boot_id: host_boot_id() },
            published_ns: stamp_ns - TICK_NS + 50_000,
            valid_until_ns: stamp_ns + 5 * TICK_NS,
            q: [q; JOINTS],
            qd: [qd; JOINTS],
            flags: command_flags::ENABLED | if k == 1 { command_flags::BEGINS } else { 0 },
            ..JointCommand::default()
        }
    }

    fn judged(commands: &[JointCommand]) -> Judge {
        let mut judge = Judge::default();
        judge.state(&JointState::default());
        commands.iter().for_each(|command| judge.command(command));
        judge
    }

    #[test]
    fn a_legal_stream_passes_and_every_rule_finds_its_breach() {
        let good = [command(1, 0.0, 0.0), command(2, 1e-4, 0.05), command(3, 3e-4, 0.1)];
        assert_eq!(judged(&good).violations, 0, "{}", judged(&good).report());
        let second = |change: fn(&mut JointCommand)| {
            let mut commands = good;
            change(&mut commands[1]);
            judged(&commands[..2]).report()["examples"].to_string()
        };
        for (change, rule) in [
            ((|c| c.q[3] = f64::NAN) as fn(&mut JointCommand), "not finite"),
            (|c| c.q[2] = 3.2, "position"),
            (|c| c.qd[0] = -3.2, "velocity"),
            (|c| (c.q[2], c.qd[2]) = (3.1, 3.0), "no stop inside"),
            (|c| (c.q[0], c.qd[0]) = (-6.2, -2.0), "no stop inside"),
            (|c| c.q[5] = 0.1, "way"),
            (|c| c.qd[1] = 0.1, "acceleration"),
            (|c| c.q[1] = 2e-4, "continuity"),
            (|c| c.q[4] = 1e-2, "jump"),
            (|c| c.header.stamp_ns -= 2 * TICK_NS, "time does not go on"),
            (|c| c.published_ns -= 30_000_000, "times"),
            (|c| c.valid_until_ns = 0, "times"),
            (|c| c.header.boot_id ^= 1, "boot"),
        ] {
            assert!(second(change).contains(rule), "{rule}: {}", second(change));
        }
    }

    #[test]
    fn beginnings_are_at_rest_where_the_arm_is_and_streams_begin() {
        assert!(judged(&[command(1, 0.03, 0.0)]).report().to_string().contains("begins elsewhere"));
        assert!(judged(&[command(1, 0.0, 1.0)]).report().to_string().contains("begins in motion"));
        let unannounced = JointCommand { flags: command_flags::ENABLED, ..command(1, 0.0, 0.0) };
        assert_eq!(judged(&[command(1, 0.0, 0.0), unannounced]).violations, 1);
    }

    #[test]
    fn a_beginning_is_judged_by_the_state_before_it_whenever_that_is_read() {
        let state = |stamp_ns: u64, q: f64| {
            let header = Header { sequence: 1, stamp_ns, boot_id: host_boot_id() };
            JointState { header, q: [q; JOINTS], ..JointState::default() }
        };
        let first = command(1, 0.0, 0.0);
        let sent = first.published_ns;
        let judged = |states: &[JointState]| {
            let mut judge = Judge::default();
            states.iter().for_each(|state| judge.state(state));
            judge.command(&first);
            (judge.violations, judge.begins_unjudged)
        };
        assert_eq!(judged(&[state(sent - TICK_NS, 0.0), state(sent + TICK_NS, 0.5)]), (0, 0));
        assert_eq!(judged(&[state(sent - TICK_NS, 0.5), state(sent + TICK_NS, 0.0)]), (1, 0));
        assert_eq!(judged(&[state(sent + TICK_NS, 0.5)]), (0, 1));
        assert_eq!(judged(&[state(sent - TICK_NS, 0.5), state(sent + GAP_NS, 0.0)]), (0, 1));
        assert_eq!(judged(&[]), (0, 1));
    }

    #[test]
    fn what_was_missed_is_counted_and_not_compared() {
        let judge = judged(&[command(1, 0.0, 0.0), command(5, 0.5, 3.0)]);
        assert_eq!((judge.violations, judge.missed), (0, 3));
    }
}
