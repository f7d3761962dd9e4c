//! Sequences to train on.

/// One recorded character as displacements per step, with what is known of its jumps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Strokes {
    /// Displacements [raw units per step], T x 2.
    pub v: Vec<[f64; 2]>,
    /// Step t crosses two strokes; T long, or empty where nothing is known.
    pub jump: Vec<bool>,
}

impl Strokes {
    /// Nothing known of jumps.
    #[must_use]
    pub fn plain(v: Vec<[f64; 2]>) -> Self {
        Self { v, jump: Vec::new() }
    }

    /// Step `t` is known to cross two strokes.
    #[must_use]
    pub fn jumps(&self, t: usize) -> bool {
        self.jump.get(t).copied().unwrap_or(false)
    }

    /// Length of step `t`; 0 beyond the end.
    #[must_use]
    pub fn length(&self, t: usize) -> f64 {
        self.v.get(t).map_or(0.0, |[x, y]| x.hypot(*y))
    }
}
