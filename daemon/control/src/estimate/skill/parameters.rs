//! Parameters of shares and records, each with what it measures and the reason for its value.
//!
//! Lengths are normalised per axis (RMS of recent motion [`crate::pen::TARGET_RMS`]): a step of ordinary
//! motion is 10 per axis, about 14 long. Tuned on train writers of the data sets, tested on the test writers
//! of all four (docs/results/closed-loop.md).

/// All parameters of [`crate::estimate::skill`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkillParameters {
    /// Displacements and errors beyond this are jumps, which no preview predicts [per axis and step ahead]:
    /// ten ordinary steps.
    pub leap: f64,
    /// Forgetting factor per judged case \[1\]: about 500 steps of motion.
    pub forgetting: f64,
    /// A preview is shortened by the amount by which its share is below 1 by more than this many standard
    /// deviations.
    pub doubt: f64,
    /// Cases of ordinary motion with which the record begins.
    pub head_start_cases: f64,
    /// The preview's squared error in them relative to Hold's \[1\]: a shipped predictor was proven on other
    /// hands.
    pub head_start_error: f64,
    /// Memory of the share of wrong claims, in claims: half a second of motion.
    pub surprise_cases: f64,
    /// How previews are trusted at onsets.
    pub onset: OnsetParameters,
}

/// How far previews are trusted at the onset of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnsetParameters {
    /// After this many steps of rest ([`crate::pen::REST`]) motion begins again.
    pub rest_steps: u32,
    /// Initial share of a preview if onsets are predicted badly \[1\].
    pub first: f64,
    /// Increase of that share with every step of motion \[1\].
    pub more: f64,
    /// Mean squared overshoot of previews at onsets relative to the squared real displacement \[1\] from
    /// which onsets count as predicted badly; 0: never overshoots. UNIPEN's train writers have 0.2 and more
    /// at 35 ms, pendigits 0.05, a clean pen 0.01.
    pub bad: f64,
    /// Farthest lead judged \[steps\]: beyond it every predictor overshoots.
    pub farthest: f64,
    /// Forgetting factor per judged preview \[1\]: some ten onsets.
    pub forgetting: f64,
    /// Squared real displacement with which the record begins, as predicted badly [per axis, squared]: 200
    /// previews of ordinary steps.
    pub head_start: f64,
    /// Share of its recent motion in which an arm must be saturated for the full reduction \[1\]. A UR5 that
    /// writes with UNIPEN's hands is saturated half of the time, with a clean pen a tenth.
    pub limited: f64,
    /// Time constant of that share, in time of motion \[s\].
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
