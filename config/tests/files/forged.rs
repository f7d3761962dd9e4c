//! Settings, robot descriptions, networks and priors that were forged: each is refused with a sentence, or
//! good, in little memory and time.

use foretrace_config::models::{Assumed, ForesightModel, LstmModel, SHIPPED_PRIOR, Shipped, parse_prior};
use foretrace_config::{Config, presets};

use crate::forging::read_forged;

/// As much as a check of settings has.
const MIB: u64 = 512;

fn is_a_sentence(message: &str) {
    assert!(!message.is_empty() && message.len() < 20_000, "{} bytes: {message:.300}", message.len());
}

#[test]
fn forged_settings_and_robots_are_refused_with_a_sentence() {
    let mut seeds: Vec<Vec<u8>> = ["ur5", "ur5e"].map(|name| presets::text(name).unwrap().into()).into();
    seeds.push(Config::preset("ur5").unwrap().render().into_bytes());
    seeds.push(b"preset = \"ur5\"\n".to_vec());
    let settings = seeds.len();
    seeds.extend(["ur5", "ur5e"].map(|name| presets::robot(name).unwrap().as_bytes().to_vec()));
    assert_eq!(seeds.len(), settings + 2);
    let folder = tempfile::tempdir().unwrap();
    let [file, robot, own] = ["a.toml", "arm.urdf", "own.toml"].map(|name| folder.path().join(name));
    std::fs::write(&own, "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\n")
        .unwrap();
    read_forged("forged::forged_settings_and_robots_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        std::fs::write(&file, bytes).unwrap();
        std::fs::write(&robot, bytes).unwrap();
        for file in [&file, &own] {
            if let Err(error) = Config::load(file) {
                is_a_sentence(&error.to_string());
            }
        }
    });
}

#[test]
fn forged_networks_and_priors_are_refused_with_a_sentence() {
    let mut seeds: Vec<Vec<u8>> = Shipped::all().iter().map(|model| model.bytes.to_vec()).collect();
    // More than headers: what is damaged in a large network is mostly a weight.
    seeds.extend(seeds.clone().iter().map(|bytes| bytes[..bytes.len().min(3000)].to_vec()));
    seeds.push(SHIPPED_PRIOR.text.into());
    read_forged("forged::forged_networks_and_priors_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        let message = [
            LstmModel::parse("a", bytes, Assumed::default()).err(),
            ForesightModel::parse("a", bytes).err(),
            parse_prior("a", bytes).err(),
        ];
        message.into_iter().flatten().for_each(|error| is_a_sentence(&error.to_string()));
    });
}
