//! The model loader against damaged files: bounded, with fixed seeds. It never panics, and what it lets
//! through is finite.
//!
//! FORETRACE_FUZZ_CASES=N runs N cases.

use foretrace_config::models::{Assumed, DType, LstmModel, Shipped};
use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};
use foretrace_control::predict::{Lstm, Predictor};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const CASES: u32 = 60_000;
const BARE: Assumed = Assumed { input_scale: Some(1.0), step_ns: Some(5_000_000) };

/// Valid files of several kinds.
fn seeds() -> Vec<Vec<u8>> {
    let mut seeds: Vec<Vec<u8>> = Shipped::all().iter().map(|model| model.bytes.to_vec()).collect();
    seeds.push(include_bytes!("fixtures/lstm/lstm2-10_linear10-2.safetensors").to_vec());
    let spec =
        LstmSpec { leads: 3, residual: true, input_clip: Some(4.0), ..LstmSpec::plain(10, 10.0, 10_000_000) };
    let weights = LstmWeights::new(spec, LstmTensors::zero(10, 3)).unwrap();
    let model = LstmModel { file: String::new(), weights: weights.into(), notes: Default::default() };
    seeds.push(model.to_bytes(DType::F64));
    seeds
}

/// One to four cuts, flips, insertions, deletions, or pieces of another file; the header twice as often as
/// the rest.
fn mutate(random: &mut Pcg64, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut below = |n: usize| random.random_range(0..n.max(1));
    let mut bytes = seeds[below(seeds.len())].clone();
    for _ in 0..=below(4) {
        let header = bytes.len().min(2000);
        let at = if below(3) < 2 { below(header) } else { below(bytes.len()) };
        match below(7) {
            0 => bytes.truncate(at),
            1 if at < bytes.len() => bytes[at] ^= 1 << below(8),
            2 if at < bytes.len() => bytes[at] = b"0123456789[]{}\",:-.eEF \xff\x00\x80"[below(26)],
            3 => bytes.insert(at, below(256) as u8),
            4 => drop(bytes.drain(at..(at + below(20)).min(bytes.len()))),
            5 => {
                let other = &seeds[below(seeds.len())];
                let from = below(other.len());
                let piece = other[from..(from + below(64)).min(other.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            // A number of the data becomes NaN, infinite, or huge.
            _ if bytes.len() > 16 => {
                let at = bytes.len() - 4 - 4 * below((bytes.len() - 8) / 4);
                let poison = [f32::NAN, f32::INFINITY, -f32::MAX, 1e30][below(4)];
                bytes[at..at + 4].copy_from_slice(&poison.to_le_bytes());
            }
            _ => {}
        }
    }
    bytes
}

#[test]
fn damaged_files_never_panic_and_never_give_poison() {
    let cases =
        std::env::var("FORETRACE_FUZZ_CASES").map_or(CASES, |text| text.parse().expect("a whole number"));
    let seeds = seeds();
    let mut random = Pcg64::seed_from_u64(7);
    let (mut accepted, mut poison_found) = (0, 0);
    for case in 0..cases {
        let bytes = mutate(&mut random, &seeds);
        match LstmModel::parse("fuzz", &bytes, BARE) {
            Ok(model) => {
                accepted += 1;
                let numbers = model.weights.tensors().all();
                assert!(
                    numbers.into_iter().flatten().all(|w| w.abs() <= LstmWeights::MAX_MAGNITUDE),
                    "case {case}"
                );
                let mut lstm = Lstm::new(model.weights);
                let mut out = [[0.0; 2]; 12];
                for _ in 0..3 {
                    lstm.observe([1e6, -20.0]);
                    lstm.preview(&mut out);
                }
                assert!(out.as_flattened().iter().all(|x| x.is_finite()), "case {case}");
            }
            Err(error) => {
                let text = error.to_string();
                poison_found += u32::from(text.contains(" at index "));
                assert!(text.starts_with("fuzz: ") && text.len() < 4000, "case {case}: {text}");
            }
        }
    }
    // The mutations reach both ends of the loader: a flipped bit of a weight loads, a poisoned one is found.
    assert!(accepted > cases / 50, "only {accepted} of {cases} were accepted");
    assert!(poison_found > cases / 100, "only {poison_found} of {cases} held poison");
}
