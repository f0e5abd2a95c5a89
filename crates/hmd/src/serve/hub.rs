//! What viewers receive: channels, the newest record of each, and a bounded queue for each client.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use super::protocol::{self, Request};
use hmd_storage::recorder::{PublishedRecord, RecordObserver};

/// Channels that are advertised: six for each of 1024 actuators, more than any viewer shows.
const CHANNELS_MAX: usize = 6144;

/// Records that wait for one client; then the oldest is left out.
const QUEUE_MAX: usize = 8192;

/// Their bytes, the same.
const QUEUE_BYTES_MAX: usize = 16 << 20;

/// Records of each channel that are kept for those who come later, the newest.
const KEPT_MAX: usize = 64;

/// Their bytes; the newest is kept even if it is larger.
const KEPT_BYTES_MAX: usize = 256 << 10;

/// Bytes kept of all channels together; a channel that has no room gives up its own.
const KEPT_BYTES_TOTAL: usize = 32 << 20;

/// Subscriptions of one client; further ones are left out.
const SUBSCRIPTIONS_MAX: usize = CHANNELS_MAX;

/// Receives the records of a run and queues them for the clients. Clones are the same hub.
#[derive(Clone, Debug, Default)]
pub struct Hub(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    inner: Mutex<Inner>,
    /// A client has come.
    arrived: Notify,
}

#[derive(Debug, Default)]
struct Inner {
    channels: Vec<Channel>,
    by_topic: HashMap<String, usize>,
    /// Bytes kept of all channels.
    kept_bytes: usize,
    clients: BTreeMap<u64, Client>,
    next_client: u64,
}

#[derive(Debug)]
struct Channel {
    advertised: String,
    /// The newest records, the oldest first.
    kept: VecDeque<Arc<Item>>,
    kept_bytes: usize,
}

#[derive(Debug)]
struct Item {
    at_ns: u64,
    data: Vec<u8>,
}

#[derive(Debug, Default)]
struct Client {
    /// Its own numbers of channels.
    subscriptions: BTreeMap<u32, usize>,
    /// Channels advertised to this client.
    advertised: usize,
    queue: VecDeque<(u32, Arc<Item>)>,
    queue_bytes: usize,
    missed: u64,
    /// A message is being sent to this client.
    is_sending: bool,
    wake: Arc<Notify>,
}

/// What is to be sent next.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Next {
    Text(String),
    Binary(Vec<u8>),
}

impl RecordObserver for Hub {
    fn publish(&self, record: PublishedRecord) {
        let inner = &mut *self.lock();
        let Some(channel) = inner.channel(&record) else { return };
        let item = Arc::new(Item {
            at_ns: record.at_ns,
            data: record.data,
        });
        inner.set_newest(channel, &item);
        for client in inner.clients.values_mut() {
            let numbers: Vec<u32> = client.numbers(channel).collect();
            for number in numbers {
                client.push(number, item.clone());
            }
            client.wake.notify_one();
        }
    }
}

impl Hub {
    /// Waits for the first client, or the next one after the last call.
    pub async fn arrived(&self) {
        self.0.arrived.notified().await;
    }

