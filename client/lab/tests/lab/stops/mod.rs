//! Stops in mid stroke, in lock-step with an arm behind its servo: the tip does not go into the paper, and
//! the arm rests hardly later than if every joint braked by itself.
//!
//! Figures: `cargo test -p foretrace-lab --test lab stops:: -- --nocapture`.

mod bench;

use foretrace_config::{Config, Draft};
use foretrace_control::follower::{Budget, Request};
use foretrace_control::stop::StopReason;
use foretrace_sim::data::{DataSet, Split, median_glyph_height};
use foretrace_sim::path::{Ink, Layout, PathSample, PenPath, Placement};
use foretrace_sim::writer::text_path;

use crate::shared::shared;
use bench::{End, Moment, Stop, Trial, write};

/// Texts of the built-in writer, each in a hand of its own, and stops in each.
const PENS: [&str; 5] = ["hello", "Wxyz", "egg", "Ajk4", "mOr8"];
const TIMES: usize = 5;

/// Below the lower of the pressing depth and the tip's height when the stop came \[m\].
const BELOW_M: f64 = 1e-4;
/// The arm later at rest, and the command later at the very end of its motion, than without the path \[s\].
const LATER_S: f64 = 0.020;
/// The same for joints whose jerk limit makes every stop half as long again, and for recorded hands.
const LATER_AT_WORST_S: f64 = 0.025;
const LATER_END_S: f64 = 0.060;
/// The worst distance from the line, as a share of what it is without the path.
const OFF_SHARE: f64 = 0.75;
const LITTLE_JERK: &str = "ur5e, joints with little jerk";
const ROUNDING: f64 = 1e-9;

fn placement(config: &Config) -> Placement {
    let [x, y, _] = config.settings().plane.workspace_m;
    Placement {
        centre_m: [0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])],
        size_m: [x[1] - x[0], y[1] - y[0]],
        layout: Layout::Line,
        ..Placement::default()
    }
}

fn texts(config: &Config) -> Vec<Vec<PathSample>> {
    let path = |(seed, text): (u64, &&str)| text_path(text, seed, 200.0, &placement(config)).unwrap().samples;
    (1..).zip(&PENS).map(path).collect()
}

/// Picks the first moment in every fifth of `path` that looks right.
fn five(path: &[PathSample], looks: fn(&Moment) -> bool) -> impl FnMut(&Moment) -> bool {
    let (first, last) = (path[0].t_s, path[path.len() - 1].t_s);
    let mut count = 0;
    move |moment: &Moment| {
        let due = first + (last - first) * (count as f64 + 0.4) / TIMES as f64;
        let picked = count < TIMES && moment.t_s >= due && looks(moment);
        count += usize::from(picked);
        picked
    }
}

/// The trials at five moments on each of `paths`.
fn stops(
    config: &Config,
    paths: &[Vec<PathSample>],
    trials: &[Trial],
    looks: fn(&Moment) -> bool,
) -> Vec<Stop> {
    paths.iter().flat_map(|path| write(config, path, trials, five(path, looks))).collect()
}

/// On the paper, in a stroke.
fn writes(moment: &Moment) -> bool {
    moment.contact && moment.above_m < 3e-4 && moment.velocity.xy().norm() > 0.05
}

/// Coming down onto it.
fn lands(moment: &Moment) -> bool {
    moment.velocity.z < -0.03 && (3e-4..3e-3).contains(&moment.above_m)
}

/// Worst cases: depths \[mm\] by the law, without its path, in silence and by a UR's program; off the line
/// \[mm\]; rest.
#[derive(Debug, Clone, Copy)]
struct Worst {
    below_mm: [f64; 4],
    off_line_mm: [f64; 2],
    later_s: f64,
    arm_later_s: f64,
    end_later_s: f64,
    jerk: f64,
    lost: u32,
}

