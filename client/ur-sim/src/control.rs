//! The control loop and the handle of a simulated controller.

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::faults;
use super::listen::serve;
use super::network::Shared;
use super::options::{ControllerOptions, Service};
use super::world::World;

/// Farther behind than this the loop does not catch up: the process was stopped, not busy.
const LATEST: Duration = Duration::from_millis(200);

/// Cycles in a row after which nothing is sent, however late it is.
const MOST_SKIPPED: u32 = 10;

/// A simulated controller; it ends when this is dropped.
#[derive(Debug)]
pub struct Controller {
    shared: Arc<Shared>,
    addresses: Vec<(Service, SocketAddr)>,
    threads: Vec<JoinHandle<()>>,
}

/// Why a controller does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// A port is taken, or the address is none of this host's.
    #[error("cannot bind {address} ({}): {error}; use --bind 127.0.0.2 for a second one", service.name())]
    Port { service: Service, address: SocketAddr, error: std::io::Error },
    /// The system gives no thread.
    #[error("no thread: {0}")]
    Thread(std::io::Error),
}

impl Controller {
    /// Starts one.
    ///
    /// # Errors
    ///
    /// See [`StartError`].
    pub fn start(options: ControllerOptions) -> Result<Self, StartError> {
        let mut listeners = Vec::new();
        for service in Service::ALL.into_iter().filter(|service| service.is_of(options.series)) {
            let port = if options.ephemeral_ports { 0 } else { service.port() };
            let address = SocketAddr::new(options.bind, port);
            let bound = TcpListener::bind(address).and_then(|listener| {
                listener.set_nonblocking(true)?;
                let address = listener.local_addr()?;
                Ok((service, listener, address))
            });
            listeners.push(bound.map_err(|error| StartError::Port { service, address, error })?);
        }
        let shared = Arc::new(Shared::new(World::new(options)));
        let mut controller = Self { shared, addresses: Vec::new(), threads: Vec::new() };
        for (service, listener, address) in listeners {
            controller.addresses.push((service, address));
            controller.spawn(service.name(), move |shared| serve(shared, service, listener, address))?;
        }
        controller.spawn("control", |shared| control(shared))?;
        Ok(controller)
    }

    fn spawn(
        &mut self,
        name: &str,
        body: impl FnOnce(&Arc<Shared>) + Send + 'static,
    ) -> Result<(), StartError> {
        let shared = Arc::clone(&self.shared);
        let thread = std::thread::Builder::new().name(format!("ur {name}")).spawn(move || body(&shared));
        self.threads.push(thread.map_err(StartError::Thread)?);
        Ok(())
    }

    /// Where a service listens; `None` where the series does not have it.
    #[must_use]
    pub fn address(&self, service: Service) -> Option<SocketAddr> {
        self.addresses.iter().find(|(known, _)| *known == service).map(|(_, address)| *address)
    }

    /// Does what a line of the fault protocol says.
    pub fn obey(&self, line: &str) -> String {
        let answer = faults::obey(&mut self.shared.world(), &self.shared.trouble, line);
        self.shared.end_connections(false);
        answer
    }

    /// Where everything stands, as JSON.
    #[must_use]
    pub fn status(&self) -> String {
        faults::status(&self.shared.world())
    }

    /// Connections that are open now.
    #[cfg(test)]
    pub(crate) fn open_connections(&self) -> usize {
        self.shared.connections().len()
    }

    #[must_use]
    pub fn connections(&self) -> usize {
        self.shared.taken.load(Ordering::Relaxed)
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.shared.end_connections(true);
        for thread in self.threads.drain(..) {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
        self.shared.end_connections(true);
    }
}

/// Cycles at their deadlines. Late ones are made up for at once, and only the newest state is sent.
fn control(shared: &Shared) {
    let rate = shared.world().robot.options.series.rate_hz();
    let period = Duration::from_secs(1) / rate;
    let mut deadline = Instant::now();
    let mut skipped = 0;
    while !shared.stop.load(Ordering::Relaxed) {
        deadline += period;
        let now = Instant::now();
        match deadline.checked_duration_since(now) {
            Some(wait) => std::thread::sleep(wait),
            None if now.duration_since(deadline) > LATEST => deadline = now,
            None => {}
        }
        let mut world = shared.world();
        world.cycle();
        // Late: only the newest state is sent, but never nothing at all.
        skipped += 1;
        if deadline + period > Instant::now() || skipped >= MOST_SKIPPED {
            shared.publish(&mut world);
            skipped = 0;
        }
        // A long program takes a while to be given back: without the lock.
        let retired = world.retired();
        drop(world);
        drop(retired);
    }
}
