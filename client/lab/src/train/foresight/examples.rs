//! Training examples from a hand's samples: features at every step of the loop's grid, and the way that
//! followed.
//!
//! The samples go through the loop's own pen grid and running scale, cold at first, so that the network sees
//! in training what it will see in the loop. A target is known as long as no jump, gap or end of the
//! recording lies before it.

use foretrace_control::pen::{
    Motion, PenReading, PenSettings, PenTracker, SpeedScale, SpeedScaleSettings, TARGET_RMS, Touch,
};
use foretrace_control::predict::PenStep;
use foretrace_control::predict::models::foresight::{FEATURES, OUTPUTS, PenHistory, turned, unit};
use foretrace_control::predict::models::mixture::{NODES, is_motion};
use foretrace_control::units::Stamp;
use foretrace_sim::path::PathSample;

use super::corpus::WrittenCharacter;
use super::study::{Study, Teller};

/// Rest between two sequences, for which the grid begins again \[s\].
const REST_S: f64 = 2.0;
/// When the first sequence begins \[s\].
const BEGIN_S: f64 = 10.0;
/// Displacements of more than this many RMS per axis are no motion to the loop.
const LARGEST: f64 = 1000.0 * TARGET_RMS;

/// Features and targets, one row per step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Examples {
    /// Inputs of the network, a row of the study's width per example.
    pub features: Vec<f32>,
    /// Way to every node in the frame of motion, in units of ordinary motion.
    pub targets: Vec<[f32; OUTPUTS]>,
    /// How many nodes of each are known.
    pub known: Vec<u8>,
}

impl Examples {
    #[must_use]
    pub fn len(&self) -> usize {
        self.known.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.known.is_empty()
    }

    /// Appends `others`.
    pub fn extend(&mut self, others: &Self) {
        self.features.extend_from_slice(&others.features);
        self.targets.extend_from_slice(&others.targets);
        self.known.extend_from_slice(&others.known);
    }
}

struct ClosedStep {
    displacement: [f64; 2],
    scale_m: f64,
    frame: [f64; 2],
    /// The displacement continues the one before.
    follows: bool,
}

/// The examples of one hand's `sequences` on a grid of `step_ns` \[ns\]; the first
/// sample stands `phase_s` \[s\] after a grid point.
#[must_use]
pub fn examples(sequences: &[WrittenCharacter], step_ns: u64, phase_s: f64, study: &Study) -> Examples {
    let settings = PenSettings {
        step_ns,
        max_speed_mps: 10.0,
        position_min_m: [-10.0; 2],
        position_max_m: [10.0; 2],
        ..PenSettings::default()
    };
    let scale = SpeedScale::new(SpeedScaleSettings::default());
    let (Ok(mut tracker), Ok(mut scale)) = (PenTracker::new(settings), scale) else {
        return Examples::default();
    };
    let step_s = step_ns as f64 * 1e-9;
    let block = study.block(step_s);
    let mut history = PenHistory::EMPTY;
    let mut steps: Vec<ClosedStep> = Vec::new();
    let mut examples = Examples::default();
    let mut begin_s = BEGIN_S + phase_s;
    let mut newest = None;
    for WrittenCharacter { label, samples, leaps } in sequences {
        let Some(first_s) = samples.first().map(|sample| sample.t_s) else { continue };
        let mut teller = Teller::new(label);
        let stamp_of = |sample: &PathSample| ((begin_s + sample.t_s - first_s) * 1e9).round() as u64;
        // No hand could tell where a jump leads, however short it is.
        let unseen: Vec<[u64; 2]> = leaps
            .iter()
            .filter_map(|leap| Some([samples.get(leap.checked_sub(1)?)?, samples.get(*leap)?].map(stamp_of)))
            .collect();
        for sample in samples {
            let stamp = Stamp(stamp_of(sample));
            let reading = PenReading::new(stamp, [sample.x_m, sample.y_m], sample.contact);
            tracker.ingest(stamp, &reading);
            let leapt = |index: u64| {
                let (begin_ns, end_ns) = (index.saturating_sub(1) * step_ns, index * step_ns);
                unseen.iter().any(|[from, to]| *from < end_ns && begin_ns < *to)
            };
            while let Some(step) = tracker.next_step() {
                let follows = newest.is_some_and(|newest: u64| newest + 1 == step.index);
                newest = Some(step.index);
                let plausible = || scale.normalise(step.displacement).iter().all(|x| x.abs() <= LARGEST);
                if step.motion != Motion::Continues || !follows || !plausible() {
                    history = PenHistory::EMPTY;
                    teller.interrupt();
                    steps.push(ClosedStep {
                        displacement: [0.0; 2],
                        scale_m: 1.0,
                        frame: [1.0, 0.0],
                        follows: false,
                    });
                    examples.known.push(0);
                    examples.targets.push([0.0; OUTPUTS]);
                    examples.features.resize(examples.known.len() * study.inputs(), 0.0);
                    continue;
                }
                scale.observe(&step);
                let x = scale.normalise(step.displacement);
                let touch: Touch = step.touch();
                history.observe(&PenStep {
                    x,
                    half: scale.normalise(step.half),
                    ahead: scale.normalise(step.ahead),
                    ahead_s: step.ahead_ns as f64 * 1e-9,
                    touch,
                });
                let look = history.look(step_s, block);
                teller.observe(x, touch, step_s);
                let mut row = vec![0.0; study.inputs()];
                row[..FEATURES].copy_from_slice(&look.features);
                study.amend(&mut row, &teller, look.frame);
                examples.features.extend_from_slice(&row);
                examples.known.push(1);
                examples.targets.push([0.0; OUTPUTS]);
                steps.push(ClosedStep {
                    displacement: step.displacement,
                    scale_m: scale.metres_per_unit(),
                    frame: look.frame,
                    follows: is_motion(x) && !leapt(step.index),
                });
            }
        }
        let duration_s = samples.last().map_or(0.0, |sample| sample.t_s - first_s);
        begin_s += duration_s + REST_S;
    }
    look_ahead(&steps, &mut examples);
    examples
}

/// Fills in targets, and drops examples without any.
fn look_ahead(steps: &[ClosedStep], examples: &mut Examples) {
    let width = examples.features.len() / examples.known.len().max(1);
    let mut kept = Examples::default();
    for (t, now) in steps.iter().enumerate() {
        if examples.known[t] == 0 {
            continue;
        }
        let mut target = [0.0; OUTPUTS];
        let mut way = [0.0; 2];
        let mut known = 0;
        let mut nodes = NODES.iter().zip(target.as_chunks_mut::<2>().0);
        let mut next = nodes.next();
        for (ahead, step) in steps.iter().skip(t + 1).enumerate() {
            if !step.follows {
                break;
            }
            way = [way[0] + step.displacement[0], way[1] + step.displacement[1]];
            let Some((node, slot)) = &mut next else { break };
            if ahead + 1 == **node {
                let normalised = turned(now.frame, way.map(|x| x / now.scale_m));
                **slot = normalised.map(|x| (x / unit(**node)) as f32);
                known += 1;
                next = nodes.next();
            }
        }
        if known > 0 {
            kept.known.push(known);
            kept.targets.push(target);
            kept.features.extend_from_slice(&examples.features[t * width..][..width]);
        }
    }
    *examples = kept;
}
