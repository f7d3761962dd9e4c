//! Connections, and the threads that read and write them.
//!
//! Contract: each read and each line is bounded; nothing that takes long to read is read under the lock of
//! the controller.

use std::collections::HashMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::arrival::Arrival;
use super::dashboard_server::{self, DashboardReply};
use super::faults;
use super::options::Service;
use super::outbox::ConnectionOutbox;
use super::rtde_server::RtdeSession;
use super::statements::InterpreterLine;
use super::streams;
use super::trouble::Trouble;
use super::world::World;
use crate::script::Uploads;
use foretrace_ur::rtde::frames::Frames;

/// Longest line of a command.
const LONGEST_LINE: usize = 1024;
/// Longest line of statements for interpreter mode.
const LONGEST_STATEMENTS: usize = 64 * 1024;
/// Between two looks at whether a line is whole again, or a place free.
const SOON: Duration = Duration::from_millis(5);

/// Who is sent something by the control loop.
#[derive(Debug)]
pub struct StreamSubscriber {
    number: u64,
    service: Service,
    outbox: Arc<ConnectionOutbox>,
    rtde: Option<Arc<Mutex<RtdeSession>>>,
}

/// What all threads share.
#[derive(Debug)]
pub struct Shared {
    pub world: Mutex<World>,
    pub trouble: Trouble,
    pub stop: AtomicBool,
    subscribers: Mutex<Vec<StreamSubscriber>>,
    connections: Mutex<HashMap<u64, (Service, TcpStream)>>,
    pub(super) next: AtomicU64,
    pub(super) taken: AtomicUsize,
}

#[derive(Debug)]
pub(super) struct Connection {
    pub(super) number: u64,
    pub(super) service: Service,
    pub(super) peer: IpAddr,
    pub(super) stream: TcpStream,
}

impl Shared {
    #[must_use]
    pub fn new(world: World) -> Self {
        Self {
            world: Mutex::new(world),
            trouble: Trouble::default(),
            stop: AtomicBool::new(false),
            subscribers: Mutex::new(Vec::new()),
            connections: Mutex::new(HashMap::new()),
            next: AtomicU64::new(1),
            taken: AtomicUsize::new(0),
        }
    }

    pub fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn subscribers(&self) -> MutexGuard<'_, Vec<StreamSubscriber>> {
        self.subscribers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn connections(&self) -> MutexGuard<'_, HashMap<u64, (Service, TcpStream)>> {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Ends the connections of services that are off, or all.
    pub fn end_connections(&self, all: bool) {
        for (service, stream) in self.connections().values() {
            if all || !self.trouble.is_on(*service) {
                // It may be shut down already.
                let _ = stream.shutdown(Shutdown::Both);
            }
        }
    }

    /// Waits until the client's line is whole, or there is nothing more to wait for. Faults have no line: who
    /// cut everybody off can still mend that.
    fn wait_out_cut(&self, service: Service, peer: IpAddr) {
        let cut = || service != Service::Faults && self.trouble.is_cut(peer);
        while cut() && !self.over() && self.trouble.is_on(service) {
            std::thread::sleep(SOON);
        }
    }

