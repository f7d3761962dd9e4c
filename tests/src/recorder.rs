//! A process that reads and judges every joint command of an instance, whatever other processes die.
//!
//! Contract: `recorder UNTIL --instance=N --root=DIR` reads commands as they lie in shared memory, without
//! the receipt checks of foretrace-shm, and prints one JSON object per line: `at`, `mode`, `pen`, `published`
//! when the mode changes and at most every 10 ms; at the end, when the file UNTIL exists, `report` (see
//! [`Judge`]).

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{Attachment, Foretrace, Instance, monotonic_now_ns};
use foretrace_shm::{JointCommand, JointState, Message};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Node, NodeBuilder, SignalHandlingMode, ipc};
use serde_json::json;

use crate::instance_of;
use crate::judge::Judge;

/// No test takes longer.
const LONGEST: Duration = Duration::from_secs(3600);
const BEAT_NS: u64 = 10_000_000;
const LOOK: Duration = Duration::from_millis(100);

/// The recorder, with the arguments after `recorder`.
#[must_use]
pub fn main(arguments: &[String]) -> ExitCode {
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Unchecked ports.
struct Tap {
    commands: Subscriber<ipc::Service, JointCommand, ()>,
    states: Subscriber<ipc::Service, JointState, ()>,
    _node: Node<ipc::Service>,
}

impl Tap {
    fn open(instance: &Instance) -> Result<Self, Box<dyn Error>> {
        let node = NodeBuilder::new()
            .config(instance.config())
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()?;
        Ok(Self { commands: subscriber(&node)?, states: subscriber(&node)?, _node: node })
    }
}

fn subscriber<T: Message>(
    node: &Node<ipc::Service>,
) -> Result<Subscriber<ipc::Service, T, ()>, Box<dyn Error>> {
    let service = node.service_builder(&T::SERVICE.try_into()?).publish_subscribe::<T>().open()?;
    Ok(service.subscriber_builder().buffer_size(T::QOS.buffer).create()?)
}

fn run(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let until = arguments.first().ok_or("until which file?")?;
    let instance = instance_of(arguments)?;
    let mut foretrace = Foretrace::attach_within(&instance, Duration::from_secs(30))?;
    let mut tap = Some(Tap::open(&instance)?);
    let mut judge = Judge::default();
    let (begin, mut looked) = (Instant::now(), Instant::now());
    let (mut beat_ns, mut mode) = (0, u32::MAX);
    println!("{}", json!({ "listens": monotonic_now_ns() }));
    while begin.elapsed() < LONGEST {
        if let Some(tap) = &tap {
            while let Some(state) = tap.states.receive()? {
                judge.state(&state);
            }
            while let Some(command) = tap.commands.receive()? {
                judge.command(&command);
                let now_ns = monotonic_now_ns();
                if command.mode != mode || now_ns >= beat_ns + BEAT_NS {
                    (mode, beat_ns) = (command.mode, now_ns);
                    let (pen, published) = (command.pen_stamp_ns, command.published_ns);
                    println!("{}", json!({ "at": now_ns, "mode": mode, "pen": pen, "published": published }));
                }
            }
        }
        if looked.elapsed() >= LOOK {
            looked = Instant::now();
            if Path::new(until).exists() {
                break;
            }
            // Without a daemon, retries.
            if let Ok(Attachment::Renewed) = foretrace.reattach_if_needed() {
                // The old ports hold places that the new ones need.
                tap = None;
            }
            if tap.is_none() {
                tap = Tap::open(&instance).ok();
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    println!("{}", json!({ "report": judge.report() }));
    Ok(std::io::stdout().flush()?)
}
