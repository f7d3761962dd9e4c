//! Recordings as files: written, replayed, damaged in every way, mended.

mod what_if;

use std::path::{Path, PathBuf};

use foretrace_config::Config;
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, StepInput};
use foretrace_control::pen::PenReading;
use foretrace_control::state;
use foretrace_control::units::Stamp;
use foretrace_record::RecordError;
use foretrace_record::info::info;
use foretrace_record::read::{Ended, RecordingReader};
use foretrace_record::repair::{mend_leftovers, repair};
use foretrace_record::replay::{ReplayEnd, ReplayError, ReplayOutcome, ReplayStart, replay};
use foretrace_record::table;
use foretrace_record::topics::{RecordingTopic, thing_bytes};
use foretrace_record::write::{FileFacts, Output, part_of};
use foretrace_shm::{PieceKind, Thing, TickInput, Wire};
use foretraced::wire::{self, Given};
use tempfile::TempDir;

const DAEMON: u64 = 5;
const TICKS: u64 = 400;
/// The tick after which the state in the recording was taken.
const CUT: u64 = 150;

/// A run of the law with an arm that obeys, as inputs; the state after [`CUT`], and the settings.
struct Lived {
    inputs: Vec<TickInput>,
    state: Thing,
    settings: Thing,
    law: Thing,
}

fn lived() -> Lived {
    let config = Config::preset("ur5").unwrap();
    let settings = config.follower_settings();
    let (period, home) = (settings.period_ns, settings.ik.home);
    let weights = settings.weights;
    let mut follower = Follower::<20, 6>::new(settings).unwrap();
    let thing = |kind, number, bytes| Thing { kind, number, daemon_id: DAEMON, bytes };
    let mut joints = JointReading { stamp: Stamp(0), q: home, qd: [0.0; 6], motion_allowed: true };
    let mut lived = Lived {
        inputs: Vec::new(),
        state: thing(PieceKind::State, CUT, Vec::new()),
        settings: thing(PieceKind::Settings, 0, config.render().into_bytes()),
        law: thing(PieceKind::Law, 0, foretraced::LAW_BUILD.as_bytes().to_vec()),
    };
    for tick in 1..=TICKS {
        let now = Stamp(10_000_000_000 + tick * period);
        joints.stamp = now;
        let t = tick as f64 * period as f64 * 1e-9;
        let mut pen = Vec::new();
        if tick.is_multiple_of(3) && tick > 20 {
            // A burst of more than one part fits now and then.
            for copy in 0..(if tick.is_multiple_of(60) { 11 } else { 1 }) {
                let position = [0.02 * (3.0 * t).sin(), 0.015 * (5.0 * t).sin()];
                pen.push(PenReading::new(Stamp(now.0 - 20_000 + copy * 1000), position, true));
            }
        }
        let request = (tick == 10).then_some(Request::Arm);
        let effort = EffortReading {
            stamp: joints.stamp,
            effort: joints.q.map(|q| 20.0 * q.sin()),
            unit: EffortUnit::NewtonMetres,
        };
        let given = Given {
            now,
            budget: Budget { shed: tick.is_multiple_of(50), ..Budget::default() },
            joints: Some(joints),
            effort: Some(effort),
            enable: None,
            request,
            halt: None,
            weights: (tick == 200).then_some(weights.version),
            preview: false,
            unsent: tick % 70 == 1,
            pen_samples: pen.len() as u32,
            complete: true,
        };
        let input = StepInput {
            pen: &pen,
            joints: given.joints.as_ref(),
            effort: given.effort.as_ref(),
            request,
            weights: given.weights.map(|_| &weights),
            unsent: given.unsent,
            ..StepInput::nothing(now)
        };
        let output = follower.step(&input, given.budget, &mut NoClock);
        if let Some(command) = output.command {
            (joints.q, joints.qd) = (command.q, command.qd);
        }
        let mut sent = wire::tick_input(tick, DAEMON, &given, &output);
        for part in 0..sent.parts as usize {
            wire::pen_part(&mut sent, part, pen.chunks(foretrace_shm::PEN_PER_PART).nth(part).unwrap_or(&[]));
            sent.header.stamp_ns = now.0;
            lived.inputs.push(sent);
        }
        if tick == CUT {
            lived.state.bytes = state::bytes_of(&follower).unwrap();
        }
    }
    lived
}

/// Sets of weights that ticks are offered.
fn offered() -> Thing {
    let weights = Config::preset("ur5").unwrap().follower_settings().weights;
    let bytes = state::bytes_of(&weights).unwrap();
    Thing { kind: PieceKind::Weights, number: weights.version, daemon_id: DAEMON, bytes }
}

