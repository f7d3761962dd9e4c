//! The predictor of another process on the wire: grid steps out, previews in, and what became of them.

use foretrace_control::pen::Motion;
use foretrace_control::predict::external::MOST_LATE;
use foretrace_control::predict::{ExternalPreview, ExternalReport, LearnStep, MAX_PREVIEW, PreviewRefusal};
use foretrace_shm as shm;
use foretrace_shm::{PREVIEW_REFUSALS, PREVIEW_STEPS, preview_flags};

// The last reason of the wire is the port's.
const _: () = assert!(MAX_PREVIEW == PREVIEW_STEPS && PreviewRefusal::ALL.len() + 1 == PREVIEW_REFUSALS);

/// A closed grid step of `step_ns`, after which a plan looks at `steps`.
#[must_use]
pub fn pen_step(step: &LearnStep, step_ns: u64, steps: usize) -> shm::PenStep {
    let [x_m, y_m] = step.position;
    let [dx_m, dy_m] = step.pen.x.map(|x| x * step.scale_m);
    shm::PenStep {
        index: step.index,
        time_ns: step.index.saturating_mul(step_ns),
        step_ns,
        x_m,
        y_m,
        dx_m,
        dy_m,
        scale_m: step.scale_m,
        longest_m: step.limit * step.scale_m,
        motion: match step.motion {
            Motion::Start => shm::PenMotion::Start,
            Motion::Continues => shm::PenMotion::Continues,
            Motion::Jump => shm::PenMotion::Jump,
        }
        .into(),
        contact: step.pen.touch.contact.into(),
        // A plan may look farther when the arm's lag has grown by then, and a late preview is carried on.
        wanted: (steps + MOST_LATE as usize).min(MAX_PREVIEW) as u32,
        ..Default::default()
    }
}

/// What another process predicts; its numbers are the law's to judge.
#[must_use]
pub fn external_preview(message: &shm::PenPreview) -> ExternalPreview {
    let mut preview = ExternalPreview {
        base_index: message.base_index,
        count: message.count as usize,
        radii: message.radius_m,
        ..ExternalPreview::EMPTY
    };
    for (position, (x, y)) in preview.positions.iter_mut().zip(message.x_m.iter().zip(&message.y_m)) {
        *position = [*x, *y];
    }
    if message.flags & preview_flags::RADII != 0 {
        preview.radii_count = preview.count;
    }
    preview
}

/// The state of the predictor of another process; counts and latency are the shell's.
#[must_use]
pub fn external_state(report: Option<&ExternalReport>) -> shm::ExternalState {
    report.map_or(shm::ExternalState::NONE, |report| shm::ExternalState {
        weight: report.weight as f32,
        evidence: report.evidence as f32,
        ..shm::ExternalState::NONE
    })
}
