//! One pass through the network, in `f32`, with weights rounded to bfloat16.
//!
//! A preview is made in one tick of several; what ran between leaves the weights out of the near caches, and
//! to fetch them takes longer than the pass. Half the bytes are half of that. Rounding changes a weight by
//! 0.4 % at most, far less than another seed of the training.
//!
//! Contract: no allocation; the same bits with every set of vector instructions. Every output is summed over
//! its inputs in their order, without fused multiply-add, so that the width of the registers changes nothing
//! but the time. That is why the choice between them may be made at run time.

use multiversion::multiversion;

use super::features::FEATURES;
use super::weights::{ForesightWeights, HIDDEN, LAYERS, OUTPUTS, SHAPES};

/// Outputs that are summed together: as many as fit the registers of every machine.
const LANES: usize = 32;
/// Units of the last hidden layer.
pub const LAST: usize = {
    let [.., last] = HIDDEN;
    last
};
/// Units of the widest layer.
const WIDEST: usize = 128;

const _: () = {
    assert!(FEATURES <= WIDEST && OUTPUTS <= WIDEST);
    let mut rest: &[(usize, usize)] = &SHAPES;
    while let [(_, outputs), others @ ..] = rest {
        assert!(*outputs <= WIDEST && outputs.is_multiple_of(LANES));
        rest = others;
    }
};

/// A network in the order in which it is read.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Per layer and block of outputs.
    biases: Box<[[f32; LANES]]>,
    /// Per layer and block of outputs a row per input, one after another; the upper half of an `f32` each.
    rows: Box<[[u16; LANES]]>,
}

/// The upper half of the `f32` that is the bfloat16 nearest to `weight`, to the even one of two.
#[must_use]
fn narrowed(weight: f64) -> u16 {
    let bits = (weight as f32).to_bits();
    (bits.wrapping_add(0x7fff + (bits >> 16 & 1)) >> 16) as u16
}

/// The number that `narrow` stands for.
#[must_use]
#[inline(always)]
fn widened(narrow: u16) -> f32 {
    f32::from_bits(u32::from(narrow) << 16)
}

/// Outputs of the network, and its last layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// The last hidden layer.
    pub hidden: [f32; LAST],
    /// Outputs, two for each node.
    pub outputs: [f32; OUTPUTS],
}

impl Network {
    /// Packs weights that were checked before.
    #[must_use]
    pub fn new(weights: &ForesightWeights) -> Self {
        let (mut biases, mut rows) = (Vec::new(), Vec::new());
        for (layer, (inputs, outputs)) in weights.layers().iter().zip(SHAPES) {
            for block in 0..outputs / LANES {
                let output = |lane: usize| block * LANES + lane;
                let bias = |lane: usize| layer.bias.get(output(lane)).copied().unwrap_or(0.0) as f32;
                biases.push(std::array::from_fn(bias));
                for input in 0..inputs {
                    let weight = |lane: usize| {
                        narrowed(layer.weight.get(output(lane) * inputs + input).copied().unwrap_or(0.0))
                    };
                    rows.push(std::array::from_fn(weight));
                }
            }
        }
        Self { biases: biases.into(), rows: rows.into() }
    }

    /// One pass through all layers.
    #[must_use]
    pub fn answer(&self, features: &[f32; FEATURES]) -> Answer {
        let mut answer = Answer { hidden: [0.0; LAST], outputs: [0.0; OUTPUTS] };
        pass(self, features, &mut answer);
        answer
    }

    /// The same with the instructions that every machine of this kind has.
    #[cfg(test)]
    fn plain_answer(&self, features: &[f32; FEATURES]) -> Answer {
        let mut answer = Answer { hidden: [0.0; LAST], outputs: [0.0; OUTPUTS] };
        run(self, features, &mut answer);
        answer
    }
}

#[multiversion(targets("x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn pass(network: &Network, features: &[f32; FEATURES], answer: &mut Answer) {
    run(network, features, answer);
}

#[inline(always)]
fn run(network: &Network, features: &[f32; FEATURES], answer: &mut Answer) {
    let mut values = [0.0_f32; WIDEST];
    for (value, feature) in values.iter_mut().zip(features) {
        *value = *feature;
    }
    let mut rows = &*network.rows;
    let mut biases = network.biases.iter();
    for (index, (inputs, outputs)) in SHAPES.into_iter().enumerate() {
        let mut next = [0.0_f32; WIDEST];
        let given = values.get(..inputs).unwrap_or_default();
        for sums in next.as_chunks_mut::<LANES>().0.iter_mut().take(outputs / LANES) {
            let (Some((weights, rest)), Some(bias)) = (rows.split_at_checked(inputs), biases.next()) else {
                return;
            };
            rows = rest;
            let mut own = *bias;
            for (row, value) in weights.iter().zip(given) {
                for (sum, weight) in own.iter_mut().zip(row) {
                    *sum += widened(*weight) * value;
                }
            }
            *sums = own;
        }
        if index + 1 < LAYERS {
            for value in &mut next {
                *value = activation(*value);
            }
        }
        if index + 2 == LAYERS {
            for (out, value) in answer.hidden.iter_mut().zip(&next) {
                *out = *value;
            }
        }
        values = next;
    }
    for (out, value) in answer.outputs.iter_mut().zip(&values) {
        *out = *value;
    }
}

