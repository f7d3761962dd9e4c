//! Who holds a place of which there is one: the pen, and the dead-man switch.
//!
//! Contract: a place belongs to whoever holds the lock on its file in the instance's root, so it is free
//! again however its holder ended. The file names the holder in readable form. A place is taken over only by
//! asking its holder, who gives way by itself; a browser never gets the dead-man switch from anything but a
//! browser.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Seek, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::holder::{Claimant, Holder, HolderKind, Place};
use super::root::{Instance, InstanceError};

/// How often a holder looks whether somebody asks.
const LOOK_EVERY_NS: u64 = 100_000_000;
/// How long a question counts: its asker writes it again before.
const ASK_LASTS_NS: u64 = 1_000_000_000;
/// Between two attempts to get a place.
const POLL: Duration = Duration::from_millis(10);
/// Attempts to lock a place that nobody has signed: somebody may just be looking at it.
const TRIES: usize = 20;

/// Why a place was not given.
#[derive(thiserror::Error)]
pub enum PlaceError {
    /// Somebody holds it.
    #[error("{place} is held by {}: end that program, or ask for the place (--take-over)", named(holder))]
    Held {
        /// The place.
        place: Place,
        /// Its holder; none: it has not signed.
        holder: Option<Holder>,
    },
    /// It is not to be had from this holder.
    #[error("{place} is held by {holder}, and a browser never takes it from there: end that program")]
    NotForABrowser {
        /// The place.
        place: Place,
        /// Its holder.
        holder: Holder,
    },
    /// The holder was asked and kept it.
    #[error("{place} is held by {}, which does not give way: end that program", named(holder))]
    Kept {
        /// The place.
        place: Place,
        /// Its holder; none: it has not signed.
        holder: Option<Holder>,
    },
    /// A file of the place cannot be used.
    #[error(transparent)]
    Instance(#[from] InstanceError),
}

crate::debug_as_display!(PlaceError);

fn named(holder: &Option<Holder>) -> String {
    holder.as_ref().map_or_else(|| "a program that does not say its name".to_owned(), ToString::to_string)
}

/// A place that is held until this is dropped or the process ends.
#[derive(Debug)]
pub struct Claim {
    file: File,
    place: Place,
    kind: HolderKind,
    asked: PathBuf,
    looked_ns: u64,
}

impl Instance {
    /// Who holds `place`; none: it is free, or its holder has not signed yet.
    #[must_use]
    pub fn holder(&self, place: Place) -> Option<Holder> {
        let mut file = File::open(self.root().join(place.file())).ok()?;
        // A free lock: what stands there is left over.
        match file.try_lock_shared() {
            Ok(()) => None,
            Err(_) => Holder::parse(&mut file),
        }
    }

    /// Takes `place` for `who`, if it is free.
    ///
    /// # Errors
    ///
    /// `Held`, `Instance`.
    pub fn claim(&self, place: Place, who: &Claimant) -> Result<Claim, PlaceError> {
        let path = self.root().join(place.file());
        let io = |source| InstanceError::Io { path: path.clone(), source };
        let mut options = OpenOptions::new();
        let options = options.read(true).write(true).create(true).truncate(false).mode(0o600);
        let mut file = options.open(&path).map_err(io)?;
        for _ in 0..TRIES {
            match file.try_lock() {
                Ok(()) => {
                    sign(&mut file, &who.signature()).map_err(io)?;
                    let asked = self.root().join(format!("{}.asked", place.file()));
                    return Ok(Claim { file, place, kind: who.kind(), asked, looked_ns: 0 });
                }
                Err(TryLockError::WouldBlock) if self.holder(place).is_some() => break,
                Err(TryLockError::WouldBlock) => std::thread::sleep(POLL),
                Err(TryLockError::Error(source)) => return Err(io(source).into()),
            }
        }
        Err(PlaceError::Held { place, holder: self.holder(place) })
    }

    /// Asks the holder of `place` to give way to `who`, waits for that up to `patience`, and takes it.
    ///
    /// # Errors
    ///
    /// `NotForABrowser`, `Kept`, `Instance`.
    pub fn take_over(&self, place: Place, who: &Claimant, patience: Duration) -> Result<Claim, PlaceError> {
        let deadline = Instant::now() + patience;
        let question = Question(self.root().join(format!("{}.asked", place.file())));
        let mut written: Option<Instant> = None;
        loop {
            match self.claim(place, who) {
                Err(PlaceError::Held { holder: Some(holder), .. })
                    if !who.kind().may_take(place, holder.who.kind()) =>
                {
                    return Err(PlaceError::NotForABrowser { place, holder });
                }
                Err(PlaceError::Held { holder, .. }) if Instant::now() >= deadline => {
                    return Err(PlaceError::Kept { place, holder });
                }
                Err(PlaceError::Held { .. }) => {}
                result => return result,
            }
            if written.is_none_or(|written| written.elapsed().as_nanos() as u64 > ASK_LASTS_NS / 2) {
                written = Some(Instant::now());
                question.ask(who)?;
            }
            std::thread::sleep(POLL);
        }
    }
}

/// The file in which somebody asks; removed when it is dropped.
struct Question(PathBuf);

impl Question {
    fn ask(&self, who: &Claimant) -> Result<(), InstanceError> {
        let whole = self.0.with_extension(format!("asked-{}", std::process::id()));
        let io = |source| InstanceError::Io { path: whole.clone(), source };
        let mut options = OpenOptions::new();
        let mut file =
            options.write(true).create(true).truncate(true).mode(0o600).open(&whole).map_err(io)?;
        file.write_all(who.signature().as_bytes()).map_err(io)?;
        fs::rename(&whole, &self.0).map_err(io)
    }
}

impl Drop for Question {
    fn drop(&mut self) {
        // There may be none.
        let _ = fs::remove_file(&self.0);
    }
}

impl Claim {
    /// Who asks for the place at `now_ns` and may have it: the holder then stops sending and drops this.
    /// Looks at the file ten times per second at most, so that it may be called for every message.
    pub fn asked(&mut self, now_ns: u64) -> Option<Holder> {
        if now_ns.saturating_sub(self.looked_ns) < LOOK_EVERY_NS {
            return None;
        }
        self.looked_ns = now_ns;
        let asker = Holder::read(&self.asked)?;
        let lasts = now_ns.abs_diff(asker.since_ns) <= ASK_LASTS_NS;
        (lasts && asker.who.kind().may_take(self.place, self.kind)).then_some(asker)
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Whoever looks in between sees nobody rather than somebody who is gone.
        let _ = self.file.set_len(0);
    }
}

fn sign(file: &mut File, signature: &str) -> io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(signature.as_bytes())?;
    file.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::clock::monotonic_now_ns;

