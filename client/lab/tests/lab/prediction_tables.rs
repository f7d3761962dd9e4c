//! Table 1 against the reference numbers and per-sequence errors, where the shared data is there.
//!
//! Sources of the numbers: the tables of the reference run (its program is not here) and
//! `fixtures/reference`.

use crate::shared::shared;
use foretrace_lab::prediction::{Model, Row, Scored, Set, score, share_below};
use foretrace_sim::data::Split;
use std::collections::HashMap;
use std::path::Path;

fn scored(set: &Set, names: &str) -> Scored {
    score(&Model::list(names).unwrap(), set, &|| ()).unwrap()
}

fn row<'a>(scored: &'a Scored, model: &str) -> &'a Row {
    scored.rows.iter().find(|r| r.model == model).unwrap()
}

#[track_caller]
fn close(what: &str, got: Option<f64>, wanted: f64, tolerance: f64) {
    let got = got.unwrap_or(f64::NAN);
    assert!((got - wanted).abs() <= tolerance, "{what}: {got}, not {wanted} +- {tolerance}");
}

/// Errors per sequence of the reference: file and segment to the columns after `steps`.
fn reference(shared: &Path, name: &str) -> HashMap<(String, usize), Vec<f64>> {
    let table = shared.join(format!("fixtures/reference/{name}-test-per-sequence.tsv"));
    let rows = std::fs::read_to_string(table).unwrap();
    rows.lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<&str> = line.split('\t').collect();
            let errors = cells[4..].iter().map(|cell| cell.parse().unwrap()).collect();
            ((cells[0].to_owned(), cells[1].parse().unwrap()), errors)
        })
        .collect()
}

/// Errors of one column in the order of the set.
fn column(set: &Set, table: &HashMap<(String, usize), Vec<f64>>, index: usize) -> Vec<f64> {
    set.scored.iter().map(|s| table[&(s.file.clone(), s.segment)][index]).collect()
}

#[track_caller]
fn agree(what: &str, ours: &[f64], theirs: &[f64]) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    for (index, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        // The table is rounded to 9 digits.
        assert!(
            (ours - theirs).abs() <= 1e-6 * theirs.abs(),
            "{what}, sequence {index}: {ours}, not {theirs}"
        );
    }
}

#[test]
fn baselines_and_the_network_on_unipen_ced_are_those_of_the_reference() {
    let Some(shared) = shared() else { return };
    let set = Set::load(&shared.join("data/unipen-ced"), &Split::test(), true).unwrap();
    let scored = scored(&set, "hold,constant-velocity,lstm10-reference");
    let steps: usize = set.scored.iter().map(|s| s.v.len() - 1).sum();
    assert_eq!((set.scored.len(), steps), (3021, 243_052));
    let zero = row(&scored, "hold");
    close("hold", zero.mse, 89.244, 0.002);
    close("zero within", zero.within, 30.921, 0.002);
    close("zero median", zero.median, 38.339, 0.002);
    close("zero PS-B", zero.ps_b, 31.1, 0.05);
    close("zero PS-LSTM", zero.ps_lstm, 2.5, 0.05);
    close("zero RMS", zero.rms_mm_10, 1.475, 0.0006);
    let baseline = row(&scored, "constant-velocity");
    close("constant velocity", baseline.mse, 120.070, 0.002);
    close("constant velocity within", baseline.within, 5.258, 0.002);
    close("constant velocity median", baseline.median, 7.418, 0.002);
    close("constant velocity PS-B", baseline.ps_b, 0.0, 0.0);
    close("constant velocity PS-LSTM", baseline.ps_lstm, 12.9, 0.05);
    close("constant velocity RMS", baseline.rms_mm_10, 1.128, 0.0006);
    let lstm = row(&scored, "lstm10-reference");
    close("LSTM", lstm.mse, 63.200, 0.002);
    close("LSTM within", lstm.within, 4.877, 0.002);
    close("LSTM median", lstm.median, 6.547, 0.002);
    close("LSTM PS-B", lstm.ps_b, 87.1, 0.05);
    close("LSTM PS-LSTM", lstm.ps_lstm, 0.0, 0.0);
    close("LSTM RMS", lstm.rms_mm_10, 1.011, 0.0006);
    let rounded = |row: &Row| -> Vec<Option<f64>> {
        let leads = row.vel_mse.values().chain(row.pos_mse.values());
        leads
            .enumerate()
            .map(|(i, v)| v.map(|v| if i < 4 { (v * 10.0).round() / 10.0 } else { v.round() }))
            .collect()
    };
    let wanted = |values: [f64; 8]| values.map(Some).to_vec();
    assert_eq!(rounded(zero), wanted([89.2, 90.2, 93.0, 98.0, 89.0, 240.0, 1035.0, 3269.0]));
    assert_eq!(rounded(baseline), wanted([120.1, 125.1, 145.3, 182.0, 120.0, 372.0, 2080.0, 8968.0]));
    assert_eq!(rounded(lstm), wanted([63.2, 66.1, 77.3, 94.8, 63.0, 139.0, 493.0, 1770.0]));
    let table = reference(&shared, "unipen-ced");
    for (index, model) in ["zero", "constant velocity", "LSTM"].into_iter().enumerate() {
        agree(model, &scored.runs[index].per_sequence(), &column(&set, &table, index));
    }
}

