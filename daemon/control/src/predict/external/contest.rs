//! Which of two predictors is better: another process's, or the built-in one that stands in for it.
//!
//! Both predict after every grid step. At each of [`JUDGED`] leads the evidence is the sum of
//! (e_fallback² − e_external²) / 2s², s² the recent variance of the fallback's error; each case and the sum
//! are clipped. It is that of [`crate::estimate::record`], with the fallback in Hold's place. The external
//! predictor has to earn its place at every lead, and loses it at the first at which it is worse. Who loses
//! it waits, twice as long each time, so that one which earns trust in order to lie gets ever fewer chances.

use crate::pen::TARGET_RMS;
use crate::state::state;

/// Leads that are judged \[steps\]: soon, where a lie is found first, and as far as a plan looks.
pub(super) const JUDGED: [usize; 3] = [2, 5, 10];
/// Pairs of previews that wait for their outcome.
const PENDING: usize = 10;
/// Bound on the evidence at a lead; a case adds at most a fifth of it.
const MOST: f64 = 10.0;
/// Evidence at every lead from which the external predictor is used; below 0 at any of them it is not.
const EARNED: f64 = 5.0;
/// Memory of the fallback's squared error \[cases\]: two seconds of motion.
const MEMORY: f64 = 200.0;
/// Cases of a hand not seen yet: errors of a fifth of the way.
const FIRST: f64 = 5.0;
/// The first wait \[steps of motion\]; it doubles up to [`LONGEST`].
const WAIT: u32 = 100;
/// Half a minute of motion.
const LONGEST: u32 = 3200;
/// Steps of use after which the last loss is forgiven.
const FORGIVEN: u32 = 2000;

/// Positions that both predicted at the judged leads \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Of the external predictor.
    pub external: [[f64; 2]; JUDGED.len()],
    /// Of the fallback, at the same leads.
    pub fallback: [[f64; 2]; JUDGED.len()],
}

state! { whole [] Pair { external, fallback } }

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct JudgedLead {
    /// Sum of the fallback's squared errors \[normalised²\], and of cases.
    squares: f64,
    cases: f64,
    evidence: f64,
}

state! { whole [] JudgedLead { squares, cases, evidence } }

/// The evidence, and who may be used.
#[derive(Debug, Clone, PartialEq)]
pub struct Contest {
    /// A ring, one place per step; `newest` is where the last step's is. `None`: the external predictor
    /// predicted nothing there.
    pairs: [Option<Pair>; PENDING],
    newest: usize,
    leads: [JudgedLead; JUDGED.len()],
    earned: bool,
    /// Times it lost its place, less those forgiven.
    losses: u32,
    /// Steps until it may earn it again.
    wait: u32,
    /// Steps of use since the last loss.
    used: u32,
}

state! { [] Contest { pairs, newest, leads, earned, losses, wait, used } }

impl Default for Contest {
    fn default() -> Self {
        let first = |steps: usize| {
            let error = 0.2 * TARGET_RMS * steps as f64;
            JudgedLead { squares: FIRST * error * error, cases: FIRST, evidence: 0.0 }
        };
        Self {
            pairs: [None; PENDING],
            newest: 0,
            leads: JUDGED.map(first),
            earned: false,
            losses: 0,
            wait: 0,
            used: 0,
        }
    }
}

impl Contest {
    /// The external predictor may be used.
    #[must_use]
    pub const fn earned(&self) -> bool {
        self.earned
    }

    /// The least evidence of the judged leads, from -10 to 10.
    #[must_use]
    pub fn evidence(&self) -> f64 {
        self.leads.iter().fold(MOST, |least, lead| least.min(lead.evidence))
    }

    /// What both predicted after the step that closed last; `None`: the external one predicted nothing.
    pub fn record(&mut self, pair: Option<Pair>) {
        self.newest = (self.newest + 1) % PENDING;
        if let Some(slot) = self.pairs.get_mut(self.newest) {
            *slot = pair;
        }
    }

    /// The pen began anew: what waits will not be judged.
    pub const fn interrupt(&mut self) {
        self.pairs = [None; PENDING];
    }

