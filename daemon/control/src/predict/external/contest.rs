//! Which of two predictors is better: another process's, or the built-in one that stands in for it.
//!
//! Both predict after every grid step. When a step closes, every lead j that plans use has a case: with the
//! errors e of what both predicted for it j steps before, and s_j² the recent variance of the fallback's
//! error there,
//!
//! gain = mean over j of (e_fallback² − e_external²) / 2s_j².
//!
//! The evidence is the sum of the gains. What a step adds is bounded by a tenth of what it may take: a lie
//! costs as much evidence as it is large, so that rare large errors are not paid for by many small gains. The
//! external predictor has to earn its place, and loses it below 0, by silence, or to another process. Who
//! loses it by lies waits, twice as long each time, so that one which earns trust in order to lie gets ever
//! fewer chances; the next process waits as long, or a restart would end the wait. While the pen rests, as
//! the fallback said, no time passes, and nothing is learned of the fallback; who predicts motion then was
//! wrong.

use crate::pen::{TARGET_RMS, rests};
use crate::predict::bands::BAND_LEADS as LEADS;
use crate::state::state;

/// Bound on the evidence.
const MOST: f64 = 10.0;
/// What one step adds at most.
const GAIN: f64 = 0.2 * MOST;
/// Evidence from which the external predictor is used; below 0 it is not.
const EARNED: f64 = 5.0;
/// Memory of the fallback's squared error \[cases\]: two seconds of motion.
const MEMORY: f64 = 200.0;
/// Cases by which doubt about the fallback is judged: it may end as soon as the fallback has learned a hand.
const SOON: f64 = 30.0;
/// Cases of a hand not seen yet: errors of a fifth of the way.
const FIRST: f64 = 5.0;
/// The first wait \[steps of motion\]: a second of steps of 10 ms. It doubles up to [`LONGEST`].
const WAIT: u32 = 100;
/// The longest wait \[steps of motion\].
const LONGEST: u32 = 3200;
/// Who is silent for so many steps has to earn its place again: the fallback may have learned the hand.
const SILENT: u32 = 100;
/// Steps of use in motion after which the last loss is forgiven.
const FORGIVEN: u32 = 2000;

/// What both predicted after one step \[m\], the first position one step later.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Position at the step.
    pub base: [f64; 2],
    /// Of the external predictor; `None`: it predicted nothing in time.
    pub external: Option<[[f64; 2]; LEADS]>,
    /// What the fallback predicted, likewise.
    pub fallback: [[f64; 2]; LEADS],
}

state! { whole [] Pair { base, external, fallback } }

/// The fallback's squared error at one lead.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FallbackError {
    /// Sum of squares \[normalised²\], and of cases.
    squares: f64,
    cases: f64,
    /// Mean square in the newest [`SOON`] cases \[normalised²\].
    recent: f64,
}

state! { whole [] FallbackError { squares, cases, recent } }

/// The evidence, and who may be used.
#[derive(Debug, Clone, PartialEq)]
pub struct Contest {
    /// A ring, one place per step; `newest` is where the last step's is. `None`: nothing was predicted there.
    pairs: [Option<Pair>; LEADS],
    newest: usize,
    spreads: [FallbackError; LEADS],
    evidence: f64,
    earned: bool,
    /// Times it lost its place, less those forgiven.
    losses: u32,
    /// Steps until it may earn it again.
    wait: u32,
    /// Steps of use since the last loss.
    used: u32,
    /// Steps since the external predictor predicted something in time.
    silence: u32,
}

state! { [] Contest { pairs, newest, spreads, evidence, earned, losses, wait, used, silence } }

impl Default for Contest {
    fn default() -> Self {
        let first = |index: usize| {
            let error = 0.2 * TARGET_RMS * (index + 1) as f64;
            FallbackError { squares: FIRST * error * error, cases: FIRST, recent: error * error }
        };
        Self {
            pairs: [None; LEADS],
            newest: 0,
            spreads: std::array::from_fn(first),
            evidence: 0.0,
            earned: false,
            losses: 0,
            wait: 0,
            used: 0,
            silence: 0,
        }
    }
}

impl Contest {
    /// The external predictor may be used.
    #[must_use]
    pub const fn earned(&self) -> bool {
        self.earned
    }

    /// The evidence, from -10 to 10.
    #[must_use]
    pub const fn evidence(&self) -> f64 {
        self.evidence
    }