    /// Whether every client was sent all that there is for it.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        let idle = |client: &Client| client.queue.is_empty() && !client.is_sending;
        self.lock().clients.values().all(idle)
    }

    /// A client has come: its number, and what wakes it.
    pub(super) fn enter(&self) -> (u64, Arc<Notify>) {
        let inner = &mut *self.lock();
        let number = inner.next_client;
        inner.next_client += 1;
        let client = Client::default();
        let wake = client.wake.clone();
        inner.clients.insert(number, client);
        self.0.arrived.notify_one();
        (number, wake)
    }

    /// A client has gone.
    pub(super) fn leave(&self, number: u64) {
        self.lock().clients.remove(&number);
    }

    /// Does what a client asks for.
    pub(super) fn request(&self, number: u64, request: Request) {
        let inner = &mut *self.lock();
        let Some(client) = inner.clients.get_mut(&number) else {
            return;
        };
        match request {
            Request::Subscribe(subscriptions) => {
                for (subscription, channel) in subscriptions {
                    let known = inner.channels.get(channel);
                    let taken = client.subscriptions.contains_key(&subscription);
                    let (Some(known), false) = (known, taken || client.subscriptions.len() >= SUBSCRIPTIONS_MAX) else {
                        continue;
                    };
                    client.subscriptions.insert(subscription, channel);
                    for kept in &known.kept {
                        client.push(subscription, kept.clone());
                    }
                }
                client.wake.notify_one();
            }
            Request::Unsubscribe(subscriptions) => {
                for subscription in subscriptions {
                    client.subscriptions.remove(&subscription);
                }
            }
        }
    }

    /// What a client is to be sent next, after the last was: channels before their data, losses before what comes after them.
    pub(super) fn next(&self, number: u64) -> Option<Next> {
        let inner = &mut *self.lock();
        let client = inner.clients.get_mut(&number)?;
        let next = client.next(&inner.channels);
        client.is_sending = next.is_some();
        next
    }

    /// A panic elsewhere leaves whole queues behind.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    /// The channel of a record's topic; `None` for one too many.
    fn channel(&mut self, record: &PublishedRecord) -> Option<usize> {
        if let Some(channel) = self.by_topic.get(&record.topic) {
            return Some(*channel);
        }
        let id = self.channels.len();
        if id >= CHANNELS_MAX {
            return None;
        }
        self.channels.push(Channel {
            advertised: protocol::channel(id, record),
            kept: VecDeque::new(),
            kept_bytes: 0,
        });
        self.by_topic.insert(record.topic.clone(), id);
        Some(id)
    }

    fn set_newest(&mut self, channel: usize, item: &Arc<Item>) {
        let bytes = item.data.len();
        let channel = &mut self.channels[channel];
        while channel.kept.len() >= KEPT_MAX
            || channel.kept_bytes + bytes > KEPT_BYTES_MAX
            || self.kept_bytes + bytes > KEPT_BYTES_TOTAL
        {
            let Some(oldest) = channel.kept.pop_front() else { break };
            channel.kept_bytes -= oldest.data.len();
            self.kept_bytes -= oldest.data.len();
        }
        if self.kept_bytes + bytes <= KEPT_BYTES_TOTAL {
            channel.kept.push_back(item.clone());
            channel.kept_bytes += bytes;
            self.kept_bytes += bytes;
        }
    }
}

impl Client {
    fn next(&mut self, channels: &[Channel]) -> Option<Next> {
        let fresh = &channels[self.advertised..];
        if !fresh.is_empty() {
            self.advertised = channels.len();
            let channels = fresh.iter().map(|channel| channel.advertised.as_str());
            return Some(Next::Text(protocol::advertise(channels)));
        }
        if self.missed > 0 {
            return Some(Next::Text(protocol::missed(std::mem::take(&mut self.missed))));
        }
        let (subscription, item) = self.queue.pop_front()?;
        self.queue_bytes -= item.data.len();
        Some(Next::Binary(protocol::message_data(
            subscription,
            item.at_ns,
            &item.data,
        )))
    }

    fn numbers(&self, channel: usize) -> impl Iterator<Item = u32> {
        let of_channel = self.subscriptions.iter().filter(move |(_, of)| **of == channel);
        of_channel.map(|(number, _)| *number)
    }

