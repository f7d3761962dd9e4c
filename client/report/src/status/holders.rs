//! What stands beside the status in the instance's folder: who holds the pen and the dead-man switch, and the
//! newest file of a flight recorder.

use foretrace_client::{Holder, Instance, Place};
use foretrace_live::last_flight::{self, LastFlight};
use foretrace_live::recorder::unix_minus_monotonic;
use foretrace_shm::monotonic_now_ns;
use serde_json::{Value, json};

/// The holders of this moment; none: nobody.
#[derive(Debug, Clone, Default)]
pub struct Holders {
    pub pen: Option<Holder>,
    pub dead_man: Option<Holder>,
    pub flight: Option<LastFlight>,
}

impl Holders {
    pub fn of(instance: &Instance) -> Self {
        Self {
            pen: instance.holder(Place::Pen),
            dead_man: instance.holder(Place::DeadMan),
            flight: last_flight::last(instance.root()),
        }
    }
}

/// "held by the tablet /dev/input/event7 (process 812) since 12 s".
pub(crate) fn words(holder: Option<&Holder>) -> String {
    holder.map_or_else(|| "held by nobody".to_owned(), |holder| format!("held by {holder}"))
}

pub(crate) fn value(holder: Option<&Holder>) -> Value {
    holder.map_or(Value::Null, |holder| {
        json!({
            "kind": holder.who.kind().label(),
            "name": holder.who.name(),
            "pid": holder.pid,
            "since_ns": holder.since_ns,
        })
    })
}

/// "stop, 12 s ago: /box/flight-1700000000000-stop.mcap".
pub(crate) fn flight_words(flight: &LastFlight) -> String {
    let now_ns = monotonic_now_ns().wrapping_add(unix_minus_monotonic());
    let ago_s = now_ns.saturating_sub(flight.unix_ns) / 1_000_000_000;
    let ago = match ago_s {
        0..120 => format!("{ago_s} s"),
        120..7200 => format!("{} min", ago_s / 60),
        _ => format!("{} h", ago_s / 3600),
    };
    format!("{}, {ago} ago: {}", flight.trigger.word(), flight.recording.display())
}

pub(crate) fn flight_value(flight: &LastFlight) -> Value {
    json!({
        "recording": flight.recording.display().to_string(),
        "trigger": flight.trigger.word(),
        "unix_ns": flight.unix_ns,
    })
}
