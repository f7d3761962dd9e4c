//! Units of length and time, by the words for them.

/// What is known of a file beyond its text: units of columns whose names have none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CsvUnits {
    /// Of x and y \[m\].
    pub length_m: Option<f64>,
    /// Of the time \[s\].
    pub time_s: Option<f64>,
}

impl std::str::FromStr for CsvUnits {
    type Err = String;

    /// One unit, or a unit of length and one of time with a comma: `mm`, `ms`, `mm,us`.
    fn from_str(text: &str) -> Result<Self, String> {
        let mut units = Self::default();
        for word in text.split(',').map(|word| word.trim().to_lowercase()) {
            match unit(&word) {
                Some(Unit::Length(Some(metres))) if units.length_m.is_none() => units.length_m = Some(metres),
                Some(Unit::Time(seconds)) if units.time_s.is_none() => units.time_s = Some(seconds),
                _ => {
                    return Err(
                        "a unit of length (m, cm, mm, um, in), one of time (s, ms, us, ns), or both: mm,ms"
                            .to_owned(),
                    );
                }
            }
        }
        Ok(units)
    }
}

/// The unit in a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Unit {
    /// \[m\]; `None`: pixels, whose size nobody knows.
    Length(Option<f64>),
    /// Its length in seconds.
    Time(f64),
}

/// The unit that a word in small letters names.
pub(super) fn unit(word: &str) -> Option<Unit> {
    Some(match word {
        "m" | "meter" | "meters" | "metre" | "metres" => Unit::Length(Some(1.0)),
        "cm" => Unit::Length(Some(1e-2)),
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Unit::Length(Some(1e-3)),
        "um" | "µm" | "μm" | "micron" | "microns" => Unit::Length(Some(1e-6)),
        "himetric" => Unit::Length(Some(1e-5)),
        "in" | "inch" | "inches" => Unit::Length(Some(0.0254)),
        "px" | "pixel" | "pixels" => Unit::Length(None),
        "s" | "sec" | "secs" | "second" | "seconds" => Unit::Time(1.0),
        "ms" | "msec" | "msecs" | "millis" | "millisec" | "millisecs" | "millisecond" | "milliseconds" => {
            Unit::Time(1e-3)
        }
        "us" | "µs" | "μs" | "usec" | "usecs" | "micros" | "microsec" | "microsecs" | "microsecond"
        | "microseconds" => Unit::Time(1e-6),
        "ns" | "nsec" | "nsecs" | "nanos" | "nanosec" | "nanosecs" | "nanosecond" | "nanoseconds" => {
            Unit::Time(1e-9)
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_an_option_are_of_length_or_time() {
        assert_eq!("mm".parse(), Ok(CsvUnits { length_m: Some(1e-3), time_s: None }));
        assert_eq!("us, in".parse(), Ok(CsvUnits { length_m: Some(0.0254), time_s: Some(1e-6) }));
        for wrong in ["", "px", "mm,cm", "fortnight", "ms,s"] {
            assert!(wrong.parse::<CsvUnits>().unwrap_err().contains("mm,ms"), "{wrong}");
        }
    }
}
