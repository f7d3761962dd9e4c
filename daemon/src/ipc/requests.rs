//! Operators' requests: to the loop, to the supervisor, and the answers back.
//!
//! Contract: every request is answered once, with the loop's answer where the loop decides, at the latest
//! after [`PATIENCE`], a reload after [`RELOAD_PATIENCE`]. Requests that cannot be accepted now are answered
//! `Busy`.

use std::time::{Duration, Instant};

use crossbeam::channel::{self, Receiver, Sender, TryRecvError};
use tracing::{info, warn};

use foretrace_control::follower::{Mode, Refusal, Request};
use foretrace_control::units::{Stamp, Trust};
use foretrace_shm::{
    Call, ControlOp, ControlServer, ControlStatus, FaultReason, NoteWords, StopDetail, monotonic_now_ns,
};

use super::IpcLinks;
use super::homeward::Homeward;
use crate::rt::facts::{LoopAnswer, LoopRequest};
use crate::rt::tick::IpcRings;
use crate::wire::{self, Refused, RequestRoute};

/// Longest time an operator waits for the loop or the supervisor.
pub const PATIENCE: Duration = Duration::from_secs(2);

/// Longest time for a reload: a check may be under way, and another one follows it.
pub const RELOAD_PATIENCE: Duration = Duration::from_secs(10);

/// A request to reload a settings file; the answer is one readable line.
#[derive(Debug)]
pub struct ReloadRequest {
    /// Receiver of the outcome.
    pub answer: Sender<ReloadOutcome>,
}

/// How a reload ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReloadOutcome {
    pub status: ControlStatus,
    /// What changed, or what is wrong.
    pub text: String,
}

/// Origin of a request to the loop.
#[derive(Debug)]
enum Asker {
    Operator(Box<Call>),
    /// A reload changed a live setting.
    Settings(Request),
}

#[derive(Debug)]
pub struct OpenRequests {
    reload: Sender<ReloadRequest>,
    next_token: u64,
    at_loop: Vec<(u64, Instant, Asker)>,
    at_supervisor: Vec<(Instant, Call, Receiver<ReloadOutcome>)>,
    answered: u64,
    refused: u64,
    context: RefusalContext,
}

/// What is known of the arm and explains a refusal.
#[derive(Debug, Clone, Copy, Default)]
pub struct RefusalContext {
    /// The newest refused joint state, which may be why there is none.
    pub joints_refused: Option<Refused>,
    /// What the arm's process says of its arm.
    pub note: Option<NoteWords>,
    /// The stop that is latched.
    pub stop: Option<(FaultReason, StopDetail)>,
}

impl RefusalContext {
    /// Why what was sent at `sent_ns` is refused, where the refusal alone does not say.
    fn why(&self, refusal: Refusal, sent_ns: u64) -> Option<String> {
        match refusal {
            Refusal::NoJointState | Refusal::JointStateStale => {
                let refused = self.joints_refused?;
                Some(format!("the arm's joint states are refused: {}", refused.why))
            }
            Refusal::MotionNotAllowed => {
                let note = self.note.as_ref()?;
                let text = note.text()?;
                Some(note.to_do().map_or(text.clone(), |to_do| format!("{text}; {to_do}")))
            }
            Refusal::StopCame => {
                // One that is older is not why, and of a request there is no more to say.
                let came = |(reason, detail): &(FaultReason, StopDetail)| {
                    *reason != FaultReason::Requested && detail.at_ns >= sent_ns
                };
                let (reason, detail) = self.stop.filter(came)?;
                let evidence = detail.to_string();
                let colon = if evidence.is_empty() { "" } else { ": " };
                Some(format!("the arm was stopped: {reason}{colon}{evidence}"))
            }
            _ => None,
        }
    }
}

impl OpenRequests {
    /// Reloads go to the supervisor through `reload`.
    #[must_use]
    pub fn new(reload: Sender<ReloadRequest>) -> Self {
        Self {
            reload,
            next_token: 1,
            at_loop: Vec::new(),
            at_supervisor: Vec::new(),
            answered: 0,
            refused: 0,
            context: RefusalContext::default(),
        }
    }

