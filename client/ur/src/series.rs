//! The two series of controllers, and their control cycles.

use serde::Serialize;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Series {
    /// CB3: PolyScope 3, 125 Hz.
    Cb3,
    /// e-Series: PolyScope 5, 500 Hz.
    E,
}

impl Series {
    /// Control rate \[Hz\].
    #[must_use]
    pub const fn rate_hz(self) -> u32 {
        match self {
            Self::Cb3 => 125,
            Self::E => 500,
        }
    }

    /// Control cycle \[s\].
    #[must_use]
    pub const fn cycle_s(self) -> f64 {
        1.0 / self.rate_hz() as f64
    }
}

impl std::fmt::Display for Series {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Cb3 => "CB3",
            Self::E => "e-Series",
        })
    }
}
