//! Trust: the ramp never jumps, and every reason leads to the right target.

use foretrace_control::estimate::skill::Record;
use foretrace_control::trust::{
    TrustControl, TrustError, TrustInputs, TrustReason, TrustRequest, TrustSettings,
};
use foretrace_control::units::Trust;
use proptest::prelude::*;

const TICK_NS: u64 = 2_000_000;

const HEALTHY: TrustInputs = TrustInputs {
    unplanned: 0.0,
    failed: 0.0,
    overtaxed: None,
    reaction_ns: 60_000_000,
    weights_refused: false,
    request: TrustRequest::Auto,
    armed: true,
    history: 1000,
    pen_age_ns: Some(5_000_000),
    jumped: false,
    preview_finite: true,
    switching: false,
    record: GOOD,
};

/// Half of Hold's squared error, a little less than constant velocity's, from enough cases.
const GOOD: Record = Record { preview: 50.0, hold: 100.0, steady: 60.0, cases: 200.0, surprise: 0.1 };

fn trusted() -> TrustControl {
    let mut trust = TrustControl::new(TrustSettings::default()).unwrap();
    for _ in 0..100 {
        trust.update(&HEALTHY, TICK_NS);
    }
    assert_eq!(trust.alpha(), Trust::FULL);
    trust
}

#[test]
fn ramp_takes_ten_grid_steps_from_zero_to_one() {
    let mut trust = TrustControl::new(TrustSettings::default()).unwrap();
    for tick in 1..=50 {
        let report = trust.update(&HEALTHY, TICK_NS);
        assert!((report.alpha.alpha() - f64::from(tick) / 50.0).abs() < 1e-12, "tick {tick}: {report:?}");
        assert_eq!((report.target, report.reason), (Trust::FULL, TrustReason::Auto));
    }
}

#[test]
fn each_defect_of_the_preview_takes_trust_to_zero_and_is_named() {
    for (inputs, reason) in [
        (TrustInputs { armed: false, ..HEALTHY }, TrustReason::Disarmed),
        (TrustInputs { pen_age_ns: None, ..HEALTHY }, TrustReason::Stale),
        (TrustInputs { pen_age_ns: Some(60_000_001), ..HEALTHY }, TrustReason::Stale),
        (TrustInputs { preview_finite: false, ..HEALTHY }, TrustReason::PredictorInvalid),
        (TrustInputs { switching: true, ..HEALTHY }, TrustReason::SwitchingPredictor),
        (TrustInputs { history: 4, ..HEALTHY }, TrustReason::Warmup),
        (TrustInputs { jumped: true, ..HEALTHY }, TrustReason::Jump),
    ] {
        let mut trust = trusted();
        for _ in 0..60 {
            let report = trust.update(&inputs, TICK_NS);
            assert_eq!((report.reason, report.target), (reason, Trust::NONE));
        }
        assert_eq!(trust.alpha(), Trust::NONE, "{reason:?}");
        // The operator cannot overrule it.
        let manual = TrustInputs { request: TrustRequest::Manual(Trust::FULL), ..inputs };
        assert_eq!(trust.update(&manual, TICK_NS).target, Trust::NONE);
    }
}

#[test]
fn jump_is_the_reason_until_history_is_long_enough_again() {
    let mut trust = trusted();
    let warming = |history, jumped| TrustInputs { history, jumped, ..HEALTHY };
    assert_eq!(trust.update(&warming(0, true), TICK_NS).reason, TrustReason::Jump);
    for history in 1..5 {
        assert_eq!(trust.update(&warming(history, false), TICK_NS).reason, TrustReason::Jump);
    }
    assert_eq!(trust.update(&warming(5, false), TICK_NS).reason, TrustReason::Auto);
}

