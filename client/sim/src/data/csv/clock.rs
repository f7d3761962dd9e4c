//! The column of time: its unit, its zero, and what of it is no clock.

use crate::data::Remark;
use crate::spread::median;

/// Times of a clock that counts from its start \[s\]: a longer one counts from 1970.
const CLOCK_MAX_S: f64 = 1e8;
/// No clock counts so far \[s\]: the unit is a thousandth of what was said.
const TIME_MAX_S: f64 = 1e11;
/// Seconds since 1970, from 2001 to 2096.
const TODAY_S: std::ops::RangeInclusive<f64> = 1e9..=4e9;
const TICKS: i64 = 1_000_000_000_000;

/// A number in a column of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CsvMoment {
    pub(super) t: f64,
    /// Its whole part, and its fraction \[10⁻¹²\]: a clock that counts from 1970 has more digits than `t`.
    whole: i64,
    ticks: i64,
}

impl CsvMoment {
    /// `t` as `text` writes it.
    pub(super) fn new(t: f64, text: &str) -> Self {
        let (whole, ticks) = exact(text).unwrap_or((t.trunc() as i64, (t.fract() * TICKS as f64) as i64));
        Self { t, whole, ticks }
    }

    /// Units since `begin`, rounded once.
    fn since(&self, begin: &Self) -> f64 {
        let whole = i128::from(self.whole) - i128::from(begin.whole);
        (whole * i128::from(TICKS) + i128::from(self.ticks - begin.ticks)) as f64 / TICKS as f64
    }
}

/// Whole part and fraction of a number without an exponent.
fn exact(text: &str) -> Option<(i64, i64)> {
    let (whole, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
    let mut ticks = 0;
    for place in 0..12 {
        let digit = fraction.as_bytes().get(place).copied().unwrap_or(b'0');
        ticks = ticks * 10 + i64::from(digit.is_ascii_digit().then(|| digit - b'0')?);
    }
    let behind = fraction.get(12..).unwrap_or_default();
    let written = behind.bytes().all(|digit| digit.is_ascii_digit());
    let ticks = if whole.starts_with('-') { -ticks } else { ticks };
    Some((whole.parse().ok().filter(|_| written)?, ticks))
}

/// How a column of time is read.
#[derive(Debug)]
pub(super) struct CsvClock {
    unit_s: f64,
    /// Since 1970: rows before [`CLOCK_MAX_S`] have no time.
    from_1970: bool,
    /// Zero, where that is not the clock's own.
    begin: Option<CsvMoment>,
}

impl CsvClock {
    /// The unit is as stated, unless no clock counts so far; else by the steps, of which a pen has from 2.5
    /// to 2500 a second.
    pub(super) fn of(
        moments: impl Iterator<Item = CsvMoment>,
        stated_s: Option<f64>,
        remarks: &mut Vec<Remark>,
    ) -> Self {
        let times: Vec<f64> = moments.map(|moment| moment.t).collect();
        // The far ones of a file may be faults.
        let size = median(times.iter().map(|t| t.abs())).unwrap_or(0.0);
        let mut by_size = stated_s.is_some();
        let mut unit_s = stated_s.unwrap_or_else(|| {
            let rising = times.windows(2).map(|w| w[1] - w[0]).filter(|step| *step > 0.0);
            let step = median(rising).unwrap_or(0.0);
            // Whole seconds of today; as many milliseconds have seldom steps of one.
            if TODAY_S.contains(&size) && (0.4..=1.0).contains(&step) {
                by_size = true;
                return 1.0;
            }
            [(0.4, 1.0), (400.0, 1e-3), (4e5, 1e-6)]
                .into_iter()
                .find(|(most, _)| step < *most)
                .map_or(1e-9, |(_, s)| s)
        });
        while size * unit_s > TIME_MAX_S {
            unit_s *= 1e-3;
        }
        if stated_s != Some(unit_s) {
            let names =
                [(1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds")];
            let near = |(s, _): &&(f64, &str)| (s / unit_s - 1.0).abs() < 0.01;
            let name = names.iter().find(near).map_or("a smaller unit", |(_, name)| name);
            let why = if by_size {
                "as large as its numbers are"
            } else {
                "by its steps; name it t_s, t_ms, ... or give --unit"
            };
            remarks.push(Remark::new(format!("the time is taken as {name}, {why}")));
        }
        Self { unit_s, from_1970: size * unit_s > CLOCK_MAX_S, begin: None }
    }

    /// The row has a time: a zero among times since 1970 is none.
    pub(super) fn has(&self, moment: &CsvMoment) -> bool {
        !self.from_1970 || (moment.t * self.unit_s).abs() > CLOCK_MAX_S
    }

    /// A clock that counts from 1970 begins at `first`.
    pub(super) fn begin_at(&mut self, first: Option<&CsvMoment>) {
        self.begin = first.copied().filter(|_| self.from_1970);
    }

    /// Seconds since the clock of the file, or its first sample, began.
    pub(super) fn seconds(&self, moment: &CsvMoment) -> f64 {
        self.begin.as_ref().map_or(moment.t, |begin| moment.since(begin)) * self.unit_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_since_1970_keep_all_their_digits() {
        let since = |text: &str, begin: &str| {
            let moment = |text: &str| CsvMoment::new(text.replace(',', ".").parse().unwrap(), text);
            moment(text).since(&moment(begin))
        };
        assert_eq!(since("1700000000.010", "1700000000.005"), 0.005);
        assert_eq!(since("1700000000,0100000", "1700000000,005"), 0.005);
        assert_eq!(since("1700000000005000001", "1700000000000000000"), 5_000_001.0);
        assert_eq!(since("-1.25", "1.5"), -2.75);
        assert_eq!(since("-0.25", "0.5"), -0.75);
        assert_eq!(since("1.70000000025e9", "1.7e9"), 0.25);
    }

    #[test]
    fn whole_seconds_of_today_are_seconds_by_their_size() {
        let unit = |times: &[f64]| {
            let moments = times.iter().map(|t| CsvMoment::new(*t, &t.to_string()));
            CsvClock::of(moments, None, &mut Vec::new()).unit_s
        };
        assert_eq!(unit(&[1.7e9, 1.7e9, 1.7e9 + 1.0, 1.7e9 + 1.0]), 1.0);
        // Milliseconds and microseconds since a machine began.
        assert_eq!(unit(&[1.7e9, 1.7e9 + 8.0, 1.7e9 + 16.0]), 1e-3);
        assert_eq!(unit(&[1.7e9, 1.7e9 + 5e3, 1.7e9 + 1e4]), 1e-6);
        assert_eq!(unit(&[5.0, 6.0, 7.0]), 1e-3);
    }
}
