//! Guarantees of the whole step, tested from outside.

use crate::support;

use crate::support::{Bench, PERIOD_NS, STEP_NS, settings};
use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::follower::{
    Budget, EnableReading, Health, JointReading, Mode, Refusal, Request, Rung, StepInput, StepOutput,
};
use foretrace_control::guard::{Commanded, consumer_state};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{Oracle, PredictorKind};
use foretrace_control::stop::StopReason;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::{Stamp, Trust};

/// A smooth written-like curve of about 3 cm, 1.7 and 2.9 Hz.
fn curve(t: f64) -> [f64; 2] {
    [0.015 * (10.7 * t).sin(), 0.012 * (18.2 * t + 0.4).sin()]
}

/// Runs `seconds` of the curve at 200 Hz; returns the RMS distance of tool and pen at the same instant, after
/// 1 s.
fn follow(bench: &mut Bench, seconds: f64) -> f64 {
    let start = bench.now;
    let (mut sum, mut count) = (0.0, 0);
    let ticks = (seconds * 1e9 / PERIOD_NS as f64) as u64;
    for tick in 0..ticks {
        let t = bench.now.seconds_since(start);
        let due = tick % 5 == 0 || tick % 5 == 3;
        let samples = [bench.pen(curve(t))];
        let output = bench.tick(if due { &samples } else { &[] });
        let command = output.command.unwrap();
        let [x, y] = curve(command.stamp.seconds_since(start));
        if t > 1.0 {
            sum += (output.tool[0] - x).powi(2) + (output.tool[1] - y).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

fn oracle_from(start: Stamp, seconds: f64) -> Oracle {
    let first = start.0 / STEP_NS;
    let steps = (seconds * 1e9 / STEP_NS as f64) as u64 + 100;
    let at = |index: u64| curve(((index * STEP_NS) as f64 - start.0 as f64) * 1e-9);
    let path = (0..steps).map(|i| {
        let ([x0, y0], [x1, y1]) = (at(first + i), at(first + i + 1));
        [x1 - x0, y1 - y0]
    });
    Oracle::new(first + 1, path.collect())
}

#[test]
fn no_command_leaves_before_arming() {
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    for _ in 0..50 {
        let pen = bench.pen([0.0, 0.0]);
        let output = bench.tick(&[pen]);
        assert_eq!((output.command, output.mode), (None, Mode::Idle));
    }
}

#[test]
fn the_first_command_is_where_the_arm_stands() {
    let bench = Bench::armed(settings(PredictorKind::HOLD));
    let command = bench.last.unwrap();
    assert_eq!(command.q, support::HOME);
    assert_eq!(command.qd, [0.0; 6]);
}

#[test]
fn every_arming_begins_a_stream_of_its_own() {
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    for _ in 0..3 {
        let pen = bench.pen([0.0, 0.0]);
        let armed = bench.tick_with(&[pen], Some(Request::Arm), Budget::default());
        assert_eq!(armed.answer, Some(Ok(())));
        assert!(armed.command.is_some() && armed.begins);
        let after = bench.tick(&[pen]);
        assert!(after.command.is_some() && !after.begins);
        bench.tick_with(&[], Some(Request::Disarm), Budget::default());
        for _ in 0..500 {
            bench.tick(&[]);
        }
    }
}

#[test]
fn prediction_beats_feedback_and_the_oracle_beats_both() {
    let mut rms = Vec::new();
    let mut feedback = settings(PredictorKind::HOLD);
    feedback.trust_request = TrustRequest::Manual(Trust::NONE);
    rms.push(follow(&mut Bench::armed(feedback), 6.0));
    for kind in [PredictorKind::CONSTANT_VELOCITY, PredictorKind::DYBM] {
        rms.push(follow(&mut Bench::armed(settings(kind)), 6.0));
    }
    let mut bench = Bench::armed(settings(PredictorKind::HOLD));
    bench.follower.use_oracle(oracle_from(bench.now, 6.0));
    rms.push(follow(&mut bench, 6.0));
    println!(
        "RMS [mm] feedback only, constant velocity, DyBM prior, oracle: {:?}",
        rms.iter().map(|r| r * 1e3).collect::<Vec<_>>()
    );
    assert!(rms[1] < 0.25 * rms[0] && rms[2] < 0.25 * rms[0] && rms[3] < 0.5 * rms[1], "{rms:?}");
    assert!(rms[3] < 3e-4, "oracle leaves {} m", rms[3]);
}

#[test]
fn trust_ramps_without_a_step_in_the_commands() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    let start = bench.now;
    let mut last = 0.0;
    for tick in 0..2000u64 {
        let t = bench.now.seconds_since(start);
        let samples = [bench.pen(curve(t))];
        let request = (tick == 1000).then_some(Request::SetTrust(0.0));
        let due = tick % 5 == 0 || tick % 5 == 3;
        let output = bench.tick_with(if due { &samples } else { &[] }, request, Budget::default());
        let alpha = output.trust.alpha.alpha();
        // Ten steps of five ticks each.
        assert!((alpha - last).abs() <= 1.0 / 50.0 + 1e-12, "trust jumped from {last} to {alpha}");
        last = alpha;
    }
    assert_eq!(last, 0.0);
}

#[test]
fn a_silent_pen_ends_in_a_smooth_hold_and_its_return_resumes() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    follow(&mut bench, 2.0);
    let mut output = bench.tick(&[]);
    for _ in 0..500 {
        output = bench.tick(&[]);
    }
    assert_eq!(output.mode, Mode::Holding);
    assert_eq!(output.trust.alpha.alpha(), 0.0);
    assert!(output.health.has(Health::PEN_STALE));
    let speed = output.command.unwrap().qd.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    assert!(speed < 1e-3, "still moving at {speed} rad/s one second after the last sample");
    follow(&mut bench, 2.0);
    assert_eq!(bench.tick(&[]).mode, Mode::Following);
}

/// A device whose clock runs slow falls behind by 0.3 s per second.
#[test]
fn stamps_that_fall_behind_end_in_one_hold_and_do_not_flap() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    follow(&mut bench, 1.0);
    let begin = bench.now;
    let (mut mode, mut changes) = (Mode::Following, 0);
    for tick in 0..1500 {
        let elapsed = bench.now.seconds_since(begin);
        let mut pen = bench.pen([0.01 * elapsed.sin(), 0.0]);
        pen.stamp = begin.plus_ns((elapsed * 0.7e9) as u64);
        let output = bench.tick(if tick % 3 == 0 { std::slice::from_ref(&pen) } else { &[] });
        changes += u32::from(output.mode != mode);
        mode = output.mode;
    }
    assert_eq!((mode, changes), (Mode::Holding, 1));
}

