//! Ports: who connects is given threads, or waits behind a line that is cut.
//!
//! Contract: at most [`MOST_CONNECTIONS`] connections a service, and as many that wait.

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::network::{Connection, Shared, talk};
use super::options::Service;

/// Connections of one service at a time.
pub const MOST_CONNECTIONS: usize = 16;
/// Between two looks at whether all is over.
const LOOK: Duration = Duration::from_millis(100);
/// Between two looks for a new connection.
const ACCEPT: Duration = Duration::from_millis(5);

/// Listens for `service` at `address` until all is over; the port is closed while the service is off.
pub fn serve(shared: &Arc<Shared>, service: Service, listener: TcpListener, address: SocketAddr) {
    let mut listener = Some(listener);
    // Whoever connects over a cut line: in a real network their calls would be under way.
    let mut held: Vec<(TcpStream, SocketAddr)> = Vec::new();
    let cut = |peer: &SocketAddr| service != Service::Faults && shared.trouble.is_cut(peer.ip());
    while !shared.over() {
        if !shared.trouble.is_on(service) {
            listener = None;
            held.clear();
            shared.end_connections(false);
            std::thread::sleep(ACCEPT);
            continue;
        }
        held.retain(|(stream, _)| !is_gone(stream));
        for (stream, peer) in held.extract_if(.., |(_, peer)| !cut(peer)) {
            welcome(shared, service, stream, peer);
        }
        let Some(open) = &listener else {
            // The port may be taken for a moment still.
            listener =
                TcpListener::bind(address).and_then(|open| open.set_nonblocking(true).map(|()| open)).ok();
            std::thread::sleep(ACCEPT);
            continue;
        };
        match open.accept() {
            Ok((stream, peer)) if !cut(&peer) => welcome(shared, service, stream, peer),
            Ok(waits) if held.len() < MOST_CONNECTIONS => held.push(waits),
            // Too many wait: this one is left.
            Ok(_) => {}
            Err(_) => std::thread::sleep(ACCEPT),
        }
    }
}

/// The client has given up.
fn is_gone(stream: &TcpStream) -> bool {
    let peeked = stream.set_nonblocking(true).and_then(|()| stream.peek(&mut [0]));
    match peeked {
        Ok(length) => length == 0,
        Err(error) => error.kind() != ErrorKind::WouldBlock,
    }
}

/// Gives a connection its threads, unless there are too many.
fn welcome(shared: &Arc<Shared>, service: Service, stream: TcpStream, peer: SocketAddr) {
    let number = shared.next.fetch_add(1, Ordering::Relaxed);
    shared.taken.fetch_add(1, Ordering::Relaxed);
    let known = {
        let mut connections = shared.connections();
        let many = connections.values().filter(|(other, _)| *other == service).count() >= MOST_CONNECTIONS;
        let ready = stream.set_nonblocking(false).and_then(|()| stream.set_nodelay(true));
        let ready = ready.and_then(|()| stream.set_read_timeout(Some(LOOK)));
        match (many, ready, stream.try_clone()) {
            (false, Ok(()), Ok(clone)) => connections.insert(number, (service, clone)).is_none(),
            _ => false,
        }
    };
    if !known {
        return;
    }
    let own = Arc::clone(shared);
    let connection = Connection { number, service, peer: peer.ip(), stream };
    let started = std::thread::Builder::new().name(format!("ur {}", service.name())).spawn(move || {
        talk(&own, &connection);
        own.connections().remove(&number);
    });
    if started.is_err() {
        shared.connections().remove(&number);
    }
}
