//! In plain words: what a tick saw, decided and cost, and the moments of a recording that matter.
//!
//! Contract: says only what the tick records hold, and where records of most ticks were never wanted
//! (`telemetry.every_ticks`), that it does not know them. Keeps no more than two records and the moments
//! found.

use std::path::Path;

use foretrace_shm::{
    FaultReason, Mode, PieceKind, Rung, Stage, Thing, TickRecord, TrustReason, guard_mask, health, pen_flags,
};
use serde::Serialize;

use crate::RecordError;
use crate::read::{Content, RecordingEntry, RecordingReader};

/// Moments that are told at most.
const MOMENTS: usize = 10;

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moment {
    pub tick: u64,
    /// After the first record \[s\].
    pub after_s: f64,
    pub what: String,
    /// The larger, the more it matters.
    #[serde(skip)]
    weight: f64,
    /// Of one kind only the weightiest is kept, except for stops.
    #[serde(skip)]
    kind: &'static str,
}

/// What a recording tells.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explanation {
    /// The moments that matter most, in order of time.
    pub moments: Vec<Moment>,
    /// The daemon was set to record every n-th tick only; 1: every tick. Of several, the largest.
    pub every_ticks: u64,
    /// Where and why the file ends early; `None`: it is whole.
    pub damage: Option<String>,
}

/// The moments of `path` that matter most.
///
/// # Errors
///
/// It is not a recording of this program's layout, or holds no tick records.
pub fn moments(path: &Path) -> Result<Explanation, RecordError> {
    let mut found: Vec<Moment> = Vec::new();
    let mut last: Option<Box<TickRecord>> = None;
    let (mut begin, mut most) = (0, 1);
    let reader = each_tick(path, |record, every| {
        if last.is_none() {
            begin = record.release_ns;
        }
        most = most.max(every);
        for (kind, weight, what) in seen(last.as_deref(), &record, every) {
            let after_s = record.release_ns.saturating_sub(begin) as f64 * 1e-9;
            keep(&mut found, Moment { tick: record.tick, after_s, what, weight, kind });
        }
        last = Some(record);
        true
    })?;
    if last.is_none() {
        return Err(no_ticks(&reader));
    }
    found.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    found.truncate(MOMENTS);
    found.sort_by_key(|moment| moment.tick);
    Ok(Explanation { moments: found, every_ticks: most, damage: reader.damage() })
}

/// What `tick` saw, decided and cost, as sentences.
///
/// # Errors
///
/// It is not a recording of this program's layout, or does not hold that tick.
pub fn tick(path: &Path, tick: u64) -> Result<Vec<String>, RecordError> {
    let (mut found, mut range): (Option<Box<TickRecord>>, Option<(u64, u64)>) = (None, None);
    let mut every_ticks = 1;
    let reader = each_tick(path, |record, every| {
        let (first, _) = range.unwrap_or((record.tick, 0));
        range = Some((first, record.tick));
        every_ticks = every;
        if record.tick == tick {
            found = Some(record);
        }
        found.is_none()
    })?;
    match (found, range) {
        (Some(record), _) => Ok(sentences(&record)),
        (None, None) => Err(no_ticks(&reader)),
        (None, Some((first, last))) => Err(RecordError::Format {
            path: path.to_path_buf(),
            why: match (every_ticks, reader.damage()) {
                (_, Some(damage)) => format!(
                    "it has no record of tick {tick}; there are ticks {first} to {last}, and it ends early, \
                     {damage}"
                ),
                (1, None) => format!("it has no record of tick {tick}; there are ticks {first} to {last}"),
                (n, None) => format!(
                    "it has no record of tick {tick}: the daemon recorded one tick of {n} \
                     (telemetry.every_ticks); there are ticks {first} to {last}"
                ),
            },
        }),
    }
}

fn no_ticks(reader: &RecordingReader) -> RecordError {
    let why = "it holds no tick records";
    let otherwise = || RecordError::Format { path: reader.path().to_path_buf(), why: why.to_owned() };
    reader.lack(why).unwrap_or_else(otherwise)
}

