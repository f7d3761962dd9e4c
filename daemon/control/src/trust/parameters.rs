//! Parameters of α, each with what it measures, its range of effect, and the reason for its value.
//!
//! The values are those of the presets, tuned on train writers of the data sets and tested on the test
//! writers of all four (docs/results/closed-loop.md). Model: the parameters of Google's ink-stroke-modeler,
//! which are public, documented and in one place.

/// A threshold with hysteresis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// Trust (or health) ends above this.
    pub ends: f64,
    /// It resumes at or below this.
    pub begins: f64,
}

impl Hysteresis {
    /// The threshold in force, depending on `holds`.
    #[must_use]
    pub const fn bound(&self, holds: bool) -> f64 {
        if holds { self.ends } else { self.begins }
    }
}

/// All parameters of [`crate::trust`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustParameters {
    /// Mean squared error of past previews over that of Hold \[1\]: 0 is perfect, 1 is as good as Hold. The
    /// record is noisy, so on the way down slightly worse than Hold is tolerated; on the way up a tenth less
    /// is required.
    pub hold: Hysteresis,
    /// The same over constant velocity \[1\]: a preview that a far simpler predictor beats clearly is not
    /// trusted.
    pub steady: Hysteresis,
    /// Previews this much better than Hold \[1\] are trusted however good constant velocity is: the
    /// alternative is Hold.
    pub clearly: f64,
    /// Share of a predictor's recent bands that the pen left \[1\]; bands promise 0.1. Detects an
    /// overconfident predictor long before its mean error does.
    pub surprise: Hysteresis,
    /// Share of the recent ticks that wanted to follow and had no plan or no joints for it \[1\].
    pub unplanned: Hysteresis,
    /// Memory of that share \[s\].
    pub unplanned_s: f64,
    /// A preview with at most this share of Hold's error \[1\] is right: following it within the limits is
    /// the best there is.
    pub right: f64,
    /// A right preview loses trust all the same if the plans of more than this share of recent ticks failed
    /// \[1\]: saturated plans take more solver steps than the cap.
    pub failed: f64,
    /// Memory of that share \[s\]: longer than from one lift of the pen to the next, which costs
    /// solver steps.
    pub failed_s: f64,
    /// Number of leads whose record decides, from the nearest one of the plan: later ones weigh little in a
    /// plan that is made again in every tick.
    pub leads_judged: usize,
    /// How long refused weights count against the learner, unless valid ones follow \[s\]: the memory of the
    /// record.
    pub learner_doubt_s: f64,
    /// Time over which squared errors of following and of feedback are averaged \[s\]: a stroke.
    pub outcome_s: f64,
    /// Share of feedback's mean squared error above which following has little value \[1\]: 0 is at the pen,
    /// 1 is as far from it as under feedback alone.
    pub outcome_poor: f64,
    /// Time constant of falling headroom, as a multiple of the delay of its effect, dead time plus feedback's
    /// lag \[1\]: 0.42 s behind a UR5, 0.83 s behind 100 ms.
    pub headroom_fall: f64,
    /// Time constant of rising headroom, in time of motion that is not overtaxed \[s\]. A digit of a fast
    /// hand takes 0.4 s.
    pub headroom_rise_s: f64,
    /// Least headroom \[1\], from which an arm recovers within half a second.
    pub headroom_least: f64,
    /// Shares within this factor count as equal \[1\]: each change of the trust makes the plan factor its
    /// costs again.
    pub headroom_same: f64,
}

impl TrustParameters {
    /// Those of the presets.
    pub const SHIPPED: Self = Self {
        hold: Hysteresis { ends: 1.05, begins: 0.9 },
        steady: Hysteresis { ends: 1.5, begins: 1.2 },
        clearly: 0.2,
        surprise: Hysteresis { ends: 0.5, begins: 0.25 },
        unplanned: Hysteresis { ends: 0.25, begins: 0.05 },
        unplanned_s: 0.1,
        right: 0.1,
        failed: 0.05,
        failed_s: 1.0,
        leads_judged: 2,
        learner_doubt_s: 5.0,
        outcome_s: 0.15,
        outcome_poor: 0.5,
        headroom_fall: 7.0,
        headroom_rise_s: 0.19,
        headroom_least: 0.1,
        headroom_same: 1.1,
    };
}

impl Default for TrustParameters {
    fn default() -> Self {
        Self::SHIPPED
    }
}
