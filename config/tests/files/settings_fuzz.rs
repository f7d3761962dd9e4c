//! Damaged settings files and URDFs, with fixed seeds: no panic, every refusal names its file or key, and
//! whatever is accepted moves an arm by legal commands only.
//!
//! FORETRACE_FUZZ_CASES=N runs N cases of each.

use std::path::Path;

use foretrace_config::{Config, JOINTS, presets};
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, StepInput};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Most accepted cases build a whole control law and run it.
const CASES: u32 = 300;
const TICKS: u64 = 60;

fn cases() -> u32 {
    std::env::var("FORETRACE_FUZZ_CASES").map_or(CASES, |text| text.parse().expect("a whole number"))
}

/// What stands in the place of a value: of every type, of every size, and close to what is legal.
fn value(random: &mut Pcg64, old: &str) -> String {
    const WORDS: [&str; 20] = [
        "nan",
        "inf",
        "-inf",
        "0",
        "-0.0",
        "-1",
        "1e308",
        "5e-324",
        "true",
        "\"\"",
        "\"auto\"",
        "[]",
        "[[1]]",
        "{}",
        "9223372036854775807",
        "0x10",
        "[0, 0, 0]",
        "[0, 0, 1]",
        "\"mixture\"",
        "1979-05-27",
    ];
    let numbers: Result<Vec<f64>, _> =
        old.trim_matches(['[', ']']).split(',').map(|part| part.trim().parse()).collect();
    match (random.random_range(0..4), numbers) {
        (0, _) | (_, Err(_)) => WORDS[random.random_range(0..WORDS.len())].to_owned(),
        (how, Ok(mut numbers)) => {
            let at = random.random_range(0..numbers.len());
            let spread = if how == 1 { 6.0 } else { 0.5 };
            numbers[at] *= 10.0f64.powf(random.random_range(-spread..spread));
            if random.random_bool(0.1) {
                numbers[at] = -numbers[at];
            }
            // Whole numbers stay whole: many keys take nothing else.
            let whole = !old.contains('.');
            let texts: Vec<String> =
                numbers.iter().map(|x| if whole { format!("{x:.0}") } else { format!("{x:?}") }).collect();
            if old.starts_with('[') { format!("[{}]", texts.join(", ")) } else { texts.concat() }
        }
    }
}

/// One to three changed values, lost or doubled lines, or damaged bytes.
fn mutate(random: &mut Pcg64, whole: &str) -> String {
    let mut lines: Vec<String> = whole.lines().map(str::to_owned).collect();
    for _ in 0..random.random_range(1..4) {
        let at = random.random_range(0..lines.len());
        let pair = lines[at].split_once(" = ").map(|(key, old)| (key.to_owned(), old.to_owned()));
        match (random.random_range(0..12), pair) {
            (0, _) => drop(lines.remove(at)),
            (1, _) => lines.insert(at, lines[random.random_range(0..lines.len())].clone()),
            (2, _) => {
                let mut bytes = std::mem::take(&mut lines[at]).into_bytes();
                if let Some(byte) = bytes.get_mut(0..).filter(|bytes| !bytes.is_empty()) {
                    let index = random.random_range(0..byte.len());
                    byte[index] = b"[]{}\"'=#.,-+e_ \x00\x7f9"[random.random_range(0..18)];
                }
                lines[at] = String::from_utf8_lossy(&bytes).into_owned();
            }
            (_, Some((key, old))) => lines[at] = format!("{key} = {}", value(random, &old)),
            _ => {}
        }
    }
    lines.join("\n")
}

/// Bytes of a URDF: numbers changed, pieces lost, doubled, or damaged.
fn mutate_urdf(random: &mut Pcg64, urdf: &str) -> Vec<u8> {
    let mut bytes = urdf.as_bytes().to_vec();
    for _ in 0..random.random_range(1..4) {
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(1..60)).min(bytes.len());
        match random.random_range(0..8) {
            0 => drop(bytes.drain(at..end)),
            1 => bytes[at] = random.random(),
            2 => {
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                // A digit, so that the numbers are reached: another one, or what is not a number.
                let Some(digit) = bytes[at..].iter().position(u8::is_ascii_digit) else { continue };
                let words: [&[u8]; 8] = [b"0", b"9", b"-1", b"1e9", b"nan", b"inf", b"", b"1e-300"];
                bytes.splice(at + digit..=at + digit, words[random.random_range(0..8)].iter().copied());
            }
        }
    }
    bytes
}

