//! The operator's end: `Requests` and `DeadMan`.

use std::time::Duration;

use foretrace_shm::{
    AskError, ControlClient, ControlOp, ControlRequest, ControlResponse, ControlStatus, Enable, PredictorId,
    PublishError, Publisher, Rejection, ServiceError, Validate, monotonic_now_ns,
};

use crate::Foretrace;

/// Why a request did not succeed.
#[derive(Clone, PartialEq, thiserror::Error)]
pub enum RequestError {
    /// The request itself makes no sense and was not sent.
    #[error("{0}")]
    Invalid(#[from] Rejection),
    /// No usable answer.
    #[error("{0}")]
    NoAnswer(#[from] AskError),
    /// The daemon refused, for this reason.
    #[error("the daemon refused: {status}{}{message}", if message.is_empty() { "" } else { ": " })]
    Refused {
        /// The kind of refusal.
        status: ControlStatus,
        /// The daemon's reason.
        message: String,
        /// A number that belongs to it, such as the joint.
        detail: u32,
        /// The offending value, if there is one.
        value: f64,
    },
}

/// Sends requests and waits for their answers.
#[derive(Debug)]
pub struct Requests {
    client: ControlClient,
}

/// The dead-man. Beat at least every [`DeadMan::INTERVAL`]; silence stops the arm.
#[derive(Debug)]
pub struct DeadMan {
    publisher: Publisher<Enable>,
}

impl Foretrace {
    /// The requests, to be used in this thread.
    ///
    /// *Errors*: `NoPlace` when four others operate already.
    pub fn requests(&self) -> Result<Requests, ServiceError> {
        Ok(Requests { client: self.services.control.client()? })
    }

    /// The dead-man, to be used in this thread. One per instance at a time.
    ///
    /// *Errors*: `NoPlace` when another one beats already.
    pub fn dead_man(&self) -> Result<DeadMan, ServiceError> {
        Ok(DeadMan { publisher: self.services.enable.publisher()? })
    }
}

/// All requests wait up to `timeout` and fail as [`RequestError`] tells.
impl Requests {
    /// Ask for mode (`detail`) and trust (`value`).
    pub fn query(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Query, 0, 0.0, timeout)
    }

    /// Begin from the measured joints.
    pub fn arm(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Arm, 0, 0.0, timeout)
    }

    /// Stop smoothly and go idle.
    pub fn disarm(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Disarm, 0, 0.0, timeout)
    }

    /// Stop smoothly and latch.
    pub fn stop(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Stop, 0, 0.0, timeout)
    }

    /// Set trust by hand: 1 prediction only, 0 hold only.
    pub fn set_trust(&mut self, trust: f64, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::SetTrust, 0, trust, timeout)
    }

    /// Keep the trust as it is.
    pub fn freeze_trust(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::FreezeTrust, 0, 0.0, timeout)
    }

    /// Trust from evidence again.
    pub fn trust_auto(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::TrustAuto, 0, 0.0, timeout)
    }

    /// Predict with another predictor.
    pub fn switch_predictor(
        &mut self,
        predictor: PredictorId,
        timeout: Duration,
    ) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::SwitchPredictor, predictor.into(), 0.0, timeout)
    }

    /// Read the settings file again.
    pub fn reload(&mut self, timeout: Duration) -> Result<ControlResponse, RequestError> {
        self.ask(ControlOp::Reload, 0, 0.0, timeout)
    }

    fn ask(
        &mut self,
        op: ControlOp,
        param: u32,
        value: f64,
        timeout: Duration,
    ) -> Result<ControlResponse, RequestError> {
        let request = ControlRequest { param, value, ..ControlRequest::new(0, 0, op) };
        request.validate()?;
        let response = self.client.ask(request, timeout)?;
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

    /// Say "go on".
    ///
    /// *Errors*: [`PublishError`].
    pub fn beat(&mut self) -> Result<(), PublishError> {
        self.send(0)
    }

    /// Say "stop".
    ///
    /// *Errors*: [`PublishError`]; falling silent stops too.
    pub fn stop(&mut self) -> Result<(), PublishError> {
        self.send(1)
    }

    fn send(&mut self, stop: u32) -> Result<(), PublishError> {
        self.publisher.publish(monotonic_now_ns(), Enable { stop, ..Default::default() }).map(|_| ())
    }
}
