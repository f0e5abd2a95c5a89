//! A server on a thread of its own: nothing that a client does reaches the daemon.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use hyper::header::{HOST, HeaderMap, ORIGIN};
use hyper::http::uri::Authority;
use hyper::server::conn::http1;
use hyper_util::rt::TokioTimer;
use tokio::net::{TcpListener, TcpStream};

/// Longest wait for the head of a request.
pub(crate) const HEAD_MAX: Duration = Duration::from_secs(5);

/// Connections at once.
#[derive(Clone, Copy)]
pub(crate) struct Room {
    /// From all addresses.
    pub(crate) clients: usize,
    /// From one address.
    pub(crate) per_address: usize,
}

/// A connection; set by its attendant once it is more than a request that is waited for.
pub(crate) type Established = Arc<AtomicBool>;

struct Connection {
    address: IpAddr,
    established: Established,
    task: tokio::task::JoinHandle<()>,
}

/// Attends to connections from now on; the address with the port that was taken. Where there is no room, the oldest connection
/// that only asks gives way, so that slow ones delay nobody; without such a one the new one is closed.
///
/// # Errors
/// When the address cannot be bound or the thread cannot be started.
pub(crate) fn serve<A: Future<Output = ()> + Send + 'static>(
    address: SocketAddr,
    thread: &str,
    room: Room,
    attend: impl Fn(TcpStream, Established) -> A + Send + 'static,
) -> io::Result<SocketAddr> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let listener = runtime.block_on(TcpListener::bind(address))?;
    let bound = listener.local_addr()?;
    let accept = async move {
        let mut connections = Vec::new();
        loop {
            let Ok((stream, peer)) = listener.accept().await else {
                // Out of descriptors, for one: not a reason to spin.
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            };
            if make_room(&mut connections, peer.ip(), room) {
                let established = Established::default();
                let task = tokio::spawn(attend(stream, established.clone()));
                connections.push(Connection {
                    address: peer.ip(),
                    established,
                    task,
                });
            }
        }
    };
    let thread = std::thread::Builder::new().name(thread.to_owned());
    thread.spawn(move || runtime.block_on(accept))?;
    Ok(bound)
}

/// Whether there is room for one more connection, oldest first; one that only asks is ended for it.
fn make_room(connections: &mut Vec<Connection>, address: IpAddr, room: Room) -> bool {
    connections.retain(|connection| !connection.task.is_finished());
    let of_address = connections.iter().filter(|of| of.address == address).count();
    let is_full_for_address = of_address >= room.per_address;
    if !is_full_for_address && connections.len() < room.clients {
        return true;
    }
    let oldest = connections
        .iter()
        .position(|of| !of.established.load(Ordering::Relaxed) && (of.address == address || !is_full_for_address));
    if let Some(oldest) = oldest {
        connections.remove(oldest).task.abort();
    }
    oldest.is_some()
}

/// Whether a request is meant for this computer and comes from it: the name that it asks for is one of the loopback interface, and
/// so is the page of a browser that asks, unless its origin is among those allowed. A name of its own that leads here gives a web
/// page nothing.
pub(crate) fn is_local(headers: &HeaderMap, origins: &[String]) -> bool {
    let mut hosts = headers.get_all(HOST).iter();
    let host = hosts.next().and_then(|host| host.to_str().ok());
    let mut from = headers.get_all(ORIGIN).iter();
    let is_allowed = match from.next().map(|origin| origin.to_str()) {
        None => true,
        Some(Ok(origin)) => {
            let page = origin
                .strip_prefix("http://")
                .or_else(|| origin.strip_prefix("https://"));
            page.is_some_and(is_loopback_name) || origins.iter().any(|allowed| allowed == origin)
        }
        Some(Err(_)) => false,
    };
    host.is_some_and(is_loopback_name) && hosts.next().is_none() && is_allowed && from.next().is_none()
}

/// Whether a name, with a port or without, is one of the loopback interface.
fn is_loopback_name(name: &str) -> bool {
    let Ok(authority) = name.parse::<Authority>() else {
        return false;
    };
    let host = authority.host();
    let address = host.trim_start_matches('[').trim_end_matches(']');
    !name.contains('@')
        && (host.eq_ignore_ascii_case("localhost") || address.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback()))
}

/// HTTP for one request on a connection, whose head may not take long.
pub(crate) fn http() -> http1::Builder {
    let mut http = http1::Builder::new();
    http.keep_alive(false)
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_MAX);
    http
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(hyper::header::HeaderName, &'static str)]) -> HeaderMap {
        list.iter()
            .map(|(name, value)| (name.clone(), hyper::header::HeaderValue::from_static(value)))
            .collect()
    }

    #[test]
    fn only_this_computers_names_and_pages_are_local() {
        for host in ["localhost", "LOCALHOST:9464", "127.0.0.1:1", "127.8.8.8", "[::1]:9464"] {
            assert!(is_local(&headers(&[(HOST, host)]), &[]), "{host}");
        }
        for host in [
            "evil.example",
            "localhost.evil.example",
            "192.168.1.2:9464",
            "",
            "x@localhost",
            "[::2]",
        ] {
            assert!(!is_local(&headers(&[(HOST, host)]), &[]), "{host}");
        }
        assert!(!is_local(&headers(&[]), &[]));
        let allowed = ["https://app.example".to_owned()];
        for (origin, local) in [
            ("http://localhost:3000", true),
            ("https://app.example", true),
            ("https://app.example.evil", false),
            ("http://app.example", false),
            ("null", false),
            ("file://", false),
        ] {
            let asked = headers(&[(HOST, "localhost"), (ORIGIN, origin)]);
            assert_eq!(is_local(&asked, &allowed), local, "{origin}");
        }
    }
}
