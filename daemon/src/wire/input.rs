//! A tick's input on the wire and back, so that a tick can be run again.
//!
//! Contract: value by value, bit by bit, in both directions; what comes back is what the law was given. The
//! way back trusts nothing: an unknown word is an error with its field.

use foretrace_control::contact::EffortReading;
use foretrace_control::follower::{Budget, EnableReading, JointReading, Request, StepInput, StepOutput};
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::{ExternalPreview, OnlineWeights, PredictorKind};
use foretrace_control::stop::{StopCause, StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretrace_shm as shm;
use foretrace_shm::{ControlOp, PEN_PER_PART, input_flags};

use super::{JOINTS, effort_of, effort_unit, fault, flag, health, mode, predictor, rung, stop_detail};

/// What a tick was given, besides pen samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Given {
    pub now: Stamp,
    pub budget: Budget,
    /// Newest joint state, if one arrived.
    pub joints: Option<JointReading<JOINTS>>,
    /// Its efforts, if the arm reports any.
    pub effort: Option<EffortReading<JOINTS>>,
    /// Newest dead-man message, if one arrived.
    pub enable: Option<EnableReading>,
    /// The request, if there was one.
    pub request: Option<Request>,
    /// The stop that the shell demanded, if any.
    pub halt: Option<(StopReason, StopDetail)>,
    /// Version of the weights offered, if there were any.
    pub weights: Option<u64>,
    /// A preview of another process came.
    pub preview: bool,
    /// The command of the tick before was not sent.
    pub unsent: bool,
    /// Pen samples that arrived.
    pub pen_samples: u32,
    /// All of them are known.
    pub complete: bool,
}

impl Given {
    /// What is recorded of `input`.
    #[must_use]
    pub fn of(input: &StepInput<'_, JOINTS>, budget: Budget) -> Self {
        Self {
            now: input.now,
            budget,
            joints: input.joints.copied(),
            effort: input.effort.copied(),
            enable: input.enable,
            request: input.request,
            halt: input.halt,
            weights: input.weights.map(|weights| weights.version),
            preview: input.preview.is_some(),
            unsent: input.unsent,
            pen_samples: input.pen.len() as u32,
            complete: true,
        }
    }

    /// The law's input with these pen samples, weights, and preview of another process.
    #[must_use]
    pub fn step_input<'a>(
        &'a self,
        pen: &'a [PenReading],
        weights: Option<&'a OnlineWeights>,
        preview: Option<&'a ExternalPreview>,
    ) -> StepInput<'a, JOINTS> {
        StepInput {
            now: self.now,
            pen,
            joints: self.joints.as_ref(),
            effort: self.effort.as_ref(),
            enable: self.enable,
            request: self.request,
            halt: self.halt,
            weights,
            preview,
            unsent: self.unsent,
        }
    }
}

/// The first part of a tick's record, without pen samples: fill in those with [`pen_part`].
#[must_use]
pub fn tick_input(tick: u64, daemon_id: u64, given: &Given, output: &StepOutput<JOINTS>) -> shm::TickInput {
    let Given {
        now,
        budget,
        joints,
        effort,
        enable,
        request,
        halt,
        weights,
        preview,
        unsent,
        pen_samples,
        complete,
    } = *given;
    let flags = flag(joints.is_some(), input_flags::JOINTS)
        | flag(joints.is_some_and(|joints| joints.motion_allowed), input_flags::MOTION_ALLOWED)
        | flag(enable.is_some(), input_flags::ENABLE)
        | flag(enable.is_some_and(|enable| enable.stop), input_flags::ENABLE_STOP)
        | flag(request.is_some(), input_flags::REQUEST)
        | flag(halt.is_some(), input_flags::HALT)
        | flag(weights.is_some(), input_flags::WEIGHTS)
        | flag(preview, input_flags::PREVIEW)
        | flag(budget.shed, input_flags::SHED)
        | flag(output.command.is_some_and(|command| command.enabled), input_flags::ENABLED)
        | flag(unsent, input_flags::UNSENT)
        | flag(!complete, input_flags::INCOMPLETE);
    let (op, request_value, kind) = request.map_or((ControlOp::Query, 0.0, None), words);
    let (reason, detail) = halt.unwrap_or((StopReason::None, StopDetail::default()));
    shm::TickInput {
        daemon_id,
        tick,
        now_ns: now.0,
        part: 0,
        parts: shm::TickInput::parts_for(pen_samples as usize) as u32,
        pen_samples,
        flags,
        budget_iterations: budget.max_iterations,
        request: op.into(),
        request_value,
        request_predictor: kind.map_or(shm::PredictorName::NONE, predictor),
        halt: fault(reason).into(),
        halt_detail: stop_detail(&detail),
        joints_ns: joints.map_or(0, |joints| joints.stamp.0),
        joints_q: joints.map_or([0.0; JOINTS], |joints| joints.q),
        joints_qd: joints.map_or([0.0; JOINTS], |joints| joints.qd),
        joints_effort: effort.map_or([0.0; JOINTS], |effort| effort.effort),
        effort_unit: effort.map_or(shm::EffortUnit::None, |effort| effort_unit(effort.unit)).into(),
        enable_ns: enable.map_or(0, |enable| enable.stamp.0),
        weights_version: weights.unwrap_or(0),
        command_ns: output.command.map_or(0, |command| command.stamp.0),
        valid_until_ns: output.command.map_or(0, |command| command.valid_until.0),
        q: output.command.map_or([0.0; JOINTS], |command| command.q),
        qd: output.command.map_or([0.0; JOINTS], |command| command.qd),
        trust: output.trust.alpha.alpha(),
        weights_used: output.weights_version,
        mode: mode(output.mode).into(),
        rung: rung(output.rung).into(),
        fault: fault(output.stop_reason).into(),
        health: health(output.health),
        ..Default::default()
    }
}