/// Writes things and inputs; returns the file.
fn written<'a>(
    place: &TempDir,
    name: &str,
    things: &[&Thing],
    inputs: impl IntoIterator<Item = &'a TickInput>,
) -> PathBuf {
    let target = place.path().join(name);
    let facts = FileFacts::from([("version".to_owned(), "0.0.1".to_owned())]);
    let mut output = Output::create(&target, &facts).unwrap();
    for thing in things {
        output.put(RecordingTopic::Thing, 1, &thing_bytes(thing)).unwrap();
    }
    for (index, input) in inputs.into_iter().enumerate() {
        let mut bytes = Vec::new();
        input.put(&mut bytes);
        output.put(RecordingTopic::Input, input.now_ns, &bytes).unwrap();
        if index % 100 == 99 {
            output.flush().unwrap();
        }
    }
    output.finish(&FileFacts::new()).unwrap()
}

fn replayed(file: &Path) -> ReplayOutcome {
    replay(file).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_recording_replays_bit_for_bit_from_the_first_tick_and_from_a_state() {
    let (place, lived, set) = (TempDir::new().unwrap(), lived(), offered());
    let whole = written(&place, "whole.mcap", &[&lived.settings, &set], &lived.inputs);
    let outcome = replayed(&whole);
    assert_eq!(
        (outcome.start, outcome.ticks, &outcome.end),
        (ReplayStart::FirstTick, TICKS, &ReplayEnd::OfRecording)
    );
    assert_eq!((outcome.difference, outcome.largest_rad), (None, 0.0));
    assert_eq!((outcome.recorded_build, outcome.same_build), (None, None));

    let late = lived.inputs.iter().filter(|input| input.tick > CUT - 20);
    let late = written(&place, "late.mcap", &[&lived.settings, &lived.state, &set], late);
    let outcome = replayed(&late);
    assert_eq!((outcome.start, outcome.ticks, outcome.difference), (ReplayStart::State, TICKS - CUT, None));
    assert!(lived.inputs.iter().any(|input| input.parts > 1), "no burst");
    // Whose law it was is known for each daemon.
    let other = Thing { daemon_id: 6, bytes: b"abc".to_vec(), ..lived.law.clone() };
    let things = [&other, &lived.law, &lived.settings, &set];
    let own = written(&place, "own.mcap", &things, &lived.inputs);
    assert_eq!(replayed(&own).same_build, Some(true));
    assert_eq!(info(&own).unwrap().laws, [(5, foretraced::LAW_BUILD.to_owned()), (6, "abc".into())].into());
    let inputs: Vec<_> = lived.inputs.iter().map(|input| TickInput { daemon_id: 6, ..*input }).collect();
    let [settings, set] = [&lived.settings, &set].map(|thing| Thing { daemon_id: 6, ..thing.clone() });
    let foreign = replayed(&written(&place, "foreign", &[&lived.law, &other, &settings, &set], &inputs));
    assert_eq!((foreign.recorded_build.as_deref(), foreign.same_build), (Some("abc"), Some(false)));
    assert_eq!((foreign.ticks, foreign.difference), (TICKS, None));
    assert!(lived.inputs.last().unwrap().q != lived.inputs.first().unwrap().q, "it did not move");
}

#[test]
fn the_first_difference_is_named_and_measured() {
    let (place, mut lived, set) = (TempDir::new().unwrap(), lived(), offered());
    let at = lived.inputs.iter().position(|input| input.tick == 301).unwrap();
    let q = &mut lived.inputs[at].q[2];
    *q = f64::from_bits(q.to_bits() ^ 1);
    lived.inputs[at + 3].q[0] += 1e-3;
    let file = written(&place, "run.mcap", &[&lived.settings, &set], &lived.inputs);
    let outcome = replayed(&file);
    let difference = outcome.difference.unwrap();
    assert_eq!((difference.tick, difference.field.as_str()), (301, "q[2]"));
    assert_ne!(difference.recorded, difference.replayed);
    assert_eq!((outcome.ticks, outcome.different_ticks), (TICKS, 2));
    let bytes = std::fs::read(&file).unwrap();
    let cut = place.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let early = replayed(&cut);
    assert!(early.difference.is_none() && matches!(early.end, ReplayEnd::Damaged { .. }), "{early:?}");
    assert!((outcome.largest_rad - 1e-3).abs() < 1e-9, "{}", outcome.largest_rad);
}

#[test]
fn what_is_missing_ends_a_replay_and_is_said() {
    let (place, lived, set) = (TempDir::new().unwrap(), lived(), offered());
    let end = |name: &str, things: &[&Thing], inputs: Vec<TickInput>| {
        let outcome = replayed(&written(&place, name, things, &inputs));
        assert_eq!(outcome.difference, None);
        (outcome.ticks, outcome.end)
    };
    let all = || lived.inputs.clone();
    let gap = all().into_iter().filter(|input| input.tick != 222).collect();
    assert_eq!(end("gap", &[&lived.settings, &set], gap), (221, ReplayEnd::Gap { next: 223 }));
    let no_set = end("set", &[&lived.settings], all());
    assert_eq!(no_set, (199, ReplayEnd::NoWeights { version: set.number }));
    // What is missing in a damaged file may have been lost with its end.
    let file = written(&place, "ends", &[&lived.settings], &all());
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() * 3 / 4]).unwrap();
    let early = replayed(&file);
    assert!(matches!(early.end, ReplayEnd::NoWeights { .. }) && early.damage.is_some(), "{early:?}");
    let lost_part = all().into_iter().filter(|input| !(input.tick == 120 && input.part == 0)).collect();
    assert_eq!(end("part", &[&lived.settings, &set], lost_part), (119, ReplayEnd::Incomplete));
    let mut other = all();
    other.iter_mut().filter(|input| input.tick > 250).for_each(|input| input.daemon_id = 6);
    assert_eq!(end("other", &[&lived.settings, &set], other), (250, ReplayEnd::OtherDaemon));

    let late: Vec<_> = all().into_iter().filter(|input| input.tick > 30).collect();
    let file = written(&place, "start", &[&lived.settings, &set], &late);
    assert!(matches!(replay(&file), Err(ReplayError::NoStart)));
    let file = written(&place, "settings", &[&set], &all());
    assert!(matches!(replay(&file), Err(ReplayError::NoSettings)));
    let reported = info(&written(&place, "told", &[&lived.settings, &lived.state], &late)).unwrap();
    assert_eq!((reported.ticks, reported.missing_ticks, reported.states), (Some((31, TICKS)), 0, vec![CUT]));
    assert_eq!((reported.damage, reported.begin["version"].as_str()), (None, "0.0.1"));
}

