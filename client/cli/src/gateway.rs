//! `foretrace gateway`: pen samples from programs of other users, which have no access to the shared memory.

use std::cell::RefCell;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_client::{Claimant, HolderKind, Lasting, PenFeed, PenSample, Place, monotonic_now_ns};
use foretrace_gateway::{Delivery, Gateway, GatewaySocket, GatewayTally, Policy};

use crate::attach::{attach_within, follow, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say};
use crate::settings::InstanceArgs;
use crate::take_over::{TakeOver, handed_over};

/// Accept pen samples from programs of other users, over a socket, checked
///
/// One client at a time, `foretrace play --gateway PATH` or any program that speaks the protocol
/// (shm-schema/src/wire/gateway.rs). The kernel tells which user a client is; only those of
/// --allow-uid are let in. Run it as the daemon's user. Holds the instance's only place for a pen. Outlives
/// the daemon; ends on Ctrl-C.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  foretrace gateway --socket /tmp/foretrace-pen.socket --allow-uid 1001 --mode \
                  666\n  foretrace play glyphs:Hello --gateway /tmp/foretrace-pen.socket      # as user 1001"
)]
pub(crate) struct GatewayArgs {
    /// Path of the socket, in a folder that only its owner may write to
    #[arg(long, value_name = "PATH")]
    socket: PathBuf,

    /// Numeric IDs of the users that may send; see `id -u NAME`
    #[arg(long, value_name = "N", value_delimiter = ',', required = true)]
    allow_uid: Vec<u32>,

    /// Permissions of the socket; 666 if the list of users is enough
    #[arg(long, value_name = "OCTAL", default_value = "660", value_parser = octal)]
    mode: u32,

    /// Numeric ID of the group that the socket is given to
    #[arg(long, value_name = "N")]
    group: Option<u32>,

    /// Largest sustained rate of samples [1/s]
    #[arg(long, value_name = "HZ", default_value_t = 2000, value_parser = clap::value_parser!(u32)
        .range(1..=100_000))]
    rate: u32,

    /// Largest burst of samples
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = clap::value_parser!(u32)
        .range(1..=100_000))]
    burst: u32,

    /// Shortest time between two reports of the counts [s]; reports only changes
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = crate::values::positive)]
    status_every: f64,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    #[command(flatten)]
    take_over: TakeOver,

    #[command(flatten)]
    instance: InstanceArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// An incomplete frame after this long is an attack or a bug.
const FRAME_TIME: Duration = Duration::from_secs(1);
/// A pen that sends nothing, or too little, for this long gives way.
const SILENCE: Duration = Duration::from_secs(5);

pub(crate) fn run(args: &GatewayArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let instance = args.instance.instance()?;
    let foretrace = attach_within(&instance, Duration::from_secs_f64(args.wait))?;
    let who = Claimant::new(HolderKind::Gateway, &args.socket.display().to_string());
    let feed = args.take_over.pen(&foretrace, &who).map_err(unattached)?;
    let pen = RefCell::new(GatewayPen { feed: Lasting::new(foretrace, feed), reported: false });
    let socket = GatewaySocket::open(&args.socket, args.mode, args.group)?;
    let policy = Policy {
        allowed: args.allow_uid.clone(),
        rate: args.rate,
        burst: args.burst,
        frame_time: FRAME_TIME,
        silence: SILENCE,
    };
    let mut gateway =
        Gateway::new(socket, policy, |sample| pen.borrow_mut().pass_on(sample), monotonic_now_ns);
    note!(
        "gateway: open at {} for users {:?}, {} samples/s, {} at once",
        args.socket.display(),
        args.allow_uid,
        args.rate,
        args.burst
    );
    let begin = Instant::now();
    let mut news = CountsReporter::new(Duration::from_secs_f64(args.status_every));
    let over = || args.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
    while !interrupt.is_set() && !over() {
        gateway.round().map_err(|error| {
            Failure::failed(format_args!("the socket failed: {error}"), "start the gateway again")
        })?;
        let feed = &mut pen.borrow_mut().feed;
        follow("gateway", "waiting for the next", feed, |foretrace| foretrace.pen_feed_as(&who));
        if let Some(to) = feed.handle.as_mut().and_then(PenFeed::handed_to) {
            return Err(handed_over(Place::Pen, Some(to)));
        }
        news.tell(&gateway);
    }
    let tally = gateway.close();
    say!("gateway: {tally}");
    args.json.write(&tally)
}

/// The feed into shared memory.
struct GatewayPen {
    feed: Lasting<PenFeed>,
    /// That samples fail has been reported.
    reported: bool,
}

impl GatewayPen {
    fn pass_on(&mut self, sample: PenSample) -> Delivery {
        match self.feed.handle.as_mut().map(|feed| feed.send_sample(sample)) {
            Some(Ok(true)) => Delivery::Heard,
            Some(Ok(false)) | None => Delivery::Unheard,
            Some(Err(error)) => {
                if !self.reported {
                    note!("gateway: {error}; said only once");
                    self.reported = true;
                }
                Delivery::Failed
            }
        }
    }
}

/// The counts reported last.
struct CountsReporter {
    every: Duration,
    last: Instant,
    tally: GatewayTally,
}

impl CountsReporter {
    fn new(every: Duration) -> Self {
        Self { every, last: Instant::now(), tally: GatewayTally::default() }
    }

    fn tell<D: FnMut(PenSample) -> Delivery>(&mut self, gateway: &Gateway<D>) {
        if self.last.elapsed() < self.every || *gateway.tally() == self.tally {
            return;
        }
        let who = gateway
            .user()
            .map_or_else(|| "no client connected".to_owned(), |user| format!("user {user} connected"));
        note!("gateway: {who}; {}", gateway.tally());
        self.last = Instant::now();
        self.tally = gateway.tally().clone();
    }
}

fn octal(text: &str) -> Result<u32, String> {
    match u32::from_str_radix(text, 8) {
        Ok(mode) if mode <= 0o777 => Ok(mode),
        _ => Err("three octal digits, 000 to 777".to_owned()),
    }
}
