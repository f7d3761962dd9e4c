//! [`OtherProgram`]: a predictor in a program of its own as a contestant.
//!
//! It gets what built-in ones get: displacements, a lift as one long one. A sequence begins with a step
//! `start` at (0, 0); positions are summed up from there. The running scale is that of [`super::Scaled`].

use std::cell::RefCell;
use std::time::Duration;

use super::model::Contestant;
use super::scaled::RunningScale;
use crate::process::{Greeting, Partner, ProcessError, StepQuestion};

/// A program that takes part in a table.
pub(super) struct OtherProgram(RefCell<ToldSteps>);

/// What it was told, and the newest step, which waits for the question whether a preview is wanted.
struct ToldSteps {
    partner: Partner,
    step_s: f64,
    index: u64,
    at: [f64; 2],
    scale: RunningScale,
    waits: Option<StepQuestion>,
    /// Displacements that it predicted after the newest step.
    preview: Vec<[f64; 2]>,
    failure: Option<ProcessError>,
}

impl OtherProgram {
    /// Starts `command` for a device with steps of `step_ns`.
    pub(super) fn start(command: &str, step_ns: f64, patience: Duration) -> Result<Self, ProcessError> {
        let step_s = step_ns * 1e-9;
        let partner = Partner::start(command, &Greeting::table(step_s), patience)?;
        let scale = RunningScale::default();
        let (waits, preview, failure) = (None, Vec::new(), None);
        Ok(Self(RefCell::new(ToldSteps {
            partner,
            step_s,
            index: 0,
            at: [0.0; 2],
            scale,
            waits,
            preview,
            failure,
        })))
    }
}

impl ToldSteps {
    fn note(&mut self, motion: &'static str, v: [f64; 2]) {
        let ([x, y], [dx, dy]) = (self.at, v);
        self.waits = Some(StepQuestion {
            index: self.index,
            t_s: self.index as f64 * self.step_s,
            x,
            y,
            dx,
            dy,
            scale: self.scale.raw_per_unit(),
            longest: None,
            motion,
            contact: true,
            wanted: 0,
        });
    }

    /// Tells the step that waits. After a failure nobody is told anything.
    fn tell(&mut self, wanted: usize) {
        let Some(step) = self.waits.take() else { return };
        self.preview.clear();
        if self.failure.is_some() {
            return;
        }
        match self.partner.tell(&StepQuestion { wanted, ..step }) {
            Ok(Some((positions, _))) => {
                let mut last = self.at;
                self.preview.extend(positions.into_iter().map(|[x, y]| {
                    let step = [x - last[0], y - last[1]];
                    last = [x, y];
                    step
                }));
            }
            Ok(None) => {}
            Err(error) => self.failure = Some(error),
        }
    }
}

impl Contestant for OtherProgram {
    fn start_sequence(&mut self) {
        let told = self.0.get_mut();
        told.tell(0);
        (told.index, told.at) = (0, [0.0; 2]);
        told.note("start", [0.0; 2]);
    }

    fn observe(&mut self, v: [f64; 2]) {
        let told = self.0.get_mut();
        told.tell(0);
        told.index += 1;
        told.at = [told.at[0] + v[0], told.at[1] + v[1]];
        told.scale.observe(v);
        told.note("continues", v);
    }

    /// Without a preview the pen stays where it is. A second preview of a step has no more positions than the
    /// first.
    fn preview(&self, out: &mut [[f64; 2]]) {
        let mut told = self.0.borrow_mut();
        told.tell(out.len());
        out.fill([0.0; 2]);
        out.iter_mut().zip(&told.preview).for_each(|(slot, step)| *slot = *step);
    }

    fn failure(&self) -> Option<ProcessError> {
        let mut told = self.0.borrow_mut();
        told.tell(0);
        told.failure.clone()
    }
}