/// Fills in part `part` of the tick's pen samples; `pen` are those of this part.
pub fn pen_part(input: &mut shm::TickInput, part: usize, pen: &[PenReading]) {
    input.part = part as u32;
    input.pen = [shm::PenInput::default(); PEN_PER_PART];
    for (slot, reading) in input.pen.iter_mut().zip(pen) {
        let PenReading { stamp, position: [x_m, y_m], contact, origin } = *reading;
        let PenOrigin { sequence, sent, received } = origin;
        *slot = shm::PenInput {
            stamp_ns: stamp.0,
            x_m,
            y_m,
            sequence,
            sent_ns: sent.0,
            received_ns: received.0,
            contact: contact.into(),
            reserved: 0,
        };
    }
}

/// A pen sample as the law saw it.
#[must_use]
pub fn pen_of(input: &shm::PenInput) -> PenReading {
    PenReading {
        stamp: Stamp(input.stamp_ns),
        position: [input.x_m, input.y_m],
        contact: input.contact != 0,
        origin: PenOrigin {
            sequence: input.sequence,
            sent: Stamp(input.sent_ns),
            received: Stamp(input.received_ns),
        },
    }
}

/// What the tick was given.
///
/// # Errors
///
/// The field that has no meaning here.
pub fn given(input: &shm::TickInput) -> Result<Given, &'static str> {
    let has = |bit: u32| input.flags & bit != 0;
    let request = if has(input_flags::REQUEST) { Some(request(input)?) } else { None };
    let halt = if has(input_flags::HALT) { Some(halt(input)?) } else { None };
    Ok(Given {
        now: Stamp(input.now_ns),
        budget: Budget { max_iterations: input.budget_iterations, shed: has(input_flags::SHED) },
        joints: has(input_flags::JOINTS).then_some(JointReading {
            stamp: Stamp(input.joints_ns),
            q: input.joints_q,
            qd: input.joints_qd,
            motion_allowed: has(input_flags::MOTION_ALLOWED),
        }),
        effort: effort_of(input.joints_ns, &input.joints_effort, input.effort_unit)
            .filter(|_| has(input_flags::JOINTS)),
        enable: has(input_flags::ENABLE)
            .then_some(EnableReading { stamp: Stamp(input.enable_ns), stop: has(input_flags::ENABLE_STOP) }),
        request,
        halt,
        weights: has(input_flags::WEIGHTS).then_some(input.weights_version),
        preview: has(input_flags::PREVIEW),
        unsent: has(input_flags::UNSENT),
        pen_samples: input.pen_samples,
        complete: !has(input_flags::INCOMPLETE),
    })
}

fn words(request: Request) -> (ControlOp, f64, Option<PredictorKind>) {
    match request {
        Request::Arm => (ControlOp::Arm, 0.0, None),
        Request::MoveHome => (ControlOp::MoveHome, 0.0, None),
        Request::Disarm => (ControlOp::Disarm, 0.0, None),
        Request::Stop => (ControlOp::Stop, 0.0, None),
        Request::SetTrust(trust) => (ControlOp::SetTrust, trust, None),
        Request::FreezeTrust => (ControlOp::FreezeTrust, 0.0, None),
        Request::TrustAuto => (ControlOp::TrustAuto, 0.0, None),
        Request::SwitchPredictor(kind) => (ControlOp::SwitchPredictor, 0.0, Some(kind)),
    }
}

fn request(input: &shm::TickInput) -> Result<Request, &'static str> {
    Ok(match ControlOp::try_from(input.request).map_err(|_| "request")? {
        ControlOp::Arm => Request::Arm,
        ControlOp::MoveHome => Request::MoveHome,
        ControlOp::Disarm => Request::Disarm,
        ControlOp::Stop => Request::Stop,
        ControlOp::SetTrust => Request::SetTrust(input.request_value),
        ControlOp::FreezeTrust => Request::FreezeTrust,
        ControlOp::TrustAuto => Request::TrustAuto,
        ControlOp::SwitchPredictor => {
            // A recording may be of a version that called it otherwise.
            let current =
                |name: &str| PredictorKind::from_name(PredictorKind::current_name(name).unwrap_or(name));
            let kind = input.request_predictor.as_str().and_then(current);
            Request::SwitchPredictor(kind.ok_or("request_predictor")?)
        }
        ControlOp::Query | ControlOp::Reload => return Err("request"),
    })
}

