//! Settings of the envelope and their ranges.

use thiserror::Error;

/// How far and how fast the tool may move, whatever commands it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnvelopeSettings {
    /// A tool farther outside the workspace than this latches a stop \[m\].
    pub margin_m: f64,
    /// Largest angle between the tool's axis and the plane's normal \[rad\].
    pub max_tilt_rad: f64,
    /// Fastest tool \[m/s\]; `None`: the plan's limits and the IK's corrections together.
    pub max_speed_mps: Option<f64>,
}

/// A number of the envelope is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{name} = {value} {unit} of the tool's envelope is outside {low} to {high} {unit}")]
pub struct EnvelopeError {
    /// Name of the number, as in the message.
    pub name: &'static str,
    /// The refused value, as it was given.
    pub value: f64,
    /// Smallest value that is legal, itself included.
    pub low: f64,
    /// Largest value that is legal, itself included.
    pub high: f64,
    /// Unit of all three.
    pub unit: &'static str,
}

impl EnvelopeSettings {
    /// Checks every bound; NaN is outside every range.
    ///
    /// # Errors
    /// The first bound broken.
    pub fn validate(&self) -> Result<(), EnvelopeError> {
        let speed = self.max_speed_mps.unwrap_or(1.0);
        let numbers = [
            ("margin", self.margin_m, 1e-4, 0.1, "m"),
            ("largest tilt", self.max_tilt_rad, 0.01, 1.6, "rad"),
            ("largest speed", speed, 1e-3, 100.0, "m/s"),
        ];
        match numbers.into_iter().find(|(_, value, low, high, _)| !(low..=high).contains(&value)) {
            Some((name, value, low, high, unit)) => Err(EnvelopeError { name, value, low, high, unit }),
            None => Ok(()),
        }
    }
}
