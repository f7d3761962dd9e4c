//! The longest stretch of a recording in which one loop was in charge of the arm, without a gap.
//!
//! Contract: ticks follow each other by number and by time; stamps that leap, which only a forged file holds,
//! end a stretch or are left out, so that nothing that is sized by time grows beyond the file.

use std::collections::BTreeMap;
use std::path::Path;

use foretrace_control::pen::PenReading;
use foretrace_control::predict::ExternalPreview;
use foretrace_control::state;
use foretrace_control::units::Stamp;
use foretrace_shm::{FaultReason, JOINTS, PieceKind, TickInput, input_flags};
use foretraced::wire;

use crate::RecordError;
use crate::modelled::RecordedCommand;
use crate::read::{Content, RecordingEntry, RecordingReader};

/// Between two ticks of one stretch, and from a tick to the stamps of its command and joints \[ns\].
const MAX_STEP_NS: u64 = 1_000_000_000;

/// A tick of the recorded life.
#[derive(Debug, Clone)]
pub(crate) struct RecordedTick {
    number: u64,
    /// It was given a preview of another process.
    given_preview: bool,
    pub now: Stamp,
    pub pen: Vec<PenReading>,
    /// The preview of another process that it was given.
    pub preview: Option<ExternalPreview>,
    pub measured: Option<(Stamp, [f64; JOINTS])>,
    pub command: Option<RecordedCommand>,
}

impl RecordedTick {
    fn of(input: &TickInput, pen: Vec<PenReading>) -> Self {
        let near = |stamp_ns: u64| stamp_ns.abs_diff(input.now_ns) <= MAX_STEP_NS;
        let measured = (input.flags & input_flags::JOINTS != 0 && near(input.joints_ns))
            .then_some((Stamp(input.joints_ns), input.joints_q));
        let command = (input.command_ns != 0).then_some(RecordedCommand {
            stamp: Stamp(input.command_ns),
            valid_until: Stamp(input.valid_until_ns),
            q: input.q,
            qd: input.qd,
            enabled: input.flags & input_flags::ENABLED != 0,
        });
        Self {
            number: input.tick,
            given_preview: input.flags & input_flags::PREVIEW != 0,
            now: Stamp(input.now_ns),
            pen,
            preview: None,
            measured,
            command,
        }
    }
}

#[derive(Debug, Default)]
pub(crate) struct Stretch {
    /// Settings in force at its daemon's start; `None`: the file has none.
    pub settings: Option<String>,
    /// Empty: the loop was never in charge.
    pub ticks: Vec<RecordedTick>,
    /// Previews of another process that its ticks were given and the file does not hold.
    pub previews_missing: usize,
    /// Where and why the file ends early.
    pub damage: Option<String>,
}

/// The longest one of `path`.
///
/// # Errors
///
/// The file is not a recording, or of another layout.
pub(crate) fn longest(path: &Path) -> Result<Stretch, RecordError> {
    let mut reader = RecordingReader::open(path)?;
    let mut settings: BTreeMap<u64, String> = BTreeMap::new();
    let mut previews: BTreeMap<(u64, u64), Vec<u8>> = BTreeMap::new();
    // Each with its daemon.
    let (mut best, mut life) = ((0, Vec::new()), (0, Vec::new()));
    let (mut last, mut pen): (Option<(u64, u64, u64)>, _) = (None, Vec::new());
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        match reader.content(&message)? {
            Content::Thing(thing) if thing.kind == PieceKind::Settings => {
                if let Ok(text) = String::from_utf8(thing.bytes) {
                    settings.entry(thing.daemon_id).or_insert(text);
                }
            }
            Content::Thing(thing) if thing.kind == PieceKind::Preview => {
                previews.insert((thing.daemon_id, thing.number), thing.bytes);
            }
            Content::Input(input) => {
                if input.part == 0 {
                    pen.clear();
                }
                pen.extend(input.pen().iter().map(wire::pen_of));
                if input.part.saturating_add(1) < input.parts {
                    continue;
                }
                let follows = input.command_ns != 0
                    && input.fault == u32::from(FaultReason::None)
                    && input.command_ns.abs_diff(input.now_ns) <= MAX_STEP_NS;
                if !follows || !last.is_some_and(|last| goes_on(last, &input)) {
                    longer(&mut best, &mut life);
                }
                last = Some((input.daemon_id, input.tick, input.now_ns));
                if follows {
                    life.0 = input.daemon_id;
                    life.1.push(RecordedTick::of(&input, std::mem::take(&mut pen)));
                }
            }
            _ => {}
        }
    }
    longer(&mut best, &mut life);
    if best.1.is_empty()
        && let Some(lack) = reader.lack("it holds no armed loop")
    {
        return Err(lack);
    }
    let (daemon, mut ticks) = best;
    // They come behind the ticks that they belong to.
    let mut previews_missing = 0;
    for tick in ticks.iter_mut().filter(|tick| tick.given_preview) {
        let mut preview = ExternalPreview::EMPTY;
        let read = previews.get(&(daemon, tick.number)).map(|bytes| state::read(&mut preview, bytes));
        tick.preview = matches!(read, Some(Ok(()))).then_some(preview);
        previews_missing += usize::from(tick.preview.is_none());
    }
    Ok(Stretch { settings: settings.remove(&daemon), ticks, previews_missing, damage: reader.damage() })
}

/// Whether `input` is the tick after the last one, given by daemon, number and time, without a leap.
fn goes_on((daemon, tick, now_ns): (u64, u64, u64), input: &TickInput) -> bool {
    let step_ns = input.now_ns.checked_sub(now_ns);
    daemon == input.daemon_id
        && tick.checked_add(1) == Some(input.tick)
        && step_ns.is_some_and(|step_ns| (1..=MAX_STEP_NS).contains(&step_ns))
}

/// Keeps the longer one, and begins again.
fn longer(best: &mut (u64, Vec<RecordedTick>), life: &mut (u64, Vec<RecordedTick>)) {
    // It begins where the arm is known.
    let known = life.1.iter().position(|tick| tick.measured.is_some()).unwrap_or(life.1.len());
    life.1.drain(..known);
    if life.1.len() > best.1.len() {
        std::mem::swap(best, life);
    }
    life.1.clear();
}