#[test]
fn a_killed_recording_keeps_all_but_its_last_chunk_and_can_be_mended() {
    let (place, lived, set) = (TempDir::new().unwrap(), lived(), offered());
    let whole = written(&place, "whole.mcap", &[&lived.settings, &set], &lived.inputs);
    let bytes = std::fs::read(&whole).unwrap();
    let mut most = 0;
    // The last tenth is index and end.
    for (number, cut) in (bytes.len() / 2..bytes.len()).step_by(bytes.len() / 40).enumerate() {
        let killed = place.path().join(format!("{number}.mcap.part"));
        std::fs::write(&killed, &bytes[..cut]).unwrap();
        let mended = place.path().join(format!("{number}.mended.mcap"));
        let result = repair(&killed, &mended).unwrap();
        assert!(result.damage.is_some(), "cut at {cut}");
        let outcome = replayed(&mended);
        assert_eq!(outcome.difference, None);
        // Chunks of a hundred inputs, and what can be read of an open one.
        let complete = cut as f64 / bytes.len() as f64 * TICKS as f64;
        assert!(outcome.ticks as f64 > complete - 140.0, "{} ticks of {complete}", outcome.ticks);
        most = most.max(outcome.ticks);
        assert_eq!(info(&mended).unwrap().damage, None, "the mended one is whole");
    }
    assert!(most > TICKS - 40, "{most} ticks at most");
    assert!(matches!(repair(&whole, &whole), Err(RecordError::Exists { .. })));
    let again = place.path().join("again.mcap");
    assert_eq!(repair(&whole, &again).unwrap().damage, None);
    assert_eq!(replayed(&again).ticks, TICKS);
}

#[test]
fn nothing_is_overwritten_and_two_recorders_do_not_share_a_file() {
    let place = TempDir::new().unwrap();
    let target = place.path().join("a.mcap");
    let first = Output::create(&target, &FileFacts::new()).unwrap();
    let second = Output::create(&target, &FileFacts::new());
    assert!(matches!(second, Err(RecordError::Busy { .. })), "{second:?}");
    let busy = mend_leftovers(&target);
    assert!(matches!(busy, Err(RecordError::Busy { .. })), "{busy:?}");
    std::fs::write(&target, "mine").unwrap();
    assert!(matches!(first.finish(&FileFacts::new()), Err(RecordError::Exists { .. })));
    assert_eq!(std::fs::read(&target).unwrap(), b"mine");
    assert!(part_of(&target).exists(), "what was recorded is still there");
    std::fs::remove_file(&target).unwrap();
    let third = Output::create(&target, &FileFacts::new());
    assert!(matches!(third, Err(RecordError::Exists { .. })), "nobody is at it, and it is kept: {third:?}");

    let other = place.path().join("b.mcap");
    // A killed recorder had begun further files of the same recording; others are not of it.
    for left in ["b.mcap", "b.12.mcap", "b.3.mcap", "b.x.mcap", "b.3.4.mcap", "c.3.mcap"] {
        drop(Output::create(&place.path().join(left), &FileFacts::new()).unwrap());
    }
    let mend = || mend_leftovers(&other).unwrap();
    let mended: Vec<_> = mend().into_iter().map(|(mended, _)| mended).collect();
    let wanted = ["b.interrupted-1.mcap", "b.3.interrupted-1.mcap", "b.12.interrupted-1.mcap"];
    assert_eq!(mended, wanted.map(|name| place.path().join(name)));
    assert!(!part_of(&other).exists() && mended.iter().all(|file| info(file).is_ok()));
    for left in ["b.x.mcap.part", "b.3.4.mcap.part", "c.3.mcap.part"] {
        assert!(place.path().join(left).exists(), "{left}");
    }
    assert_eq!(mend(), []);
}

