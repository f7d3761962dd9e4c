//! Dates of the Gregorian calendar in UTC, from seconds since 1970 and back.
//!
//! Source: Howard Hinnant, "chrono-Compatible Low-Level Date Algorithms", `civil_from_days` and
//! `days_from_civil`: years that begin in March have their leap day at their end, and eras of 400 years,
//! which begin at 0000-03-01, are alike.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

const SECONDS_PER_DAY: u64 = 86_400;
const DAYS_PER_ERA: i64 = 146_097;
/// From 0000-03-01 to 1970-01-01.
const DAYS_TO_1970: i64 = 719_468;

/// A moment to the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UtcMoment {
    /// Year, month and day.
    pub date: [i64; 3],
    /// Hour, minute and second.
    pub clock: [u64; 3],
}

impl UtcMoment {
    /// Of a time since 1970; of an earlier one, 1970.
    #[must_use]
    pub fn of(time: SystemTime) -> Self {
        let seconds = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
        let date = date_of((seconds / SECONDS_PER_DAY) as i64);
        Self { date, clock: [seconds / 3600 % 24, seconds / 60 % 60, seconds % 60] }
    }

    /// `2026-11-28T19:45:12Z` (RFC 3339).
    #[must_use]
    pub fn rfc3339(self) -> String {
        let ([year, month, day], [hour, minute, second]) = (self.date, self.clock);
        format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
    }
}

/// Year, month and day, so many days after 1970-01-01.
fn date_of(days: i64) -> [i64; 3] {
    let days = days + DAYS_TO_1970;
    let (era, day) = (days.div_euclid(DAYS_PER_ERA), days.rem_euclid(DAYS_PER_ERA));
    let year_of_era = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    [year_of_era + era * 400 + i64::from(month <= 2), month, day]
}

/// Days from 1970-01-01 to a date of the calendar; before it they are negative.
#[must_use]
pub fn days_since_1970([year, month, day]: [i64; 3]) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let days = of_era * 365 + of_era / 4 - of_era / 100 + (153 * month + 2) / 5 + day - 1;
    era * DAYS_PER_ERA + days - DAYS_TO_1970
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_calendar() {
        // The neighbourhood of leap days: `date -u -d @SECONDS`.
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (1_709_164_800, "2024-02-29T00:00:00Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (1_795_895_112, "2026-11-28T19:45:12Z"),
        ] {
            assert_eq!(UtcMoment::of(UNIX_EPOCH + Duration::from_secs(seconds)).rfc3339(), text);
        }
    }

    #[test]
    fn days_and_dates_are_each_others_inverse() {
        // Two eras around 1970, and each day of them once.
        let mut next = date_of(-DAYS_PER_ERA);
        for days in -DAYS_PER_ERA..DAYS_PER_ERA {
            let date = date_of(days);
            assert_eq!((date, days_since_1970(date)), (next, days));
            let [year, month, day] = date;
            let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
            let last = match month {
                2 => 28 + i64::from(leap),
                4 | 6 | 9 | 11 => 30,
                _ => 31,
            };
            next = match (day == last, month) {
                (false, _) => [year, month, day + 1],
                (true, 12) => [year + 1, 1, 1],
                (true, _) => [year, month + 1, 1],
            };
        }
    }
}
