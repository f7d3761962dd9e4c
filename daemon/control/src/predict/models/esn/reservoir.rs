//! `Reservoir`: the fixed random network of an echo state network.
//!
//! s ← (1 − leak)·s + leak·tanh(x W_in + s W_rec), row vectors. Built once (that may allocate), shared from
//! then on. The same seed gives the same matrices.

use std::sync::{Arc, OnceLock};

use crate::predict::models::esn::network::{Double, Single};
use crate::predict::online::WeightsError;

/// Units of the reservoir (the paper's 50).
pub const UNITS: usize = 50;

/// s, one number per unit.
pub type ReservoirState = [f64; UNITS];

/// What determines a reservoir.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReservoirSettings {
    /// Seed of the random generator.
    pub seed: u64,
    /// Share of the new state, 0 to 1; 0.7.
    pub leak: f64,
    /// Largest magnitude of W_rec's eigenvalues, below 1 so that memory fades; 0.95.
    pub spectral_radius: f64,
    /// Standard deviation of W_in's entries; 0.1/√2 for inputs of RMS 10 per axis.
    pub input_std: f64,
}

impl Default for ReservoirSettings {
    fn default() -> Self {
        Self { seed: 0, leak: 0.7, spectral_radius: 0.95, input_std: 0.1 * std::f64::consts::FRAC_1_SQRT_2 }
    }
}

impl ReservoirSettings {
    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        let within = |name, got, min, max| WeightsError::bounded("reservoir", name, got, min, max);
        within("leak", self.leak, 0.0, 1.0)
            .and(within("spectral_radius", self.spectral_radius, 0.0, 0.999))
            .and(within("input_std", self.input_std, 0.0, 100.0))
    }
}

/// W_in, W_rec and the leak.
#[derive(Debug, Clone, PartialEq)]
pub struct Reservoir {
    pub(super) double: Double,
    pub(super) single: Single,
    digest: u64,
}

impl Reservoir {
    /// W_in ~ N(0, input_std²), W_rec ~ N(0, 1) scaled to the spectral radius.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds.
    pub fn seeded(settings: &ReservoirSettings) -> Result<Self, WeightsError> {
        settings.validate()?;
        let (input, recurrent) = matrices(settings)?;
        Self::from_matrices(settings.leak, input, recurrent)
    }

    /// The same, and made once in a process for the default settings: its spectral radius takes milliseconds,
    /// and every predictor that has a reservoir asks for that one.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds.
    pub fn shared(settings: &ReservoirSettings) -> Result<Arc<Self>, WeightsError> {
        static STANDARD: OnceLock<Arc<Reservoir>> = OnceLock::new();
        if *settings != ReservoirSettings::default() {
            return Ok(Arc::new(Self::seeded(settings)?));
        }
        if let Some(standard) = STANDARD.get() {
            return Ok(Arc::clone(standard));
        }
        let made = Arc::new(Self::seeded(settings)?);
        Ok(Arc::clone(STANDARD.get_or_init(|| made)))
    }

    /// A given reservoir: W_in 2 x UNITS, W_rec UNITS x UNITS, for row vectors.
    ///
    /// # Errors
    ///
    /// A leak outside 0 to 1, or an entry that is non-finite or beyond ±100.
    pub fn from_matrices(
        leak: f64,
        input: [ReservoirState; 2],
        recurrent: [ReservoirState; UNITS],
    ) -> Result<Self, WeightsError> {
        WeightsError::bounded("reservoir", "leak", leak, 0.0, 1.0)?;
        let entries = || input.iter().chain(&recurrent).flatten().copied();
        WeightsError::all_within("reservoir", 100.0, entries())?;
        // FNV-1a over the bits.
        let digest = std::iter::once(leak)
            .chain(entries())
            .flat_map(|w| w.to_bits().to_le_bytes())
            .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
            });
        let (double, single) = (Double::new(leak, &input, &recurrent), Single::new(leak, &input, &recurrent));
        Ok(Self { double, single, digest })
    }

    /// Identifies a reservoir: a read-out is valid for its own only.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.digest
    }

    /// Takes in one displacement.
    #[inline]
    pub fn observe(&self, state: &mut ReservoirState, x: [f64; 2]) {
        self.double.step(state, x);
    }
}

/// W_in, 2 x UNITS, and W_rec, UNITS x UNITS.
type Matrices = ([ReservoirState; 2], [ReservoirState; UNITS]);

