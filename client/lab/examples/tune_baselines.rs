//! Tunes the baselines (`foretrace_lab::baselines`) for least error on the training writers of a set.
//!
//! `cargo run --release -p foretrace-lab --example tune_baselines -- FOLDER [WAY [EVERY [limited]]]`
//!
//! FOLDER: a set such as `../shared/data/unipen-tos`; hover is kept, the median glyph is 0.1 m high. WAY: one
//! of the baselines, or `all`. EVERY: search on every n-th letter (default 5); the result is then scored on
//! all letters; 0 only scores the present settings. `limited`: glyphs 0.03 m high and the shipped tool limits
//! for a UR5. Search for the least mean squared error at every budget of jerk: the servoj baselines over the
//! whole grid; the others one knob after another over its grid until nothing improves, from two starts, then
//! on from budget to budget.

use std::path::Path;

use foretrace_lab::baselines::{
    BaselineKind, BaselineSettings, Feed, Limits, OneEuroKnobs, OpenLoop, Origin, OtgKnobs, PostFilter,
    open_loop,
};
use foretrace_lab::experiments::{Labels, letters};
use foretrace_sim::data::{DataSet, Split};
use foretrace_sim::path::{PathSample, Placement};

const PERIOD_S: f64 = 0.002;
/// Tool limits of the shipped settings for a UR5.
const UR5: Limits = Limits { velocity_mps: 1.0, acceleration_mps2: 15.0, jerk_mps3: 2000.0 };
/// RMS jerk of the target for which the least error is searched, at glyphs of 0.1 m \[m/s³\].
const BUDGETS: [f64; 8] = [f64::INFINITY, 3e5, 1e5, 3e4, 1e4, 3e3, 1e3, 300.0];

/// One knob: its name and the settings that each of its values leads to.
type Knob = (&'static str, fn(&BaselineSettings) -> Vec<BaselineSettings>);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = arguments.first().ok_or("usage: tune_baselines FOLDER [WAY|all [EVERY]]")?;
    let kinds = match arguments.get(1).map(String::as_str) {
        None | Some("all") => BaselineKind::ALL.to_vec(),
        Some(name) => vec![name.parse()?],
    };
    let every: usize = arguments.get(2).map_or(Ok(5), |text| text.parse())?;
    let limited = arguments.get(3).is_some_and(|word| word == "limited");
    let (height_m, limits) = if limited { (0.03, UR5) } else { (0.1, Limits::OFF) };
    let set = DataSet::load(Path::new(folder), &Split::train(), true)?;
    let placement = Placement { size_m: [1.0, 0.6], glyph_height_m: height_m, ..Placement::default() };
    let (letters, skipped) = letters(&set, &Labels::All, &placement)?;
    let all: Vec<&[PathSample]> = letters.iter().map(|letter| &letter.path.samples[..]).collect();
    let some: Vec<&[PathSample]> = all.iter().step_by(every.max(1)).copied().collect();
    println!("{}: {} letters ({skipped} do not fit), search on {}", set.name, all.len(), some.len());
    for kind in kinds {
        let dead_times = if kind.smooths_in_the_servo() { &[0.0, 0.03][..] } else { &[0.0, 0.03, 0.1] };
        for &dead_time_s in dead_times {
            let start = BaselineSettings::new(kind, PERIOD_S, dead_time_s, limits, height_m);
            if every == 0 {
                println!("\n{kind}, dead time {} ms", dead_time_s * 1e3);
                report(kind, &start, limits.jerk_mps3, &all)?;
            } else {
                tune(kind, &start, height_m, &some, &all)?;
            }
        }
    }
    Ok(())
}

