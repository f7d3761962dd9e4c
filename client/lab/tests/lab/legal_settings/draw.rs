//! Random legal values for the keys of the law, checked by `config` itself.

use std::sync::OnceLock;

use foretrace_config::{Config, Draft, Key, Legal, keys};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sections whose keys are drawn.
const SECTIONS: [&str; 7] = ["mpc", "ik", "plane", "robot", "safety", "pen", "trust"];
/// Lists with an entry per joint that presets leave out.
const PER_JOINT: [&str; 5] = [
    "robot.jerk_radps3",
    "robot.stale_deceleration_radps2",
    "robot.position_min_rad",
    "robot.position_max_rad",
    "robot.acceleration_radps2",
];

fn rendered(preset: &str) -> &'static str {
    static TEXTS: OnceLock<[String; 2]> = OnceLock::new();
    let [ur5, ur5e] =
        TEXTS.get_or_init(|| ["ur5", "ur5e"].map(|name| Config::preset(name).unwrap().render()));
    if preset == "ur5" { ur5 } else { ur5e }
}

fn drawn() -> Vec<&'static Key> {
    let ours = |key: &&Key| {
        let section = key.path.split('.').next().unwrap_or_default();
        SECTIONS.contains(&section) && key.legal != Legal::Text
    };
    keys().iter().filter(ours).collect()
}

/// The value of `key` in a rendered preset, if it is written there.
fn preset_value<'a>(preset: &'a str, key: &Key) -> Option<&'a str> {
    let mut section = "";
    for line in preset.lines() {
        if let Some(name) = line.strip_prefix('[') {
            section = name.trim_end_matches(']');
        } else if let Some((name, value)) = line.trim_start_matches("# ").split_once(" = ")
            && section == key.section
            && key.path.ends_with(&format!(".{name}"))
        {
            return Some(value.trim());
        }
    }
    None
}

fn number(random: &mut Pcg64, (low, high): (f64, f64), old: Option<f64>) -> f64 {
    match (random.random_range(0..8), old) {
        (0, _) => low,
        (1, _) => high,
        (2..5, Some(old)) => (old * 10.0_f64.powf(random.random_range(-1.0..1.0))).clamp(low, high),
        (5, Some(old)) => (old * 2.0_f64.powf(random.random_range(-1.0..1.0))).clamp(low, high),
        _ if low > 0.0 => low * (high / low).powf(random.random_range(0.0..1.0)),
        _ => random.random_range(low..=high),
    }
}

/// How a value is drawn.
#[derive(Clone, Copy, PartialEq)]
enum How {
    Lowest,
    Highest,
    Any,
}

fn value(random: &mut Pcg64, key: &Key, old: Option<&str>, how: How) -> String {
    match key.legal {
        Legal::Between(low, high) => {
            let whole = key.legal_text.contains("whole");
            let text = |x: f64| if whole { format!("{:.0}", x.round()) } else { format!("{x:?}") };
            let mut draw = |old: Option<f64>| match how {
                How::Lowest => low,
                How::Highest => high,
                How::Any => number(random, (low, high), old),
            };
            if PER_JOINT.contains(&key.path.as_str()) && old.is_none_or(|old| !old.starts_with('[')) {
                let all: Vec<_> = (0..6).map(|_| text(draw(None))).collect();
                return format!("[{}]", all.join(", "));
            }
            let Some(list) = old.filter(|old| old.starts_with('[')) else {
                let drawn = draw(old.and_then(|old| old.parse().ok()));
                return text(drawn);
            };
            // Lists keep their shape; all entries by the same factor, or each by its own.
            let numbers = list.split(['[', ']', ',']).filter_map(|part| part.trim().parse::<f64>().ok());
            let numbers: Vec<f64> = numbers.collect();
            let same = draw(numbers.first().copied());
            let alike = numbers.iter().all(|x| *x == numbers[0]);
            let mut entries = numbers.iter().map(|old| if alike { same } else { draw(Some(*old)) });
            let mut out = String::new();
            let mut inside = false;
            for c in list.chars() {
                if matches!(c, '[' | ']' | ',' | ' ') {
                    inside = false;
                    out.push(c);
                } else if !inside {
                    inside = true;
                    out.push_str(&text(entries.next().unwrap_or(low)));
                }
            }
            out
        }
        Legal::OneOf(numbers) => format!("{}", numbers[random.random_range(0..numbers.len())]),
        Legal::Words(words) => format!("{:?}", words[random.random_range(0..words.len())]),
        Legal::Flag => random.random_bool(0.5).to_string(),
        Legal::Text => unreachable!(),
    }
}

/// Two extremes per key: so many cases go through all of them.
pub(crate) fn extremes() -> u64 {
    2 * drawn().len() as u64
}

/// A combination that `config` accepts.
pub(crate) struct Accepted {
    pub(crate) config: Config,
    /// What was changed, as written on a command line.
    pub(crate) changed: String,
    /// Combinations refused before.
    pub(crate) refused: u64,
    /// The extreme of this case, if it was never accepted, not even alone.
    pub(crate) left_out: Option<String>,
}

/// How often an extreme is tried among other changes, and then by itself.
const AMONG_OTHERS: u64 = 8;
const BY_ITSELF: u64 = 8;

/// A combination with the extreme of the key that the number of the case selects; the first [`extremes`]
/// cases go through all.
pub(crate) fn accepted(random: &mut Pcg64, case: u64) -> Accepted {
    let keys = drawn();
    let extreme_key = keys[(case / 2) as usize % keys.len()];
    let how = if case.is_multiple_of(2) { How::Lowest } else { How::Highest };
    for refused in 0.. {
        let preset = ["ur5", "ur5e"][random.random_range(0..2)];
        let rendered = rendered(preset);
        let mut draft = Draft::preset(preset);
        let mut changed = vec![preset.to_owned()];
        let mut set = |draft: Draft, key: &Key, how: How, random: &mut Pcg64| {
            let value = value(random, key, preset_value(rendered, key), how);
            changed.push(format!("{}={value}", key.path));
            draft.set(&key.path, &value)
        };
        let with_extreme = refused < AMONG_OTHERS + BY_ITSELF;
        if with_extreme {
            draft = set(draft, extreme_key, how, random);
        }
        let among_others = !(AMONG_OTHERS..AMONG_OTHERS + BY_ITSELF).contains(&refused);
        let more = match random.random_range(0..6) {
            _ if !among_others => 0,
            0 => 0,
            1..4 => random.random_range(1..4),
            4 => random.random_range(4..8),
            _ => random.random_range(8..20),
        };
        for _ in 0..more {
            let key = keys[random.random_range(0..keys.len())];
            draft = set(draft, key, How::Any, random);
        }
        if among_others && random.random_bool(0.3) {
            let rate = [125, 250, 500, 1000][random.random_range(0..4)];
            draft = draft.rate(rate);
            changed.push(format!("rate {rate}"));
        }
        if let Ok(config) = draft.finish() {
            let end = if how == How::Lowest { "lowest" } else { "highest" };
            let left_out = (!with_extreme).then(|| format!("{end} {}", extreme_key.path));
            return Accepted { config, changed: changed.join(" "), refused, left_out };
        }
    }
    unreachable!()
}
