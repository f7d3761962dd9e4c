//! The numbers behind shares and records, each with what it measures and why it has its value.
//!
//! Lengths are normalised per axis (RMS of recent motion [`crate::pen::TARGET_RMS`]): a step of ordinary
//! motion is 10 per axis, about 14 long. Set on train writers of the data sets, judged on the test writers of
//! all four (docs/results/closed-loop.md).

/// See the module's description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkillParameters {
    /// Ways and errors beyond this are leaps, which no preview foresees [per axis and step ahead]: ten
    /// ordinary steps.
    pub leap: f64,
    /// Factor by which the past loses weight per judged case \[1\]: about 500 steps of motion.
    pub forgetting: f64,
    /// A preview is shortened where its share is below 1 by more than this many standard deviations, and by
    /// what is more.
    pub doubt: f64,
    /// Cases of ordinary motion that the record begins with...
    pub head_start_cases: f64,
    /// ... and the preview's squared error in them relative to Hold's \[1\]: a predictor that is shipped has
    /// its proof from other hands.
    pub head_start_error: f64,
    /// Claims over which the share of surprises forgets: half a second of motion.
    pub surprise_cases: f64,
    /// Where the pen begins to move.
    pub onset: OnsetParameters,
}

/// How far previews are believed where the pen begins to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnsetParameters {
    /// After so many steps of rest ([`crate::pen::REST`]) motion begins anew.
    pub rest_steps: u32,
    /// Share of a preview that is believed at first where beginnings are foreseen badly \[1\]...
    pub first: f64,
    /// ... and how much more with every step of motion \[1\].
    pub more: f64,
    /// Mean square of the way by which previews of beginnings went too far, relative to that of the real way
    /// \[1\]: 0 is never too far; from here on they count as foreseen badly. UNIPEN's train writers have 0.2
    /// and more 35 ms ahead, pendigits' 0.05, a clean pen 0.01.
    pub bad: f64,
    /// No farther ahead is looked \[steps\]: there everybody goes too far.
    pub farthest: f64,
    /// Factor by which past beginnings lose weight per judged preview \[1\]: some ten of them.
    pub forgetting: f64,
    /// Square of the real way that they begin with, foreseen badly [per axis, squared]: 200 previews of
    /// ordinary steps.
    pub head_start: f64,
    /// An arm counts as limited fully that is at its limits in this part of its recent motion \[1\]. A UR5
    /// that writes with UNIPEN's hands is in half of it, with a clean pen in a tenth.
    pub limited: f64,
    /// What was before loses weight by a factor e in so much motion \[s\].
    pub memory_s: f64,
}

impl SkillParameters {
    /// Those of the presets.
    pub const SHIPPED: Self = Self {
        leap: 100.0,
        forgetting: 0.998,
        doubt: 3.0,
        head_start_cases: 20.0,
        head_start_error: 0.7,
        surprise_cases: 50.0,
        onset: OnsetParameters {
            rest_steps: 5,
            first: 0.3,
            more: 0.1,
            bad: 0.15,
            farthest: 10.0,
            forgetting: 0.9995,
            head_start: 200.0 * 100.0,
            limited: 0.3,
            memory_s: 0.2,
        },
    };
}

impl Default for SkillParameters {
    fn default() -> Self {
        Self::SHIPPED
    }
}