fn matrices(settings: &ReservoirSettings) -> Result<Matrices, WeightsError> {
    let mut normal = Normal::new(settings.seed);
    let mut row = |std: f64| std::array::from_fn(|_| std * normal.draw());
    let input = [row(settings.input_std), row(settings.input_std)];
    let mut recurrent: [ReservoirState; UNITS] = std::array::from_fn(|_| row(1.0));
    let radius = spectral_radius(&recurrent);
    if !(radius > 1e-6 && radius.is_finite()) {
        return Err(WeightsError::Radius { got: radius });
    }
    let factor = settings.spectral_radius / radius;
    recurrent.as_flattened_mut().iter_mut().for_each(|w| *w *= factor);
    Ok((input, recurrent))
}

/// Largest magnitude of the eigenvalues: lim ‖Aⁿ‖^(1/n) (Gelfand) by repeated squaring, n = 2³², A normalised
/// each time.
///
/// Needs no eigenvalues and cannot fail to converge; accurate to about 1e-9 relative.
fn spectral_radius(matrix: &[ReservoirState; UNITS]) -> f64 {
    let mut power = *matrix;
    let (mut log, mut share) = (0.0, 1.0);
    for _ in 0..32 {
        let norm = power.iter().flatten().map(|w| w * w).sum::<f64>().sqrt();
        if !(norm > 0.0 && norm.is_finite()) {
            return 0.0;
        }
        log += share * norm.ln();
        share *= 0.5;
        let unit = power.map(|row| row.map(|w| w / norm));
        for (row, left) in power.iter_mut().zip(&unit) {
            *row = [0.0; UNITS];
            for (right, w) in unit.iter().zip(left) {
                for (sum, r) in row.iter_mut().zip(right) {
                    *sum += w * r;
                }
            }
        }
    }
    f64::exp(log)
}

/// Standard normal numbers: SplitMix64 and Marsaglia's polar method.
struct Normal {
    state: u64,
    spare: Option<f64>,
}

impl Normal {
    fn new(seed: u64) -> Self {
        Self { state: seed, spare: None }
    }

    /// Uniform in [−1, 1).
    fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 * (2.0 / (1_u64 << 53) as f64) - 1.0
    }

    fn draw(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        // Accepts π/4 of all pairs: 64 rejections in a row are less likely than 1e-42.
        for _ in 0..64 {
            let (u, v) = (self.uniform(), self.uniform());
            let square = u * u + v * v;
            if 0.0 < square && square < 1.0 {
                let factor = (-2.0 * square.ln() / square).sqrt();
                self.spare = Some(v * factor);
                return u * factor;
            }
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeded_matrices_have_the_stated_moments_and_radius() {
        let settings = ReservoirSettings { seed: 3, ..ReservoirSettings::default() };
        let (input, recurrent) = matrices(&settings).unwrap();
        let eigen = nalgebra::DMatrix::from_fn(UNITS, UNITS, |i, j| recurrent[i][j]).complex_eigenvalues();
        let radius = eigen.iter().map(|e| e.norm()).fold(0.0, f64::max);
        assert!((radius - 0.95).abs() < 1e-7, "spectral radius {radius}");
        let inputs = input.as_flattened();
        let std = (inputs.iter().map(|w| w * w).sum::<f64>() / inputs.len() as f64).sqrt();
        assert!((std / settings.input_std - 1.0).abs() < 0.25, "input std {std}");
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let mut normal = Normal::new(7);
        let drawn: Vec<f64> = (0..100_000).map(|_| normal.draw()).collect();
        let count = drawn.len() as f64;
        let mean = drawn.iter().sum::<f64>() / count;
        let variance = drawn.iter().map(|z| z * z).sum::<f64>() / count;
        let beyond_two = drawn.iter().filter(|z| z.abs() > 2.0).count() as f64 / count;
        // Four standard errors each.
        assert!(mean.abs() < 0.013 && (variance - 1.0).abs() < 0.018, "{mean} {variance}");
        assert!((beyond_two - 0.0455).abs() < 0.0027, "{beyond_two}");
    }

    #[test]
    fn the_seed_decides() {
        let of = |seed| Reservoir::seeded(&ReservoirSettings { seed, ..Default::default() }).unwrap();
        assert_eq!(of(1), of(1));
        assert_ne!(of(1).digest(), of(2).digest());
        let silent = ReservoirSettings { leak: 0.5, ..Default::default() };
        assert_ne!(Reservoir::seeded(&silent).unwrap().digest(), of(0).digest());
    }
}
