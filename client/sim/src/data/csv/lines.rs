//! The lines of a CSV recording: the header, a sample, and the head of foretrace's own recordings. Loader and
//! recorder share them.

use crate::path::PathSample;

pub(in crate::data) const HEADER: &str = "t_s,x_m,y_m,contact";
/// Begins the first line of a recording of foretrace's own.
pub(in crate::data) const MARK: &str = "# foretrace-pen ";
pub(in crate::data) const VERSION: &str = "1";
pub(in crate::data) const UNKNOWN: &str = "unknown";

/// A sample as a line.
pub(in crate::data) fn row(s: &PathSample) -> String {
    format!("{:.6},{:.7},{:.7},{}", s.t_s, s.x_m, s.y_m, u8::from(s.contact))
}

/// What the first line of a recording says.
#[derive(Debug, Default, PartialEq)]
pub(super) struct CsvHead {
    /// `None` in a recording that was not finished.
    pub(super) rate_hz: Option<f64>,
    pub(super) writer: String,
}

/// Reads the first line of a recording; `None` where `text` does not begin with one.
///
/// # Errors
///
/// Field, value and what is legal.
pub(super) fn read_head(text: &str) -> Result<Option<CsvHead>, (&'static str, String, &'static str)> {
    let first = text.trim_start_matches('\u{feff}').split(['\n', '\r']).next().unwrap_or_default();
    let Some(fields) = first.strip_prefix(MARK) else { return Ok(None) };
    let field = |name: &str| {
        let named = |f: &str| f.split_once('=').filter(|(n, _)| *n == name).map(|(_, v)| v.to_owned());
        fields.split_whitespace().find_map(named).unwrap_or_default()
    };
    let version = field("version");
    if version != VERSION {
        return Err(("version", version, "1; a later foretrace wrote it"));
    }
    let unit = field("unit");
    if unit != "m" {
        return Err(("unit", unit, "m"));
    }
    let rate = field("rate_hz");
    let rate_hz = match rate.parse::<f64>() {
        _ if rate == UNKNOWN => None,
        Ok(rate_hz) if (1e-3..=1e6).contains(&rate_hz) => Some(rate_hz),
        _ => return Err(("rate_hz", rate, "unknown, or a number from 0.001 to 1000000")),
    };
    let writer = Some(field("writer")).filter(|w| w != "-").unwrap_or_default();
    Ok(Some(CsvHead { rate_hz, writer }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_of_other_versions_units_and_rates_are_refused() {
        for (head, wanted) in [
            ("version=2 unit=m rate_hz=1", ("version", "2")),
            ("version=1 unit=mm rate_hz=1", ("unit", "mm")),
            ("version=1 unit=m rate_hz=NaN", ("rate_hz", "NaN")),
            ("version=1 unit=m", ("rate_hz", "")),
        ] {
            let (field, value, _) = read_head(&format!("{MARK}{head}\n")).unwrap_err();
            assert_eq!((field, value.as_str()), wanted);
        }
        assert_eq!(read_head("t_s,x_m,y_m,contact\n"), Ok(None));
    }
}
