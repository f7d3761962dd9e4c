//! `foretrace enable`: a dead-man switch from a button that is held.
//!
//! Contract: the daemon hears "go on" only while the button is held. Released, unplugged, this program ended
//! or killed: the arm stops. It outlives the daemon; after a daemon's return the button has to be released
//! once. It arms nothing, and it is no safety function.

mod device;
mod rehearsal;
mod switch;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{Claimant, DeadMan, Foretrace, HolderKind, Place};

use crate::attach::{Lookout, News, attach_within, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note, say};
use crate::place::{TakeOver, handed_over};
use crate::settings::InstanceArgs;
use device::{Button, Identity};
use switch::{Signal, Switch};

/// How often the button is looked at: a release is told within this time.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Between two attempts to find a device that was unplugged.
const AGAIN: Duration = Duration::from_millis(500);

/// Hold to run: keep the arm enabled while a button of an input device is held
///
/// Sends the dead-man signal that safety.enable_required asks for, from a foot pedal, a gamepad, a keyboard
/// or a stylus; wired only, Bluetooth is refused. Release the button, unplug the device or end this program,
/// and the arm stops. A button that is already held at the start counts only after it was released once. This
/// is not a safety function: the enabling device of the arm's own controller is.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace enable --list\n  foretrace enable --device \
                        /dev/input/by-id/usb-Foot_Pedal-event-kbd --button KEY_B\n  foretrace enable \
                        --terminal    beside foretrace arm sim")]
pub(crate) struct EnableArgs {
    /// The input device, best by its name in /dev/input/by-id
    #[arg(long, value_name = "FILE", required_unless_present_any = ["list", "terminal"])]
    device: Option<PathBuf>,

    /// The button, by the kernel's name, for example KEY_SPACE, BTN_TRIGGER, BTN_STYLUS
    #[arg(long, value_name = "NAME", required_unless_present_any = ["list", "terminal"])]
    button: Option<String>,

    /// Rehearse with a simulated arm: any key of this terminal, which counts as held for 0.7 s after its last
    /// repeat
    #[arg(long, conflicts_with_all = ["device", "button", "list"])]
    terminal: bool,

    /// List the devices that have buttons, and end
    #[arg(long)]
    list: bool,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    #[command(flatten)]
    take_over: TakeOver,

    #[command(flatten)]
    instance: InstanceArgs,
}

pub(crate) fn run(args: &EnableArgs) -> Result<(), Failure> {
    if args.terminal {
        return rehearsal::run(args);
    }
    let (Some(path), Some(name)) = (&args.device, &args.button) else { return list() };
    if args.list {
        return list();
    }
    let interrupt = Interrupt::listen()?;
    let button = Button::open(path, name)?;
    let mut foretrace = attach_within(&args.instance.instance()?, Duration::from_secs_f64(args.wait))?;
    let who = Claimant::new(HolderKind::Button, &format!("{}, {}", path.display(), button.name()));
    let dead_man = args.take_over.dead_man(&foretrace, &who).map_err(unattached)?;
    note!("enable: hold {} to let the arm move", button.name());
    let mut holder = Holder {
        dead_man: Some(dead_man),
        who,
        identity: button.identity().clone(),
        refused: None,
        button: Some(button),
        switch: Switch::new(DeadMan::INTERVAL),
        next_attempt: Instant::now(),
        shown: None,
    };
    let (begin, mut lookout) = (Instant::now(), Lookout::new());
    while !interrupt.is_set() {
        holder.reopen(path, name);
        holder.look(begin.elapsed());
        holder.follow(&mut lookout, &mut foretrace);
        if let Some(to) = holder.dead_man.as_mut().and_then(DeadMan::handed_to) {
            return Err(handed_over(Place::DeadMan, Some(to)));
        }
        std::thread::sleep(LOOK_EVERY);
    }
    holder.end();
    Ok(())
}

fn list() -> Result<(), Failure> {
    let (devices, closed) = device::list()?;
    for device::Listed { path, name, buttons, radio } in &devices {
        let refused = if *radio { ", over Bluetooth: refused, wired only" } else { "" };
        say!("{:<24}{} ({buttons} buttons{refused})", path.display(), foretrace_config::plain(name));
    }
    if closed > 0 {
        note!("enable: {closed} more devices may not be read by this user");
    }
    if devices.is_empty() {
        return Err(Failure::failed("no input device with buttons", "plug one in; see `ls -l /dev/input`"));
    }
    Ok(())
}

/// The button, the way to the daemon, and what was last said of them.
struct Holder {
    dead_man: Option<DeadMan>,
    who: Claimant,
    button: Option<Button>,
    identity: Identity,
    /// Why the device that is there is not taken; told once.
    refused: Option<String>,
    switch: Switch,
    next_attempt: Instant,
    shown: Option<&'static str>,
}

impl Holder {
    /// Opens a device that was unplugged.
    fn reopen(&mut self, path: &std::path::Path, name: &str) {
        if self.button.is_none() && Instant::now() >= self.next_attempt {
            self.next_attempt = Instant::now() + AGAIN;
            match Button::open_again(path, name, &self.identity) {
                Ok(button) => {
                    (self.button, self.refused) = (Some(button), None);
                    self.switch.begin_anew();
                }
                // Nothing at the path is what an unplugged device looks like, and told already.
                Err(_) if !path.exists() => self.refused = None,
                Err(error) => {
                    let words = error.to_string();
                    if self.refused.as_ref() != Some(&words) {
                        note!("{words}");
                        self.refused = Some(words);
                    }
                }
            }
        }
    }

    fn look(&mut self, now: Duration) {
        let held = self.button.as_ref().and_then(|button| button.held().ok());
        if held.is_none() {
            self.button = None;
        }
        let sent = match (self.switch.look(now, held), &mut self.dead_man) {
            (Signal::Beat, Some(dead_man)) => dead_man.beat().is_ok(),
            (Signal::Stop, Some(dead_man)) => dead_man.stop().is_ok(),
            _ => true,
        };
        self.show(match (&self.button, &self.dead_man) {
            (None, _) => "the device is gone: the arm stops; plug it in",
            (_, None) => "the daemon is gone",
            _ if !sent => "the daemon does not take the signal",
            _ if self.switch.is_held() => "held",
            _ if self.switch.waits_for_release() => "held since before it could count: release it once",
            _ => "released",
        });
    }

    fn follow(&mut self, lookout: &mut Lookout, foretrace: &mut Foretrace) {
        match lookout.look(foretrace) {
            News::None => {}
            News::Gone => self.switch.begin_anew(),
            News::Back | News::Renewed => {
                // The old handle holds the place that the new one needs.
                self.dead_man = None;
                self.switch.begin_anew();
                match foretrace.dead_man_as(&self.who) {
                    Ok(dead_man) => self.dead_man = Some(dead_man),
                    Err(error) => {
                        note!("{error}");
                        lookout.again();
                    }
                }
            }
        }
    }

    /// Tells a change.
    fn show(&mut self, state: &'static str) {
        if self.shown != Some(state) {
            self.shown = Some(state);
            note!("enable: {state}");
        }
    }

    fn end(&mut self) {
        if let (true, Some(dead_man)) = (self.switch.is_held(), &mut self.dead_man) {
            // Silence stops as well.
            let _ = dead_man.stop();
        }
    }
}
