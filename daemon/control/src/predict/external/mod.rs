//! `external`: the predictor of another process, with a built-in one that stands in for it.
//!
//! Contract: fixed size, no allocation, total. A preview is checked once, when it comes; what fails is
//! refused with its reason and changes nothing. Both previews are blended,
//!
//! p = p_fallback + w · (p_external − p_fallback),
//!
//! where the difference is at most `DOUBT` times the recent error of the fallback at its lead: what another
//! process says is bounded by what the fallback may be wrong by. A hand that the fallback foresees leaves a
//! lie no room, one that nothing foresees leaves the truth enough. w rises and falls by a fixed amount per
//! grid step, so that neither a loss nor a return moves the reference at once; only what nothing before
//! belongs to ends it at once: a jump, a new stroke, another process. It rises only while previews come in
//! time and the [`Contest`] says that they are better than the fallback's. Trust, shares and corrections
//! judge each of the two, and what both come to is blended.

mod contest;
mod preview;

use super::bands::BAND_LEADS;
use super::{Entry, LearnStep, MAX_PREVIEW, RollOut};
use crate::pen::Motion;
use crate::state::state;
pub use contest::Contest;
use contest::Pair;
pub use preview::{ExternalPreview, PreviewRefusal};

pub(super) const ENTRY: Entry = Entry::external(
    "external",
    "that of another process, which has to earn its part; predictor.external.fallback stands in for it",
);

/// Rise of w per step: as fast as trust.
const RISE: f64 = 0.1;
/// Its fall per step.
const FALL: f64 = 0.2;
/// Largest difference to the fallback, in rms of its recent errors: of errors in two axes, one in fifty is
/// larger.
const DOUBT: f64 = 2.0;
/// Grid steps whose positions are kept, and the most that a preview may be late.
pub const MOST_LATE: u32 = 8;
/// Displacements longer than this multiple of the bound on the built-in predictors' are refused; shorter ones
/// are shortened to the bound, as theirs are.
const WILD: f64 = 4.0;

/// What became of the other process's previews.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExternalReport {
    /// w, its part in the preview in force, from 0 to 1.
    pub weight: f64,
    /// The evidence for it against the fallback, from -10 to 10.
    pub evidence: f64,
    /// Grid steps since its newest usable preview's base; `None`: there is none.
    pub age: Option<u32>,
    /// What became of the preview that came in this tick; `None`: none came.
    pub verdict: Option<Result<(), PreviewRefusal>>,
}

/// What a plan looks at of a preview \[steps after the newest closed one\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanLeads {
    /// Of its first reference.
    pub nearest: usize,
    /// Of its last reference, while the pen's samples come in time.
    pub last: usize,
    /// As far as a preview has to reach: a plan without new samples looks farther.
    pub farthest: usize,
}

state! { whole [] PlanLeads { nearest, last, farthest } }

/// The newest preview of the other process, and what it is worth.
#[derive(Debug, Clone)]
pub(super) struct External {
    /// Most steps by which a preview may be late.
    most_late: u32,
    /// Steps of the newest preview, from its base on \[m\]; `count` of them.
    moves: [[f64; 2]; MAX_PREVIEW],
    radii: [f64; MAX_PREVIEW],
    radii_count: usize,
    count: usize,
    /// Its base; `None`: there is no preview.
    base: Option<u64>,
    /// The process that made it, or the one before it.
    sender: u64,
    /// The newest closed steps' positions \[m\], from `first` on; a ring by index.
    positions: [[f64; 2]; MOST_LATE as usize + 1],
    /// The first step of this stroke, and the newest.
    first: u64,
    newest: Option<u64>,
    /// The fallback's preview after the newest step, without its start \[m\].
    fallback: [[f64; 2]; MAX_PREVIEW],
    /// How many of it count, and how it was made; `None`: it is not that of the newest step.
    made: Option<(usize, RollOut)>,
    /// The preview as it may be followed: carried on from the newest step, near the fallback's \[m\].
    bounded: [[f64; 2]; MAX_PREVIEW],
    /// The newest step had a preview: what is in force is what is judged, so it gets no other.
    answered: bool,
    /// What plans looked at when it was made.
    leads: PlanLeads,
    /// Metres per normalised unit at the newest step.
    unit_m: f64,
    weight: f64,
    contest: Contest,
}

state! {
    [] External {
        moves, radii, radii_count, count, base, sender, positions, first, newest, fallback, made, bounded,
        answered, leads, unit_m, weight, contest,
    }
    fixed { most_late }
}