/// Calls `use_record` with each record and its daemon's `telemetry.every_ticks` until it returns false;
/// returns the reader, which tells how the file ended if it came there.
fn each_tick(
    path: &Path,
    mut use_record: impl FnMut(Box<TickRecord>, u64) -> bool,
) -> Result<RecordingReader, RecordError> {
    // A recorder gets the settings some records after the first one.
    let mut every = 1;
    let mut reader = RecordingReader::open(path)?;
    while let Some(entry) = reader.next_entry()? {
        if let RecordingEntry::Message(message) = entry
            && let Ok(Content::Thing(thing)) = reader.ticks_and_things(&message)
            && let Some(found) = every_ticks(&thing)
        {
            every = found;
            break;
        }
    }
    let (mut reader, mut goes_on) = (RecordingReader::open(path)?, true);
    while goes_on && let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        match reader.ticks_and_things(&message)? {
            Content::Thing(thing) => every = every_ticks(&thing).unwrap_or(every),
            Content::Tick(record) => goes_on = use_record(record, every),
            _ => {}
        }
    }
    Ok(reader)
}

/// One tick of how many is recorded under the settings in `thing`, if it has any.
fn every_ticks(thing: &Thing) -> Option<u64> {
    let text = std::str::from_utf8(&thing.bytes).ok().filter(|_| thing.kind == PieceKind::Settings)?;
    // Read as a table: what the settings name need not be here, and they may be of another version.
    let table: toml::Table = text.parse().ok()?;
    let every = table.get("telemetry").and_then(|section| section.get("every_ticks")?.as_integer());
    Some(every.and_then(|every| u64::try_from(every).ok()).unwrap_or(1).max(1))
}

fn keep(found: &mut Vec<Moment>, moment: Moment) {
    let same = found.iter().position(|other| other.kind == moment.kind && moment.kind != "stop");
    if let Some(other) = same.and_then(|index| found.get_mut(index)) {
        if moment.weight > other.weight {
            *other = moment;
        }
    } else if found.len() < 64 {
        // A recording of a life full of stops tells the first ones.
        found.push(moment);
    }
}

/// What `record` shows that `before` did not, which is `every` ticks earlier: kind, weight, words.
fn seen(before: Option<&TickRecord>, record: &TickRecord, every: u64) -> Vec<(&'static str, f64, String)> {
    let mut found = Vec::new();
    let mut tell = |kind, weight: f64, words: String| found.push((kind, weight, words));
    let mode = Mode::try_from(record.mode).unwrap_or(Mode::Idle);
    let has = |bit: u32| record.health & bit != 0;
    if has(health::OVERRUN) {
        let late_us = -record.slack_ns as f64 * 1e-3;
        tell("overrun", 1e5 + late_us, format!("the tick ended {late_us:.0} µs late: {}", costs(record)));
    }
    if record.error_m >= 0.0 {
        let (error_mm, ghost) = (record.error_m * 1e3, ghost(record));
        let words = format!("the tool was {error_mm:.2} mm off the pen, at {}{ghost}", trust(record));
        tell("error", 1e3 + error_mm, words);
    }
    let Some(before) = before else { return found };
    let passed = record.tick.saturating_sub(before.tick);
    let missing = (passed / every.max(1)).saturating_sub(1);
    if missing > 0 {
        tell("gap", 5e3 + missing as f64, format!("{missing} records before it are missing"));
    }
    let late = record.counters.overruns.saturating_sub(before.counters.overruns);
    // A tick after lost periods is counted as late too.
    let unseen = late.saturating_sub(u64::from(has(health::OVERRUN) || record.skipped_ticks > 0));
    if unseen > 0 && passed > 1 {
        let words = format!("{unseen} of the {} ticks before it that have no record ended late", passed - 1);
        tell("unseen overrun", 9e4 + unseen as f64, words);
    }
    if record.skipped_ticks > 0 {
        let skipped = f64::from(record.skipped_ticks);
        tell("skipped", 8e4 + skipped, format!("{skipped} whole periods passed before it without a tick"));
    }
    if before.mode != record.mode {
        if matches!(mode, Mode::Stopped | Mode::Fault) {
            tell("stop", 1e6, stopped(record));
        } else {
            let was = Mode::try_from(before.mode).map_or("unknown", Mode::label);
            // Between following and holding the hand goes to and fro.
            let weight = if matches!(mode, Mode::Armed | Mode::Idle | Mode::Homing) { 3e4 } else { 2e2 };
            tell(mode.label(), weight, format!("it went from {was} to {mode}"));
        }
    }
    let follows = matches!(mode, Mode::Following);
    let rung = Rung::try_from(record.rung).unwrap_or(Rung::Hold);
    if follows && rung != Rung::FreshPlan && before.rung != record.rung {
        tell("rung", 2e4, format!("no plan of its own: {rung}; {}", degraded(record)));
    }
    let (from, to) = (before.trust_target, record.trust_target);
    if from - to > 0.2 {
        let words = format!("trust was to fall from {from:.2} to {to:.2}: {}", reason(record));
        tell("trust", 1e4 + (from - to), words);
    }
    if before.predictor != record.predictor {
        tell("predictor", 6e3, format!("the predictor became {}", record.predictor));
    }
    let (now, then) = (&record.counters, &before.counters);
    for (kind, now, then, words) in [
        ("pen refused", now.pen_rejected.total(), then.pen_rejected.total(), "pen samples were refused"),
        (
            "joints refused",
            now.joint_state_rejected.total(),
            then.joint_state_rejected.total(),
            "joint states were refused",
        ),
        ("pen lost", now.pen_dropped, then.pen_dropped, "pen samples were lost before the tick"),
        ("joints lost", now.joint_state_dropped, then.joint_state_dropped, "joint states were lost"),
        ("weights refused", now.weights_refused, then.weights_refused, "sets of weights were refused"),
    ] {
        let new = now.saturating_sub(then);
        if new > 0 {
            tell(kind, 4e3 + new as f64, format!("{new} {words}"));
        }
    }
    found
}

