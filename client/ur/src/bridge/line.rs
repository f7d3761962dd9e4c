//! The bridge's RTDE connection: which fields it has, and what they mean.

use std::net::SocketAddr;
use std::time::Duration;

use foretrace_client::JOINTS;

use super::pilot::Package;
use super::reason::Reason;
use super::registers::{Answer, Inputs, Registers};
use super::wire::{Fields, Rtde, RtdeError, Sent};

/// Outputs beside the program's answer, in the order of [`package`].
const OUTPUTS: [&str; 9] = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
];

/// A connection with its recipes.
#[derive(Debug)]
pub struct Line {
    rtde: Rtde,
    inputs: u8,
}

impl Line {
    /// Connects, claims `registers` and lets states come `rate_hz` times a second. Each step takes `patience`
    /// at most.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`]; [`RtdeError::reason`] says what it means for the bridge.
    pub fn connect(
        address: SocketAddr,
        registers: &Registers,
        rate_hz: f64,
        patience: Duration,
    ) -> Result<Self, RtdeError> {
        let mut rtde = Rtde::connect(address, patience)?;
        let answers = registers.answer_names();
        let outputs: Vec<String> = OUTPUTS.iter().map(|name| (*name).to_owned()).chain(answers).collect();
        rtde.outputs(rate_hz, &outputs)?;
        let inputs = rtde.inputs(&registers.input_names())?;
        rtde.start()?;
        Ok(Self { rtde, inputs })
    }

    /// The newest state, waiting for one for `wait` at most; `None` when none came.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn receive(&mut self, wait: Duration) -> Result<Option<Package>, RtdeError> {
        let Some(fields) = self.rtde.receive(wait)? else { return Ok(None) };
        package(&fields).map(Some).ok_or(RtdeError::Strange("fields of other shapes than asked for"))
    }

    /// Sends the registers of a cycle.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn send(&mut self, inputs: &Inputs) -> Result<(), RtdeError> {
        let doubles = inputs.q.iter().chain(&inputs.qd).map(|value| Sent::Double(*value));
        let values: Vec<Sent> =
            [Sent::Int(inputs.counter), Sent::Int(inputs.leave)].into_iter().chain(doubles).collect();
        self.rtde.send(self.inputs, &values)
    }
}

/// The fields of [`OUTPUTS`] and the program's answer.
fn package(fields: &Fields) -> Option<Package> {
    let mut fields = fields.iter();
    let mut field = || fields.next().map(Vec::as_slice);
    let six = |field: &[f64]| <[f64; JOINTS]>::try_from(field).ok();
    let one = |field: &[f64]| field.first().copied();
    Some(Package {
        timestamp: one(field()?)?,
        q: six(field()?)?,
        qd: six(field()?)?,
        current: six(field()?)?,
        robot_mode: one(field()?)? as i32,
        safety_mode: one(field()?)? as i32,
        runtime_state: one(field()?)? as u32,
        speed_scaling: one(field()?)?,
        target_speed_fraction: one(field()?)?,
        answer: {
            let mut words = [0; 7];
            for word in &mut words {
                *word = one(field()?)? as i32;
            }
            Answer::from_words(words)
        },
    })
}

impl RtdeError {
    /// What it means for the bridge.
    #[must_use]
    pub fn reason(&self) -> Reason {
        match self {
            Self::Connect(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {
                Reason::ServiceOff
            }
            Self::Connect(_) => Reason::Unreachable,
            Self::Fields { in_use, .. } if !in_use.is_empty() => Reason::InUse,
            _ => Reason::ConnectionLost,
        }
    }
}