    /// Sends everybody what is due after a cycle; `world` is locked already.
    pub fn publish(&self, world: &mut World) {
        let tenth = u64::from(world.robot.options.series.rate_hz()) / 10;
        let state_due = world.robot.cycle.is_multiple_of(tenth.max(1));
        let content: Vec<_> = world.messages.drain(..).collect();
        let content: Vec<Vec<u8>> =
            content.into_iter().map(|content| streams::message(world, content)).collect();
        let (mut state, mut real_time) = (None, None);
        for subscriber in self.subscribers().iter() {
            let outbox = &subscriber.outbox;
            match subscriber.service {
                Service::Rtde => {
                    let Some(session) = &subscriber.rtde else { continue };
                    let session = session.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some(package) = session.package(world) {
                        outbox.package(package, self.trouble.next_delay());
                    }
                }
                Service::RealTime | Service::RealTimeReadOnly => {
                    let bytes: &Vec<u8> = real_time.get_or_insert_with(|| streams::real_time(world));
                    outbox.package(bytes.clone(), Duration::ZERO);
                }
                Service::Primary | Service::PrimaryReadOnly => {
                    for content in &content {
                        // A client that does not read loses messages.
                        let _ = outbox.reply(content.clone());
                    }
                    if state_due {
                        let bytes: &Vec<u8> = state.get_or_insert_with(|| streams::state(world));
                        outbox.package(bytes.clone(), Duration::ZERO);
                    }
                }
                Service::Secondary | Service::SecondaryReadOnly if state_due => {
                    let bytes: &Vec<u8> = state.get_or_insert_with(|| streams::state(world));
                    outbox.package(bytes.clone(), Duration::ZERO);
                }
                _ => {}
            }
        }
    }
}

/// Reads and writes until the connection ends.
pub(super) fn talk(shared: &Arc<Shared>, connection: &Connection) {
    match connection.service {
        Service::Dashboard | Service::Faults => lines(shared, connection),
        _ => stream_to(shared, connection),
    }
    // It may be shut down already.
    let _ = connection.stream.shutdown(Shutdown::Both);
}

/// Reads once; `None` at the end, an empty slice where nothing came yet.
fn read<'a>(shared: &Shared, connection: &Connection, buffer: &'a mut [u8]) -> Option<&'a [u8]> {
    let &Connection { service, peer, .. } = connection;
    shared.wait_out_cut(service, peer);
    if shared.over() {
        return None;
    }
    match (&connection.stream).read(buffer) {
        Ok(0) => None,
        Ok(length) => {
            // A cut that came while it waited: what arrived stays where it is until the network is back.
            shared.wait_out_cut(service, peer);
            buffer.get(..length)
        }
        Err(error) => match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Some(&[]),
            _ => None,
        },
    }
}

/// Dashboard and faults: lines in, lines out.
fn lines(shared: &Shared, connection: &Connection) {
    let &Connection { service, peer, .. } = connection;
    // Who does not read the answers is left.
    if connection.stream.set_write_timeout(Some(Duration::from_secs(2))).is_err() {
        return;
    }
    let mut out = &connection.stream;
    let mut say = |line: &str| {
        shared.wait_out_cut(service, peer);
        out.write_all(format!("{line}\n").as_bytes()).is_ok()
    };
    if service == Service::Dashboard && !say(dashboard_server::GREETING) {
        return;
    }
    let (mut buffer, mut line) = ([0; 1024], Vec::new());
    while let Some(bytes) = read(shared, connection, &mut buffer) {
        for byte in bytes {
            if *byte != b'\n' {
                line.push(*byte);
                if line.len() > LONGEST_LINE {
                    return;
                }
                continue;
            }
            let text = String::from_utf8_lossy(&line).trim().to_owned();
            line.clear();
            let answer = match service {
                Service::Dashboard => dashboard_server::answer(&mut shared.world(), &text),
                _ => DashboardReply::Line(faults::obey(&mut shared.world(), &shared.trouble, &text)),
            };
            shared.end_connections(false);
            let (DashboardReply::Line(text) | DashboardReply::Last(text) | DashboardReply::Off(text)) =
                &answer;
            let said = say(text);
            if matches!(answer, DashboardReply::Off(_)) {
                shared.trouble.shut_down();
                shared.end_connections(false);
            }
            if !said || !matches!(answer, DashboardReply::Line(_)) {
                return;
            }
        }
    }
}