    /// A step closed at `position` \[m\] after ordinary motion, with `unit_m` metres per unit: judges what
    /// was predicted for it. `in_use`: the external predictor was.
    pub fn judge(&mut self, position: [f64; 2], unit_m: f64, in_use: bool) {
        self.wait = self.wait.saturating_sub(1);
        self.used = if in_use { self.used.saturating_add(1) } else { self.used };
        if self.used >= FORGIVEN {
            (self.used, self.losses) = (0, self.losses.saturating_sub(1));
        }
        for (index, (steps, lead)) in JUDGED.into_iter().zip(&mut self.leads).enumerate() {
            let made = (self.newest + PENDING + 1 - steps) % PENDING;
            let Some(Some(pair)) = self.pairs.get(made) else { continue };
            let error = |predicted: Option<&[f64; 2]>| {
                let [x, y] = predicted.copied().unwrap_or(position);
                let (x, y) = ((x - position[0]) / unit_m, (y - position[1]) / unit_m);
                x * x + y * y
            };
            lead.add(error(pair.external.get(index)), error(pair.fallback.get(index)));
        }
        let least = self.evidence();
        // Written so that NaN counts against it.
        if self.earned && !(least >= 0.0) {
            self.earned = false;
            self.wait = WAIT.saturating_mul(1 << self.losses.min(16)).min(LONGEST);
            self.losses = self.losses.saturating_add(1);
            self.used = 0;
        } else if !self.earned && self.wait == 0 && least >= EARNED {
            self.earned = true;
        }
    }
}

impl JudgedLead {
    fn add(&mut self, external: f64, fallback: f64) {
        let gain = (fallback - external) / (2.0 * self.squares / self.cases.max(1.0));
        // Where neither has an error there is nothing to tell them apart by.
        let gain = if gain.is_nan() { 0.0 } else { gain.clamp(-0.2 * MOST, 0.2 * MOST) };
        self.evidence = (self.evidence + gain).clamp(-MOST, MOST);
        let forgetting = 1.0 - 1.0 / MEMORY;
        self.squares = forgetting * self.squares + fallback;
        self.cases = forgetting * self.cases + 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pen stands on the line; errors are as given, at every lead \[normalised\].
    fn after(steps: usize, contest: &mut Contest, external: f64, fallback: f64) {
        let unit_m = 1e-4;
        for _ in 0..steps {
            let at = |error: f64| [[error * unit_m, 0.0]; JUDGED.len()];
            contest.judge([0.0; 2], unit_m, contest.earned());
            contest.record(Some(Pair { external: at(external), fallback: at(fallback) }));
        }
    }

    fn steps_until(contest: &mut Contest, earned: bool, external: f64, fallback: f64) -> usize {
        (0..20_000)
            .take_while(|_| {
                after(1, contest, external, fallback);
                contest.earned() != earned
            })
            .count()
    }

    #[test]
    fn the_better_one_earns_its_place_and_the_equal_or_worse_one_never_does() {
        let mut contest = Contest::default();
        let steps = steps_until(&mut contest, true, 4.0, 5.0);
        assert!((20..120).contains(&steps), "{steps}");
        for worse in [5.0, 5.1, 50.0, 1e300, f64::INFINITY] {
            let mut contest = Contest::default();
            after(5000, &mut contest, worse, 5.0);
            assert!(!contest.earned(), "{worse}");
        }
    }

    #[test]
    fn a_lie_is_found_within_ten_steps_and_the_wait_doubles_each_time() {
        let mut contest = Contest::default();
        let mut waits = Vec::new();
        for _ in 0..8 {
            waits.push(steps_until(&mut contest, true, 1.0, 5.0));
            after(300, &mut contest, 1.0, 5.0);
            let lied = steps_until(&mut contest, false, 100.0, 5.0);
            assert!(lied <= 10, "{lied}");
        }
        assert!(waits.windows(2).all(|pair| pair[1] >= pair[0]), "{waits:?}");
        assert!(waits[7] >= 3000 && waits[7] <= 3400, "{waits:?}");
    }

    #[test]
    fn long_good_use_forgives() {
        let mut contest = Contest::default();
        steps_until(&mut contest, true, 1.0, 5.0);
        for _ in 0..3 {
            steps_until(&mut contest, false, 100.0, 5.0);
            steps_until(&mut contest, true, 1.0, 5.0);
        }
        after(3 * FORGIVEN as usize + 1, &mut contest, 1.0, 5.0);
        steps_until(&mut contest, false, 100.0, 5.0);
        let wait = steps_until(&mut contest, true, 1.0, 5.0);
        assert!(wait < 150, "{wait}");
    }

    #[test]
    fn previews_that_came_with_gaps_are_judged_at_their_own_lead() {
        let (mut contest, unit_m, right) = (Contest::default(), 1e-4, [0.002, 0.0]);
        let signs = |contest: &Contest| contest.leads.map(|lead| lead.evidence > 0.0);
        // One pair only, of which the external one is right everywhere.
        contest.record(Some(Pair { external: [right; 3], fallback: [[0.0; 2]; 3] }));
        let expected = [
            [false, false, false],
            [true, false, false],
            [true, false, false],
            [true, false, false],
            [true, true, false],
        ];
        for expected in expected {
            contest.judge(right, unit_m, false);
            assert_eq!(signs(&contest), expected);
            contest.record(None);
        }
        contest.interrupt();
        (0..10).for_each(|_| contest.judge(right, unit_m, false));
        assert_eq!(signs(&contest), [true, true, false], "what waited is not judged after a new beginning");
    }
}