/// What feedback alone would have made of it, where that is known.
fn ghost(record: &TickRecord) -> String {
    let known = (record.ghost_error_m >= 0.0).then_some(record.ghost_error_m * 1e3);
    known.map_or_else(String::new, |mm| format!("; feedback alone would have been {mm:.2} mm off"))
}

fn stopped(record: &TickRecord) -> String {
    let reason = FaultReason::try_from(record.fault).map_or("unknown reason", FaultReason::label);
    let detail = record.stop.to_string();
    let detail = if detail.is_empty() { detail } else { format!("; {detail}") };
    format!("it stopped: {reason}{detail}")
}

fn trust(record: &TickRecord) -> String {
    format!("trust {:.2} ({})", record.trust, reason(record))
}

fn reason(record: &TickRecord) -> &'static str {
    TrustReason::try_from(record.trust_reason).map_or("unknown reason", TrustReason::label)
}

fn degraded(record: &TickRecord) -> String {
    let labels: Vec<_> = health::labels(record.health).collect();
    if labels.is_empty() { "nothing degraded".to_owned() } else { labels.join(", ") }
}

/// The stages by cost, dearest first.
fn costs(record: &TickRecord) -> String {
    let stages = Stage::ALL.iter().filter(|stage| !matches!(stage, Stage::Step));
    let mut stages: Vec<_> = stages.map(|stage| (record.stage(*stage), stage.label())).collect();
    stages.sort_by_key(|(ns, _)| std::cmp::Reverse(*ns));
    let told = stages.iter().take(3).map(|(ns, label)| format!("{label} {:.0} µs", f64::from(*ns) * 1e-3));
    told.collect::<Vec<_>>().join(", ")
}

fn millimetres(at: &[f64; 3]) -> String {
    let [x, y, z] = at.map(|m| m * 1e3);
    format!("({x:.2}, {y:.2}, {z:.2}) mm")
}

fn age(ns: u64) -> String {
    if ns == u64::MAX { "of unknown age".to_owned() } else { format!("{:.1} ms old", ns as f64 * 1e-6) }
}

