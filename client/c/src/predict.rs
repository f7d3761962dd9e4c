//! The functions of `foretrace.h` for predictors in a process of their own; contract and safety as in
//! `exports`.

use std::time::Duration;

use foretrace_client::wire::{PenPreview, PenStep};
use foretrace_client::{Foretrace, PenSteps, Previews};

use crate::code::{CallFailure, ErrorCode, run};
use crate::exports::opened;
use crate::handles::with;
use crate::pointers::{Out, offer, read, room};

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_pen_steps(attachment: u64, out: Out<'_, u64>) -> i32 {
    run(|| opened(out, || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.pen_steps()?))))
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_pen_steps_next(
    steps: u64,
    timeout_ns: u64,
    step: *mut PenStep,
    size: usize,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let place = unsafe { room("step", step, size) }?;
        let next =
            with(steps, |steps: &mut PenSteps| Ok(steps.next_within(Duration::from_nanos(timeout_ns))))?;
        place.put(next.ok_or_else(|| {
            CallFailure::new(
                ErrorCode::NotSent,
                "no step in time: the pen is away, or predictor external is not chosen",
            )
        })?);
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_previews(attachment: u64, out: Out<'_, u64>) -> i32 {
    run(|| opened(out, || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.previews()?))))
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_previews_send(
    previews: u64,
    preview: *const PenPreview,
    size: usize,
    mut heard: Out<'_, bool>,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let preview = unsafe { read("preview", preview, size) }?;
        let connected = with(previews, |previews: &mut Previews| Ok(previews.send_preview(preview)?))?;
        offer(&mut heard, connected);
        Ok(())
    })
}
