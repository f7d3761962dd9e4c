//! Trust and governor behind a saturated arm, tested through the whole step.

use crate::support::writing::{curve, oracle, scribble, write};
use crate::support::{Bench, PERIOD_NS, settings};
use foretrace_control::arm::JointLimits;
use foretrace_control::follower::{Budget, Follower, FollowerError, FollowerSettings, Request, StepOutput};
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::{Stamp, Trust};

/// Dead time of the arm \[s\].
const DEAD_S: f64 = 0.03;
/// An arm that is asked to go less than this share of the way to the preview is held back.
const GOVERNED: f64 = 0.95;

/// Results of an arm in the interval observed, after the approach to the pen.
struct Hurried {
    /// RMS distance \[m\] of a perfect arm from the pen one dead time later.
    rms: f64,
    /// Trust and share of the governor at the end, and whether that was lowered because of the arm.
    alpha: f64,
    governor: f64,
    lowered: bool,
    /// Share of the ticks with saturated acceleration.
    at_limit: f64,
}

/// `path` until `seconds[1]`, observed from `seconds[0]`; `exact`: with a perfect preview.
fn hurried(
    wanted: &FollowerSettings<6>,
    path: fn(f64) -> [f64; 2],
    exact: bool,
    seconds: [f64; 2],
) -> Hurried {
    let mut bench = Bench::armed(wanted.clone());
    let start = bench.now;
    if exact {
        bench.follower.use_oracle(oracle(start, 3000, path));
    }
    let mut seen = Hurried { rms: 0.0, alpha: 0.0, governor: 0.0, lowered: false, at_limit: 0.0 };
    let mut count = 0.0;
    let [begin, end] = seconds;
    write(&mut bench, start, (end * 1e9) as u64 / PERIOD_NS, path, |_, output| {
        let t = output.command.unwrap().stamp.seconds_since(start);
        let [x, y] = path(t + DEAD_S);
        (seen.alpha, seen.governor) = (output.trust.alpha.alpha(), output.governor);
        if t > begin {
            seen.lowered |= output.governor < GOVERNED;
            seen.rms += (output.tool[0] - x).powi(2) + (output.tool[1] - y).powi(2);
            let limited = output.axes.iter().any(|axis| axis.active.acceleration > 0);
            seen.at_limit += f64::from(u8::from(limited));
            count += 1.0;
        }
    });
    Hurried { rms: (seen.rms / count).sqrt(), at_limit: seen.at_limit / count, ..seen }
}

/// Constant velocity with learned corrections, 30 ms ahead of an arm with this acceleration limit.
fn weak(acceleration_mps2: f64) -> FollowerSettings<6> {
    let mut wanted = settings(PredictorKind::CONSTANT_VELOCITY);
    wanted.dead_time_ns = (DEAD_S * 1e9) as u64;
    for axis in &mut wanted.mpc.axes {
        axis.acceleration_mps2 = acceleration_mps2;
    }
    wanted
}

/// Automatic trust, and RMS \[m\] of the same at full trust and at none.
fn beside_manual(
    wanted: &FollowerSettings<6>,
    path: fn(f64) -> [f64; 2],
    exact: bool,
    seconds: [f64; 2],
) -> (Hurried, [f64; 2]) {
    let manual = [Trust::FULL, Trust::NONE].map(|trust| {
        let wanted = FollowerSettings { trust_request: TrustRequest::Manual(trust), ..wanted.clone() };
        let run = hurried(&wanted, path, exact, seconds);
        assert!(!run.lowered && run.governor == 1.0, "an operator's trust was lowered to {}", run.governor);
        run.rms
    });
    let auto = hurried(wanted, path, exact, seconds);
    let [rms, full, none] = [auto.rms, manual[0], manual[1]].map(|rms| rms * 1e3);
    println!(
        "{rms:.2} mm at trust {:.2} and share {:.2}, {full:.2} at 1, {none:.2} at 0; {:.2} at a limit",
        auto.alpha, auto.governor, auto.at_limit
    );
    (auto, manual)
}

