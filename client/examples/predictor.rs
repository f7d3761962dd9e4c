//! A predictor in a process of its own: constant velocity. Argument: the instance (default 0). The daemon
//! asks for it where `predictor.kind` is `external`: `foretrace request predictor external`.

use std::error::Error;
use std::time::Duration;

use foretrace_client::wire::{PREVIEW_STEPS, PenMotion};
use foretrace_client::{Foretrace, PreviewSendError};

fn main() -> Result<(), Box<dyn Error>> {
    let number = std::env::args().nth(1).map_or(Ok(0), |text| text.parse())?;
    let foretrace = Foretrace::attach(number)?;
    let (mut steps, mut previews) = (foretrace.pen_steps()?, foretrace.previews()?);
    println!("predicting; Ctrl-C ends this, and the fallback serves");
    loop {
        let Some(step) = steps.next_within(Duration::from_secs(1)) else {
            if !foretrace.daemon_is_up() {
                return Err("the daemon is gone".into());
            }
            continue;
        };
        // A start or a jump: nothing before it belongs to it.
        let continues = step.motion == u32::from(PenMotion::Continues);
        let velocity = if continues { [step.dx_m, step.dy_m] } else { [0.0; 2] };
        let positions: [[f64; 2]; PREVIEW_STEPS] = std::array::from_fn(|i| {
            let ahead = (i + 1) as f64;
            [step.x_m + ahead * velocity[0], step.y_m + ahead * velocity[1]]
        });
        match previews.send(step.index, &positions[..step.wanted as usize], &[]) {
            Ok(_heard) => {}
            Err(PreviewSendError::HandedOver) => return Ok(()),
            Err(error) => eprintln!("left out: {error}"),
        }
    }
}
