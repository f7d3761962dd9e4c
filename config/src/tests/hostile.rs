//! Arbitrary settings files: an error, never a panic. FORETRACE_FUZZ_CASES=N runs N cases of each test.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::over_ur5;
use crate::files::LONGEST_SETTINGS;
use crate::{Config, Draft, keys};

/// Values at the edges of types and ranges.
fn value() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("nan".to_owned()),
        Just("-inf".to_owned()),
        Just("[]".to_owned()),
        Just("[[]]".to_owned()),
        Just("{}".to_owned()),
        Just("\"\"".to_owned()),
        Just("true".to_owned()),
        Just("-9223372036854775808".to_owned()),
        Just("0xFFFFFFFFFFFFFFFFFF".to_owned()),
        Just("1e308".to_owned()),
        Just("[1, \"a\", nan, [2]]".to_owned()),
        any::<f64>().prop_map(|x| format!("{x:?}")),
        any::<i32>().prop_map(|x| x.to_string()),
        proptest::collection::vec(-10.0..10.0f64, 0..8).prop_map(|list| format!("{list:?}")),
        (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64).prop_map(|(x, y, z)| format!("[{x:?}, {y:?}, {z:?}]")),
    ]
}

fn bounds() -> ProptestConfig {
    let cases =
        std::env::var("FORETRACE_FUZZ_CASES").map_or(512, |text| text.parse().expect("a whole number"));
    // The same cases in every run: a failure can be repeated.
    let rng_seed = RngSeed::Fixed(1);
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(bounds())]

    #[test]
    fn random_bytes_in_a_file_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("random.toml");
        std::fs::write(&path, &bytes).unwrap();
        prop_assert!(Config::load(&path).is_err());
    }

    #[test]
    fn random_text_that_looks_like_toml_never_panics(
        text in "([a-z_\\.]{1,8}|[=\\[\\]{}\",'#\n \t0-9.eE+-]|é|\u{0}){0,120}"
    ) {
        let _ = over_ur5(&text);
    }

    #[test]
    fn any_value_for_any_key_gives_settings_that_render_back_or_an_error_about_it(
        i in any::<prop::sample::Index>(), value in value(),
    ) {
        let key = &keys()[i.index(keys().len())];
        match Draft::preset("ur5").set(&key.path, &value).finish() {
            Ok(config) => {
                let again = Config::parse(&config.render(), "rendered.toml", ".").unwrap();
                prop_assert_eq!(config.settings(), again.settings());
            }
            Err(error) => prop_assert!(!error.problems().is_empty() && !error.to_string().is_empty()),
        }
    }
}

#[test]
fn deep_nesting_is_refused_without_exhausting_the_stack() {
    assert!(over_ur5(&format!("a = {}{}", "[".repeat(100_000), "]".repeat(100_000))).is_err());
    assert!(over_ur5(&format!("a = {}", "{b = ".repeat(10_000))).is_err());
    assert!(over_ur5(&format!("{} = 1", vec!["a"; 10_000].join("."))).is_err());
    // As many as fit into the longest file.
    let most = LONGEST_SETTINGS as usize - 100;
    for (open, close) in [("[", "]"), ("{b=", "}"), ("[{b=", "}]")] {
        let depth = most / (open.len() + close.len());
        assert!(over_ur5(&format!("a = {}{}", open.repeat(depth), close.repeat(depth))).is_err());
    }
    let dotted = vec!["a"; most / 2].join(".");
    assert!(over_ur5(&format!("{dotted} = 1")).is_err());
    assert!(over_ur5(&format!("[{dotted}]")).is_err());
    assert!(over_ur5(&"[[a.b]]\n".repeat(most / 8)).is_err());
    let message = over_ur5(&"\n".repeat(LONGEST_SETTINGS as usize)).unwrap_err().to_string();
    assert!(message.contains("1048576 are the most that are read"), "{message}");
}
