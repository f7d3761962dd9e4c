//! Values of options that several commands take, judged while the command line is read.
//!
//! Exit codes: an error that only the command line can cause (a number, a name of ours, two options that
//! exclude each other) is 2. An error in an input is 5: settings, also from `--set`, recordings, texts, data
//! sets, files.

use std::ops::RangeInclusive;

use foretrace_config::{LONGEST_ROOT_BYTES, presets};
use foretrace_control::predict::PredictorKind;

/// A preset that there is.
pub(crate) fn preset(text: &str) -> Result<String, String> {
    match presets::text(text) {
        Some(_) => Ok(text.to_owned()),
        None => Err(format!("the presets are {}", presets::names())),
    }
}

/// KEY=VALUE.
pub(crate) fn pair(text: &str) -> Result<String, String> {
    match text.split_once('=') {
        Some((key, _)) if !key.trim().is_empty() => Ok(text.to_owned()),
        _ => Err("write --set KEY=VALUE, for example --set loop.rate_hz=250".to_owned()),
    }
}

/// A folder that the middleware can use.
pub(crate) fn root(text: &str) -> Result<std::path::PathBuf, String> {
    let path = std::path::PathBuf::from(text);
    if !path.is_absolute() || text.len() > LONGEST_ROOT_BYTES {
        return Err(format!(
            "an absolute path of at most {LONGEST_ROOT_BYTES} bytes (this one has {})",
            text.len()
        ));
    }
    Ok(path)
}

/// A predictor that the loop can run with.
pub(crate) fn predictor(text: &str) -> Result<PredictorKind, String> {
    PredictorKind::LIVE.into_iter().find(|kind| kind.name() == text).ok_or_else(|| {
        if PredictorKind::from_name(text).is_some() {
            return format!("{text} knows the future, so it runs in the lab only; one of {}", predictors());
        }
        format!("one of {}{}", predictors(), PredictorKind::renamed(text))
    })
}

/// Their names, for a message.
pub(crate) fn predictors() -> String {
    PredictorKind::LIVE.map(PredictorKind::name).join(", ")
}

/// `auto`, or a number from 0 to 1 as it was written.
pub(crate) fn trust(text: &str) -> Result<String, String> {
    let share = || text.parse().is_ok_and(|value: f64| (0.0..=1.0).contains(&value));
    if text == "auto" || share() {
        return Ok(text.to_owned());
    }
    Err("a number from 0 (hold only) to 1 (prediction only), or auto".to_owned())
}

/// Judges a number by its `legal` range; `words` say what to give instead of another one.
pub(crate) fn number(
    legal: RangeInclusive<f64>,
    words: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| text.parse().ok().filter(|number| legal.contains(number)).ok_or_else(|| words.to_owned())
}

/// One of several words, with what it stands for.
pub(crate) fn word<T: Clone + Send + Sync + 'static, const N: usize>(
    known: [(&'static str, T); N],
    words: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| {
        let found = known.iter().find(|(word, _)| *word == text);
        found.map(|(_, value)| value.clone()).ok_or_else(|| words.to_owned())
    }
}

/// Seconds to wait, none included.
pub(crate) fn wait(text: &str) -> Result<f64, String> {
    number(0.0..=3600.0, "a number of seconds from 0 to 3600")(text)
}

/// A length of time that something lasts [s].
pub(crate) fn lasting(text: &str) -> Result<f64, String> {
    number(1e-3..=1e6, "a number of seconds from 0.001 to 1000000")(text)
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    number(f64::MIN_POSITIVE..=1000.0, "a number above 0, at most 1000")(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_legal_is_taken_and_what_is_not_is_told_the_range() {
        assert_eq!((wait("0"), lasting("0.5")), (Ok(0.0), Ok(0.5)));
        for wrong in ["nan", "inf", "-1", "", "1e9", "\u{1b}[2J"] {
            assert!(wait(wrong).unwrap_err().contains("0 to 3600"), "{wrong}");
            assert!(lasting(wrong).unwrap_err().contains("0.001"), "{wrong}");
            assert!(trust(wrong).unwrap_err().contains("auto"), "{wrong}");
        }
        assert!(
            root("tmp/x").is_err()
                && root(&format!("/{}", "x".repeat(60))).is_err()
                && root("/tmp/x").is_ok()
        );
    }

    #[test]
    fn every_predictor_that_is_granted_is_offered_and_no_other() {
        for kind in PredictorKind::LIVE {
            assert_eq!(predictor(kind.name()), Ok(kind));
        }
        let refused = predictor("oracle").unwrap_err();
        assert!(refused.contains("lab") && refused.contains("mixture"), "{refused}");
        assert!(!predictor("x").unwrap_err().contains("oracle"));
    }
}
