//! What an operator should read, as entries of systemd's journal with fields, where stderr is the journal.
//!
//! The native protocol: a datagram of `FIELD=value` lines. A journal that does not take an entry is no reason to stop; the line
//! then goes to stderr, which the journal reads as well.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;

use hmd_core::record::LogLevel;

/// Where the journal listens.
const SOCKET: &str = "/run/systemd/journal/socket";

/// Says of a process which device and inode of its stderr, or stdout, is the journal's.
const STREAM: &str = "JOURNAL_STREAM";

/// The journal's end.
#[derive(Debug)]
pub(super) struct Journal(UnixDatagram);

impl Journal {
    /// The journal, if stderr is it.
    pub(super) fn of_stderr() -> Option<Self> {
        let stream = std::env::var(STREAM).ok()?;
        let (device, inode) = stream.split_once(':')?;
        let stderr = rustix::fs::fstat(io::stderr()).ok()?;
        let is_it = device.parse() == Ok(stderr.st_dev) && inode.parse() == Ok(stderr.st_ino);
        if is_it { Self::at(Path::new(SOCKET)).ok() } else { None }
    }

    fn at(socket: &Path) -> io::Result<Self> {
        let own = UnixDatagram::unbound()?;
        own.connect(socket)?;
        // The watch does not wait for its log.
        own.set_nonblocking(true)?;
        Ok(Self(own))
    }

    /// Writes an entry; whether the journal took it.
    pub(super) fn write(&self, level: LogLevel, message: &str) -> bool {
        self.0.send(entry(level, message).as_bytes()).is_ok()
    }
}

/// Whom a message is about stands before its first colon, if it is one word.
fn entry(level: LogLevel, message: &str) -> String {
    let priority = match level {
        LogLevel::Fatal => 2,
        LogLevel::Error => 3,
        LogLevel::Warning => 4,
        LogLevel::Info | LogLevel::Unknown => 6,
        LogLevel::Debug => 7,
    };
    // A value ends with its line.
    let message = message.replace('\n', " ");
    let mut entry = format!("PRIORITY={priority}\nSYSLOG_IDENTIFIER=hmd\n");
    if let Some((whom, _)) = message.split_once(": ")
        && !whom.contains(' ')
    {
        entry += &format!("HMD_ABOUT={whom}\n");
    }
    entry + &format!("MESSAGE={message}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_has_its_fields_one_on_each_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let listening = UnixDatagram::bind(&path).unwrap();
        let journal = Journal::at(&path).unwrap();
        assert!(journal.write(LogLevel::Warning, "ema3: STALE,\nno sample"));
        assert!(journal.write(LogLevel::Info, "not reloaded: a\nMESSAGE=b"));
        let mut bytes = [0; 256];
        let mut next = || {
            let length = listening.recv(&mut bytes).unwrap();
            String::from_utf8(bytes[..length].to_vec()).unwrap()
        };
        let whole = "PRIORITY=4\nSYSLOG_IDENTIFIER=hmd\nHMD_ABOUT=ema3\nMESSAGE=ema3: STALE, no sample\n";
        assert_eq!(next(), whole);
        let plain = "PRIORITY=6\nSYSLOG_IDENTIFIER=hmd\nMESSAGE=not reloaded: a MESSAGE=b\n";
        assert_eq!(next(), plain, "no field can be smuggled in");
        drop(listening);
        assert!(!journal.write(LogLevel::Info, "nobody is there"));
    }

    #[test]
    fn a_stderr_that_is_no_journal_is_none() {
        assert!(Journal::of_stderr().is_none());
    }
}
