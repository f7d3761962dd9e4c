//! [`OtherPredictor`]: a predictor in a program of its own before the loop, in lock-step.
//!
//! It is told what a daemon sends over shared memory, and its previews are the law's to judge.

use std::time::Duration;

use foretrace_control::pen::Motion;
use foretrace_control::predict::external::MOST_LATE;
use foretrace_control::predict::{ExternalPreview, LearnStep, MAX_PREVIEW};

use crate::process::{Greeting, Partner, ProcessError, StepQuestion};

/// A predictor beside the loop, in lock-step.
pub trait StepPredictor: std::fmt::Debug {
    /// Tells a closed step, after which a plan looks at `steps`; its preview comes before the next tick.
    ///
    /// # Errors
    /// It cannot go on.
    fn tell(&mut self, step: &LearnStep, steps: usize) -> Result<Option<ExternalPreview>, ProcessError>;
}

/// A program that predicts one hand.
#[derive(Debug)]
pub struct OtherPredictor {
    partner: Partner,
    step_ns: u64,
}

impl OtherPredictor {
    /// Starts `command` for a loop with grid steps of `step_ns`; `hand` is who writes.
    ///
    /// # Errors
    /// [`Partner::start`].
    pub fn start(
        command: &str,
        step_ns: u64,
        hand: String,
        patience: Duration,
    ) -> Result<Self, ProcessError> {
        let greeting = Greeting::closed_loop(step_ns as f64 * 1e-9, hand);
        Ok(Self { partner: Partner::start(command, &greeting, patience)?, step_ns })
    }
}

impl StepPredictor for OtherPredictor {
    fn tell(&mut self, step: &LearnStep, steps: usize) -> Result<Option<ExternalPreview>, ProcessError> {
        let ([x, y], [dx, dy]) = (step.position, step.pen.x.map(|x| x * step.scale_m));
        let question = StepQuestion {
            index: step.index,
            t_s: step.index.saturating_mul(self.step_ns) as f64 * 1e-9,
            x,
            y,
            dx,
            dy,
            scale: step.scale_m,
            longest: Some(step.limit * step.scale_m),
            motion: match step.motion {
                Motion::Start => "start",
                Motion::Continues => "continues",
                Motion::Jump => "jump",
            },
            contact: step.pen.touch.contact,
            // As many as a daemon asks for.
            wanted: (steps + MOST_LATE as usize).min(MAX_PREVIEW),
        };
        let Some((positions, radii)) = self.partner.tell(&question)? else { return Ok(None) };
        let mut preview = ExternalPreview {
            base_index: step.index,
            count: positions.len(),
            radii_count: radii.len(),
            ..ExternalPreview::EMPTY
        };
        preview.positions.iter_mut().zip(positions).for_each(|(slot, position)| *slot = position);
        preview.radii.iter_mut().zip(radii).for_each(|(slot, radius)| *slot = radius);
        Ok(Some(preview))
    }
}
