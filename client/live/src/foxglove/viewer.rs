//! One viewer: its messages in, topics and answers out.
//!
//! Contract: every wait is bounded. A viewer that sends too much, takes nothing for too long or falls silent
//! is let go, and counted; what it did not take in time is dropped, the oldest first.

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use foretrace_serve::metered::Metered;
use foretrace_serve::websocket::{Bytes, Incoming, Message as Packet, Socket, SocketLimits};

use super::guard::{Admitted, ViewerDoor};
use super::hub::{Hub, ViewerParameters, ViewerQueue};
use super::orders::{OrderAnswer, OrderKind, Orders};
use super::protocol::{self, CHANNELS, StatusLevel, ViewerMessage, ViewerService, ViewerSetting};

/// Longest wait for a message, and so between two looks at the queue.
const WAIT: Duration = Duration::from_millis(2);
/// Longest time for which one write may hold the viewer's thread up.
const WRITE: Duration = Duration::from_millis(20);
/// A viewer that has nothing to say answers the pings.
const LIMITS: SocketLimits = SocketLimits {
    message_bytes: protocol::MESSAGE_BYTES,
    messages_per_s: 500,
    write_buffer: 32 << 10,
    stuck: Duration::from_secs(5),
    silent: Duration::from_secs(20),
};
const PING: Duration = Duration::from_secs(5);
/// Between two messages of the time.
const TIME: Duration = Duration::from_millis(100);
/// Most subscriptions of a viewer; two to one channel are legal.
const SUBSCRIPTIONS: usize = 64;

/// An answer on its way back.
enum OrderReply {
    Call { service: u32, call: u32, answer: OrderAnswer },
    Set { names: Vec<String>, id: Option<String>, answer: OrderAnswer },
}

/// Values that were asked for before they are known.
struct Due {
    names: Vec<String>,
    id: Option<String>,
    /// Parameters have to be shown more often than so.
    after: u64,
}

pub(crate) struct Viewer<'a> {
    socket: Socket<Metered<TcpStream>>,
    hub: &'a Arc<Hub>,
    queue: &'a Arc<ViewerQueue>,
    door: &'a ViewerDoor,
    orders: &'a Orders,
    controls: bool,
    /// Channel of each subscription, by its number.
    subscriptions: BTreeMap<u32, usize>,
    /// Names of parameters of which changes are told; `None`: of none.
    followed: Option<Vec<String>>,
    told: Arc<ViewerParameters>,
    due: Vec<Due>,
    replies: Sender<OrderReply>,
    answers: Receiver<OrderReply>,
    pinged: Instant,
    timed: Instant,
}

impl<'a> Viewer<'a> {
    /// A viewer on a connection that has been upgraded.
    pub(crate) fn new(
        stream: Metered<TcpStream>,
        admitted: Admitted,
        (hub, queue): (&'a Arc<Hub>, &'a Arc<ViewerQueue>),
        door: &'a ViewerDoor,
        orders: &'a Orders,
    ) -> Self {
        let (replies, answers) = channel();
        let now = Instant::now();
        // One that fails is noticed at the first packet.
        let _ = stream
            .get_ref()
            .set_read_timeout(Some(WAIT))
            .and_then(|()| stream.get_ref().set_write_timeout(Some(WRITE)))
            .and_then(|()| stream.get_ref().set_nodelay(true));
        Self {
            socket: Socket::new(stream, LIMITS),
            hub,
            queue,
            door,
            orders,
            controls: admitted.controls,
            subscriptions: BTreeMap::new(),
            followed: None,
            told: Arc::default(),
            due: Vec::new(),
            replies,
            answers,
            pinged: now,
            timed: now,
        }
    }

    /// Serves the viewer until it ends.
    pub(crate) fn serve(mut self, session: &str) {
        self.say(&protocol::server_info(session));
        self.say(&protocol::advertise());
        self.say(&protocol::advertise_services());
        if let Some(reason) = self.talk() {
            self.hub.refuse(reason);
            // It may not read any more.
            self.say(&protocol::status(StatusLevel::Error, reason, None));
        }
        drop(self.socket.close());
    }

