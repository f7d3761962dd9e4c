//! Trust: the ramp never jumps, and every reason leads to the right target.

use foretrace_control::estimate::LawParameters;
use foretrace_control::estimate::record::Record;
use foretrace_control::trust::{
    TrustControl, TrustError, TrustInputs, TrustReason, TrustRequest, TrustSettings,
};
use foretrace_control::units::Trust;
use proptest::prelude::*;

const TICK_NS: u64 = 2_000_000;

const HEALTHY: TrustInputs = TrustInputs {
    unplanned: 0.0,
    weights_refused: false,
    request: TrustRequest::Auto,
    armed: true,
    history: 1000,
    pen_age_ns: Some(5_000_000),
    preview_finite: true,
    switching: false,
    record: GOOD,
};

/// Half of Hold's squared error, and as much evidence as can be.
const GOOD: Record = Record { preview: 50.0, hold: 100.0, evidence: 20.0 };

/// As much evidence against the preview as can be.
const BAD: Record = Record { preview: 1e3, hold: 100.0, evidence: -20.0 };

fn trusted() -> TrustControl {
    let mut trust = TrustControl::new(TrustSettings::default(), &LawParameters::SHIPPED).unwrap();
    for _ in 0..100 {
        trust.update(&HEALTHY, TICK_NS);
    }
    assert_eq!(trust.alpha(), Trust::FULL);
    trust
}

