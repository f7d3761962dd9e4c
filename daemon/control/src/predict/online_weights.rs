//! `OnlineWeights`: everything that crosses from the learner to the loop, as one plain copy.
//!
//! Contract: complete sets only. Every part carries its own version, so that an unchanged part costs nothing
//! to take over; the set's version counts hand-overs. A set with a part that is non-finite, too large or made
//! for another loop is refused. One part per line of [`for_each_taught`].

use super::bands::BandTable;
use super::models::{self, Models, for_each_taught};
use super::online::{ModelParameters, WeightsError};
use super::taught::{ListedPredictor, OnlinePredictor, ParametersOf};
use crate::state::{Reader, State, StateError, Writer};

macro_rules! online_weights {
    ($($(#[doc = $doc:literal])+ $(#[cfg($when:meta)])? $part:ident: $room:ident::{$model:ident,
        $weights:ident}),+ $(,)?) => {
        /// Parameters of all models that learn online, and the error bands of every predictor.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct OnlineWeights {
            /// Counts sets handed over; 0: none yet.
            pub version: u64,
            $($(#[doc = $doc])+ $(#[cfg($when)])? pub $part: models::$room::$weights,)+
            /// Bands of all predictors.
            pub bands: BandTable,
        }

        impl State for OnlineWeights {
            fn save(&self, to: &mut Writer<'_>) {
                self.version.save(to);
                $($(#[cfg($when)])? self.$part.save(to);)+
                self.bands.save(to);
            }

            fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
                self.version.load(from)?;
                $($(#[cfg($when)])? self.$part.load(from)?;)+
                self.bands.load(from)
            }
        }

        impl OnlineWeights {
            /// Before anything was learned.
            #[must_use]
            pub fn start(models: &Models) -> Self {
                Self {
                    version: 0,
                    $($(#[cfg($when)])? $part: models::$room::$model::start(models),)+
                    bands: BandTable::default(),
                }
            }

            /// Checks every number.
            ///
            /// # Errors
            ///
            /// The first bound that is broken.
            pub fn validate(&self) -> Result<(), WeightsError> {
                $($(#[cfg($when)])? self.$part.validate()?;)+
                self.bands.validate()
            }

            /// Checks that this set was made for a loop with grid step `loop_ns` \[ns\].
            ///
            /// # Errors
            ///
            /// Another grid step or input scale.
            pub fn fits(&self, loop_ns: u64) -> Result<(), WeightsError> {
                $($(#[cfg($when)])? self.$part.fits(loop_ns)?;)+
                Ok(())
            }

            /// Checks that every model can learn from here.
            ///
            /// # Errors
            ///
            /// Settings outside their bounds, or weights that do not fit.
            pub(super) fn can_be_taught(&self, models: &Models) -> Result<(), WeightsError> {
                $($(#[cfg($when)])? models::$room::$model::learner(models, &self.$part)?;)+
                Ok(())
            }
        }

        $($(#[cfg($when)])? impl ListedPredictor for models::$room::$model {
            fn part(weights: &OnlineWeights) -> &ParametersOf<Self> {
                &weights.$part
            }

            fn part_mut(weights: &mut OnlineWeights) -> &mut ParametersOf<Self> {
                &mut weights.$part
            }
        })+
    };
}

for_each_taught!(online_weights);
