//! Whether the daemon and a command that makes it move mean the same arm and the same paper.
//!
//! Contract: judged by where both see the tool for the joints that the daemon commands, before anything
//! moves. A command that reads other settings would lead the tool to somewhere else.

use std::time::{Duration, Instant};

use foretrace_client::Telemetry;
use foretrace_config::Config;
use foretrace_failure::Failure;

/// Farther apart than rounding, nearer than any two tools \[m\].
const SAME_M: f64 = 1e-4;
const PATIENCE: Duration = Duration::from_secs(2);
const STRIDE: Duration = Duration::from_millis(5);

/// Compares the daemon's tool with that of `config`; the loop has to be armed.
///
/// # Errors
///
/// They differ, or the daemon reports nothing of its ticks.
pub(crate) fn same_tool(telemetry: &mut Telemetry, config: &Config) -> Result<(), Failure> {
    let plane = config.follower_settings().plane;
    let deadline = Instant::now() + PATIENCE;
    // What lies in the buffer may be older than the arming.
    telemetry.drain(|_| {});
    loop {
        let mut newest = None;
        telemetry.drain(|record| newest = Some((record.q, record.tool_m)));
        if let Some((q, theirs)) = newest {
            let ours = plane.point_from_base(&config.robot().chain.forward(&q).position);
            let apart_m = [ours.x, ours.y, ours.z]
                .iter()
                .zip(&theirs)
                .map(|(ours, theirs)| (ours - theirs).powi(2))
                .sum::<f64>()
                .sqrt();
            if apart_m <= SAME_M {
                return Ok(());
            }
            return Err(Failure::bad_input(
                format_args!(
                    "the daemon sees the tool {:.1} mm from where the settings of this command see it",
                    apart_m * 1e3
                ),
                "give this command the settings that the daemon runs with (--config FILE or --preset NAME)",
            ));
        }
        if Instant::now() > deadline {
            return Err(Failure::failed("the daemon tells nothing of its ticks", "see `foretrace status`"));
        }
        std::thread::sleep(STRIDE);
    }
}