#[test]
fn ramp_takes_ten_grid_steps_from_zero_to_one() {
    let mut trust = TrustControl::new(TrustSettings::default(), &LawParameters::SHIPPED).unwrap();
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

/// A jump empties the predictor's memory.
#[test]
fn after_a_jump_nothing_is_trusted_until_history_is_long_enough_again() {
    let mut trust = trusted();
    for history in 0..5 {
        let report = trust.update(&TrustInputs { history, ..HEALTHY }, TICK_NS);
        assert_eq!((report.reason, report.target), (TrustReason::Warmup, Trust::NONE), "{history}");
    }
    assert_eq!(trust.update(&TrustInputs { history: 5, ..HEALTHY }, TICK_NS).reason, TrustReason::Auto);
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
fn belief_ends_when_the_evidence_is_beyond_doubt_and_begins_again_when_it_is_even() {
    let mut trust = trusted();
    let of = |evidence| Record { evidence, ..GOOD };
    let (believed, given_up) = ((TrustReason::Auto, Trust::FULL), (TrustReason::WorseThanHold, Trust::NONE));
    // Between the thresholds a trusted preview stays trusted, ...
    for evidence in [0.0, -0.1, -9.9, 5.0, -10.0] {
        assert_eq!(judged(&mut trust, of(evidence)), believed, "{evidence}");
    }
    assert_eq!(judged(&mut trust, of(-10.1)), given_up);
    // ... and an untrusted one stays untrusted.
    for evidence in [-9.9, -20.0, -5.0, -0.1] {
        assert_eq!(judged(&mut trust, of(evidence)), given_up, "{evidence}");
    }
    assert_eq!(judged(&mut trust, of(0.0)), believed);
    assert_eq!(judged(&mut trust, of(-9.9)), believed);
}

#[test]
fn a_preview_is_believed_from_the_first_update_unless_the_evidence_is_against_it() {
    for (evidence, reason) in
        [(20.0, TrustReason::Auto), (-9.9, TrustReason::Auto), (-10.1, TrustReason::WorseThanHold)]
    {
        let mut trust = TrustControl::new(TrustSettings::default(), &LawParameters::SHIPPED).unwrap();
        assert_eq!(judged(&mut trust, Record { evidence, ..GOOD }).0, reason, "{evidence}");
    }
}

/// Errors are in the unit of the record; what they prove is in the evidence.
#[test]
fn only_the_evidence_counts_however_large_the_errors_are() {
    let mut trust = trusted();
    assert_eq!(judged(&mut trust, Record { evidence: 1.0, ..BAD }).0, TrustReason::Auto);
    assert_eq!(judged(&mut trust, Record { evidence: -11.0, ..GOOD }).0, TrustReason::WorseThanHold);
}

#[test]
fn evidence_is_judged_while_an_operator_decides() {
    let mut trust = trusted();
    let manual = TrustRequest::Manual(Trust::FULL);
    for evidence in [-20.0, -5.0] {
        let record = Record { evidence, ..GOOD };
        let inputs = TrustInputs { request: manual, record, ..HEALTHY };
        assert_eq!(trust.update(&inputs, TICK_NS).reason, TrustReason::Manual);
    }
    assert_eq!(judged(&mut trust, Record { evidence: -5.0, ..GOOD }).0, TrustReason::WorseThanHold);
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
    let report = trusted().update(&refused, TICK_NS);
    assert_eq!((report.reason, report.target), (TrustReason::PredictorInvalid, Trust::NONE));
    let refused = TrustInputs { request: manual, ..refused };
    assert_eq!(trusted().update(&refused, TICK_NS).reason, TrustReason::Manual);
}

#[test]
fn evidence_that_is_not_a_number_speaks_against_the_preview_until_it_is_even() {
    let mut trust = trusted();
    let none = Record { evidence: f64::NAN, ..GOOD };
    assert_eq!(judged(&mut trust, none), (TrustReason::WorseThanHold, Trust::NONE));
    assert_eq!(judged(&mut trust, Record { evidence: -0.1, ..GOOD }).1, Trust::NONE);
    assert_eq!(judged(&mut trust, GOOD), (TrustReason::Auto, Trust::FULL));
}

#[test]
fn frozen_trust_stays_whatever_the_evidence_says_but_not_whatever_happens() {
    let mut trust = trusted();
    let request = TrustRequest::Frozen(trust.alpha());
    let bad = TrustInputs { request, record: BAD, ..HEALTHY };
    assert_eq!(trust.update(&bad, TICK_NS).reason, TrustReason::Frozen);
    assert_eq!(trust.alpha(), Trust::FULL);
    assert_eq!(trust.update(&TrustInputs { history: 0, ..bad }, TICK_NS).target, Trust::NONE);
}

#[test]
fn settings_out_of_bounds_are_refused() {
    let good = TrustSettings::default();
    assert_eq!(
        TrustControl::new(TrustSettings { step_ns: 0, ..good }, &LawParameters::SHIPPED),
        Err(TrustError::Step)
    );
    for ramp_steps in [0.0, 0.5, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            TrustControl::new(TrustSettings { ramp_steps, ..good }, &LawParameters::SHIPPED),
            Err(TrustError::Ramp { .. })
        ));
    }
    for stale_after_ns in [0, u64::MAX] {
        let bad = TrustSettings { stale_after_ns, ..good };
        assert!(matches!(TrustControl::new(bad, &LawParameters::SHIPPED), Err(TrustError::Stale { .. })));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn alpha_stays_in_its_range_and_never_moves_faster_than_the_ramp(
        ticks in proptest::collection::vec(
            (any::<[bool; 4]>(), any::<Option<f64>>(), any::<[f64; 2]>(), 0..20_u32, any::<Option<u64>>(),
             0..60_000_000_u64), 1..300)
    ) {
        let settings = TrustSettings::default();
        let mut trust = TrustControl::new(settings, &LawParameters::SHIPPED).unwrap();
        let mut before = trust.alpha().alpha();
        for ([armed, preview_finite, switching, weights_refused], manual, [evidence, unplanned], history,
            age, dt_ns) in ticks {
            let record = Record { evidence, ..GOOD };
            let request = manual.map_or(TrustRequest::Auto, |alpha| TrustRequest::Manual(Trust::new(alpha)));
            let pen_age_ns = age.map(|age| age % 120_000_000);
            let inputs = TrustInputs {
                request, armed, history, pen_age_ns, preview_finite, switching, unplanned, weights_refused,
                record,
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
