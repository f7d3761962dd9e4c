//! The weights from which refinement starts, as a file: the shipped one is the law's own, and everything that
//! can be wrong with one is refused with place, value and bounds.

use foretrace_config::models::{SHIPPED_PRIOR, find_prior, parse_prior};
use foretrace_config::{Config, ConfigError};
use foretrace_control::estimate::refine::RefinePrior;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const CASES: u32 = 20_000;

/// The shipped file with `old` replaced by `new`, which must change it.
fn changed(old: &str, new: &str) -> String {
    let text = SHIPPED_PRIOR.text.replacen(old, new, 1);
    assert_ne!(text, SHIPPED_PRIOR.text, "{old:?} does not stand in the file");
    text
}

fn refused(text: impl AsRef<[u8]>) -> String {
    parse_prior("mine.toml", text.as_ref()).unwrap_err().to_string()
}

#[test]
fn the_shipped_file_says_bit_for_bit_what_the_law_has_without_it() {
    let file = find_prior(SHIPPED_PRIOR.name).unwrap();
    assert_eq!(file, RefinePrior::SHIPPED);
    for (lead, phase, clarity) in
        (1..=24).flat_map(|lead| [0.125, 0.375, 0.875].map(|phase| (lead, phase, f64::from(lead) / 24.0)))
    {
        let bits = |prior: &RefinePrior| prior.weights(f64::from(lead) - phase, clarity).map(f64::to_bits);
        assert_eq!(bits(&file), bits(&RefinePrior::SHIPPED));
    }
    assert_eq!(*Config::preset("ur5").unwrap().prior(), RefinePrior::SHIPPED);
}

#[test]
fn its_card_says_what_it_is_made_of_and_what_is_not_known() {
    let card = SHIPPED_PRIOR.card;
    assert!(card.starts_with(&format!("# {}\n", SHIPPED_PRIOR.name)));
    for word in
        ["| data", "| split", "| fit", "| scores", "*Limits.*", "citation", "*Licence of the weights.*"]
    {
        assert!(card.contains(word), "the card says nothing about {word}");
    }
}

#[test]
fn numbers_out_of_bounds_are_named_with_key_value_and_bounds() {
    let of = |old: &str, new: &str| refused(changed(old, new));
    assert_eq!(
        of("base = -0.6", "base = nan"),
        "mine.toml: the weights that refinement starts from: coarse.left: base = NaN is outside -4 to 4"
    );
    assert_eq!(
        of("amplitude = -0.9", "amplitude = 1e308"),
        format!(
            "mine.toml: the weights that refinement starts from: coarse.acceleration: amplitude = {} is \
             outside -4 to 4",
            1e308
        )
    );
    assert_eq!(
        of("reach_steps = 12.0", "reach_steps = 0.0"),
        "mine.toml: the weights that refinement starts from: clean.left: reach_steps = 0 is outside 0.01 to \
         1000"
    );
    for bad in ["-inf", "+inf", "-1.5", "1001.0", "nan"] {
        let message = of("reach_steps = 9.0", &format!("reach_steps = {bad}"));
        assert!(message.contains("clean.velocity: reach_steps = "), "{bad}: {message}");
    }
}

#[test]
fn missing_and_unknown_keys_words_and_kinds_are_named_with_their_line() {
    let line = 1 + SHIPPED_PRIOR.text.lines().position(|line| line.starts_with("innovation")).unwrap();
    for (old, new, message) in [
        ("innovation = { base = 0.0, parts", "innovation = { parts", "missing field `base`"),
        ("innovation = { base = 0.0, parts", "innovation = { base = 0.0, parst", "unknown field `parst`"),
        ("innovation = { base = 0.0", "innovation = { base = 0.0, gain = 1.0", "unknown field `gain`"),
        (
            "shape = \"growing\"",
            "shape = \"groing\"",
            "unknown variant `groing`, expected one of `fading`, `growing`",
        ),
        ("amplitude = 1.9, ", "", "missing field `amplitude`"),
        ("amplitude = 1.9", "amplitude = \"1.9\"", "invalid type: string"),
        ("innovation = { base = 0.0,", "innovation = { base = 0.0,,", ""),
        ("innovation = ", "left = ", "duplicate key"),
    ] {
        let text = changed(old, new);
        let error = refused(&text);
        assert!(
            error.starts_with(&format!("mine.toml: not where refinement can start, line {line}: ")),
            "{error}"
        );
        assert!(
            error.contains(message) && error.ends_with("refine-prior.toml as a pattern"),
            "{message}: {error}"
        );
    }
    let whole = [("[clean]", "[celan]", "unknown field `celan`"), ("[coarse.acceleration]", "[clean.x]", "")];
    for (old, new, message) in whole {
        let error = refused(changed(old, new));
        assert!(error.contains(message) && error.contains("not where refinement can start"), "{error}");
    }
    let part = "{ amplitude = -0.9, shape = \"fading\", reach_steps = 0.6 },";
    let crowded = refused(changed(part, &part.repeat(2)));
    assert!(crowded.contains("a term has 3 parts, there is room for 2"), "{crowded}");
}

