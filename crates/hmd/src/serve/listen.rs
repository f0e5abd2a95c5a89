//! The server, on a thread of its own.

use std::convert::Infallible;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::Poll;
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use futures_util::{SinkExt, StreamExt};
use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    CONNECTION, HeaderMap, HeaderName, HeaderValue, SEC_WEBSOCKET_ACCEPT, SEC_WEBSOCKET_KEY, SEC_WEBSOCKET_PROTOCOL,
    SEC_WEBSOCKET_VERSION, UPGRADE,
};
use hyper::service::service_fn;
use hyper::upgrade::{OnUpgrade, Upgraded};
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use sha1_smol::Sha1;
use tokio::time::MissedTickBehavior;
use tokio_websockets::{Limits, Message, ServerBuilder, WebSocketStream};

use super::hub::{Hub, Next};
use super::protocol::{SUBPROTOCOLS, request, server_info};
use crate::local_server::{self, HEAD_MAX, Room, is_local};

/// Connections at once. Viewers stay, one that only asks gives way to the next, and with no such one the next is closed.
const ROOM: Room = Room {
    clients: 16,
    per_address: 8,
};

/// Time between two pings, and time after which a client is taken for gone that answers none and takes nothing else: it misses two of them.
const PING_EVERY: Duration = Duration::from_millis(if cfg!(test) { 100 } else { 15_000 });
const SILENT_MAX: Duration = Duration::from_millis(if cfg!(test) { 1_000 } else { 40_000 });

/// Longest time that one message may take to a client; a dead one is dropped then.
const SEND_MAX: Duration = Duration::from_secs(30);

/// Longest message of a client, bytes: a subscription to everything.
const REQUEST_MAX: usize = 1 << 20;

/// What a key is joined with, by RFC 6455, section 1.3.
const KEY_SUFFIX: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";

type Socket = WebSocketStream<TokioIo<Upgraded>>;

/// Serves the hub from now on; the address with the port that was taken. `session` distinguishes runs; pages of `origins` may ask
/// besides those of this computer.
///
/// # Errors
/// When the address cannot be bound or the thread cannot be started.
pub fn listen(address: SocketAddr, hub: Hub, session: &str, origins: &[String]) -> io::Result<SocketAddr> {
    let (session, origins) = (session.to_owned(), Arc::new(origins.to_owned()));
    local_server::serve(address, "viewers", ROOM, move |stream, established| {
        let (hub, session, origins) = (hub.clone(), session.clone(), origins.clone());
        async move {
            if let Some(upgrade) = shake_hands(stream, &origins).await
                && let Ok(Ok(upgraded)) = tokio::time::timeout(HEAD_MAX, upgrade).await
            {
                established.store(true, Ordering::Relaxed);
                let limits = Limits::default().max_payload_len(Some(REQUEST_MAX));
                let socket = ServerBuilder::new().limits(limits).serve(TokioIo::new(upgraded));
                let (number, wake) = hub.enter();
                // A client that goes away or breaks the protocol is its own affair.
                let _ = attend(socket, &hub, number, &wake, &session).await;
                hub.leave(number);
            }
        }
    })
}

/// Answers the first request; what becomes of the connection if that is ours.
async fn shake_hands(stream: tokio::net::TcpStream, origins: &[String]) -> Option<OnUpgrade> {
    let upgrade = std::sync::Mutex::new(None);
    let service = service_fn(|mut asked: Request<Incoming>| {
        let answer = answer(&asked, origins);
        if answer.status() == StatusCode::SWITCHING_PROTOCOLS
            && let Ok(mut upgrade) = upgrade.lock()
        {
            *upgrade = Some(hyper::upgrade::on(&mut asked));
        }
        async { Ok::<_, Infallible>(answer) }
    });
    let connection = local_server::http()
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    tokio::time::timeout(2 * HEAD_MAX, connection).await.ok()?.ok()?;
    upgrade.into_inner().ok()?
}

/// The handshake of RFC 6455, section 4.2, with one of our protocols.
fn answer(request: &Request<Incoming>, origins: &[String]) -> Response<Full<Bytes>> {
    let headers = request.headers();
    let mut response = Response::new(Full::default());
    if !is_local(headers, origins) {
        *response.status_mut() = StatusCode::FORBIDDEN;
        let page = "expected Host and Origin of this computer, or an origin of --serve-origin\n";
        *response.body_mut() = Full::from(page);
        return response;
    }
    let has = |name: HeaderName, token: &str| tokens(headers, &name).any(|found| found.eq_ignore_ascii_case(token));
    let is_websocket = *request.method() == Method::GET
        && has(UPGRADE, "websocket")
        && has(CONNECTION, "upgrade")
        && has(SEC_WEBSOCKET_VERSION, "13");
    let offered =
        tokens(headers, &SEC_WEBSOCKET_PROTOCOL).find_map(|name| SUBPROTOCOLS.into_iter().find(|of| *of == name));
    let (true, Some(key), Some(protocol)) = (is_websocket, headers.get(SEC_WEBSOCKET_KEY), offered) else {
        *response.status_mut() = StatusCode::BAD_REQUEST;
        let page = format!(
            "expected a WebSocket with one of the protocols {}\n",
            SUBPROTOCOLS.join(", ")
        );
        *response.body_mut() = Full::from(page);
        return response;
    };
    let mut sum = Sha1::from(key.as_bytes());
    sum.update(KEY_SUFFIX.as_bytes());
    *response.status_mut() = StatusCode::SWITCHING_PROTOCOLS;
    let accept = HeaderValue::from_str(&STANDARD.encode(sum.digest().bytes()));
    let headers = response.headers_mut();
    headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
    headers.insert(CONNECTION, HeaderValue::from_static("Upgrade"));
    headers.insert(SEC_WEBSOCKET_ACCEPT, accept.expect("base64 is printable"));
    headers.insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(protocol));
    response
}