fn tune(
    kind: BaselineKind,
    start: &BaselineSettings,
    height_m: f64,
    some: &[&[PathSample]],
    all: &[&[PathSample]],
) -> Result<(), Box<dyn std::error::Error>> {
    let mut tried = vec![(*start, open_loop(kind, start, some)?)];
    if kind.smooths_in_the_servo() {
        let mut grid = vec![*start];
        for (_, values) in knobs(kind) {
            grid = grid.iter().flat_map(values).collect();
        }
        for point in grid {
            tried.push((point, open_loop(kind, &point, some)?));
        }
    } else {
        let mut quick = *start;
        quick.otg = OtgKnobs { acceleration_share: 0.0, window_s: 0.031, ..start.otg };
        quick.otg.limits = Limits { acceleration_mps2: 3000.0, jerk_mps3: 1e7, ..start.otg.limits };
        quick.kalman.acceleration_share = 0.0;
        for start in [*start, quick] {
            descend(kind, &start, f64::INFINITY, some, &mut tried)?;
        }
    }
    for budget in BUDGETS {
        let budget = budget * height_m / 0.1;
        if !kind.smooths_in_the_servo() {
            let mut from = least(&tried, budget)?;
            from.otg.intercept = false;
            descend(kind, &from, budget, some, &mut tried)?;
            // Interception costs ten plans a period, so it is tried on the best settings only.
            let mut met = least(&tried, budget)?;
            if kind == BaselineKind::Otg && !met.otg.intercept {
                met.otg.intercept = true;
                tried.push((met, open_loop(kind, &met, some)?));
            }
        }
    }
    println!("\n{kind}, dead time {} ms, {} settings tried", start.dead_time_s * 1e3, tried.len());
    let published = tried.first().map(|(point, _)| (f64::NAN, *point));
    let fronts = BUDGETS.iter().map(|budget| budget * height_m / 0.1);
    let fronts = fronts.map(|budget| least(&tried, budget).map(|point| (budget, point)));
    for row in published.into_iter().map(Ok).chain(fronts) {
        let (budget, point) = row?;
        report(kind, &point, budget, all)?;
    }
    Ok(())
}

fn report(
    kind: BaselineKind,
    settings: &BaselineSettings,
    budget: f64,
    paths: &[&[PathSample]],
) -> Result<(), Box<dyn std::error::Error>> {
    let score = open_loop(kind, settings, paths)?;
    println!(
        "  jerk to {budget:<8} RMS {:.3} mm, pen down {:.3} mm, RMS jerk {:.0} m/s3, {} failures\n    {}",
        score.mse_m2.sqrt() * 1e3,
        score.pen_down_mse_m2.sqrt() * 1e3,
        score.rms_jerk_mps3,
        score.failures,
        describe(kind, settings)
    );
    Ok(())
}

/// Coordinate descent: one knob after another over its grid until nothing improves.
fn descend(
    kind: BaselineKind,
    start: &BaselineSettings,
    budget: f64,
    some: &[&[PathSample]],
    tried: &mut Vec<(BaselineSettings, OpenLoop)>,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut best = (*start, open_loop(kind, start, some)?);
    loop {
        let before = cost(&best.1, budget);
        for (_, values) in knobs(kind) {
            for point in values(&best.0) {
                let known = tried.iter().find(|(known, _)| *known == point).map(|(_, score)| *score);
                let score = known.map_or_else(|| open_loop(kind, &point, some), Ok)?;
                tried.push((point, score));
                if cost(&score, budget) < cost(&best.1, budget) {
                    best = (point, score);
                }
            }
        }
        if cost(&best.1, budget) >= before {
            return Ok(());
        }
    }
}

/// Squared error, and a steep price for more jerk than the budget.
fn cost(score: &OpenLoop, budget: f64) -> f64 {
    score.mse_m2 * (score.rms_jerk_mps3 / budget).max(1.0).powi(4)
}

fn least(
    tried: &[(BaselineSettings, OpenLoop)],
    budget: f64,
) -> Result<BaselineSettings, Box<dyn std::error::Error>> {
    let least = tried.iter().min_by(|a, b| cost(&a.1, budget).total_cmp(&cost(&b.1, budget)));
    least.map(|(point, _)| *point).ok_or_else(|| "nothing was tried".into())
}

fn describe(kind: BaselineKind, settings: &BaselineSettings) -> String {
    match kind {
        BaselineKind::ServojGello | BaselineKind::ServojRos => {
            format!("{:?} {:?} {:?}", settings.servo, settings.feed, settings.one_euro)
        }
        BaselineKind::Otg => format!("{:?}", settings.otg),
        BaselineKind::Kalman => format!("{:?}", settings.kalman),
    }
}

/// `settings` once for every value, each set by `set`.
fn each<T: Copy>(
    settings: &BaselineSettings,
    values: &[T],
    set: impl Fn(&mut BaselineSettings, T),
) -> Vec<BaselineSettings> {
    values
        .iter()
        .map(|value| {
            let mut point = *settings;
            set(&mut point, *value);
            point
        })
        .collect()
}