/// The shell demands a stop for an operator, or because of late ticks.
fn halt(input: &shm::TickInput) -> Result<(StopReason, StopDetail), &'static str> {
    let reason = match shm::FaultReason::try_from(input.halt) {
        Ok(shm::FaultReason::Requested) => StopReason::Requested,
        Ok(shm::FaultReason::Overruns) => StopReason::Overruns,
        _ => return Err("halt"),
    };
    let detail = &input.halt_detail;
    let cause = match shm::StopCause::try_from(detail.cause) {
        Ok(shm::StopCause::None) => StopCause::None,
        Ok(shm::StopCause::LateTicks) => StopCause::LateTicks,
        _ => return Err("halt_detail.cause"),
    };
    let joint = u8::try_from(detail.joint).ok();
    let at = Stamp(detail.at_ns);
    Ok((reason, StopDetail { cause, joint, amount: detail.amount, limit: detail.limit, at }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_control::follower::NoClock;
    use foretrace_shm::Validate;

    fn some_output() -> StepOutput<JOINTS> {
        let config = foretrace_config::Config::preset("ur5").unwrap();
        let mut follower =
            foretrace_control::follower::Follower::<30, JOINTS>::new(config.follower_settings()).unwrap();
        follower.step(&StepInput::nothing(Stamp(5)), Budget::default(), &mut NoClock)
    }

    #[test]
    fn every_input_comes_back_as_it_was() {
        let output = some_output();
        let budget = Budget { max_iterations: 12, shed: false };
        let nothing = Given::of(&StepInput::nothing(Stamp(77)), budget);
        let joints =
            JointReading { stamp: Stamp(3), q: [f64::MIN_POSITIVE; 6], qd: [-0.0; 6], motion_allowed: true };
        let unit = foretrace_control::contact::EffortUnit::Amperes;
        let effort = EffortReading { stamp: Stamp(3), effort: [-2.5; 6], unit };
        let late =
            StopDetail { cause: StopCause::LateTicks, amount: 0.3, limit: 0.1, ..StopDetail::default() };
        let mut cases = vec![
            nothing,
            Given { budget: Budget { shed: true, ..nothing.budget }, complete: false, ..nothing },
            Given { joints: Some(joints), ..nothing },
            Given { joints: Some(JointReading { motion_allowed: false, ..joints }), ..nothing },
            Given { joints: Some(joints), effort: Some(effort), ..nothing },
            Given { enable: Some(EnableReading { stamp: Stamp(9), stop: true }), ..nothing },
            Given { halt: Some((StopReason::Requested, StopDetail::default())), ..nothing },
            Given { halt: Some((StopReason::Overruns, late)), ..nothing },
            Given { weights: Some(0), ..nothing },
            Given { unsent: true, ..nothing },
        ];
        let requests = [
            Request::Arm,
            Request::MoveHome,
            Request::Disarm,
            Request::Stop,
            Request::SetTrust(0.1),
            Request::FreezeTrust,
            Request::TrustAuto,
        ];
        let kinds = PredictorKind::ALL.map(Request::SwitchPredictor);
        for request in requests.iter().chain(&kinds) {
            cases.push(Given { request: Some(*request), ..nothing });
        }
        for case in cases {
            let sent = tick_input(4, 1, &case, &output);
            assert_eq!(sent.validate(), Ok(()));
            assert_eq!(given(&sent), Ok(case));
        }
    }

    #[test]
    fn pen_samples_of_a_burst_come_back_in_order() {
        let reading = |i: usize| PenReading {
            stamp: Stamp(i as u64),
            position: [i as f64, -0.0],
            contact: i.is_multiple_of(2),
            origin: PenOrigin { sequence: i as u64, sent: Stamp(1), received: Stamp(2) },
        };
        for count in [0, 1, PEN_PER_PART, PEN_PER_PART + 1, 64] {
            let pen: Vec<_> = (0..count).map(reading).collect();
            let nothing = given(&shm::TickInput::default()).unwrap();
            let mut input = tick_input(1, 1, &Given { pen_samples: count as u32, ..nothing }, &some_output());
            let parts = input.parts as usize;
            let mut back = Vec::new();
            for part in 0..parts {
                let these = pen.chunks(PEN_PER_PART).nth(part).unwrap_or_default();
                pen_part(&mut input, part, these);
                back.extend(input.pen().iter().map(pen_of));
            }
            assert_eq!(back, pen);
        }
    }

    #[test]
    fn words_without_a_meaning_are_named() {
        let request = shm::TickInput { flags: input_flags::REQUEST, ..Default::default() };
        assert_eq!(given(&request), Err("request"));
        let unknown = shm::TickInput { request: ControlOp::SwitchPredictor.into(), ..request };
        assert_eq!(given(&unknown), Err("request_predictor"));
        let halt = shm::TickInput { flags: input_flags::HALT, halt: 1, ..Default::default() };
        assert_eq!(given(&halt), Err("halt"));
    }
}
