//! Changed copies of the sequences, new in each epoch: other devices, other hands.
//!
//! Contract: drawn from the seed, the epoch and the sequence's index alone. Everything off changes nothing,
//! bit for bit. Order: rate (decimation or stretching of time), smoothing, rotation and shear, size, noise,
//! the device's grid.

use std::str::FromStr;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::corpus::Strokes;
use super::resample;

/// The augmentations and their sizes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Augment {
    /// Factor on all displacements, log-uniform between these.
    pub scale: Option<(f64, f64)>,
    /// Samples per step, log-uniform between these: the same motion at another rate.
    pub time: Option<(f64, f64)>,
    /// Chance that only every second sample is taken, from a random phase.
    pub decimate: f64,
    /// Chance that positions are smoothed by (1, 2, 1)/4 inside strokes.
    pub smooth: f64,
    /// Largest turn either way \[degrees\].
    pub rotate: f64,
    /// Largest shear either way: x grows by it per y.
    pub shear: f64,
    /// Standard deviation of noise on positions \[input scales\], uniform from 0.
    pub noise: f64,
    /// Pitch of the grid that positions are rounded to \[input scales\], uniform from 0.
    pub grid: f64,
}

/// A wrong `--augment`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct AugmentError(String);

const LEGAL: &str = "comma-separated scale=0.5..2, time=0.7..1.4 (both within 0.1..10), decimate=0..1, \
                     smooth=0..1, \
     rotate=0..45 (degrees), shear=0..1, noise=0..1, grid=0..2 (input scales)";

impl FromStr for Augment {
    type Err = AugmentError;

    fn from_str(text: &str) -> Result<Self, AugmentError> {
        let mut augment = Self::default();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty() && *part != "none") {
            let wrong = || AugmentError(format!("{part:?} is not an augmentation; legal: {LEGAL}"));
            let (name, value) = part.split_once('=').ok_or_else(wrong)?;
            let number = |text: &str| text.parse::<f64>().ok().filter(|x| x.is_finite());
            let up_to = |limit: f64| number(value).filter(|x| (0.0..=limit).contains(x)).ok_or_else(wrong);
            let range = || {
                let (low, high) = value.split_once("..")?;
                let (low, high) = (number(low)?, number(high)?);
                (0.1 <= low && low <= high && high <= 10.0).then_some((low, high))
            };
            match name {
                "scale" => augment.scale = Some(range().ok_or_else(wrong)?),
                "time" => augment.time = Some(range().ok_or_else(wrong)?),
                "decimate" => augment.decimate = up_to(1.0)?,
                "smooth" => augment.smooth = up_to(1.0)?,
                "rotate" => augment.rotate = up_to(45.0)?,
                "shear" => augment.shear = up_to(1.0)?,
                "noise" => augment.noise = up_to(1.0)?,
                "grid" => augment.grid = up_to(2.0)?,
                _ => return Err(wrong()),
            }
        }
        Ok(augment)
    }
}

impl Augment {
    #[must_use]
    pub fn is_off(&self) -> bool {
        *self == Self::default()
    }

    /// The changed copy of `strokes` for one epoch; `unit` is one input scale in raw units.
    ///
    /// `keep_speed`: displacements per step are divided by the change of rate, as a running speed scale
    /// would.
    #[must_use]
    pub fn apply(&self, strokes: &Strokes, unit: f64, keep_speed: bool, seed: u64) -> Strokes {
        if self.is_off() {
            return strokes.clone();
        }
        let rng = &mut Pcg64::seed_from_u64(seed);
        let mut size = self.scale.map_or(1.0, |range| log_uniform(rng, range));
        let mut changed = strokes.clone();
        if self.decimate > 0.0 && rng.random_range(0.0..1.0) < self.decimate {
            changed = resample::decimated(&changed, 2, rng.random_range(0..2));
            size *= if keep_speed { 0.5 } else { 1.0 };
        }
        if let Some(range) = self.time {
            let ratio = log_uniform(rng, range);
            changed = resample::resampled(&changed, ratio, rng.random_range(0.0..1.0));
            size *= if keep_speed { 1.0 / ratio } else { 1.0 };
        }
        if self.smooth > 0.0 && rng.random_range(0.0..1.0) < self.smooth {
            changed = smoothed(&changed);
        }
        let (sin, cos) = symmetric(rng, self.rotate).to_radians().sin_cos();
        let shear = symmetric(rng, self.shear);
        for [x, y] in &mut changed.v {
            let sheared = *x + shear * *y;
            [*x, *y] = [size * (cos * sheared - sin * *y), size * (sin * sheared + cos * *y)];
        }
        let noise = unit * self.noise * rng.random_range(0.0..1.0);
        let pitch = unit * self.grid * rng.random_range(0.0..1.0);
        if noise > 0.0 || pitch > 0.0 {
            let origin: [f64; 2] = std::array::from_fn(|_| rng.random_range(0.0..1.0) * pitch);
            let disturb = |x: f64, rng: &mut Pcg64| {
                let x = x + noise * gaussian(rng);
                if pitch > 0.0 { (x / pitch).round() * pitch } else { x }
            };
            let points = resample::positions(&changed);
            let points: Vec<[f64; 2]> = points
                .iter()
                .map(|p| [disturb(p[0] + origin[0], rng), disturb(p[1] + origin[1], rng)])
                .collect();
            for (v, pair) in changed.v.iter_mut().zip(points.windows(2)) {
                *v = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            }
        }
        changed
    }
}

