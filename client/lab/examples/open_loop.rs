//! Open loop: how well the pen is predicted at the moment of a sample, without plan and arm.
//!
//! `cargo run --release -p foretrace-lab --example open_loop -- FOLDER [LIMIT [EVERY [SPLIT [SETTINGS]]]]`
//! (SETTINGS: KEY=VALUE ..., or two of them with `--` between)
//!
//! FOLDER: a set such as `DATA/unipen-tos`, its median glyph 0.1 m high. The first LIMIT sequences (default
//! 25) of every EVERY-th hand (default 6) of SPLIT (default train), each hand cold at first. Mean squared
//! distance \[m²\], 4, 7, 17, 35, 37 and 55 ms after a sample, of: standing still; the shipped predictor's
//! preview; a Kalman filter tuned for that lead; the preview as corrected by `trust::Evidence`, with no joint
//! saturated. Points of a preview are joined by straight lines. Samples that the loop refuses, as the first
//! of a jump, are not scored; the Kalman filter observes them.
//!
//! SETTINGS (KEY=VALUE ...) stand over the preset. With two of them, every hand is foreseen with both; the
//! ratios of the squared errors, second over first, stand below, each with the middle 95 % of bootstraps over
//! writers, over all samples and over those with no jump before the lead.

use std::path::Path;
use std::process::ExitCode;

use foretrace_config::{Config, Draft};
use foretrace_control::estimate::LEADS;
use foretrace_control::estimate::record::{NewPreview, PreviewRecord};
use foretrace_control::estimate::refine::Refiner;
use foretrace_control::learn::{Leads, Learner, LearnerSettings};
use foretrace_control::pen::{PenReading, PenTracker, Receipt};
use foretrace_control::predict::Previewer;
use foretrace_control::units::Stamp;
use foretrace_lab::baselines::{BaselineKind, BaselineSettings, Limits, build};
use foretrace_lab::closed_loop::{BenchArm, Hand, hands};
use foretrace_sim::data::{DataSet, Split, median_glyph_height};
use foretrace_sim::path::{Lift, PathSample};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

const LEADS_S: [f64; 6] = [0.004, 0.007, 0.017, 0.035, 0.037, 0.055];
const PERIOD_S: f64 = 0.002;
/// A jump is over for the loop after this long \[s\].
const WHOLE_S: f64 = 0.02;
/// Between two sequences \[s\].
const REST_S: f64 = 2.0;
/// Samples of a sequence before anything is scored: a Kalman filter needs some.
const WARM: usize = 8;

type Point = [f64; 2];
type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

/// Bootstraps of a ratio.
const BOOTSTRAPS: usize = 2000;

/// Sums of squared distances per lead: still, preview, Kalman, corrected; and how many there are.
type Sums = [([f64; 4], f64); LEADS_S.len()];

