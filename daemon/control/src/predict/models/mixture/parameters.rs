//! `MixtureParameters`: everything that is learned online, one plain copy that crosses threads.

use crate::pen::TARGET_RMS;
use crate::predict::ArRlsWeights;
use crate::predict::models::ar_rls;
use crate::predict::models::foresight::{READ, turned_back};
use crate::predict::models::mixture::readout::NodeReadout;
use crate::predict::models::mixture::trunk::{ALL, MixtureMemory, PLAIN, Present};
use crate::predict::models::mixture::{EXPERTS, LEADS, NODE_COUNT, NODES, NodePath};
use crate::predict::online::{ModelParameters, WeightsError};
use crate::state::state;

/// Parameters of the mixture and its experts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixtureParameters {
    /// Counts every change of the live parameters.
    pub version: u64,
    /// Coefficients of the autoregressive expert; also Δ.
    pub ar: ArRlsWeights,
    /// Read-out of FIFO and reservoir, added to constant velocity.
    pub(super) plain: NodeReadout<PLAIN>,
    /// Read-out of all features, added to the LSTM.
    pub(super) full: NodeReadout<ALL>,
    /// Read-out of the last layer of `foresight`, added to it, in the frame of motion.
    pub(super) foresight: NodeReadout<READ>,
    /// Weight of each expert at each node; a row sums to 1.
    pub(super) shares: [[f32; EXPERTS]; NODE_COUNT],
    /// Which networks' experts take part.
    pub(super) present: Present,
}

state! { [] MixtureParameters { version, ar, plain, full, foresight, shares, present } }

impl MixtureParameters {
    /// Nothing learned yet: read-outs zero; of the experts that take part, those that rest on a trained
    /// network have equal weights, and the others a tenth of that.
    #[must_use]
    pub fn untrained(step_ns: u64, present: impl Into<Present>) -> Self {
        let present = present.into();
        let weights: [f32; EXPERTS] = std::array::from_fn(|expert| {
            let takes = taking_part(present).get(expert).copied().unwrap_or(false);
            f32::from(u8::from(takes)) * if expert < TRAINED_FROM { FIRST_SHARE } else { 1.0 }
        });
        let total: f32 = weights.iter().sum();
        let shares = weights.map(|weight| weight / total);
        Self {
            version: 0,
            ar: ArRlsWeights::constant_velocity(step_ns),
            plain: NodeReadout::ZERO,
            full: NodeReadout::ZERO,
            foresight: NodeReadout::ZERO,
            shares: [shares; NODE_COUNT],
            present,
        }
    }

    /// Weight of each expert (constant velocity, AR-RLS, DyBM+ESN, LSTM, corrected LSTM, foresight, corrected
    /// foresight, the mean of both corrected ones) at each node.
    #[must_use]
    pub fn shares(&self) -> &[[f32; EXPERTS]; NODE_COUNT] {
        &self.shares
    }

    /// Becomes `other`, which these accept. Kilobytes for an expert that does not take part are not touched:
    /// they are cold in the tick that adopts weights.
    pub(super) fn take_over(&mut self, other: &Self) {
        let Self { version, ar, plain, full, foresight, shares, present } = other;
        (self.version, self.ar, self.shares, self.present) = (*version, *ar, *shares, *present);
        (self.plain, self.full) = (*plain, *full);
        if present.foresight {
            self.foresight = *foresight;
        }
    }

