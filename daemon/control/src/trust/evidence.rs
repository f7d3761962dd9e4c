//! Evidence: what past previews of the active predictor were worth, per lead, and what a newer sample says about the newest.
//!
//! Contract: fixed size, no allocation, total. Once per closed grid step every waiting preview is compared with where the
//! pen really is. From that follow, per lead j (steps after the newest grid point of the preview):
//!
//! - *correction*: between two grid points newer samples arrive. What they say about the preview at lead j is learned while
//!   the pen moves, from a prior (`blend`): without it up to a whole step of what is known about the pen would lie idle.
//!   A preview that is right without is not corrected: what past corrections were worth counts as well.
//! - *share* w in [0, 1]: trust per step. The regression of the pen's real way since its newest sample on the predicted way:
//!   a predictor that overshoots at lead 12 is believed there only as far as it pays, and fully at lead 2. The scalar α of
//!   the paper stays above it.
//! - *mean squared errors* of the preview as it would be used, of Hold, and of constant velocity: the evidence for α.
//!
//! Lengths are divided by the running scale (a typical step is about 10), so one bad stretch counts as much as it lasted,
//! whatever the size of the writing.

use super::blend::{Blend, Terms};
use super::observer::Observer;
use crate::units::Stamp;

/// Leads with evidence of their own [steps]; farther ahead the last one counts.
pub const EVIDENCE_LEADS: usize = 24;
/// Parts of a grid step that have corrections of their own: devices sample where they like.
const PHASES: usize = 4;
/// Factor by which the past loses weight per judged case: about 500 steps of motion.
const FORGETTING: f64 = 0.998;
/// Weight of the priors [normalised²]: some ten cases of ordinary motion.
const PRIOR: f64 = 2000.0;
/// Weight of the prior that corrections are worth what they say [normalised²].
const PRIOR_WORTH: f64 = 100.0;
/// Ways and errors beyond this [normalised, per step ahead] are leaps, which no preview foresees.
const LARGEST_PER_STEP: f64 = 100.0;
/// News beyond this [normalised] tells of a leap, and nothing of where the pen goes next.
const LARGEST_NEWS: f64 = 150.0;
/// Cases of ordinary motion that the record begins with, and the preview's squared error in them relative to Hold's.
const HEAD_START: f64 = 20.0;
const HEAD_START_ERROR: f64 = 0.7;
/// The pen moved less than this [normalised] and was not thought to move: says nothing.
const REST: f64 = 0.3;

/// What the newest sample says beyond its position.
#[derive(Debug, Clone, Copy, PartialEq)]
struct News {
    /// Sample − preview at its instant [m].
    innovation: [f64; 2],
    /// Velocity [m/step] and acceleration [m/step²] of the pen.
    velocity: [f64; 2],
    acceleration: [f64; 2],
}

impl News {
    /// Neither a leap nor what a filter makes of one, nor no number; `unit_m`: metres per normalised unit.
    fn is_ordinary(&self, unit_m: f64) -> bool {
        let said = self.innovation.iter().chain(&self.velocity).chain(&self.acceleration);
        said.into_iter().all(|v| v.abs() <= LARGEST_NEWS * unit_m)
    }

    /// The terms of a correction for `left` [m] of predicted way.
    fn terms(&self, left: [f64; 2]) -> Terms {
        [left, self.innovation, self.velocity, self.acceleration]
    }
}

/// One preview that waits for what it foresaw.
#[derive(Debug, Clone, Copy)]
struct Shot {
    /// Grid steps closed since.
    age: usize,
    /// Newest sample before the next grid point closed [m], and where in the step it lay.
    newest: [f64; 2],
    phase: f64,
    news: Option<News>,
    /// Displacement before the preview [m]: what constant velocity goes on with.
    velocity: [f64; 2],
    /// Predicted positions [m].
    path: [[f64; 2]; EVIDENCE_LEADS],
}

impl Shot {
    const EMPTY: Self = Self {
        age: 0,
        newest: [0.0; 2],
        phase: 0.0,
        news: None,
        velocity: [0.0; 2],
        path: [[0.0; 2]; EVIDENCE_LEADS],
    };
}

/// What is known about one lead; sums forget.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Lead {
    /// Squared errors [normalised²].
    preview: f64,
    hold: f64,
    steady: f64,
    /// ⟨real way, predicted way⟩ and ⟨predicted way, predicted way⟩.
    along: f64,
    way: f64,
    /// ⟨preview's error, correction⟩ and ⟨correction, correction⟩.
    worth: f64,
    corrected: f64,
    cases: f64,
}

/// Squared errors over the leads that a plan looks at [normalised²], and from how many cases.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Record {
    /// Of the preview, as it would be used.
    pub preview: f64,
    /// Of Hold.
    pub hold: f64,
    /// Of constant velocity.
    pub steady: f64,
    /// Cases of motion per lead.
    pub cases: f64,
}