    /// Refusals from here on are explained by this.
    pub const fn explain_by(&mut self, context: RefusalContext) {
        self.context = context;
    }

    /// Requests answered so far, and how many of them with a refusal.
    #[must_use]
    pub const fn counts(&self) -> (u64, u64) {
        (self.answered, self.refused)
    }

    /// Takes new requests, and sends answers that are ready or overdue.
    pub fn serve(&mut self, server: &mut ControlServer, links: &mut IpcLinks, mode: Mode, trust: Trust) {
        let IpcLinks { rings, homeward, .. } = links;
        // Bounded by the number of slots of the service.
        for call in std::iter::from_fn(|| server.take()).take(16) {
            self.take(call, rings, mode, trust);
        }
        while let Ok(answer) = rings.answers.pop() {
            self.loop_answered(&answer, homeward);
        }
        self.supervisor_answered(mode, trust);
        self.overdue(mode, trust);
    }

    /// Sends a live setting to the loop.
    pub fn change_setting(&mut self, request: Request, rings: &mut IpcRings) {
        if let Err(Asker::Settings(request)) = self.ask_loop(request, Asker::Settings(request), rings) {
            warn!("the loop is too busy for {request:?}: reload again");
        }
    }

    fn take(&mut self, call: Call, rings: &mut IpcRings, mode: Mode, trust: Trust) {
        if let Err(ahead) = call.request.check_date(monotonic_now_ns()) {
            return self.answer(call, ControlStatus::Invalid, mode, trust, &ahead.to_string());
        }
        match wire::route(&call.request) {
            RequestRoute::Query => self.answer(call, ControlStatus::Ok, mode, trust, ""),
            RequestRoute::UnknownPredictor => {
                let text = wire::unknown_predictor(&call.request);
                self.answer(call, ControlStatus::PredictorUnavailable, mode, trust, &text);
            }
            RequestRoute::Unsupported => {
                let text = "this daemon does not know how to do that";
                self.answer(call, ControlStatus::Unsupported, mode, trust, text);
            }
            RequestRoute::Reload => {
                let (answer, outcome) = channel::bounded(1);
                if self.reload.try_send(ReloadRequest { answer }).is_ok() {
                    self.at_supervisor.push((Instant::now(), call, outcome));
                } else {
                    self.answer(call, ControlStatus::Busy, mode, trust, "another reload is under way");
                }
            }
            RequestRoute::Loop(request) => {
                if let Err(Asker::Operator(call)) =
                    self.ask_loop(request, Asker::Operator(Box::new(call)), rings)
                {
                    self.answer(*call, ControlStatus::Busy, mode, trust, "too many requests: ask again");
                }
            }
        }
    }

    fn ask_loop(&mut self, request: Request, asker: Asker, rings: &mut IpcRings) -> Result<(), Asker> {
        let token = self.next_token;
        let stamp = monotonic_now_ns();
        // Requests of the supervisor are sent now; what little an operator's clock is ahead is taken off.
        let sent = match &asker {
            Asker::Operator(call) => call.request.sent_ns.min(stamp),
            Asker::Settings(_) => stamp,
        };
        let asked = LoopRequest { token, request, stamp: Stamp(stamp), sent: Stamp(sent) };
        // The ring of answers has room for as many as requests: never more in flight than that.
        if self.at_loop.len() >= rings.answers.buffer().capacity() || rings.requests.push(asked).is_err() {
            return Err(asker);
        }
        self.next_token += 1;
        self.at_loop.push((token, Instant::now(), asker));
        Ok(())
    }

