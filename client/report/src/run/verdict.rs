//! The verdict on a run: what stopped the arm, where its tool was, which limits were kept.
//!
//! Contract: pure. The program ends with the worst finding, the one that comes first; the report has them
//! all.

use foretrace_control::extent::ExtentBounds;

use super::figures::RunFigures;
use super::gathered::Gathered;
use crate::stopped;
use foretrace_failure::Failure;

/// What went wrong, why, and what to do about it: a line each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunFinding {
    pub what: String,
    /// What fired, with its evidence; empty where `what` says it.
    pub reason: String,
    pub remedy: String,
}

impl RunFinding {
    fn new(what: String, remedy: &str) -> Self {
        Self { what, reason: String::new(), remedy: remedy.to_owned() }
    }

    /// As the program ends with it.
    pub fn failure(&self) -> Failure {
        let Self { what, reason, remedy } = self;
        if reason.is_empty() {
            return Failure::failed(what, remedy);
        }
        Failure::failed(format_args!("{what}\n  {reason}\n  {remedy}"), "")
    }
}

/// All findings, the worst first; none for a run as it should be. An arm that did not follow its commands may
/// leave the envelope as well: the stop, which names the cause, comes first.
pub(super) fn of(gathered: &Gathered, figures: &RunFigures, bounds: &ExtentBounds) -> Vec<RunFinding> {
    let count = figures.limit_violations();
    let illegal = (count > 0).then(|| {
        RunFinding::new(
            format!("{count} commands broke a limit"),
            "this is a fault of foretrace: please report it with the report folder",
        )
    });
    let breach = gathered.extent.and_then(|extent| bounds.broken_by(&extent)).map(|breach| {
        RunFinding::new(
            format!("the tool left its envelope: {breach}"),
            "lower the speed of the pen or of plane.scale, or restore the preset's mpc.limits; the report \
             has the picture",
        )
    });
    let stops = gathered.stops.iter().zip(&figures.control_loop.stops).map(|(stop, figures)| {
        let (mut reason, mut remedy) = (figures.words(), stopped::remedy(stop.fault));
        if let Some(starved) = gathered.arm_words.starved(stop.fault, &stop.detail) {
            reason = format!("{reason}: {starved}");
            "run the demo again, with less beside it".clone_into(&mut remedy);
        }
        RunFinding {
            what: format!("the daemon stopped the arm by itself after {:.1} s", figures.at_s),
            reason,
            remedy,
        }
    });
    let mut findings: Vec<RunFinding> = illegal.into_iter().chain(stops).chain(breach).collect();
    if findings.is_empty() && figures.tracking.is_none() {
        findings.push(RunFinding::new(
            "the arm never came near the pen, or the pen never touched the paper".to_owned(),
            "give it more --seconds, play something with ink, or look at the settings",
        ));
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fired_and_its_remedy_have_a_line_each() {
        let mut finding = RunFinding::new("the daemon stopped the arm".to_owned(), "do this");
        assert_eq!(finding.failure().to_string(), "the daemon stopped the arm; do this");
        finding.reason = "tracking error: joint 3".to_owned();
        let text = finding.failure().to_string();
        assert_eq!(text, "the daemon stopped the arm\n  tracking error: joint 3\n  do this");
    }
}