#[test]
fn manual_value_is_reached_by_the_same_ramp() {
    let mut trust = trusted();
    let manual = TrustInputs { request: TrustRequest::Manual(Trust::new(0.3)), ..HEALTHY };
    let mut ticks = 0;
    while trust.update(&manual, TICK_NS).alpha != Trust::new(0.3) {
        ticks += 1;
        assert!(ticks < 100);
    }
    // From 1 to 0.3 at 0.02 per tick: 35 ticks, the last of which ends the loop (or the next, by rounding).
    assert!((34..=35).contains(&ticks), "{ticks}");
    assert_eq!(trust.update(&manual, TICK_NS).reason, TrustReason::Manual);
}

fn judged(trust: &mut TrustControl, record: Record) -> (TrustReason, Trust) {
    let report = trust.update(&TrustInputs { record, ..HEALTHY }, TICK_NS);
    (report.reason, report.target)
}

#[test]
fn nothing_is_believed_before_enough_previews_were_judged() {
    for proof_cases in [1, 20] {
        let settings = TrustSettings { proof_cases, ..TrustSettings::default() };
        let mut trust = TrustControl::new(settings).unwrap();
        let few = Record { cases: 0.95 * f64::from(proof_cases), ..GOOD };
        assert_eq!(judged(&mut trust, few), (TrustReason::Unproven, Trust::NONE));
        assert_eq!(judged(&mut trust, Record::default()), (TrustReason::Unproven, Trust::NONE));
        assert_eq!(judged(&mut trust, GOOD), (TrustReason::Auto, Trust::FULL));
    }
}

#[test]
fn belief_ends_above_hold_and_begins_again_only_well_below_it() {
    let mut trust = trusted();
    let of = |preview| Record { preview, steady: 1e3, ..GOOD };
    // Between the thresholds a trusted preview stays trusted, ...
    for preview in [95.0, 104.0, 91.0, 105.0] {
        assert_eq!(judged(&mut trust, of(preview)), (TrustReason::Auto, Trust::FULL), "{preview}");
    }
    assert_eq!(judged(&mut trust, of(105.1)), (TrustReason::WorseThanHold, Trust::NONE));
    // ... and an untrusted one stays untrusted.
    for preview in [104.0, 91.0, 105.0] {
        assert_eq!(judged(&mut trust, of(preview)), (TrustReason::Hysteresis, Trust::NONE), "{preview}");
    }
    assert_eq!(judged(&mut trust, of(90.0)), (TrustReason::Auto, Trust::FULL));
}

#[test]
fn predictor_that_a_straight_line_beats_by_far_is_not_believed() {
    let mut trust = trusted();
    let of = |steady| Record { steady, ..GOOD };
    assert_eq!(judged(&mut trust, of(33.0)), (TrustReason::WorseThanSteady, Trust::NONE));
    assert_eq!(judged(&mut trust, of(40.0)), (TrustReason::WorseThanSteady, Trust::NONE));
    assert_eq!(judged(&mut trust, of(42.0)), (TrustReason::Auto, Trust::FULL));
}

#[test]
fn straight_line_does_not_count_where_doubt_would_only_put_hold_in_the_previews_place() {
    let mut trust = trusted();
    let of = |preview| Record { preview, steady: 5.0, ..GOOD };
    assert_eq!(judged(&mut trust, of(20.0)), (TrustReason::Auto, Trust::FULL));
    assert_eq!(judged(&mut trust, of(21.0)), (TrustReason::WorseThanSteady, Trust::NONE));
    assert_eq!(judged(&mut trust, of(20.0)), (TrustReason::Auto, Trust::FULL));
}

#[test]
fn shipped_predictor_loses_belief_by_its_own_faults_only() {
    // The start of the first stroke is unpredictable: as good as Hold is no reason for distrust yet.
    let mut trust = TrustControl::new(TrustSettings::default()).unwrap();
    let first = Record { preview: 95.0, hold: 100.0, steady: 100.0, cases: 1.0, surprise: 0.0 };
    assert_eq!(judged(&mut trust, first).0, TrustReason::Auto);
    let mut trust = TrustControl::new(TrustSettings::default()).unwrap();
    let worse = Record { preview: 106.0, ..first };
    assert_eq!(judged(&mut trust, worse).0, TrustReason::WorseThanHold);
    assert_eq!(judged(&mut trust, first).0, TrustReason::Hysteresis);
}

