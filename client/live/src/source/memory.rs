//! Listening to shared memory itself: one slot of each service that is wanted.

use std::time::Duration;

use foretrace_client::{Attachment, Foretrace, InputWatch, Instance, ServiceError, StatusReader, Telemetry};

use super::{SourceMessage, SourceNews, Wants};
use crate::LiveError;

/// Handles of one attachment.
#[derive(Debug)]
struct Handles {
    inputs: Option<InputWatch>,
    telemetry: Option<Telemetry>,
    status: StatusReader,
}

impl Handles {
    fn open(foretrace: &Foretrace, wants: Wants) -> Result<Self, ServiceError> {
        Ok(Self {
            inputs: wants.inputs.then(|| foretrace.inputs()).transpose()?,
            telemetry: wants.ticks.then(|| foretrace.telemetry()).transpose()?,
            status: foretrace.status()?,
        })
    }
}

#[derive(Debug)]
pub(super) struct MemorySource {
    // Before the attachment that made them.
    handles: Handles,
    foretrace: Foretrace,
    wants: Wants,
    away: bool,
    /// New handles could not be made yet; reported already.
    again: bool,
    /// Of handles that were replaced.
    broken: u64,
    refused: u64,
}

impl MemorySource {
    pub(super) fn open(instance: &Instance, wants: Wants) -> Result<Self, LiveError> {
        let foretrace = Foretrace::attach_within(instance, Duration::ZERO)?;
        let handles = Handles::open(&foretrace, wants)?;
        Ok(Self { handles, foretrace, wants, away: false, again: false, broken: 0, refused: 0 })
    }

    pub(super) fn hear(&mut self, pass: &mut dyn FnMut(SourceMessage)) {
        // Records first: an input without its record is of more use than the other way round.
        if let Some(telemetry) = &mut self.handles.telemetry {
            telemetry.drain(|record| pass(SourceMessage::Tick(Box::new(*record))));
        }
        if let Some(inputs) = &mut self.handles.inputs {
            inputs.drain(|input| pass(SourceMessage::Input(Box::new(*input))));
            inputs.snapshots(|snapshot| pass(SourceMessage::Thing(snapshot)));
        }
        if let Some(status) = self.handles.status.newest_if_new() {
            pass(SourceMessage::Status(Box::new(status)));
        }
    }

    pub(super) fn start_again(&mut self) -> Result<(), LiveError> {
        match &mut self.handles.inputs {
            Some(inputs) => Ok(inputs.start_again(&self.foretrace)?),
            None => Ok(()),
        }
    }

    /// Looks whether the daemon is still there; makes new handles where that is needed and possible. Handles
    /// that are replaced have been drained.
    pub(super) fn look(&mut self) -> Option<SourceNews> {
        match self.foretrace.reattach_if_needed() {
            Ok(Attachment::Renewed) => self.renew(),
            Ok(_) if self.again => self.renew(),
            Ok(found) => {
                let back = std::mem::take(&mut self.away) || found == Attachment::TakenOver;
                back.then_some(SourceNews::Back)
            }
            // The obstacle may be transient: keep looking.
            Err(_) => (!std::mem::replace(&mut self.away, true)).then_some(SourceNews::Gone),
        }
    }

    fn renew(&mut self) -> Option<SourceNews> {
        self.away = false;
        match Handles::open(&self.foretrace, self.wants) {
            Ok(new) => {
                (self.broken, self.refused, self.again) = (self.broken(), self.refused(), false);
                self.handles = new;
                Some(SourceNews::Renewed)
            }
            Err(error) => (!std::mem::replace(&mut self.again, true)).then(|| SourceNews::Deaf(error.into())),
        }
    }

    pub(super) fn broken(&self) -> u64 {
        self.broken + self.handles.inputs.as_ref().map_or(0, InputWatch::snapshots_broken)
    }

    pub(super) fn refused(&self) -> u64 {
        let inputs = self.handles.inputs.as_ref().map_or(0, |inputs| inputs.rejections().total());
        let ticks = self.handles.telemetry.as_ref().map_or(0, |ticks| ticks.rejections().total());
        self.refused + inputs + ticks
    }
}
