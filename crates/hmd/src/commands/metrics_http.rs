//! The metrics over HTTP, on this computer alone, and only when asked for.
//!
//! Few connections at once; a client that says nothing for [`HEAD_MAX`] is dropped, and one that is slow delays no other.

use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};

use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{CONTENT_TYPE, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;

use crate::local_server::{self, HEAD_MAX, Room, is_local};

/// Connections at once. Where all are taken, the oldest is ended, answered or not.
const ROOM: Room = Room {
    clients: 16,
    per_address: 8,
};

/// What `prometheus-client` writes.
const OPEN_METRICS: HeaderValue =
    HeaderValue::from_static("application/openmetrics-text; version=1.0.0; charset=utf-8");

/// The newest metrics, shared with the thread that serves them.
#[derive(Clone, Debug, Default)]
pub(super) struct Page(Arc<Mutex<String>>);

impl Page {
    /// Replaces the text.
    pub(super) fn set(&self, text: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }

    fn text(&self) -> String {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// An address of this computer alone.
///
/// # Errors
/// One sentence for the command line.
pub(super) fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr = text.parse().map_err(|_| "expected ADDRESS:PORT".to_owned())?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("expected an address of this computer alone, as 127.0.0.1:9464 or [::1]:9464".to_owned())
    }
}

/// Serves the page at `/metrics` from now on; the address with the port that was taken.
///
/// # Errors
/// When the address cannot be bound or the thread cannot be started.
pub(super) fn serve(address: SocketAddr, page: Page) -> io::Result<SocketAddr> {
    local_server::serve(address, "metrics", ROOM, move |stream, _| {
        let page = page.clone();
        async move {
            let answered = local_server::http().serve_connection(
                TokioIo::new(stream),
                service_fn(|request| respond(request, page.text())),
            );
            // A client that goes away or is too slow is its own affair.
            let _ = tokio::time::timeout(2 * HEAD_MAX, answered).await;
        }
    })
}

async fn respond(request: Request<Incoming>, page: String) -> Result<Response<Full<Bytes>>, Infallible> {
    let mut response = Response::new(Full::default());
    if !is_local(request.headers(), &[]) {
        *response.status_mut() = StatusCode::FORBIDDEN;
    } else if request.uri().path() != "/metrics" {
        *response.status_mut() = StatusCode::NOT_FOUND;
    } else if !matches!(*request.method(), Method::GET | Method::HEAD) {
        *response.status_mut() = StatusCode::METHOD_NOT_ALLOWED;
    } else {
        response.headers_mut().insert(CONTENT_TYPE, OPEN_METRICS);
        *response.body_mut() = Full::from(page);
    }
    Ok(response)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;
    use std::time::{Duration, Instant};

    use super::*;

    fn request(address: SocketAddr, text: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        let mut response = String::new();
        stream.read_to_string(&mut response).unwrap();
        response
    }

    #[test]
    fn the_page_is_served_and_nothing_else() {
        let page = Page::default();
        let address = serve("127.0.0.1:0".parse().unwrap(), page.clone()).unwrap();
        page.set("hmd_samples_total 3\n# EOF\n".to_owned());
        // Clients that say nothing, however many, keep nobody out.
        let _silent = [(); 100].map(|()| TcpStream::connect(address).unwrap());
        let since = Instant::now();
        let text = request(address, "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
        assert!(text.starts_with("HTTP/1.1 200 OK\r\n"), "{text}");
        assert!(text.contains("application/openmetrics-text"), "{text}");
        assert!(text.ends_with("hmd_samples_total 3\n# EOF\n"), "{text}");
        assert!(since.elapsed() < Duration::from_secs(1), "{:?}", since.elapsed());
        let of_a_page = "GET /metrics HTTP/1.1\r\nHost: localhost\r\nOrigin: http://evil.example\r\n\r\n";
        for foreign in ["GET /metrics HTTP/1.1\r\nHost: evil.example\r\n\r\n", of_a_page] {
            let text = request(address, foreign);
            assert!(
                text.starts_with("HTTP/1.1 403") && !text.contains("hmd_samples"),
                "{text}"
            );
        }
        let other = request(address, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
        assert!(other.starts_with("HTTP/1.1 404"), "{other}");
        let post = request(
            address,
            "POST /metrics HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n",
        );
        assert!(post.starts_with("HTTP/1.1 405"), "{post}");
        assert!(request(address, "rubbish\r\n\r\n").starts_with("HTTP/1.1 400"));
    }

    #[test]
    fn only_this_computer_may_ask() {
        assert!(loopback("127.0.0.1:9464").is_ok());
        assert!(loopback("[::1]:9464").is_ok());
        for refused in ["0.0.0.0:9464", "192.168.1.2:9464", "[::]:9464", "localhost", "9464"] {
            assert!(loopback(refused).is_err(), "{refused}");
        }
    }
}
