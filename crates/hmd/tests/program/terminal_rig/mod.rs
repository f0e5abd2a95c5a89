//! A program on a terminal that is no terminal: what stands on its screen, and keys for it.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::fs::File;
use std::io::{Read, Write};
use std::num::NonZero;
use std::process::{Child, Command, ExitStatus};
use std::sync::mpsc::{Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

/// Longest wait for anything on the screen.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A terminal with a program on it.
pub(crate) struct Terminal {
    keys: Option<File>,
    /// The program's end, kept open to look at its modes.
    end: Option<File>,
    screen: Arc<Mutex<vt100::Parser>>,
    child: Child,
    /// What ends the thread that reads, and the thread.
    reader: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Terminal {
    /// Starts a program on a terminal of 80 columns and 24 lines.
    pub(crate) fn start(command: &mut Command) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let end = open(
            name.as_c_str(),
            OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC,
            Mode::empty(),
        )
        .unwrap();
        let (keys, end) = (File::from(master), File::from(end));
        set_size(&keys, 80, 24);
        let stdio = || end.try_clone().unwrap();
        let child = command.stdin(stdio()).stdout(stdio()).stderr(stdio()).spawn().unwrap();
        let screen = Arc::new(Mutex::new(vt100::Parser::new(size(24), size(80), 0)));
        let (mut out, seen) = (keys.try_clone().unwrap(), screen.clone());
        let (hung_up, gone) = channel::<()>();
        let reader = std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while gone.try_recv() == Err(TryRecvError::Empty) {
                let mut ends = [PollFd::new(&out, PollFlags::IN)];
                let ready = poll(
                    &mut ends,
                    Some(&Timespec {
                        tv_sec: 0,
                        tv_nsec: 10_000_000,
                    }),
                )
                .unwrap();
                if ready > 0 {
                    let Ok(got @ 1..) = out.read(&mut bytes) else { return };
                    seen.lock().unwrap().process(&bytes[..got]);
                }
            }
        });
        Self {
            keys: Some(keys),
            end: Some(end),
            screen,
            child,
            reader: Some((hung_up, reader)),
        }
    }

    /// What stands on the screen.
    pub(crate) fn text(&self) -> String {
        self.screen.lock().unwrap().screen().contents()
    }

    /// Waits until this stands on the screen; all that stands there.
    pub(crate) fn wait_for(&self, text: &str) -> String {
        self.wait_until(text, |screen| screen.contains(text))
    }

    /// Waits for a screen; all that stands there.
    pub(crate) fn wait_until(&self, what: &str, reached: impl Fn(&str) -> bool) -> String {
        let since = Instant::now();
        loop {
            let text = self.text();
            if reached(&text) {
                return text;
            }
            assert!(
                since.elapsed() < TIMEOUT,
                "expected {what:?} on the screen, found\n{text}"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Whether any character on the screen has a colour.
    pub(crate) fn has_colour(&self) -> bool {
        let parser = self.screen.lock().unwrap();
        let (rows, columns) = parser.screen().size();
        let cells = (0..rows.get()).flat_map(|row| (0..columns.get()).map(move |column| (row, column)));
        let mut cells = cells.filter_map(|(row, column)| parser.screen().cell(row, column));
        cells.any(|cell| cell.fgcolor() != vt100::Color::Default || cell.bgcolor() != vt100::Color::Default)
    }

    fn is_alternate(&self) -> bool {
        self.screen.lock().unwrap().screen().alternate_screen()
    }

    pub(crate) fn press(&mut self, keys: &str) {
        self.keys.as_mut().unwrap().write_all(keys.as_bytes()).unwrap();
    }

    pub(crate) fn resize(&mut self, columns: u16, rows: u16) {
        self.screen
            .lock()
            .unwrap()
            .screen_mut()
            .set_size(size(rows), size(columns));
        set_size(self.keys.as_ref().unwrap(), columns, rows);
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether the program has the terminal to itself: its own screen, keys without a line end.
    pub(crate) fn is_taken(&self) -> bool {
        let modes = tcgetattr(self.end.as_ref().unwrap()).unwrap().local_modes;
        let parser = self.screen.lock().unwrap();
        assert_eq!(parser.screen().alternate_screen(), !modes.contains(LocalModes::ICANON));
        parser.screen().alternate_screen()
    }

    /// Pulls the plug, and waits for the end of the program.
    pub(crate) fn hang_up(mut self) -> ExitStatus {
        let (hung_up, reader) = self.reader.take().unwrap();
        drop(hung_up);
        reader.join().unwrap();
        (self.keys, self.end) = (None, None);
        let since = Instant::now();
        loop {
            match self.child.try_wait().unwrap() {
                Some(status) => return status,
                None => assert!(since.elapsed() < TIMEOUT, "it goes on without a terminal"),
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits for the end of the program, which must have given the terminal back; its exit code and what it left.
    pub(crate) fn end(mut self) -> (ExitStatus, String) {
        let status = self.child.wait().unwrap();
        self.wait_until("the terminal as it was", |_| !self.is_alternate());
        // What was written last may still be on its way.
        std::thread::sleep(Duration::from_millis(100));
        assert!(!self.is_taken());
        assert!(!self.screen.lock().unwrap().screen().hide_cursor());
        (status, self.text())
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn size(count: u16) -> NonZero<u16> {
    NonZero::new(count).unwrap()
}

fn set_size(terminal: &File, columns: u16, rows: u16) {
    let size = Winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(terminal, size).unwrap();
}
