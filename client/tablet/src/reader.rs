//! A thread that waits on a device, so that who sends the readings can wait for other things besides.
//!
//! Contract: readings come in the order of their stamps. The channel is bounded: readings that find no room
//! are counted, as are events that the kernel dropped. The thread ends with its device.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use foretrace_client::monotonic_now_ns;

use crate::decoder::{Decoded, Decoder};
use crate::device::Device;

/// Readings between the thread and its reader: more than a second's.
const ROOM: usize = 2048;

/// What came of the device.
#[derive(Debug)]
pub enum Input {
    /// A reading, or that the pen left the range.
    Decoded(Decoded),
    /// Nothing in the time.
    Quiet,
    /// The device is gone.
    Unplugged,
}

/// Counts of what was lost.
#[derive(Debug, Default)]
struct Losses {
    no_room: AtomicU64,
    dropped: AtomicU64,
}

#[derive(Debug)]
pub struct TabletReader {
    inputs: Receiver<Decoded>,
    losses: Arc<Losses>,
}

impl TabletReader {
    /// Begins to read `device`.
    ///
    /// # Errors
    ///
    /// No thread can be started.
    pub fn start(device: Device) -> io::Result<Self> {
        let (sender, inputs) = sync_channel(ROOM);
        let losses = Arc::new(Losses::default());
        let counted = losses.clone();
        std::thread::Builder::new()
            .name("tablet-reads".to_owned())
            .spawn(move || follow(&device, &sender, &counted))?;
        Ok(Self { inputs, losses })
    }

    /// What comes next, within `patience`.
    #[must_use]
    pub fn next(&self, patience: Duration) -> Input {
        match self.inputs.recv_timeout(patience) {
            Ok(decoded) => Input::Decoded(decoded),
            Err(RecvTimeoutError::Timeout) => Input::Quiet,
            Err(RecvTimeoutError::Disconnected) => Input::Unplugged,
        }
    }

    /// Readings that found no room here.
    #[must_use]
    pub fn without_room(&self) -> u64 {
        self.losses.no_room.load(Ordering::Relaxed)
    }

    /// How often the kernel had to drop events, because nobody read them in time.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.losses.dropped.load(Ordering::Relaxed)
    }
}

/// Reads until the device is gone or nobody listens: `None`.
fn follow(device: &Device, sender: &SyncSender<Decoded>, losses: &Losses) -> Option<()> {
    let mut decoder = Decoder::new(device.geometry());
    let send = |decoded| match sender.try_send(decoded) {
        Ok(()) => Some(()),
        Err(TrySendError::Full(_)) => {
            losses.no_room.fetch_add(1, Ordering::Relaxed);
            Some(())
        }
        Err(TrySendError::Disconnected(_)) => None,
    };
    // A pen may be on the tablet since before this was started.
    let resync = |decoder: &mut Decoder| {
        let state = device.state().ok()?;
        match decoder.resync(&state, monotonic_now_ns()) {
            Decoded::Nothing => Some(()),
            decoded => send(decoded),
        }
    };
    resync(&mut decoder)?;
    loop {
        let mut alive = Some(());
        device
            .read(|event| {
                let decoded = decoder.take(event);
                let done = match decoded {
                    Decoded::Nothing => Some(()),
                    Decoded::Lost => {
                        losses.dropped.fetch_add(1, Ordering::Relaxed);
                        resync(&mut decoder)
                    }
                    decoded => send(decoded),
                };
                alive = alive.and(done);
            })
            .ok()?;
        alive?;
    }
}
