//! How long things took: counted values, their quantiles, and durations in words.

/// Counted values of one quantity, as an HDR histogram's recorded values give them.
#[derive(Debug, Clone)]
pub struct Distribution {
    pub label: String,
    /// (value in µs, how often); any order.
    pub counts_us: Vec<(f64, u64)>,
}

impl Distribution {
    /// From single values in µs.
    #[must_use]
    pub fn from_values_us(label: impl Into<String>, values_us: impl IntoIterator<Item = f64>) -> Self {
        Self { label: label.into(), counts_us: values_us.into_iter().map(|v| (v, 1)).collect() }
    }

    /// Smallest value in µs that at least `share` of all values do not exceed; `None` without values.
    #[must_use]
    pub fn quantile_us(&self, share: f64) -> Option<f64> {
        let mut sorted: Vec<(f64, u64)> = self.counts_us.iter().copied().filter(counted).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: u64 = sorted.iter().map(|c| c.1).sum();
        let rank = ((share.clamp(0.0, 1.0) * total as f64).ceil() as u64).max(1);
        let mut seen = 0;
        sorted.iter().find_map(|(value, count)| {
            seen += count;
            (seen >= rank).then_some(*value)
        })
    }
}

pub(super) fn counted(count: &(f64, u64)) -> bool {
    count.0.is_finite() && count.0 >= 0.0 && count.1 > 0
}

/// Three figures and the unit that fits.
pub(super) fn microseconds(value_us: f64) -> String {
    let (value, unit) = match value_us {
        v if v < 1.0 => (v * 1e3, "ns"),
        v if v < 1e3 => (v, "µs"),
        v if v < 1e6 => (v * 1e-3, "ms"),
        v => (v * 1e-6, "s"),
    };
    let digits = if value < 9.995 { 2 } else { usize::from(value < 99.95) };
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text} {unit}")
}
