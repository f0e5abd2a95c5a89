//! The messages of the protocol, as far as a server that only publishes needs them.
//!
//! Both names of the protocol mean the same for what is used here: JSON text for everything but the data, which come as
//! binary messages.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hmd_core::counted::counted;
use prost::Message;
use serde::Deserialize;
use serde_json::json;

use hmd_storage::recorder::PublishedRecord;

/// Names of the protocol: Lichtblick's and the free client's, and that of the Foxglove application.
pub const SUBPROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];

/// First byte of a binary message with data.
const MESSAGE_DATA: u8 = 1;

/// `status` of the protocol: a warning.
const LEVEL_WARNING: u8 = 1;

/// What a client asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// Data of channels from now on, under numbers of the client's own: (number, channel).
    Subscribe(Vec<(u32, usize)>),
    /// No more of these numbers.
    Unsubscribe(Vec<u32>),
}

#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Received {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

/// Reads what a client sent; `None` for what is not served.
pub(super) fn request(text: &str) -> Option<Request> {
    Some(match serde_json::from_str(text).ok()? {
        Received::Subscribe { subscriptions } => {
            Request::Subscribe(subscriptions.into_iter().map(|of| (of.id, of.channel_id)).collect())
        }
        Received::Unsubscribe { subscription_ids } => Request::Unsubscribe(subscription_ids),
    })
}

/// The first message to a client.
pub(super) fn server_info(session: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": concat!("hmd ", env!("CARGO_PKG_VERSION")),
        "capabilities": [],
        "sessionId": session,
    })
    .to_string()
}

/// A channel as [`advertise`] takes it.
pub(super) fn channel(id: usize, record: &PublishedRecord) -> String {
    json!({
        "id": id,
        "topic": record.topic,
        "encoding": "protobuf",
        "schemaName": record.schema,
        "schemaEncoding": "protobuf",
        "schema": STANDARD.encode((record.descriptor)().encode_to_vec()),
    })
    .to_string()
}

/// Tells of channels.
pub(super) fn advertise<'a>(channels: impl Iterator<Item = &'a str>) -> String {
    let channels: Vec<&str> = channels.collect();
    format!("{{\"op\":\"advertise\",\"channels\":[{}]}}", channels.join(","))
}

/// Says that a client is too slow.
pub(super) fn missed(messages: u64) -> String {
    let messages = counted(messages, "message", "messages");
    let message = format!("{messages} left out: this client takes them too slowly");
    json!({ "op": "status", "level": LEVEL_WARNING, "message": message }).to_string()
}

/// One record for one subscription.
pub(super) fn message_data(subscription: u32, at_ns: u64, data: &[u8]) -> Vec<u8> {
    let mut message = Vec::with_capacity(13 + data.len());
    message.push(MESSAGE_DATA);
    message.extend(subscription.to_le_bytes());
    message.extend(at_ns.to_le_bytes());
    message.extend(data);
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_client_asks_is_read_and_anything_else_is_nothing() {
        let subscribe = r#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":2}]}"#;
        assert_eq!(request(subscribe), Some(Request::Subscribe(vec![(7, 2)])));
        let unsubscribe = r#"{"op":"unsubscribe","subscriptionIds":[7,8]}"#;
        assert_eq!(request(unsubscribe), Some(Request::Unsubscribe(vec![7, 8])));
        for other in [
            "",
            "[]",
            r#"{"op":"advertise","channels":[]}"#,
            r#"{"op":"subscribe","subscriptions":[{"id":-1}]}"#,
        ] {
            assert_eq!(request(other), None, "{other}");
        }
    }

    #[test]
    fn data_carry_their_subscription_and_time() {
        let message = message_data(0x0102, 3, b"x");
        assert_eq!(message, [1, 2, 1, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0, b'x']);
    }
}