/// One hand's sums: over everything, and where no jump comes before the lead.
#[derive(Default, Clone)]
struct Scored {
    writer: String,
    all: Sums,
    within: Sums,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("open_loop: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("usage: open_loop FOLDER [LIMIT [EVERY [SPLIT]]]")?);
    let number = |at: usize, name: &str, usual: usize| match arguments.get(at).map(|text| text.parse()) {
        Some(Ok(number)) if number > 0 => Ok(number),
        None => Ok(usual),
        _ => Err(format!("{name} is {:?}, legal are whole numbers from 1 on", arguments[at])),
    };
    let (limit, every) = (number(1, "LIMIT", 25)?, number(2, "EVERY", 6)?);
    let split: Split = arguments.get(3).map_or("train", String::as_str).parse()?;
    let config = Config::preset("ur5")?;
    let set = DataSet::load(folder, &split, false)?;
    let height = median_glyph_height(set.characters()).ok_or("no glyph")?;
    let (hands, _) = hands(&set, height, BenchArm::Ideal, &config, Lift::Leap)?;
    let hands: Vec<Hand> = hands.into_iter().step_by(every).collect();
    let words = arguments.get(4..).unwrap_or_default();
    let (first, second) = match words.iter().position(|word| word == "--") {
        Some(at) => (&words[..at], Some(&words[at + 1..])),
        None => (words, None),
    };
    let before = scored(&hands, limit, &over_preset(first)?)?;
    let other = second.map(|words| scored(&hands, limit, &over_preset(words)?)).transpose()?;
    for (name, scored) in [("first settings", Some(&before)), ("second settings", other.as_ref())] {
        let Some(scored) = scored else { continue };
        println!(
            "{name}\nafter      still      preview    Kalman     corrected [m²]; the same with no jump before"
        );
        for (lead, lead_s) in LEADS_S.iter().enumerate() {
            let mean = |of: fn(&Scored) -> &Sums, way: usize| {
                let sum = scored.iter().map(|hand| of(hand)[lead].0[way]).sum::<f64>();
                sum / scored.iter().map(|hand| of(hand)[lead].1).sum::<f64>()
            };
            let row = |of| [0, 1, 2, 3].map(|way| format!("{:.3e}", mean(of, way))).join("  ");
            println!("{:4.0} ms    {};  {}", lead_s * 1e3, row(|hand| &hand.all), row(|hand| &hand.within));
        }
    }
    if let Some(other) = &other {
        ratios(&before, other);
    }
    Ok(())
}

/// The preset with `words` (KEY=VALUE) over it.
fn over_preset(words: &[String]) -> Fallible<Config> {
    let mut draft = Draft::preset("ur5");
    for pair in words {
        let (key, value) = pair.split_once('=').ok_or_else(|| format!("{pair:?} is not KEY=VALUE"))?;
        draft = draft.set(key, value);
    }
    Ok(draft.finish()?)
}

/// Prints the ratios of squared errors, preview and corrected, with their bootstraps over writers.
fn ratios(before: &[Scored], after: &[Scored]) {
    println!("second / first, 95 % over writers");
    println!(
        "after      preview                corrected              preview, no jump       corrected, no jump"
    );
    let mut writers: Vec<&str> = before.iter().map(|hand| hand.writer.as_str()).collect();
    writers.sort_unstable();
    writers.dedup();
    for (lead, lead_s) in LEADS_S.iter().enumerate() {
        let columns = [(false, 1), (false, 3), (true, 1), (true, 3)].map(|(within, way)| {
            let of = |hands: &[Scored], writer: &str| -> f64 {
                let own = hands.iter().filter(|hand| hand.writer == writer);
                own.map(|hand| if within { &hand.within } else { &hand.all }).map(|s| s[lead].0[way]).sum()
            };
            let pairs: Vec<[f64; 2]> = writers.iter().map(|w| [of(before, w), of(after, w)]).collect();
            let ratio = |pairs: &mut dyn Iterator<Item = [f64; 2]>| {
                let [old, new] = pairs.fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
                new / old
            };
            let mut rng = Pcg64::seed_from_u64(0);
            let mut drawn: Vec<f64> = (0..BOOTSTRAPS)
                .map(|_| ratio(&mut (0..pairs.len()).map(|_| pairs[rng.random_range(0..pairs.len())])))
                .collect();
            drawn.sort_by(f64::total_cmp);
            let at = |share: f64| drawn[((BOOTSTRAPS - 1) as f64 * share) as usize];
            format!("{:.3} [{:.3} {:.3}]", ratio(&mut pairs.iter().copied()), at(0.025), at(0.975))
        });
        println!("{:4.0} ms    {}", lead_s * 1e3, columns.join("  "));
    }
}

/// Every hand's sums, on all cores.
fn scored(hands: &[Hand], limit: usize, config: &Config) -> Fallible<Vec<Scored>> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let parts: Vec<Result<Vec<(usize, Scored)>, String>> = std::thread::scope(|scope| {
        let one = |part: usize| {
            let own = hands.iter().enumerate().skip(part).step_by(threads);
            own.map(|(place, hand)| {
                let mut scored = Scored { writer: hand.writer.clone(), ..Scored::default() };
                write(hand, limit, config, &mut scored).map_err(|error| error.to_string())?;
                Ok((place, scored))
            })
            .collect()
        };
        let stack = || std::thread::Builder::new().stack_size(16 << 20);
        let running: Vec<_> =
            (0..threads).filter_map(|part| stack().spawn_scoped(scope, move || one(part)).ok()).collect();
        running.into_iter().filter_map(|thread| thread.join().ok()).collect()
    });
    let mut all = Vec::new();
    for part in parts {
        all.extend(part?);
    }
    if all.len() != hands.len() {
        return Err("a thread could not be started".into());
    }
    all.sort_by_key(|(place, _)| *place);
    Ok(all.into_iter().map(|(_, scored)| scored).collect())
}

