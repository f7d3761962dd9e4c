//! A process that tries to access files of another user.
//!
//! Contract: `trespass PATH...` tries each path for reading, for writing without changing it, as a folder and
//! as a socket, and prints `user`, `entered` (what worked), `denied` (attempts that the system forbade) and
//! `gone` (what is not there).

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixDatagram;
use std::process::ExitCode;

use serde_json::json;

/// The trespasser, with the arguments after `trespass`.
#[must_use]
pub fn main(paths: &[String]) -> ExitCode {
    let (mut entered, mut denied, mut gone, mut other) = (Vec::new(), 0, 0, 0);
    for path in paths {
        let attempts: [(&str, io::Result<()>); 4] = [
            ("read", File::open(path).map(drop)),
            ("write", OpenOptions::new().write(true).open(path).map(drop)),
            ("list", std::fs::read_dir(path).map(drop)),
            ("send", UnixDatagram::unbound().and_then(|socket| socket.connect(path))),
        ];
        for (what, attempt) in attempts {
            match attempt.map_err(|error| error.kind()) {
                Ok(()) => entered.push(format!("{what} {path}")),
                Err(ErrorKind::PermissionDenied) => denied += 1,
                Err(ErrorKind::NotFound) => gone += 1,
                // The path is no folder, or no socket.
                Err(_) => other += 1,
            }
        }
    }
    let user = std::fs::metadata("/proc/self").map_or(u32::MAX, |found| found.uid());
    println!(
        "{}",
        json!({ "user": user, "entered": entered, "denied": denied, "gone": gone, "other": other })
    );
    ExitCode::SUCCESS
}