    fn scratch() -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(3, folder.path()).unwrap();
        (folder, instance)
    }

    fn tablet() -> Claimant {
        Claimant::new(HolderKind::Tablet, "/dev/input/event7")
    }

    fn browser() -> Claimant {
        Claimant::new(HolderKind::Browser, "127.0.0.1")
    }

    /// Takes over while `claim` looks at what is asked, as its holder does.
    fn asked_while(instance: &Instance, mut claim: Claim, who: Claimant) -> Result<Claim, PlaceError> {
        let (place, instance) = (claim.place, instance.clone());
        let asking = std::thread::spawn(move || {
            instance.take_over(place, &who, Duration::from_secs(2)).map(|claim| (claim, who))
        });
        while !asking.is_finished() {
            if let Some(asker) = claim.asked(monotonic_now_ns()) {
                drop(claim);
                let (claim, who) = asking.join().unwrap()?;
                assert_eq!(asker.who, who);
                return Ok(claim);
            }
            std::thread::sleep(POLL);
        }
        asking.join().unwrap().map(|(claim, _)| claim)
    }

    #[test]
    fn a_second_one_learns_who_holds_the_place_and_gets_it_when_it_is_free() {
        let (_folder, instance) = scratch();
        assert_eq!(instance.holder(Place::Pen), None);
        let claim = instance.claim(Place::Pen, &tablet()).unwrap();
        let holder = instance.holder(Place::Pen).unwrap();
        assert_eq!((&holder.who, holder.pid), (&tablet(), std::process::id()));
        let message = instance.claim(Place::Pen, &browser()).unwrap_err().to_string();
        let expected = format!(
            "the pen is held by the tablet /dev/input/event7 (process {}) since 0 s",
            std::process::id()
        );
        assert!(message.starts_with(&expected), "{message}");
        // The other place is another one.
        let _dead_man = instance.claim(Place::DeadMan, &browser()).unwrap();
        drop(claim);
        assert_eq!(instance.holder(Place::Pen), None);
        instance.claim(Place::Pen, &browser()).unwrap();
    }

    #[test]
    fn a_place_is_taken_over_only_by_asking_and_only_when_its_holder_gives_way() {
        let (_folder, instance) = scratch();
        let mut claim = instance.claim(Place::Pen, &tablet()).unwrap();
        assert_eq!(claim.asked(monotonic_now_ns()), None);
        // A holder that does not look keeps it.
        let kept = instance.take_over(Place::Pen, &browser(), Duration::from_millis(30)).unwrap_err();
        assert!(matches!(kept, PlaceError::Kept { holder: Some(_), .. }), "{kept}");
        let claim = asked_while(&instance, claim, browser()).unwrap();
        assert_eq!(instance.holder(Place::Pen).unwrap().who, browser());
        assert!(!claim.asked.exists());
    }

    #[test]
    fn a_browser_never_gets_the_dead_man_switch_from_a_button_or_a_program() {
        let (_folder, instance) = scratch();
        for kind in HolderKind::ALL {
            let claim = instance.claim(Place::DeadMan, &Claimant::new(kind, "x")).unwrap();
            let asked = asked_while(&instance, claim, browser());
            match kind {
                HolderKind::Browser => assert!(asked.is_ok()),
                _ => assert!(matches!(asked, Err(PlaceError::NotForABrowser { .. })), "{kind:?}"),
            }
            drop(asked);
            // Everybody else may ask.
            let claim = instance.claim(Place::DeadMan, &Claimant::new(kind, "x")).unwrap();
            let button = Claimant::new(HolderKind::Button, "pedal");
            assert!(asked_while(&instance, claim, button).is_ok(), "{kind:?}");
        }
    }

    #[test]
    fn a_forged_or_old_question_takes_nothing() {
        let (_folder, instance) = scratch();
        let mut claim = instance.claim(Place::DeadMan, &Claimant::new(HolderKind::Button, "pedal")).unwrap();
        let now = monotonic_now_ns();
        let mut asks = |text: &str| {
            fs::write(&claim.asked, text).unwrap();
            claim.looked_ns = 0;
            claim.asked(now).is_some()
        };
        assert!(!asks(&format!("browser 1 {now}\nx\n")));
        assert!(!asks(&format!("button 1 {}\nx\n", now - 2 * ASK_LASTS_NS)));
        assert!(!asks(&format!("button 1 {}\nx\n", now + 2 * ASK_LASTS_NS)));
        for broken in ["", "\n", "button", "button x y\n", "king 1 2\n", &"9".repeat(5000)] {
            assert!(!asks(broken), "{broken}");
        }
        assert!(asks(&format!("button 1 {now}\nx\n")));
    }
}
