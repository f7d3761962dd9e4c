//! The settings in force, for the static scene around the pen.
//!
//! Contract: they come with what recordings need, of which shared memory has two slots. One of them is taken
//! for as long as it takes to receive the settings, and tried for again where there is none.

use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_shm::PieceKind;

use crate::LiveError;
use crate::source::{LiveSource, SourceMessage, Wants};

const AGAIN: Duration = Duration::from_secs(5);
/// Longest wait for settings that do not come.
const PATIENCE: Duration = Duration::from_secs(2);

/// Receives them once, then again whenever they are wanted.
#[derive(Debug)]
pub(crate) struct Settings {
    instance: Instance,
    source: Option<(LiveSource, Instant)>,
    /// `None`: they are known.
    due: Option<Instant>,
    refused: bool,
}

impl Settings {
    pub(crate) fn new(instance: &Instance) -> Self {
        Self { instance: instance.clone(), source: None, due: Some(Instant::now()), refused: false }
    }

    /// Another daemon is there.
    pub(crate) fn want(&mut self) {
        (self.source, self.due) = (None, Some(Instant::now()));
    }

    /// Their text, once it has come. Call this every few milliseconds.
    ///
    /// # Errors
    ///
    /// There is no slot; reported once, and tried again.
    pub(crate) fn look(&mut self) -> Result<Option<Vec<u8>>, LiveError> {
        let now = Instant::now();
        if self.due.is_none_or(|due| now < due) {
            return Ok(None);
        }
        let Some((source, since)) = &mut self.source else {
            return match LiveSource::open(&self.instance, Wants { ticks: false, inputs: true }) {
                Ok(source) => {
                    (self.source, self.refused) = (Some((source, now)), false);
                    Ok(None)
                }
                Err(error) => {
                    self.due = Some(now + AGAIN);
                    if std::mem::replace(&mut self.refused, true) { Ok(None) } else { Err(error) }
                }
            };
        };
        let mut text = None;
        source.hear(|heard| match heard {
            SourceMessage::Thing(thing) if thing.kind == PieceKind::Settings => text = Some(thing.bytes),
            _ => {}
        });
        if text.is_some() {
            (self.source, self.due) = (None, None);
        } else if since.elapsed() > PATIENCE {
            (self.source, self.due) = (None, Some(now + AGAIN));
        }
        Ok(text)
    }
}
