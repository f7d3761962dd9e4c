//! The functions of `foretrace.h`, which documents them.
//!
//! Contract: each checks its arguments, does one thing with one handle, and returns 0 or an error code, whose
//! text `foretrace_last_error` gives.
//!
//! # Safety
//! Of every function that takes pointers: each is null or leads to what `foretrace.h` says.

use std::ffi::c_char;
use std::time::Duration;

use foretrace_client::wire::{ControlOp, ControlResponse, RejectReason, Status, TickRecord};
use foretrace_client::{Attachment, Commands, DeadMan, JointStates};
use foretrace_client::{
    Claimant, Demand, Foretrace, GatewayFeed, HolderKind, Instance, JOINTS, JointCommand, JointState,
    PenFeed, PenSample, ServiceError, StatusReader, demand_at, host_boot_id, monotonic_now_ns,
};
use foretrace_shm::C_LAYOUT_HASH;

use crate::code::{CallFailure, ErrorCode, newest, run};
use crate::handles::{Opened, TickBacklog, close, keep, take, with};
use crate::pointers::{Out, give, offer, put_text, read, room, text};

fn bad(text: impl Into<String>) -> CallFailure {
    CallFailure::new(ErrorCode::BadArgument, text)
}

/// Opens something and gives its handle to the caller.
pub(crate) fn opened<T: Opened>(
    mut out: Out<'_, u64>,
    open: impl FnOnce() -> Result<T, CallFailure>,
) -> Result<(), CallFailure> {
    // Also where opening fails: no old number stays there.
    give("handle", &mut out, 0)?;
    give("handle", &mut out, keep(open()?)?)
}

