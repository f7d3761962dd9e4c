//! The predictor of another process beside the loop: what was sent to it, and what became of its previews.
//!
//! Contract: fixed size, no allocation. Nothing is sent or asked for unless that predictor is chosen.

use foretrace_control::follower::StepOutput;
use foretrace_control::predict::{ExternalPreview, PredictorKind, PreviewRefusal};
use foretrace_control::units::Stamp;

use crate::ports::Ports;
use crate::wire::{self, JOINTS};

/// Grid steps whose time of sending is kept.
const SENT: usize = 16;

/// Counts since the daemon started, and the newest latency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ExternalTally {
    /// Previews that the law took.
    pub taken: u64,
    /// Previews that it refused, by reason.
    pub refused: [u64; PreviewRefusal::ALL.len()],
    /// From a grid step sent to its preview received in this tick \[ns\].
    pub latency_ns: Option<u64>,
}

/// The exchange with another process.
#[derive(Debug)]
pub struct ExternalDoor {
    chosen: bool,
    step_ns: u64,
    /// Index and time of sending; a ring by index.
    sent: [(u64, u64); SENT],
    tally: ExternalTally,
}

impl ExternalDoor {
    pub fn new(kind: PredictorKind, step_ns: u64) -> Self {
        let chosen = kind == PredictorKind::EXTERNAL;
        Self { chosen, step_ns, sent: [(0, 0); SENT], tally: ExternalTally::default() }
    }

    /// Previews are asked for.
    pub const fn asks(&self) -> bool {
        self.chosen
    }

    pub const fn tally(&self) -> ExternalTally {
        self.tally
    }

    /// Counts what became of `preview`, received at `received`.
    pub fn count(&mut self, preview: Option<&ExternalPreview>, output: &StepOutput<JOINTS>, received: Stamp) {
        self.chosen = output.predictor == PredictorKind::EXTERNAL;
        let verdict = output.external.and_then(|external| external.verdict);
        match verdict {
            None => {}
            Some(Ok(())) => self.tally.taken += 1,
            Some(Err(why)) => {
                if let Some(count) = self.tally.refused.get_mut(why.index()) {
                    *count += 1;
                }
            }
        }
        self.tally.latency_ns = preview.and_then(|preview| {
            let (index, sent_ns) = self.sent.get(place(preview.base_index)).copied()?;
            (index == preview.base_index && sent_ns > 0).then(|| received.0.saturating_sub(sent_ns))
        });
    }

    /// Sends the grid steps that closed in this tick.
    pub fn send(&mut self, ports: &mut impl Ports, now: Stamp, output: &StepOutput<JOINTS>) {
        if !self.chosen {
            return;
        }
        for step in output.learn.iter().take(output.learn_count) {
            if let Some(slot) = self.sent.get_mut(place(step.index)) {
                *slot = (step.index, now.0);
            }
            ports.send_step(now, wire::pen_step(step, self.step_ns, output.preview_steps));
        }
    }
}

const fn place(index: u64) -> usize {
    (index % SENT as u64) as usize
}
