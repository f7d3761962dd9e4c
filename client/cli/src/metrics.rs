//! `foretrace metrics`: status and costs of ticks for Prometheus.

use std::net::{SocketAddr, TcpListener};
use std::time::{Duration, Instant};

use foretrace_live::LiveError;
use foretrace_live::metrics::{MetricsBoard, serve, text};
use foretrace_live::source::{LiveSource, SourceMessage, SourceNews, Wants};
use foretrace_live::stages::Stages;
use foretrace_shm::monotonic_now_ns;

use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::note;
use crate::record::unrecorded;
use crate::settings::InstanceArgs;

/// Between two looks: 256 ticks are kept unread.
const NAP: Duration = Duration::from_millis(20);
/// Between two texts; the daemon sends its status ten times a second.
const TEXT: Duration = Duration::from_millis(100);

/// Serve the status of a running daemon to Prometheus until Ctrl-C
///
/// Histograms of the latencies and of the stages of every tick, trust, lag, the learner, and every counter of
/// what was dropped or refused, by reason, at /metrics. Outlives the daemon: without one it says foretrace_up
/// 0.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  foretrace metrics --listen 127.0.0.1:9184")]
pub(crate) struct MetricsArgs {
    /// Address and port to listen on; another address than 127.0.0.1 is open to the network
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:9184")]
    listen: SocketAddr,

    #[command(flatten)]
    instance: InstanceArgs,
}

pub(crate) fn run(args: &MetricsArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    let instance = args.instance.instance()?;
    let (mut source, mut stages) = match LiveSource::open(&instance, Wants::TICKS) {
        Ok(source) => (source, Some(Stages::default())),
        Err(error @ LiveError::NoPlace { .. }) => {
            note!("metrics: no histograms of the stages: {error}");
            (LiveSource::open(&instance, Wants::STATUS).map_err(unrecorded)?, None)
        }
        Err(error) => return Err(unrecorded(error)),
    };
    let board = MetricsBoard::default();
    board.show(text(None, None, monotonic_now_ns()));
    let unheard = |error| {
        Failure::failed(format_args!("cannot listen on {}: {error}", args.listen), "give another --listen")
    };
    let listener = TcpListener::bind(args.listen).map_err(unheard)?;
    let address = listener.local_addr().map_err(unheard)?;
    serve(listener, board.clone()).map_err(unheard)?;
    note!("metrics: http://{address}/metrics until Ctrl-C");
    let (mut newest, mut shown) = (None, Instant::now());
    while !interrupt.is_set() {
        let changed = source.hear(|heard| match (heard, &mut stages) {
            (SourceMessage::Status(status), _) => newest = Some(status),
            (SourceMessage::Tick(record), Some(stages)) => stages.take(&record),
            _ => {}
        });
        if let Some(stages) = &mut stages {
            stages.lost = source.lost().ticks;
        }
        if let Some(changed) = changed {
            if matches!(changed, SourceNews::Gone) {
                newest = None;
            }
            note!("metrics: {}", changed.words());
        }
        if shown.elapsed() >= TEXT {
            shown = Instant::now();
            board.show(text(newest.as_deref(), stages.as_ref(), monotonic_now_ns()));
        }
        std::thread::sleep(NAP);
    }
    Ok(())
}