fn knobs(kind: BaselineKind) -> &'static [Knob] {
    const SERVOJ: &[Knob] = &[
        ("look-ahead", |s| {
            each(s, &[0.03, 0.05, 0.1, 0.15, 0.2], |p, look_ahead_s| p.servo.look_ahead_s = look_ahead_s)
        }),
        ("feed", |s| each(s, &[Feed::Samples, Feed::Periods], |p, feed| p.feed = feed)),
        ("beta", |s| {
            let values = [0.0, 3.0, 10.0, 30.0, 100.0, 1000.0];
            each(s, &values, |p, beta| p.one_euro.beta_hz_per_mps = beta)
        }),
        ("cut-off of speed", |s| each(s, &[1.0, 3.0, 10.0], |p, hz| p.one_euro.speed_cutoff_hz = hz)),
        ("cut-off at rest", |s| each(s, &[0.5, 1.0, 3.0, 10.0, 20.0], |p, hz| p.one_euro.min_cutoff_hz = hz)),
    ];
    const OTG: &[Knob] = &[
        ("window", |s| {
            let values = [0.011, 0.021, 0.031, 0.041, 0.061, 0.081];
            each(s, &values, |p, window_s| p.otg.window_s = window_s)
        }),
        ("acceleration believed", |s| each(s, &[0.0, 0.5, 1.0], |p, share| p.otg.acceleration_share = share)),
        ("longest prediction", |s| {
            each(s, &[0.025, 0.05, f64::INFINITY], |p, most| p.otg.horizon_max_s = most)
        }),
        ("target acceleration", |s| each(s, &[false, true], |p, on| p.otg.target_acceleration = on)),
        ("jerk limit", |s| {
            each(s, &[3e2, 1e3, 3e3, 1e4, 3e4, 1e5, 1e6, 1e7], |p, jerk| p.otg.limits.jerk_mps3 = jerk)
        }),
        ("acceleration limit", |s| {
            each(s, &[20.0, 100.0, 500.0, 3000.0], |p, limit| p.otg.limits.acceleration_mps2 = limit)
        }),
    ];
    const KALMAN: &[Knob] = &[
        ("process noise", |s| {
            let values = [1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0];
            each(s, &values, |p, noise| p.kalman.process_mps2 = noise)
        }),
        ("acceleration believed", |s| {
            each(s, &[0.0, 0.25, 0.5, 0.75, 1.0], |p, share| p.kalman.acceleration_share = share)
        }),
        ("origin", |s| each(s, &[Origin::Measured, Origin::Filtered], |p, origin| p.kalman.origin = origin)),
        ("longest prediction", |s| {
            let values = [0.025, 0.05, 0.075, f64::INFINITY];
            each(s, &values, |p, most| p.kalman.horizon_max_s = most)
        }),
        ("post-filter", |s| {
            let mut points = each(s, &[()], |p, ()| p.kalman.post_filter = None);
            for min_cutoff_hz in [5.0, 20.0, 50.0] {
                points.extend(each(s, &[0.0, 30.0], |p, beta_hz_per_mps| {
                    let knobs = OneEuroKnobs { min_cutoff_hz, beta_hz_per_mps, speed_cutoff_hz: 10.0 };
                    p.kalman.post_filter = Some(PostFilter::OneEuro(knobs));
                }));
            }
            // A servo comes with a longer prediction that compensates for it, wholly or in part.
            for share in [0.25, 0.5, 0.75, 1.0] {
                points.extend(each(s, &[0.005, 0.01, 0.02, 0.03, 0.05, 0.1], |p, look_ahead_s| {
                    p.kalman.post_filter = Some(PostFilter::Servo(look_ahead_s));
                    p.kalman.lead_extra_s = share * look_ahead_s;
                }));
            }
            points
        }),
        ("further", |s| {
            each(s, &[0.0, 0.005, 0.01, 0.02, 0.03, 0.05], |p, extra| p.kalman.lead_extra_s = extra)
        }),
        ("turn rule", |s| each(s, &[false, true], |p, on| p.kalman.turn_rule = on)),
        ("reversal rule", |s| each(s, &[false, true], |p, on| p.kalman.reversal_rule = on)),
    ];
    match kind {
        BaselineKind::ServojGello | BaselineKind::ServojRos => SERVOJ,
        BaselineKind::Otg => OTG,
        BaselineKind::Kalman => KALMAN,
    }
}