fn worst(name: &str, stops: &[Stop]) -> Worst {
    let most = |of: &dyn Fn(&Stop) -> f64| stops.iter().map(of).fold(f64::NEG_INFINITY, f64::max);
    let ways = |stop: &Stop| [stop.law, stop.without, stop.silent, stop.program];
    let below = |way: usize| most(&|stop: &Stop| 1e3 * (stop.floor_m() - ways(stop)[way].lowest_m));
    let worst = Worst {
        below_mm: [0, 1, 2, 3].map(below),
        off_line_mm: [0, 1].map(|way| most(&|stop: &Stop| 1e3 * ways(stop)[way].off_line_m)),
        later_s: most(&|stop: &Stop| stop.law.rest_s - stop.without.rest_s),
        arm_later_s: most(&|stop: &Stop| stop.law.arm_rest_s - stop.without.arm_rest_s),
        end_later_s: most(&|stop: &Stop| stop.law.end_s - stop.without.end_s),
        jerk: most(&|stop: &Stop| stop.law.jerk),
        lost: stops.iter().map(|stop| stop.law.lost).sum(),
    };
    let Worst { below_mm: [law, without, silent, program], off_line_mm: [off, off_without], .. } = worst;
    println!(
        "{name}: {} stops; below {law:.3} mm, without the path {without:.2}, silence {silent:.2}, a UR's \
         program {program:.2}; off the line {off:.1} mm, without {off_without:.1}; rests after {:.0} ms at \
         most, {:.0} later, the arm {:.0} later, ends {:.0} later; {:.2} of the jerk; {} lost",
        stops.len(),
        1e3 * most(&|stop: &Stop| stop.law.rest_s),
        1e3 * worst.later_s,
        1e3 * worst.arm_later_s,
        1e3 * worst.end_later_s,
        worst.jerk,
        worst.lost,
    );
    worst
}

impl Worst {
    fn keeps_the_paper(&self) {
        self.keeps_the_paper_within(LATER_S);
    }

    fn keeps_the_paper_within(&self, later_s: f64) {
        let [law, ..] = self.below_mm;
        assert!(law <= 1e3 * BELOW_M, "{self:?}");
        assert!(self.arm_later_s <= later_s + ROUNDING, "{self:?}");
        assert!(self.end_later_s <= LATER_END_S + ROUNDING && self.lost == 0, "{self:?}");
    }
}

fn configs() -> Vec<(&'static str, Config)> {
    let jerk = "[1500.0, 1500.0, 1500.0, 1500.0, 1500.0, 1500.0]";
    let deep = "[[-0.15, 0.15], [-0.1, 0.1], [-0.0015, 0.06]]";
    let pressing = Draft::preset("ur5e").set("plane.workspace_m", deep).set("plane.press_m", "0.001");
    vec![
        ("ur5e", Config::preset("ur5e").unwrap()),
        ("ur5", Config::preset("ur5").unwrap()),
        ("ur5e at 125 Hz", Draft::preset("ur5e").rate(125).finish().unwrap()),
        (LITTLE_JERK, Draft::preset("ur5e").set("robot.jerk_radps3", jerk).finish().unwrap()),
        ("ur5e, pressing 1 mm", pressing.finish().unwrap()),
    ]
}

#[test]
fn a_stop_in_mid_stroke_does_not_go_into_the_paper_nor_does_one_while_the_pen_lands() {
    let mut of_configs = Vec::new();
    for (name, config) in configs() {
        let path = |path: &Vec<PathSample>| {
            let (mut in_stroke, mut landing) = (five(path, writes), five(path, lands));
            write(&config, path, &[Trial::default()], |moment| in_stroke(moment) | landing(moment))
        };
        let all: Vec<_> = texts(&config).iter().flat_map(path).collect();
        let (landing, writing): (Vec<_>, Vec<_>) = all.into_iter().partition(|stop| lands(&stop.moment));
        assert!(writing.len() == PENS.len() * TIMES && landing.len() > 20, "{name}: {}", landing.len());
        of_configs.push((name, worst(&format!("{name}, landing"), &landing), worst(name, &writing)));
    }
    for (name, landing, worst) in of_configs {
        landing.keeps_the_paper();
        worst.keeps_the_paper_within(if name == LITTLE_JERK { LATER_AT_WORST_S } else { LATER_S });
        // What the rows are for: else half of the envelope's margin is all that holds the tip.
        let ([_, without, silent, program], [off, off_without]) = (worst.below_mm, worst.off_line_mm);
        assert!(without > 0.9 && silent > 1.0 && program > 0.5, "{name}: {worst:?}");
        // The line is kept where that costs no time.
        assert!(off < OFF_SHARE * off_without && worst.jerk < 1.0 + 1e-6, "{name}: {worst:?}");
    }
}

/// As fast down as across: braking needs its way, but less than there is.
#[test]
fn a_pen_that_lands_as_fast_as_it_writes_is_caught_too() {
    let mut hurried = Draft::preset("ur5e");
    for (key, value) in [("velocity_mps", "0.8"), ("acceleration_mps2", "36.0"), ("jerk_mps3", "16000.0")] {
        hurried = hurried.set(&format!("mpc.limits.z.{key}"), value);
    }
    let config = hurried.finish().unwrap();
    let all = stops(&config, &texts(&config), &[Trial::default()], lands);
    assert!(all.len() > 20, "{}", all.len());
    let worst = worst("ur5e, landing as fast as it writes", &all);
    assert!(worst.below_mm[0] <= 1e3 * BELOW_M, "{worst:?}");
}

