//! The prior of refinement: weights learned from other hands, as plain data.
//!
//! A weight depends on how many steps after the sample a lead lies and on how clean the tablet is. Per kind
//! of tablet and term it is a [`Curve`]: a base and parts that decay or grow with the steps ahead. Data, fit
//! and limits: `config/models/refine-prior.md`. The same numbers are in `refine-prior.toml` beside it, which
//! settings load; a test there compares them bit for bit. They are repeated here because the law must be
//! complete without files.

use thiserror::Error;

use super::blend::TERMS;

/// Most parts of a curve.
pub const CURVE_PARTS: usize = 2;
/// Largest magnitude of a base or an amplitude \[1\]: that of a learned weight.
pub const LARGEST_COEFFICIENT: f64 = 4.0;
/// Shortest and longest reach of a part \[steps\].
pub const LEGAL_REACH: [f64; 2] = [0.01, 1000.0];

/// Shape of a part as a function of x = steps ahead / reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CurveShape {
    /// e^(−x): 1 at the sample, 0 after a few reaches.
    Fading,
    /// 1 − e^(−x): 0 at the sample, 1 far ahead.
    Growing,
    /// e^(−x²): near 1 for half a reach, then falls quickly.
    Falling,
    /// 1 − e^(−x²).
    Rising,
}

/// amplitude · shape(steps ahead / reach).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePart {
    /// The weight where the shape is 1 \[1\].
    pub amplitude: f64,
    /// How it depends on the steps ahead.
    pub shape: CurveShape,
    /// Reach \[steps of the pen's grid\], above 0.
    pub reach_steps: f64,
}

/// A weight by steps ahead: base + Σ parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curve {
    /// Constant part \[1\].
    pub base: f64,
    /// Parts that vary with the steps ahead.
    pub parts: [Option<CurvePart>; CURVE_PARTS],
}

/// One curve per term of a correction; all weights are metres per metre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curves {
    /// Of the preview's remaining displacement.
    pub left: Curve,
    /// Of the innovation: newest sample − preview at its time.
    pub innovation: Curve,
    /// Of the displacement by the pen's velocity until the lead.
    pub velocity: Curve,
    /// Of the displacement by its acceleration.
    pub acceleration: Curve,
}

/// Curves for both kinds of tablet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinePrior {
    /// For tablets of coarse steps (clarity 0).
    pub coarse: Curves,
    /// For clean ones (clarity 1).
    pub clean: Curves,
}

/// A number of a prior outside its range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("the weights that refinement starts from: {curve}: {name} = {got} is outside {min} to {max}")]
pub struct PriorError {
    /// Tablet and term, for example `coarse.left`.
    pub curve: &'static str,
    /// `base`, `amplitude` or `reach_steps`.
    pub name: &'static str,
    /// The refused value, as it was given.
    pub got: f64,
    /// Smallest value that is legal, itself included.
    pub min: f64,
    /// Largest value that is legal, itself included.
    pub max: f64,
}

impl CurveShape {
    /// In \[0, 1\], `ahead` steps after the sample.
    fn at(self, ahead: f64, reach: f64) -> f64 {
        let exponential = || (-ahead / reach).exp();
        let gaussian = || (-(ahead / reach) * (ahead / reach)).exp();
        match self {
            Self::Fading => exponential(),
            Self::Growing => 1.0 - exponential(),
            Self::Falling => gaussian(),
            Self::Rising => 1.0 - gaussian(),
        }
    }
}

impl Curve {
    /// `base` and one part.
    const fn new(base: f64, amplitude: f64, shape: CurveShape, reach_steps: f64) -> Self {
        Self { base, parts: [Some(CurvePart { amplitude, shape, reach_steps }), None] }
    }

    /// The weight `ahead` steps after the sample.
    #[must_use]
    pub fn at(&self, ahead: f64) -> f64 {
        let parts = self.parts.iter().flatten();
        parts.fold(self.base, |weight, part| weight + part.amplitude * part.shape.at(ahead, part.reach_steps))
    }

    /// Name, value and bounds of every number.
    fn numbers(&self) -> impl Iterator<Item = (&'static str, f64, [f64; 2])> + '_ {
        const WEIGHTS: [f64; 2] = [-LARGEST_COEFFICIENT, LARGEST_COEFFICIENT];
        let parts = self.parts.iter().flatten().flat_map(|part| {
            [("amplitude", part.amplitude, WEIGHTS), ("reach_steps", part.reach_steps, LEGAL_REACH)]
        });
        std::iter::once(("base", self.base, WEIGHTS)).chain(parts)
    }
}

impl Curves {
    /// In the order of a correction's terms.
    const fn all(&self) -> [&Curve; TERMS] {
        [&self.left, &self.innovation, &self.velocity, &self.acceleration]
    }

