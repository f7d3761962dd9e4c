//! What each kind of input is worth, as text, CSV and JSON.

use serde_json::{Value, json};

use super::Judgement;

/// A line of the table.
pub struct InputRow {
    pub inputs: String,
    pub trained_on: String,
    pub set: String,
    pub judgement: Judgement,
}

/// The table for people.
pub fn input_lines(rows: &[InputRow]) -> Vec<String> {
    let mut lines = Vec::new();
    lines.push("squared error over that of standing still [95 % over writers]".to_owned());
    for InputRow { inputs, trained_on, set, judgement } in rows {
        let Judgement { lead_s, share, low, high, .. } = judgement;
        let ms = lead_s * 1e3;
        lines.push(format!(
            "{set:24} {ms:3.0} ms  {share:.3} [{low:.3} {high:.3}]  inputs: {inputs}; trained on {trained_on}"
        ));
    }
    lines
}

/// The table for other programs.
pub fn input_csv(rows: &[InputRow]) -> String {
    let mut text = "inputs,trained_on,set,lead_ms,of_standing_still,low,high,writers\n".to_owned();
    for InputRow { inputs, trained_on, set, judgement } in rows {
        let Judgement { lead_s, share, low, high, writers } = judgement;
        let ms = (lead_s * 1e3).round();
        text += &format!("{inputs},{trained_on},{set},{ms},{share:.4},{low:.4},{high:.4},{writers}\n");
    }
    text
}

/// One object a line.
pub fn input_json(rows: &[InputRow]) -> Vec<Value> {
    rows.iter()
        .map(|InputRow { inputs, trained_on, set, judgement }| {
            let Judgement { lead_s, share, low, high, writers } = judgement;
            json!({ "inputs": inputs, "trained_on": trained_on, "set": set, "lead_ms": lead_s * 1e3,
                "of_standing_still": share, "low": low, "high": high, "writers": writers })
        })
        .collect()
}
