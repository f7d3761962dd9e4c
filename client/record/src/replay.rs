//! Replay: the recorded inputs through the law of this program, compared with what was recorded.
//!
//! Contract: begins at the daemon's first tick or at the first state in the file, ends at the first gap and
//! says so. The same build gives the same commands bit for bit; the first difference is named with tick,
//! field and both values, and how far the joints came apart altogether.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use foretrace_config::Config;
use foretrace_control::follower::FollowerError;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, OnlineWeights};
use foretrace_control::state::{self, StateError};
use foretrace_shm::{PieceKind, Thing, TickInput, input_flags};
use foretraced::wire;
use serde::Serialize;

use crate::RecordError;
use crate::law::{Law, law, quietly};
use crate::read::{Content, Ended, RecordingEntry, RecordingReader};

/// Why a recording cannot be replayed.
#[derive(thiserror::Error)]
pub enum ReplayError {
    /// The file.
    #[error(transparent)]
    File(#[from] RecordError),
    /// No settings in it.
    #[error("the recording holds no settings: it is too short; record for a second at least")]
    NoSettings,
    /// Nothing to start from.
    #[error(
        "the recording holds neither the first tick nor a state to start from: it is too short, or the \
         daemon's solver is Clarabel, whose state cannot be written"
    )]
    NoStart,
    /// Settings of another version.
    #[error("the settings in the recording are not legal here: {0}")]
    Settings(String),
    /// The law cannot be built.
    #[error("the law of the recording cannot be built: {0}")]
    Law(#[from] FollowerError),
    /// The state of another law.
    #[error(
        "the recording is of another law: its state does not fit this version's ({0}); info, explain, export and \
         what-if read it all the same"
    )]
    State(#[from] StateError),
    /// A forged file.
    #[error("tick {tick}: field {field} of the input has no meaning here")]
    Input { tick: u64, field: &'static str },
    /// A forged file made the law panic.
    #[error("the law cannot run with what the recording holds at tick {tick}: the file is forged or damaged")]
    Forged { tick: u64 },
}

foretrace_shm::debug_as_display!(ReplayError);

/// Where a replay began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReplayStart {
    /// At the daemon's first tick.
    FirstTick,
    /// At a state in the recording.
    State,
}

/// Why a replay ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReplayEnd {
    /// All inputs were used.
    OfRecording,
    /// Ticks are missing: the next one there is `next`.
    Gap {
        /// The tick after the gap.
        next: u64,
    },
    /// Pen samples of a tick are missing.
    Incomplete,
    /// A set of weights is missing.
    NoWeights { version: u64 },
    /// A preview of another process is missing.
    NoPreview { tick: u64 },
    /// Another daemon took over.
    OtherDaemon,
    /// The file ends early or is damaged.
    Damaged { after: u64, why: String },
}

/// A difference between recording and replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    pub tick: u64,
    /// The field of `TickInput`.
    pub field: String,
    pub recorded: String,
    pub replayed: String,
}

/// Result of a replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReplayOutcome {
    pub start: ReplayStart,
    /// The first tick that was run again.
    pub first_tick: u64,
    /// Ticks that were run again.
    pub ticks: u64,
    /// Time that they cover \[s\].
    pub seconds: f64,
    pub end: ReplayEnd,
    /// Where and why the file ends early, which what is missing may come of; `None`: it is whole.
    pub damage: Option<String>,
    /// Keys of the recorded settings that are gone, each with the reason: the law of then had something that
    /// this one has not.
    pub gone: Vec<String>,
    /// The first difference, if there is any.
    pub difference: Option<Difference>,
    /// Ticks with a difference.
    pub different_ticks: u64,
    /// Largest distance of a recorded and a replayed joint \[rad\].
    pub largest_rad: f64,
    /// Build of the law of that daemon, [`foretraced::LAW_BUILD`]; `None`: the file does not tell.
    pub recorded_build: Option<String>,
    /// Whether that is the build of this program; `None`: unknown.
    pub same_build: Option<bool>,
}

