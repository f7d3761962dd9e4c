//! A stamped pen path in the writing plane: what a player feeds to the loop.
//!
//! Times rise strictly and start anywhere; positions in metres, y upwards. Longer steps in time are gaps in
//! which the device saw nothing. Absent: pressure and tilt.

mod place;
mod travel;

pub use place::{Anchor, Ink, Layout, Lift, PathError, Placement};
pub use travel::travel_duration_s;

use crate::metrics::{Smoothness, ToolSample, motion};
use std::ops::Range;

/// One reading of the pen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSample {
    /// \[s\]
    pub t_s: f64,
    /// \[m\]
    pub x_m: f64,
    /// \[m\]
    pub y_m: f64,
    /// The pen touches the surface.
    pub contact: bool,
}

/// The samples that belong to one character.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelSpan {
    pub label: String,
    /// Indices into [`PenPath::samples`]; travel to and from the character is outside.
    pub samples: Range<usize>,
}

/// A pen path with the stamps a device would have given it.
#[derive(Debug, Clone, PartialEq)]
pub struct PenPath {
    /// In order of time.
    pub samples: Vec<PathSample>,
    /// Nominal rate of the device \[Hz\].
    pub rate_hz: f64,
    /// Characters in order of time; empty for paths that come without labels.
    pub spans: Vec<LabelSpan>,
    /// Lifts and travels that were synthesised because the recording has none.
    pub inserted_travels: usize,
    /// Recorded stretches without samples.
    pub gaps: usize,
    /// Indices of the samples behind a lift without recorded hover, if none was synthesised.
    pub leaps: Vec<usize>,
}

impl PenPath {
    /// A path of given samples (times rising) without labels; the rate is one over the median step.
    #[must_use]
    pub fn from_samples(samples: Vec<PathSample>) -> Self {
        let mut steps: Vec<f64> =
            samples.iter().zip(samples.iter().skip(1)).map(|(a, b)| b.t_s - a.t_s).collect();
        steps.sort_by(f64::total_cmp);
        let rate_hz = steps.get(steps.len() / 2).filter(|d| **d > 0.0).map_or(0.0, |d| 1.0 / d);
        let gaps = steps.iter().filter(|d| **d * rate_hz > 4.0).count();
        Self { samples, rate_hz, spans: Vec::new(), inserted_travels: 0, gaps, leaps: Vec::new() }
    }

    /// Time from the first to the last sample \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match (self.samples.first(), self.samples.last()) {
            (Some(first), Some(last)) => last.t_s - first.t_s,
            _ => 0.0,
        }
    }

    /// Lower left and upper right corner of all samples \[m\]; `None` for an empty path.
    #[must_use]
    pub fn bounds_m(&self) -> Option<[[f64; 2]; 2]> {
        self.samples.iter().fold(None, |bounds, s| {
            let [[left, low], [right, high]] = bounds.unwrap_or([[s.x_m, s.y_m]; 2]);
            Some([[left.min(s.x_m), low.min(s.y_m)], [right.max(s.x_m), high.max(s.y_m)]])
        })
    }

    /// The same path `speed` times as fast (2 = half the time); the rate grows with it.
    ///
    /// `speed` must be positive and finite; anything else gives the path unchanged.
    #[must_use]
    pub fn time_scaled(mut self, speed: f64) -> Self {
        if !(speed > 0.0 && speed.is_finite()) {
            return self;
        }
        for sample in &mut self.samples {
            sample.t_s /= speed;
        }
        self.rate_hz *= speed;
        self
    }

    /// The path with a hover travel from its end back to its start, so that it can be repeated without a
    /// jump.
    #[must_use]
    pub fn closed(mut self) -> Self {
        if let (Some(&last), Some(&first)) = (self.samples.last(), self.samples.first()) {
            let back = travel::travel(last, [0.0; 2], [first.x_m, first.y_m], [0.0; 2], self.rate_hz, 0.0);
            self.samples.extend(back);
            self.inserted_travels += 1;
        }
        self
    }

    /// The samples over and over with times that go on rising: one step of the rate between end and start.
    ///
    /// Close the path first, or the pen jumps at every repetition. Empty for an empty path.
    pub fn cycle(&self) -> impl Iterator<Item = PathSample> + '_ {
        let turn_s = self.duration_s() + if self.rate_hz > 0.0 { 1.0 / self.rate_hz } else { 1.0 };
        let turns = if self.samples.is_empty() { 0 } else { u32::MAX };
        (0..turns).flat_map(move |turn| {
            let later_s = f64::from(turn) * turn_s;
            self.samples.iter().map(move |s| PathSample { t_s: s.t_s + later_s, ..*s })
        })
    }

    /// Peak and RMS of the pen's derivatives, hover included, gaps left out.
    #[must_use]
    pub fn motion(&self) -> Smoothness {
        let samples: Vec<ToolSample> =
            self.samples.iter().map(|s| ToolSample { t_s: s.t_s, x_m: s.x_m, y_m: s.y_m }).collect();
        motion(&samples)
    }
}

#[cfg(test)]
mod tests;
