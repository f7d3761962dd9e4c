//! The paper's figures on built-in handwriting: their claims must hold.

use foretrace_config::Config;
use foretrace_control::predict::{Needs, PredictorKind};
use foretrace_control::stop::{StopCause, StopDetail};
use foretrace_lab::experiments::{
    ExperimentError, Fig2Arm, Fig3, LawEntrant, Letter, RunError, fig2, fig2_entrant, fig3,
};
use foretrace_sim::path::Placement;
use foretrace_sim::writer::text_path;

fn written() -> Vec<Letter> {
    ["K", "a", "8", "R", "m", "B"]
        .iter()
        .zip(1..)
        .map(|(label, seed)| Letter {
            label: (*label).to_owned(),
            writer: format!("hand {seed}"),
            path: text_path(label, seed, 200.0, &Placement::default()).unwrap(),
        })
        .collect()
}

#[test]
fn perfect_prediction_beats_ours_and_the_dybm_and_both_beat_feedback() {
    let config = Config::preset("ur5").unwrap();
    let entrants =
        ["hold", "dybm", "mixture", "mixture-trust1", "oracle"].map(|name| fig2_entrant(name).unwrap());
    let figure = fig2(&config, &written(), &entrants, || {}).unwrap();
    let mse = |arm, entrant| {
        figure.rows.iter().find(|row| row.arm == arm && row.entrant == entrant).unwrap().mse_m2
    };
    for arm in [Fig2Arm::Ideal, Fig2Arm::Ur5] {
        let [hold, dybm, mixture, believed, oracle] = entrants.map(|entrant| mse(arm, entrant));
        println!(
            "{arm:?}: hold {hold:e}, DyBM {dybm:e}, mixture {mixture:e}, at trust 1 {believed:e}, oracle \
             {oracle:e} m²"
        );
        assert!(dybm < 0.7 * hold && oracle < 0.2 * dybm, "{arm:?}: {hold:e} {dybm:e} {oracle:e}");
        for mixture in [mixture, believed] {
            assert!(
                mixture < 0.7 * hold && oracle < 0.5 * mixture,
                "{arm:?}: {hold:e} {mixture:e} {oracle:e}"
            );
        }
    }
    let oracle = fig2_entrant("oracle").unwrap();
    assert!(mse(Fig2Arm::Ideal, oracle) < 1e-6, "perfect prediction leaves more than 1 mm");
}

#[test]
fn every_predictor_has_its_row_and_the_picture_stays_readable() {
    let config = Config::preset("ur5").unwrap();
    let letters = &written()[..2];
    let figure = fig2(&config, letters, &LawEntrant::all().collect::<Vec<_>>(), || {}).unwrap();
    for arm in [Fig2Arm::Ideal, Fig2Arm::Ur5] {
        let rows: Vec<_> = figure.rows.iter().filter(|row| row.arm == arm).collect();
        let mut names: Vec<_> = rows.iter().map(|row| row.name()).collect();
        for kind in PredictorKind::ALL.into_iter().filter(|kind| kind.needs() != Needs::Process) {
            assert!(names.contains(&kind.name()), "{names:?} lacks {}", kind.name());
        }
        assert!(names.contains(&"mixture-trust1"), "{names:?}");
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), LawEntrant::all().count(), "each name once: {names:?}");
        for row in rows {
            assert_eq!(fig2_entrant(row.name()), Some(row.entrant));
            assert!(row.mse_m2 > 0.0 && row.letters_mse_m2.len() == letters.len(), "{row:?}");
        }
    }
    // At trust 1 no two predictors write the same; else one of them was not in use.
    let mut errors: Vec<u64> = figure.rows.iter().map(|row| row.mse_m2.to_bits()).collect();
    errors.sort_unstable();
    errors.dedup();
    assert_eq!(errors.len(), figure.rows.len());
    let drawn: Vec<_> =
        figure.rows.iter().zip(&figure.typical_tools).filter(|(_, tool)| !tool.is_empty()).collect();
    let names: Vec<_> = drawn.iter().take(5).map(|(row, _)| row.name()).collect();
    assert_eq!(names, ["hold", "constant-velocity", "dybm", "mixture", "oracle"]);
    assert_eq!(drawn.len(), 2 * 5);
    assert_eq!(fig2_entrant("nobody"), None);
}

#[test]
fn switching_from_feedback_to_prediction_is_smooth() {
    let config = Config::preset("ur5").unwrap();
    for kind in [PredictorKind::MIXTURE, PredictorKind::DYBM] {
        let figure = fig3(&config, &written(), kind, || {}).unwrap();
        println!("{kind:?}: jerk ratio {}, irregularity {}", figure.max_jerk_ratio, figure.irregularity);
        assert!(figure.max_jerk_ratio < 1.5 && figure.irregularity < 1.5, "{kind:?}");
        ramp_lies_in_steps_30_to_40(&figure);
    }
}

fn ramp_lies_in_steps_30_to_40(figure: &Fig3) {
    for letter in &figure.letters {
        let at = |step: f64| letter.trust.iter().rfind(|(s, _)| *s <= step).unwrap().1;
        assert_eq!(at(29.5), 0.0);
        assert!((at(35.0) - 0.5).abs() < 0.06, "half way at step 35, not {}", at(35.0));
        assert_eq!(at(41.0), 1.0);
    }
}

#[test]
fn a_run_that_is_stopped_is_named_with_letter_predictor_arm_and_bound() {
    let (cause, joint) = (StopCause::Response, Some(0));
    let detail = StopDetail { cause, joint, amount: 0.006_352, limit: 0.003_75, ..StopDetail::default() };
    let (label, writer) = ("e".to_owned(), "2064".to_owned());
    let error = Box::new(RunError::NotFollowing(detail));
    let stopped = ExperimentError::Run { label, writer, predictor: "lstm", arm: Fig2Arm::Ur5.name(), error };
    assert_eq!(
        stopped.to_string(),
        "letter \"e\" of writer 2064, lstm on ur5: the loop says that the arm does not follow: Response of \
         joint 0 is 0.00635 m, its bound 0.00375 m"
    );
}