    pub(super) fn experts(&self, memory: &MixtureMemory) -> [NodePath; EXPERTS] {
        let [x, y] = memory.newest();
        let constant = NODES.map(|node| [x * node as f64, y * node as f64]);
        let mut steps = [[0.0; 2]; LEADS];
        ar_rls::roll_out(&self.ar, memory.recent, f64::INFINITY, &mut steps);
        let rolled = crate::predict::models::mixture::trunk::summed(&steps);
        let plain = sum(&constant, &self.plain.of(memory.plain()));
        let [lstm, full] = match &memory.lstm {
            Some(lstm) if self.present.lstm => [*lstm, sum(lstm, &self.full.of(&memory.features))],
            _ => [constant; 2],
        };
        let [foresight, corrected] = match &memory.foresight {
            Some(answer) if self.present.foresight => {
                let turned = self.foresight.of(&answer.read).map(|way| turned_back(answer.frame, way));
                [answer.path, sum(&answer.path, &turned)]
            }
            _ => [constant; 2],
        };
        [constant, rolled, plain, lstm, full, foresight, corrected, mean(&full, &corrected)]
    }

    /// The weighted mean of the experts.
    pub(super) fn mix(&self, paths: &[NodePath; EXPERTS]) -> NodePath {
        let mut mixed = [[0.0; 2]; NODE_COUNT];
        for (node, (out, shares)) in mixed.iter_mut().zip(&self.shares).enumerate() {
            for (path, share) in paths.iter().zip(shares) {
                let [x, y] = path.get(node).copied().unwrap_or_default();
                // An expert without weight has no effect even if it is non-finite.
                if *share > 0.0 {
                    out[0] += f64::from(*share) * x;
                    out[1] += f64::from(*share) * y;
                }
            }
        }
        mixed
    }
}

/// The first expert that rests on a trained network.
const TRAINED_FROM: usize = 3;
/// First weight of an expert without one, over that of an expert with one. All three say "straight on" until
/// they have learned the hand: together they would outweigh the networks in its first letters.
const FIRST_SHARE: f32 = 0.1;

/// Which experts take part.
pub(super) fn taking_part(present: Present) -> [bool; EXPERTS] {
    let Present { lstm, foresight } = present;
    [true, true, true, lstm, lstm, foresight, foresight, lstm && foresight]
}

fn sum(a: &NodePath, b: &NodePath) -> NodePath {
    let mut out = *a;
    for (out, b) in out.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
        *out += b;
    }
    out
}

fn mean(a: &NodePath, b: &NodePath) -> NodePath {
    sum(a, b).map(|way| way.map(|x| 0.5 * x))
}

/// Largest magnitude of a read-out's number: the displacement for a feature of 1 \[per axis\], a thousand
/// typical ones.
const LARGEST: f64 = 1e4;

impl ModelParameters for MixtureParameters {
    const MODEL: &'static str = "mixture";

    fn version(&self) -> u64 {
        self.version
    }

    fn with_version(self, version: u64) -> Self {
        Self { version, ..self }
    }

    fn step_ns(&self) -> u64 {
        self.ar.step_ns
    }

    fn input_scale(&self) -> f64 {
        TARGET_RMS
    }

    fn validate(&self) -> Result<(), WeightsError> {
        self.ar.validate()?;
        WeightsError::all_within(Self::MODEL, LARGEST, self.plain.numbers())?;
        WeightsError::all_within(Self::MODEL, LARGEST, self.full.numbers())?;
        if self.present.foresight {
            WeightsError::all_within(Self::MODEL, LARGEST, self.foresight.numbers())?;
        }
        for shares in &self.shares {
            for share in shares {
                WeightsError::bounded(Self::MODEL, "weight of an expert", f64::from(*share), 0.0, 1.0)?;
            }
            let total = f64::from(shares.iter().sum::<f32>());
            WeightsError::bounded(Self::MODEL, "sum of the experts' weights", total, 0.999, 1.001)?;
        }
        Ok(())
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        self.ar.accepts(&other.ar)?;
        let flags = |of: &Self| [of.present.lstm, of.present.foresight].map(|is| f64::from(u8::from(is)));
        let ([lstm, foresight], [wanted_lstm, wanted]) = (flags(other), flags(self));
        WeightsError::bounded(Self::MODEL, "use of an LSTM", lstm, wanted_lstm, wanted_lstm)?;
        WeightsError::bounded(Self::MODEL, "use of foresight", foresight, wanted, wanted)
    }
}