    fn loop_answered(&mut self, answer: &LoopAnswer, homeward: &Homeward) {
        let Some(slot) = self.at_loop.iter().position(|(token, ..)| *token == answer.token) else { return };
        let (_, _, asker) = self.at_loop.swap_remove(slot);
        match (asker, answer.outcome) {
            (Asker::Operator(call), Ok(())) => {
                // Motion takes time; everything else is done with the tick.
                let follows = [ControlOp::Disarm, ControlOp::Stop, ControlOp::MoveHome].map(u32::from);
                let status = if follows.contains(&call.request.op) && answer.mode != Mode::Idle {
                    ControlStatus::Accepted
                } else {
                    ControlStatus::Ok
                };
                self.answer(*call, status, answer.mode, answer.trust, "");
            }
            (Asker::Operator(call), Err(refusal)) => {
                let (status, text) = wire::refusal(refusal);
                let text = match refusal {
                    Refusal::WayBlocked(by) => homeward.obstructed(&by),
                    other => self.context.why(other, call.request.sent_ns).unwrap_or_else(|| text.to_owned()),
                };
                self.answer(*call, status, answer.mode, answer.trust, &text);
            }
            (Asker::Settings(request), Ok(())) => info!("live setting in force: {request:?}"),
            (Asker::Settings(request), Err(refusal)) => {
                warn!("live setting refused: {request:?}: {}", wire::refusal(refusal).1);
            }
        }
    }

    fn supervisor_answered(&mut self, mode: Mode, trust: Trust) {
        for (since, call, outcome) in std::mem::take(&mut self.at_supervisor) {
            match outcome.try_recv() {
                Ok(ReloadOutcome { status, text }) => self.answer(call, status, mode, trust, &text),
                Err(TryRecvError::Empty) if since.elapsed() < RELOAD_PATIENCE => {
                    self.at_supervisor.push((since, call, outcome));
                }
                Err(_) => self.answer(call, ControlStatus::Internal, mode, trust, "the reload got no answer"),
            }
        }
    }

    fn overdue(&mut self, mode: Mode, trust: Trust) {
        while let Some(slot) = self.at_loop.iter().position(|(_, since, _)| since.elapsed() > PATIENCE) {
            if let (_, _, Asker::Operator(call)) = self.at_loop.swap_remove(slot) {
                self.answer(*call, ControlStatus::Internal, mode, trust, "the loop did not answer in time");
            }
        }
    }

    fn answer(&mut self, call: Call, status: ControlStatus, mode: Mode, trust: Trust, text: &str) {
        self.answered += 1;
        let op = ControlOp::try_from(call.request.op).map_or("unknown", ControlOp::label);
        let refused = i32::from(status) < 0;
        if refused {
            self.refused += 1;
            info!("request {op}: {status}: {text}");
        } else if call.request.op != u32::from(ControlOp::Query) {
            info!("request {op}: {status}");
        }
        // An operator that is gone needs no answer.
        let _ = call.answer(status, trust.alpha(), wire::mode(mode).into(), text);
    }
}

#[cfg(test)]
mod tests {
    use foretrace_shm::StopCause;

    use super::*;

    #[test]
    fn refusals_are_explained_by_what_is_known_of_the_arm() {
        let note = NoteWords::new("speed scaling is at 50 %", "set the slider to 100 %");
        let detail = StopDetail {
            cause: StopCause::Height.into(),
            joint: -1,
            amount: -0.04,
            limit: -0.002,
            at_ns: 70,
        };
        let known = RefusalContext {
            note: Some(note),
            stop: Some((FaultReason::Envelope, detail)),
            ..RefusalContext::default()
        };
        let why = |refusal, sent_ns| known.why(refusal, sent_ns);
        assert_eq!(
            why(Refusal::MotionNotAllowed, 0).unwrap(),
            "speed scaling is at 50 %; set the slider to 100 %"
        );
        assert!(
            why(Refusal::StopCame, 60)
                .unwrap()
                .starts_with("the arm was stopped: tool envelope: the tool is -40")
        );
        // A stop from before the request is not why, nor is there more to say of one that was requested.
        assert_eq!(why(Refusal::StopCame, 71), None);
        let asked = RefusalContext { stop: Some((FaultReason::Requested, detail)), ..known };
        assert_eq!(asked.why(Refusal::StopCame, 60), None);
        assert_eq!(why(Refusal::ArmMoves, 0), None);
        assert_eq!(RefusalContext::default().why(Refusal::MotionNotAllowed, 0), None);
    }
}