/// Arms the follower that `config` describes, moves the pen wildly, stops; true when joints moved.
fn drive<const N: usize>(config: &Config, random: &mut Pcg64) -> bool {
    let settings = config.follower_settings();
    let (period_ns, limits) = (settings.period_ns, settings.limits);
    let mut follower = Follower::<N, JOINTS>::new(settings).expect("a config was judged by the law");
    let mut judge = CommandChecker::new(limits);
    let mut now = Stamp(10_000_000_000);
    let mut joints =
        JointReading { stamp: now, q: config.robot().home, qd: [0.0; JOINTS], motion_allowed: true };
    let mut moved = false;
    for tick in 0..TICKS {
        joints.stamp = now;
        let reach = if random.random_bool(0.1) { 1e3 } else { 0.2 };
        let pen = PenReading::new(now, std::array::from_fn(|_| random.random_range(-reach..reach)), true);
        let request = match tick {
            0 => Some(Request::Arm),
            40 => Some(Request::Stop),
            _ => None,
        };
        let input = StepInput { pen: &[pen], joints: Some(&joints), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        if let Some(command) = output.command {
            let legal = judge.observe(command.stamp, command.valid_until, &command.q, &command.qd);
            assert!(legal, "tick {tick}: {command:?}, {:?}", judge.statistics().violations);
            moved |= command.qd.iter().any(|qd| *qd != 0.0);
            (joints.q, joints.qd) = (command.q, command.qd);
        }
        now = now + period_ns;
    }
    moved
}

/// Checks a config or its refusal; returns whether it was accepted, and whether the arm moved.
fn judge(
    case: u32,
    parsed: Result<Config, foretrace_config::ConfigError>,
    named: &str,
    random: &mut Pcg64,
) -> [bool; 2] {
    match parsed {
        Ok(config) => {
            let again = Config::parse(&config.render(), "again.toml", ".");
            assert_eq!(
                config.settings(),
                again.expect("what was accepted renders back").settings(),
                "case {case}"
            );
            let moved = match config.settings().mpc.horizon {
                10 => drive::<10>(&config, random),
                20 => drive::<20>(&config, random),
                _ => drive::<30>(&config, random),
            };
            [true, moved]
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains(named) && text.len() < 20_000, "case {case}: {text}");
            [false; 2]
        }
    }
}

#[test]
fn damaged_settings_never_panic_and_what_is_accepted_moves_legally() {
    let mut random = Pcg64::seed_from_u64(11);
    let wholes = ["ur5", "ur5e"].map(|name| Config::preset(name).unwrap().render());
    let mut counts = [0; 2];
    for case in 0..cases() {
        let text = mutate(&mut random, &wholes[case as usize % 2]);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            judge(case, Config::parse(&text, "fuzz.toml", "."), "fuzz.toml", &mut random)
        }));
        let seen = caught.unwrap_or_else(|_| panic!("case {case}:\n{text}"));
        counts.iter_mut().zip(seen).for_each(|(count, seen)| *count += u32::from(seen));
    }
    reaches("settings", counts);
}

#[test]
fn damaged_urdfs_never_panic_and_what_is_accepted_moves_legally() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arm.urdf");
    let urdf = presets::robot("ur5").unwrap();
    let mut random = Pcg64::seed_from_u64(12);
    let mut counts = [0; 2];
    for case in 0..cases() {
        let bytes = mutate_urdf(&mut random, urdf);
        std::fs::write(&path, &bytes).unwrap();
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            judge(case, load(folder.path()), "key `", &mut random)
        }));
        let seen = caught.unwrap_or_else(|_| panic!("case {case}:\n{}", bytes.escape_ascii()));
        counts.iter_mut().zip(seen).for_each(|(count, seen)| *count += u32::from(seen));
    }
    reaches("urdf", counts);
}

/// Enough was accepted and moved, and not everything; a few cases, as when one is looked for, prove nothing
/// either way.
fn reaches(what: &str, [accepted, moved]: [u32; 2]) {
    println!("{what}: {accepted} of {} accepted, {moved} moved", cases());
    if cases() >= CASES {
        assert!(accepted > cases() / 10 && accepted < cases() && moved > accepted / 2, "{accepted}, {moved}");
    }
}

fn load(folder: &Path) -> Result<Config, foretrace_config::ConfigError> {
    Config::parse(
        "preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\ntool_m = [0.0, 0.0, 0.15]\n",
        "fuzz.toml",
        folder,
    )
}
