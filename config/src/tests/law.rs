//! What the control law is built from: conversion of units and frames, and the presets' values.

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::follower::Follower;
use foretrace_control::ik::IkSettings;
use foretrace_control::learn::{Leads, LearnerSettings};
use foretrace_control::mpc::{Gains, SoftPenalty};
use foretrace_control::pen::SpeedScaleSettings;
use foretrace_control::plane::Plane;
use foretrace_control::predict::{InitialWeights, ModelSettings, PredictorKind, PreviewSettings};
use foretrace_control::qp::backend::Backend;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

use super::over_ur5;
use crate::follower::judge;
use crate::{Config, JOINTS, Settings, keys};

#[test]
fn every_preset_builds_a_follower() {
    for name in ["ur5", "ur5e"] {
        let config = Config::preset(name).unwrap();
        assert_eq!(config.settings().mpc.horizon, 20);
        Follower::<20, JOINTS>::new(config.follower_settings()).unwrap();
    }
}

#[test]
fn presets_keep_what_was_measured_in_the_control_law() {
    for name in ["ur5", "ur5e"] {
        let config = Config::preset(name).unwrap();
        let law = config.follower_settings();
        // Twenty plan steps of 2.5 ms are five grid steps.
        let leads = Leads::of_loop(10_000_000, law.dead_time_ns + law.response_ns, 5);
        let learner = LearnerSettings { leads, ..LearnerSettings::preset(10_000_000, 0) };
        assert_eq!(config.learner_settings(), learner, "{name}");
        assert_eq!(*law.models.settings(), ModelSettings::preset(10_000_000), "{name}");
        assert_eq!((&law.models, law.weights), (config.models(), law.models.initial_weights()), "{name}");
        let gains = |position, velocity| Gains { position, velocity, acceleration: 0.0, decay: 1.0 };
        assert_eq!(law.mpc.gains_feedback, [gains(1.0, 7.0); 3], "{name}");
        assert_eq!(law.mpc.gains_feedforward, [gains(1.0, 2.5); 3], "{name}");
        assert_eq!((law.mpc.effort, law.mpc.step_s), (10.0, 0.0025));
        assert_eq!((law.response_ns, law.velocity_lead_ns), (0, 7_000_000));
        assert_eq!(law.mpc.soft_penalty, SoftPenalty::DEFAULT);
        assert_eq!(law.ik, IkSettings::for_period(0.002, config.robot().home));
        assert_eq!(law.preview, PreviewSettings::default());
        assert_eq!(law.preview.scale, SpeedScaleSettings::default());
    }
}

#[test]
fn milliseconds_hertz_and_millimetres_arrive_in_the_units_of_the_law() {
    let law = over_ur5(
        "[timing]\ndead_time_ms = 34.5\n[loop]\nrate_hz = 1000\n[pen]\nmin_interval_us = \
                  1500\n[mpc]\nvelocity_lead_ms = 12.5\n",
    )
    .unwrap()
    .follower_settings();
    assert_eq!((law.dead_time_ns, law.velocity_lead_ns), (34_500_000, 12_500_000));
    assert_eq!((law.period_ns, law.pen.step_ns), (1_000_000, 10_000_000));
    assert_eq!(law.pen.min_interval_ns, 1_500_000);
    assert_eq!(law.mpc.step_s, 0.0025);
    assert_eq!(law.trust.stale_after_ns, 100_000_000);
    assert_eq!(law.safety.latch_after_ns, 200_000_000);
    assert_eq!(law.ik.gain_hz, 500.0);
}

#[test]
fn pen_gates_are_scaled_from_the_device_into_the_plane() {
    let law = over_ur5(
        "[plane]\nscale = 2.0\npen_origin_m = [0.1, -0.1]\n[pen]\nbounds_m = [[0.0, 0.3], [-0.2, \
         0.2]]\nmax_speed_mps = 1.5\n",
    )
    .unwrap()
    .follower_settings();
    assert_eq!(law.pen.max_speed_mps, 3.0);
    // Hand-worked: (0 - 0.1) * 2, (-0.2 + 0.1) * 2; (0.3 - 0.1) * 2, (0.2 + 0.1) * 2.
    for (got, wanted) in law.pen.position_min_m.iter().zip([-0.2, -0.2]) {
        assert!((got - wanted).abs() < 1e-15);
    }
    for (got, wanted) in law.pen.position_max_m.iter().zip([0.4, 0.6]) {
        assert!((got - wanted).abs() < 1e-15);
    }
}

#[test]
fn workspace_and_limits_reach_their_axes() {
    let law = over_ur5("[mpc.limits.y]\njerk_mps3 = 300\n[mpc.limits.z]\nvelocity_mps = 0.25\n")
        .unwrap()
        .follower_settings();
    let [x, y, z] = law.mpc.axes;
    assert_eq!((x.jerk_mps3, y.jerk_mps3, z.jerk_mps3), (16000.0, 300.0, 400.0));
    assert_eq!((x.velocity_mps, z.velocity_mps), (0.8, 0.25));
    assert_eq!([x.position_m, y.position_m, z.position_m], [[-0.15, 0.15], [-0.1, 0.1], [-0.0005, 0.06]]);
}

