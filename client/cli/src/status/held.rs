//! Who holds the pen and the dead-man switch.

use foretrace_client::{Holder, Instance, Place};
use serde_json::{Value, json};

/// The holders of this moment; none: nobody.
#[derive(Debug, Clone, Default)]
pub(crate) struct Held {
    pub(crate) pen: Option<Holder>,
    pub(crate) dead_man: Option<Holder>,
}

impl Held {
    pub(crate) fn of(instance: &Instance) -> Self {
        Self { pen: instance.holder(Place::Pen), dead_man: instance.holder(Place::DeadMan) }
    }
}

/// "held by the tablet /dev/input/event7 (process 812) since 12 s".
pub(super) fn words(holder: Option<&Holder>) -> String {
    holder.map_or_else(|| "held by nobody".to_owned(), |holder| format!("held by {holder}"))
}

pub(super) fn value(holder: Option<&Holder>) -> Value {
    holder.map_or(Value::Null, |holder| {
        json!({
            "kind": holder.who.kind().label(),
            "name": holder.who.name(),
            "pid": holder.pid,
            "since_ns": holder.since_ns,
        })
    })
}
