//! Outputs for frames: a file, stdout, a serial device, a pseudo-terminal, a CAN bus.

use std::fmt::Display;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use firmware_sim::CanFrame;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, isatty, tcgetattr, tcsetattr};
use socketcan::{CanDataFrame, CanErrorFrame, CanSocket, EmbeddedFrame, Socket, StandardId};

/// Error class of a disturbed frame: `CAN_ERR_PROT` of `linux/can/error.h`.
const PROTOCOL_VIOLATION: u32 = 0x08;

/// Output for frames.
pub(crate) enum Output {
    Serial(Line),
    Can(Bus),
}

/// Why sending ends early.
pub(crate) enum OutputError {
    /// The receiver has closed the line.
    HungUp,
    Failed(String),
}

/// A byte stream.
pub(crate) struct Line {
    name: String,
    writer: Box<dyn Write>,
    /// The output is a device, which transmits in real time.
    live: bool,
    /// Symbolic link to the pseudo-terminal, removed at the end.
    link: Option<PathBuf>,
}

/// A CAN interface.
pub(crate) struct Bus {
    name: String,
    socket: CanSocket,
}

impl Output {
    /// Stdout.
    pub(crate) fn stdout() -> Self {
        Self::Serial(Line {
            name: "stdout".to_owned(),
            writer: Box::new(BufWriter::new(io::stdout().lock())),
            live: false,
            link: None,
        })
    }

    /// A new file, or an existing serial device.
    pub(crate) fn path(path: &Path) -> Result<Self, String> {
        let name = path.display().to_string();
        let failed = |e: &dyn Display| format!("{name}: {e}");
        let file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(true)
            .open(path)
            .map_err(|e| failed(&e))?;
        let live = isatty(&file);
        let writer: Box<dyn Write> = if live {
            make_raw(&file).map_err(|e| failed(&e))?;
            Box::new(file)
        } else {
            Box::new(BufWriter::new(file))
        };
        let link = None;
        Ok(Self::Serial(Line {
            name,
            writer,
            live,
            link,
        }))
    }

    /// A new pseudo-terminal, and a symbolic link to the end for the receiver.
    pub(crate) fn pty(link: &Path) -> Result<Self, String> {
        let name = link.display().to_string();
        let writer = make_pty(link).map_err(|e| format!("{name}: {e}"))?;
        Ok(Self::Serial(Line {
            name,
            writer: Box::new(writer),
            live: true,
            link: Some(link.to_owned()),
        }))
    }

    /// A CAN interface.
    pub(crate) fn can(interface: &str) -> Result<Self, String> {
        let name = interface.to_owned();
        match CanSocket::open(interface) {
            Ok(socket) => Ok(Self::Can(Bus { name, socket })),
            Err(e) => Err(format!("{name}: {e}")),
        }
    }

    /// Whether the output is a device, which transmits in real time.
    pub(crate) fn is_live(&self) -> bool {
        match self {
            Self::Serial(line) => line.live,
            Self::Can(_) => true,
        }
    }
}

impl Line {
    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<(), OutputError> {
        match self.writer.write_all(bytes) {
            // Only the pseudo-terminal is non-blocking: bytes that its buffer does not hold are lost, as on a wire.
            Err(e) if e.kind() == ErrorKind::WouldBlock => Ok(()),
            sent => self.checked(sent),
        }
    }

    pub(crate) fn finish(mut self) -> Result<(), OutputError> {
        let flushed = self.writer.flush();
        self.checked(flushed)
    }

    fn checked(&self, result: io::Result<()>) -> Result<(), OutputError> {
        result.map_err(|e| match e.kind() {
            ErrorKind::BrokenPipe => OutputError::HungUp,
            _ => OutputError::Failed(format!("{}: {e}", self.name)),
        })
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(link) = &self.link {
            // The pseudo-terminal ends with this process.
            let _ = fs::remove_file(link);
        }
    }
}

impl Bus {
    pub(crate) fn send(&self, frame: &CanFrame) -> Result<(), OutputError> {
        let failed = |e: &dyn Display| OutputError::Failed(format!("{}: {e}", self.name));
        let sent = match frame {
            CanFrame::Data { id, data, .. } => {
                let frame = StandardId::new(*id).and_then(|id| CanDataFrame::new(id, data));
                // The identifier has 11 bits and the frame 8 bytes, so the conversion does not fail.
                frame.map_or(Ok(()), |frame| self.socket.write_frame(&frame))
            }
            CanFrame::Error => {
                let frame = CanErrorFrame::new_error(PROTOCOL_VIOLATION, &[0; 8]).map_err(|e| failed(&e))?;
                self.socket.write_frame(&frame)
            }
        };
        sent.map_err(|e| failed(&e))
    }
}

/// Switches the terminal to raw mode, so that it does not change any byte.
fn make_raw(tty: impl AsFd) -> io::Result<()> {
    let mut settings = tcgetattr(&tty)?;
    settings.make_raw();
    Ok(tcsetattr(&tty, OptionalActions::Now, &settings)?)
}

fn make_pty(link: &Path) -> io::Result<File> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    make_raw(&master)?;
    let name = ptsname(&master, Vec::new())?;
    fcntl_setfl(&master, OFlags::NONBLOCK)?;
    // Remove the link of an earlier run that was killed.
    if link.is_symlink() {
        fs::remove_file(link)?;
    }
    symlink(Path::new(name.to_str().map_err(io::Error::other)?), link)?;
    Ok(File::from(master))
}
