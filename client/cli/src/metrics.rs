//! `foretrace metrics`: the status for Prometheus.

use std::net::{SocketAddr, TcpListener};
use std::time::Duration;

use foretrace_record::metrics::{Board, serve, text};
use foretrace_shm::monotonic_now_ns;

use crate::attach::{Lookout, News, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::note;
use crate::settings::InstanceArgs;

/// Between two looks; the daemon sends its status ten times a second.
const NAP: Duration = Duration::from_millis(100);

/// Serve the status of a running daemon to Prometheus until Ctrl-C
///
/// Histograms of the latencies, costs of the stages, trust, lag, the learner, and every counter of what was
/// dropped or refused, by reason, at /metrics. Outlives the daemon: without one it says foretrace_up 0.
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
    let mut foretrace = args.instance.attach()?;
    let mut status = foretrace.status().map_err(unattached)?;
    let board = Board::default();
    board.show(text(status.latest(), monotonic_now_ns()));
    let unheard = |error| {
        Failure::failed(format_args!("cannot listen on {}: {error}", args.listen), "give another --listen")
    };
    let listener = TcpListener::bind(args.listen).map_err(unheard)?;
    let address = listener.local_addr().map_err(unheard)?;
    serve(listener, board.clone()).map_err(unheard)?;
    note!("metrics: http://{address}/metrics until Ctrl-C");
    let mut lookout = Lookout::new();
    let mut gone = false;
    while !interrupt.is_set() {
        match lookout.look(&mut foretrace) {
            News::None => {}
            News::Gone => gone = true,
            News::Back => gone = false,
            News::Renewed => match foretrace.status() {
                Ok(new) => (status, gone) = (new, false),
                Err(error) => {
                    lookout.again();
                    note!("metrics: {}", unattached(error));
                }
            },
        }
        let newest = status.latest().filter(|_| !gone);
        board.show(text(newest, monotonic_now_ns()));
        std::thread::sleep(NAP);
    }
    Ok(())
}
