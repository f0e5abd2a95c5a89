//! `hmd top`: how all actuators stand, on a terminal.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, bail};
use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::DefaultTerminal;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use tokio::sync::mpsc;

use super::live::{Asked, signals};
use super::{Exit, Misuse};
use hmd_report::top::{Colours, Condition, Cursor, Follow, Model, Progress, State, draw, full_height};

/// Watch all actuators of a running daemon, or the end of a recording, on the terminal.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Keys: Up/Down or k/j select, PgUp/PgDn, Home/End, w worst first, q, Esc or Ctrl-C end. \
                        NO_COLOR is honoured.\n\nExamples:\n\
                        \x20 hmd top /var/lib/hmd\n\
                        \x20 hmd top flight.mcap --once"
)]
pub struct Args {
    /// Folder that hmd run writes to, or an MCAP file that hmd wrote or writes.
    #[arg(value_name = "FOLDER|FILE.mcap")]
    place: PathBuf,
    /// Print what there is now as text, and end; no terminal is needed.
    #[arg(long)]
    once: bool,
}

/// Time between two looks at the files.
const PERIOD: Duration = Duration::from_millis(500);

/// Keys that wait; then the terminal does.
const EVENTS_WAITING: usize = 16;

/// Columns of `--once`.
const ONCE_WIDTH: u16 = 80;

/// Runs the verb.
///
/// # Errors
/// A folder or file that is none of ours; no terminal.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let mut watch = Watch::open(args)?;
    if args.once {
        return once(&mut watch);
    }
    if !io::stdout().is_terminal() {
        return Err(Misuse("top: expected a terminal on stdout, found none; --once prints text".to_owned()).into());
    }
    // What is no log is told on the terminal as it was.
    watch.read()?;
    let asked = signals().context("signals")?;
    let restore = Restore;
    let mut terminal = ratatui::try_init().context("terminal")?;
    let ended = show(&mut watch, &mut terminal, asked);
    if has_hung_up() {
        // There is nothing to give back and nobody to tell, which would be an error of its own.
        std::process::exit(Exit::Done as i32);
    }
    drop(restore);
    ended.map(|()| Exit::Done)
}

/// Shows what there is until a key or a signal ends it.
fn show(watch: &mut Watch, terminal: &mut DefaultTerminal, mut asked: mpsc::Receiver<Asked>) -> anyhow::Result<()> {
    let events = events()?;
    let colours = if std::env::var_os("NO_COLOR").is_some_and(|set| !set.is_empty()) {
        Colours::Off
    } else {
        Colours::On
    };
    let mut selection = Selection::default();
    while asked.try_recv().is_err() && !has_hung_up() {
        let progress = watch.read()?;
        let model = watch.model(selection.worst_first);
        selection.follow(&model);
        terminal
            .draw(|frame| {
                selection.shown = draw(&model, selection.cursor(), colours, frame.buffer_mut());
            })
            .context("terminal")?;
        let patience = if matches!(progress, Progress::Reading(_)) {
            Duration::ZERO
        } else {
            PERIOD
        };
        match events.recv_timeout(patience) {
            Ok(Event::Key(key)) if key.kind != KeyEventKind::Release && selection.press(key, &model) => break,
            Ok(_) | Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => bail!("terminal: it cannot be read"),
        }
    }
    Ok(())
}

/// Keys and sizes of the terminal, from a thread of its own: at the end of a terminal that has gone, crossterm reads for ever.
fn events() -> anyhow::Result<Receiver<Event>> {
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
        .context("thread")?;
    Ok(receiver)
}

/// Whether nobody is at the other end any more, as when a connection breaks.
fn has_hung_up() -> bool {
    let stdout = io::stdout();
    let mut ends = [PollFd::new(&stdout, PollFlags::empty())];
    poll(&mut ends, Some(&Timespec::default())).is_ok() && ends[0].revents().contains(PollFlags::HUP)
}

/// Gives the terminal back, whatever ended the watch.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        // A terminal that has gone needs nothing back.
        let _ = ratatui::try_restore();
    }
}

/// What is read, and how long nothing came.
struct Watch {
    place: String,
    follow: Follow,
    state: State,
    progress: Progress,
    /// Records so far, when that was found, and how old the newest was then.
    heard: (u64, Instant, Duration),
    /// All that was there at the start was read.
    has_caught_up: bool,
}

impl Watch {
    fn open(args: &Args) -> anyhow::Result<Self> {
        Ok(Self {
            place: args.place.display().to_string(),
            follow: Follow::open(&args.place)?,
            state: State::default(),
            progress: Progress::Reading(0.0),
            heard: (0, Instant::now(), Duration::ZERO),
            has_caught_up: false,
        })
    }

    fn read(&mut self) -> anyhow::Result<Progress> {
        self.progress = self.follow.read(&mut self.state)?;
        if !self.has_caught_up {
            self.heard = (self.state.records, Instant::now(), self.age_by_clock()?);
            self.has_caught_up = !matches!(self.progress, Progress::Reading(_));
        } else if self.heard.0 != self.state.records {
            // From here on age is measured without the clock, which may be set.
            self.heard = (self.state.records, Instant::now(), Duration::ZERO);
        }
        Ok(self.progress)
    }

    /// Age of the newest record as the clock has it: by the file, or by the record itself where a copy made the file young.
    fn age_by_clock(&self) -> anyhow::Result<Duration> {
        let now = SystemTime::now();
        let of_file = now.duration_since(self.follow.written_at()?).unwrap_or_default();
        // The stamps of a replay are those of its log.
        let is_live = self
            .state
            .status()
            .is_some_and(|(_, status)| !status.actuator.is_empty());
        let stamp = SystemTime::UNIX_EPOCH + Duration::from_nanos(self.state.newest_ns());
        let of_record = now.duration_since(stamp).unwrap_or_default();
        Ok(if is_live { of_file.max(of_record) } else { of_file })
    }

    fn model(&self, worst_first: bool) -> Model<'_> {
        let (_, then, age) = self.heard;
        let silent = then.elapsed() + age;
        let condition = Condition::new(self.progress, silent.as_secs_f64());
        Model::new(&self.place, &self.state, condition, worst_first)
    }
}

fn once(watch: &mut Watch) -> anyhow::Result<Exit> {
    while matches!(watch.read()?, Progress::Reading(_)) {}
    let model = watch.model(false);
    let mut buffer = Buffer::empty(Rect::new(0, 0, ONCE_WIDTH, full_height(&model)));
    draw(&model, Cursor { row: 0, keys: false }, Colours::Off, &mut buffer);
    for y in 0..buffer.area.height {
        let line: String = (0..buffer.area.width)
            .filter_map(|x| buffer.cell((x, y)))
            .map(|cell| cell.symbol())
            .collect();
        super::say(line.trim_end())?;
    }
    io::stdout().flush().context("stdout")?;
    if watch.state.damaged == 0 {
        return Ok(Exit::Done);
    }
    super::warn(format_args!(
        "{}: data lost: {} damaged places",
        watch.place, watch.state.damaged
    ));
    Ok(Exit::DataLost)
}

/// What the keys have chosen.
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