    /// Error of the fallback at `lead` steps lately, RMS \[normalised, in the plane\]; the last beyond.
    #[must_use]
    pub fn doubt(&self, lead: usize) -> f64 {
        self.spreads.get(lead.clamp(1, LEADS) - 1).map_or(0.0, |spread| spread.recent.sqrt())
    }

    /// What both predicted after the step that closed last; `None`: not even the fallback did.
    pub fn record(&mut self, pair: Option<Pair>) {
        self.newest = (self.newest + 1) % LEADS;
        let answered = pair.as_ref().is_some_and(|pair| pair.external.is_some());
        if let Some(slot) = self.pairs.get_mut(self.newest) {
            *slot = pair;
        }
        self.silence = if answered { 0 } else { self.silence.saturating_add(1) };
        if self.silence >= SILENT {
            (self.evidence, self.earned) = (0.0, false);
        }
    }

    /// Another process predicts from now on: what the last one was worth says nothing of it.
    pub fn begin_anew(&mut self) {
        (self.evidence, self.earned) = (0.0, false);
        for pair in self.pairs.iter_mut().flatten() {
            pair.external = None;
        }
    }

    /// The pen began anew: what waits will not be judged.
    pub const fn interrupt(&mut self) {
        self.pairs = [None; LEADS];
    }

    /// A step closed at `position` \[m\] after ordinary motion, with `unit_m` metres per unit: judges what
    /// was predicted for it, the external predictor at the leads from `nearest` to `last` that plans use.
    /// `in_use`: that had a part in it.
    pub fn judge(&mut self, position: [f64; 2], unit_m: f64, nearest: usize, last: usize, in_use: bool) {
        let first = nearest.clamp(1, LEADS);
        let used = first..=last.clamp(first, LEADS);
        let (mut gains, mut cases, mut moves) = (0.0, 0_u32, false);
        for (lead, spread) in (1..).zip(&mut self.spreads) {
            let made = (self.newest + LEADS + 1 - lead) % LEADS;
            let Some(Some(pair)) = self.pairs.get(made) else { continue };
            let Some(case) = Case::of(pair, lead - 1, position, unit_m) else { continue };
            moves |= case.moves;
            if let Some(gain) = case.gain(spread).filter(|_| used.contains(&lead)) {
                gains += gain;
                cases += 1;
            }
            if case.moves {
                spread.learn(case.fallback);
            }
        }
        if moves {
            self.wait = self.wait.saturating_sub(1);
            self.used = if in_use { self.used.saturating_add(1) } else { self.used };
            if self.used >= FORGIVEN {
                (self.used, self.losses) = (0, self.losses.saturating_sub(1));
            }
        }
        if cases > 0 {
            let gain = gains / f64::from(cases);
            // NaN counts against it.
            let gain = if gain >= -2.0 * MOST { gain.min(GAIN) } else { -2.0 * MOST };
            self.evidence = (self.evidence + gain).clamp(-MOST, MOST);
        }
        if self.earned && self.evidence < 0.0 {
            self.earned = false;
            self.wait = WAIT.saturating_mul(1 << self.losses.min(16)).min(LONGEST);
            self.losses = self.losses.saturating_add(1);
            self.used = 0;
        } else if !self.earned && self.wait == 0 && self.evidence >= EARNED {
            self.earned = true;
        }
    }
}

/// What both predicted for the step that closed, at one lead.
struct Case {
    /// Squared errors \[normalised²\]; `None`: the external predictor predicted nothing in time.
    fallback: f64,
    external: Option<f64>,
    /// The pen moved, or the fallback had expected it to.
    moves: bool,
}

impl Case {
    /// `None`: the pen rested, and all said so.
    fn of(pair: &Pair, index: usize, position: [f64; 2], unit_m: f64) -> Option<Self> {
        let per_m = 1.0 / unit_m;
        let from = |[x, y]: [f64; 2], [x0, y0]: [f64; 2]| [(x - x0) * per_m, (y - y0) * per_m];
        let error = |at: [f64; 2]| {
            let [x, y] = from(at, position);
            x * x + y * y
        };
        let rested = |at: &[f64; 2]| rests(from(*at, pair.base));
        let fallback = *pair.fallback.get(index)?;
        let external = pair.external.as_ref().and_then(|external| external.get(index)).copied();
        let moves = !(rested(&position) && rested(&fallback));
        if !moves && external.as_ref().is_none_or(rested) {
            return None;
        }
        Some(Self { fallback: error(fallback), external: external.map(error), moves })
    }

