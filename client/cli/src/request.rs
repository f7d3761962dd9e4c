//! `foretrace request`: sends a request to the running daemon.
//!
//! Contract: ends within `--timeout`. A stop needs no middleware; every other request runs in a thread that
//! is abandoned at the timeout, because calls into damaged shared memory can hang.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use foretrace_client::wire::{ControlResponse, ControlStatus};
use foretrace_client::{Mode, RequestError, Requests, StopError, Stopped};
use foretrace_control::predict::PredictorKind;
use foretrace_report::failures::refused;
use serde_json::json;

use crate::failure::{Cause, Failure};
use crate::output::{JsonArgs, say};
use crate::settings::InstanceArgs;
use crate::values;

/// Ask the running daemon: arm, disarm, stop, set trust, switch the predictor, reload the settings
#[derive(Debug, clap::Args)]
pub(crate) struct RequestArgs {
    #[command(subcommand)]
    request: DaemonRequest,

    #[command(flatten)]
    instance: InstanceArgs,

    /// Seconds to wait for the answer [default: 2; reload: 12]
    #[arg(long, value_name = "S", global = true, value_parser = values::number(0.01..=3600.0, "a number of seconds from 0.01 to 3600"))]
    timeout: Option<f64>,

    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Clone, PartialEq, clap::Subcommand)]