impl External {
    pub(super) fn new(most_late: u32) -> Self {
        Self {
            most_late: most_late.min(MOST_LATE),
            moves: [[0.0; 2]; MAX_PREVIEW],
            radii: [0.0; MAX_PREVIEW],
            radii_count: 0,
            count: 0,
            base: None,
            sender: 0,
            positions: [[0.0; 2]; MOST_LATE as usize + 1],
            first: 0,
            newest: None,
            fallback: [[0.0; 2]; MAX_PREVIEW],
            made: None,
            bounded: [[0.0; 2]; MAX_PREVIEW],
            answered: false,
            leads: PlanLeads { nearest: 1, last: BAND_LEADS, farthest: BAND_LEADS },
            unit_m: 0.0,
            weight: 0.0,
            contest: Contest::default(),
        }
    }

    /// A step closed while this predictor is chosen.
    pub(super) fn observe(&mut self, step: &LearnStep) {
        // In the step that ends here.
        let in_time = self.in_time();
        if step.motion == Motion::Continues {
            self.contest.record(self.pair());
            let PlanLeads { nearest, last, .. } = self.leads;
            self.contest.judge(step.position, step.scale_m, nearest, last, self.weight > 0.0);
        } else {
            self.contest.interrupt();
            (self.base, self.weight) = (None, 0.0);
        }
        // Nothing before its beginning, or before it was chosen, is known here.
        if step.motion != Motion::Continues || self.newest.is_none() {
            self.first = step.index;
        }
        if let Some(slot) = self.positions.get_mut(place(step.index)) {
            *slot = step.position;
        }
        self.newest = Some(step.index);
        (self.made, self.answered, self.unit_m) = (None, false, step.scale_m);
        let wanted = self.contest.earned() && in_time && self.base.is_some();
        self.weight = (self.weight + if wanted { RISE } else { -FALL }).clamp(0.0, 1.0);
    }

    /// Takes over what another process predicted for a plan that looks at `leads`, unless something speaks
    /// against it. `limit_m`: bound on a displacement \[m\].
    pub(super) fn take(
        &mut self,
        preview: &ExternalPreview,
        leads: PlanLeads,
        limit_m: f64,
    ) -> Result<(), PreviewRefusal> {
        let ExternalPreview { base_index, count, radii_count, sender, .. } = *preview;
        if sender != self.sender {
            self.contest.begin_anew();
            (self.sender, self.base, self.weight, self.answered) = (sender, None, 0.0, false);
        }
        let positions = preview.positions();
        if positions.is_empty() || positions.len() != count {
            return Err(PreviewRefusal::Malformed);
        }
        if preview.radii().len() != radii_count || ![0, count].contains(&radii_count) {
            return Err(PreviewRefusal::Malformed);
        }
        if !preview.radii().iter().all(|radius| radius.is_finite() && *radius >= 0.0)
            || !positions.iter().flatten().all(|x| x.is_finite())
        {
            return Err(PreviewRefusal::NonFinite);
        }
        let Some(age) = self.newest.and_then(|newest| newest.checked_sub(base_index)) else {
            return Err(PreviewRefusal::Ahead);
        };
        if age > u64::from(self.most_late) {
            return Err(PreviewRefusal::Late);
        }
        if base_index < self.first {
            return Err(PreviewRefusal::OtherStroke);
        }
        if self.answered || self.base.is_some_and(|before| base_index <= before) {
            return Err(PreviewRefusal::Repeated);
        }
        // Of a late one the first positions are past.
        if count < leads.farthest.saturating_add(age as usize).min(MAX_PREVIEW) {
            return Err(PreviewRefusal::Malformed);
        }
        let from = self.positions.get(place(base_index)).copied().unwrap_or_default();
        if moves_of(from, positions).any(|[dx, dy]| !(dx.hypot(dy) <= WILD * limit_m)) {
            return Err(PreviewRefusal::Wild);
        }
        for (slot, step) in self.moves.iter_mut().zip(moves_of(from, positions)) {
            *slot = super::shortened(step, limit_m);
        }
        (self.base, self.count, self.answered) = (Some(base_index), count, true);
        (self.radii, self.radii_count) = (preview.radii, radii_count);
        Ok(())
    }

    /// The fallback's `positions` after the newest step, made by `roll_out` for a plan that looks at `leads`.
    pub(super) fn stand_in(&mut self, positions: &[[f64; 2]], roll_out: RollOut, leads: PlanLeads) {
        for (slot, position) in self.fallback.iter_mut().zip(positions) {
            *slot = *position;
        }
        (self.made, self.leads) = (Some((positions.len().min(MAX_PREVIEW), roll_out)), leads);
    }

