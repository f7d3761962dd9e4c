//! The predictor of another process: its part in the preview, how it keeps up, what of it was refused.

use foretrace_shm::{ExternalState, PreviewRefusal, UnknownValue};
use serde_json::{Value, json};

use super::view::milliseconds;

/// One line; `None`: it is not chosen.
pub(super) fn text(state: &ExternalState) -> Option<String> {
    if !(state.weight >= 0.0) {
        return None;
    }
    let refused: Vec<String> =
        refused(state).filter(|(_, count)| *count > 0).map(|(why, count)| format!("{count} {why}")).collect();
    let late = match state.latency.p50_ns {
        0 => "none in the last two seconds".to_owned(),
        ns => format!("median {}", milliseconds(ns.into())),
    };
    Some(format!(
        "{:.0} % of the preview, {:.0} % in the mean (evidence {:+.1})   {} of {} steps in time, {late}   {} lost, \
         {} unsent, refused: {}",
        state.weight * 100.0,
        state.share.max(0.0) * 100.0,
        state.evidence,
        state.hits,
        state.steps,
        state.lost,
        state.unsent,
        if refused.is_empty() { "none".to_owned() } else { refused.join(", ") }
    ))
}

/// The same for machines; null: it is not chosen.
pub(super) fn json(state: &ExternalState) -> Value {
    if !(state.weight >= 0.0) {
        return Value::Null;
    }
    let refused: serde_json::Map<_, _> = refused(state).map(|(why, count)| (why, count.into())).collect();
    json!({
        "weight": state.weight,
        "evidence": state.evidence,
        "share": state.share,
        "steps": state.steps,
        "hits": state.hits,
        "taken": state.taken,
        "lost": state.lost,
        "unsent": state.unsent,
        "refused": refused,
        "latency_ms": {
            "p50": f64::from(state.latency.p50_ns) * 1e-6,
            "p99": f64::from(state.latency.p99_ns) * 1e-6,
            "max": f64::from(state.latency.max_ns) * 1e-6,
        },
    })
}

/// Every reason with its count.
fn refused(state: &ExternalState) -> impl Iterator<Item = (String, u32)> {
    (1..).zip(state.refused).map(|(number, count)| {
        let why: Result<PreviewRefusal, UnknownValue> = PreviewRefusal::try_from(number);
        (why.map_or_else(|unknown| unknown.to_string(), |why| why.to_string()), count)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_its_name_and_a_predictor_that_is_not_chosen_has_no_line() {
        assert_eq!((text(&ExternalState::NONE), json(&ExternalState::NONE)), (None, Value::Null));
        let mut state = ExternalState { weight: 0.5, steps: 10, hits: 9, ..ExternalState::NONE };
        assert!(text(&state).unwrap().ends_with("refused: none"));
        (state.refused[0], state.refused[6]) = (1, 7);
        let line = text(&state).unwrap();
        assert!(line.contains("9 of 10 steps") && line.ends_with("refused: 1 malformed, 7 wild"), "{line}");
        assert_eq!(json(&state)["refused"]["wild"], 7);
    }
}