/// The other ports: this thread reads, another writes what the control loop has for it.
fn stream_to(shared: &Arc<Shared>, connection: &Connection) {
    let &Connection { number, service, peer, ref stream } = connection;
    let Ok(writing) = stream.try_clone() else { return };
    let outbox = Arc::new(ConnectionOutbox::default());
    let rtde = (service == Service::Rtde)
        .then(|| Arc::new(Mutex::new(RtdeSession::new(number, &shared.world().robot.options))));
    let silent = [Service::Rtde, Service::RealTime, Service::RealTimeReadOnly, Service::Interpreter];
    if !silent.contains(&service) {
        let greeting = streams::greeting(&shared.world());
        outbox.reply(greeting);
    }
    let subscriber = StreamSubscriber { number, service, outbox: Arc::clone(&outbox), rtde: rtde.clone() };
    shared.subscribers().push(subscriber);
    let (own, own_outbox) = (Arc::clone(shared), Arc::clone(&outbox));
    let writer = std::thread::Builder::new()
        .name(format!("ur {} out", service.name()))
        .spawn(move || own_outbox.write_to(&writing, || own.wait_out_cut(service, peer)));
    if writer.is_ok() {
        match &rtde {
            Some(session) => read_rtde(shared, session, &outbox, connection),
            None if service == Service::Interpreter => read_statements(shared, &outbox, connection),
            None => read_scripts(shared, connection),
        }
    }
    outbox.close();
    shared.subscribers().retain(|subscriber| subscriber.number != number);
    shared.world().inputs.release(number);
}

fn read_rtde(
    shared: &Shared,
    session: &Mutex<RtdeSession>,
    outbox: &ConnectionOutbox,
    connection: &Connection,
) {
    let (mut frames, mut buffer) = (Frames::default(), [0; 4096]);
    while let Some(bytes) = read(shared, connection, &mut buffer) {
        frames.feed(bytes);
        loop {
            let (kind, payload) = match frames.next_package() {
                Ok(Some(package)) => package,
                Ok(None) => break,
                Err(_) => return,
            };
            // First the world, as the control loop does.
            let mut world = shared.world();
            let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
            let replies = session.answer(kind, payload, &mut world);
            if !replies.is_empty() {
                // A package of the recipe before would be read as one of the new recipe.
                outbox.forget_packages();
            }
            drop(session);
            drop(world);
            if !replies.into_iter().all(|reply| outbox.reply(reply)) {
                return;
            }
        }
    }
}

/// Lines for a program in interpreter mode.
fn read_statements(shared: &Shared, outbox: &Arc<ConnectionOutbox>, connection: &Connection) {
    let (mut buffer, mut line) = ([0; 4096], Vec::new());
    while let Some(bytes) = read(shared, connection, &mut buffer) {
        for byte in bytes {
            if *byte != b'\n' {
                line.push(*byte);
                if line.len() > LONGEST_STATEMENTS {
                    return;
                }
                continue;
            }
            let text = String::from_utf8_lossy(&std::mem::take(&mut line)).trim().to_owned();
            if !text.is_empty() {
                let read = InterpreterLine::read(&text, Arc::clone(outbox));
                shared.world().interpret(read);
            }
        }
    }
}

fn read_scripts(shared: &Shared, connection: &Connection) {
    let takes = matches!(connection.service, Service::Primary | Service::Secondary | Service::RealTime);
    let (mut text, mut buffer) = (Uploads::default(), [0; 4096]);
    while let Some(bytes) = read(shared, connection, &mut buffer) {
        if !takes {
            continue;
        }
        let Ok(programs) = text.take(bytes) else { return };
        for program in programs {
            // A long program takes longer to read than a cycle lasts.
            if !hand_over(shared, Arrival::read(&program)) {
                return;
            }
        }
    }
}

/// Waits until the control loop has room for it, never with the lock that this takes; false at the end.
fn hand_over(shared: &Shared, mut arrival: Arrival) -> bool {
    while !shared.over() {
        let taken = shared.world().arrive(arrival);
        let Err(back) = taken else { return true };
        arrival = back;
        std::thread::sleep(SOON);
    }
    false
}
