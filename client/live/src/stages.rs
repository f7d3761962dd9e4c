//! Costs of the stages of ticks, counted into buckets.
//!
//! Contract: one count per stage and tick; sums and counts only grow, as Prometheus wants of a histogram.

use std::fmt::Write as _;

use foretrace_shm::{STAGES, Stage, TickRecord};

/// Upper ends of the buckets \[ns\]: six per factor of ten, from a tenth of a microsecond to 100 ms.
const EDGES_NS: [u32; 37] = {
    let (steps, mut edges, mut scale, mut at) = ([10, 15, 20, 30, 50, 70], [0; 37], 10, 0);
    while at < edges.len() {
        edges[at] = steps[at % steps.len()] * scale;
        at += 1;
        if at % steps.len() == 0 {
            scale *= 10;
        }
    }
    edges
};
/// With one for what is beyond.
const BUCKETS: usize = EDGES_NS.len() + 1;

/// Histograms of all stages.
#[derive(Debug, Clone)]
pub struct Stages {
    counts: [[u64; BUCKETS]; STAGES],
    sums_ns: [u64; STAGES],
    /// Tick records that were lost on their way here.
    pub lost: u64,
}

impl Default for Stages {
    fn default() -> Self {
        Self { counts: [[0; BUCKETS]; STAGES], sums_ns: [0; STAGES], lost: 0 }
    }
}

impl Stages {
    pub fn take(&mut self, record: &TickRecord) {
        for ((stage, counts), sum) in Stage::ALL.iter().zip(&mut self.counts).zip(&mut self.sums_ns) {
            let ns = record.stage(*stage);
            *sum += u64::from(ns);
            if let Some(count) = counts.get_mut(EDGES_NS.partition_point(|edge| *edge < ns)) {
                *count += 1;
            }
        }
    }

    /// Appends them in Prometheus's text format.
    pub(crate) fn write(&self, text: &mut String) {
        let name = "foretrace_stage_duration_seconds";
        let _ = writeln!(text, "# HELP {name} Cost of each stage of each tick.\n# TYPE {name} histogram");
        for ((stage, counts), sum) in Stage::ALL.iter().zip(&self.counts).zip(&self.sums_ns) {
            let mut below = 0;
            let edges = EDGES_NS.iter().map(|ns| (f64::from(*ns) / 1e9).to_string());
            for (edge, count) in edges.chain(["+Inf".to_owned()]).zip(counts) {
                below += count;
                let _ = writeln!(text, "{name}_bucket{{stage=\"{stage}\",le=\"{edge}\"}} {below}");
            }
            let _ = writeln!(text, "{name}_sum{{stage=\"{stage}\"}} {}", *sum as f64 * 1e-9);
            let _ = writeln!(text, "{name}_count{{stage=\"{stage}\"}} {below}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_round_from_a_tenth_of_a_microsecond_to_100_ms() {
        assert_eq!(EDGES_NS[..8], [100, 150, 200, 300, 500, 700, 1000, 1500]);
        assert_eq!(EDGES_NS[34..], [50_000_000, 70_000_000, 100_000_000]);
    }

    #[test]
    fn every_tick_counts_once_per_stage_in_the_bucket_of_its_cost() {
        let mut stages = Stages::default();
        let step = Stage::Step as usize;
        for ns in [0, 100, 101, 10_000, 10_001, u32::MAX] {
            let mut record = TickRecord::default();
            record.stage_ns[step] = ns;
            stages.take(&record);
        }
        let mut text = String::new();
        stages.write(&mut text);
        for line in [
            "foretrace_stage_duration_seconds_bucket{stage=\"step\",le=\"0.0000001\"} 2",
            "foretrace_stage_duration_seconds_bucket{stage=\"step\",le=\"0.00000015\"} 3",
            "foretrace_stage_duration_seconds_bucket{stage=\"step\",le=\"0.00001\"} 4",
            "foretrace_stage_duration_seconds_bucket{stage=\"step\",le=\"0.1\"} 5",
            "foretrace_stage_duration_seconds_bucket{stage=\"step\",le=\"+Inf\"} 6",
            "foretrace_stage_duration_seconds_count{stage=\"step\"} 6",
            "foretrace_stage_duration_seconds_bucket{stage=\"guard\",le=\"0.0000001\"} 6",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in {text}");
        }
        let sum = text.lines().find(|line| line.contains("_sum{stage=\"step\"}")).unwrap();
        assert!(
            (sum.split(' ').nth(1).unwrap().parse::<f64>().unwrap() - 4.294_987_497).abs() < 1e-9,
            "{sum}"
        );
    }
}
