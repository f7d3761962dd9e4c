//! Ports over shared memory: the only file of the daemon that names the middleware.
//!
//! Contract: ports are made in the thread that uses them. The real-time ends neither block nor allocate
//! unless a peer came or went since the last call (then 20 to 40 allocations and about 100 us, which cannot
//! be avoided; see [`PeerWatch`] for how they are distinguished).

use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeBuilder, SignalHandlingMode, ipc};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use foretrace_control::follower::{EnableReading, JointReading};
use foretrace_control::predict::ExternalPreview;
use foretrace_control::units::Stamp;
use foretrace_shm as shm;
use foretrace_shm::{
    ControlServer, HeaderBounds, Instance, Message, Publisher, ServiceError, Services, Subscriber,
};

use super::{Inbox, PEN_PER_TICK, PortTally, Ports};
use crate::wire::{self, Outgoing, Refused};

/// The real-time thread's ports.
#[derive(Debug)]
pub struct ShmPorts {
    pen: Subscriber<shm::PenSample>,
    joints: Subscriber<shm::JointState>,
    enable: Subscriber<shm::Enable>,
    previews: Subscriber<shm::PenPreview>,
    commands: Publisher<shm::JointCommand>,
    steps: Publisher<shm::PenStep>,
    /// Previews that a newer one of the same tick replaced.
    replaced: u64,
    tally: PortTally,
}

impl ShmPorts {
    /// Opens them in the calling thread.
    ///
    /// # Errors
    ///
    /// As the middleware's, see [`ServiceError`].
    pub fn open(services: &Services) -> Result<Self, ServiceError> {
        Ok(Self {
            pen: services.pen.subscriber(shm::PenSample::QOS.buffer, HeaderBounds::DEFAULT)?,
            joints: services.joint_state.subscriber(8, HeaderBounds::DEFAULT)?,
            enable: services.enable.subscriber(shm::Enable::QOS.buffer, HeaderBounds::DEFAULT)?,
            previews: services.preview.subscriber(shm::PenPreview::QOS.buffer, HeaderBounds::DEFAULT)?,
            commands: services.joint_cmd.publisher()?,
            steps: services.pen_step.publisher()?,
            replaced: 0,
            tally: PortTally::default(),
        })
    }
}

impl Ports for ShmPorts {
    fn receive(&mut self, now: Stamp, inbox: &mut Inbox) {
        inbox.clear();
        let mut taken = 0;
        while taken < PEN_PER_TICK
            && let Some(sample) = self.pen.take()
        {
            taken += 1;
            if let Ok(sample) = sample {
                inbox.push_pen(wire::pen_reading(&sample, now));
            }
        }
        // Usually the newest command only, but a stop between two ticks must not be skipped.
        let (mut allowed, mut stop) = (true, false);
        self.joints.drain(|state| {
            let reading = wire::joint_reading(&state);
            allowed &= reading.motion_allowed;
            inbox.joints = Some(JointReading { motion_allowed: allowed, ..reading });
            inbox.effort = wire::effort_reading(&state);
            inbox.echo = wire::echo(&state);
            (self.tally.arm_line, self.tally.arm_note) = (state.line, state.note);
        });
        self.enable.drain(|enable| {
            let reading = wire::enable_reading(&enable);
            stop |= reading.stop;
            inbox.enable = Some(EnableReading { stop, ..reading });
        });
        if inbox.asks_previews {
            let came = self.previews.drain(|message| inbox.preview = Some(wire::external_preview(&message)));
            let process = self.previews.restarts();
            inbox.preview = inbox.preview.map(|preview| ExternalPreview { sender: process, ..preview });
            self.replaced += came.saturating_sub(1) as u64;
            // Before the tick that closes a step; if it fails, sending that step does, and is counted.
            let _ = self.steps.connect();
        }

        let tally = &mut self.tally;
        // Connects an arm that appeared while nothing was commanded, before the first tick that moves.
        tally.commands_failed += u64::from(self.commands.connect().is_err());
        tally.pen_deferred += u64::from(taken == PEN_PER_TICK);
        tally.pen_received = self.pen.received();
        tally.pen_dropped = self.pen.dropped();
        tally.pen_rejected = self.pen.rejections().by_reason;
        tally.joints_received = self.joints.received();
        tally.joints_dropped = self.joints.dropped();
        tally.joints_rejected = self.joints.rejections().by_reason;
        tally.enable_rejected = self.enable.rejections().total();
        tally.enable_dropped = self.enable.dropped();
        tally.previews_rejected = self.previews.rejections().total();
        tally.previews_lost = self.replaced + self.previews.dropped();
        tally.pen_refused = refused(&self.pen);
        tally.joints_refused = refused(&self.joints);
        tally.enable_refused = refused(&self.enable);
        tally.receive_failures =
            self.pen.failures() + self.joints.failures() + self.enable.failures() + self.previews.failures();
    }

    fn send(&mut self, now: Stamp, outgoing: &Outgoing) -> bool {
        let message = wire::joint_command(outgoing, now);
        let sent = self.commands.publish(outgoing.command.stamp.0, message).is_ok();
        *(if sent { &mut self.tally.commands_sent } else { &mut self.tally.commands_failed }) += 1;
        sent
    }

