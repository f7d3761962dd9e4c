//! Each way along its own knob between smoothness and lag, for a picture of error against jerk.

use super::{Limits, OneEuroKnobs, ServoKnobs, WayKind, WaySettings};

/// Settings of `kind` from smooth to quick, each with a name; one of them is `settings` itself ("default").
#[must_use]
pub fn sweep(kind: WayKind, settings: &WaySettings) -> Vec<(String, WaySettings)> {
    let mut points = match kind {
        WayKind::ServojGello | WayKind::ServojRos => servoj(settings),
        WayKind::Otg => otg(settings),
        WayKind::Kalman => kalman(settings),
    };
    points.push(("default".to_owned(), *settings));
    points
}

/// The filter's opening with speed, then servoj's look-ahead over its legal range with the filter as it is.
fn servoj(settings: &WaySettings) -> Vec<(String, WaySettings)> {
    let filters = [0.1, 0.3, 3.0].map(|factor| {
        let one_euro =
            OneEuroKnobs { beta_hz_per_mps: settings.one_euro.beta_hz_per_mps * factor, ..settings.one_euro };
        (format!("beta x {factor}"), WaySettings { one_euro, ..*settings })
    });
    let servos = [(0.03, 2000.0), (0.05, 1000.0), (0.1, 300.0), (0.15, 200.0), (0.2, 100.0)]
        .into_iter()
        .filter(|(look_ahead_s, _)| *look_ahead_s != settings.servo.look_ahead_s)
        .map(|(look_ahead_s, gain)| {
            let servo = ServoKnobs { look_ahead_s, gain };
            (format!("look-ahead {look_ahead_s} s"), WaySettings { servo, ..*settings })
        });
    filters.into_iter().chain(servos).collect()
}

/// The generator's jerk limit.
fn otg(settings: &WaySettings) -> Vec<(String, WaySettings)> {
    let jerk = [100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5, 1e6];
    jerk.into_iter()
        .map(|jerk_mps3| {
            let mut point = *settings;
            point.otg.limits = Limits { jerk_mps3, ..settings.otg.limits };
            (format!("jerk limit {jerk_mps3} m/s3"), point)
        })
        .collect()
}

/// The ratio of process to measurement noise.
fn kalman(settings: &WaySettings) -> Vec<(String, WaySettings)> {
    [0.003, 0.01, 0.03, 0.1, 0.3, 3.0, 10.0]
        .into_iter()
        .map(|factor| {
            let mut point = *settings;
            point.kalman.process_mps2 *= factor;
            (format!("process noise x {factor}"), point)
        })
        .collect()
}
