//! The loop measures the lag of simulated arms while it writes: the acceptance figures, with the daemon's own
//! law.

use foretrace_config::Config;
use foretrace_control::arm::lag::Following;
use foretrace_control::follower::{
    Budget, Follower, FollowerSettings, JointReading, NoClock, Request, StepInput, StepOutput,
};
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, DelayChange, DelaySettings, JOINTS};
use foretrace_sim::path::{Layout, PenPath, Placement};
use foretrace_sim::writer::text_path;

/// The pen begins here, the loop a second before \[ns\].
const BEGIN_NS: u64 = 10_000_000_000;
/// Of the preset.
const HORIZON: usize = 20;

fn config() -> Config {
    Config::preset("ur5e").unwrap()
}

fn written(text: &str, seed: u64) -> PenPath {
    let placement = Placement { layout: Layout::Line, ..Placement::default() };
    text_path(text, seed, 200.0, &placement).unwrap()
}

/// Writes `path` with an arm; `see` hears the time since the pen began \[s\], what the loop answered, and the
/// arm's tool and the pen at that moment \[m\].
fn write(
    settings: FollowerSettings<JOINTS>,
    arm: ArmSettings,
    path: &PenPath,
    mut see: impl FnMut(f64, &StepOutput<JOINTS>, [f64; 2], [f64; 2]),
) {
    let period_ns = settings.period_ns;
    let ticks_per_cycle = (arm.cycle_s * 1e9).round() as u64 / period_ns;
    let home = config().robot().home;
    assert_eq!(config().settings().mpc.horizon, HORIZON as u32);
    let first_s = path.samples[0].t_s;
    let stamp = |t_s: f64| Stamp(BEGIN_NS + ((t_s - first_s) * 1e9) as u64);
    let mut follower = Follower::<HORIZON, JOINTS>::new(settings).unwrap();
    let mut model = ArmModel::at_rest(arm, home);
    let mut samples = path.samples.iter().peekable();
    let mut pen = [path.samples[0].x_m, path.samples[0].y_m];
    let mut request = Some(Request::Arm);
    let mut target = home;
    let mut fresh = true;
    for tick in 0_u64.. {
        let now = Stamp(BEGIN_NS - 1_000_000_000 + tick * period_ns);
        let mut due = Vec::new();
        if now.0 < BEGIN_NS {
            due.push(PenReading { stamp: now, position: pen, contact: false, origin: PenOrigin::default() });
        }
        while let Some(sample) = samples.next_if(|sample| stamp(sample.t_s) <= now) {
            pen = [sample.x_m, sample.y_m];
            due.push(PenReading {
                stamp: stamp(sample.t_s),
                position: pen,
                contact: sample.contact,
                origin: PenOrigin::default(),
            });
        }
        if samples.peek().is_none() {
            return;
        }
        let joints = model.joints();
        let reading = JointReading { stamp: now, q: joints.q, qd: joints.qd, motion_allowed: true };
        let joints = fresh.then_some(&reading);
        let input = StepInput { pen: &due, joints, request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        if request.take().is_some() {
            assert_eq!(output.answer, Some(Ok(())));
        }
        let settings = follower.settings();
        let tool = settings.plane.point_from_base(&settings.chain.forward(&model.joints().q).position);
        see(now.seconds_since(Stamp(BEGIN_NS)), &output, [tool.x, tool.y], pen);
        // The controller takes the command that holds when its cycle begins: the one of the tick before.
        fresh = (tick + 1).is_multiple_of(ticks_per_cycle);
        if tick.is_multiple_of(ticks_per_cycle) {
            model.cycle(target);
        }
        target = output.command.unwrap().q;
    }
}

/// Worst error of the estimate \[ms\] from `after` to the end, and its largest standard deviation \[ms\].
fn worst(arm: ArmSettings, texts: &[(&str, u64)], after: f64) -> [f64; 2] {
    let mut found = [0.0_f64; 2];
    for (text, seed) in texts {
        let mut count = 0;
        write(config().follower_settings(), arm, &written(text, *seed), |t, output, _, _| {
            if t >= after {
                let lag = output.lag.expect("five seconds of writing tell");
                let error = lag.lag_s - arm.group_delay_at(t + 1.0);
                found[0] = found[0].max(error.abs() * 1e3);
                found[1] = found[1].max(lag.std_s * 1e3);
                count += 1;
            }
        });
        assert!(count > 100, "{text:?} is too short");
    }
    found
}

const TEXTS: [(&str, u64); 3] = [("Kx4 Rg8 Sy2", 0), ("ANTICIPATE", 1), ("abcdefghijklm", 2)];

#[test]
fn lag_is_found_within_two_milliseconds_after_five_seconds_of_writing() {
    let jitter = DelaySettings { delay_s: 0.03, jitter_s: 0.002, seed: 3, ..DelaySettings::default() };
    let slowed = ArmSettings { speed_scaling: 0.5, ..ArmSettings::ur5(0.002, 0.03) };
    let arms = [
        ("delay 2 ms", ArmSettings::delayed(0.002, 0.002)),
        ("delay 34 ms", ArmSettings::delayed(0.002, 0.034)),
        ("delay 75 ms", ArmSettings::delayed(0.002, 0.075)),
        ("delay 100 ms", ArmSettings::delayed(0.002, 0.100)),
        ("delay 150 ms", ArmSettings::delayed(0.002, 0.150)),
        ("servo 30 ms", ArmSettings::ur5(0.002, 0.030)),
        ("servo 60 ms", ArmSettings::ur5(0.002, 0.060)),
        ("servo 100 ms", ArmSettings::ur5(0.002, 0.100)),
        ("servo 146 ms", ArmSettings::ur5(0.002, 0.146)),
        ("CB3 (125 Hz), servo 30 ms", ArmSettings::ur5(0.008, 0.030)),
        ("servo 30 ms behind 30 ± 2 ms", ArmSettings { delay: jitter, ..ArmSettings::ur5(0.002, 0.030) }),
        ("servo 30 ms at half speed", slowed),
    ];
    for (name, arm) in arms {
        let [error, std] = worst(arm, &TEXTS, 5.0);
        let lag = arm.group_delay_s() * 1e3;
        println!("{name:<30} lag {lag:6.1} ms   worst error {error:5.2} ms   largest std {std:5.2} ms");
        assert!(error < 2.0, "{name}: {error} ms");
        assert!(std < 3.0, "{name}: {std} ms");
    }
}

#[test]
fn a_change_of_the_lag_is_found_within_five_seconds() {
    for (before, after) in [(0.0, 0.066), (0.1, 0.0)] {
        // The arm begins to cycle a second before the pen begins to write.
        let change = DelayChange { at_s: 5.0, delay_s: after };
        let delay = DelaySettings { delay_s: before, change: Some(change), ..DelaySettings::default() };
        let arm = ArmSettings { delay, ..ArmSettings::ur5(0.002, 0.030) };
        let [error, std] = worst(arm, &[("Kx4 Rg8 Sy2", 0), ("ANTICIPATION", 1)], 9.0);
        println!("delay {before} s to {after} s: worst error {error:.2} ms, std {std:.2} ms");
        assert!(error < 2.0, "{before} to {after}: {error} ms");
    }
}

#[test]
fn behind_a_slow_servo_following_the_shift_costs_who_foresees_badly_less_than_its_group_delay() {
    let arm = ArmSettings::ur5(0.002, 0.1);
    let mse = |kind: PredictorKind, following: Following| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (text, seed) in
            TEXTS.iter().flat_map(|(text, seed)| [0, 10, 20, 30].map(|more| (*text, seed + more)))
        {
            let mut settings = config().follower_settings();
            settings.preview.kind = kind;
            settings.dead_time_ns = (arm.group_delay_s() * 1e9) as u64;
            settings.following = following;
            crate::paper_law::set(&mut settings);
            write(settings, arm, &written(text, seed), |t, _, tool, pen| {
                if t >= 4.0 {
                    sum += (tool[0] - pen[0]).powi(2) + (tool[1] - pen[1]).powi(2);
                    count += 1.0;
                }
            });
        }
        sum / count
    };
    // A predictor that goes on straight loses accuracy with every millisecond of lead that the arm, a filter,
    // did not need. One that turns with the pen loses little by it.
    for (kind, legal) in [(PredictorKind::CONSTANT_VELOCITY, 0.0..0.8), (PredictorKind::MIXTURE, 0.9..1.0)] {
        let fixed = mse(kind, Following::Fixed);
        let follows = mse(kind, Following::Measured { max_ns: 150_000_000, rate: 0.02 });
        println!("{kind:?}: at the group delay {fixed:.3e} m², following the shift {follows:.3e} m²");
        assert!(legal.contains(&(follows / fixed)), "{kind:?}: {follows:e} {fixed:e}");
    }
}