    fn push(&mut self, subscription: u32, item: Arc<Item>) {
        self.queue_bytes += item.data.len();
        self.queue.push_back((subscription, item));
        while self.queue.len() > QUEUE_MAX || self.queue_bytes > QUEUE_BYTES_MAX {
            let Some((_, oldest)) = self.queue.pop_front() else {
                return;
            };
            self.queue_bytes -= oldest.data.len();
            self.missed += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::record::{Log, Record};

    fn record(topic: &str, at_ns: u64, bytes: usize) -> PublishedRecord {
        PublishedRecord {
            at_ns,
            topic: topic.to_owned(),
            schema: Log::SCHEMA_NAME,
            descriptor: Log::descriptor,
            data: vec![0; bytes],
        }
    }

    fn all(hub: &Hub, client: u64) -> Vec<Next> {
        std::iter::from_fn(|| hub.next(client)).collect()
    }

    fn times(sent: &[Next]) -> Vec<u8> {
        let binary = sent.iter().filter_map(|next| match next {
            Next::Binary(data) => Some(data[5]),
            Next::Text(_) => None,
        });
        binary.collect()
    }

    #[test]
    fn channels_come_before_data_and_a_late_client_gets_what_was_kept() {
        let hub = Hub::default();
        hub.publish(record("/a", 1, 10));
        hub.publish(record("/a", 2, 10));
        let (client, _) = hub.enter();
        let Some(Next::Text(text)) = hub.next(client) else {
            panic!("a channel first")
        };
        assert!(!hub.is_idle(), "it may be on its way");
        assert!(
            text.contains(r#""op":"advertise""#) && text.contains(r#""topic":"/a""#),
            "{text}"
        );
        hub.publish(record("/a", 3, 10));
        assert_eq!(hub.next(client), None, "nothing that was not asked for");
        hub.request(client, Request::Subscribe(vec![(7, 0), (7, 0), (8, 99)]));
        hub.publish(record("/a", 4, 10));
        assert_eq!(times(&all(&hub, client)), [1, 2, 3, 4]);
        hub.request(client, Request::Unsubscribe(vec![7]));
        hub.publish(record("/a", 5, 10));
        assert_eq!(all(&hub, client), []);
        hub.publish(record("/b", 6, 10));
        assert!(matches!(&all(&hub, client)[..], [Next::Text(text)] if text.contains("/b")));
    }

    #[test]
    fn a_slow_client_misses_the_oldest_and_gets_their_count() {
        let hub = Hub::default();
        hub.publish(record("/a", 0, 1));
        let [(slow, _), (gone, _)] = [hub.enter(), hub.enter()];
        for client in [slow, gone] {
            hub.request(client, Request::Subscribe(vec![(1, 0)]));
        }
        assert_eq!(times(&all(&hub, slow)), [0]);
        for n in 0..QUEUE_MAX + 3 {
            hub.publish(record("/a", n as u64, 1));
        }
        hub.leave(gone);
        assert!(!hub.is_idle());
        let sent = all(&hub, slow);
        assert!(
            matches!(&sent[0], Next::Text(text) if text.contains("3 messages left out")),
            "{:?}",
            sent[0]
        );
        let times = times(&sent);
        assert_eq!((times.len(), times[0], times[1]), (QUEUE_MAX, 3, 4));
        assert!(hub.is_idle());

        for n in 0..5 {
            hub.publish(record("/a", n, QUEUE_BYTES_MAX / 2));
        }
        let sent = all(&hub, slow);
        assert!(matches!(&sent[0], Next::Text(text) if text.contains("3 messages left out")));
        assert_eq!(sent.len(), 1 + 2, "bytes are bounded too");
    }

    #[test]
    fn channels_and_what_is_kept_are_bounded() {
        let hub = Hub::default();
        for n in 0..CHANNELS_MAX + 10 {
            hub.publish(record(&format!("/{n}"), 0, 20 << 10));
        }
        let inner = hub.lock();
        assert_eq!(inner.channels.len(), CHANNELS_MAX);
        let bytes: usize = inner
            .channels
            .iter()
            .flat_map(|channel| &channel.kept)
            .map(|item| item.data.len())
            .sum();
        assert_eq!(inner.kept_bytes, bytes);
        assert!(bytes <= KEPT_BYTES_TOTAL && bytes > KEPT_BYTES_TOTAL / 2, "{bytes}");
    }

    #[test]
    fn a_channel_keeps_its_newest_records() {
        let hub = Hub::default();
        for n in 0..100 {
            hub.publish(record("/small", n, 10));
            hub.publish(record("/large", n, 100 << 10));
        }
        hub.publish(record("/huge", 7, KEPT_BYTES_MAX + 1));
        let inner = hub.lock();
        let kept: Vec<_> = inner
            .channels
            .iter()
            .map(|channel| (channel.kept.len(), channel.kept.back().unwrap().at_ns))
            .collect();
        assert_eq!(kept, [(KEPT_MAX, 99), (2, 99), (1, 7)]);
    }
}