#[test]
fn baselines_on_unipen_tos_are_those_of_the_reference() {
    let Some(shared) = shared() else { return };
    let set = Set::load(&shared.join("data/unipen-tos"), &Split::test(), true).unwrap();
    let scored = scored(&set, "hold,constant-velocity");
    let (zero, baseline) = (row(&scored, "hold"), row(&scored, "constant-velocity"));
    close("hold", zero.mse, 5.153, 0.001);
    close("zero within", zero.within, 1.540, 0.001);
    close("zero median", zero.median, 2.667, 0.001);
    close("zero PS-B", zero.ps_b, 72.7, 0.05);
    close("constant velocity", baseline.mse, 8.525, 0.001);
    close("constant velocity within", baseline.within, 1.342, 0.001);
    close("constant velocity median", baseline.median, 2.312, 0.001);
    let table = reference(&shared, "unipen-tos");
    let errors = [scored.runs[0].per_sequence(), scored.runs[1].per_sequence()];
    agree("hold", &errors[0], &column(&set, &table, 0));
    agree("constant velocity", &errors[1], &column(&set, &table, 1));
    // The reference's LSTM(10) of this set has only its errors here, not its weights.
    let lstm = column(&set, &table, 2);
    close("zero PS-LSTM", share_below(&errors[0], &lstm), 4.6, 0.05);
    close("constant velocity PS-LSTM", share_below(&errors[1], &lstm), 1.4, 0.05);
}

#[test]
fn models_that_learn_online_on_unipen_ced_are_those_of_the_reference() {
    let Some(shared) = shared() else { return };
    let set = Set::load(&shared.join("data/unipen-ced"), &Split::test(), false).unwrap();
    let scored = scored(&set, "dybm-offline,dybm,dybm-esn,ar-rls");
    close("offline", row(&scored, "dybm-offline").mse, 73.533, 0.002);
    close("offline within", row(&scored, "dybm-offline").within, 11.704, 0.002);
    close("offline PS-B", row(&scored, "dybm-offline").ps_b, 38.0, 0.05);
    close("online", row(&scored, "dybm").mse, 72.814, 0.002);
    close("online within", row(&scored, "dybm").within, 11.467, 0.002);
    close("online PS-B", row(&scored, "dybm").ps_b, 37.9, 0.05);
    // Other random matrices than the reference's: its seeds 0, 1 and 2 spread as far.
    let esn = row(&scored, "dybm-esn");
    close("ESN", esn.mse, 63.902, 0.3);
    close("ESN within", esn.within, 4.700, 0.2);
    close("ESN PS-B", esn.ps_b, 92.3, 3.0);
    // Another start and bound of the covariance than the reference's.
    let rls = row(&scored, "ar-rls");
    close("AR-RLS", rls.mse, 63.787, 0.02);
    close("AR-RLS within", rls.within, 4.202, 0.01);
    close("AR-RLS PS-B", rls.ps_b, 98.9, 0.3);
    close("AR-RLS PS-LSTM", rls.ps_lstm, 55.2, 1.0);
    close("AR-RLS RMS", rls.rms_mm_10, 0.806, 0.002);
    assert!(scored.rows.iter().all(|row| row.train_s_per_epoch.is_some() && row.us_per_step.is_some()));
}