/// The words of a header that is a list.
fn tokens<'a>(headers: &'a HeaderMap, name: &HeaderName) -> impl Iterator<Item = &'a str> {
    let values = headers
        .get_all(name)
        .into_iter()
        .filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).map(str::trim)
}

/// Sends what the hub has for a client, and does what it asks, until it goes.
async fn attend(
    mut socket: Socket,
    hub: &Hub,
    number: u64,
    wake: &tokio::sync::Notify,
    session: &str,
) -> Result<(), tokio_websockets::Error> {
    send(&mut socket, Message::text(server_info(session))).await?;
    let mut pings = tokio::time::interval_at(tokio::time::Instant::now() + PING_EVERY, PING_EVERY);
    pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
    // Since when a ping is not answered. A slow client may have much to take before it finds the ping: what it takes is life as well.
    let mut waiting: Option<Instant> = None;
    loop {
        let received = if let Some(next) = hub.next(number) {
            let message = match next {
                Next::Text(text) => Message::text(text),
                Next::Binary(data) => Message::binary(data),
            };
            send(&mut socket, message).await?;
            waiting = waiting.map(|_| Instant::now());
            // What is asked meanwhile is answered however much there is to send.
            let at_once = poll_fn(|context| match socket.poll_next_unpin(context) {
                Poll::Ready(received) => Poll::Ready(Some(received)),
                Poll::Pending => Poll::Ready(None),
            });
            let Some(received) = at_once.await else { continue };
            received
        } else {
            tokio::select! {
                received = socket.next() => received,
                () = wake.notified() => continue,
                _ = pings.tick() => {
                    if waiting.is_some_and(|since| since.elapsed() > SILENT_MAX) {
                        return Ok(());
                    }
                    send(&mut socket, Message::ping("")).await?;
                    waiting.get_or_insert_with(Instant::now);
                    continue;
                }
            }
        };
        waiting = None;
        match received {
            Some(Ok(message)) if message.is_close() => return Ok(()),
            Some(Ok(message)) => {
                if let Some(request) = message.as_text().and_then(request) {
                    hub.request(number, request);
                }
            }
            Some(Err(error)) => return Err(error),
            None => return Ok(()),
        }
    }
}

