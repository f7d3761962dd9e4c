//! `foretrace enable`: a dead-man switch from a button that is held.
//!
//! Contract: the daemon hears "go on" only while the button is held. Released, unplugged, this program ended
//! or killed: the arm stops. It outlives the daemon; after a daemon's return the button has to be released
//! once. It arms nothing, and it is no safety function.

mod rehearsal;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{Claimant, DaemonChange, DeadMan, Foretrace, HolderKind, Lasting, Place};
use foretrace_tablet::{Button, ButtonDevice, ButtonIdentity, HoldSwitch, SwitchSignal, list_buttons};

use crate::attach::{attach_within, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{note, say};
use crate::settings::InstanceArgs;
use crate::take_over::{TakeOver, handed_over};

/// How often the button is looked at: a release is reported within this time.
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
    let foretrace = attach_within(&args.instance.instance()?, Duration::from_secs_f64(args.wait))?;
    let who = Claimant::new(HolderKind::Button, &format!("{}, {}", path.display(), button.name()));
    let dead_man = args.take_over.dead_man(&foretrace, &who).map_err(unattached)?;
    note!("enable: hold {} to let the arm move", button.name());
    let mut button = HeldButton {
        dead_man: Lasting::new(foretrace, dead_man),
        who,
        identity: button.identity().clone(),
        refused: None,
        button: Some(button),
        switch: HoldSwitch::new(DeadMan::INTERVAL),
        next_attempt: Instant::now(),
        shown: None,
    };
    let begin = Instant::now();
    while !interrupt.is_set() {
        button.reopen(path, name);
        button.look(begin.elapsed());
        button.follow();
        if let Some(to) = button.dead_man.handle.as_mut().and_then(DeadMan::handed_to) {
            return Err(handed_over(Place::DeadMan, Some(to)));
        }
        std::thread::sleep(LOOK_EVERY);
    }
    button.end();
    Ok(())
}

fn list() -> Result<(), Failure> {
    let (devices, closed) = list_buttons()?;
    for ButtonDevice { path, name, buttons, radio } in &devices {
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

/// The button, the way to the daemon, and what was last reported of them.
struct HeldButton {
    dead_man: Lasting<DeadMan>,
    who: Claimant,
    button: Option<Button>,
    identity: ButtonIdentity,
    /// Why the device that is there is not taken; reported once.
    refused: Option<String>,
    switch: HoldSwitch,
    next_attempt: Instant,
    shown: Option<&'static str>,
}

impl HeldButton {
    /// Opens a device that was unplugged.
    fn reopen(&mut self, path: &std::path::Path, name: &str) {
        if self.button.is_none() && Instant::now() >= self.next_attempt {
            self.next_attempt = Instant::now() + AGAIN;
            match Button::open_again(path, name, &self.identity) {
                Ok(button) => {
                    (self.button, self.refused) = (Some(button), None);
                    self.switch.begin_again();
                }
                // Nothing at the path is what an unplugged device looks like, and reported already.
                Err(_) if !path.exists() => self.refused = None,
                Err(error) => {
                    let words = format!("foretrace: {error}");
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
        let sent = match (self.switch.look(now, held), &mut self.dead_man.handle) {
            (SwitchSignal::Beat, Some(dead_man)) => dead_man.beat().is_ok(),
            (SwitchSignal::Stop, Some(dead_man)) => dead_man.stop().is_ok(),
            _ => true,
        };
        self.show(match (&self.button, &self.dead_man.handle) {
            (None, _) => "the device is gone: the arm stops; plug it in",
            (_, None) => "the daemon is gone",
            _ if !sent => "the daemon does not take the signal",
            _ if self.switch.is_held() => "held",
            _ if self.switch.waits_for_release() => "held since before it could count: release it once",
            _ => "released",
        });
    }

    fn follow(&mut self) {
        let Self { dead_man, who, .. } = self;
        let open = |foretrace: &Foretrace| foretrace.dead_man_as(who);
        let (change, mut error) = dead_man.look(open);
        if change == DaemonChange::Back {
            error = dead_man.open_again(open);
        }
        if let Some(error) = error {
            note!("{error}");
        }
        if change != DaemonChange::None {
            self.switch.begin_again();
        }
    }

    fn show(&mut self, state: &'static str) {
        if self.shown != Some(state) {
            self.shown = Some(state);
            note!("enable: {state}");
        }
    }

    fn end(&mut self) {
        if let (true, Some(dead_man)) = (self.switch.is_held(), &mut self.dead_man.handle) {
            // Silence stops as well.
            let _ = dead_man.stop();
        }
    }
}