/// A pen that circles half off the paper, so that the tool's envelope holds it.
#[test]
fn a_stop_at_the_edge_of_the_paper_keeps_it_too() {
    let config = Config::preset("ur5e").unwrap();
    let circle = |speed: f64| -> Vec<PathSample> {
        let at = |k: u32| (f64::from(k) * 0.005, speed * f64::from(k) * 0.005 / 0.08);
        let sample = |(t_s, angle): (f64, f64)| PathSample {
            t_s,
            x_m: 0.08 * angle.cos(),
            y_m: 0.06 + 0.08 * angle.sin(),
            contact: t_s > 0.3,
        };
        (0..800).map(at).map(sample).collect()
    };
    let paths: Vec<_> = [0.2, 0.3, 0.4, 0.6].map(circle).into();
    let all = stops(&config, &paths, &[Trial::default()], |moment| writes(moment) && moment.tip.y > 0.097);
    assert!(all.len() > 10, "{}", all.len());
    let worst = worst("ur5e, at the edge", &all);
    assert!(worst.below_mm[0] <= 1e3 * BELOW_M, "{worst:?}");
}

#[test]
fn recorded_hands_are_stopped_on_the_paper() {
    let Some(shared) = shared() else { return };
    for set in ["unipen-ced", "unipen-tos", "pendigits-orig", "character-trajectories"] {
        let recorded = DataSet::load(&shared.join("data").join(set), &Split::test(), false).unwrap();
        for preset in ["ur5e", "ur5"] {
            let config = Config::preset(preset).unwrap();
            let median_height = median_glyph_height(recorded.characters()).unwrap();
            let path = |file: &foretrace_sim::data::SetFile| {
                let characters: Vec<_> = file.recording.segments.iter().take(6).cloned().collect();
                let ink = Ink { characters: &characters, rate_hz: file.recording.rate_hz, median_height };
                PenPath::from_ink(ink, &placement(&config)).unwrap().0.samples
            };
            let paths: Vec<_> = recorded.files.iter().take(5).map(path).collect();
            let all = stops(&config, &paths, &[Trial::default()], writes);
            assert!(all.len() >= 5, "{set}: {}", all.len());
            worst(&format!("{set} on {preset}"), &all).keeps_the_paper_within(LATER_AT_WORST_S);
        }
    }
}

/// Whoever stops the arm, the commands are the same.
#[test]
fn every_kind_of_stop_keeps_the_paper() {
    let config = Config::preset("ur5e").unwrap();
    let paths = &texts(&config)[..2];
    let halted = [
        StopReason::Overruns,
        StopReason::TrackingError,
        StopReason::Envelope,
        StopReason::TimeLost,
        StopReason::JointStateLost,
    ];
    let kinds =
        [End::Asked(Request::Stop), End::Asked(Request::Disarm), End::DeadManReleased, End::ArmSafety];
    let ends: Vec<_> = kinds.into_iter().chain(halted.map(End::Halted)).collect();
    let trials: Vec<_> = ends.iter().map(|end| Trial { end: *end, ..Trial::default() }).collect();
    let all = stops(&config, paths, &trials, writes);
    assert_eq!(all.len(), paths.len() * TIMES * trials.len());
    for of_a_moment in all.chunks(trials.len()) {
        for (stop, end) in of_a_moment.iter().zip(&ends) {
            assert_eq!(stop.law, of_a_moment[0].law, "{end:?} at {:?}", stop.moment);
        }
    }
    worst("any reason", &all).keeps_the_paper();
}

#[test]
fn a_stop_without_time_to_solve_brakes_joint_by_joint_and_says_so() {
    let config = Config::preset("ur5e").unwrap();
    let shed = Trial { budget: Budget { shed: true, ..Budget::default() }, ..Trial::default() };
    let all = stops(&config, &texts(&config), &[shed], writes);
    let worst = worst("ur5e, shed", &all);
    let [law, without, ..] = worst.below_mm;
    assert!((law - without).abs() < 0.05 && law > 0.9, "{worst:?}");
    for stop in all {
        assert!(stop.law.rest_s <= stop.without.rest_s + ROUNDING, "{:?}", stop.moment);
        assert!(stop.law.lost > 0, "{:?}", stop.moment);
    }
}
