//! `foresight`: a network that sees what the pen knows: motion, contact, direction in the plane, time.
//!
//! Trained offline on other writers, it predicts the way to every node of the mixture directly, in the frame
//! of motion. It is one of the mixture's experts; its last hidden layer feeds a read-out that learns the
//! hand. [`features`] is the pure function from the last displacements to its inputs, the same in training
//! and in the loop. Nothing learns here.
//!
//! Contract: no allocation after construction; the same bits with every set of vector instructions.

pub mod features;
mod network;
mod weights;

use std::sync::Arc;

pub use features::{FEATURES, Look, PenHistory};
pub use network::{Answer, LAST, Network, activation, slope};
pub use weights::{
    Dense, ForesightError, ForesightSpec, ForesightWeights, HIDDEN, LAYERS, NAMES, OUTPUTS, SHAPES,
};

use crate::pen::TARGET_RMS;
use crate::predict::models::mixture::{NODES, NodePath};
use crate::state::state;

/// Features of the read-out: the last hidden layer and a constant.
pub const READ: usize = LAST + 1;

/// The network with what it was trained for. Clones share the weights.
#[derive(Debug, Clone)]
pub struct Foresight {
    network: Arc<Network>,
    step_s: f64,
    block: usize,
}

/// Output of the network at the newest step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foreseen {
    /// Summed displacements at the nodes, normalised, in the plane.
    pub(in crate::predict::models) path: NodePath,
    /// Features of the read-out.
    pub(in crate::predict::models) read: [f32; READ],
    /// Cosine and sine of the frame of motion, in which the read-out works.
    pub(in crate::predict::models) frame: [f64; 2],
}

state! { whole [] Foreseen { path, read, frame } }

impl Foreseen {
    /// Of a pen that nothing is known of.
    pub const NOTHING: Self = Self { path: [[0.0; 2]; NODES.len()], read: [0.0; READ], frame: [1.0, 0.0] };

    /// Summed displacements at the nodes, normalised, in the plane.
    #[must_use]
    pub const fn path(&self) -> &[[f64; 2]; NODES.len()] {
        &self.path
    }
}

impl Foresight {
    /// Packs `weights`.
    #[must_use]
    pub fn new(weights: &ForesightWeights) -> Self {
        let spec = weights.spec();
        Self {
            network: Arc::new(Network::new(weights)),
            step_s: spec.step_ns as f64 * 1e-9,
            block: spec.block,
        }
    }

    /// What is ahead of `history`.
    #[must_use]
    pub fn foresee(&self, history: &PenHistory) -> Foreseen {
        let look = history.look(self.step_s, self.block);
        let Answer { hidden, outputs } = self.network.answer(&look.features);
        let mut foreseen = Foreseen { frame: look.frame, ..Foreseen::NOTHING };
        let steps = NODES.iter().zip(outputs.as_chunks::<2>().0);
        for (at, (node, output)) in foreseen.path.iter_mut().zip(steps) {
            let way = output.map(|o| f64::from(o) * unit(*node));
            *at = turned_back(look.frame, way);
        }
        for (feature, value) in foreseen.read.iter_mut().zip(hidden.into_iter().chain([1.0])) {
            *feature = value;
        }
        foreseen
    }
}

/// The way that an output of 1 stands for at `node` steps: that of ordinary motion on one axis.
#[must_use]
pub fn unit(node: usize) -> f64 {
    TARGET_RMS * node as f64
}

/// From the plane into a frame of motion.
#[must_use]
#[inline]
pub fn turned([c, s]: [f64; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    [c * x + s * y, c * y - s * x]
}

/// From a frame of motion back into the plane.
#[must_use]
#[inline]
pub fn turned_back([c, s]: [f64; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    [c * x - s * y, s * x + c * y]
}