#[test]
fn predictor_whose_bands_are_left_is_doubted_until_they_hold_again() {
    let mut trust = trusted();
    let of = |surprise| Record { surprise, ..GOOD };
    for surprise in [0.1, 0.5, 0.26] {
        assert_eq!(judged(&mut trust, of(surprise)), (TrustReason::Auto, Trust::FULL), "{surprise}");
    }
    assert_eq!(judged(&mut trust, of(0.51)), (TrustReason::Surprised, Trust::NONE));
    assert_eq!(judged(&mut trust, of(0.26)), (TrustReason::Surprised, Trust::NONE));
    assert_eq!(judged(&mut trust, of(0.25)), (TrustReason::Auto, Trust::FULL));
}

#[test]
fn health_of_solver_and_learner_counts_unless_an_operator_decides() {
    let manual = TrustRequest::Manual(Trust::new(0.7));
    let mut trust = trusted();
    let mut told = |unplanned, request| {
        let report = trust.update(&TrustInputs { unplanned, request, ..HEALTHY }, TICK_NS);
        (report.reason, report.target)
    };
    assert_eq!(told(0.25, TrustRequest::Auto), (TrustReason::Auto, Trust::FULL));
    assert_eq!(told(0.26, TrustRequest::Auto), (TrustReason::SolverUnhealthy, Trust::NONE));
    assert_eq!(told(0.06, TrustRequest::Auto), (TrustReason::SolverUnhealthy, Trust::NONE));
    assert_eq!(told(0.06, manual), (TrustReason::Manual, Trust::new(0.7)));
    assert_eq!(told(0.05, TrustRequest::Auto), (TrustReason::Auto, Trust::FULL));
    assert_eq!(told(f64::NAN, TrustRequest::Auto).1, Trust::NONE);
    let refused = TrustInputs { weights_refused: true, ..HEALTHY };
    assert_eq!(trusted().update(&refused, TICK_NS).reason, TrustReason::LearnerUnhealthy);
    let refused = TrustInputs { request: manual, ..refused };
    assert_eq!(trusted().update(&refused, TICK_NS).reason, TrustReason::Manual);
}

/// α after `seconds` on an arm that is saturated in the share `used` of its ticks at a trust, the reason, and
/// the share of the ticks in which it was.
fn limited(
    trust: &mut TrustControl,
    seconds: f64,
    request: TrustRequest,
    used: impl Fn(f64) -> f64,
) -> (f64, TrustReason, f64) {
    let ticks = (seconds * 1e9) as u64 / TICK_NS;
    let (mut due, mut at_limits, mut last) = (0.0, 0.0, TrustReason::Auto);
    for _ in 0..ticks {
        due += used(trust.alpha().alpha());
        let at_limit = due >= 1.0;
        due -= f64::from(u8::from(at_limit));
        at_limits += f64::from(u8::from(at_limit));
        last = trust.update(&TrustInputs { overtaxed: Some(at_limit), request, ..HEALTHY }, TICK_NS).reason;
    }
    (trust.alpha().alpha(), last, at_limits / ticks as f64)
}

