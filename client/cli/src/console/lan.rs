//! `foretrace console --lan`: how other machines find the page, and know that it is the right one.

use std::time::SystemTime;

use foretrace_console::{Certificate, Console, Renewer};
use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;

use crate::failure::Failure;
use crate::output::{note, say};
use crate::terminal::read_lines;

/// Tells how to get there, and how to know that it is this machine.
pub(super) fn tell(address: &str, certificate: &Certificate) {
    show(address);
    if let Some(why) = certificate.made() {
        note!("console: a new certificate was made: {why}; browsers ask once whether to go on");
    }
    say!("certificate {}, {} more days", certificate.fingerprint(), certificate.days_left(SystemTime::now()));
    note!(
        "console: compare it where the browser warns; the address works once, for the page that controls; \
         others watch. Type `token` for another one"
    );
}

fn show(address: &str) {
    // An address fits into a code by far.
    let Ok(code) = QrCode::new(address) else { return };
    // For light letters on a dark ground.
    say!("{}", code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build());
}

/// Gives another address whenever somebody types `token`. The thread ends with its input.
pub(super) fn listen(console: &Console) -> Result<(), Failure> {
    let renewer = console.renewer();
    read_lines("console-words", move |line| {
        answer(&renewer, line);
        true
    })
}

fn answer(renewer: &Renewer, line: &str) {
    match line.trim() {
        "" => {}
        "token" => match renewer.address() {
            Ok(address) => {
                say!("open {address}");
                show(&address);
            }
            Err(error) => note!("console: no token can be made: {error}"),
        },
        other => note!("console: {other:?} is not understood: type `token` for another address"),
    }
}