/// What a replay needs before the first tick.
#[derive(Debug, Default)]
struct Beginning {
    laws: Vec<Thing>,
    settings: Vec<Thing>,
    states: Vec<Thing>,
    sets: BTreeMap<(u64, u64), Vec<u8>>,
    /// Daemon, first and last tick of inputs without a gap, in order.
    stretches: Vec<(u64, u64, u64)>,
    damage: Option<String>,
}

impl Beginning {
    fn of(path: &Path) -> Result<(Self, RecordingReader), RecordError> {
        let mut reader = RecordingReader::open(path)?;
        let mut found = Self::default();
        while let Some(entry) = reader.next_entry()? {
            let RecordingEntry::Message(message) = entry else { continue };
            match reader.content(&message)? {
                Content::Input(input) => match found.stretches.last_mut() {
                    Some((daemon, _, to))
                        if *daemon == input.daemon_id
                            && (*to == input.tick || to.checked_add(1) == Some(input.tick)) =>
                    {
                        *to = input.tick;
                    }
                    _ => found.stretches.push((input.daemon_id, input.tick, input.tick)),
                },
                Content::Thing(thing) => match thing.kind {
                    PieceKind::Settings => found.settings.push(thing),
                    PieceKind::State => found.states.push(thing),
                    PieceKind::Law => found.laws.push(thing),
                    PieceKind::Weights => {
                        found.sets.insert((thing.daemon_id, thing.number), thing.bytes);
                    }
                    // Many: they are taken as they are used.
                    PieceKind::Preview => {}
                },
                _ => {}
            }
        }
        found.damage = reader.damage();
        Ok((found, reader))
    }

    /// Build of the law of `daemon`.
    fn build(&self, daemon: u64) -> Option<String> {
        let law = self.laws.iter().find(|thing| thing.daemon_id == daemon)?;
        Some(String::from_utf8_lossy(&law.bytes).into_owned())
    }

    /// The first state from which a tick of the file can be run, or else the first one.
    fn state(&self) -> Option<&Thing> {
        let runs = |state: &&Thing| {
            state.number.checked_add(1).is_some_and(|next| {
                let has = |(daemon, from, to): &(u64, u64, u64)| {
                    *daemon == state.daemon_id && (*from..=*to).contains(&next)
                };
                self.stretches.iter().any(has)
            })
        };
        let sound = |state: &&Thing| state.number < u64::MAX;
        self.states.iter().find(runs).or_else(|| self.states.iter().find(sound))
    }
}

/// Replays `path`.
///
/// # Errors
///
/// See [`ReplayError`].
pub fn replay(path: &Path) -> Result<ReplayOutcome, ReplayError> {
    let (beginning, reader) = Beginning::of(path)?;
    let without = |what: &str, otherwise| reader.lack(what).map_or(otherwise, ReplayError::File);
    let no_start =
        || without("it holds neither the first tick nor a state to start from", ReplayError::NoStart);
    let (first_daemon, first_tick, _) = *beginning.stretches.first().ok_or_else(no_start)?;
    let from_first = first_tick == 1;
    let state = beginning.state().filter(|_| !from_first);
    if !from_first && state.is_none() {
        return Err(no_start());
    }
    let daemon = state.map_or(first_daemon, |state| state.daemon_id);
    let settings = beginning.settings.iter().find(|thing| thing.daemon_id == daemon);
    let toml = settings.ok_or_else(|| without("it holds no settings", ReplayError::NoSettings))?;
    let toml = std::str::from_utf8(&toml.bytes).map_err(|error| ReplayError::Settings(error.to_string()))?;
    let config = Config::recorded(toml).map_err(|error| ReplayError::Settings(error.to_string()))?;
    let mut law = law(config.follower_settings(), config.settings().mpc.horizon)?;
    if let Some(state) = state {
        law.restore(&state.bytes)?;
    }
    let after = state.map_or(0, |state| state.number);
    let recorded_build = beginning.build(daemon);
    let mut run = ReplayRun {
        law,
        daemon,
        blank: config.follower_settings().weights,
        sets: &beginning.sets,
        previews: BTreeMap::new(),
        next: after + 1,
        pen: Vec::new(),
        times: None,
        outcome: ReplayOutcome {
            start: if state.is_some() { ReplayStart::State } else { ReplayStart::FirstTick },
            first_tick: after + 1,
            ticks: 0,
            seconds: 0.0,
            end: ReplayEnd::OfRecording,
            damage: beginning.damage.clone(),
            gone: config.gone(),
            difference: None,
            different_ticks: 0,
            largest_rad: 0.0,
            same_build: recorded_build.as_ref().map(|build| build == foretraced::LAW_BUILD),
            recorded_build,
        },
    };
    let mut reader = RecordingReader::open(path)?;
    let mut ended = false;
    // Inputs whose preview comes behind them.
    let mut waiting: VecDeque<Box<TickInput>> = VecDeque::new();
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        match reader.content(&message)? {
            Content::Thing(thing) if thing.kind == PieceKind::Preview && thing.daemon_id == daemon => {
                if thing.number > after && run.previews.len() < UNUSED {
                    run.previews.insert(thing.number, thing.bytes);
                }
            }
            // Inputs of before the state may come after it in the file, and the other way round.
            Content::Input(input) if input.daemon_id == daemon && input.tick <= after => {}
            Content::Input(input) => waiting.push_back(input),
            _ => continue,
        }
        ended = run.take_waiting(&mut waiting, after, false)?;
        if ended {
            break;
        }
    }
    if !ended {
        ended = run.take_waiting(&mut waiting, after, true)?;
    }
    if let (false, Some(Ended::Cut { after, why, .. })) = (ended, reader.ended()) {
        run.outcome.end = ReplayEnd::Damaged { after: *after, why: why.clone() };
    }
    if let Some((from, to)) = run.times {
        run.outcome.seconds = to.saturating_sub(from) as f64 * 1e-9;
    }
    Ok(run.outcome)
}

