//! Keeps a few ticks of a recording, so that later versions can be tested to read the layouts of this one:
//! `cargo run -p foretrace-record --example keep -- RUN.mcap client/record/tests/kept`.
//!
//! Keeps the build of the law, settings, a status, and the first ticks after a state in which the pen
//! writes, as their messages are. The file is named after the layouts. Source of the recording:
//! `tests/record/keep.sh`.

use std::error::Error;
use std::path::Path;

use foretrace_record::read::{Content, RecordingEntry, RecordingReader};
use foretrace_record::topics::{RecordingTopic, layouts};
use foretrace_record::write::{FileFacts, Output};
use foretrace_shm::PieceKind;

/// Ticks that are kept.
const TICKS: u64 = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(from), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("give a recording and a folder".into());
    };
    let from = Path::new(&from);
    let (first, facts) = first_tick(from)?;
    let target = Path::new(&folder).join(format!("{:016x}.mcap", layouts()));
    let mut output = Output::create(&target, &facts)?;
    let ticks = first..first + TICKS;
    let (mut reader, mut status, mut times) = (RecordingReader::open(from)?, false, None);
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        let topic = reader
            .channels()
            .get(&message.channel)
            .and_then(|channel| RecordingTopic::from_name(&channel.name));
        let Some(topic) = topic else { continue };
        let wanted = match reader.content(&message)? {
            Content::Input(input) => ticks.contains(&input.tick),
            Content::Tick(tick) => {
                let wanted = ticks.contains(&tick.tick);
                if wanted {
                    let (from, _) = times.unwrap_or((message.time_ns, 0));
                    times = Some((from, message.time_ns));
                }
                wanted
            }
            Content::Thing(thing) => match thing.kind {
                PieceKind::Law | PieceKind::Settings => thing.number == 0,
                // Bytes of one build only, and many.
                PieceKind::State | PieceKind::Weights | PieceKind::Preview => false,
            },
            Content::Status(_) => !std::mem::replace(&mut status, true),
            // Follows the raw record of its tick.
            Content::Other => times.is_some_and(|(from, to)| (from..=to).contains(&message.time_ns)),
        };
        if wanted {
            output.put(topic, message.time_ns, &message.data)?;
        }
    }
    println!("{}", output.finish(&FileFacts::new())?.display());
    Ok(())
}

/// The first tick after a state in whose neighbourhood the pen writes, and what the file says about itself.
fn first_tick(path: &Path) -> Result<(u64, FileFacts), Box<dyn Error>> {
    let (mut reader, mut states, mut pen, mut about) =
        (RecordingReader::open(path)?, Vec::new(), Vec::new(), None);
    while let Some(entry) = reader.next_entry()? {
        match entry {
            RecordingEntry::Facts(name, facts) if name == "foretrace" => about = Some(facts),
            RecordingEntry::Facts(..) => {}
            RecordingEntry::Message(message) => match reader.content(&message)? {
                Content::Thing(thing) if thing.kind == PieceKind::State => states.push(thing.number + 1),
                Content::Input(input) if input.pen_samples > 0 => pen.push(input.tick),
                _ => {}
            },
        }
    }
    let writes = |first: &u64| pen.iter().filter(|tick| (*first..first + TICKS).contains(tick)).count() > 1;
    let first = states.into_iter().find(writes).ok_or("no state while the pen writes: record again")?;
    Ok((first, about.ok_or("the recording says nothing about itself")?))
}
