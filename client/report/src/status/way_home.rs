//! The way home in a status: words while the arm moves along it, and JSON.

use foretrace_shm::{Mode, Status, WayHome};
use serde_json::{Value, json};

/// How far the arm is; `None` in any other mode.
pub(crate) fn words(status: &Status) -> Option<String> {
    let WayHome { farthest_rad, left_s, share, joint, .. } = status.way_home;
    (status.mode == u32::from(Mode::Homing)).then(|| {
        let percent = 100.0 * share.max(0.0);
        format!("{percent:.0} % gone, {left_s:.1} s to go; joint {joint} is {farthest_rad:.3} rad from home")
    })
}

/// The way home; null where the joints are not known.
pub(crate) fn value(way: &WayHome) -> Value {
    let known = |value: f64| (value >= 0.0).then_some(value);
    json!({
        "farthest_rad": known(way.farthest_rad), "joint": known(way.farthest_rad).map(|_| way.joint),
        "left_s": known(way.left_s), "share": known(way.share), "moving": way.moving != 0,
    })
}