#[test]
fn an_arm_too_weak_for_what_is_foreseen_is_better_off_than_with_all_trust_or_none() {
    for acceleration_mps2 in [3.0, 4.0, 6.0] {
        // Unpredictable strokes lower the share; sines become predictable, and a right preview keeps it.
        for (path, unforeseen) in [(scribble as fn(f64) -> [f64; 2], true), (curve, false)] {
            let wanted = weak(acceleration_mps2);
            let (Hurried { rms, lowered, .. }, [believed, held]) =
                beside_manual(&wanted, path, false, [4.0, 12.0]);
            let told = format!("{acceleration_mps2} m/s², unforeseen: {unforeseen}");
            assert!(rms < 0.8 * believed && rms < held, "{told}: {rms} m, {believed} and {held} m");
            assert!(lowered || !unforeseen, "{told}");
        }
    }
}

#[test]
fn a_good_preview_keeps_its_trust_however_much_the_arm_is_at_its_limits() {
    let Hurried { rms, alpha, governor, lowered, at_limit } = hurried(&weak(5.0), curve, true, [4.0, 12.0]);
    println!("{:.2} mm at trust {alpha:.2} and share {governor:.2}; {at_limit:.2} at a limit", rms * 1e3);
    assert!(at_limit > 0.9, "{at_limit}: an arm that is not at its limits proves nothing");
    assert!(alpha == 1.0 && !lowered && rms < 4e-3, "{rms} m at trust {alpha}");
    let Hurried { alpha, lowered, at_limit, .. } = hurried(&weak(20.0), curve, false, [4.0, 12.0]);
    assert!(alpha == 1.0 && !lowered && at_limit == 0.0, "{alpha} {at_limit}");
}

#[test]
fn a_pen_beyond_the_workspace_and_time_lost_cost_a_good_preview_no_trust() {
    // The tool moves along the edge of the workspace, as far out as it can be.
    fn beyond(t: f64) -> [f64; 2] {
        [(0.05 * t).min(0.15), 0.012 * (22.0 * t + 0.4).sin()]
    }
    // 40 ms lost now and then: the arm lags by as much, and for as long as that lasts.
    for (path, lost_every) in [(beyond as fn(f64) -> [f64; 2], u64::MAX), (curve, 300)] {
        let mut bench = Bench::armed(weak(5.0));
        let start = bench.now;
        bench.follower.use_oracle(oracle(start, 2000, path));
        let (mut limited, mut lowered, mut ticks, mut judged) = (0.0, 0.0, 0, 0.0);
        while bench.now.seconds_since(start) < 12.0 {
            ticks += 1;
            if ticks % lost_every == 0 {
                bench.now = bench.now + 20 * PERIOD_NS;
            }
            let due = ticks % 5 == 0 || ticks % 5 == 3;
            let samples = [bench.pen(path(bench.now.seconds_since(start)))];
            let output = bench.tick(if due { &samples } else { &[] });
            if bench.now.seconds_since(start) > 4.0 {
                limited += f64::from(u8::from(output.axes.iter().any(|axis| axis.active.acceleration > 0)));
                lowered += f64::from(u8::from(output.governor < GOVERNED));
                judged += 1.0;
            }
        }
        println!("at a limit in {:.2}, lowered in {:.2} of the ticks", limited / judged, lowered / judged);
        assert!(
            limited > 0.8 * judged,
            "{limited} of {judged}: an arm that is not at its limits proves nothing"
        );
        assert!(lowered == 0.0, "{lowered} of {judged}");
    }
}

/// A short way makes following hardly better than feedback, which is what shortens the way of a saturated
/// arm.
#[test]
fn trust_that_the_arm_has_cost_a_good_preview_comes_back() {
    /// First far too fast for the arm, then motion that a trusted preview follows within millimetres.
    fn eased(t: f64) -> [f64; 2] {
        let [x, y] = curve(t);
        let hard = if t < 6.0 { 4.0 } else { 1.0 };
        [hard * x, hard * y]
    }
    for acceleration_mps2 in [3.0, 4.0, 5.0] {
        let (Hurried { rms, alpha, governor, at_limit, .. }, [believed, held]) =
            beside_manual(&weak(acceleration_mps2), eased, true, [14.0, 24.0]);
        assert!(at_limit > 0.9, "{at_limit}: an arm that is not at its limits proves nothing");
        assert!(
            alpha == 1.0 && governor >= GOVERNED && rms < 1.1 * believed && rms < 0.5 * held,
            "{acceleration_mps2} m/s²: {rms} m"
        );
    }
}