fn sentences(record: &TickRecord) -> Vec<String> {
    let mode = Mode::try_from(record.mode).map_or("unknown", Mode::label);
    let rung = Rung::try_from(record.rung).map_or("unknown", Rung::label);
    let reason = reason(record);
    let touch = if record.pen_flags & pen_flags::CONTACT != 0 { "on the paper" } else { "lifted" };
    let pen = if record.pen_sequence == 0 && record.pen_stamp_ns == 0 {
        "It has never seen a pen sample.".to_owned()
    } else {
        format!(
            "It got {} pen samples; the newest, number {}, was {}, at {}, {touch}.",
            record.pen_samples,
            record.pen_sequence,
            age(record.chain.pen_age_ns),
            millimetres(&record.pen_m),
        )
    };
    let mut told = vec![
        format!("Tick {} was {mode}.", record.tick),
        pen,
        format!("The arm's newest joint state was {}.", age(record.joint_state_age_ns)),
        format!("Trust was {:.2}, on its way to {:.2}: {reason}.", record.trust, record.trust_target),
        format!(
            "The predictor was {}, with weights {}; {}.",
            record.predictor,
            record.learner_version,
            if record.predictor_band_m < 0.0 {
                "how far off it may be is not known yet".to_owned()
            } else {
                format!("nine times of ten the pen is within {:.2} mm of it", record.predictor_band_m * 1e3)
            }
        ),
    ];
    if record.command_stamp_ns == 0 {
        told.push("No command left: the loop is not in charge of the arm.".to_owned());
    } else {
        told.push(format!(
            "The command came from: {rung}. Its reference was {}, the tool's place {}.",
            millimetres(&record.reference_m),
            millimetres(&record.tool_m),
        ));
        let limits: u32 = record.mpc_active.iter().sum();
        told.push(format!(
            "The plan took {} solver steps and ran into {limits} limits; inverse kinematics took {}.",
            record.mpc_iterations.iter().sum::<u32>(),
            record.ik_iterations,
        ));
        let guarded: Vec<_> = guard_mask::labels(record.guard_mask).collect();
        if !guarded.is_empty() {
            told.push(format!("The guard changed it: {}.", guarded.join(", ")));
        }
    }
    if record.error_m >= 0.0 {
        let (error_mm, ghost) = (record.error_m * 1e3, ghost(record));
        told.push(format!("A tenth of a second before, the tool was {error_mm:.2} mm off the pen{ghost}."));
    }
    let step_us = f64::from(record.stage(Stage::Step)) * 1e-3;
    let slack_us = record.slack_ns as f64 * 1e-3;
    let costs = costs(record);
    told.push(format!("It cost {step_us:.0} µs and left {slack_us:.0} µs to its deadline: {costs}."));
    if record.shed != 0 {
        told.push("It was told to shed the solve, for want of time.".to_owned());
    }
    if record.skipped_ticks > 0 {
        told.push(format!("{} whole periods passed before it without a tick.", record.skipped_ticks));
    }
    if record.health != 0 {
        told.push(format!("What degraded: {}.", degraded(record)));
    }
    if record.fault != 0 {
        told.push(format!("{}.", stopped(record).replacen("it stopped", "A stop is latched", 1)));
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_an_overrun_and_a_fall_of_trust_are_moments() {
        let before =
            TickRecord { tick: 7, mode: Mode::Following.into(), trust_target: 0.9, ..Default::default() };
        let record = TickRecord {
            tick: 8,
            mode: Mode::Stopped.into(),
            fault: FaultReason::DeadMan.into(),
            slack_ns: -250_000,
            health: health::OVERRUN,
            trust_target: 0.1,
            error_m: -1.0,
            ..Default::default()
        };
        let told = seen(Some(&before), &record, 1);
        let kinds: Vec<_> = told.iter().map(|(kind, ..)| *kind).collect();
        assert_eq!(kinds, ["overrun", "stop", "trust"]);
        let words: String = told.iter().map(|(_, _, words)| words.as_str()).collect();
        for part in ["250 µs late", "it stopped: dead-man", "from 0.90 to 0.10"] {
            assert!(words.contains(part), "{part} in {words}");
        }
        let quiet = TickRecord { tick: 8, error_m: -1.0, ..before };
        assert_eq!(seen(Some(&before), &quiet, 1), []);
    }

    #[test]
    fn records_that_were_never_wanted_are_not_missing_and_late_ticks_among_them_are_reported() {
        let mut before = TickRecord { tick: 8, error_m: -1.0, ..Default::default() };
        before.counters.overruns = 3;
        let next = TickRecord { tick: 12, ..before };
        assert_eq!(seen(Some(&before), &next, 4), []);
        let told = |record: &TickRecord, every| seen(Some(&before), record, every).remove(0).2;
        assert_eq!(told(&next, 1), "3 records before it are missing");
        assert_eq!(told(&TickRecord { tick: 20, ..before }, 4), "2 records before it are missing");
        let mut late = next;
        late.counters.overruns = 5;
        assert_eq!(told(&late, 4), "2 of the 3 ticks before it that have no record ended late");
        late.health = health::OVERRUN;
        assert_eq!(
            seen(Some(&before), &late, 4)[1].2,
            "1 of the 3 ticks before it that have no record ended late"
        );
    }

    #[test]
    fn of_one_kind_the_weightiest_is_kept_and_stops_all() {
        let mut found = Vec::new();
        for (tick, kind, weight) in
            [(1, "error", 1.0), (2, "error", 3.0), (3, "error", 2.0), (4, "stop", 9.0), (5, "stop", 9.0)]
        {
            keep(&mut found, Moment { tick, after_s: 0.0, what: String::new(), weight, kind });
        }
        assert_eq!(found.iter().map(|moment| moment.tick).collect::<Vec<_>>(), [2, 4, 5]);
    }
}
