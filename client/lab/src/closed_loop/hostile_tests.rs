//! What a predictor of another process may cost behind the simulated UR5, whatever it sends, beside the
//! shipped fallback, which learns. `FORETRACE_EXTERNAL_TICKS` is how long each family writes; `.ci/long
//! external` has a million ticks.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use foretrace_config::{Config, Draft};
use foretrace_control::predict::external::MOST_LATE;
use foretrace_control::predict::{ExternalPreview, LearnStep, MAX_PREVIEW};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::job::Job;
use super::pareto::Tuning;
use super::{BenchArm, Benchmark, Flaws, Hand, Rival, SequenceScore, hand_of_text};
use crate::experiments::{StepPredictor, WAIT_S};
use crate::process::ProcessError;
use foretrace_control::estimate::LawParameters;

const TEXTS: [&str; 5] = ["aK8", "eOb", "Su", "wRg", "dE4"];

/// Positions of the pen's grid steps, as a first run was told them \[m\].
type Truth = Rc<RefCell<Vec<(u64, [f64; 2])>>>;
/// From the number of the step and the truth to what is sent instead.
type Spoil = fn(u64, &mut Pcg64, ExternalPreview) -> Option<ExternalPreview>;

/// Remembers what it is told, and predicts nothing.
#[derive(Debug)]
struct Recorder(Truth);

impl StepPredictor for Recorder {
    fn tell(&mut self, step: &LearnStep, _steps: usize) -> Result<Option<ExternalPreview>, ProcessError> {
        self.0.borrow_mut().push((step.index, step.position));
        Ok(None)
    }
}

/// Knows the truth, and sends what becomes of it.
#[derive(Debug)]
struct Spoiler {
    truth: Truth,
    told: usize,
    rng: Pcg64,
    spoil: Spoil,
    sent: Rc<Cell<u64>>,
}

impl StepPredictor for Spoiler {
    fn tell(&mut self, step: &LearnStep, steps: usize) -> Result<Option<ExternalPreview>, ProcessError> {
        let truth = self.truth.borrow();
        let now = self.told;
        self.told += 1;
        assert_eq!(truth.get(now), Some(&(step.index, step.position)), "the pen is the same in both runs");
        let count = (steps + MOST_LATE as usize).min(MAX_PREVIEW);
        let mut honest = ExternalPreview { base_index: step.index, count, ..ExternalPreview::EMPTY };
        let mut last = step.position;
        for (ahead, slot) in honest.positions.iter_mut().take(count).enumerate() {
            // A stroke that is over stays where it ended.
            let next =
                truth.get(now + 1 + ahead).filter(|(index, _)| *index == step.index + 1 + ahead as u64);
            last = next.map_or(last, |(_, position)| *position);
            *slot = last;
        }
        let sent = (self.spoil)(now as u64, &mut self.rng, honest);
        self.sent.set(self.sent.get() + u64::from(sent.is_some()));
        Ok(sent)
    }
}

fn spoiled(
    mut preview: ExternalPreview,
    mut spoil: impl FnMut(usize, [f64; 2]) -> [f64; 2],
) -> ExternalPreview {
    let count = preview.count;
    preview.positions.iter_mut().take(count).enumerate().for_each(|(i, at)| *at = spoil(i, *at));
    preview
}

/// From its first position on.
fn stretched(preview: ExternalPreview, way: f64) -> ExternalPreview {
    let [first, ..] = preview.positions;
    spoiled(preview, |_, at| std::array::from_fn(|axis| first[axis] + way * (at[axis] - first[axis])))
}

/// What is sent instead of the truth, by the number of the step.
const FAMILIES: [(&str, Spoil); 19] = [
    ("the truth", |_, _, honest| Some(honest)),
    ("random", |_, rng, honest| Some(spoiled(honest, |_, at| at.map(|x| x + rng.random_range(-0.05..0.05))))),
    ("random within the bound", |_, rng, honest| {
        let [mut walk, ..] = honest.positions;
        Some(spoiled(honest, |_, _| {
            walk = walk.map(|x| x + rng.random_range(-0.0005..0.0005));
            walk
        }))
    }),
    ("not a number", |n, _, honest| {
        Some(spoiled(honest, |i, at| if i == (n % 20) as usize { [f64::NAN, at[1]] } else { at }))
    }),
    ("far away", |_, _, honest| Some(spoiled(honest, |_, at| at.map(|x| x + 1e300)))),
    ("mirrored", |_, _, honest| Some(stretched(honest, -1.0))),
    ("three times as far", |_, _, honest| Some(stretched(honest, 3.0))),
    ("frozen", |_, _, honest| Some(stretched(honest, 0.0))),
    ("another step's", |_, _, honest| Some(ExternalPreview { base_index: honest.base_index + 7, ..honest })),
    ("too late", |_, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index.saturating_sub(3), ..honest })
    }),
    ("mirrored, two steps late", |_, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index.saturating_sub(2), ..stretched(honest, -1.0) })
    }),
    ("the same number again", |n, _, honest| {
        Some(ExternalPreview { base_index: honest.base_index - n % 2, ..stretched(honest, -1.0) })
    }),
    ("certain of nonsense", |_, _, honest| {
        let nonsense = stretched(honest, -1.0);
        Some(ExternalPreview { radii_count: honest.count, radii: [1e-9; MAX_PREVIEW], ..nonsense })
    }),
    ("a lie in eight", |n, _, honest| Some(if n % 8 == 0 { stretched(honest, -1.0) } else { honest })),
    ("a lie in four", |n, _, honest| Some(if n % 4 == 0 { stretched(honest, 3.0) } else { honest })),
    ("right to the eighth lead, mirrored beyond", |_, _, honest| {
        let [.., eighth, _] = honest.positions[..9] else { return None };
        Some(spoiled(honest, |i, at| {
            if i < 8 { at } else { std::array::from_fn(|axis| 2.0 * eighth[axis] - at[axis]) }
        }))
    }),
    ("mirrored to the eleventh lead, right beyond", |_, _, honest| {
        let [first, ..] = honest.positions;
        Some(spoiled(honest, |i, at| {
            if i < 11 { std::array::from_fn(|axis| 2.0 * first[axis] - at[axis]) } else { at }
        }))
    }),
    ("shaken to the eleventh lead, right beyond", |_, rng, honest| {
        Some(spoiled(honest, |i, at| {
            at.map(|x| if i < 11 { x + 0.0003 * (i + 1) as f64 * rng.random_range(-1.0..1.0) } else { x })
        }))
    }),
    ("there for three seconds, then not, again and again", |n, _, honest| (n % 600 < 300).then_some(honest)),
];

