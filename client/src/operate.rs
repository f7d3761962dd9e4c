//! For the operator: `Requests` and `DeadMan`.

use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use foretrace_shm::{
    AskError, Claimant, ControlOp, ControlRequest, ControlResponse, ControlStatus, ControlTopic, Enable,
    Holder, Place, PredictorName, PublishError, Rejection, ServiceError, Validate, monotonic_now_ns,
};

use crate::Foretrace;
use crate::attach::Leaving;
use crate::seat::Seat;

/// Why a request did not succeed.
#[derive(Clone, PartialEq, thiserror::Error)]
pub enum RequestError {
    /// The request itself is invalid and was not sent.
    #[error("{0}")]
    Invalid(#[from] Rejection),
    /// No usable answer.
    #[error("{0}")]
    NoAnswer(#[from] AskError),
    /// No operator slot became free in time, or the middleware refuses one.
    #[error("{0}")]
    NotConnected(String),
    /// The daemon refused, for this reason.
    #[error("the daemon refused: {status}{}{message}", if message.is_empty() { "" } else { ": " })]
    Refused {
        /// The kind of refusal.
        status: ControlStatus,
        /// The daemon's reason and remedy, as text.
        message: String,
        /// A number that belongs to it, such as the joint.
        detail: u32,
        /// The offending value, if there is one.
        value: f64,
    },
}

/// Pause before a free slot is looked for again.
const POLL: Duration = Duration::from_millis(5);

/// Sends requests and waits for their answers. Holds one of the four operator slots only while it asks,
/// so that idle or frozen programs do not block others.
#[derive(Debug)]
pub struct Requests {
    topic: ControlTopic,
    /// 0: the moment of sending \[ns\].
    decided_ns: u64,
    _leaving: Arc<Leaving>,
}

/// The dead-man switch. Beat at least every [`DeadMan::INTERVAL`]; silence stops the arm. Gives way to
/// whoever asks for the switch, which stops the arm as well.
#[derive(Debug)]
pub struct DeadMan(Seat<Enable>);

/// Why the dead-man signal was not sent.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DeadManError {
    /// It could not be delivered.
    #[error("the dead-man signal was not sent: {0}")]
    NotSent(#[from] PublishError),
    /// Somebody asked for the switch and has it; [`DeadMan::handed_to`] says who.
    #[error("the dead-man switch was handed to a program that asked for it (--take-over): end this one")]
    HandedOver,
}

impl Foretrace {
    /// The requests, to be used in any thread.
    #[must_use]
    pub fn requests(&self) -> Requests {
        Requests { topic: self.services.control.clone(), decided_ns: 0, _leaving: self.leaving.clone() }
    }

    /// The dead-man, to be used in this thread. One per instance at a time. Held in the name of this program.
    ///
    /// # Errors
    ///
    /// `Place` when another one beats already: it names that one.
    pub fn dead_man(&self) -> Result<DeadMan, ServiceError> {
        self.dead_man_as(&Claimant::this_program())
    }

    /// The dead-man, held in the name of `who`.
    ///
    /// # Errors
    ///
    /// As [`Foretrace::dead_man`].
    pub fn dead_man_as(&self, who: &Claimant) -> Result<DeadMan, ServiceError> {
        let claim = self.instance().claim(Place::DeadMan, who)?;
        Seat::take(claim, &self.services.enable, self.leaving.clone()).map(DeadMan)
    }

    /// The dead-man, for which the program that holds it is asked; waits for that up to `patience`. An arm
    /// that was enabled stops.
    ///
    /// # Errors
    ///
    /// `Place` when it does not give way; a browser never gets it from anything but a browser.
    pub fn take_dead_man(&self, who: &Claimant, patience: Duration) -> Result<DeadMan, ServiceError> {
        let claim = self.instance().take_over(Place::DeadMan, who, patience)?;
        Seat::take(claim, &self.services.enable, self.leaving.clone()).map(DeadMan)
    }
}

/// All requests wait up to `timeout`, also where shared memory is so damaged that calls into it hang, and
/// fail with a [`RequestError`].
impl Requests {
    /// Sets when the operator decided what is asked from here on \[ns, monotonic clock\]: the
    /// daemon refuses to arm if a stop came since then. Of everything but `stop`, `disarm` and `query` a
    /// moment more than [`foretrace_shm::ORDER_AHEAD_NS`] ahead is refused.
    #[must_use]
    pub const fn decided_at(mut self, decided_ns: u64) -> Self {
        self.decided_ns = decided_ns;
        self
    }

    /// Ask for mode (`detail`) and trust (`value`).
    pub fn query(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Query, 0.0, timeout)
    }

    /// Begin from the measured joints.
    pub fn arm(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Arm, 0.0, timeout)
    }

