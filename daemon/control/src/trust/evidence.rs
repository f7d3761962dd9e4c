//! Evidence: what past previews of the active predictor were worth, per lead, and what a newer sample says about the newest.
//!
//! Contract: fixed size, no allocation, total. Once per closed grid step every waiting preview is compared with where the
//! pen really is. From that follow, per lead j (steps after the newest grid point of the preview):
//!
//! - *innovation gain* G: between two grid points newer samples arrive. With e = newest sample − preview at its instant, the
//!   preview at lead j moves by G_j e. G is the regression of the preview's error at j on e, learned while the pen moves,
//!   from a prior. Without it up to a whole step of what is known about the pen would lie idle.
//! - *share* w in [0, 1]: trust per step. The regression of the pen's real way since its newest sample on the predicted way:
//!   a predictor that overshoots at lead 12 is believed there only as far as it pays, and fully at lead 2. The scalar α of
//!   the paper stays above it.
//! - *mean squared errors* of the preview as it would be used, of Hold, and of constant velocity: the evidence for α.
//!
//! Lengths are divided by the running scale (a typical step is about 10), so one bad stretch counts as much as it lasted,
//! whatever the size of the writing.

/// Leads with evidence of their own [steps]; farther ahead the last one counts.
pub const EVIDENCE_LEADS: usize = 24;
/// Parts of a grid step that have innovation gains of their own: devices sample where they like.
const PHASES: usize = 4;
/// Factor by which the past loses weight per judged case: about 500 steps of motion.
const FORGETTING: f64 = 0.998;
/// Weight of the priors [normalised²]: some ten cases of ordinary motion.
const PRIOR: f64 = 2000.0;
/// Weight of the prior gain [normalised²].
const PRIOR_GAIN: f64 = 300.0;
/// Errors beyond this [normalised] are leaps, which no preview foresees.
const LARGEST: f64 = 400.0;
/// The pen moved less than this [normalised] and was not thought to move: says nothing.
const REST: f64 = 0.3;

/// One preview that waits for what it foresaw.
#[derive(Debug, Clone, Copy)]
struct Shot {
    /// Grid steps closed since.
    age: usize,
    /// Newest sample before the next grid point closed [m], and where in the step it lay.
    newest: [f64; 2],
    phase: f64,
    /// Innovation of that sample [m].
    innovation: [f64; 2],
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
        innovation: [0.0; 2],
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
    /// Newest first.
    shots: [Shot; EVIDENCE_LEADS],
    waiting: usize,
    leads: [Lead; EVIDENCE_LEADS],
    /// ⟨innovation, preview's error⟩ and ⟨innovation, innovation⟩.
    gains: [[[f64; 2]; EVIDENCE_LEADS]; PHASES],
    prior: [[f64; EVIDENCE_LEADS]; PHASES],
    /// Gains and shares are used; if not, previews are judged as they are.
    per_step: bool,
}

impl Evidence {
    /// Nothing seen yet. `per_step`: previews are used, and therefore judged, with gains and shares.
    #[must_use]
    pub fn new(per_step: bool) -> Self {
        let mut prior = [[0.0; EVIDENCE_LEADS]; PHASES];
        for (bucket, row) in prior.iter_mut().enumerate() {
            let phase = (bucket as f64 + 0.5) / PHASES as f64;
            for (lead, gain) in (1..).zip(row) {
                *gain = prior_gain(phase, f64::from(lead));
            }
        }
        Self {
            shots: [Shot::EMPTY; EVIDENCE_LEADS],
            waiting: 0,
            leads: [Lead::default(); EVIDENCE_LEADS],
            gains: [[[0.0; 2]; EVIDENCE_LEADS]; PHASES],
            prior,
            per_step,
        }
    }

    /// Another predictor answers from here on: what was learned about the last one goes.
    pub fn forget(&mut self) {
        self.waiting = 0;
        self.leads = [Lead::default(); EVIDENCE_LEADS];
        self.gains = [[[0.0; 2]; EVIDENCE_LEADS]; PHASES];
    }

    /// The pen was elsewhere at once: previews that wait foresaw nothing of it.
    pub fn interrupt(&mut self) {
        self.waiting = 0;
    }

