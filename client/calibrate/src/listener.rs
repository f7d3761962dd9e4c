//! Records the commands to the arm and its joint states while the test motion runs.

use foretrace_client::wire::command_flags;
use foretrace_client::{Commands, Foretrace, JointCommand, JointWatch, ServiceError};
use foretrace_sim::lag::Sample;
use serde::Serialize;

/// Both subscriptions and what they received.
pub(crate) struct MotionListener {
    commands: Commands,
    states: JointWatch,
    /// Time 0 of the samples \[ns\].
    zero_ns: u64,
    pub(crate) commanded: Vec<Sample>,
    pub(crate) measured: Vec<Sample>,
    disabled: u64,
    refused_by_arm: Option<(u64, u64)>,
    lost_before: (u64, u64),
}

/// Counts of messages received and lost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct MessageCounts {
    pub commands: u64,
    /// Sent by the daemon but not received here.
    pub commands_lost: u64,
    /// Malformed, foreign or replayed.
    pub commands_refused: u64,
    /// Refused by the arm meanwhile, as it reports.
    pub commands_refused_by_arm: u64,
    pub states: u64,
    pub states_lost: u64,
    pub states_refused: u64,
}

impl MotionListener {
    pub(crate) fn open(foretrace: &Foretrace) -> Result<Self, ServiceError> {
        Ok(Self {
            commands: foretrace.commands(Commands::MAX_BUFFER)?,
            states: foretrace.joint_watch()?,
            zero_ns: 0,
            commanded: Vec::new(),
            measured: Vec::new(),
            disabled: 0,
            refused_by_arm: None,
            lost_before: (0, 0),
        })
    }

    /// Forgets everything received so far; `zero_ns` is time 0 from now on.
    pub(crate) fn begin(&mut self, zero_ns: u64) {
        self.listen();
        self.zero_ns = zero_ns;
        self.commanded.clear();
        self.measured.clear();
        (self.disabled, self.refused_by_arm) = (0, None);
        self.lost_before = (self.commands.dropped(), self.states.lost());
    }

    /// Takes in what came since the last call; at most 200 ms may lie between two calls.
    pub(crate) fn listen(&mut self) {
        let seconds = |stamp_ns: u64| (i128::from(stamp_ns) - i128::from(self.zero_ns)) as f64 * 1e-9;
        let (commanded, disabled) = (&mut self.commanded, &mut self.disabled);
        self.commands.drain(|command: &JointCommand| {
            commanded.push(Sample { t_s: seconds(command.header.stamp_ns), q: command.q });
            *disabled += u64::from(command.flags & command_flags::ENABLED == 0);
        });
        let (measured, refused) = (&mut self.measured, &mut self.refused_by_arm);
        self.states.drain(|state| {
            measured.push(Sample { t_s: seconds(state.header.stamp_ns), q: state.q });
            let first = refused.map_or(state.commands_refused, |(first, _)| first);
            *refused = Some((first, state.commands_refused));
        });
    }

    pub(crate) fn counts(&self) -> MessageCounts {
        let (commands_lost, states_lost) = self.lost_before;
        MessageCounts {
            commands: self.commanded.len() as u64,
            commands_lost: self.commands.dropped().saturating_sub(commands_lost),
            commands_refused: self.commands.rejections().total(),
            commands_refused_by_arm: self
                .refused_by_arm
                .map_or(0, |(first, last)| last.saturating_sub(first)),
            states: self.measured.len() as u64,
            states_lost: self.states.lost().saturating_sub(states_lost),
            states_refused: self.states.rejections().total(),
        }
    }

    /// Commands with the arm disabled.
    pub(crate) fn disabled(&self) -> u64 {
        self.disabled
    }
}