    /// Until it ends; why it is let go, if it is.
    fn talk(&mut self) -> Option<&'static str> {
        while !self.hub.is_over() {
            match self.socket.receive() {
                Ok(Incoming::Message(Packet::Text(text))) => self.hear(protocol::text(text.as_str())),
                Ok(Incoming::Message(packet)) => self.hear(protocol::binary(&packet.into_data())),
                Ok(Incoming::Nothing) => {}
                Ok(Incoming::Closed | Incoming::Broken) => return None,
                Err(reason) => return Some(reason),
            }
            while let Ok(reply) = self.answers.try_recv() {
                self.answer(reply);
            }
            if let Err(reason) = self.socket.push() {
                return Some(reason);
            }
            if !self.socket.is_stuck() {
                self.show();
            }
        }
        None
    }

    /// Sends what has come, the time, and parameters that changed.
    fn show(&mut self) {
        let (words, mut data) = self.queue.take();
        words.iter().for_each(|words| self.say(words));
        let mut sent = 0;
        while !self.socket.is_stuck()
            && let Some(data) = data.pop_front()
        {
            for (id, _) in self.subscriptions.iter().filter(|(_, channel)| **channel == data.channel) {
                let packet = protocol::message_data(*id, data.time_ns, &data.bytes);
                sent += 1;
                self.socket.send(Packet::Binary(packet.into()));
            }
        }
        let dropped = if data.is_empty() { 0 } else { self.queue.put_back(data) };
        if sent + dropped > 0 {
            self.hub
                .count(|tally| (tally.sent, tally.dropped) = (tally.sent + sent, tally.dropped + dropped));
        }
        if self.timed.elapsed() >= TIME {
            self.timed = Instant::now();
            let now_ns = self.hub.now_ns.load(Ordering::Relaxed);
            self.write(Packet::Binary(protocol::time(now_ns).into()));
        }
        if self.pinged.elapsed() >= PING {
            self.pinged = Instant::now();
            self.write(Packet::Ping(Bytes::new()));
        }
        let (shown, newest) = self.hub.parameters();
        if let Some(followed) = &self.followed
            && !Arc::ptr_eq(&newest, &self.told)
        {
            let changed = newest.changed_since(&self.told).named(followed);
            self.told = newest.clone();
            if !changed.is_empty() {
                self.say(&protocol::parameter_values(&changed, None));
            }
        }
        let (ready, due) = self.due.drain(..).partition(|due| shown > due.after);
        self.due = due;
        let ready: Vec<Due> = ready;
        for Due { names, id, .. } in ready {
            self.say(&protocol::parameter_values(&newest.named(&names), id.as_deref()));
        }
        self.socket.flush();
    }

    fn say(&mut self, text: &str) {
        self.write(Packet::text(text));
    }

    fn write(&mut self, packet: Packet) {
        self.socket.send(packet);
    }

    fn tell(&mut self, level: StatusLevel, words: &str) {
        self.say(&protocol::status(level, words, None));
    }

    fn hear(&mut self, said: Result<ViewerMessage, &'static str>) {
        match said {
            Ok(said) => self.carry_out(said),
            Err(reason) => {
                self.hub.refuse(reason);
                self.tell(StatusLevel::Warning, reason);
            }
        }
    }

    fn carry_out(&mut self, said: ViewerMessage) {
        match said {
            ViewerMessage::Subscribe(wanted) => {
                wanted.into_iter().for_each(|(id, channel)| self.subscribe(id, channel))
            }
            ViewerMessage::Unsubscribe(ids) => {
                for id in ids {
                    if self.subscriptions.remove(&id).is_none() {
                        self.refuse("unknown subscription");
                    }
                }
                self.want();
            }
            ViewerMessage::GetParameters(names, id) => {
                // Before the first status there is nothing to tell.
                self.answer_with(Due { names, id, after: 0 });
            }
            ViewerMessage::SubscribeParameters(names) => {
                // An empty list stands for all.
                let all = names.is_empty() || self.followed.as_ref().is_some_and(Vec::is_empty);
                let mut followed = self.followed.take().unwrap_or_default();
                followed.extend(names);
                followed.truncate(if all { 0 } else { SUBSCRIPTIONS });
                self.followed = Some(followed);
                self.told = Arc::default();
            }
            ViewerMessage::UnsubscribeParameters(names) => {
                if names.is_empty() {
                    self.followed = None;
                } else if let Some(followed) = &mut self.followed {
                    followed.retain(|name| !names.contains(name));
                    self.followed = self.followed.take().filter(|left| !left.is_empty());
                }
            }
            ViewerMessage::SetParameters(settings, id) => self.set(settings, id),
            ViewerMessage::Call { service, call, token } => self.call(service, call, token.as_deref()),
        }
    }

    fn refuse(&mut self, reason: &'static str) {
        self.hear(Err(reason));
    }

    fn answer_with(&mut self, due: Due) {
        self.due.push(due);
        if self.due.len() > SUBSCRIPTIONS {
            self.due.remove(0);
            self.refuse("too many questions at once");
        }
    }

    fn subscribe(&mut self, id: u32, channel: u64) {
        let index = usize::try_from(channel).ok().and_then(|channel| channel.checked_sub(1));
        match index.filter(|index| *index < CHANNELS.len()) {
            None => self.refuse("unknown channel"),
            Some(_) if self.subscriptions.contains_key(&id) => self.refuse("subscription in use"),
            Some(_) if self.subscriptions.len() >= SUBSCRIPTIONS => self.refuse("too many subscriptions"),
            Some(index) => {
                self.subscriptions.insert(id, index);
                self.want();
                if let Some(data) = self.hub.kept(index) {
                    self.hub.count(|tally| tally.sent += 1);
                    let packet = protocol::message_data(id, data.time_ns, &data.bytes);
                    self.write(Packet::Binary(packet.into()));
                }
            }
        }
    }

    /// Tells the publisher what is subscribed to.
    fn want(&self) {
        let wanted = self.subscriptions.values().fold(0, |bits, channel| bits | (1 << channel));
        self.queue.wanted.store(wanted, Ordering::Relaxed);
    }

    fn set(&mut self, settings: Vec<(String, ViewerSetting)>, id: Option<String>) {
        if !self.controls {
            self.hub.refuse("without the token");
            self.tell(
                StatusLevel::Error,
                "to set parameters, open this server's address with ?token= and the token it printed",
            );
            let names = settings.into_iter().map(|(name, _)| name).collect();
            return self.answer_with(Due { names, id, after: 0 });
        }
        for (name, setting) in settings {
            let (replies, id) = (self.replies.clone(), id.clone());
            let back = move |answer| drop(replies.send(OrderReply::Set { names: vec![name], id, answer }));
            self.orders.pass(OrderKind::Set(setting), Box::new(back));
        }
    }

    fn call(&mut self, service: u32, call: u32, token: Option<&str>) {
        let replies = self.replies.clone();
        let back = move |answer| drop(replies.send(OrderReply::Call { service, call, answer }));
        match ViewerService::ALL.into_iter().find(|known| known.id() == service) {
            // Anybody may stop the arm, in the way that needs no middleware.
            Some(ViewerService::Stop) => {
                self.hub.count(|tally| tally.stops += 1);
                self.orders.stop(Box::new(back));
            }
            Some(ViewerService::Arm) => {
                let may = token.map_or(self.controls, |token| self.door.token.is(token));
                if may {
                    self.orders.pass(OrderKind::Arm, Box::new(back));
                } else {
                    self.hub.refuse("without the token");
                    let words = "to arm, give the token that this server printed: {\"token\": \"...\"}";
                    self.say(&protocol::call_failed(service, call, words));
                }
            }
            None => {
                self.hub.refuse("unknown service");
                self.say(&protocol::call_failed(service, call, "there is no such service"));
            }
        }
    }

    fn answer(&mut self, reply: OrderReply) {
        match reply {
            OrderReply::Call { service, call, answer: Ok(words) } => {
                self.write(Packet::Binary(protocol::call_done(service, call, &words).into()));
            }
            OrderReply::Call { service, call, answer: Err(words) } => {
                self.say(&protocol::call_failed(service, call, &words));
            }
            OrderReply::Set { names, id, answer } => {
                if let Err(words) = answer {
                    self.tell(StatusLevel::Error, &words);
                }
                // The status after this one shows it.
                self.answer_with(Due { names, id, after: self.hub.parameters().0 + 1 });
            }
        }
    }
}
