//! Every number of the law between prediction and plan: what it measures, unit, range, and why this value.
//!
//! Lengths are normalised per axis (RMS of recent motion [`crate::pen::TARGET_RMS`]): a step of ordinary
//! motion is 10 per axis, about 14 long. Chosen by train writers of the data sets, tested on the test writers
//! of all four (docs/results/closed-loop.md). What half and double of each do: docs/results/law.md. Model:
//! the parameters of Google's ink-stroke-modeler, which are public, documented and in one place.

/// A number of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// The field of [`LawParameters`].
    pub name: &'static str,
    /// Its unit; `1` if it has none.
    pub unit: &'static str,
    /// That of the presets.
    pub value: f64,
    /// Smallest and largest value that make sense, both included.
    pub range: [f64; 2],
    /// What it measures, and why it has the value of the presets.
    pub about: &'static str,
}

macro_rules! parameters {
    ($($(#[doc = $doc:literal])+ $name:ident = $value:expr, $unit:literal, $least:expr, $most:expr;)+) => {
        /// Every number of the law.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct LawParameters {
            $($(#[doc = $doc])+ #[doc = concat!(" \\[", $unit, "\\]")] pub $name: f64,)+
        }

        impl LawParameters {
            /// Those of the presets.
            pub const SHIPPED: Self = Self { $($name: $value,)+ };

            /// What is known about each, in the order of the law.
            pub const NUMBERS: &[Number] = &[$(Number {
                name: stringify!($name),
                unit: $unit,
                value: $value,
                range: [$least, $most],
                about: concat!($($doc),+),
            }),+];

            /// What is known about the number with this name.
            #[must_use]
            pub fn named(name: &str) -> Option<&'static Number> {
                Self::NUMBERS.iter().find(|number| number.name == name)
            }

            /// The same law with another value of a number.
            #[must_use]
            pub fn with(mut self, number: &Number, value: f64) -> Self {
                $(if number.name == stringify!($name) {
                    self.$name = value;
                })+
                self
            }
        }
    };
}

parameters! {
    // All of them.
    /// Displacements, errors and motions beyond this are jumps, which no preview predicts: fifteen ordinary
    /// steps.
    leap = 150.0, "per axis and step", 10.0, 1e4;
    /// Cases that the records and the corrections remember: five seconds of motion.
    memory = 500.0, "cases", 10.0, 1e6;
    /// Cases of other hands that count at a hand's beginning, forgotten like its own: corrections agreed with
    /// the error in them, and Hold had the error of ordinary motion. The fewer, the sooner a preview that is
    /// right is left alone.
    first_cases = 20.0, "cases", 1.0, 1e4;

    // Corrections.
    /// Samples later than this after the newest grid point do not correct the preview, as after a pause.
    latest_phase = 1.5, "steps", 1.0, 10.0;
    /// The prior of a correction weighs as much as this many cases of ordinary motion, and as many more per
    /// step ahead, because errors far ahead are correlated.
    prior_cases = 40.0, "cases", 0.0, 1e4;
    /// Square of the innovation in ordinary motion: a third of a step.
    ordinary_innovation = 10.0, "per axis, squared", 0.1, 1e3;
    /// Square of the displacement by acceleration in ordinary motion, one step ahead: a fifth of a step.
    ordinary_acceleration = 4.0, "per axis, squared", 0.1, 1e3;
    /// Largest weight of a term of a correction.
    largest = 4.0, "1", 1.0, 100.0;
    /// Least horizon that a case is divided by; nearer leads use this value.
    shortest = 0.5, "steps", 0.1, 1.0;

    // Filters of the pen's velocity and acceleration.
    /// Change of acceleration per sample over the noise of its position, in the filter for the coarsest
    /// tablets.
    filter_coarsest = 3e3, "1/s²", 100.0, 1e5;
    /// The same from each filter to the next: the coarsest tablets and the cleanest differ by a hundred.
    filter_ratio = 3.162, "1", 1.1, 10.0;
    /// Extrapolation by which the filters are judged.
    filter_reach_s = 0.015, "s", 0.002, 0.1;
    /// Weight of a judgement while the pen moves fast: 0 judges nothing, 1 forgets all earlier judgements. At
    /// rest none counts.
    filter_pace = 0.03, "1", 0.001, 1.0;
    /// Judgements before another filter than the coarsest is selected.
    filter_settled = 8.0, "cases", 1.0, 1e3;
    /// A filter is replaced by one whose mean squared error is below this share of its own. At 1 the best is
    /// selected at once, but every change resets the corrections.
    filter_better = 0.85, "1", 0.1, 1.0;
    /// Initial standard deviation of velocity: 0.3 m/s of a hand whose samples have 0.3 mm.
    filter_velocity = 1e3, "1/s, of a sample's noise", 10.0, 1e5;
    /// The same of acceleration: 10 m/s². Without a bound it would explain the whole displacement to the
    /// second sample.
    filter_acceleration = 3e4, "1/s², of a sample's noise", 100.0, 1e7;
    /// After a longer silence the velocity is unknown.
    filter_forget_s = 0.1, "s", 0.02, 1.0;

    // Record and shares.
    /// A preview is shortened by the amount by which its share is below 1 by more than this many standard
    /// deviations.
    doubt = 3.0, "1", 0.0, 10.0;
    /// Bound on the evidence Λ, with which it begins: a shipped predictor was proven on other hands. A case
    /// adds at most a fifth of it. Trust ends where Λ is below minus half of it, and begins again from 0 on.
    evidence_most = 20.0, "1", 1.0, 1e3;

    // Onset of motion.
    /// After this many steps of rest ([`crate::pen::REST`]) motion begins again.
    onset_rest = 5.0, "steps", 1.0, 100.0;
    /// Initial share of a preview if onsets are predicted badly.
    onset_first = 0.3, "1", 0.0, 1.0;
    /// Increase of that share with every step of motion.
    onset_more = 0.1, "1/step", 0.01, 1.0;
    /// Mean squared overshoot of previews at onsets relative to the squared real displacement from which
    /// onsets count as predicted badly; 0: never overshoots. UNIPEN's train writers have 0.2 and more at 35
    /// ms, pendigits 0.05, a clean pen 0.01.
    onset_bad = 0.15, "1", 0.001, 10.0;
    /// Farthest lead judged: beyond it every predictor overshoots. The record of onsets begins with the first
    /// cases at each of the leads, predicted badly, and remembers as many at each as other records do.
    onset_farthest = 10.0, "steps", 1.0, 24.0;
    /// Saturated share of the arm's motion for the full reduction. A UR5 that writes with UNIPEN's hands is
    /// saturated half of the time, with a clean pen a tenth.
    onset_saturated = 0.3, "1", 0.01, 1.0;
    /// Time constant of the saturated share, in time of motion.
    saturation_s = 0.2, "s", 0.01, 10.0;

    // Governor.
    /// Time over which squared errors of following and of feedback are averaged: a stroke.
    outcome_s = 0.15, "s", 0.01, 10.0;
    /// Share of feedback's mean squared error above which following has little value: 0 is at the pen, 1 is
    /// as far from it as under feedback alone.
    outcome_poor = 0.5, "1", 0.01, 1.0;
    /// A preview with at most this share of Hold's squared error is right: following it within the limits is
    /// the best there is.
    right = 0.1, "1", 0.0, 1.0;
    /// Time constant of κ's fall, as a multiple of the delay of its effect, dead time plus feedback's lag:
    /// 0.42 s behind a UR5, 0.83 s behind 100 ms.
    governor_fall = 7.0, "1", 0.5, 100.0;
    /// Time constant of its rise, in time of motion. A digit of a fast hand takes 0.4 s.
    governor_rise_s = 0.19, "s", 0.02, 10.0;
    /// Least κ, from which an arm recovers within half a second.
    governor_least = 0.1, "1", 0.01, 1.0;

    // Trust.
    /// Share of the recent ticks that wanted to follow and had no plan or no joints for it, at which trust
    /// ends; at a fifth of it trust begins again.
    unplanned_ends = 0.25, "1", 0.01, 1.0;
    /// Memory of that share.
    unplanned_s = 0.1, "s", 0.01, 10.0;
}

impl LawParameters {
    /// λ, the forgetting factor per case of the records and the corrections.
    #[must_use]
    pub const fn forgetting(&self) -> f64 {
        1.0 - 1.0 / self.memory
    }
}

impl Default for LawParameters {
    fn default() -> Self {
        Self::SHIPPED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_found_by_its_name_lies_in_its_range_and_says_what_it_is() {
        let shipped = LawParameters::SHIPPED;
        for number in LawParameters::NUMBERS {
            let [least, most] = number.range;
            assert!((least..=most).contains(&number.value), "{number:?}");
            assert!(number.about.trim().len() > 20 && !number.unit.is_empty(), "{number:?}");
            assert_eq!(LawParameters::named(number.name), Some(number));
            assert_eq!(shipped.with(number, number.value), shipped);
            assert_ne!(shipped.with(number, 1.1 * number.value), shipped);
        }
        assert_eq!(size_of::<LawParameters>(), 8 * LawParameters::NUMBERS.len());
        let leap = LawParameters::named("leap").expect("leap");
        assert_eq!(shipped.with(leap, 1.0), LawParameters { leap: 1.0, ..shipped });
        assert_eq!(LawParameters::named("no such"), None);
    }
}
