//! A process that sends invalid messages: forged numbers, headers, rates, layouts.
//!
//! Contract: `forge KIND SECONDS --instance=N --root=DIR` writes messages into shared memory without the
//! checks of foretrace-shm, and prints at the end one JSON object: `sent` by kind, and the daemon's counters
//! `before` and `after`.

mod arm;
mod pen;

use std::collections::BTreeMap;
use std::error::Error;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use foretrace_client::{Commands, Foretrace, Instance, Status};
use foretrace_shm::{JointState, Message, PenSample, monotonic_now_ns};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{AttributeSpecifier, Node, NodeBuilder, SignalHandlingMode, ipc};
use serde_json::{Value, json};

use crate::instance_of;

/// The daemon publishes its status ten times per second.
const STATUS: Duration = Duration::from_secs(5);

/// The forger, with the arguments after `forge`.
#[must_use]
pub fn main(arguments: &[String]) -> ExitCode {
    match run(arguments) {
        Ok(told) => {
            println!("{told}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<Value, Box<dyn Error>> {
    let [kind, seconds, ..] = arguments else { return Err("forge what, and for how many seconds?".into()) };
    let time = Duration::from_secs_f64(seconds.parse()?);
    let instance = instance_of(arguments)?;
    if kind == "layout" {
        return squat(&instance, time);
    }
    let foretrace = Foretrace::attach_within(&instance, Duration::from_secs(30))?;
    if kind == "deaf" {
        return deaf(&foretrace, time);
    }
    let mut status = foretrace.status()?;
    let mut counters = || status.next_within(STATUS).ok_or("the daemon says no status");
    let before = counters()?;
    let sent = match kind.as_str() {
        "arm" => arm::forge(&instance, &foretrace, time)?,
        "degrees" => arm::degrees(&instance, time)?,
        kind => {
            let kind = pen::Kind::from_word(kind).ok_or("an unknown kind of forgery")?;
            pen::forge(&mut Forge::open(&instance)?, kind, time)?
        }
    };
    // Two periods: what was sent last is counted in the second at the latest.
    std::thread::sleep(Duration::from_millis(300));
    counters()?;
    let after = counters()?;
    Ok(json!({ "sent": sent, "before": counts(&before), "after": counts(&after) }))
}

/// What the daemon counted that a forger may have caused.
fn counts(status: &Status) -> Value {
    let counters = &status.counters;
    json!({
        "mode": status.mode, "fault": status.fault,
        "pen": {
            "received": counters.pen_received, "dropped": counters.pen_dropped,
            "rejected": counters.pen_rejected.total(), "by_reason": counters.pen_rejected.by_reason,
            "out_of_order": counters.pen_out_of_order, "outliers": counters.pen_outliers,
        },
        "arm": {
            "received": counters.joint_state_received, "dropped": counters.joint_state_dropped,
            "rejected": counters.joint_state_rejected.total(),
                "by_reason": counters.joint_state_rejected.by_reason,
        },
        "learner": {
            "version": status.learner_version, "updates": status.learner_updates,
            "promotions": status.learner_promotions, "refused": status.learner_refused,
            "weights_refused": counters.weights_refused,
        },
        "commands": { "sent": counters.commands_sent, "failed": counters.commands_failed },
    })
}

/// A publisher that sends whatever it is given.
struct Forge<T: Message> {
    port: Publisher<ipc::Service, T, ()>,
    sent: BTreeMap<&'static str, u64>,
    _node: Node<ipc::Service>,
}

impl<T: Message> Forge<T> {
    fn open(instance: &Instance) -> Result<Self, Box<dyn Error>> {
        let node = node(instance)?;
        let service = node.service_builder(&T::SERVICE.try_into()?).publish_subscribe::<T>().open()?;
        let port = service.publisher_builder().max_loaned_samples(1).create()?;
        Ok(Self { port, sent: BTreeMap::new(), _node: node })
    }

    fn send(&mut self, what: &'static str, message: T) -> Result<(), Box<dyn Error>> {
        *self.sent.entry(what).or_default() += 1;
        self.port.loan_uninit()?.write_payload(message).send()?;
        Ok(())
    }
}

fn node(instance: &Instance) -> Result<Node<ipc::Service>, Box<dyn Error>> {
    Ok(NodeBuilder::new()
        .config(instance.config())
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()?)
}

/// Takes the largest buffers there are and never reads.
fn deaf(foretrace: &Foretrace, time: Duration) -> Result<Value, Box<dyn Error>> {
    let _commands = foretrace.commands(Commands::MAX_BUFFER)?;
    let _ports =
        (foretrace.telemetry()?, foretrace.status()?, foretrace.pen_watch()?, foretrace.joint_watch()?);
    println!("{}", json!({ "listens": monotonic_now_ns() }));
    std::thread::sleep(time);
    Ok(json!({ "read": 0 }))
}

/// Occupies the pen's service as a program of another version would, with another layout.
fn squat(instance: &Instance, time: Duration) -> Result<Value, Box<dyn Error>> {
    // Makes the folder, as a daemon of that version would have.
    drop(instance.lock()?);
    let node = node(instance)?;
    let attributes =
        AttributeSpecifier::new().define(&"foretrace.layout".try_into()?, &"0123456789abcdef".try_into()?)?;
    let _service = node
        .service_builder(&PenSample::SERVICE.try_into()?)
        .publish_subscribe::<PenSample>()
        .max_publishers(PenSample::QOS.publishers)
        .max_subscribers(PenSample::QOS.subscribers)
        .max_nodes(foretrace_shm::MAX_PEERS)
        .subscriber_max_buffer_size(PenSample::QOS.buffer)
        .create_with_attributes(&attributes)?;
    println!("{}", json!({ "listens": monotonic_now_ns() }));
    std::thread::sleep(time);
    Ok(json!({ "sat": time.as_secs_f64() }))
}

/// Sleeps until `due_ns`.
fn pace(begin: Instant, due_ns: u64) {
    let due = Duration::from_nanos(due_ns);
    std::thread::sleep(due.saturating_sub(begin.elapsed()));
}

/// Invalid joint states, one after the other.
fn bad_states(good: JointState) -> [(&'static str, JointState); 7] {
    let joint = |value: f64| {
        let mut state = good;
        state.q[2] = value;
        state
    };
    let mut fast = good;
    fast.qd[0] = f64::NEG_INFINITY;
    [
        ("nan", joint(f64::NAN)),
        ("infinite", fast),
        ("huge", joint(1e300)),
        ("unknown mode", JointState { safety_mode: 99, ..good }),
        ("foreign boot", JointState { header: boot(good.header), ..good }),
        ("future", JointState { header: later(good.header), ..good }),
        ("past", JointState { header: earlier(good.header), ..good }),
    ]
}

fn boot(header: foretrace_shm::Header) -> foretrace_shm::Header {
    foretrace_shm::Header { boot_id: header.boot_id ^ 1, ..header }
}

fn later(header: foretrace_shm::Header) -> foretrace_shm::Header {
    foretrace_shm::Header { stamp_ns: header.stamp_ns + 1_000_000_000, ..header }
}

fn earlier(header: foretrace_shm::Header) -> foretrace_shm::Header {
    foretrace_shm::Header { stamp_ns: header.stamp_ns.saturating_sub(1_000_000_000), ..header }
}
