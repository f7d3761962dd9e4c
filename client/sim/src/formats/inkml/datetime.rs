//! `xsd:dateTime`, in which timestamps may be written.
//!
//! Source: W3C XML Schema Part 2, section 3.2.7. The calendar is Gregorian for all years; a time without a
//! zone counts as UTC.

use foretrace_host::calendar::days_since_1970;

const MS_PER_DAY: i64 = 86_400_000;
/// Years before and after which no pen writes; days since 1970 stay far from their bound.
const YEARS: std::ops::RangeInclusive<i64> = -9999..=99_999;
/// Nanoseconds: digits behind them are below the rounding of a time since 1970.
const FRACTION_DIGITS: usize = 9;

/// Milliseconds since 1970, or `None` for what is no date with a time.
pub(super) fn milliseconds(text: &str) -> Option<f64> {
    let text = text.trim();
    let (sign, rest) = text.strip_prefix('-').map_or((1, text), |rest| (-1, rest));
    let (date, time) = rest.split_once('T')?;
    let [year, month, day] = parts(date, '-')?;
    if year.len() < 4 {
        return None;
    }
    let year = sign * digits(year, 4..=9).filter(|year| YEARS.contains(year))?;
    let month = digits(month, 2..=2).filter(|month| (1..=12).contains(month))?;
    let day = digits(day, 2..=2).filter(|day| (1..=days_in(year, month)).contains(day))?;
    let zone_at = time.find(['Z', '+', '-']).unwrap_or(time.len());
    let (clock, zone) = time.split_at_checked(zone_at)?;
    let ms = days_since_1970([year, month, day]) * MS_PER_DAY - zone_minutes(zone)? * 60_000;
    Some(ms as f64 + clock_ms(clock)?)
}

/// `hh:mm:ss` with a fraction; 24:00:00 is the midnight that ends the day.
fn clock_ms(clock: &str) -> Option<f64> {
    let [hours, minutes, seconds] = parts(clock, ':')?;
    let (whole, fraction) = seconds.split_once('.').map_or((seconds, None), |(w, f)| (w, Some(f)));
    let hours = digits(hours, 2..=2).filter(|hours| *hours <= 24)?;
    let minutes = digits(minutes, 2..=2).filter(|minutes| *minutes < 60)?;
    let seconds = digits(whole, 2..=2).filter(|seconds| *seconds < 60)?;
    let ns = match fraction {
        None => 0,
        Some(fraction) => {
            if fraction.is_empty() || !fraction.bytes().all(|b| b.is_ascii_digit()) {
                return None;
            }
            let kept = fraction.get(..FRACTION_DIGITS).unwrap_or(fraction);
            digits(kept, 1..=FRACTION_DIGITS)? * 10_i64.pow((FRACTION_DIGITS - kept.len()) as u32)
        }
    };
    if hours == 24 && (minutes, seconds, ns) != (0, 0, 0) {
        return None;
    }
    Some(((hours * 60 + minutes) * 60 + seconds) as f64 * 1e3 + ns as f64 / 1e6)
}

/// `Z`, `+hh:mm`, `-hh:mm` or nothing.
fn zone_minutes(zone: &str) -> Option<i64> {
    let sign = match zone.as_bytes().first() {
        None => return Some(0),
        Some(b'Z') => return (zone == "Z").then_some(0),
        Some(b'-') => -1,
        Some(_) => 1,
    };
    let (hours, minutes) = zone.get(1..)?.split_once(':')?;
    let minutes = digits(hours, 2..=2)? * 60 + digits(minutes, 2..=2).filter(|minutes| *minutes < 60)?;
    (minutes <= 14 * 60).then_some(sign * minutes)
}

fn parts(text: &str, separator: char) -> Option<[&str; 3]> {
    let mut parts = text.split(separator);
    let three = [parts.next()?, parts.next()?, parts.next()?];
    parts.next().is_none().then_some(three)
}

fn digits(text: &str, length: std::ops::RangeInclusive<usize>) -> Option<i64> {
    let legal = length.contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    text.parse().ok().filter(|_| legal)
}

fn is_leap(year: i64) -> bool {
    year % 4 == 0 && (year % 100 != 0 || year % 400 == 0)
}

fn days_in(year: i64, month: i64) -> i64 {
    match month {
        2 => 28 + i64::from(is_leap(year)),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

#[cfg(test)]
mod tests {
    use super::milliseconds;

    #[test]
    fn dates_of_every_form_are_milliseconds_since_1970() {
        for (text, ms) in [
            ("1970-01-01T00:00:00Z", 0.0),
            ("2023-11-14T22:13:20.600Z", 1_700_000_000_600.0),
            (" 2023-11-14T23:13:20+01:00 ", 1_700_000_000_000.0),
            ("2023-11-14T16:43:20.0000000-05:30", 1_700_000_000_000.0),
            ("2000-02-29T24:00:00", 951_868_800_000.0),
            ("1969-12-31T23:59:59.5Z", -500.0),
            ("1900-03-01T00:00:00Z", -2_203_891_200_000.0),
            ("-0001-01-01T00:00:00Z", -62_198_755_200_000.0),
            ("2023-11-14T22:13:20.000000000999Z", 1_700_000_000_000.0),
        ] {
            assert_eq!(milliseconds(text), Some(ms), "{text}");
        }
    }

    #[test]
    fn what_is_no_date_with_a_time_is_refused() {
        for text in [
            "",
            "T",
            "1700000000",
            "2023-11-14",
            "2023-11-14 22:13:20",
            "2023-02-29T00:00:00Z",
            "2023-13-01T00:00:00Z",
            "2023-11-14T24:00:01Z",
            "2023-11-14T22:60:20Z",
            "2023-11-14T22:13:20.Z",
            "2023-11-14T22:13:20Zulu",
            "2023-11-14T22:13:20+15:00",
            "2023-11-14T22:13:20+é1:00",
            "999999999-01-01T00:00:00Z",
            "+2023-11-14T22:13:20Z",
            "2023-11-14T+2:13:20Z",
        ] {
            assert_eq!(milliseconds(text), None, "{text}");
        }
    }
}