fn write(hand: &Hand, limit: usize, config: &Config, scored: &mut Scored) -> Fallible<()> {
    let settings = config.follower_settings();
    let step_ns = settings.pen.step_ns;
    let step_s = step_ns as f64 * 1e-9;
    let leads = Leads::of_loop(step_ns, 30_000_000, 10);
    let mut learner = Learner::new(LearnerSettings { leads, ..config.learner_settings() }, config.models())?;
    let mut previewer = Previewer::new(settings.preview, &settings.models, &settings.weights)?;
    let mut pen = settings.pen;
    pen.max_speed_mps = 10.0;
    (pen.position_min_m, pen.position_max_m) = ([-10.0; 2], [10.0; 2]);
    let mut tracker = PenTracker::new(pen)?;
    let mut record = PreviewRecord::new(step_s, true);
    let mut refiner = Refiner::tuned(step_s, &settings.law, &settings.prior);
    let mut filters = Vec::new();
    for lead_s in LEADS_S {
        let way = BaselineSettings::new(BaselineKind::Kalman, PERIOD_S, lead_s - PERIOD_S, Limits::OFF, 0.1);
        filters.push(build(BaselineKind::Kalman, &way)?);
    }
    let mut begin_s = 10.0;
    for sequence in hand.sequences.iter().take(limit) {
        let samples = &sequence.path.samples;
        let Some(first_s) = samples.first().map(|sample| sample.t_s) else { continue };
        // The preview in force: its base, the point before, and the predicted points.
        let mut preview: Option<(Stamp, Point, [Point; LEADS + 1])> = None;
        // Input of the record from the last sample: whether a new preview was made, and the sample.
        let (mut made, mut look) = (false, None);
        for (index, sample) in samples.iter().enumerate() {
            let time_s = begin_s + sample.t_s - first_s;
            let (stamp, position) = (Stamp((time_s * 1e9).round() as u64), [sample.x_m, sample.y_m]);
            let reading = PenReading { stamp, position, contact: sample.contact, origin: Default::default() };
            let receipt = tracker.ingest(stamp, &reading);
            let mut closed = Vec::new();
            while let Some(step) = tracker.next_step() {
                let learn = previewer.observe(&step);
                if learner.learn(&learn).hand_over {
                    previewer.set_weights(learner.weights())?;
                }
                closed.push(learn);
            }
            if let Some((_, _, path)) = preview.as_ref().filter(|_| std::mem::take(&mut made)) {
                let [base, path @ ..] = path;
                record.record_preview(&NewPreview { base: *base, path });
            }
            if let Some(refinement) = look.take() {
                record.record_refinement(&refiner, &refinement);
            }
            record.judge(&mut refiner, &closed);
            let shifted = PathSample { t_s: time_s, ..*sample };
            let kalman: Vec<_> = filters.iter_mut().map(|filter| filter.target(time_s, &[shifted])).collect();
            // The first sample of a jump is refused, and the loop goes on as if it had not come.
            if receipt != Receipt::Accepted {
                continue;
            }
            refiner.observe(stamp, position);
            let mut points = [[0.0; 2]; LEADS];
            if !closed.is_empty()
                && let Some(report) = previewer.preview(&mut points)
            {
                let velocity = previewer.newest().map_or([0.0; 2], |step| step.displacement);
                made = true;
                let mut path = [report.base_position; LEADS + 1];
                path[1..].copy_from_slice(&points);
                let [[x, y], [dx, dy]] = [report.base_position, velocity];
                preview = Some((Stamp(report.base_index * step_ns), [x - dx, y - dy], path));
            }
            let Some((base, before, path)) = &preview else { continue };
            let phase = stamp.since(*base) as f64 / step_ns as f64;
            if !(0.0..1.5).contains(&phase) {
                continue;
            }
            let filtered = refiner.refinement(position, phase, parabola(*before, path[0], path[1], phase));
            look = Some(filtered);
            if index < WARM {
                continue;
            }
            // No arm, no limits: onsets are trusted as with an arm that follows.
            let shares = record.report(1, 1, 0.0).believed();
            for (lead, (lead_s, kalman)) in LEADS_S.iter().zip(kalman).enumerate() {
                let Some(real) = at(samples, sample.t_s + lead_s) else { continue };
                let s = phase + lead_s / step_s;
                let (index, part) = (s as usize, s.fract());
                let believed =
                    |index: usize| refiner.refined(&filtered, index, path[index], shares[index - 1]);
                let corrected = if index == 0 {
                    between(position, believed(1), ((s - phase) / (1.0 - phase).max(0.02)).min(1.0))
                } else {
                    between(believed(index), believed(index + 1), part)
                };
                let claims = [
                    position,
                    between(path[index], path[index + 1], part),
                    kalman.unwrap_or(position),
                    corrected,
                ];
                let jumps = sequence.path.leaps.iter().any(|leap| {
                    let at_s = samples[*leap].t_s;
                    sample.t_s - WHOLE_S < at_s && at_s <= sample.t_s + lead_s
                });
                for (sums, count) in
                    [Some(&mut scored.all[lead]), (!jumps).then_some(&mut scored.within[lead])]
                        .into_iter()
                        .flatten()
                {
                    for (sum, [x, y]) in sums.iter_mut().zip(claims) {
                        *sum += (x - real[0]).powi(2) + (y - real[1]).powi(2);
                    }
                    *count += 1.0;
                }
            }
        }
        begin_s += sequence.path.duration_s() + REST_S;
    }
    Ok(())
}

/// Where the pen was at `t_s`, on straight lines between samples.
fn at(samples: &[PathSample], t_s: f64) -> Option<Point> {
    let after = samples.partition_point(|sample| sample.t_s < t_s);
    let (from, to) = (samples.get(after.checked_sub(1)?)?, samples.get(after)?);
    Some(between([from.x_m, from.y_m], [to.x_m, to.y_m], (t_s - from.t_s) / (to.t_s - from.t_s)))
}

fn between([ax, ay]: Point, [bx, by]: Point, part: f64) -> Point {
    [ax + part * (bx - ax), ay + part * (by - ay)]
}

/// `phase` steps after the middle one of three points a step apart: what the follower takes as expected.
fn parabola([bx, by]: Point, [hx, hy]: Point, [nx, ny]: Point, phase: f64) -> Point {
    let along = |before: f64, here: f64, next: f64| {
        here + phase * (0.5 * (next - before) + phase * (0.5 * (next + before) - here))
    };
    [along(bx, hx, nx), along(by, hy, ny)]
}
