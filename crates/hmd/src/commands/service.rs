//! Notifications to the service manager (`sd_notify`); without one, nothing happens.

use std::ffi::OsStr;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

use sd_notify::NotifyState;

/// Sources and output are open, or a reload is over.
pub(super) fn ready() {
    notify(&[NotifyState::Ready]);
}

/// Everything makes progress. The watch does not wait for its manager: one that does not read misses some of them.
pub(super) fn heartbeat() {
    tell(&[NotifyState::Watchdog], None);
}

/// A reload begins; newer managers want to know since when.
pub(super) fn reloading() {
    match NotifyState::monotonic_usec_now() {
        Ok(since) => notify(&[NotifyState::Reloading, since]),
        Err(_) => notify(&[NotifyState::Reloading]),
    }
}

/// The end has begun.
pub(super) fn stopping() {
    notify(&[NotifyState::Stopping]);
}

/// Longest time that a message waits for a manager that does not read.
const WAIT: Duration = Duration::from_secs(1);

fn notify(states: &[NotifyState<'_>]) {
    tell(states, Some(WAIT));
}

fn tell(states: &[NotifyState<'_>], wait: Option<Duration>) {
    if let Some(socket) = std::env::var_os("NOTIFY_SOCKET") {
        // A failure cannot be reported; a manager that gets no notification acts by itself.
        let _ = send(&socket, states, wait);
    }
}

/// Sends one datagram; without a time to wait only if there is room for it.
fn send(socket: &OsStr, states: &[NotifyState<'_>], wait: Option<Duration>) -> io::Result<()> {
    let own = UnixDatagram::unbound()?;
    match socket.as_bytes().strip_prefix(b"@") {
        Some(name) => own.connect_addr(&SocketAddr::from_abstract_name(name)?)?,
        None => own.connect(socket)?,
    }
    match wait {
        Some(wait) => own.set_write_timeout(Some(wait))?,
        None => own.set_nonblocking(true)?,
    }
    let text: String = states.iter().map(|state| format!("{state}\n")).collect();
    own.send(text.as_bytes()).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_that_does_not_read_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).unwrap();
        let heartbeat = || send(path.as_os_str(), &[NotifyState::Watchdog], None);
        let full = (0..10_000)
            .find_map(|_| heartbeat().err())
            .expect("a queue with an end");
        assert_eq!(full.kind(), io::ErrorKind::WouldBlock);
        let stopping = || {
            send(
                path.as_os_str(),
                &[NotifyState::Stopping],
                Some(Duration::from_millis(20)),
            )
        };
        assert_eq!(stopping().unwrap_err().kind(), io::ErrorKind::WouldBlock);
        let mut text = [0; 64];
        let length = manager.recv(&mut text).unwrap();
        assert_eq!(&text[..length], b"WATCHDOG=1\n");
        stopping().unwrap();
    }

    #[test]
    fn an_abstract_name_is_a_socket_too() {
        let name = format!("hmd-test-{}", std::process::id());
        let manager = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap();
        send(format!("@{name}").as_ref(), &[NotifyState::Ready], None).unwrap();
        let mut text = [0; 64];
        let length = manager.recv(&mut text).unwrap();
        assert_eq!(&text[..length], b"READY=1\n");
    }
}
