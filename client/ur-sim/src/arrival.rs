//! What clients send to ports 30001 to 30003, read before the control loop looks at it.

use crate::script::{Program, ScriptError};

/// What waits at most.
pub(super) const MOST_ARRIVALS: usize = 16;

/// Something that a client sent.
#[derive(Debug)]
pub enum Arrival {
    /// `stop program`
    Stop,
    /// `pause program`
    Pause,
    /// `resume program`
    Resume,
    /// `set robotmode run`, `power on`
    PowerOn,
    /// A program, or what is wrong with it.
    Script(Result<Program, ScriptError>),
}

impl Arrival {
    /// Reads one of the plain lines that drivers send, or a program. Takes as long as the text is: not to be
    /// done under a lock that the control loop wants.
    #[must_use]
    pub fn read(text: &str) -> Self {
        match text.trim() {
            "stop program" => Self::Stop,
            "pause program" => Self::Pause,
            "resume program" => Self::Resume,
            "set robotmode run" | "power on" => Self::PowerOn,
            _ => Self::Script(Program::parse(text)),
        }
    }
}