async fn send(socket: &mut Socket, message: Message) -> Result<(), tokio_websockets::Error> {
    match tokio::time::timeout(SEND_MAX, socket.send(message)).await {
        Ok(sent) => sent,
        Err(_) => Err(io::Error::from(io::ErrorKind::TimedOut).into()),
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;

    use super::*;
    use hmd_core::record::{Log, Record};
    use hmd_storage::recorder::{PublishedRecord, RecordObserver};

    fn hub() -> (Hub, SocketAddr) {
        let hub = Hub::default();
        let address = listen("127.0.0.1:0".parse().unwrap(), hub.clone(), "1", &[]).unwrap();
        (hub, address)
    }

    /// What is answered to a request with these headers, and the connection.
    fn ask(address: SocketAddr, headers: &str) -> (String, TcpStream) {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let request = format!("GET / HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        (String::from_utf8(head).unwrap().to_lowercase(), stream)
    }

    /// The key is the example of RFC 6455, section 1.3.
    const HEADERS: &str = "Upgrade: websocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                           Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
                           Sec-WebSocket-Protocol: other, foxglove.sdk.v1\r\n";

    /// One frame of the server: whether it is text, and what is in it.
    fn frame(stream: &mut TcpStream) -> (bool, Vec<u8>) {
        let mut head = [0; 2];
        stream.read_exact(&mut head).unwrap();
        let mut length = [0; 8];
        let long = match head[1] {
            126 => 2,
            127 => 8,
            short => {
                length[7] = short;
                0
            }
        };
        stream.read_exact(&mut length[8 - long..]).unwrap();
        let mut data = vec![0; u64::from_be_bytes(length) as usize];
        stream.read_exact(&mut data).unwrap();
        match head[0] & 0xf {
            // A ping; no client of these tests answers.
            9 => frame(stream),
            opcode => (opcode == 1, data),
        }
    }

    fn record(at_ns: u64, bytes: usize) -> PublishedRecord {
        PublishedRecord {
            at_ns,
            topic: "/log".to_owned(),
            schema: Log::SCHEMA_NAME,
            descriptor: Log::descriptor,
            data: vec![0; bytes],
        }
    }

    #[test]
    fn only_a_client_with_our_protocol_is_let_in() {
        let (_, address) = hub();
        let (head, mut stream) = ask(address, HEADERS);
        assert!(head.starts_with("http/1.1 101"), "{head}");
        assert!(
            head.contains("sec-websocket-accept: s3pplmbitxaq9kygzzhzrbk+xoo="),
            "{head}"
        );
        assert!(head.contains("sec-websocket-protocol: foxglove.sdk.v1"), "{head}");
        let (is_text, info) = frame(&mut stream);
        assert!(is_text && String::from_utf8(info).unwrap().contains("serverInfo"));
        for headers in [
            String::new(),
            HEADERS.replace("foxglove.sdk.v1", "foxglove.sdk.v9"),
            HEADERS.replace("13", "8"),
            HEADERS.replace("websocket\r", "h2c\r"),
        ] {
            let (head, _) = ask(address, &headers);
            assert!(head.starts_with("http/1.1 400"), "{head}");
        }
    }

    #[test]
    fn a_page_of_another_origin_gets_nothing_and_a_silent_client_is_dropped() {
        let (hub, address) = hub();
        hub.publish(record(0, 1));
        let (head, mut stream) = ask(address, &format!("Origin: https://evil.example\r\n{HEADERS}"));
        assert!(head.starts_with("http/1.1 403"), "{head}");
        let mut rest = Vec::new();
        stream.read_to_end(&mut rest).unwrap();
        assert!(!String::from_utf8_lossy(&rest).contains("serverInfo"));
        let since = Instant::now();
        let (head, mut stream) = ask(address, &format!("Origin: http://localhost:3000\r\n{HEADERS}"));
        assert!(head.starts_with("http/1.1 101"), "{head}");
        // It reads, but answers no ping.
        stream.read_to_end(&mut Vec::new()).unwrap();
        assert!(
            since.elapsed() >= SILENT_MAX && since.elapsed() < 10 * SILENT_MAX,
            "{:?}",
            since.elapsed()
        );
    }

    /// A client that has asked for the only channel and has its newest record.
    fn subscribed(address: SocketAddr) -> TcpStream {
        let (_, mut stream) = ask(address, HEADERS);
        // The channels come; they are asked for in one frame, masked with zeros.
        let told_of: Vec<_> = (0..2).map(|_| frame(&mut stream).1).collect();
        assert!(String::from_utf8_lossy(&told_of[1]).contains("advertise"));
        let subscribe = br#"{"op":"subscribe","subscriptions":[{"id":7,"channelId":0}]}"#;
        let mut asked = vec![0x81, 0x80 | subscribe.len() as u8, 0, 0, 0, 0];
        asked.extend(subscribe);
        stream.write_all(&asked).unwrap();
        assert_eq!(
            frame(&mut stream),
            (false, super::super::protocol::message_data(7, 0, &[0]))
        );
        stream
    }

    #[test]
    fn a_client_that_takes_what_is_sent_is_not_gone() {
        let (hub, address) = hub();
        hub.publish(record(0, 1));
        let mut stream = subscribed(address);
        // It answers no ping, but always has something to read before the next one.
        let since = Instant::now();
        let mut n = 0;
        while since.elapsed() < 3 * SILENT_MAX {
            n += 1;
            hub.publish(record(n, 1));
            assert!(!frame(&mut stream).0);
            std::thread::sleep(PING_EVERY / 5);
        }
        // Nothing more comes, and it is silent.
        let since = Instant::now();
        stream.read_to_end(&mut Vec::new()).unwrap();
        assert!(since.elapsed() < 10 * SILENT_MAX, "{:?}", since.elapsed());
    }

    #[test]
    fn a_client_that_does_not_read_delays_no_other() {
        const RECORDS: u64 = 200;
        let (hub, address) = hub();
        hub.publish(record(0, 1));
        let mut stream = subscribed(address);
        let since = Instant::now();
        for n in 1..=RECORDS {
            hub.publish(record(n, 1 << 20));
        }
        let took = since.elapsed();
        // Where 200 MiB went through the socket, or waited for it, this would be for ever.
        assert!(took < Duration::from_secs(5), "{took:?}");
        let (mut newest, mut left_out) = (0, false);
        while newest < RECORDS {
            let (is_text, data) = frame(&mut stream);
            if is_text {
                left_out |= String::from_utf8(data).unwrap().contains("messages left out");
            } else {
                newest = u64::from_le_bytes(data[5..13].try_into().unwrap());
            }
        }
        assert!(left_out, "what was missed is reported");
    }
}