/// An arm that is too weak for strokes that nobody foresees, until it is asked for half of the way.
fn held_back() -> Bench {
    let mut bench = Bench::armed(weak(3.0));
    for _ in 0..10_000 {
        let output = scribble_on(&mut bench);
        if output.governor < 0.5 {
            assert_eq!(output.trust.alpha, Trust::FULL, "the governor is not the trust");
            return bench;
        }
    }
    panic!("never held back");
}

/// One more tick of such strokes.
fn scribble_on(bench: &mut Bench) -> StepOutput<6> {
    let samples = [bench.pen(scribble(bench.now.seconds_since(Stamp(0))))];
    let tick = bench.now.0 / PERIOD_NS;
    bench.tick(if matches!(tick % 5, 0 | 3) { &samples } else { &[] })
}

#[test]
fn an_operator_another_predictor_and_a_new_arming_get_all_of_the_way() {
    let mut bench = held_back();
    let output = bench.tick_with(&[], Some(Request::Disarm), Budget::default());
    assert_eq!((output.answer, output.governor), (Some(Ok(())), 1.0));
    // The way of another predictor begins when no part of the old one is in use; an operator's, gradually.
    for request in
        [Request::SwitchPredictor(PredictorKind::HOLD), Request::SetTrust(1.0), Request::FreezeTrust]
    {
        let mut bench = held_back();
        let mut before = bench.tick_with(&[], Some(request), Budget::default());
        assert_eq!(before.answer, Some(Ok(())));
        let mut ticks = 0;
        while before.governor < 1.0 {
            let output = scribble_on(&mut bench);
            let rise = output.governor / before.governor;
            let at_once = before.trust.alpha == Trust::NONE;
            assert!(rise < 1.02 || at_once, "{request:?}: {} to {}", before.governor, output.governor);
            before = output;
            ticks += 1;
            assert!(ticks < 250, "{request:?}: {}", output.governor);
        }
        // An operator's turn makes no arm stronger.
        if request == Request::SetTrust(1.0) {
            bench.tick_with(&[], Some(Request::TrustAuto), Budget::default());
            assert!((0..2000).any(|_| scribble_on(&mut bench).governor < 0.6), "{request:?}");
        }
    }
}

/// A plan of 100 ms must see a stop from 0.1 m/s.
#[test]
fn jerk_that_is_too_little_for_any_plan_is_refused_with_whose_it_is() {
    let refused = |settings: FollowerSettings<6>| match Follower::<10, 6>::new(settings) {
        Err(FollowerError::LittleJerk { whose, axis, jerk_mps3, needed_mps3 }) => {
            assert!(
                jerk_mps3 < needed_mps3 && (needed_mps3 - 40.0).abs() < 1e-9,
                "{jerk_mps3} {needed_mps3}"
            );
            (whose, axis)
        }
        other => panic!("{:?}", other.map(|_| "taken")),
    };
    let mut plan = settings(PredictorKind::HOLD);
    plan.mpc.axes[1].jerk_mps3 = 39.0;
    assert_eq!(refused(plan), ("the plan's limits", 1));
    let mut weak = settings(PredictorKind::HOLD);
    let tau = std::f64::consts::TAU;
    let limits = JointLimits::new([[-tau, tau]; 6], [3.0; 6], [2.0; 6]).unwrap();
    weak.limits = limits.with_jerk([80.0; 6]).unwrap().with_stale_braking(0.01, [1.9; 6]).unwrap();
    assert_eq!(refused(weak).0, "the joints' jerk limits");
}