#[test]
fn words_choose_what_they_say() {
    let config = over_ur5(
        "[predictor]\nkind = \"hold\"\n[trust]\nmode = \"manual\"\nvalue = 0.25\n[mpc]\nbackend \
         = \"clarabel\"\n\
         [learner]\ninitial_persistence = 0.0\n",
    )
    .unwrap();
    let law = config.follower_settings();
    assert_eq!(law.preview.kind, PredictorKind::HOLD);
    assert_eq!(law.trust_request, TrustRequest::Manual(Trust::new(0.25)));
    assert_eq!(law.mpc.backend, Backend::Other(&ClarabelProfile::Default));
    assert_eq!(law.models.settings().initial, InitialWeights::Zero);
    assert_eq!(law.ik_backend, Backend::Exact);
    let tuned = over_ur5("[mpc]\nbackend = \"clarabel-tuned\"\n[ik]\nbackend = \"clarabel\"\n")
        .unwrap()
        .follower_settings();
    assert_eq!(tuned.ik_backend, Backend::Other(&ClarabelProfile::Default));
    assert_eq!(tuned.mpc.backend, Backend::Other(&ClarabelProfile::Tuned));
}

#[test]
fn the_plane_of_the_law_is_the_plane_of_the_file() {
    let config = Config::preset("ur5e").unwrap();
    let Plane { origin, lift_height, press_depth, pen_scale, .. } = config.follower_settings().plane;
    assert_eq!([origin.x, origin.y, origin.z], config.settings().plane.origin_m);
    assert_eq!((lift_height, press_depth, pen_scale), (0.01, 0.0, 1.0));
    let pressing = over_ur5("[plane]\npress_m = 0.0004\n").unwrap();
    assert_eq!(pressing.follower_settings().plane.press_depth, 0.0004);
}

#[test]
fn what_no_key_forbids_is_still_judged_by_the_law() {
    let config = Config::preset("ur5").unwrap();
    let refused = |change: fn(&mut Settings)| {
        let mut settings = config.settings().clone();
        change(&mut settings);
        judge(&settings, config.robot(), config.models(), config.prior()).map_err(|error| error.to_string())
    };
    assert_eq!(refused(|_| ()), Ok(()));
    assert!(refused(|s| s.mpc.effort = f64::NAN).unwrap_err().contains("effort"));
    assert!(refused(|s| s.learner.follow_steps = 0).unwrap_err().contains("follow_steps"));
    assert!(refused(|s| s.pen.step_ms = 7).unwrap_err().contains("not a multiple"));
    // Each of them is legal by itself.
    let soft = |s: &mut Settings| (s.mpc.effort, s.mpc.feedforward.position) = (1000.0, 0.01);
    assert_eq!(refused(soft), Ok(()));
    let swings = refused(|s| {
        (s.mpc.effort, s.mpc.feedforward.position, s.mpc.feedforward.velocity) = (1000.0, 0.01, 0.02);
    });
    let swings = swings.unwrap_err();
    assert!(swings.contains("does not settle") && swings.contains("mpc.feedforward.velocity"), "{swings}");
}

#[test]
fn weights_are_compared_as_far_ahead_as_the_plan_looks() {
    let leads = |text: &str| over_ur5(text).unwrap().learner_settings().leads;
    let ideal = leads("[timing]\ndead_time_ms = 0.0\n[mpc]\nhorizon = 10\nstep_ms = 10\nresponse_ms = 0\n");
    assert_eq!(ideal, Leads::new(1, 10).unwrap());
    let lagging = leads("[timing]\ndead_time_ms = 41.0\n[mpc]\nhorizon = 20\nstep_ms = 10\n");
    assert_eq!(lagging, Leads::new(5, 25).unwrap());
    // The servo filter that the plan models need not be predicted; twenty plan steps of 2.5 ms are five grid
    // steps.
    let inverted = leads("[timing]\ndead_time_ms = 34.0\nservo_filter_ms = 30.0\n[mpc]\nresponse_ms = 0\n");
    assert_eq!(inverted, Leads::new(1, 6).unwrap());
}

#[test]
fn every_predictor_of_the_law_but_the_oracle_can_be_chosen() {
    let key = keys().iter().find(|key| key.path == "predictor.kind").unwrap();
    for kind in PredictorKind::LIVE {
        assert!(key.legal_text.contains(&format!("{:?}", kind.name())), "{}", key.legal_text);
        assert!(key.meaning.contains(kind.about()), "{kind:?} is not explained: {}", key.meaning);
        let text = format!("[predictor]\nkind = \"{}\"\n", kind.name());
        let config = over_ur5(&text).unwrap();
        let law = config.follower_settings();
        assert_eq!((law.preview.kind, law.models.has(kind)), (kind, true));
    }
    let refused = over_ur5("[predictor]\nkind = \"oracle\"\n").unwrap_err().to_string();
    assert!(refused.contains("oracle") && refused.contains("\"mixture\""), "{refused}");
}

