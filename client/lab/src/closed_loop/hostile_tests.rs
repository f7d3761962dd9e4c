//! What a predictor of another process may cost behind the simulated UR5, whatever it sends, beside the
//! shipped fallback, which learns. `FORETRACE_EXTERNAL_TICKS` is how long each family writes; `.ci/long
//! external` has a million ticks.

#[path = "../../../../daemon/control/tests/law/support/hostile.rs"]
mod hostile;

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use foretrace_config::{Config, Draft};
use foretrace_control::predict::external::MOST_LATE;
use foretrace_control::predict::{ExternalPreview, LearnStep, MAX_PREVIEW};
use rand::SeedableRng as _;
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
    spoil: hostile::Spoil,
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

struct Desk<'a> {
    config: &'a Config,
    hand: &'a Hand,
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
        let job = Job { rival, tuning: &Tuning::Default, arm: BenchArm::Ur5, hand: self.hand };
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

    /// Error of the fallback alone \[m\], ticks, and where the pen was.
    fn alone(&self) -> (f64, u32, Truth) {
        let truth = Truth::default();
        let (rms, ticks) = self.write(Box::new(Recorder(truth.clone())));
        (rms, ticks, truth)
    }

    /// Error beside one that sends what `spoil` makes of the truth \[m\].
    fn beside(&self, truth: &Truth, spoil: hostile::Spoil) -> f64 {
        let sent = Rc::new(Cell::new(0));
        let (truth, rng) = (truth.clone(), Pcg64::seed_from_u64(7));
        let (rms, _) = self.write(Box::new(Spoiler { truth, told: 0, rng, spoil, sent: sent.clone() }));
        assert!(sent.get() > 100, "{} previews", sent.get());
        rms
    }
}

/// So many ticks of writing, each text in another hand.
fn hand(wanted: u32, config: &Config) -> Hand {
    let of =
        |seed: u64| hand_of_text(TEXTS[seed as usize % TEXTS.len()], seed, BenchArm::Ur5, config).unwrap();
    let mut hand = of(1);
    let seconds = |hand: &Hand| {
        let samples = &hand.sequences[hand.sequences.len() - 1].path.samples;
        samples[samples.len() - 1].t_s - samples[0].t_s
    };
    let mut all = seconds(&hand);
    for seed in 2.. {
        if all * 500.0 >= f64::from(wanted) {
            break;
        }
        hand.sequences.extend(of(seed).sequences);
        all += seconds(&hand);
    }
    hand
}

#[test]
fn whatever_a_hostile_process_sends_costs_at_most_a_tenth_behind_the_ur5() {
    let config = Draft::preset("ur5").finish().unwrap();
    let wanted = std::env::var("FORETRACE_EXTERNAL_TICKS").map_or(6000, |n| n.parse().expect("a number"));
    let hand = hand(wanted, &config);
    let desk = Desk { config: &config, hand: &hand };
    let (fallback, ticks, truth) = desk.alone();
    assert!(ticks >= wanted, "{ticks}");
    println!("{ticks} ticks, fallback {:.3} mm", fallback * 1e3);
    let more: [(&str, hostile::Spoil); 3] = [
        ("the truth", |_, _, honest| Some(honest)),
        ("true, then mirrored, again and again", |n, _, honest| Some(hostile::betrayed(n, honest, -1.0))),
        ("true, then three times as far, again and again", |n, _, honest| {
            Some(hostile::betrayed(n, honest, 3.0))
        }),
    ];
    let (mut too_much, mut moved) = (Vec::new(), 0);
    for (name, spoil) in more.into_iter().chain(hostile::FAMILIES) {
        let ratio = desk.beside(&truth, spoil) / fallback;
        println!("{name}: {ratio:.3}");
        if !(ratio <= 1.10) {
            too_much.push((name, ratio));
        }
        moved += u32::from((ratio - 1.0).abs() > 1e-9);
        let refused = hostile::REFUSED.contains(&name);
        assert!(!refused || ratio.to_bits() == 1_f64.to_bits(), "{name}: {ratio}");
    }
    assert!(too_much.is_empty(), "{too_much:?}");
    assert!(moved >= 6, "{moved} families had a part");
}

/// Where the arm does not lead what is known anyway, knowledge brings it nearer to the pen.
#[test]
fn without_the_lead_the_truth_is_better_than_the_fallback_behind_the_ur5() {
    let config = Draft::preset("ur5").set("mpc.velocity_lead_ms", "0").finish().unwrap();
    let hand = hand(12_000, &config);
    let desk = Desk { config: &config, hand: &hand };
    let (fallback, ticks, truth) = desk.alone();
    let ratio = desk.beside(&truth, |_, _, honest| Some(honest)) / fallback;
    println!("{ticks} ticks without the lead, fallback {:.3} mm; the truth: {ratio:.3}", fallback * 1e3);
    assert!(ratio < 0.85, "{ratio}");
}