/// See the module's description.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// A ring; `last` is where the newest is, `waiting` how many there are.
    shots: [Shot; EVIDENCE_LEADS],
    last: usize,
    waiting: usize,
    leads: [Lead; EVIDENCE_LEADS],
    corrections: [[Blend; EVIDENCE_LEADS]; PHASES],
    observer: Observer,
    /// Newest sample [m] and what it says.
    newest: [f64; 2],
    news: Option<News>,
    /// Metres per normalised unit, the newest that was told; 0 before.
    unit_m: f64,
    step_s: f64,
    /// Corrections and shares are used; if not, previews are judged as they are.
    per_step: bool,
}

impl Evidence {
    /// Nothing seen yet; grid step `step_s` [s]. `per_step`: previews are used, and therefore judged, with corrections and
    /// shares.
    #[must_use]
    pub fn new(step_s: f64, per_step: bool) -> Self {
        Self {
            shots: [Shot::EMPTY; EVIDENCE_LEADS],
            last: 0,
            waiting: 0,
            leads: untried(),
            corrections: fresh(),
            observer: Observer::NEW,
            newest: [0.0; 2],
            news: None,
            unit_m: 0.0,
            step_s,
            per_step,
        }
    }

    /// Another predictor answers from here on: what was learned about the last one goes.
    pub fn forget(&mut self) {
        self.waiting = 0;
        self.leads = untried();
        self.corrections = fresh();
    }

    /// The pen was elsewhere at once: previews that wait foresaw nothing of it.
    pub fn interrupt(&mut self) {
        self.waiting = 0;
        self.news = None;
        self.observer.forget();
    }

    /// A grid step closed at `position` [m] after ordinary motion: judges every preview that waits. `unit_m`: metres per
    /// normalised unit.
    pub fn realise(&mut self, position: [f64; 2], unit_m: f64) {
        if !(unit_m > 0.0) {
            return;
        }
        self.unit_m = unit_m;
        for index in 0..self.waiting {
            let at = (self.last + EVIDENCE_LEADS - index) % EVIDENCE_LEADS;
            let Some(shot) = self.shots.get_mut(at) else { break };
            let age = shot.age;
            shot.age += 1;
            let shot = *shot;
            let Some(predicted) = shot.path.get(age) else { continue };
            let ahead = (age + 1) as f64 - shot.phase;
            let left = from(*predicted, shot.newest);
            let news = shot.news.filter(|news| news.is_ordinary(unit_m));
            if shot.news.is_some() && news.is_none() {
                continue;
            }
            let terms = news.map(|news| news.terms(left).map(|term| term.map(|v| v / unit_m)));
            let [ax, ay] = self.correction_at(shot.phase, age, terms.as_ref());
            let worth = self.worth(age);
            let (cx, cy) = (worth * ax, worth * ay);
            let [rx, ry] = from(position, *predicted).map(|v| v / unit_m);
            let [yx, yy] = from(position, shot.newest).map(|v| v / unit_m);
            let (dx, dy) = (yx - (rx - cx), yy - (ry - cy));
            // What is not a number is not ordinary either.
            let most = LARGEST_PER_STEP * (ahead + 0.5);
            let ordinary = [rx, ry, yx, yy, dx, dy]
                .iter()
                .chain(terms.iter().flatten().flatten())
                .all(|v| v.abs() <= most);
            if !ordinary || [yx, yy, dx, dy].into_iter().all(|v| v.abs() < REST) {
                continue;
            }
            let share = self.share(age + 1);
            let [vx, vy] = shot.velocity.map(|v| v / unit_m * ahead);
            let square = |x: f64, y: f64| x * x + y * y;
            if let Some(lead) = self.leads.get_mut(age) {
                let keep = |sum: &mut f64, value: f64| *sum = FORGETTING * *sum + value;
                keep(&mut lead.preview, square(yx - share * dx, yy - share * dy));
                keep(&mut lead.hold, square(yx, yy));
                // Nobody bounded the velocity; a minimum with a number is a number.
                keep(&mut lead.steady, square(yx - vx, yy - vy).min(2.0 * most * most));
                keep(&mut lead.along, yx * dx + yy * dy);
                keep(&mut lead.way, square(dx, dy));
                keep(&mut lead.worth, ax * rx + ay * ry);
                keep(&mut lead.corrected, square(ax, ay));
                keep(&mut lead.cases, 1.0);
            }
            let blend = bucket_mut(&mut self.corrections, shot.phase, age);
            if let (Some(blend), Some(terms)) = (blend, terms) {
                blend.learn(&terms, [rx, ry], ahead);
            }
        }
    }

    /// A new preview: `path` [m] after the grid point at `base` [m], which was reached by `velocity` [m per step].
    pub fn shoot(&mut self, base: [f64; 2], velocity: [f64; 2], path: &[[f64; 2]]) {
        self.last = (self.last + 1) % EVIDENCE_LEADS;
        let Some(shot) = self.shots.get_mut(self.last) else { return };
        *shot = Shot { newest: base, velocity, ..Shot::EMPTY };
        let mut last = base;
        let mut given = path.iter();
        for slot in &mut shot.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
        self.waiting = (self.waiting + 1).min(EVIDENCE_LEADS);
    }

