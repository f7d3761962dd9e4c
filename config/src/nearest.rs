//! Suggestions for what the user may have meant: the nearest word, and the unit that a number looks like.

use foretrace_control::predict::PredictorKind;

/// Sections of earlier versions with their present names.
const RENAMED: [(&str, &str); 1] = [("predictor.ours", "predictor.mixture")];

/// Keys of earlier versions that nothing has replaced, and why.
const GONE: [(&str, &str); 1] =
    [("trust.proof_cases", "automatic trust begins proven and ends on evidence: leave the line out")];

/// Why there is no key `path` any more; `None`: there never was one.
pub(crate) fn gone(path: &str) -> Option<&'static str> {
    GONE.iter().find(|(key, _)| *key == path).map(|(_, why)| *why)
}

/// What `word` of an earlier version is called now, a section or a predictor; `None`: it never had another
/// name.
pub(crate) fn current(word: &str) -> Option<&'static str> {
    let section = RENAMED.iter().find(|(old, _)| *old == word).map(|(_, new)| *new);
    section.or_else(|| PredictorKind::current_name(word))
}

/// The present name of `word`, or the candidate nearest to it, if it is near enough to be a typing error
/// (about a third of its letters).
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let renamed = current(word);
    // A hostile file may hold a key of megabytes, which is not a typing error.
    const LONGEST: usize = 80;
    if word.len() > LONGEST {
        return None;
    }
    let allowed = word.chars().count().div_ceil(3).max(1);
    let candidates: Vec<&str> = candidates.into_iter().collect();
    if let Some(known) = candidates.iter().find(|candidate| Some(**candidate) == renamed) {
        return Some(known);
    }
    candidates
        .into_iter()
        .map(|candidate| (distance(word, candidate), candidate))
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Edits (insert, delete, replace, swap of neighbours) that turn `a` into `b`.
///
/// *Source*: optimal string alignment, the restricted Damerau-Levenshtein distance.
pub(crate) fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_ascii_lowercase().chars().collect();
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    let mut left: Option<char> = None;
    for (i, from) in a.to_ascii_lowercase().chars().enumerate() {
        let mut row = Vec::with_capacity(b.len() + 1);
        row.push(i + 1);
        for (j, &to) in b.iter().enumerate() {
            let replaced = last[j] + usize::from(from != to);
            let mut cost = replaced.min(last[j + 1] + 1).min(row[j] + 1);
            if j > 0 && left == Some(to) && b[j - 1] == from {
                cost = cost.min(before[j - 1] + 1);
            }
            row.push(cost);
        }
        before = std::mem::replace(&mut last, row);
        left = Some(from);
    }
    last.last().copied().unwrap_or_default()
}

/// Unit suffixes of key names with the unit as it is written; longest first, so that `_mps3` is not read as
/// `_s`.
const UNITS: [(&str, &str); 15] = [
    ("_radps3", "rad/s^3"),
    ("_radps2", "rad/s^2"),
    ("_radps", "rad/s"),
    ("_rad", "rad"),
    ("_kg", "kg"),
    ("_mps3", "m/s^3"),
    ("_mps2", "m/s^2"),
    ("_mps", "m/s"),
    ("_m2", "m^2"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_hz", "Hz"),
    ("_s", "s"),
    ("_m", "m"),
];

/// The unit in the name of a key, or nothing for a plain number.
pub(crate) fn unit_of(key: &str) -> &'static str {
    UNITS.iter().find(|(suffix, _)| key.ends_with(suffix)).map_or("", |(_, unit)| unit)
}

/// The name of a key without its unit.
pub(crate) fn without_unit(key: &str) -> &str {
    // Also units that foretrace does not use, because they are written by mistake.
    const FOREIGN: [&str; 9] =
        ["_mm", "_cm", "_deg", "_degps", "_degrees", "_sec", "_seconds", "_mmps", "_khz"];
    UNITS
        .iter()
        .map(|(suffix, _)| *suffix)
        .chain(FOREIGN)
        .find_map(|suffix| key.strip_suffix(suffix))
        .unwrap_or(key)
}

/// The unit that a number outside `min..=max` of `unit` may have been meant in: `", 10 looks like ..."`.
pub(crate) fn unit_slip(value: f64, min: f64, max: f64, unit: &str) -> Option<String> {
    let slips: &[(&str, f64)] = match unit {
        "m" | "m/s" | "m/s^2" | "m/s^3" => &[("mm", 1e-3)],
        "rad" | "rad/s" | "rad/s^2" | "rad/s^3" => &[("degrees", std::f64::consts::PI / 180.0)],
        "ms" => &[("seconds", 1e3), ("microseconds", 1e-3), ("nanoseconds", 1e-6)],
        "us" => &[("milliseconds", 1e3), ("nanoseconds", 1e-3)],
        "Hz" => &[("kHz", 1e3)],
        _ => &[],
    };
    slips.iter().find(|(_, factor)| (min..=max).contains(&(value * factor)) && value != 0.0).map(
        |(other, factor)| {
            format!(
                "{value} looks like {other} where the key takes {unit}; that would be {}",
                rounded(value * factor)
            )
        },
    )
}

/// Four significant digits are enough for a suggestion.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_counts_single_edits_and_swaps() {
        // Hand-worked: one insertion, one swap, one replacement, nothing in common.
        assert_eq!(distance("horizn", "horizon"), 1);
        assert_eq!(distance("hroizon", "horizon"), 1);
        assert_eq!(distance("horizan", "horizon"), 1);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("abc", "abc"), 0);
    }

    #[test]
    fn nearest_refuses_words_that_have_little_in_common() {
        assert_eq!(nearest("horizn", ["effort", "horizon"]), Some("horizon"));
        assert_eq!(nearest("zzzzzz", ["effort", "horizon"]), None);
        assert_eq!(nearest(&"h".repeat(1_000_000), ["horizon"]), None);
    }

    #[test]
    fn unit_of_takes_the_longest_suffix() {
        assert_eq!(unit_of("jerk_mps3"), "m/s^3");
        assert_eq!(unit_of("velocity_radps"), "rad/s");
        assert_eq!(unit_of("latch_after_ms"), "ms");
        assert_eq!(unit_of("horizon"), "");
    }

    #[test]
    fn degrees_and_millimetres_are_recognised() {
        let text = unit_slip(180.0, 0.01, 10.0, "rad/s").unwrap();
        assert!(text.contains("degrees") && text.contains("3.142"), "{text}");
        assert!(unit_slip(50.0, 0.001, 0.2, "m").unwrap().contains("mm"));
        assert_eq!(unit_slip(-5.0, 1.0, 100.0, "m"), None);
    }
}
