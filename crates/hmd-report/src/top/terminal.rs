//! The screen on a terminal: reads the records, draws the model, takes the keys.

use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant, SystemTime};

use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::DefaultTerminal;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::draw::{Colours, Cursor, draw, full_height};
use super::follow::{Follow, FollowError, Progress};
use super::model::{Condition, Model};
use super::state::State;

/// Time between two reads of the files.
const PERIOD: Duration = Duration::from_millis(500);

/// Keys that wait; when it is full, the terminal waits.
const EVENTS_WAITING: usize = 16;

/// Columns of the screen as text.
const TEXT_WIDTH: u16 = 80;

/// Why the screen cannot be shown any longer.
#[derive(Debug, thiserror::Error)]
pub enum TerminalError {
    /// The terminal cannot be set up or drawn on.
    #[error("terminal: {0}")]
    Terminal(io::Error),
    /// The terminal gives no keys any more.
    #[error("terminal: it cannot be read")]
    Unreadable,
    /// The thread for the keys cannot be started.
    #[error("thread: {0}")]
    Thread(io::Error),
    /// The records cannot be read.
    #[error(transparent)]
    Follow(#[from] FollowError),
}

/// Why the screen ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScreenEnd {
    /// A key or a signal.
    Asked,
    /// The terminal has gone. It was not restored, which would be an error of its own: end the process at once.
    HungUp,
}

/// Shows the screen until a key or `is_stopped` ends it, and restores the terminal.
///
/// # Errors
/// [`TerminalError`].
pub fn show(watch: &mut Watch, is_stopped: impl FnMut() -> bool) -> Result<ScreenEnd, TerminalError> {
    let restore = Restore;
    let mut terminal = ratatui::try_init().map_err(TerminalError::Terminal)?;
    let ended = show_until_ended(watch, &mut terminal, is_stopped);
    if has_hung_up() {
        std::mem::forget((terminal, restore));
        return Ok(ScreenEnd::HungUp);
    }
    drop(restore);
    ended.map(|()| ScreenEnd::Asked)
}

/// A folder or file that is watched, and the age of its newest record.
pub struct Watch {
    place: String,
    follow: Follow,
    state: State,
    progress: Progress,
    /// Number of records when the newest came, the instant of that, and the age of the newest then.
    newest: (u64, Instant, Duration),
    /// All that was there at the start was read.
    has_caught_up: bool,
}

impl Watch {
    /// Opens a folder that `hmd run` writes to, or an MCAP file.
    ///
    /// # Errors
    /// [`FollowError`].
    pub fn open(place: &Path) -> Result<Self, FollowError> {
        Ok(Self {
            place: place.display().to_string(),
            follow: Follow::open(place)?,
            state: State::default(),
            progress: Progress::Reading(0.0),
            newest: (0, Instant::now(), Duration::ZERO),
            has_caught_up: false,
        })
    }

    /// Reads what has come since the last call.
    ///
    /// # Errors
    /// [`FollowError`].
    pub fn read(&mut self) -> Result<Progress, FollowError> {
        self.progress = self.follow.read(&mut self.state)?;
        if !self.has_caught_up {
            self.newest = (self.state.records, Instant::now(), self.age_by_clock()?);
            self.has_caught_up = !matches!(self.progress, Progress::Reading(_));
        } else if self.newest.0 != self.state.records {
            // From here on age is measured without the clock, which may be set.
            self.newest = (self.state.records, Instant::now(), Duration::ZERO);
        }
        Ok(self.progress)
    }

    /// Age of the newest record as the clock has it: by the file, or by the record itself where a copy made the file young.
    fn age_by_clock(&self) -> Result<Duration, FollowError> {
        let now = SystemTime::now();
        let of_file = now.duration_since(self.follow.written_at()?).unwrap_or_default();
        // The stamps of a replay are those of its log.
        let is_live = self
            .state
            .status()
            .is_some_and(|(_, status)| !status.actuators.is_empty());
        let stamp = SystemTime::UNIX_EPOCH + Duration::from_nanos(self.state.newest_ns());
        let of_record = now.duration_since(stamp).unwrap_or_default();
        Ok(if is_live { of_file.max(of_record) } else { of_file })
    }

    /// Damaged places found so far.
    #[must_use]
    pub fn damaged(&self) -> u64 {
        self.state.damaged
    }