    /// A sample at `stamp` and `position` [m], `phase` of a step after the newest grid point, where the preview had `expected`.
    /// The same sample may be told again.
    pub fn sample(&mut self, stamp: Stamp, position: [f64; 2], phase: f64, expected: [f64; 2]) {
        self.observer.see(stamp.0 as f64 * 1e-9, position);
        let [velocity, acceleration] = self.observer.motion();
        self.newest = position;
        self.news = Some(News {
            innovation: from(position, expected),
            velocity: velocity.map(|v| v * self.step_s),
            acceleration: acceleration.map(|a| a * self.step_s * self.step_s),
        });
        // Previews that are taken as they are know of nothing newer than their base, and neither may their yardsticks.
        let usable = self.waiting > 0 && phase.is_finite() && self.per_step;
        if let Some(shot) = self.shots.get_mut(self.last).filter(|_| usable) {
            (shot.newest, shot.phase, shot.news) = (position, phase.clamp(0.0, 1.0), self.news);
        }
    }

    /// Where the preview that had `predicted` [m] at `lead` ≥ 1 steps is believed to be, after the newest sample at `phase`:
    /// where that sample is, if it leapt.
    #[must_use]
    pub fn believed(&self, phase: f64, lead: usize, predicted: [f64; 2]) -> [f64; 2] {
        let left = from(predicted, self.newest);
        if self.per_step && self.unit_m > 0.0 && self.news.is_some_and(|news| !news.is_ordinary(self.unit_m))
        {
            return self.newest;
        }
        let terms = self.news.map(|news| news.terms(left));
        let index = lead.saturating_sub(1).min(EVIDENCE_LEADS - 1);
        let [cx, cy] = self.correction_at(phase, index, terms.as_ref());
        let ([lx, ly], [x, y], share, worth) = (left, self.newest, self.share(lead), self.worth(index));
        [x + share * (lx + worth * cx), y + share * (ly + worth * cy)]
    }

    /// w at `lead` ≥ 1 steps.
    #[must_use]
    pub fn share(&self, lead: usize) -> f64 {
        if !self.per_step {
            return 1.0;
        }
        let index = lead.saturating_sub(1).min(EVIDENCE_LEADS - 1);
        self.leads.get(index).map_or(0.0, |lead| ((lead.along + PRIOR) / (lead.way + PRIOR)).clamp(0.0, 1.0))
    }

    /// Sums over the leads `first` to `last` [steps].
    #[must_use]
    pub fn record(&self, first: usize, last: usize) -> Record {
        let first = first.clamp(1, EVIDENCE_LEADS);
        let count = last.clamp(first, EVIDENCE_LEADS) + 1 - first;
        let mut record = Record { cases: f64::INFINITY, ..Record::default() };
        for lead in self.leads.iter().skip(first - 1).take(count) {
            record.preview += lead.preview;
            record.hold += lead.hold;
            record.steady += lead.steady;
            record.cases = record.cases.min(lead.cases);
        }
        record
    }

    /// How much of a correction past ones were worth, in [0, 1]: none to a preview that is right without.
    fn worth(&self, index: usize) -> f64 {
        let worth = |lead: &Lead| (lead.worth + PRIOR_WORTH) / (lead.corrected + PRIOR_WORTH);
        self.leads.get(index).map_or(0.0, |lead| worth(lead).clamp(0.0, 1.0))
    }

    fn correction_at(&self, phase: f64, index: usize, terms: Option<&Terms>) -> [f64; 2] {
        let blend = self.corrections.get(bucket_of(phase)).and_then(|row| row.get(index));
        match (blend, terms) {
            (Some(blend), Some(terms)) if self.per_step => blend.correction(terms),
            _ => [0.0; 2],
        }
    }
}

fn fresh() -> [[Blend; EVIDENCE_LEADS]; PHASES] {
    std::array::from_fn(|bucket| {
        let phase = (bucket as f64 + 0.5) / PHASES as f64;
        std::array::from_fn(|index| Blend::new((index + 1) as f64 - phase))
    })
}

/// Leads before the first case: a few of ordinary motion in which the preview was somewhat better than Hold.
fn untried() -> [Lead; EVIDENCE_LEADS] {
    std::array::from_fn(|index| {
        let way = 10.0 * (index + 1) as f64;
        let hold = HEAD_START * way * way;
        Lead { preview: HEAD_START_ERROR * hold, hold, steady: hold, ..Lead::default() }
    })
}

fn from(there: [f64; 2], here: [f64; 2]) -> [f64; 2] {
    let ([tx, ty], [x, y]) = (there, here);
    [tx - x, ty - y]
}

fn bucket_of(phase: f64) -> usize {
    ((phase * PHASES as f64) as usize).min(PHASES - 1)
}

fn bucket_mut(
    corrections: &mut [[Blend; EVIDENCE_LEADS]; PHASES],
    phase: f64,
    index: usize,
) -> Option<&mut Blend> {
    corrections.get_mut(bucket_of(phase))?.get_mut(index)
}
