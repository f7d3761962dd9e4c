//! The settings in force, for the static scene around the pen.
//!
//! Contract: they come with what recordings need, of which shared memory has two places. One of them is taken
//! for as long as it takes to hear the settings, and tried for again where there is none.

use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_shm::PieceKind;

use crate::LiveError;
use crate::source::{Heard, Source, Wants};

/// Between two tries.
const AGAIN: Duration = Duration::from_secs(5);
/// Longest wait at a place where nothing comes.
const PATIENCE: Duration = Duration::from_secs(2);

/// Hears them once, then again whenever they are wanted.
#[derive(Debug)]
pub(crate) struct Settings {
    instance: Instance,
    place: Option<(Source, Instant)>,
    /// `None`: they are known.
    due: Option<Instant>,
    deaf: bool,
}

impl Settings {
    pub(crate) fn new(instance: &Instance) -> Self {
        Self { instance: instance.clone(), place: None, due: Some(Instant::now()), deaf: false }
    }

    /// Another daemon is there.
    pub(crate) fn want(&mut self) {
        (self.place, self.due) = (None, Some(Instant::now()));
    }

    /// Their text, once it has come. Call this every few milliseconds.
    ///
    /// # Errors
    ///
    /// There is no place; told once, and tried again.
    pub(crate) fn look(&mut self) -> Result<Option<Vec<u8>>, LiveError> {
        let now = Instant::now();
        if self.due.is_none_or(|due| now < due) {
            return Ok(None);
        }
        let Some((source, since)) = &mut self.place else {
            return match Source::open(&self.instance, Wants { ticks: false, inputs: true }) {
                Ok(source) => {
                    (self.place, self.deaf) = (Some((source, now)), false);
                    Ok(None)
                }
                Err(error) => {
                    self.due = Some(now + AGAIN);
                    if std::mem::replace(&mut self.deaf, true) { Ok(None) } else { Err(error) }
                }
            };
        };
        let mut text = None;
        source.hear(|heard| match heard {
            Heard::Thing(thing) if thing.kind == PieceKind::Settings => text = Some(thing.bytes),
            _ => {}
        });
        if text.is_some() {
            (self.place, self.due) = (None, None);
        } else if since.elapsed() > PATIENCE {
            (self.place, self.due) = (None, Some(now + AGAIN));
        }
        Ok(text)
    }
}