/// Behind a network every sample is old. Silence counts from when it came.
#[test]
fn a_pen_that_is_old_when_it_comes_is_followed_unless_it_is_far_too_old() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    let start = bench.now;
    // Modes seen over 2 s of samples of this age, and no more samples in the last 120 ms.
    let mut told = |age_ms: u64| {
        let mut modes = Vec::new();
        for tick in 0..1000 {
            let stamp = Stamp(bench.now.0 - age_ms * 1_000_000);
            let pen = PenReading::new(stamp, curve(stamp.seconds_since(start)), true);
            let due = (tick % 5 == 0 || tick % 5 == 3) && tick < 940;
            modes.push(bench.tick(if due { std::slice::from_ref(&pen) } else { &[] }).mode);
        }
        modes.dedup();
        modes
    };
    assert_eq!(told(100), [Mode::Armed], "too old to begin with");
    assert_eq!(told(55), [Mode::Following], "175 ms old in the end, but silent for 120 ms only");
    assert_eq!(told(110), [Mode::Following], "too old for trust, but it comes");
    assert_eq!(told(140), [Mode::Holding]);
    assert_eq!(told(110), [Mode::Holding], "no flapping about the bound");
    assert_eq!(told(55), [Mode::Following]);
}

#[test]
fn shedding_falls_back_to_the_previous_plan_then_stops_then_recovers() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    follow(&mut bench, 2.0);
    let shed = Budget { shed: true, ..Budget::default() };
    let rungs: Vec<_> = (0..400).map(|_| bench.tick_with(&[], None, shed).rung).collect();
    assert_eq!(rungs[0], Rung::PreviousPlan);
    let stop = rungs.iter().position(|rung| *rung == Rung::Stop).unwrap();
    assert_eq!(stop as u64, 50_000_000 / PERIOD_NS - 1, "50 ms of the previous plan, counted from its start");
    assert_eq!(*rungs.last().unwrap(), Rung::Hold);
    let rms = follow(&mut bench, 3.0);
    assert!(rms < 3e-3, "after recovery the tool is {rms} m away");
}

