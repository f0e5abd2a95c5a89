//! A server on a thread of its own: nothing that a client does reaches the daemon.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::TokioTimer;
use tokio::net::TcpStream;
use tokio::sync::Semaphore;

/// Longest wait for the head of a request.
pub(crate) const HEAD_MAX: Duration = Duration::from_secs(5);

/// Attends to at most `clients_max` connections at once from now on, further ones wait in the kernel; the address with the port that
/// was taken.
///
/// # Errors
/// When the address cannot be bound or the thread cannot be started.
pub(crate) fn serve<A: Future<Output = ()> + Send + 'static>(
    address: SocketAddr,
    thread: &str,
    clients_max: usize,
    attend: impl Fn(TcpStream) -> A + Send + 'static,
) -> io::Result<SocketAddr> {
    let listener = TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    let bound = listener.local_addr()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let listener = {
        let _inside = runtime.enter();
        tokio::net::TcpListener::from_std(listener)?
    };
    let accept = async move {
        let clients = Arc::new(Semaphore::new(clients_max));
        while let Ok(permit) = clients.clone().acquire_owned().await {
            let Ok((stream, _)) = listener.accept().await else {
                // Out of descriptors, for one: not a reason to spin.
                tokio::time::sleep(HEAD_MAX).await;
                continue;
            };
            let attended = attend(stream);
            tokio::spawn(async move {
                attended.await;
                drop(permit);
            });
        }
    };
    let thread = std::thread::Builder::new().name(thread.to_owned());
    thread.spawn(move || runtime.block_on(accept))?;
    Ok(bound)
}

/// HTTP for one request on a connection, whose head may not take long.
pub(crate) fn http() -> http1::Builder {
    let mut http = http1::Builder::new();
    http.keep_alive(false)
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_MAX);
    http
}
