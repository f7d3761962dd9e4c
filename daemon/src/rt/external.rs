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
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExternalTally {
    /// Grid steps that closed while it was chosen, and the sum of its part over them.
    pub steps: u64,
    pub weights: f64,
    /// Those of them that had a preview of their own before the next one closed.
    pub hits: u64,
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
        let tally = &mut self.tally;
        tally.latency_ns = None;
        let Some(report) = output.external else { return };
        tally.steps += output.learn_count as u64;
        tally.weights += report.weight * output.learn_count as f64;
        match report.verdict {
            None => return,
            Some(Ok(())) => {
                tally.taken += 1;
                tally.hits += u64::from(report.age == Some(0));
            }
            Some(Err(why)) => {
                if let Some(count) = tally.refused.get_mut(why.index()) {
                    *count += 1;
                }
                // Of others it would be no answer to a step.
                if why != PreviewRefusal::Late {
                    return;
                }
            }
        }
        tally.latency_ns = preview.and_then(|preview| {
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