#[test]
fn every_latched_stop_comes_to_rest_and_needs_arming_again() {
    let disturb: [(&str, StopReason, Mode); 3] = [
        ("request", StopReason::Requested, Mode::Stopped),
        ("joints", StopReason::JointStateLost, Mode::Stopped),
        ("safety", StopReason::ArmSafety, Mode::Fault),
    ];
    for (what, reason, mode) in disturb {
        let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
        follow(&mut bench, 1.5);
        let mut output = None;
        for tick in 0..300 {
            let pen = [bench.pen(curve(1.5 + tick as f64 * 0.002))];
            bench.joints.motion_allowed = what != "safety";
            output = Some(match what {
                "joints" => {
                    bench.step(&StepInput { pen: &pen, ..StepInput::nothing(bench.now) }, Budget::default())
                }
                _ => bench.tick_with(
                    &pen,
                    (what == "request" && tick == 0).then_some(Request::Stop),
                    Budget::default(),
                ),
            });
        }
        let output = output.unwrap();
        assert_eq!((output.mode, output.stop_reason), (mode, reason), "{what}");
        assert_eq!(output.rung, Rung::Hold);
        let command = output.command.unwrap();
        assert_eq!(command.qd, [0.0; 6]);
        assert!(!command.enabled);
        bench.joints.motion_allowed = true;
        let again = bench.tick_with(&[], Some(Request::Arm), Budget::default());
        assert_eq!(again.answer, Some(Ok(())), "{what}");
        follow(&mut bench, 1.0);
    }
}

#[test]
fn disarming_stops_first_and_then_lets_go() {
    let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
    follow(&mut bench, 1.5);
    let mut output = bench.tick_with(&[], Some(Request::Disarm), Budget::default());
    assert_eq!(output.mode, Mode::Stopped);
    let mut ticks = 0;
    while output.mode != Mode::Idle {
        output = bench.tick(&[]);
        ticks += 1;
        assert!(ticks < 500);
    }
    assert_eq!(bench.tick(&[]).command, None);
}

#[test]
fn arming_refuses_what_could_jump() {
    type Case = (Refusal, fn(&mut Bench));
    let refusals: [Case; 5] = [
        (Refusal::MotionNotAllowed, |bench| bench.joints.motion_allowed = false),
        (Refusal::ArmMoves, |bench| bench.joints.qd[2] = 0.2),
        (Refusal::OutsideJointLimits, |bench| bench.joints.q[5] = 7.0),
        (Refusal::ToolOutsideWorkspace, |bench| bench.joints.q[0] += 1.0),
        (Refusal::ToolNotAligned, |bench| bench.joints.q[4] += 0.5),
    ];
    for (refusal, prepare) in refusals {
        let mut bench = Bench::new(settings(PredictorKind::HOLD));
        prepare(&mut bench);
        let output = bench.tick_with(&[], Some(Request::Arm), Budget::default());
        assert_eq!(output.answer, Some(Err(refusal)));
        assert_eq!(output.command, None);
    }
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    let input = StepInput { request: Some(Request::Arm), ..StepInput::nothing(bench.now) };
    assert_eq!(bench.step(&input, Budget::default()).answer, Some(Err(Refusal::NoJointState)));
    let old = bench.joints;
    bench.now = bench.now + 200_000_000;
    let input =
        StepInput { request: Some(Request::Arm), joints: Some(&old), ..StepInput::nothing(bench.now) };
    assert_eq!(bench.step(&input, Budget::default()).answer, Some(Err(Refusal::JointStateStale)));
}

/// The state of an arm that is gone must not be used for the next one, which may stand elsewhere, however
/// patient the loop is with an arm in charge.
#[test]
fn the_last_word_of_an_arm_that_is_gone_arms_nothing() {
    let mut patient = settings(PredictorKind::HOLD);
    patient.safety.joint_state_timeout_ns = 500_000_000;
    // The arm sends every 8 ms, then is silent for `silent_ns`; the answer to a request to arm.
    let asked_after = |silent_ns: u64| {
        let mut bench = Bench::new(patient.clone());
        for _ in 0..5 {
            bench.now = bench.now + 8_000_000;
            bench.joints.stamp = bench.now;
            let joints = bench.joints;
            let input = StepInput { joints: Some(&joints), ..StepInput::nothing(bench.now) };
            bench.step(&input, Budget::default());
        }
        bench.now = bench.now + silent_ns;
        let input = StepInput { request: Some(Request::Arm), ..StepInput::nothing(bench.now) };
        (bench.step(&input, Budget::default()).answer, bench)
    };
    assert_eq!(asked_after(16_000_000).0, Some(Ok(())));
    let (answer, mut bench) = asked_after(40_000_000);
    assert_eq!(answer, Some(Err(Refusal::JointStateStale)));
    // The next arm stands elsewhere, and is armed there.
    bench.now = bench.now + 8_000_000;
    (bench.joints.stamp, bench.joints.q[0]) = (bench.now, bench.joints.q[0] + 0.01);
    let joints = bench.joints;
    let input =
        StepInput { joints: Some(&joints), request: Some(Request::Arm), ..StepInput::nothing(bench.now) };
    let output = bench.step(&input, Budget::default());
    assert_eq!(output.answer, Some(Ok(())));
    assert_eq!(output.command.unwrap().q, joints.q);
}