#[test]
fn networks_that_do_not_fit_the_loop_are_refused_by_name_and_number() {
    for (text, words) in [
        ("[predictor]\nlstm = \"lstm10-reference\"\n", ["5000000 ns", "10000000 ns"]),
        ("[predictor]\nlstm = \"lstm99\"\n", ["lstm99", "lstm10-reference"]),
        ("[predictor]\nkind = \"lstm\"\nlstm = \"none\"\n", ["predictor.kind", "needs a trained network"]),
        ("[predictor.mixture]\nnetwork = \"lstm10-10ms\"\n", ["leads of the LSTM", "24"]),
        ("[predictor.ar_rls]\ngate = 1.0\nhuber = 5e3\n", ["huber", "1000"]),
    ] {
        let error = over_ur5(text).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{text} -> {error}");
    }
}

#[test]
fn shipped_networks_are_taken_for_the_step_that_they_were_made_for() {
    let without = |text: &str| {
        let law = over_ur5(text).unwrap().follower_settings();
        (law.models.has(PredictorKind::LSTM), law.models.networks().mixture.is_some())
    };
    assert_eq!(without(""), (true, true));
    assert_eq!(
        without("[predictor]\nlstm = \"none\"\n[predictor.mixture]\nnetwork = \"none\"\n"),
        (false, false)
    );
    assert_eq!(without("[loop]\nrate_hz = 125\n[pen]\nstep_ms = 8\n"), (false, true));
    assert_eq!(without("[loop]\nrate_hz = 1000\n[pen]\nstep_ms = 5\n"), (false, true));
}

#[test]
fn nobody_loses_the_network_of_the_mixture_without_a_remark() {
    let remarks = |text: &str| over_ur5(text).unwrap().remarks();
    assert_eq!(remarks(""), Vec::<String>::new());
    let found = remarks("[loop]\nrate_hz = 1000\n[pen]\nstep_ms = 6\n[mpc]\nstep_ms = 2.5\n");
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found.iter().all(|r| r.contains("pen.step_ms = 6 ") && r.contains("5, 8, 10 ms")), "{found:?}");
    // Switched off in the settings, or another predictor: no remark.
    for text in ["[predictor.mixture]\nnetwork = \"none\"\n", "[predictor]\nkind = \"dybm\"\n"] {
        let quiet =
            remarks(&format!("[loop]\nrate_hz = 1000\n[pen]\nstep_ms = 6\n[mpc]\nstep_ms = 2.5\n{text}"));
        assert_eq!(quiet, Vec::<String>::new(), "{text}");
    }
}

#[test]
fn what_a_slow_loop_costs_and_limits_that_do_not_count_are_reported() {
    let remarks = |text: &str| over_ur5(text).unwrap().remarks();
    let slow = remarks("[loop]\nrate_hz = 125\n[pen]\nstep_ms = 8\n");
    assert!(
        slow.iter().any(|remark| remark.contains("loop.rate_hz = 125") && remark.contains("8 ms")),
        "{slow:?}"
    );
    let notes = |text: &str| over_ur5(text).unwrap().notes();
    let fast = notes("[mpc.limits.z]\nvelocity_mps = 0.5\n[mpc.limits.x]\nvelocity_mps = 2.0\n");
    let lowered: Vec<_> = fast.iter().filter(|note| note.starts_with("mpc.limits are lowered")).collect();
    assert_eq!(lowered.len(), 1, "{fast:?}");
    assert!(
        lowered[0].contains("z.velocity_mps 0.5 to 0.188") && lowered[0].contains("x.velocity_mps 2 to"),
        "{fast:?}"
    );
    assert_eq!(remarks("[mpc.limits.z]\nvelocity_mps = 0.5\n"), Vec::<String>::new());
}

#[test]
fn plan_steps_lie_between_the_period_and_the_grid_step() {
    assert_eq!(
        over_ur5("[loop]\nrate_hz = 125\n[pen]\nstep_ms = 8\n").unwrap().settings().plan_step_s(),
        0.008
    );
    for text in ["[mpc]\nstep_ms = 1.5\n", "[mpc]\nstep_ms = 12\n"] {
        let error = over_ur5(text).unwrap_err().to_string();
        assert!(error.contains("mpc.step_ms") && error.contains("2 to 10 ms"), "{error}");
    }
}

#[test]
fn every_horizon_builds() {
    for horizon in [10, 20, 30] {
        over_ur5(&format!("[mpc]\nhorizon = {horizon}\n")).unwrap();
    }
}
