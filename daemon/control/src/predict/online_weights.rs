//! `OnlineWeights`: everything that crosses from the learner to the loop, as one plain copy.
//!
//! Contract: whole sets only. Every part carries its own version, so that a part which has not changed costs nothing to
//! take over; the set's version counts hand-overs. What is not finite, too large or made for another loop is refused
//! together with the set that carries it.

use super::bands::BandTable;
use super::online::{ModelParameters, WeightsError};
use super::{ArRlsWeights, DybmEsnWeights, DybmWeights, MixtureParameters};

/// Parameters of all models that learn online, and how wrong every predictor has lately been.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnlineWeights {
    /// Counts sets handed over; 0: nothing was.
    pub version: u64,
    /// Linear DyBM.
    pub dybm: DybmWeights,
    /// DyBM with a reservoir.
    pub dybm_esn: DybmEsnWeights,
    /// AR-RLS.
    pub ar_rls: ArRlsWeights,
    /// The mixture and its experts.
    pub mixture: MixtureParameters,
    /// Bands of all predictors.
    pub bands: BandTable,
}

impl OnlineWeights {
    /// Checks every number.
    ///
    /// *Errors*: the first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        self.dybm.validate()?;
        self.dybm_esn.validate()?;
        self.ar_rls.validate()?;
        self.mixture.validate()?;
        self.bands.validate()
    }

    /// Checks that this set was made for a loop with grid step `loop_ns` [ns].
    ///
    /// *Errors*: another grid step or input scale.
    pub fn fits(&self, loop_ns: u64) -> Result<(), WeightsError> {
        self.dybm.fits(loop_ns)?;
        self.dybm_esn.fits(loop_ns)?;
        self.ar_rls.fits(loop_ns)?;
        self.mixture.fits(loop_ns)
    }
}