#[test]
fn a_short_stall_is_caught_up_with_and_a_long_one_latches() {
    for (stall_ns, mode) in
        [(6_000_000, Mode::Following), (40_000_000, Mode::Following), (300_000_000, Mode::Stopped)]
    {
        let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
        follow(&mut bench, 1.5);
        bench.now = bench.now + stall_ns;
        let pen = [bench.pen(curve(1.5))];
        let output = bench.tick(&pen);
        assert!(output.health.has(Health::TIME_LOST | Health::RESYNCHRONISED));
        assert_eq!(output.mode, mode, "after {stall_ns} ns");
        for _ in 0..100 {
            bench.tick(&[]);
        }
    }
}

/// A step that is held up until its command is over sends nothing: consumers went on by the one before.
#[test]
fn after_a_command_that_was_not_sent_the_arm_goes_on_from_the_one_before() {
    let settings = settings(PredictorKind::CONSTANT_VELOCITY);
    let decel = *settings.limits.deceleration();
    for stall_ns in [0, 6_000_000, 40_000_000, 600_000_000] {
        let mut bench = Bench::armed(settings.clone());
        follow(&mut bench, 1.5);
        let sent = bench.last.unwrap();
        assert!(sent.qd.iter().any(|qd| qd.abs() > 0.05), "{sent:?}");
        let pen = [bench.pen(curve(1.5))];
        let held_up = StepInput { pen: &pen, ..StepInput::nothing(bench.now) };
        let lost = bench.withhold(&held_up, Budget::default()).command.unwrap();
        assert_ne!(lost.q, sent.q);
        bench.now = bench.now + stall_ns;
        let motion = JointMotion { q: sent.q, qd: sent.qd, qdd: [0.0; 6] };
        let arm = |now| {
            let command = Commanded::new(sent.stamp, motion).unwrap();
            consumer_state(&command, sent.valid_until, &decel, now)
        };
        let reading = JointReading { stamp: bench.now, q: arm(bench.now).q, ..bench.joints };
        let input = StepInput { joints: Some(&reading), ..StepInput::nothing(bench.now) };
        // The bench's checker never saw the lost command: what follows is continuous for consumers, too.
        let output = bench.step(&input, Budget::default());
        assert!(output.health.has(Health::TIME_LOST));
        if stall_ns > 200_000_000 {
            assert_eq!(output.stop_reason, StopReason::TimeLost);
            let rests = arm(bench.now).q;
            let command = output.command.unwrap();
            let moved = command.q.iter().zip(&rests).map(|(a, b)| (a - b).abs());
            assert!(moved.fold(0.0, f64::max) < 1e-12, "it stands where it stood");
        }
        for _ in 0..100 {
            bench.tick(&[]);
        }
    }
}

#[test]
fn the_first_command_that_is_sent_begins() {
    let mut bench = Bench::new(settings(PredictorKind::CONSTANT_VELOCITY));
    let joints = bench.joints;
    let arm =
        StepInput { joints: Some(&joints), request: Some(Request::Arm), ..StepInput::nothing(bench.now) };
    let lost = bench.withhold(&arm, Budget::default());
    assert!(lost.begins && lost.answer == Some(Ok(())));
    let joints = JointReading { stamp: bench.now, ..joints };
    let input = StepInput { joints: Some(&joints), ..StepInput::nothing(bench.now) };
    assert!(bench.withhold(&input, Budget::default()).begins);
    assert!(bench.tick(&[]).begins);
    assert!(!bench.tick(&[]).begins);
    follow(&mut bench, 1.5);
}