fn log_uniform(rng: &mut Pcg64, (low, high): (f64, f64)) -> f64 {
    (low.ln() + (high.ln() - low.ln()) * rng.random_range(0.0..1.0)).exp()
}

fn symmetric(rng: &mut Pcg64, limit: f64) -> f64 {
    limit * rng.random_range(-1.0..1.0)
}

/// Standard normal by Box and Muller.
fn gaussian(rng: &mut Pcg64) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random_range(0.0..1.0_f64)).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random_range(0.0..1.0)).cos()
}

/// Each point the mean of itself (twice) and its neighbours; ends of strokes stay.
fn smoothed(strokes: &Strokes) -> Strokes {
    let points = resample::positions(strokes);
    let mut v = strokes.v.clone();
    let at = |k: usize| {
        let inside = k > 0 && k + 1 < points.len() && !strokes.jumps(k - 1) && !strokes.jumps(k);
        let mean = |axis: usize| {
            if inside {
                0.25 * (points[k - 1][axis] + 2.0 * points[k][axis] + points[k + 1][axis])
            } else {
                points[k][axis]
            }
        };
        [mean(0), mean(1)]
    };
    for k in 1..points.len() {
        let (a, b) = (at(k - 1), at(k));
        v[k - 1] = [b[0] - a[0], b[1] - a[1]];
    }
    Strokes { v, jump: strokes.jump.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> Strokes {
        let v =
            (0..60).map(|t| [(f64::from(t) * 0.2).cos() * 8.0, (f64::from(t) * 0.2).sin() * 8.0]).collect();
        let mut jump = vec![false; 60];
        jump[30] = true;
        Strokes::at_rest(v, jump)
    }

    fn parse(text: &str) -> Augment {
        text.parse().unwrap()
    }

    #[test]
    fn off_changes_nothing_and_a_seed_decides_all() {
        assert_eq!(parse("none").apply(&curve(), 10.0, false, 3), curve());
        let all = parse(
            "scale=0.5..2,time=0.7..1.4,decimate=0.5,smooth=0.5,rotate=10,shear=0.2,noise=0.1,grid=0.3",
        );
        assert_eq!(all.apply(&curve(), 10.0, true, 3), all.apply(&curve(), 10.0, true, 3));
        assert_ne!(all.apply(&curve(), 10.0, true, 3), all.apply(&curve(), 10.0, true, 4));
    }

    #[test]
    fn a_grid_leaves_whole_multiples_and_size_scales_every_step() {
        let gridded = parse("grid=1").apply(&curve(), 10.0, false, 5);
        let smallest =
            gridded.v.iter().flatten().map(|x| x.abs()).filter(|x| *x > 1e-9).fold(f64::MAX, f64::min);
        assert!(gridded.v.iter().flatten().all(|x| ((x / smallest).round() - x / smallest).abs() < 1e-6));
        let double = parse("scale=2..2").apply(&curve(), 10.0, false, 5);
        for (a, b) in double.v.iter().flatten().zip(curve().v.iter().flatten()) {
            assert!((a - 2.0 * b).abs() < 1e-12);
        }
    }

    #[test]
    fn a_change_of_rate_can_keep_the_speed_per_step() {
        let rms = |s: &Strokes| super::super::corpus::rms([s]);
        let fast = parse("decimate=1").apply(&curve(), 10.0, false, 1);
        let kept = parse("decimate=1").apply(&curve(), 10.0, true, 1);
        assert!(rms(&fast) > 1.6 * rms(&curve()));
        assert!((rms(&fast) / rms(&kept) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn wrong_words_are_answered_with_the_legal_ones() {
        for wrong in ["scale", "scale=2..1", "scale=0..2", "noise=nan", "noise=-1", "warp=1", "decimate=2"] {
            let message = wrong.parse::<Augment>().unwrap_err().to_string();
            assert!(
                message.contains(wrong) && message.contains("legal: comma-separated scale="),
                "{message}"
            );
        }
    }
}
