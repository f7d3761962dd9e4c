//! Where the measured arm is, and what its process says of it.

use foretrace_client::{Status, monotonic_now_ns};
use serde_json::{Value, json};

/// The six angles in degrees, as a pendant shows them; `None` while there is no joint state.
pub(crate) fn joints(status: &Status) -> Option<String> {
    let angles = status.joints_q.map(|q| format!("{:>7.1}", q.to_degrees()));
    is_known(status).then(|| format!("{} °", angles.concat().trim_start()))
}

/// The tool in the base frame, as a pendant shows it, and over the paper.
pub(crate) fn pose(status: &Status) -> Option<String> {
    let [x, y, z, rx, ry, rz] = status.tool_base;
    let mm = |m: f64| m * 1e3;
    let [along, across, above] = status.tool_plane_m.map(mm);
    is_known(status).then(|| {
        format!(
            "base {:.1} {:.1} {:.1} mm, {rx:.3} {ry:.3} {rz:.3} rad   paper {along:.1} {across:.1} mm, {above:.1} \
             above",
            mm(x),
            mm(y),
            mm(z)
        )
    })
}

/// What the arm's process says, since when, and what to do.
pub(crate) fn note(status: &Status) -> Option<String> {
    let text = status.note.text()?;
    let to_do = status.note.to_do().map_or(String::new(), |to_do| format!("; {to_do}"));
    let since_s = monotonic_now_ns().saturating_sub(status.note_since_ns) as f64 * 1e-9;
    Some(format!("{text}{to_do} (since {since_s:.0} s)"))
}

/// The same under stable keys.
pub(crate) fn json(status: &Status) -> [(&'static str, Value); 4] {
    let known = is_known(status);
    let note = status
        .note
        .text()
        .map(|text| json!({ "text": text, "to_do": status.note.to_do(), "since_ns": status.note_since_ns }));
    [
        ("joints_rad", json!(known.then_some(status.joints_q))),
        ("tool_base", json!(known.then_some(status.tool_base))),
        ("tool_plane_m", json!(known.then_some(status.tool_plane_m))),
        ("note", json!(note)),
    ]
}

fn is_known(status: &Status) -> bool {
    status.joint_state_age_ns != u64::MAX
}

#[cfg(test)]
mod tests {
    use foretrace_client::wire::NoteWords;

    use super::*;

    #[test]
    fn angles_are_shown_once_there_are_some() {
        let mut status = Status { joint_state_age_ns: u64::MAX, ..Status::default() };
        assert_eq!((joints(&status), pose(&status), note(&status)), (None, None, None));
        assert!(json(&status).iter().all(|(_, value)| value.is_null()));
        let half = std::f64::consts::FRAC_PI_2;
        (status.joint_state_age_ns, status.joints_q) = (7, [0.0, -half, half, 0.1, 0.0, -3.0]);
        status.tool_plane_m = [0.01, -0.02, 0.003];
        status.note = NoteWords::new("speed scaling is at 50 %", "set the slider");
        assert_eq!(joints(&status).unwrap(), "0.0  -90.0   90.0    5.7    0.0 -171.9 °");
        assert!(pose(&status).unwrap().ends_with("paper 10.0 -20.0 mm, 3.0 above"));
        assert!(note(&status).unwrap().starts_with("speed scaling is at 50 %; set the slider (since "));
    }
}