    /// Folder or file, as given.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Reads everything that is there; the screen then, as lines of text, with the gravest actuator in detail.
    ///
    /// # Errors
    /// [`FollowError`].
    pub fn lines(&mut self) -> Result<Vec<String>, FollowError> {
        while matches!(self.read()?, Progress::Reading(_)) {}
        let model = self.model(false);
        let mut buffer = Buffer::empty(Rect::new(0, 0, TEXT_WIDTH, full_height(&model)));
        let row = model.worst_row();
        draw(&model, Cursor { row, keys: false }, Colours::Off, &mut buffer);
        let line = |y| -> String {
            let cells = (0..buffer.area.width).filter_map(|x| buffer.cell((x, y)));
            cells.map(|cell| cell.symbol()).collect()
        };
        Ok((0..buffer.area.height).map(|y| line(y).trim_end().to_owned()).collect())
    }

    fn model(&self, worst_first: bool) -> Model<'_> {
        let (_, then, age) = self.newest;
        let silent = then.elapsed() + age;
        let condition = Condition::new(self.progress, silent.as_secs_f64());
        Model::new(&self.place, &self.state, condition, worst_first)
    }
}

/// Shows the model until a key, `is_stopped` or the end of the terminal ends it.
fn show_until_ended(
    watch: &mut Watch,
    terminal: &mut DefaultTerminal,
    mut is_stopped: impl FnMut() -> bool,
) -> Result<(), TerminalError> {
    let events = events()?;
    let colours = if std::env::var_os("NO_COLOR").is_some_and(|set| !set.is_empty()) {
        Colours::Off
    } else {
        Colours::On
    };
    let mut selection = Selection::default();
    while !is_stopped() && !has_hung_up() {
        let progress = watch.read()?;
        let model = watch.model(selection.worst_first);
        selection.follow(&model);
        terminal
            .draw(|frame| {
                selection.shown = draw(&model, selection.cursor(), colours, frame.buffer_mut());
            })
            .map_err(TerminalError::Terminal)?;
        let patience = if matches!(progress, Progress::Reading(_)) {
            Duration::ZERO
        } else {
            PERIOD
        };
        match events.recv_timeout(patience) {
            Ok(Event::Key(key)) if key.kind != KeyEventKind::Release && selection.press(key, &model) => break,
            Ok(_) | Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(TerminalError::Unreadable),
        }
    }
    Ok(())
}

/// Keys and sizes of the terminal, from a thread of its own: crossterm reads for ever from a terminal that has gone.
fn events() -> Result<Receiver<Event>, TerminalError> {
    let (sender, receiver) = sync_channel(EVENTS_WAITING);
    let read = move || {
        while let Ok(event) = event::read() {
            if sender.send(event).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new()
        .name("keys".to_owned())
        .spawn(read)
        .map_err(TerminalError::Thread)?;
    Ok(receiver)
}

/// Whether the other end of the terminal is closed, as when a connection breaks.
fn has_hung_up() -> bool {
    let stdout = io::stdout();
    let mut ends = [PollFd::new(&stdout, PollFlags::empty())];
    poll(&mut ends, Some(&Timespec::default())).is_ok() && ends[0].revents().contains(PollFlags::HUP)
}

/// Restores the terminal, whatever ended the watch.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        // A terminal that has gone needs no restoring.
        let _ = ratatui::try_restore();
    }
}

/// What the keys selected.
#[derive(Default)]
struct Selection {
    row: usize,
    /// Whose row that was; it is followed when the order changes.
    name: Option<String>,
    worst_first: bool,
    /// Rows of a page.
    shown: usize,
}

impl Selection {
    fn cursor(&self) -> Cursor {
        Cursor {
            row: self.row,
            keys: true,
        }
    }

    /// The row of the chosen actuator in this model.
    fn follow(&mut self, model: &Model<'_>) {
        let found = self
            .name
            .as_ref()
            .and_then(|name| model.rows.iter().position(|row| row.name == name));
        self.row = found.unwrap_or(self.row.min(model.rows.len().saturating_sub(1)));
    }

    /// Takes a key; whether it ends the watch.
    fn press(&mut self, key: KeyEvent, model: &Model<'_>) -> bool {
        let last = model.rows.len().saturating_sub(1);
        match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return true,
            KeyCode::Char('q') | KeyCode::Esc => return true,
            KeyCode::Up | KeyCode::Char('k') => self.row = self.row.saturating_sub(1),
            KeyCode::Down | KeyCode::Char('j') => self.row = (self.row + 1).min(last),
            KeyCode::PageUp => self.row = self.row.saturating_sub(self.shown),
            KeyCode::PageDown => self.row = (self.row + self.shown).min(last),
            KeyCode::Home => self.row = 0,
            KeyCode::End => self.row = last,
            KeyCode::Char('w') => self.worst_first = !self.worst_first,
            _ => {}
        }
        self.name = model.rows.get(self.row).map(|row| row.name.to_owned());
        false
    }
}
