//! How many cases a fuzzer runs: `FORETRACE_FUZZ_CASES` of them, else as many as it says itself; the same in
//! every run.

use proptest::prelude::ProptestConfig;
use proptest::test_runner::RngSeed;

pub(crate) fn cases(usual: u32) -> ProptestConfig {
    let asked = std::env::var("FORETRACE_FUZZ_CASES");
    let cases = asked.map_or(usual, |text| text.parse().expect("FORETRACE_FUZZ_CASES is a whole number"));
    ProptestConfig {
        cases,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    }
}
