//! The numbers behind α, each with what it measures, where it starts and ends to count, and why it has its
//! value.
//!
//! The values are those of the presets; they were set on train writers of the data sets and judged on the
//! test writers of all four (docs/results/closed-loop.md). Model: the parameters of Google's
//! ink-stroke-modeler, which are public, documented and in one place.

/// A bound with a memory: what has ended begins again at another value, so that nothing flickers at the
/// bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hysteresis {
    /// Belief (or health) ends beyond this.
    pub ends: f64,
    /// It begins again at or below this.
    pub begins: f64,
}

impl Hysteresis {
    /// The bound now, while it `holds` or not.
    #[must_use]
    pub const fn bound(&self, holds: bool) -> f64 {
        if holds { self.ends } else { self.begins }
    }
}

/// See the module's description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrustParameters {
    /// Mean squared error of past previews over that of Hold \[1\]: 0 is perfect, 1 is as good as standing
    /// still. On the way down a little worse than Hold is borne, because the record is noisy; on the way up a
    /// tenth less is asked for.
    pub hold: Hysteresis,
    /// The same over constant velocity \[1\]: what a far simpler predictor does much better is not to be
    /// believed.
    pub steady: Hysteresis,
    /// Previews this much better than Hold \[1\] are believed however much better constant velocity is: Hold
    /// is what doubt would put in their place.
    pub clearly: f64,
    /// Share of a predictor's recent bands that the pen left \[1\]: 0.1 is what bands promise, 1 is that they
    /// are never right. A predictor does not know what it does not know, long before its mean error tells.
    pub surprise: Hysteresis,
    /// Share of the recent ticks that wanted to follow and had no plan or no joints for it \[1\].
    pub unplanned: Hysteresis,
    /// A preview with at most this part of Hold's error \[1\] is right: what limits leave of it is the best
    /// there is...
    pub right: f64,
    /// ... but where the plans of more than this share of the recent ticks failed \[1\]: plans at limits take
    /// the solver more steps than it has.
    pub failed: f64,
    /// Time over which squared errors of following and of feedback are averaged \[s\]: a stroke.
    pub outcome_s: f64,
    /// Part of feedback's mean squared error above which following is not worth much \[1\]: 0 is to be at the
    /// pen, 1 is as far from it as feedback alone.
    pub outcome_poor: f64,
    /// Headroom falls by a factor e in this many times of what a change of trust takes to show, dead time and
    /// feedback's lag \[1\]: 0.42 s behind a UR5, 0.83 s behind 100 ms. Behind a UR5 0.42 instead of 0.75 s
    /// leave train writers of unipen-ced 4 % less error and 8 instead of 15 % of their sequences worse than
    /// feedback, pendigits 3 % less, unipen-tos 1 % more.
    pub headroom_fall: f64,
    /// It rises by a factor e in this time of motion that is not overtaxed \[s\]. A digit of a fast hand
    /// takes 0.4 s.
    pub headroom_rise_s: f64,
    /// Its least share \[1\], from which an arm that is overtaxed no more is back within half a second.
    pub headroom_least: f64,
    /// Shares within this factor count as the same \[1\]: with each change of the trust a plan factors its
    /// costs anew.
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
        right: 0.1,
        failed: 0.05,
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