#[test]
fn an_arm_at_its_limits_is_asked_for_less_until_it_is_well_used() {
    let auto = TrustRequest::Auto;
    let mut trust = trusted();
    let (alpha, reason, _) = limited(&mut trust, 4.0, auto, |_| 0.5);
    assert_eq!((alpha, reason), (1.0, TrustReason::Auto));
    // By e in 7 x 60 ms, and the part left out because it would count as equal.
    let (alpha, reason, _) = limited(&mut trust, 0.21, auto, |_| 1.0);
    assert!((alpha - (-0.5_f64).exp()).abs() < 0.07, "{alpha}");
    assert_eq!(reason, TrustReason::ArmLimited);
    let (lowest, reason, _) = limited(&mut trust, 4.0, auto, |_| 1.0);
    assert!((lowest - 0.1).abs() < 0.01 && reason == TrustReason::ArmLimited, "{lowest}");
    // At rest there is nothing to learn about saturation.
    for _ in 0..2000 {
        trust.update(&HEALTHY, TICK_NS);
    }
    assert_eq!(trust.alpha().alpha(), lowest);
    let (alpha, reason, _) = limited(&mut trust, 2.0, auto, |_| 0.5);
    assert_eq!((alpha, reason), (1.0, TrustReason::Auto));
    limited(&mut trust, 4.0, auto, |alpha| 1.6 * alpha);
    let (alpha, _, share) = limited(&mut trust, 4.0, auto, |alpha| 1.6 * alpha);
    let well_used = 0.42 / (0.42 + 0.19);
    assert!((share - well_used).abs() < 0.02 && (alpha - share / 1.6).abs() < 0.1, "{share} at {alpha}");
}

#[test]
fn what_takes_long_to_show_is_taken_back_slowly_and_a_preview_that_is_right_not_at_all() {
    let after_with = |reaction_ns, preview, failed| {
        let record = Record { preview, ..GOOD };
        let at_limit = TrustInputs { overtaxed: Some(true), reaction_ns, record, failed, ..HEALTHY };
        let mut trust = trusted();
        for _ in 0..100 {
            trust.update(&at_limit, TICK_NS);
        }
        trust.alpha().alpha()
    };
    let after = |reaction_ns, preview| after_with(reaction_ns, preview, 0.0);
    let [soon, late] = [60_000_000, 120_000_000].map(|reaction_ns| after(reaction_ns, 50.0));
    assert!(((soon.ln() / late.ln()) - 2.0).abs() < 0.3, "{soon} {late}");
    assert!(after(0, 50.0) > 0.0 && after(u64::MAX, 50.0) > 0.99);
    // A tenth of Hold's 100.
    assert!(after(60_000_000, 10.1) < 0.7);
    assert_eq!(after(60_000_000, 9.9), 1.0);
    assert_eq!(after_with(60_000_000, 9.9, 0.05), 1.0);
    for failed in [0.06, f64::NAN] {
        assert!(after_with(60_000_000, 9.9, failed) < 0.7, "a solver without steps does not get on");
    }
}

#[test]
fn who_arms_and_another_predictor_begin_with_all_the_strength_of_the_arm() {
    for begins in [TrustInputs { armed: false, ..HEALTHY }, TrustInputs { switching: true, ..HEALTHY }] {
        let mut trust = trusted();
        limited(&mut trust, 4.0, TrustRequest::Auto, |_| 1.0);
        assert_eq!(trust.update(&HEALTHY, TICK_NS).reason, TrustReason::ArmLimited);
        trust.update(&begins, TICK_NS);
        let report = trust.update(&HEALTHY, TICK_NS);
        assert_eq!((report.reason, report.target), (TrustReason::Auto, Trust::FULL));
    }
}

#[test]
fn limits_of_the_arm_are_no_reason_against_an_operator_and_none_for_a_bad_preview() {
    let manual = TrustRequest::Manual(Trust::new(0.9));
    let mut trust = trusted();
    let (alpha, reason, _) = limited(&mut trust, 1.0, manual, |_| 1.0);
    assert!((alpha - 0.9).abs() < 1e-12 && reason == TrustReason::Manual, "{alpha} {reason:?}");
    let auto = TrustInputs { overtaxed: Some(true), ..HEALTHY };
    assert_eq!(
        trust.update(&auto, TICK_NS).reason,
        TrustReason::Auto,
        "what an operator asked for is learned from"
    );
    let bad = TrustInputs { overtaxed: Some(true), record: Record { preview: 1e3, ..GOOD }, ..HEALTHY };
    trust = trusted();
    for _ in 0..500 {
        let report = trust.update(&bad, TICK_NS);
        assert_eq!((report.reason, report.target), (TrustReason::WorseThanHold, Trust::NONE));
    }
}