    /// What it says for the external predictor, beside what the fallback was lately wrong by.
    fn gain(&self, spread: &FallbackError) -> Option<f64> {
        let external = self.external?;
        // Where neither has an error there is nothing to tell them apart by.
        if self.fallback == external {
            return Some(0.0);
        }
        Some((self.fallback - external) / (2.0 * spread.squares / spread.cases.max(1.0)))
    }
}

impl FallbackError {
    /// A case of motion with this squared error \[normalised²\]. Rest would make the spread that of rest.
    fn learn(&mut self, squared: f64) {
        // A jump that the grid did not see must not hide the errors of years to come.
        let squared = squared.min(1e6);
        let forgetting = 1.0 - 1.0 / MEMORY;
        self.squares = forgetting * self.squares + squared;
        self.cases = forgetting * self.cases + 1.0;
        self.recent += (squared - self.recent) / SOON;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT_M: f64 = 1e-4;

    /// The pen moves on a line; errors are as given, at every lead \[normalised\].
    struct Scene {
        contest: Contest,
        step: u32,
    }

    impl Scene {
        fn new() -> Self {
            Self { contest: Contest::default(), step: 0 }
        }

        fn at(step: u32) -> [f64; 2] {
            [f64::from(step) * 14.0 * UNIT_M, 0.0]
        }

        fn go(&mut self, steps: usize, external: f64, fallback: f64) {
            for _ in 0..steps {
                self.step += 1;
                let in_use = self.contest.earned();
                self.contest.judge(Self::at(self.step), UNIT_M, 4, 20, in_use);
                let with = |error: f64| {
                    std::array::from_fn(|index| {
                        let [x, y] = Self::at(self.step + 1 + index as u32);
                        [x, y + error * UNIT_M]
                    })
                };
                let pair = Pair {
                    base: Self::at(self.step),
                    external: Some(with(external)),
                    fallback: with(fallback),
                };
                self.contest.record(Some(pair));
            }
        }

        fn until(&mut self, earned: bool, external: f64, fallback: f64) -> usize {
            (0..20_000)
                .take_while(|_| {
                    self.go(1, external, fallback);
                    self.contest.earned() != earned
                })
                .count()
        }
    }

    #[test]
    fn the_better_one_earns_its_place_and_the_equal_or_worse_one_never_does() {
        let steps = Scene::new().until(true, 4.0, 5.0);
        assert!((10..150).contains(&steps), "{steps}");
        for worse in [5.0, 5.1, 50.0, 1e300, f64::INFINITY, f64::NAN] {
            let mut scene = Scene::new();
            scene.go(5000, worse, 5.0);
            assert!(!scene.contest.earned(), "{worse}");
        }
    }

    #[test]
    fn a_lie_is_found_when_its_nearest_lead_closes_and_the_wait_doubles_each_time() {
        let mut scene = Scene::new();
        let mut waits = Vec::new();
        for _ in 0..8 {
            waits.push(scene.until(true, 1.0, 5.0));
            scene.go(300, 1.0, 5.0);
            let lied = scene.until(false, 100.0, 5.0);
            assert!(lied <= 5, "{lied}");
            // It goes on honestly.
        }
        assert!(waits.windows(2).skip(1).all(|pair| pair[1] + 20 >= pair[0]), "{waits:?}");
        assert!(waits[7] >= 3000 && waits[7] <= 3600, "{waits:?}");
    }

    /// Many small gains do not pay for a rare large lie.
    #[test]
    fn one_large_lie_in_eight_is_never_let_in() {
        for every in [4, 6, 8, 10, 20] {
            let (mut scene, mut used) = (Scene::new(), 0);
            for step in 0..4000 {
                scene.go(1, if step % every == 0 { 25.0 } else { 0.5 }, 5.0);
                used += u32::from(scene.contest.earned());
            }
            assert!(used < 100, "every {every}: used in {used} of 4000 steps");
        }
    }

    #[test]
    fn long_good_use_forgives() {
        let mut scene = Scene::new();
        scene.until(true, 1.0, 5.0);
        for _ in 0..3 {
            scene.until(false, 100.0, 5.0);
            scene.until(true, 1.0, 5.0);
        }
        scene.go(3 * FORGIVEN as usize + 30, 1.0, 5.0);
        scene.until(false, 100.0, 5.0);
        let wait = scene.until(true, 1.0, 5.0);
        assert!(wait < 200, "{wait}");
    }

    /// A pause makes neither the spread small nor the next error large.
    #[test]
    fn a_resting_pen_tells_nothing() {
        let mut scene = Scene::new();
        scene.until(true, 1.0, 5.0);
        let rest = |scene: &mut Scene, steps: usize, error: f64| {
            for _ in 0..steps {
                let base = Scene::at(scene.step);
                scene.contest.judge(base, UNIT_M, 4, 20, true);
                let near = [base[0] + error * UNIT_M, base[1]];
                scene.contest.record(Some(Pair {
                    base,
                    external: Some([near; LEADS]),
                    fallback: [base; LEADS],
                }));
            }
        };
        // What was predicted before the pause is judged by it.
        rest(&mut scene, LEADS, 0.2);
        let before = scene.contest.clone();
        rest(&mut scene, 3000, 0.2);
        assert_eq!((scene.contest.evidence(), scene.contest.spreads), (before.evidence(), before.spreads));
        // Neither does a wait pass in it, nor is a loss forgiven.
        scene.until(false, 100.0, 5.0);
        let before = scene.contest.clone();
        assert!(before.wait > 90 && before.losses == 1, "{} {}", before.wait, before.losses);
        rest(&mut scene, LEADS, 0.2);
        let before = scene.contest.clone();
        // Not even for who predicts motion, which is wrong all the same.
        for error in [0.2, 1.5] {
            rest(&mut scene, FORGIVEN as usize + 10, error);
            let now = &scene.contest;
            assert_eq!((now.wait, now.used, now.losses), (before.wait, before.used, before.losses));
            assert_eq!(now.spreads, before.spreads);
        }
        scene.until(true, 1.0, 5.0);
        rest(&mut scene, LEADS, 0.2);
        let evidence = scene.contest.evidence();
        rest(&mut scene, 100, 1.5);
        assert!(scene.contest.evidence() < evidence, "{evidence}");
    }

    /// Who was good has to prove it again after a silence, in which the fallback may have learned the hand.
    #[test]
    fn silence_ends_what_was_earned_and_the_fallback_is_known_all_the_same() {
        let mut scene = Scene::new();
        scene.until(true, 1.0, 50.0);
        scene.go(300, 1.0, 50.0);
        let unsure = scene.contest.doubt(8);
        assert!((40.0..60.0).contains(&unsure), "{unsure}");
        let silent = |scene: &mut Scene, steps: usize| {
            for _ in 0..steps {
                scene.step += 1;
                scene.contest.judge(Scene::at(scene.step), UNIT_M, 4, 20, false);
                let at = |index: usize| Scene::at(scene.step + 1 + index as u32);
                let fallback = std::array::from_fn(|index| [at(index)[0], at(index)[1] + 0.5 * UNIT_M]);
                let pair = Pair { base: Scene::at(scene.step), external: None, fallback };
                scene.contest.record(Some(pair));
            }
        };
        silent(&mut scene, SILENT as usize - 1);
        assert!(scene.contest.earned());
        silent(&mut scene, 400);
        assert!(!scene.contest.earned() && scene.contest.evidence() == 0.0 && scene.contest.losses == 0);
        assert!(scene.contest.doubt(8) < 0.6, "{}", scene.contest.doubt(8));
        // As good as the fallback was then is not good enough now.
        scene.go(2000, 5.0, 0.5);
        assert!(!scene.contest.earned());
    }

    #[test]
    fn previews_that_came_with_gaps_are_judged_at_their_own_lead() {
        let (mut contest, right) = (Contest::default(), [0.002, 0.0]);
        let mut changed = Vec::new();
        // One pair only, of which the external one is right everywhere.
        contest.record(Some(Pair {
            base: [0.0; 2],
            external: Some([right; LEADS]),
            fallback: [[0.0; 2]; LEADS],
        }));
        for step in 1..=LEADS {
            let before = contest.evidence();
            contest.judge(right, UNIT_M, 4, 20, false);
            if contest.evidence() != before {
                changed.push(step);
            }
            contest.record(None);
        }
        assert!(changed.iter().all(|step| (4..=20).contains(step)) && changed.contains(&4), "{changed:?}");
        contest.record(Some(Pair {
            base: [0.0; 2],
            external: Some([[0.0; 2]; LEADS]),
            fallback: [right; LEADS],
        }));
        contest.interrupt();
        let before = contest.evidence();
        (0..LEADS).for_each(|_| contest.judge(right, UNIT_M, 4, 20, false));
        assert_eq!(contest.evidence(), before, "what waited is not judged after a new beginning");
    }
}