/// True for two seconds, then a lie of a fifth, again and again.
fn betrayed(n: u64, _: &mut Pcg64, honest: ExternalPreview) -> Option<ExternalPreview> {
    Some(if n % 220 >= 200 { stretched(honest, -1.0) } else { honest })
}

struct Desk<'a> {
    config: &'a Config,
    hand: Hand,
}

impl Desk<'_> {
    /// RMS error \[m\] and ticks of the hand beside `process`; every command is inside the joints' limits.
    fn write(&self, process: Box<dyn StepPredictor>) -> (f64, u32) {
        let benchmark = Benchmark {
            config: self.config,
            arms: Vec::new(),
            rivals: Vec::new(),
            flaws: Flaws::default(),
            law: LawParameters::SHIPPED,
        };
        let rival = Rival::named("external:tested").unwrap();
        let job = Job { rival, tuning: &Tuning::Default, arm: BenchArm::Ur5, hand: &self.hand };
        let mut desk = benchmark.desk_with(&job, |_| Ok(Some(process))).unwrap();
        let (mut squares, mut ticks) = (0.0, 0);
        for sequence in &self.hand.sequences {
            let run = desk.write(&sequence.path.samples, WAIT_S, &[]).unwrap();
            assert!(run.ticks.iter().all(|tick| !tick.illegal), "a command beyond the limits");
            let score = SequenceScore::of(sequence, &run).unwrap();
            squares += score.mse_m2 * f64::from(score.ticks);
            ticks += score.ticks;
        }
        ((squares / f64::from(ticks)).sqrt(), ticks)
    }
}

#[test]
fn whatever_a_hostile_process_sends_costs_at_most_a_tenth_behind_the_ur5() {
    let config = Draft::preset("ur5").finish().unwrap();
    let wanted = std::env::var("FORETRACE_EXTERNAL_TICKS").ok().and_then(|n| n.parse().ok()).unwrap_or(6000);
    let mut hand = hand_of_text(TEXTS[0], 1, BenchArm::Ur5, &config).unwrap();
    let mut seconds = 0.0;
    for seed in 1.. {
        let text = TEXTS[seed as usize % TEXTS.len()];
        let more = hand_of_text(text, seed, BenchArm::Ur5, &config).unwrap();
        let samples = &more.sequences[0].path.samples;
        seconds += samples[samples.len() - 1].t_s - samples[0].t_s;
        hand.sequences.extend(more.sequences);
        if seconds * 500.0 >= f64::from(wanted) {
            break;
        }
    }
    let desk = Desk { config: &config, hand };
    let truth = Truth::default();
    let (fallback, ticks) = desk.write(Box::new(Recorder(truth.clone())));
    assert!(ticks >= wanted, "{ticks}");
    let beside = |spoil: Spoil| {
        let sent = Rc::new(Cell::new(0));
        let (truth, rng) = (truth.clone(), Pcg64::seed_from_u64(7));
        let (rms, _) = desk.write(Box::new(Spoiler { truth, told: 0, rng, spoil, sent: sent.clone() }));
        assert!(sent.get() > 100, "{} previews", sent.get());
        rms / fallback
    };
    println!("{ticks} ticks, fallback {:.3} mm", fallback * 1e3);
    println!("true for two seconds, then a lie of a fifth, again and again: {:.3}", beside(betrayed));
    let (mut too_much, mut moved) = (Vec::new(), 0);
    for (name, spoil) in FAMILIES {
        let ratio = beside(spoil);
        println!("{name}: {ratio:.3}");
        moved += u32::from((ratio - 1.0).abs() > 1e-9);
        if !(ratio <= 1.10) {
            too_much.push((name, ratio));
        }
    }
    assert!(too_much.is_empty(), "{too_much:?}");
    // Who never has a part leaves the arm as it is, bit for bit.
    assert!(moved >= 6, "{moved} families had a part");
}