#[test]
fn another_layout_is_refused_by_name_and_still_listed_and_tabled() {
    let (place, path) = (TempDir::new().unwrap(), "old.mcap");
    let path = place.path().join(path);
    // What an older version may have written: fewer fields, and one of another name.
    let table = b"layout 0123456789abcdef size 24\ntick 0 8 u64\njoints_us 8 8 u64\nq 16 8 f32*2\n";
    let mut writer = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let schema = writer.add_schema("TickInput", "foretrace.wire", table).unwrap();
    let channel = writer.add_channel(schema, "/raw/input", "foretrace.wire", &FileFacts::new()).unwrap();
    for tick in 1..=4_u64 {
        let mut data = tick.to_le_bytes().to_vec();
        data.extend((tick * 1000).to_le_bytes());
        data.extend(0.5_f32.to_le_bytes());
        data.extend((-1.5_f32).to_le_bytes());
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: 0,
            log_time: tick,
            publish_time: tick,
        };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    let reported = info(&path).unwrap();
    assert_eq!((reported.foreign, reported.topics["/raw/input"]), (vec!["/raw/input".to_owned()], 4));
    let refused = replay(&path).unwrap_err().to_string();
    assert!(refused.contains("/raw/input have another layout"), "{refused}");
    let mut out = Vec::new();
    let mut reader = RecordingReader::open(&path).unwrap();
    assert_eq!(table::csv(&mut reader, "/raw/input", 2, &[], &mut out).unwrap(), 2);
    let text = String::from_utf8(out).unwrap();
    assert_eq!(
        text,
        "time [ns since 1970],tick [1],joints_us [1],q[0] [rad],q[1] [rad]\n1,1,1000,0.5,-1.5\n3,3,3000,0.5,-1.5\n"
    );
    let mut reader = RecordingReader::open(&path).unwrap();
    let unknown = table::csv(&mut reader, "/raw/input", 1, &["qd".to_owned()], &mut Vec::new());
    assert!(unknown.unwrap_err().to_string().contains("there are: tick, joints_us, q"));
}

#[test]
fn damaged_bytes_never_panic_and_reading_them_ends() {
    let (place, lived, set) = (TempDir::new().unwrap(), lived(), offered());
    let few = &lived.inputs[..60];
    let whole = written(&place, "whole.mcap", &[&lived.settings, &set], few);
    let bytes = std::fs::read(&whole).unwrap();
    let cases = std::env::var("FORETRACE_FUZZ_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(300_u64);
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed
    };
    let mut cut = 0;
    for case in 0..cases {
        let mut bad = bytes.clone();
        for _ in 0..1 + case % 4 {
            let at = next() as usize % bad.len();
            // Lengths and operation codes stand at the beginning: be there more often.
            let at = if case.is_multiple_of(2) { at % 4096 } else { at };
            bad[at] = next() as u8;
        }
        if case.is_multiple_of(7) {
            bad.truncate(next() as usize % bytes.len());
        }
        let path = place.path().join("bad.mcap");
        std::fs::write(&path, &bad).unwrap();
        if let Ok(mut reader) = RecordingReader::open(&path) {
            while let Ok(Some(_)) = reader.next_entry() {}
            cut += u64::from(matches!(reader.ended(), Some(Ended::Cut { .. })));
        }
        let _ = info(&path);
        if case.is_multiple_of(10) {
            let _ = replay(&path);
            let mended = place.path().join("mended.mcap");
            let _ = std::fs::remove_file(&mended);
            if repair(&path, &mended).is_ok() {
                assert_eq!(info(&mended).unwrap().damage, None);
            }
        }
    }
    assert!(cut > cases / 10, "only {cut} of {cases} were seen to be damaged");
}
