//! A way to the controller from an address of one's own, so that a cut of somebody else's line leaves it
//! whole. Bytes go through as they are.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddrV4, TcpListener, TcpStream};

use rustix::net::{AddressFamily, SocketType, bind, connect, socket};

/// Listens at `own` and carries every connection on to `to`, from `own`, until the test's process ends.
pub(super) fn relay(own: SocketAddrV4, to: SocketAddrV4) {
    let listener = TcpListener::bind(own).expect("an address of the test's own");
    std::thread::spawn(move || {
        for client in listener.incoming().flatten() {
            let Ok(server) = connect_from(*own.ip(), to) else { continue };
            let ends = [client.try_clone(), server.try_clone()];
            let [Ok(client_out), Ok(server_out)] = ends else { continue };
            std::thread::spawn(move || carry(client, server_out));
            std::thread::spawn(move || carry(server, client_out));
        }
    });
}

fn connect_from(own: Ipv4Addr, to: SocketAddrV4) -> io::Result<TcpStream> {
    let socket = socket(AddressFamily::INET, SocketType::STREAM, None)?;
    bind(&socket, &SocketAddrV4::new(own, 0))?;
    connect(&socket, &to)?;
    let stream = TcpStream::from(socket);
    stream.set_nodelay(true)?;
    Ok(stream)
}

fn carry(mut from: TcpStream, mut to: TcpStream) {
    let _ = from.set_nodelay(true);
    let mut bytes = [0; 4096];
    while let Ok(length) = from.read(&mut bytes) {
        if length == 0 || to.write_all(&bytes[..length]).is_err() {
            break;
        }
    }
    // It may be shut down already.
    let _ = to.shutdown(std::net::Shutdown::Both);
}