    /// Move the arm home, slowly and straight in joint space; the answer comes when the path has been
    /// checked.
    pub fn move_home(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::MoveHome, 0.0, timeout)
    }

    /// Stop smoothly and go idle.
    pub fn disarm(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Disarm, 0.0, timeout)
    }

    /// Stop smoothly and latch. Prefer [`crate::stop`]: it needs no middleware and works where this way is
    /// closed.
    pub fn stop(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Stop, 0.0, timeout)
    }

    /// Set trust by hand: 1 prediction only, 0 hold only.
    pub fn set_trust(&mut self, trust: f64, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::SetTrust, trust, timeout)
    }

    /// Keep the trust as it is.
    pub fn freeze_trust(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::FreezeTrust, 0.0, timeout)
    }

    /// Trust from evidence again.
    pub fn trust_auto(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::TrustAuto, 0.0, timeout)
    }

    /// Predict with another predictor, by its name in the settings; the daemon decides which exist.
    pub fn switch_predictor(
        &mut self,
        name: &str,
        timeout: Duration,
    ) -> Result<ControlResponse, RequestError> {
        // A malformed name is refused before it is sent.
        let predictor = PredictorName::new(name).unwrap_or(PredictorName::NONE);
        self.ask_with(ControlOp::SwitchPredictor, predictor, 0.0, timeout)
    }

    /// Read the settings file again.
    pub fn reload(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Reload, 0.0, timeout)
    }

    fn ask(&mut self, op: ControlOp, value: f64, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask_with(op, PredictorName::NONE, value, timeout)
    }

    fn ask_with(
        &mut self,
        op: ControlOp,
        predictor: PredictorName,
        value: f64,
        timeout: Duration,
    ) -> Result<ControlResponse, RequestError> {
        let sent_ns = self.decided_ns;
        let request = ControlRequest { predictor, value, sent_ns, ..ControlRequest::new(0, 0, op) };
        request.validate()?;
        request.check_date(monotonic_now_ns())?;
        let response = bounded(&self.topic, request, timeout)?;
        if response.is_success() {
            return Ok(response);
        }
        Err(RequestError::Refused {
            status: response.outcome(),
            message: response.text(),
            detail: response.detail,
            value: response.value,
        })
    }
}

/// Asks in a thread that is abandoned after `timeout`.
fn bounded(
    topic: &ControlTopic,
    request: ControlRequest,
    timeout: Duration,
) -> Result<ControlResponse, RequestError> {
    let (answer, answered) = mpsc::channel();
    let topic = topic.clone();
    // The thread's own timeout is shorter, because it knows what it waits for.
    let deadline = Instant::now() + timeout - (timeout / 10).min(Duration::from_millis(20));
    let asking = move || {
        let client = loop {
            match topic.client() {
                Err(ServiceError::NoOperatorSlot { .. }) if Instant::now() < deadline => {
                    std::thread::sleep(POLL);
                }
                client => break client,
            }
        };
        let left = deadline.saturating_duration_since(Instant::now());
        let asked = client
            .map_err(|error| RequestError::NotConnected(error.to_string()))
            .and_then(|mut client| Ok(client.ask(request, left)?));
        // The receiver may be gone.
        let _ = answer.send(asked);
    };
    std::thread::Builder::new()
        .name("foretrace-asks".to_owned())
        .spawn(asking)
        .map_err(|error| RequestError::NotConnected(format!("starting a thread: {error}")))?;
    match answered.recv_timeout(timeout) {
        Ok(Err(RequestError::NoAnswer(AskError::Timeout(_)))) | Err(_) => {
            Err(AskError::Timeout(timeout).into())
        }
        Ok(asked) => asked,
    }
}

impl RequestError {
    /// The daemon's reason, where it refused.
    pub fn refusal(&self) -> Option<ControlStatus> {
        match self {
            Self::Refused { status, .. } => Some(*status),
            _ => None,
        }
    }
}

impl DeadMan {
    /// 50 times per second.
    pub const INTERVAL: Duration = Duration::from_millis(20);

    /// Sends "go on".
    ///
    /// # Errors
    ///
    /// [`DeadManError`].
    pub fn beat(&mut self) -> Result<(), DeadManError> {
        self.send(0)
    }

    /// Sends "stop".
    ///
    /// # Errors
    ///
    /// [`DeadManError`]; falling silent stops too.
    pub fn stop(&mut self) -> Result<(), DeadManError> {
        self.send(1)
    }

    /// Gives way to whoever asks, and returns who has the switch since then. Every signal sent does the same:
    /// call it while nothing is sent.
    pub fn handed_to(&mut self) -> Option<&Holder> {
        self.give_way_if_asked(monotonic_now_ns());
        self.0.handed_to()
    }

    fn give_way_if_asked(&mut self, now_ns: u64) {
        if let Some(asker) = self.0.asked(now_ns) {
            if let Some(publisher) = self.0.publisher().filter(|publisher| publisher.sequence() > 0) {
                // Silence stops as well; the message goes with its publisher, so the daemon gets time to
                // read.
                let _ = publisher.publish(now_ns, Enable { stop: 1, ..Default::default() });
                std::thread::sleep(Self::INTERVAL);
            }
            self.0.hand_to(asker);
        }
    }

    fn send(&mut self, stop: u32) -> Result<(), DeadManError> {
        let now_ns = monotonic_now_ns();
        self.give_way_if_asked(now_ns);
        let publisher = self.0.publisher().ok_or(DeadManError::HandedOver)?;
        publisher.publish(now_ns, Enable { stop, ..Default::default() })?;
        Ok(())
    }
}
