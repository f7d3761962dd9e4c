//! The paper's figures on built-in handwriting: what they claim has to come out.

use foretrace_config::Config;
use foretrace_control::predict::PredictorKind;
use foretrace_lab::experiments::{Fig2Arm, Letter, fig2, fig3};
use foretrace_lab::path::Placement;
use foretrace_lab::writer::text_path;

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
    let figure = fig2(&config, &written(), || {}).unwrap();
    let mse = |arm, predictor| {
        figure.rows.iter().find(|row| row.arm == arm && row.predictor == predictor).unwrap().mse_m2
    };
    for arm in [Fig2Arm::Ideal, Fig2Arm::Ur5] {
        let [hold, dybm, ours, oracle] =
            [PredictorKind::Hold, PredictorKind::Dybm, PredictorKind::Ours, PredictorKind::Oracle]
                .map(|kind| mse(arm, kind));
        println!("{arm:?}: hold {hold:e}, DyBM {dybm:e}, ours {ours:e}, oracle {oracle:e} m²");
        assert!(dybm < 0.7 * hold && oracle < 0.2 * dybm, "{arm:?}: {hold:e} {dybm:e} {oracle:e}");
        assert!(ours < 0.7 * hold && oracle < 0.5 * ours, "{arm:?}: {hold:e} {ours:e} {oracle:e}");
    }
    assert!(mse(Fig2Arm::Ideal, PredictorKind::Oracle) < 1e-6, "perfect prediction leaves more than 1 mm");
}

#[test]
fn switching_from_feedback_to_prediction_is_smooth() {
    let config = Config::preset("ur5").unwrap();
    let figure = fig3(&config, &written(), || {}).unwrap();
    println!("jerk ratio {}, irregularity {}", figure.max_jerk_ratio, figure.irregularity);
    assert!(figure.max_jerk_ratio < 1.5 && figure.irregularity < 1.5);
    for letter in &figure.letters {
        let at = |step: f64| letter.trust.iter().rfind(|(s, _)| *s <= step).unwrap().1;
        assert_eq!(at(29.5), 0.0);
        assert!((at(35.0) - 0.5).abs() < 0.06, "half way at step 35, not {}", at(35.0));
        assert_eq!(at(41.0), 1.0);
    }
}