    /// A grid step closed at `position` [m] after ordinary motion: judges every preview that waits. `unit_m`: metres per
    /// normalised unit.
    pub fn realise(&mut self, position: [f64; 2], unit_m: f64) {
        if !(unit_m > 0.0) {
            return;
        }
        for index in 0..self.waiting {
            let Some(shot) = self.shots.get_mut(index) else { break };
            let age = shot.age;
            shot.age += 1;
            let shot = *shot;
            let Some(predicted) = shot.path.get(age) else { continue };
            let scaled = |to: [f64; 2], from: [f64; 2]| {
                let ([to_x, to_y], [x, y]) = (to, from);
                [(to_x - x) / unit_m, (to_y - y) / unit_m]
            };
            let gain = self.gain_at(shot.phase, age);
            let [ex, ey] = shot.innovation.map(|e| e / unit_m);
            let [rx, ry] = scaled(position, *predicted);
            let [yx, yy] = scaled(position, shot.newest);
            let (corrected_x, corrected_y) = (rx - gain * ex, ry - gain * ey);
            let (dx, dy) = (yx - corrected_x, yy - corrected_y);
            // What is not a number is not ordinary either.
            let ordinary = [rx, ry, yx, yy, dx, dy, ex, ey].into_iter().all(|v| v.abs() <= LARGEST);
            if !ordinary || [yx, yy, dx, dy].into_iter().all(|v| v.abs() < REST) {
                continue;
            }
            let share = self.share(age + 1);
            let ahead = (age + 1) as f64 - shot.phase;
            let [vx, vy] = shot.velocity.map(|v| v / unit_m * ahead);
            let square = |x: f64, y: f64| x * x + y * y;
            if let Some(lead) = self.leads.get_mut(age) {
                let keep = |sum: &mut f64, value: f64| *sum = FORGETTING * *sum + value;
                keep(&mut lead.preview, square(yx - share * dx, yy - share * dy));
                keep(&mut lead.hold, square(yx, yy));
                // Nobody bounded the velocity; a minimum with a number is a number.
                keep(&mut lead.steady, square(yx - vx, yy - vy).min(2.0 * LARGEST * LARGEST));
                keep(&mut lead.along, yx * dx + yy * dy);
                keep(&mut lead.way, square(dx, dy));
                keep(&mut lead.cases, 1.0);
            }
            if let Some([cross, power]) = bucket_mut(&mut self.gains, shot.phase, age) {
                *cross = FORGETTING * *cross + ex * rx + ey * ry;
                *power = FORGETTING * *power + square(ex, ey);
            }
        }
    }

    /// A new preview: `path` [m] after the grid point at `base` [m], which was reached by `velocity` [m per step].
    pub fn shoot(&mut self, base: [f64; 2], velocity: [f64; 2], path: &[[f64; 2]]) {
        self.shots.rotate_right(1);
        let Some(shot) = self.shots.first_mut() else { return };
        *shot = Shot { newest: base, velocity, ..Shot::EMPTY };
        let mut last = base;
        let mut given = path.iter();
        for slot in &mut shot.path {
            last = given.next().copied().unwrap_or(last);
            *slot = last;
        }
        self.waiting = (self.waiting + 1).min(EVIDENCE_LEADS);
    }

    /// A sample at `position` [m], `phase` of a step after the newest grid point; returns its innovation [m].
    pub fn sample(&mut self, position: [f64; 2], phase: f64, expected: [f64; 2]) -> [f64; 2] {
        let ([x, y], [ex, ey]) = (position, expected);
        let innovation = [x - ex, y - ey];
        let usable = self.waiting > 0 && phase.is_finite();
        if let Some(shot) = self.shots.first_mut().filter(|_| usable) {
            (shot.newest, shot.phase, shot.innovation) = (position, phase.clamp(0.0, 1.0), innovation);
        }
        innovation
    }

    /// G at `lead` ≥ 1 steps for a sample at `phase` of a step.
    #[must_use]
    pub fn gain(&self, phase: f64, lead: usize) -> f64 {
        self.gain_at(phase, lead.saturating_sub(1).min(EVIDENCE_LEADS - 1))
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

    fn gain_at(&self, phase: f64, index: usize) -> f64 {
        if !self.per_step {
            return 0.0;
        }
        let bucket = bucket_of(phase);
        let prior = self.prior.get(bucket).and_then(|row| row.get(index)).copied().unwrap_or(0.0);
        let [cross, power] =
            self.gains.get(bucket).and_then(|row| row.get(index)).copied().unwrap_or_default();
        ((cross + PRIOR_GAIN * prior) / (power + PRIOR_GAIN)).clamp(0.0, 8.0)
    }
}

fn bucket_of(phase: f64) -> usize {
    ((phase * PHASES as f64) as usize).min(PHASES - 1)
}

fn bucket_mut(
    gains: &mut [[[f64; 2]; EVIDENCE_LEADS]; PHASES],
    phase: f64,
    index: usize,
) -> Option<&mut [f64; 2]> {
    gains.get_mut(bucket_of(phase))?.get_mut(index)
}

/// An innovation is mostly a change of velocity that fades over six steps; measured on UNIPEN train writers at half a step.
fn prior_gain(phase: f64, lead: f64) -> f64 {
    const FADE: f64 = 6.0;
    let growth = 0.75 * (2.0 * phase).min(1.0);
    0.85 + growth * FADE * (1.0 - (-(lead - phase) / FADE).exp())
}