/// Where joints cannot do what is planned, the next plan must begin with their velocity at that time, which
/// differs by half a step's acceleration from the mean velocity that their positions imply.
#[test]
fn a_plan_begins_with_the_velocity_that_limited_joints_have() {
    let mut slow = settings(PredictorKind::HOLD);
    let tau = std::f64::consts::TAU;
    slow.limits = JointLimits::new([[-tau, tau]; 6], [3.0; 6], [18.0; 6]).unwrap();
    let mut bench = Bench::armed(slow);
    let period_s = PERIOD_NS as f64 * 1e-9;
    let mut ticks = Vec::new();
    for tick in 0..1000u32 {
        // Two places 4.5 cm apart that are jumped to in turn.
        let at = if tick < 500 { [0.0, 0.0] } else { [0.04, 0.02].map(|x| x * f64::from(tick / 60 % 2)) };
        let output = bench.tick(&[bench.pen(at)]);
        let [x, y, _] = output.setpoint.map(|axis| axis.velocity);
        ticks.push((output.tool, [x, y], output.health.has(Health::IK_LIMITED)));
    }
    let (mut off, mut half_step, mut count) = (0.0, 0.0, 0);
    for around in ticks.windows(3).skip(500).filter(|around| around[1].2) {
        let [(before, ..), (here, begins, _), (after, ..)] = around else { unreachable!() };
        for axis in 0..2 {
            let [came, goes] =
                [here[axis] - before[axis], after[axis] - here[axis]].map(|way| way / period_s);
            off += (begins[axis] - 0.5 * (came + goes)).powi(2);
            half_step += (0.5 * (goes - came)).powi(2);
        }
        count += 1;
    }
    println!(
        "{count} limited steps; velocity off by {:.3} of half a step's acceleration",
        (off / half_step).sqrt()
    );
    assert!(count > 50, "only {count} steps were limited");
    assert!(off < 0.3 * 0.3 * half_step, "off by {} of {}", off.sqrt(), half_step.sqrt());
}

#[test]
fn the_same_inputs_give_the_same_commands_bit_for_bit() {
    let run = || {
        let mut bench = Bench::armed(settings(PredictorKind::DYBM));
        follow(&mut bench, 2.0);
        bench.last.unwrap().q.map(f64::to_bits)
    };
    assert_eq!(run(), run());
}

/// One tick with a dead-man message.
fn tick_enabled(bench: &mut Bench, stop: Option<bool>, request: Option<Request>) -> StepOutput<6> {
    bench.joints.stamp = bench.now;
    let joints = bench.joints;
    let pen = [bench.pen([0.0, 0.0])];
    let enable = stop.map(|stop| EnableReading { stamp: bench.now, stop });
    let input =
        StepInput { pen: &pen, joints: Some(&joints), enable, request, ..StepInput::nothing(bench.now) };
    bench.step(&input, Budget::default())
}

#[test]
fn a_dead_man_that_was_held_stops_the_arm_when_it_falls_silent() {
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    tick_enabled(&mut bench, Some(false), Some(Request::Arm));
    for _ in 0..40 {
        assert_eq!(tick_enabled(&mut bench, Some(false), None).mode, Mode::Following);
    }
    // 100 ms of silence, then a stop.
    let modes: Vec<_> = (0..60).map(|_| tick_enabled(&mut bench, None, None)).collect();
    assert_eq!(modes[40].mode, Mode::Following);
    assert_eq!((modes[59].mode, modes[59].stop_reason), (Mode::Stopped, StopReason::EnableLost));
}

#[test]
fn a_stop_from_the_dead_man_counts_even_if_it_was_never_held() {
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    tick_enabled(&mut bench, None, Some(Request::Arm));
    tick_enabled(&mut bench, None, None);
    let output = tick_enabled(&mut bench, Some(true), None);
    assert_eq!((output.mode, output.stop_reason), (Mode::Stopped, StopReason::EnableLost));
    for _ in 0..100 {
        tick_enabled(&mut bench, None, None);
    }
    let refused = tick_enabled(&mut bench, None, Some(Request::Arm));
    assert_eq!(refused.answer, Some(Err(Refusal::EnableMissing)));
    let armed = tick_enabled(&mut bench, Some(false), Some(Request::Arm));
    assert_eq!(armed.answer, Some(Ok(())));
}

#[test]
fn where_the_dead_man_is_required_nothing_arms_without_it() {
    let mut settings = settings(PredictorKind::HOLD);
    settings.safety.enable_required = true;
    let mut bench = Bench::new(settings);
    let refused = tick_enabled(&mut bench, None, Some(Request::Arm));
    assert_eq!((refused.answer, refused.command), (Some(Err(Refusal::EnableMissing)), None));
    assert_eq!(tick_enabled(&mut bench, Some(false), Some(Request::Arm)).answer, Some(Ok(())));
}