    fn weights(&self, ahead: f64) -> [f64; TERMS] {
        self.all().map(|curve| curve.at(ahead))
    }
}

impl RefinePrior {
    /// That of the presets.
    pub const SHIPPED: Self = Self {
        coarse: Curves {
            left: Curve::new(-0.6, -0.3, CurveShape::Fading, 1.5),
            innovation: Curve::new(0.0, 1.9, CurveShape::Growing, 4.0),
            velocity: Curve::new(0.0, 0.68, CurveShape::Fading, 5.5),
            acceleration: Curve {
                base: 0.0,
                parts: [
                    Some(CurvePart { amplitude: 0.25, shape: CurveShape::Fading, reach_steps: 15.0 }),
                    Some(CurvePart { amplitude: -0.9, shape: CurveShape::Fading, reach_steps: 0.6 }),
                ],
            },
        },
        clean: Curves {
            left: Curve::new(-0.3, -0.7, CurveShape::Falling, 12.0),
            innovation: Curve::new(0.0, 1.2, CurveShape::Rising, 5.0),
            velocity: Curve::new(0.0, 1.0, CurveShape::Falling, 9.0),
            acceleration: Curve::new(0.0, 1.0, CurveShape::Falling, 10.0),
        },
    };

    /// The weights `ahead` steps after the sample, on a tablet from coarse, 0, to clean, 1; in the order of
    /// [`Curves`]' fields.
    #[must_use]
    pub fn weights(&self, ahead: f64, clarity: f64) -> [f64; TERMS] {
        let mut weights = self.coarse.weights(ahead);
        for (weight, clean) in weights.iter_mut().zip(self.clean.weights(ahead)) {
            *weight += clarity * (clean - *weight);
        }
        weights
    }

    /// Checks every number.
    ///
    /// # Errors
    ///
    /// The first outside its bounds; NaN and infinity are outside all of them.
    pub fn validate(&self) -> Result<(), PriorError> {
        const COARSE: [&str; TERMS] =
            ["coarse.left", "coarse.innovation", "coarse.velocity", "coarse.acceleration"];
        const CLEAN: [&str; TERMS] =
            ["clean.left", "clean.innovation", "clean.velocity", "clean.acceleration"];
        let coarse = COARSE.into_iter().zip(self.coarse.all());
        for (curve, of) in coarse.chain(CLEAN.into_iter().zip(self.clean.all())) {
            for (name, got, [min, max]) in of.numbers() {
                if !(min..=max).contains(&got) {
                    return Err(PriorError { curve, name, got, min, max });
                }
            }
        }
        Ok(())
    }
}

impl Default for RefinePrior {
    fn default() -> Self {
        Self::SHIPPED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_weights_are_those_of_the_formulas_that_were_fitted() {
        for ahead in [0.125, 0.5, 1.375, 3.7, 12.0, 23.875] {
            let fading = |within: f64| (-ahead / within).exp();
            let falling = |within: f64| (-(ahead / within) * (ahead / within)).exp();
            let coarse = [
                -0.6 - 0.3 * fading(1.5),
                1.9 * (1.0 - fading(4.0)),
                0.68 * fading(5.5),
                0.25 * fading(15.0) - 0.9 * fading(0.6),
            ];
            let clean = [-0.3 - 0.7 * falling(12.0), 1.2 * (1.0 - falling(5.0)), falling(9.0), falling(10.0)];
            // Bit for bit, because ticks depend on it.
            assert_eq!(RefinePrior::SHIPPED.weights(ahead, 0.0), coarse);
            for ((got, coarse), clean) in
                RefinePrior::SHIPPED.weights(ahead, 0.75).iter().zip(coarse).zip(clean)
            {
                assert_eq!(*got, coarse + 0.75 * (clean - coarse));
            }
        }
    }

    #[test]
    fn every_number_is_judged_and_named() {
        assert_eq!(RefinePrior::SHIPPED.validate(), Ok(()));
        let refused = |change: fn(&mut RefinePrior, f64), value: f64| {
            let mut prior = RefinePrior::SHIPPED;
            change(&mut prior, value);
            prior.validate().unwrap_err().to_string()
        };
        for (value, written) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (-4.5, "-4.5"), (1e300, "1000")] {
            let base = refused(|prior, value| prior.clean.velocity.base = value, value);
            assert!(base.contains(&format!("clean.velocity: base = {written}")), "{base}");
            assert!(base.ends_with("is outside -4 to 4"), "{base}");
            let far = refused(
                |prior, value| {
                    for part in prior.coarse.acceleration.parts.iter_mut().flatten().skip(1) {
                        part.amplitude = value;
                    }
                },
                value,
            );
            assert!(far.contains(&format!("coarse.acceleration: amplitude = {written}")), "{far}");
        }
        for value in [0.0, -1.0, f64::NAN, 1e4] {
            let reach = refused(
                |prior, value| {
                    for part in prior.coarse.left.parts.iter_mut().flatten() {
                        part.reach_steps = value;
                    }
                },
                value,
            );
            assert!(
                reach.contains("coarse.left: reach_steps = ") && reach.ends_with("0.01 to 1000"),
                "{reach}"
            );
        }
    }
}
