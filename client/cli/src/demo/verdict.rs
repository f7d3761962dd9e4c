//! Whether a run went as it should: what stopped the arm, where its tool was, which limits were kept.
//!
//! Contract: pure. The worst finding is told, the one that comes first here; the report has them all.

use foretrace_control::extent::ExtentBounds;

use super::evidence::Evidence;
use super::figures::Figures;
use crate::failure::Failure;
use crate::stopped;

/// `Ok` for a run without a finding.
pub(crate) fn of(evidence: &Evidence, figures: &Figures, bounds: &ExtentBounds) -> Result<(), Failure> {
    let count = figures.limit_violations();
    if count > 0 {
        return Err(Failure::failed(
            format_args!("{count} commands broke a limit"),
            "this is a fault of foretrace: please report it with the report folder",
        ));
    }
    if let Some(breach) = evidence.extent.and_then(|extent| bounds.broken_by(&extent)) {
        return Err(Failure::failed(
            format_args!("the tool left its envelope: {breach}"),
            "lower the speed of the pen or of plane.scale, or give the plan back its mpc.limits; the report has the picture",
        ));
    }
    if let (Some(stop), Some(told)) = (evidence.stops.first(), figures.control_loop.stops.first()) {
        return Err(Failure::failed(
            format_args!("the daemon stopped the arm by itself after {:.1} s\n  {}", told.at_s, told.words()),
            format_args!("\n  {}", stopped::remedy(stop.fault)),
        ));
    }
    if figures.tracking.is_none() {
        return Err(Failure::failed(
            "the arm never came near the pen, or the pen never touched the paper",
            "give it more --seconds, play something with ink, or look at the settings",
        ));
    }
    Ok(())
}
