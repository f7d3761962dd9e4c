//! The bridge's RTDE connection: which fields it has, and what they mean.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::time::Duration;

use super::pilot::Package;
use super::reason::HaltReason;
use super::registers::{ProgramAnswer, RegisterInputs, RegisterMap};
use crate::rtde::{InputRecipe, RtdeClient, RtdeError, RtdeValue};

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
pub struct RtdeLine {
    client: RtdeClient,
    inputs: InputRecipe,
}

impl RtdeLine {
    /// Connects, claims `registers` and lets states come `rate_hz` times a second. Each step takes `patience`
    /// at most.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`]; [`reason`] says what it means for the bridge.
    pub fn connect(
        address: SocketAddr,
        registers: &RegisterMap,
        rate_hz: f64,
        patience: Duration,
    ) -> Result<Self, RtdeError> {
        let mut client = RtdeClient::connect(address, patience)?;
        let answers = registers.answer_names();
        let outputs: Vec<&str> = OUTPUTS.into_iter().chain(answers.iter().map(String::as_str)).collect();
        client.set_up_outputs(&outputs, rate_hz)?;
        let names = registers.input_names();
        let inputs = client.set_up_inputs(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
        client.start()?;
        Ok(Self { client, inputs })
    }

    /// The newest state, waiting for one for `wait` at most; `None` when none came.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn receive(&mut self, wait: Duration) -> Result<Option<Package>, RtdeError> {
        let Some(received) = self.client.receive(wait)? else { return Ok(None) };
        package(&received.values).map(Some).ok_or(RtdeError::Refused("fields of the types that they have"))
    }

    /// Sends the registers of a cycle.
    ///
    /// # Errors
    ///
    /// See [`RtdeError`].
    pub fn send(&mut self, inputs: &RegisterInputs) -> Result<(), RtdeError> {
        let doubles = inputs.q.into_iter().chain(inputs.qd).map(RtdeValue::Double);
        let values: Vec<RtdeValue> = [RtdeValue::Int32(inputs.counter), RtdeValue::Int32(inputs.permit)]
            .into_iter()
            .chain(doubles)
            .collect();
        self.client.send(&self.inputs, &values)
    }
}

/// The fields of [`OUTPUTS`] and the program's answer.
fn package(values: &[RtdeValue]) -> Option<Package> {
    let mut values = values.iter().copied();
    let mut next = || values.next();
    Some(Package {
        timestamp: next()?.double()?,
        q: next()?.vector6d()?,
        qd: next()?.vector6d()?,
        current: next()?.vector6d()?,
        robot_mode: next()?.int32()?,
        safety_mode: next()?.int32()?,
        runtime_state: next()?.uint32()?,
        speed_scaling: next()?.double()?,
        target_speed_fraction: next()?.double()?,
        answer: {
            let mut words = [0; 7];
            for word in &mut words {
                *word = next()?.int32()?;
            }
            ProgramAnswer::from_words(words)
        },
    })
}

/// What an error means for the bridge.
#[must_use]
pub fn reason(error: &RtdeError) -> HaltReason {
    match error {
        RtdeError::Connect(error) if error.kind() == ErrorKind::ConnectionRefused => HaltReason::ServiceOff,
        RtdeError::Connect(_) => HaltReason::Unreachable,
        RtdeError::InUse(_) => HaltReason::InUse,
        _ => HaltReason::ConnectionLost,
    }
}