enum DaemonRequest {
    /// Take over the arm at its measured joints; also clears a latched stop
    Arm,
    /// Stop smoothly and disarm
    Disarm,
    /// Stop smoothly and stay stopped until armed again
    Stop,
    /// Set the trust in the prediction by hand, or let the evidence decide
    Trust {
        /// 0 (hold only) to 1 (prediction only), auto (evidence decides), or freeze (stays as it is)
        #[arg(value_name = "VALUE|auto|freeze", value_parser = trust)]
        value: TrustSetting,
    },
    /// Switch to another predictor; trust goes through 0
    Predictor {
        #[arg(value_name = "NAME", help = values::predictors(), value_parser = values::predictor)]
        kind: PredictorKind,
    },
    /// Reload the settings file; only live settings may have changed
    Reload,
    /// Show mode and trust, changing nothing
    Query,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum TrustSetting {
    Auto,
    Freeze,
    By(f64),
}

pub(crate) fn run(args: &RequestArgs) -> Result<(), Failure> {
    args.json.claim()?;
    // Another process reads the settings first, perhaps after one that is under way.
    let usual = if args.request == DaemonRequest::Reload { 12.0 } else { 2.0 };
    let wait = Duration::from_secs_f64(args.timeout.unwrap_or(usual));
    if args.request == DaemonRequest::Stop {
        return stop(args, wait);
    }
    let answer = match asked(args, wait)? {
        Ok(answer) => answer,
        Err(error) => {
            if let RequestError::Refused { status, message, detail, value } = &error {
                args.json.write(&result(*status, message, *detail, *value))?;
            }
            return Err(refused(&error));
        }
    };
    let mode = Mode::try_from(answer.detail).map_or("unknown", Mode::label);
    say!("{answer} (mode {mode}, trust {:.2})", answer.value);
    args.json.write(&result(answer.outcome(), &answer.text(), answer.detail, answer.value))
}

/// Attaches and asks, within `wait`.
fn asked(args: &RequestArgs, wait: Duration) -> Result<Result<ControlResponse, RequestError>, Failure> {
    let (answer, answered) = mpsc::channel();
    let (instance, request) = (args.instance.clone(), args.request.clone());
    // The thread itself reports the daemon's silence, so it has to be done sooner, with what attaching takes.
    let done_by = Instant::now() + (wait - (wait / 5).min(Duration::from_millis(100)));
    let asking = move || {
        let asked = instance.attach().map(|foretrace| {
            let mut requests = foretrace.requests();
            ask(&mut requests, &request, done_by.saturating_duration_since(Instant::now()))
        });
        // The receiver may be gone.
        let _ = answer.send(asked);
    };
    std::thread::Builder::new()
        .name("foretrace-asks".to_owned())
        .spawn(asking)
        .map_err(|error| Failure::failed(format_args!("starting a thread: {error}"), "free some memory"))?;
    match answered.recv_timeout(wait) {
        Ok(asked) => asked,
        Err(RecvTimeoutError::Disconnected) => {
            Err(Failure::failed("asking ended by a fault", "see `foretrace doctor`"))
        }
        Err(RecvTimeoutError::Timeout) => Err(Failure::failed(
            format_args!("no answer within {} ms: attaching hangs", wait.as_millis()),
            "see `foretrace doctor`; `foretrace request stop` does not need to attach",
        )),
    }
}

/// Stops without the middleware.
fn stop(args: &RequestArgs, wait: Duration) -> Result<(), Failure> {
    const OTHERWISE: &str = "use the arm's own stop button";
    let stopped = foretrace_client::stop(&args.instance.instance()?, wait).map_err(|error| match error {
        StopError::NoDaemon { .. } => Failure::new(
            Cause::NoDaemon,
            format_args!("no stop was sent: {error}"),
            "if an arm moves, use its own stop button; a service's daemon is found with `sudo -u \
                 foretrace \
                 XDG_RUNTIME_DIR=/run/foretrace foretrace request stop`",
        ),
        other => Failure::failed(other, OTHERWISE),
    })?;
    // Coming to rest takes its time; in idle there is nothing to stop.
    let Stopped { mode, trust } = stopped;
    let status = if mode == Some(Mode::Idle) { ControlStatus::Ok } else { ControlStatus::Accepted };
    match trust {
        Some(trust) => say!("{status} (mode {}, trust {trust:.2})", stopped.words()),
        None => say!("{status} (mode {})", stopped.words()),
    }
    args.json.write(&result(status, "", mode.map_or(u32::MAX, u32::from), trust.unwrap_or(f64::NAN)))
}

fn ask(
    requests: &mut Requests,
    request: &DaemonRequest,
    wait: Duration,
) -> Result<ControlResponse, RequestError> {
    match request {
        DaemonRequest::Arm => requests.arm(wait),
        DaemonRequest::Disarm => requests.disarm(wait),
        DaemonRequest::Stop => requests.stop(wait),
        DaemonRequest::Trust { value: TrustSetting::Auto } => requests.trust_auto(wait),
        DaemonRequest::Trust { value: TrustSetting::Freeze } => requests.freeze_trust(wait),
        DaemonRequest::Trust { value: TrustSetting::By(value) } => requests.set_trust(*value, wait),
        DaemonRequest::Predictor { kind } => requests.switch_predictor(kind.name(), wait),
        DaemonRequest::Reload => requests.reload(wait),
        DaemonRequest::Query => requests.query(wait),
    }
}

fn result(status: ControlStatus, message: &str, detail: u32, value: f64) -> serde_json::Value {
    let success = i32::from(status) >= 0;
    let mode = Mode::try_from(detail).map_or("unknown", Mode::label);
    json!({ "status": status.label(), "message": message, "success": success, "mode": mode, "trust": value })
}

fn trust(text: &str) -> Result<TrustSetting, String> {
    match text.parse::<f64>() {
        _ if text == "auto" => Ok(TrustSetting::Auto),
        _ if text == "freeze" => Ok(TrustSetting::Freeze),
        Ok(value) if (0.0..=1.0).contains(&value) => Ok(TrustSetting::By(value)),
        _ => Err("a number from 0 to 1, auto or freeze".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trust_is_a_share_or_auto() {
        assert_eq!(trust("auto"), Ok(TrustSetting::Auto));
        assert_eq!(trust("freeze"), Ok(TrustSetting::Freeze));
        assert_eq!(trust("0.25"), Ok(TrustSetting::By(0.25)));
        for wrong in ["1.1", "-0.1", "nan", "inf", ""] {
            assert!(trust(wrong).is_err(), "{wrong}");
        }
    }
}