#[test]
fn what_is_no_such_file_at_all_is_refused_in_few_words() {
    for (bytes, message) in [
        (vec![], "missing field `coarse`"),
        (vec![0xff; 10], "it is not text"),
        (vec![b' '; 40_000], "it is longer than 32768 bytes"),
        (format!("{} = 1", "a".repeat(30_000)).into_bytes(), "unknown field `aaa"),
        (format!("coarse = {}", "[".repeat(30_000)).into_bytes(), "line 1"),
        (vec!["a"; 10_000].join(".").into_bytes(), "line 1"),
    ] {
        let error = refused(&bytes);
        assert!(error.contains(message) && error.len() < 500, "{message}: {error}");
    }
    let error = find_prior("/nowhere/prior.toml").unwrap_err().to_string();
    assert!(
        error.starts_with("/nowhere/prior.toml: cannot be read (No such file")
            && error.ends_with("refine-prior"),
        "{error}"
    );
    // It never ends, and has no size.
    let endless = find_prior("/dev/zero").unwrap_err().to_string();
    assert!(endless.contains("not a regular file"), "{endless}");
    let no_size = find_prior("/proc/kallsyms").unwrap_err().to_string();
    assert!(no_size.contains("more than 32768 bytes"), "{no_size}");
}

#[test]
fn damaged_files_never_panic_and_never_give_weights_without_bounds() {
    let cases =
        std::env::var("FORETRACE_FUZZ_CASES").map_or(CASES, |text| text.parse().expect("a whole number"));
    let mut random = Pcg64::seed_from_u64(8);
    // Without the comments, which may be damaged freely.
    let text: String = SHIPPED_PRIOR
        .text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| format!("{line}\n"))
        .collect();
    let mut accepted = 0;
    for case in 0..cases {
        let mut below = |n: usize| random.random_range(0..n.max(1));
        let mut bytes = text.clone().into_bytes();
        for _ in 0..=below(3) {
            let at = below(bytes.len());
            match below(4) {
                0 => bytes[at] = b"0123456789[]{}\",.-eEinf#= \n\xff"[below(28)],
                1 => bytes.insert(at, b"0123456789.-e"[below(13)]),
                2 => drop(bytes.drain(at..(at + below(20)).min(bytes.len()))),
                _ => bytes.truncate(bytes.len() - below(3)),
            }
        }
        match parse_prior("fuzz", &bytes) {
            Ok(prior) => {
                accepted += 1;
                let weights = [0.1, 1.0, 23.9].map(|ahead| prior.weights(ahead, 0.5));
                // Two parts and a base, each at most 4.
                assert!(
                    weights.as_flattened().iter().all(|weight| weight.abs() <= 12.0),
                    "case {case}: {weights:?}"
                );
            }
            Err(error) => {
                let message = error.to_string();
                assert!(message.starts_with("fuzz: ") && message.len() < 1000, "case {case}: {message}");
            }
        }
    }
    assert!(accepted > cases / 50 && accepted < cases, "{accepted} of {cases} were accepted");
}

/// Settings over the UR5 preset in `folder`, with a prior.
fn over_ur5(folder: &std::path::Path, prior: &str) -> Result<Config, ConfigError> {
    Config::parse(
        &format!("preset = \"ur5\"\n[predictor.refine]\nprior = \"{prior}\"\n"),
        "mine.toml",
        folder,
    )
}

#[test]
fn settings_name_another_file_and_the_law_starts_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hands.toml");
    std::fs::write(&file, changed("amplitude = 1.9", "amplitude = 1.5")).unwrap();
    let config = over_ur5(folder.path(), "hands.toml").unwrap();
    let [shipped, own] =
        [RefinePrior::SHIPPED, config.follower_settings().prior].map(|prior| prior.coarse.innovation.at(6.0));
    assert!((own / shipped - 1.5 / 1.9).abs() < 1e-12, "{own} {shipped}");
    assert_eq!(*over_ur5(folder.path(), "refine-prior").unwrap().prior(), RefinePrior::SHIPPED);
    // Shown elsewhere they load the same file.
    assert_eq!(Config::parse(&config.render(), "shown.toml", "/").unwrap().prior(), config.prior());
    // Another content of the same file takes effect at start only.
    std::fs::write(&file, SHIPPED_PRIOR.text).unwrap();
    let refused = config.live_diff(&over_ur5(folder.path(), "hands.toml").unwrap()).unwrap_err();
    assert!(refused[0].to_string().contains("predictor.refine.prior"), "{}", refused[0]);
    std::fs::write(&file, changed("base = -0.6", "base = -6.0")).unwrap();
    let error = over_ur5(folder.path(), "hands.toml").unwrap_err().to_string();
    for word in [
        "mine.toml:3",
        "predictor.refine.prior",
        "coarse.left: base = -6 is outside -4 to 4",
        "leave the key out",
    ] {
        assert!(error.contains(word), "{word}: {error}");
    }
}