    /// The fallback's preview and how it was made, if it was after the newest step.
    pub(super) fn fallback(&self) -> Option<(&[[f64; 2]], RollOut)> {
        let (count, roll_out) = self.made?;
        Some((self.fallback.get(..count)?, roll_out))
    }

    /// Carries the other process's preview on from the newest step, as far from the fallback's as doubt about
    /// that allows.
    pub(super) fn carry_on(&mut self) {
        let Some((fallback, _)) = self.fallback() else { return };
        let mut bounded = [[0.0; 2]; MAX_PREVIEW];
        if let Some(ahead) = self.ahead() {
            for ((lead, slot), ([x, y], [ex, ey])) in (1..).zip(&mut bounded).zip(fallback.iter().zip(ahead))
            {
                let most = DOUBT * self.contest.doubt(lead) * self.unit_m;
                let [dx, dy] = super::shortened([ex - x, ey - y], most);
                *slot = [x + dx, y + dy];
            }
        }
        self.bounded = bounded;
    }

    /// What was carried on \[m\], the first position one step after the newest; `None`: there is nothing.
    pub(super) fn bounded(&self) -> Option<&[[f64; 2]]> {
        self.age()?;
        self.bounded.get(..self.made?.0)
    }

    /// w, while there is something of it to be followed.
    pub(super) fn part(&self) -> f64 {
        if self.age().is_some() { self.weight } else { 0.0 }
    }

    /// Radius \[m\] in which it expects the pen `lead` steps after the newest step, where it says so.
    pub(super) fn radius(&self, lead: f64) -> Option<f64> {
        let at = lead + f64::from(self.age()?);
        if !(at >= 1.0) {
            return None;
        }
        let radii = self.radii.get(..self.radii_count)?;
        let (below, part) = (at.floor() as usize, at - at.floor());
        let (near, far) = (*radii.get(below - 1)?, radii.get(below).copied());
        Some(if part > 0.0 { near + part * (far? - near) } else { near })
    }

    /// The process that predicts, or did last.
    pub(super) const fn sender(&self) -> u64 {
        self.sender
    }

    /// What became of its previews.
    pub(super) fn report(&self, verdict: Option<Result<(), PreviewRefusal>>) -> ExternalReport {
        ExternalReport { weight: self.weight, evidence: self.contest.evidence(), age: self.age(), verdict }
    }

    /// Steps that closed since the base of its preview; `None`: there is none, or it is too old to be carried
    /// on.
    fn age(&self) -> Option<u32> {
        let age = u32::try_from(self.newest?.checked_sub(self.base?)?).ok()?;
        ((age as usize) < self.count).then_some(age)
    }

    /// Its positions after the newest step \[m\]: as far as they go, then the last again.
    fn ahead(&self) -> Option<impl Iterator<Item = [f64; 2]>> {
        let age = self.age()? as usize;
        let mut at = self.positions.get(place(self.newest?)).copied()?;
        let rest = self.moves.get(age..self.count)?.iter().copied();
        Some(rest.chain(std::iter::repeat([0.0; 2])).map(move |[dx, dy]| {
            at = [at[0] + dx, at[1] + dy];
            at
        }))
    }

    /// It has a preview that came in time.
    pub(super) fn in_time(&self) -> bool {
        self.age().is_some_and(|age| age <= self.most_late)
    }

    /// What both predicted after the newest step, the other process where it did in time.
    fn pair(&self) -> Option<Pair> {
        let (fallback, _) = self.fallback()?;
        let base = self.positions.get(place(self.newest?)).copied()?;
        let last = fallback.last().copied()?;
        let mut pair = Pair { base, external: None, fallback: [last; BAND_LEADS] };
        for (slot, position) in pair.fallback.iter_mut().zip(fallback) {
            *slot = *position;
        }
        if let Some(ahead) = self.ahead().filter(|_| self.in_time()) {
            let external = pair.external.insert([base; BAND_LEADS]);
            external.iter_mut().zip(ahead).for_each(|(slot, position)| *slot = position);
        }
        Some(pair)
    }
}

/// Where the position of step `index` is kept.
const fn place(index: u64) -> usize {
    (index % (MOST_LATE as u64 + 1)) as usize
}

/// The displacements along `positions`, the first from `from`.
fn moves_of(from: [f64; 2], positions: &[[f64; 2]]) -> impl Iterator<Item = [f64; 2]> {
    let mut last = from;
    positions.iter().map(move |[x, y]| {
        let step = [x - last[0], y - last[1]];
        last = [*x, *y];
        step
    })
}