    fn send_step(&mut self, now: Stamp, step: shm::PenStep) {
        self.tally.steps_failed += u64::from(self.steps.publish(now.0, step).is_err());
    }

    fn tally(&self) -> &PortTally {
        &self.tally
    }
}

fn refused<T: Message>(subscriber: &Subscriber<T>) -> Option<Refused> {
    subscriber.newest_refused().map(|(why, at_ns)| Refused { why, at: Stamp(at_ns) })
}

/// The ipc thread's ports.
#[derive(Debug)]
pub struct IpcPorts {
    /// Tick records for telemetry.
    pub telemetry: Publisher<shm::TickRecord>,
    pub status: Publisher<shm::Status>,
    /// Inputs of the ticks for recordings.
    pub inputs: Publisher<shm::TickInput>,
    /// Settings, weights and states in pieces.
    pub pieces: Publisher<shm::Piece>,
    /// What the arm's process says of its arm.
    pub notes: Subscriber<shm::ArmNote>,
    pub control: ControlServer,
    pub watch: PeerWatch,
    config: Config,
}

impl IpcPorts {
    /// Opens them in the calling thread; `daemon_id` goes into every answer.
    ///
    /// # Errors
    ///
    /// As the middleware's, see [`ServiceError`].
    pub fn open(services: &Services, instance: &Instance, daemon_id: u64) -> Result<Self, ServiceError> {
        let config = instance.config().clone();
        Ok(Self {
            telemetry: services.telemetry.publisher()?,
            status: services.status.publisher()?,
            inputs: services.inputs.publisher()?,
            pieces: services.pieces.publisher()?,
            notes: services.arm_note.subscriber(shm::ArmNote::QOS.buffer, HeaderBounds::DEFAULT)?,
            control: services.control.server(daemon_id)?,
            watch: PeerWatch::open(&config)?,
            config,
        })
    }

    /// Removes what dead peers of this instance left behind; returns how many were cleaned away.
    #[must_use]
    pub fn clean_up_dead_peers(&self) -> u64 {
        Node::<ipc::Service>::try_cleanup_dead_nodes(&self.config).cleanups
    }
}

/// Observes which peers are connected to the real-time ports.
///
/// A count is not enough: a killed peer is often removed and replaced between two looks. Listing peers
/// allocates, so this is for another thread.
#[derive(Debug)]
pub struct PeerWatch {
    // Keeps the factories valid.
    _node: Node<ipc::Service>,
    pen: PortFactory<ipc::Service, shm::PenSample, ()>,
    joints: PortFactory<ipc::Service, shm::JointState, ()>,
    enable: PortFactory<ipc::Service, shm::Enable, ()>,
    commands: PortFactory<ipc::Service, shm::JointCommand, ()>,
    previews: PortFactory<ipc::Service, shm::PenPreview, ()>,
    steps: PortFactory<ipc::Service, shm::PenStep, ()>,
}

impl PeerWatch {
    /// Opens the services for observation only.
    ///
    /// # Errors
    ///
    /// The middleware refuses.
    pub fn open(config: &Config) -> Result<Self, ServiceError> {
        let node = NodeBuilder::new()
            .config(config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| ServiceError::Middleware { service: "foretrace", detail: error.to_string() })?;
        Ok(Self {
            pen: open(&node)?,
            joints: open(&node)?,
            enable: open(&node)?,
            commands: open(&node)?,
            previews: open(&node)?,
            steps: open(&node)?,
            _node: node,
        })
    }

    /// A number that changes whenever a peer connects or disconnects.
    #[must_use]
    pub fn fingerprint(&self) -> u128 {
        let mut sum = 0_u128;
        let mut add =
            |id: u128| sum = sum.wrapping_add(id.wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835));
        publishers(&self.pen, &mut add);
        publishers(&self.joints, &mut add);
        publishers(&self.enable, &mut add);
        publishers(&self.previews, &mut add);
        subscribers(&self.commands, &mut add);
        subscribers(&self.steps, &mut add);
        sum
    }
}

fn publishers<T: Message>(service: &PortFactory<ipc::Service, T, ()>, add: &mut impl FnMut(u128)) {
    service.dynamic_config().list_publishers(|peer| {
        add(peer.publisher_id.value());
        CallbackProgression::Continue
    });
}

fn subscribers<T: Message>(service: &PortFactory<ipc::Service, T, ()>, add: &mut impl FnMut(u128)) {
    service.dynamic_config().list_subscribers(|peer| {
        add(peer.subscriber_id.value());
        CallbackProgression::Continue
    });
}

fn open<T: Message>(node: &Node<ipc::Service>) -> Result<PortFactory<ipc::Service, T, ()>, ServiceError> {
    let failed = |detail| ServiceError::Middleware { service: T::SERVICE, detail };
    let name = T::SERVICE.try_into().map_err(|error| failed(format!("{error:?}")))?;
    node.service_builder(&name).publish_subscribe::<T>().open().map_err(|error| failed(error.to_string()))
}