#[test]
fn evidence_that_is_not_a_number_speaks_against_the_preview() {
    for bad in [
        Record { preview: f64::NAN, ..GOOD },
        Record { hold: f64::NAN, ..GOOD },
        Record { steady: f64::NAN, ..GOOD },
        Record { cases: f64::NAN, ..GOOD },
        Record { surprise: f64::NAN, ..GOOD },
    ] {
        assert_eq!(judged(&mut trusted(), bad).1, Trust::NONE, "{bad:?}");
    }
}

#[test]
fn frozen_trust_stays_whatever_the_evidence_says_but_not_whatever_happens() {
    let mut trust = trusted();
    let request = TrustRequest::Frozen(trust.alpha());
    let bad = TrustInputs { request, record: Record { preview: 1e3, ..GOOD }, ..HEALTHY };
    assert_eq!(trust.update(&bad, TICK_NS).reason, TrustReason::Frozen);
    assert_eq!(trust.alpha(), Trust::FULL);
    assert_eq!(trust.update(&TrustInputs { jumped: true, ..bad }, TICK_NS).target, Trust::NONE);
}

#[test]
fn settings_out_of_bounds_are_refused() {
    let good = TrustSettings::default();
    assert_eq!(TrustControl::new(TrustSettings { step_ns: 0, ..good }), Err(TrustError::Step));
    for ramp_steps in [0.0, 0.5, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            TrustControl::new(TrustSettings { ramp_steps, ..good }),
            Err(TrustError::Ramp { .. })
        ));
    }
    for stale_after_ns in [0, u64::MAX] {
        let bad = TrustSettings { stale_after_ns, ..good };
        assert!(matches!(TrustControl::new(bad), Err(TrustError::Stale { .. })));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn alpha_stays_in_its_range_and_never_moves_faster_than_the_ramp(
        ticks in proptest::collection::vec(
            (any::<[bool; 4]>(), any::<(Option<f64>, Option<bool>)>(), any::<[f64; 6]>(), 0..20_u32,
                any::<Option<u64>>(),
             0..60_000_000_u64), 1..300)
    ) {
        let settings = TrustSettings::default();
        let mut trust = TrustControl::new(settings).unwrap();
        let mut before = trust.alpha().alpha();
        for ([armed, jumped, preview_finite, switching], (manual, overtaxed), sums, history, age,
            dt_ns) in ticks {
            let [preview, hold, steady, cases, surprise, unplanned] = sums;
            let record = Record { preview, hold, steady, cases, surprise };
            let request = manual.map_or(TrustRequest::Auto, |alpha| TrustRequest::Manual(Trust::new(alpha)));
            let pen_age_ns = age.map(|age| age % 120_000_000);
            let weights_refused = history == 7;
            let inputs = TrustInputs {
                request, armed, history, pen_age_ns, jumped, preview_finite, switching, unplanned,
                    overtaxed, weights_refused, record,
                reaction_ns: dt_ns * 3,
                failed: unplanned,
            };
            let report = trust.update(&inputs, dt_ns);
            let alpha = report.alpha.alpha();
            let reach = dt_ns as f64 / (settings.ramp_steps * settings.step_ns as f64);
            prop_assert!((0.0..=1.0).contains(&alpha));
            prop_assert!((alpha - before).abs() <= reach + 1e-12);
            // It moves towards the target and never past it.
            let target = report.target.alpha();
            prop_assert!((target - alpha) * (target - before) >= 0.0);
            before = alpha;
        }
    }
}
