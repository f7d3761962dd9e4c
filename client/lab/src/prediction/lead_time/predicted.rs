//! What an entrant predicts of a set, target after target, and how that is scored.

use super::super::Set;
use super::super::model::Contestant;
use super::super::registry::{Model, RegistryError, Setting};
use super::super::run::{take_in, train, with_choice};
use super::LEADS_MS;
use super::bands::Bands;
use super::board::{BoardError, Entrant, Lane, height};
use super::file::BandedPosition;
use super::tally::LaneTally;
use super::targets::{Targets, between};

/// The predictions of one entrant on one set.
#[derive(Debug, Clone, PartialEq)]
pub struct Predicted {
    pub model: String,
    /// Notes for the reader.
    pub note: Option<String>,
    pub answers: LeadAnswers,
}

/// One per target of the sequences that were asked for, in the order of the targets \[raw units\].
#[derive(Debug, Clone, PartialEq)]
pub enum LeadAnswers {
    /// Of a model that runs here: displacements since the newest point. It gets bands when it is scored.
    Here(Vec<[f64; 2]>),
    /// Positions that came from elsewhere.
    Elsewhere(Vec<BandedPosition>),
}

/// What `entrant` predicts at the instants of the sequences that are `owned`; a model observes all sequences
/// before them. `None`: it has no predictions of this set.
///
/// # Errors
/// A model that cannot start, or predictions that do not fit.
pub(super) fn predict(
    entrant: &Entrant,
    set: &Set,
    targets: &Targets,
    owned: &[bool],
) -> Result<Option<Predicted>, BoardError> {
    let (answers, note) = match entrant {
        Entrant::Model(model) => {
            let (mut contestant, note) = model.build(&Setting::of(set))?;
            train(&mut *contestant, &set.train, if set.cold { 0 } else { model.passes() }, &|| ());
            let note = with_choice(note, &*contestant);
            (LeadAnswers::Here(walk(model, &mut *contestant, set, targets, owned)?), note)
        }
        Entrant::File { predictions, .. } => {
            let Some(all) = predictions.answers(&set.name, &set.scored, targets)? else { return Ok(None) };
            let of_target = targets.instants.iter().flat_map(|i| i.scored().map(|_| i.sequence));
            let own = all.into_iter().zip(of_target);
            let own = own.filter(|(_, sequence)| owned.get(*sequence).copied().unwrap_or(false));
            (LeadAnswers::Elsewhere(own.map(|(answer, _)| answer).collect()), None)
        }
    };
    Ok(Some(Predicted { model: entrant.name().to_owned(), note, answers }))
}

impl Predicted {
    /// The lane of these predictions, which are of every target of the set.
    #[must_use]
    pub fn lane(&self, set: &Set, targets: &Targets) -> Lane {
        let scale = set.mm_per_unit().unwrap_or([1.0; 2]);
        let tally = match &self.answers {
            LeadAnswers::Here(displacements) => with_bands(displacements, set, targets, scale),
            LeadAnswers::Elsewhere(answers) => judge(answers, targets, scale),
        };
        let glyph_height = height(set);
        let rows = tally.leads.iter().enumerate().map(|(lead, tally)| tally.row(lead, glyph_height));
        let (model, note) = (self.model.clone(), self.note.clone());
        Lane { model, leads: rows.collect(), note, sequences: tally.sequences }
    }
}

/// Lets a model observe the set up to its last owned sequence, and predict at every instant of those.
fn walk(
    model: &Model,
    contestant: &mut dyn Contestant,
    set: &Set,
    targets: &Targets,
    owned: &[bool],
) -> Result<Vec<[f64; 2]>, RegistryError> {
    let mut predictions = Vec::new();
    let mut instants = targets.instants.iter().peekable();
    let (mut steps, mut path): (Vec<[f64; 2]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let needed = owned.iter().rposition(|owned| *owned).map_or(0, |last| last + 1);
    for (index, (sequence, owned)) in set.scored.iter().zip(owned).enumerate().take(needed) {
        contestant.start_sequence();
        let farthest = targets.steps_ahead(index, LEADS_MS.len() - 1).ceil().max(1.0) as usize;
        steps.resize(farthest, [0.0; 2]);
        for t in 0..sequence.v.len() {
            take_in(contestant, sequence, t);
            // After step t the newest point is t + 1.
            let Some(instant) = instants.next_if(|i| i.sequence == index && i.point == t + 1) else {
                continue;
            };
            if !owned {
                continue;
            }
            contestant.preview(&mut steps);
            sum_up(&steps, &mut path);
            let ahead = |lead| between(&path, targets.steps_ahead(index, lead)).unwrap_or([f64::NAN; 2]);
            predictions.extend(instant.scored().map(ahead));
        }
        model.check(contestant, sequence)?;
    }
    Ok(predictions)
}

/// Scores displacements that stand in the order of the targets, with bands that learn from them.
fn with_bands(displacements: &[[f64; 2]], set: &Set, targets: &Targets, unit: [f64; 2]) -> LaneTally {
    let mut tally = LaneTally::new(unit);
    let mut displacements = displacements.iter();
    let mut instants = targets.instants.iter().peekable();
    let mut bands = Bands::untried(|lead| targets.steps_ahead(0, lead));
    for (index, sequence) in set.scored.iter().enumerate() {
        for (t, v) in sequence.v.iter().enumerate() {
            bands.observe(t + 1, *v);
            let Some(instant) = instants.next_if(|i| i.sequence == index && i.point == t + 1) else {
                continue;
            };
            for lead in instant.scored() {
                let (Some(predicted), Some(truth)) =
                    (displacements.next(), targets.truth(index, instant.point, lead))
                else {
                    continue;
                };
                tally.push(targets, (*instant, lead), *predicted, &truth, bands.at(lead));
                let [x, y] = truth.position;
                let due = instant.point + targets.steps_ahead(index, lead).ceil() as usize;
                bands.push(lead, due, (predicted[0] - x).hypot(predicted[1] - y), x.hypot(y));
            }
        }
        bands.end_sequence();
    }
    tally
}

/// Scores answers that stand in the order of the targets.
fn judge(answers: &[BandedPosition], targets: &Targets, unit: [f64; 2]) -> LaneTally {
    let mut tally = LaneTally::new(unit);
    let mut answers = answers.iter();
    for instant in &targets.instants {
        let newest = targets.points(instant.sequence).get(instant.point).copied().unwrap_or_default();
        for lead in instant.scored() {
            let (Some(answer), Some(truth)) =
                (answers.next(), targets.truth(instant.sequence, instant.point, lead))
            else {
                continue;
            };
            let predicted = [answer.position[0] - newest[0], answer.position[1] - newest[1]];
            tally.push(targets, (*instant, lead), predicted, &truth, answer.radii);
        }
    }
    tally
}

/// Positions after 0, 1, 2 ... predicted steps.
fn sum_up(steps: &[[f64; 2]], path: &mut Vec<[f64; 2]>) {
    path.clear();
    let mut at = [0.0; 2];
    path.push(at);
    for [x, y] in steps {
        at = [at[0] + x, at[1] + y];
        path.push(at);
    }
}