/// x · clamp(x/6 + 1/2, 0, 1): smooth enough to train, without an exponential (Howard et al. 2019,
/// "Searching for MobileNetV3").
#[must_use]
#[inline(always)]
pub fn activation(x: f32) -> f32 {
    let gate = x * (1.0 / 6.0) + 0.5;
    let gate = if gate > 0.0 { gate } else { 0.0 };
    x * if gate < 1.0 { gate } else { 1.0 }
}

/// Derivative of the activation at x.
#[must_use]
#[inline(always)]
pub fn slope(x: f32) -> f32 {
    let inside = x * (1.0 / 3.0) + 0.5;
    let inside = if x > -3.0 { inside } else { 0.0 };
    if x < 3.0 { inside } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::super::weights::{Dense, ForesightSpec};
    use super::*;

    /// Numbers without order, of order 1.
    fn number(seed: usize) -> f64 {
        let stirred = (seed as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
        stirred as f64 / (1_u64 << 53) as f64 - 0.5
    }

    fn weights() -> ForesightWeights {
        let mut seed = 0;
        let layers = SHAPES.map(|(inputs, outputs)| {
            let mut numbers = |count: usize| {
                seed += count;
                (0..count).map(|at| 0.4 * number(seed + at)).collect::<Vec<_>>()
            };
            Dense { weight: numbers(inputs * outputs), bias: numbers(outputs) }
        });
        ForesightWeights::new(ForesightSpec { step_ns: 10_000_000, input_scale: 10.0, block: 2 }, layers)
            .unwrap()
    }

    fn features(seed: usize) -> [f32; FEATURES] {
        std::array::from_fn(|at| (4.0 * number(seed * FEATURES + at)) as f32)
    }

    #[test]
    fn a_weight_becomes_the_nearest_bfloat16_and_of_two_the_even_one() {
        let known = [
            (0.0, 0x0000),
            (1.0, 0x3f80),
            (-2.5, 0xc020),
            // 2^-8 of a number lies between two: the even one.
            (1.0 + 1.0 / 256.0, 0x3f80),
            (1.0 + 3.0 / 256.0, 0x3f82),
            (-1.0 - 3.0 / 256.0, 0xbf82),
            // A little beyond: the next one.
            (1.0 + 1.01 / 256.0, 0x3f81),
            (1.0 + 2.99 / 256.0, 0x3f81),
            // Up to the next power.
            (1.9999, 0x4000),
        ];
        for (weight, bits) in known {
            assert_eq!(narrowed(weight), bits, "{weight}");
        }
        for seed in 0..1000 {
            let weight = number(seed);
            let error = (f64::from(widened(narrowed(weight))) - weight).abs();
            assert!(
                error <= weight.abs() / 255.0 && narrowed(-weight) == narrowed(weight) ^ 0x8000,
                "{weight}"
            );
        }
    }

    #[test]
    fn every_set_of_instructions_gives_the_same_bits() {
        let network = Network::new(&weights());
        for seed in 0..50 {
            let (chosen, plain) = (network.answer(&features(seed)), network.plain_answer(&features(seed)));
            let bits = |answer: Answer| answer.outputs.map(f32::to_bits);
            assert_eq!(bits(chosen), bits(plain));
            assert_eq!(chosen.hidden.map(f32::to_bits), plain.hidden.map(f32::to_bits));
        }
    }

    #[test]
    fn the_answer_is_that_of_the_formula_in_double_precision() {
        let weights = weights();
        let network = Network::new(&weights);
        for seed in 0..20 {
            let features = features(seed);
            let mut values: Vec<f64> = features.iter().map(|f| f64::from(*f)).collect();
            for (index, (layer, (inputs, outputs))) in weights.layers().iter().zip(SHAPES).enumerate() {
                values = (0..outputs)
                    .map(|o| {
                        let row = &layer.weight[o * inputs..][..inputs];
                        layer.bias[o]
                            + row
                                .iter()
                                .zip(&values)
                                .map(|(w, v)| f64::from(widened(narrowed(*w))) * v)
                                .sum::<f64>()
                    })
                    .map(|x| if index + 1 < LAYERS { x * (x / 6.0 + 0.5).clamp(0.0, 1.0) } else { x })
                    .collect();
            }
            for (got, expected) in network.answer(&features).outputs.iter().zip(values) {
                assert!((f64::from(*got) - expected).abs() < 1e-4, "{got} {expected}");
            }
        }
    }

    #[test]
    fn the_slope_is_that_of_the_activation() {
        for step in -400..400_i16 {
            let x = f32::from(step) * 0.0125 + 0.003;
            let measured = (activation(x + 1e-3) - activation(x - 1e-3)) / 2e-3;
            // The corners at ±3 have two slopes.
            if (x.abs() - 3.0).abs() > 2e-3 {
                assert!((measured - slope(x)).abs() < 2e-3, "{x}: {measured} {}", slope(x));
            }
        }
        assert_eq!((activation(-4.0), activation(4.0)), (0.0, 4.0));
    }
}
