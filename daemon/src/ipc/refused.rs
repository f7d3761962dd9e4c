//! The newest refused pen sample, refused by a port or by the pen grid.

use crate::rt::facts::TickFacts;
use crate::wire::{Refused, pen_rejection};

/// The newest refused pen sample.
#[must_use]
pub fn pen(facts: &TickFacts) -> Option<Refused> {
    let grid = facts
        .output
        .pen_refused
        .and_then(|refusal| pen_rejection(&refusal).map(|why| Refused { why, at: refusal.at }));
    match (facts.ports.pen_refused, grid) {
        (Some(port), Some(grid)) => Some(if port.at > grid.at { port } else { grid }),
        (port, grid) => port.or(grid),
    }
}

#[cfg(test)]
mod tests {
    use foretrace_control::pen::{PenRefusal, PenRejection};
    use foretrace_control::units::Stamp;
    use foretrace_shm::{RejectReason, Rejection};

    use super::*;
    use crate::ipc::tests::facts;

    #[test]
    fn newest_of_port_and_grid_is_reported_with_its_evidence() {
        let mut tick = facts(1);
        assert_eq!(pen(&tick), None);
        let grid = PenRefusal {
            why: PenRejection::OutOfRange,
            axis: Some(1),
            value: 3.2,
            bound: 0.5,
            at: Stamp(20),
        };
        tick.output.pen_refused = Some(grid);
        let text = |tick: &_| crate::wire::refused(pen(tick)).to_string();
        assert!(
            text(&tick).starts_with("y_m = 3.2000 m, beyond the edge of the device at 0.5000 m"),
            "{}",
            text(&tick)
        );
        let why = Rejection::new(RejectReason::NotFinite, "pressure").because(f64::NAN, 1.0);
        tick.ports.pen_refused = Some(Refused { why, at: Stamp(10) });
        assert!(text(&tick).starts_with("y_m"), "{}", text(&tick));
        tick.ports.pen_refused = Some(Refused { why, at: Stamp(30) });
        assert!(text(&tick).starts_with("pressure = NaN"), "{}", text(&tick));
        let future = PenRefusal {
            why: PenRejection::FromFuture,
            axis: None,
            value: 1.7e9,
            bound: 0.02,
            at: Stamp(40),
        };
        tick.output.pen_refused = Some(future);
        assert!(text(&tick).contains("the time of day?"), "{}", text(&tick));
    }
}