/// Opens one of the places that an instance has once, in a name of the caller's or the program's own; its
/// holder is asked for it where `take_over_ns` is not 0.
///
/// # Safety
/// As [`text`], for `name`.
unsafe fn opened_place<T: Opened>(
    attachment: u64,
    name: *const c_char,
    take_over_ns: u64,
    out: Out<'_, u64>,
    free: impl FnOnce(&Foretrace, &Claimant) -> Result<T, ServiceError>,
    take_over: impl FnOnce(&Foretrace, &Claimant, Duration) -> Result<T, ServiceError>,
) -> Result<(), CallFailure> {
    // SAFETY: the caller's.
    let name = unsafe { text("name", name) }?;
    let who = name.map_or_else(Claimant::this_program, |name| Claimant::new(HolderKind::Program, &name));
    let open = |foretrace: &mut Foretrace| {
        Ok(match take_over_ns {
            0 => free(foretrace, &who)?,
            _ => take_over(foretrace, &who, Duration::from_nanos(take_over_ns))?,
        })
    };
    opened(out, || with(attachment, open))
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_last_error() -> *const c_char {
    newest()
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_now_ns() -> u64 {
    monotonic_now_ns()
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_attach_as(
    layout_hash: u64,
    instance: u32,
    wait_ns: u64,
    out: Out<'_, u64>,
) -> i32 {
    run(|| {
        let open = || {
            if layout_hash != C_LAYOUT_HASH {
                let text = format!(
                    "this program was built with messages of layout {layout_hash:016x}, libforetrace {} has \
                     {C_LAYOUT_HASH:016x}: build it again with the library's own header",
                    env!("CARGO_PKG_VERSION")
                );
                return Err(CallFailure::new(ErrorCode::OtherLayout, text));
            }
            let instance = Instance::new(instance)
                .map_err(|error| CallFailure::new(ErrorCode::Instance, error.to_string()))?;
            Ok(Foretrace::attach_within(&instance, Duration::from_nanos(wait_ns))?)
        };
        opened(out, open)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_close(handle: u64) -> i32 {
    run(|| close(handle))
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_daemon_is_up(attachment: u64, mut out: Out<'_, bool>) -> i32 {
    run(|| {
        let up = with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.daemon_is_up()))?;
        give("is up", &mut out, up)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_renew(attachment: u64, mut out: Out<'_, u32>) -> i32 {
    run(|| {
        let change = with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.reattach_if_needed()?))?;
        let number = match change {
            Attachment::Unchanged => 0,
            Attachment::TakenOver => 1,
            Attachment::Renewed => 2,
        };
        give("change", &mut out, number)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_pen(
    attachment: u64,
    name: *const c_char,
    take_over_ns: u64,
    out: Out<'_, u64>,
) -> i32 {
    run(|| {
        let (free, take_over) = (Foretrace::pen_feed_as, Foretrace::take_pen_feed);
        // SAFETY: the caller's.
        unsafe { opened_place(attachment, name, take_over_ns, out, free, take_over) }
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_pen_send(
    pen: u64,
    sample: *const PenSample,
    size: usize,
    mut heard: Out<'_, bool>,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let sample = unsafe { read("sample", sample, size) }?;
        let connected = with(pen, |pen: &mut PenFeed| Ok(pen.send_sample(sample)?))?;
        offer(&mut heard, connected);
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_pen_handed_to(pen: u64, buffer: *mut c_char, room: usize) -> i32 {
    run(|| {
        let holder = with(pen, |pen: &mut PenFeed| Ok(pen.handed_to().map(ToString::to_string)))?;
        // SAFETY: the caller's.
        unsafe { put_text(buffer, room, &holder.unwrap_or_default()) };
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_gateway(path: *const c_char, out: Out<'_, u64>) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let path = unsafe { text("path", path) }?;
        let open = || Ok(GatewayFeed::connect(path.ok_or_else(|| bad("path is a null pointer"))?)?);
        opened(out, open)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_gateway_send(gateway: u64, sample: *const PenSample, size: usize) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let sample = unsafe { read("sample", sample, size) }?;
        with(gateway, |gateway: &mut GatewayFeed| Ok(gateway.send_sample(sample)?))
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_gateway_finish(gateway: u64, buffer: *mut c_char, room: usize) -> i32 {
    run(|| {
        let line = take::<GatewayFeed>(gateway)?.finish()?;
        // SAFETY: the caller's.
        unsafe { put_text(buffer, room, &line) };
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_commands(attachment: u64, buffer: u32, out: Out<'_, u64>) -> i32 {
    run(|| {
        let open = || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.commands(buffer as usize)?));
        opened(out, open)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_commands_latest(
    commands: u64,
    command: *mut JointCommand,
    size: usize,
    mut there: Out<'_, bool>,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let place = unsafe { room("command", command, size) }?;
        let newest = with(commands, |commands: &mut Commands| Ok(commands.latest().copied()))?;
        place.put(newest.unwrap_or_default());
        offer(&mut there, newest.is_some());
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_commands_echo(commands: u64, state: *mut JointState, size: usize) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let place = unsafe { room("state", state, size) }?;
        place.put(with(commands, |commands: &mut Commands| Ok(commands.echo()))?);
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_demand_at(
    command: *const JointCommand,
    size: usize,
    now_ns: u64,
    mut q: Out<'_, [f64; JOINTS]>,
    mut qd: Out<'_, [f64; JOINTS]>,
    mut follow: Out<'_, bool>,
) -> i32 {
    run(|| {
        give("follow", &mut follow, false)?;
        // SAFETY: the caller's.
        let command = unsafe { read("command", command, size) }?;
        let enabled = command.flags & foretrace_client::wire::command_flags::ENABLED != 0;
        if enabled && command.header.boot_id != host_boot_id() {
            let text = "the command is of before this machine's last start, or of another machine";
            return Err(CallFailure::new(ErrorCode::OtherBoot, text));
        }
        let Demand::Follow { q: to, qd: at } = demand_at(&command, now_ns) else { return Ok(()) };
        if !to.iter().chain(&at).all(|number| number.is_finite()) {
            let text = format!("the command is invalid: {}", RejectReason::NotFinite);
            return Err(CallFailure::new(ErrorCode::Invalid, text));
        }
        give("q", &mut q, to)?;
        give("qd", &mut qd, at)?;
        give("follow", &mut follow, true)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_joint_states(attachment: u64, out: Out<'_, u64>) -> i32 {
    run(|| {
        let open = || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.joint_states()?));
        opened(out, open)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_joint_states_publish(
    states: u64,
    measured_ns: u64,
    state: *const JointState,
    size: usize,
    mut heard: Out<'_, bool>,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let state = unsafe { read("state", state, size) }?;
        let connected = with(states, |states: &mut JointStates| Ok(states.publish(measured_ns, state)?))?;
        offer(&mut heard, connected);
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_joint_states_note(
    states: u64,
    why: *const c_char,
    to_do: *const c_char,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let why = unsafe { text("why", why) }?;
        // SAFETY: the caller's.
        let to_do = unsafe { text("to_do", to_do) }?.unwrap_or_default();
        with(states, |states: &mut JointStates| {
            match &why {
                Some(why) => states.say(why, &to_do),
                None => states.say_nothing(),
            }
            Ok(())
        })
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_telemetry(attachment: u64, out: Out<'_, u64>) -> i32 {
    run(|| {
        let open =
            || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.telemetry()?)).map(TickBacklog::new);
        opened(out, open)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_telemetry_read(
    telemetry: u64,
    records: *mut TickRecord,
    size: usize,
    most: usize,
    mut count: Out<'_, usize>,
) -> i32 {
    run(|| {
        give("count", &mut count, 0)?;
        let read = with(telemetry, |telemetry: &mut TickBacklog| {
            telemetry.collect();
            let mut read = 0;
            while read < most {
                // SAFETY: the caller's: `most` records have room, and read < most.
                let place = unsafe { room("records", records.wrapping_add(read), size) }?;
                let Some(record) = telemetry.next() else { break };
                place.put(record);
                read += 1;
            }
            Ok(read)
        })?;
        give("count", &mut count, read)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_telemetry_lost(telemetry: u64, mut out: Out<'_, u64>) -> i32 {
    run(|| {
        let lost = with(telemetry, |telemetry: &mut TickBacklog| Ok(telemetry.lost()))?;
        give("lost", &mut out, lost)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_status_reader(attachment: u64, out: Out<'_, u64>) -> i32 {
    run(|| {
        let open = || with(attachment, |foretrace: &mut Foretrace| Ok(foretrace.status()?));
        opened(out, open)
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_status_next(
    reader: u64,
    timeout_ns: u64,
    status: *mut Status,
    size: usize,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let place = unsafe { room("status", status, size) }?;
        let next = with(reader, |reader: &mut StatusReader| {
            Ok(reader.next_within(Duration::from_nanos(timeout_ns)))
        })?;
        let next = next.ok_or_else(|| {
            let text = format!("no status within {} ms: the daemon is gone or stuck", timeout_ns / 1_000_000);
            CallFailure::new(ErrorCode::NotSent, text)
        })?;
        place.put(next);
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_request(
    attachment: u64,
    operation: u32,
    value: f64,
    predictor: *const c_char,
    timeout_ns: u64,
    response: *mut ControlResponse,
    size: usize,
) -> i32 {
    run(|| {
        // SAFETY: the caller's.
        let predictor = unsafe { text("predictor", predictor) }?;
        // Before anything is asked for: an error says that nothing was.
        let place = match response.is_null() {
            true => None,
            // SAFETY: the caller's.
            false => Some(unsafe { room("response", response, size) }?),
        };
        let operation = ControlOp::try_from(operation).map_err(|error| bad(error.to_string()))?;
        let timeout = Duration::from_nanos(timeout_ns);
        let answer = with(attachment, |foretrace: &mut Foretrace| {
            let mut requests = foretrace.requests();
            let answer = match operation {
                ControlOp::Query => requests.query(timeout),
                ControlOp::Arm => requests.arm(timeout),
                ControlOp::Disarm => requests.disarm(timeout),
                ControlOp::Stop => requests.stop(timeout),
                ControlOp::MoveHome => requests.move_home(timeout),
                ControlOp::SetTrust => requests.set_trust(value, timeout),
                ControlOp::FreezeTrust => requests.freeze_trust(timeout),
                ControlOp::TrustAuto => requests.trust_auto(timeout),
                ControlOp::Reload => requests.reload(timeout),
                ControlOp::SwitchPredictor => {
                    let name = predictor.as_deref().ok_or_else(|| bad("predictor is a null pointer"))?;
                    requests.switch_predictor(name, timeout)
                }
            };
            Ok(answer?)
        })?;
        if let Some(place) = place {
            place.put(answer);
        }
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_stop(
    instance: u32,
    timeout_ns: u64,
    buffer: *mut c_char,
    room: usize,
) -> i32 {
    run(|| {
        let instance = Instance::new(instance)
            .map_err(|error| CallFailure::new(ErrorCode::Instance, error.to_string()))?;
        let stopped = foretrace_client::stop(&instance, Duration::from_nanos(timeout_ns))?;
        // SAFETY: the caller's.
        unsafe { put_text(buffer, room, stopped.words()) };
        Ok(())
    })
}

/// # Safety
/// See the module.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn foretrace_dead_man(
    attachment: u64,
    name: *const c_char,
    take_over_ns: u64,
    out: Out<'_, u64>,
) -> i32 {
    run(|| {
        let (free, take_over) = (Foretrace::dead_man_as, Foretrace::take_dead_man);
        // SAFETY: the caller's.
        unsafe { opened_place(attachment, name, take_over_ns, out, free, take_over) }
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_dead_man_beat(dead_man: u64) -> i32 {
    run(|| with(dead_man, |dead_man: &mut DeadMan| Ok(dead_man.beat()?)))
}

#[unsafe(no_mangle)]
pub extern "C" fn foretrace_dead_man_stop(dead_man: u64) -> i32 {
    run(|| with(dead_man, |dead_man: &mut DeadMan| Ok(dead_man.stop()?)))
}
