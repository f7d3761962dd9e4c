//! The chain from pen to arm: where the time goes, the arm's lag, and how the plan accounts for it.
//!
//! Contract: medians of about the last second, as the status carries them; what is not known is left out of
//! the words and null in JSON.

use foretrace_shm::{Latency, Status};
use serde_json::{Value, json};

use super::view::age_ms;

pub(crate) fn text(status: &Status) -> String {
    let (chain, lag) = (&status.chain, &status.arm_lag);
    let part = |ns: u64, words: &dyn Fn(f64) -> String| age_ms(ns).map(words);
    let late = || {
        let [late, spread, shift] = [lag.lag_s, lag.std_s, lag.shift_s].map(|s| s * 1e3);
        format!("arm {late:.1} ± {spread:.1} late ({shift:.1} in this motion)")
    };
    let parts = [
        part(chain.pen_age_ns, &|ms| match (age_ms(chain.pen_reader_ns), age_ms(chain.pen_transport_ns)) {
            (Some(reader), Some(transport)) => {
                format!("pen {ms:.1} ms old ({reader:.1} in its reader, {transport:.1} on the way)")
            }
            _ => format!("pen {ms:.1} ms old"),
        }),
        part(chain.compute_ns, &|ms| format!("computed in {ms:.2}")),
        part(chain.command_transport_ns, &|ms| format!("sent to the arm in {ms:.1}")),
        Some(if lag.is_known() { late() } else { "arm not measured yet".to_owned() }),
    ];
    let known: Vec<String> = parts.into_iter().flatten().collect();
    format!("{}; planned for {:.1} ms", known.join(", "), lag.dead_time_ns as f64 * 1e-6)
}

pub(crate) fn json(status: &Status) -> Value {
    let chain = &status.chain;
    json!({
        "pen_reader_ms": age_ms(chain.pen_reader_ns),
        "pen_transport_ms": age_ms(chain.pen_transport_ns),
        "pen_age_ms": age_ms(chain.pen_age_ns),
        "compute_ms": age_ms(chain.compute_ns),
        "command_transport_ms": age_ms(chain.command_transport_ns),
    })
}

/// The arm's lag, and how the plan accounts for it.
pub(crate) fn lag_json(status: &Status) -> Value {
    let lag = &status.arm_lag;
    let known = |s: f64| lag.is_known().then_some(s * 1e3);
    json!({
        "lag_ms": known(lag.lag_s),
        "std_ms": known(lag.std_s),
        "shift_ms": known(lag.shift_s),
        "dead_time_ms": lag.dead_time_ns as f64 * 1e-6,
    })
}

/// Percentiles and histogram of a latency; null before it was measured.
pub(crate) fn latency(latency: &Latency) -> Value {
    let spread = &latency.percentiles;
    let us = |ns: u32| (latency.count > 0).then(|| f64::from(ns) / 1e3);
    let bins = latency.bins.iter().enumerate().map(|(index, count)| {
        let edge = Latency::edge_us(index);
        json!({ "below_us": edge.is_finite().then_some(edge), "count": count })
    });
    json!({
        "count": latency.count,
        "p50_us": us(spread.p50_ns), "p99_us": us(spread.p99_ns),
        "p99_9_us": us(spread.p99_9_ns), "max_us": us(spread.max_ns),
        "histogram": bins.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use foretrace_shm::{ArmLag, Chain};

    use super::*;

    #[test]
    fn the_chain_is_one_line_and_leaves_out_what_is_not_known() {
        let arm_lag = ArmLag::unknown(42_000_000);
        let mut status = Status { chain: Chain::UNKNOWN, arm_lag, ..Status::default() };
        assert_eq!(text(&status), "arm not measured yet; planned for 42.0 ms");
        assert!(json(&status)["compute_ms"].is_null() && lag_json(&status)["lag_ms"].is_null());
        status.chain.pen_age_ns = 3_100_000;
        status.chain.command_transport_ns = 400_000;
        let words = "pen 3.1 ms old, sent to the arm in 0.4, arm not measured yet; planned for 42.0 ms";
        assert_eq!(text(&status), words);
        status.chain =
            Chain { pen_reader_ns: 100_000, pen_transport_ns: 1_200_000, compute_ns: 20_000, ..status.chain };
        status.arm_lag = ArmLag { dead_time_ns: 33_200_000, lag_s: 0.0341, std_s: 0.0006, shift_s: 0.0332 };
        let words = "pen 3.1 ms old (0.1 in its reader, 1.2 on the way), computed in 0.02, sent to the arm \
                     in 0.4, \
                     arm 34.1 ± 0.6 late (33.2 in this motion); planned for 33.2 ms";
        assert_eq!(text(&status), words);
        let age_ms = json(&status)["pen_age_ms"].as_f64().unwrap();
        assert!((age_ms - 3.1).abs() < 1e-9, "{age_ms}");
        let lag = lag_json(&status);
        assert!(
            (lag["std_ms"].as_f64().unwrap() - 0.6).abs() < 1e-9
                && (lag["dead_time_ms"].as_f64().unwrap() - 33.2).abs() < 1e-9
        );
    }
}