/// A replay under way.
struct ReplayRun<'a> {
    law: Box<dyn Law>,
    daemon: u64,
    blank: OnlineWeights,
    sets: &'a BTreeMap<(u64, u64), Vec<u8>>,
    /// Previews of another process that no tick has used yet, by tick.
    previews: BTreeMap<u64, Vec<u8>>,
    next: u64,
    pen: Vec<PenReading>,
    times: Option<(u64, u64)>,
    outcome: ReplayOutcome,
}

/// Ticks that wait for a preview at most: it follows its tick within a fifth of a second.
const WAITING: usize = 4096;
/// Previews kept that no tick has used: those of a quarter of an hour, which a flight recorder writes first.
const UNUSED: usize = 100_000;

impl ReplayRun<'_> {
    /// Runs the ticks that wait, up to the first whose preview has not come; `all`: nothing comes any more.
    /// Whether the replay is over.
    fn take_waiting(
        &mut self,
        waiting: &mut VecDeque<Box<TickInput>>,
        after: u64,
        all: bool,
    ) -> Result<bool, ReplayError> {
        while let Some(input) = waiting.front() {
            let lacks = input.flags & input_flags::PREVIEW != 0
                && input.daemon_id == self.daemon
                && !self.previews.contains_key(&input.tick);
            if lacks && !all && waiting.len() < WAITING {
                return Ok(false);
            }
            let Some(input) = waiting.pop_front() else { break };
            // Of a daemon before that of the start.
            if input.daemon_id != self.daemon && self.next == after + 1 && self.pen.is_empty() {
                continue;
            }
            if let Some(end) = self.take(&input)? {
                self.outcome.end = end;
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Runs the tick that `input` completes; returns why there is no next one.
    fn take(&mut self, input: &TickInput) -> Result<Option<ReplayEnd>, ReplayError> {
        if input.daemon_id != self.daemon {
            return Ok(Some(ReplayEnd::OtherDaemon));
        }
        if input.tick != self.next {
            return Ok(Some(ReplayEnd::Gap { next: input.tick }));
        }
        self.pen.extend(input.pen().iter().map(wire::pen_of));
        if input.part.saturating_add(1) < input.parts {
            return Ok(None);
        }
        let tick = input.tick;
        let given = wire::given(input).map_err(|field| ReplayError::Input { tick, field })?;
        if !given.complete || self.pen.len() != given.pen_samples as usize {
            return Ok(Some(ReplayEnd::Incomplete));
        }
        let mut set = None;
        if let Some(version) = given.weights {
            let Some(bytes) = self.sets.get(&(self.daemon, version)) else {
                return Ok(Some(ReplayEnd::NoWeights { version }));
            };
            let mut weights = self.blank;
            state::read(&mut weights, bytes)?;
            set = Some(weights);
        }
        let mut preview = None;
        if given.preview {
            let Some(bytes) = self.previews.remove(&tick) else {
                return Ok(Some(ReplayEnd::NoPreview { tick }));
            };
            state::read(preview.insert(ExternalPreview::EMPTY), &bytes)?;
        }
        let (law, pen) = (&mut self.law, &self.pen);
        let input_of = given.step_input(pen, set.as_ref(), preview.as_ref());
        let output = quietly(|| law.tick(&input_of, given.budget)).ok_or(ReplayError::Forged { tick })?;
        self.pen.clear();
        self.next = self.next.saturating_add(1);
        self.compare(input, &wire::tick_input(tick, input.daemon_id, &given, &output));
        let (from, _) = self.times.unwrap_or((input.now_ns, 0));
        self.times = Some((from, input.now_ns));
        Ok(None)
    }

    fn compare(&mut self, recorded: &TickInput, replayed: &TickInput) {
        let outcome = &mut self.outcome;
        outcome.ticks += 1;
        for (a, b) in recorded.q.iter().zip(&replayed.q) {
            outcome.largest_rad = outcome.largest_rad.max((a - b).abs());
        }
        let difference = first_difference(recorded, replayed);
        outcome.different_ticks += u64::from(difference.is_some());
        outcome.difference = outcome.difference.take().or(difference);
    }
}

/// The first field of the tick's results that differs in any bit.
fn first_difference(recorded: &TickInput, replayed: &TickInput) -> Option<Difference> {
    let both = [recorded, replayed];
    let mut rows: Vec<(String, [u64; 2], [String; 2])> = Vec::new();
    let mut whole = |name: &str, of: fn(&TickInput) -> u64| {
        let values = both.map(of);
        rows.push((name.to_owned(), values, values.map(|value| value.to_string())));
    };
    whole("mode", |tick| tick.mode.into());
    whole("fault", |tick| tick.fault.into());
    whole("rung", |tick| tick.rung.into());
    whole("health", |tick| tick.health.into());
    whole("flags", |tick| tick.flags.into());
    whole("weights_used", |tick| tick.weights_used);
    whole("command_ns", |tick| tick.command_ns);
    whole("valid_until_ns", |tick| tick.valid_until_ns);
    let mut number = |name: String, values: [f64; 2]| {
        rows.push((name, values.map(f64::to_bits), values.map(|value| format!("{value:?}"))));
    };
    number("trust".to_owned(), both.map(|tick| tick.trust));
    for (joint, (a, b)) in recorded.q.iter().zip(&replayed.q).enumerate() {
        number(format!("q[{joint}]"), [*a, *b]);
    }
    for (joint, (a, b)) in recorded.qd.iter().zip(&replayed.qd).enumerate() {
        number(format!("qd[{joint}]"), [*a, *b]);
    }
    let (field, _, [recorded_text, replayed_text]) = rows.into_iter().find(|(_, [a, b], _)| a != b)?;
    Some(Difference { tick: recorded.tick, field, recorded: recorded_text, replayed: replayed_text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_named_with_tick_field_and_both_values() {
        let recorded = TickInput { tick: 7, q: [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], ..Default::default() };
        assert_eq!(first_difference(&recorded, &recorded), None);
        let mut replayed = recorded;
        replayed.q[3] = f64::from_bits(0.3_f64.to_bits() + 1);
        let found = first_difference(&recorded, &replayed).unwrap();
        assert_eq!((found.tick, found.field.as_str()), (7, "q[3]"));
        assert_eq!((found.recorded.as_str(), found.replayed.as_str()), ("0.3", "0.30000000000000004"));
        // Zero and minus zero are different bits.
        replayed = recorded;
        replayed.q[0] = -0.0;
        assert_eq!(first_difference(&recorded, &replayed).unwrap().field, "q[0]");
    }
}
