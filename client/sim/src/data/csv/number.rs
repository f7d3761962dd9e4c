//! Cells as numbers of every writing, and those without a value.

/// A finite number, with a point or a comma before its fraction.
pub(super) fn number(text: &str) -> Option<f64> {
    let value: f64 = match text.matches(',').count() {
        0 => text.parse().ok()?,
        1 if !text.contains('.') => text.replace(',', ".").parse().ok()?,
        _ => return None,
    };
    value.is_finite().then_some(value)
}

/// What programs write where they have no value.
pub(super) fn is_blank(text: &str) -> bool {
    const BLANKS: [&str; 9] = ["", "nan", "-nan", "na", "n/a", "#n/a", "<na>", "null", "nil"];
    text.len() <= 4 && BLANKS.iter().any(|blank| text.eq_ignore_ascii_case(blank))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comma_may_stand_before_the_fraction() {
        for (text, wanted) in
            [("0,25", Some(0.25)), ("-1e-3", Some(-1e-3)), ("1,000.5", None), ("1,0,0", None), ("inf", None)]
        {
            assert_eq!(number(text), wanted, "{text}");
        }
    }

    #[test]
    fn words_for_no_value_are_blank() {
        assert!(["", "nan", "NaN", "NA", "null", "#N/A"].into_iter().all(is_blank));
        assert!(!["0", "none", "nano", "-"].into_iter().any(is_blank));
    }
}
