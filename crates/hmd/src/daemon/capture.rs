//! Frames around the windows that matter, for a run that does not store all.
//!
//! The newest frames wait in a ring, for some seconds and as long as a window waits that may ask for them. An interval that is wanted
//! takes its frames out of it, and all that come until its end. What is written without a break is one capture; a frame given up behind
//! it ends it.

use std::collections::VecDeque;

use hmd_core::config::Config;
use hmd_core::frame::RawFrame;
use hmd_storage::recorder::RecordError;

/// Most frames that wait: 20 MiB. Beyond it the oldest is given up.
const FRAMES_MAX: usize = 1 << 18;

/// Most intervals wanted at once; a further one extends the last.
const INTERVALS_MAX: usize = 64;

/// Newest captures whose times are known.
const CAPTURES_MAX: usize = 64;

/// How much longer than a window and what is stored before it a frame waits in any case, ns: time for an operator to ask for it.
const SPARE_NS: u64 = 5_000_000_000;

/// Takes what becomes of the frames.
pub(super) type Put<'a> = &'a mut dyn FnMut(Step<'_>) -> Result<(), RecordError>;

/// What becomes of the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step<'a> {
    /// The next frame begins a capture; why.
    Begin(&'a str),
    /// A frame of it.
    Frame(&'a RawFrame),
    /// The next frame does not follow the last.
    End,
}

/// What is there of an interval that is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// All that came of it, and what comes.
    All,
    /// Frames were given up, or had passed when the run began.
    NotAll,
}

/// An interval of stamps, UTC ns, both ends included.
#[derive(Clone, Debug)]
struct Wanted {
    from_ns: u64,
    to_ns: u64,
    why: String,
}

/// The frames that may be wanted, and what is.
#[derive(Debug)]
pub(super) struct Capture {
    before_ns: u64,
    after_ns: u64,
    /// Age up to which frames wait though no window does.
    held_ns: u64,
    /// Starts of the windows without a verdict, UTC ns.
    unassessed: Vec<u64>,
    /// Newest stamp of which frames are no longer there, UTC ns.
    gone_ns: u64,
    /// Stamps of the first and last frame of the newest captures, UTC ns, oldest first.
    captured_ns: VecDeque<(u64, u64)>,
    /// Frames not written, oldest first.
    waiting: VecDeque<RawFrame>,
    wanted: Vec<Wanted>,
    /// The first of those that wait follows the last one written.
    open: bool,
}

impl Capture {
    /// For a run of this configuration that begins now, UTC ns; `None` where all frames are stored, or none shall be.
    pub(super) fn of(config: &Config, now_ns: u64) -> Option<Self> {
        let output = config.output();
        let ns = |seconds: f64| (1e9 * seconds) as u64;
        (output.captures && !output.raw_frames).then(|| Self {
            before_ns: ns(output.capture_before_s),
            after_ns: ns(output.capture_after_s),
            held_ns: ns(held_s(config)),
            unassessed: Vec::new(),
            gone_ns: now_ns,
            captured_ns: VecDeque::new(),
            waiting: VecDeque::new(),
            wanted: Vec::new(),
            open: false,
        })
    }

    /// A window that begins then waits for its verdict, and its frames with it.
    pub(super) fn begin_wait(&mut self, t_start_ns: u64) {
        self.unassessed.push(t_start_ns);
    }

    /// It has its verdict, or gets none.
    pub(super) fn end_wait(&mut self, t_start_ns: u64) {
        if let Some(n) = self.unassessed.iter().position(|start| *start == t_start_ns) {
            self.unassessed.swap_remove(n);
        }
    }

    /// Takes the newest frame.
    pub(super) fn push(&mut self, frame: &RawFrame, put: Put<'_>) -> Result<(), RecordError> {
        // The first one, or the clock was set back.
        self.gone_ns = self.gone_ns.min(frame.stamp_ns.saturating_sub(1));
        self.waiting.push_back(*frame);
        if self.is_wanted(frame) {
            return self.write_wanted(put);
        }
        self.give_up(frame.stamp_ns, put)
    }

    /// Asks for the frames from an interval of time, with what the configuration adds around it. Whether those of the interval itself
    /// are there.
    pub(super) fn want(
        &mut self,
        (from_ns, to_ns): (u64, u64),
        why: String,
        put: Put<'_>,
    ) -> Result<Found, RecordError> {
        let holds = |&(first_ns, last_ns): &(u64, u64)| first_ns <= from_ns && to_ns <= last_ns;
        let is_captured = self.captured_ns.iter().any(holds);
        let found = if from_ns > self.gone_ns || is_captured {
            Found::All
        } else {
            Found::NotAll
        };
        let from_ns = from_ns.saturating_sub(self.before_ns);
        let to_ns = to_ns.saturating_add(self.after_ns);
        let is_full = self.wanted.len() == INTERVALS_MAX;
        match self.wanted.last_mut() {
            Some(last) if is_full => {
                last.from_ns = last.from_ns.min(from_ns);
                last.to_ns = last.to_ns.max(to_ns);
            }
            _ => self.wanted.push(Wanted { from_ns, to_ns, why }),
        }
        self.write_wanted(put)?;
        Ok(found)
    }

    /// Whether frames that follow a time, as long as the configuration adds them to it, are there or may still come.
    pub(super) fn has_later(&self, t_ns: u64) -> bool {
        t_ns.saturating_add(self.after_ns) > self.gone_ns
    }

    /// Gives up what no window asks for any more; to be called every second, so that a silent bus ends a capture as well.
    pub(super) fn tick(&mut self, now_ns: u64, put: Put<'_>) -> Result<(), RecordError> {
        let held_ns = self.held_ns;
        self.wanted
            .retain(|wanted| now_ns <= wanted.to_ns.saturating_add(held_ns));
        self.give_up(now_ns, put)?;
        let silent = self.waiting.is_empty() && self.wanted.iter().all(|wanted| wanted.to_ns < now_ns);
        if self.open && silent {
            self.open = false;
            put(Step::End)?;
        }
        Ok(())
    }

    fn is_wanted(&self, frame: &RawFrame) -> bool {
        let stamp_ns = frame.stamp_ns;
        let mut wanted = self.wanted.iter();
        wanted.any(|wanted| (wanted.from_ns..=wanted.to_ns).contains(&stamp_ns))
    }

    /// Writes all frames up to the newest that is wanted; an open capture takes those between as well.
    fn write_wanted(&mut self, put: Put<'_>) -> Result<(), RecordError> {
        let Some(last) = self.waiting.iter().rposition(|frame| self.is_wanted(frame)) else {
            return Ok(());
        };
        let unwanted = self
            .waiting
            .iter()
            .position(|frame| self.is_wanted(frame))
            .unwrap_or(last);
        let mut left = last + 1;
        if !self.open {
            for frame in self.waiting.drain(..unwanted) {
                self.gone_ns = self.gone_ns.max(frame.stamp_ns);
            }
            left -= unwanted;
            self.open = true;
            let stamp_ns = self.waiting.front().map_or(0, |frame| frame.stamp_ns);
            if self.captured_ns.len() == CAPTURES_MAX {
                self.captured_ns.pop_front();
            }
            self.captured_ns.push_back((stamp_ns, stamp_ns));
            let why = self
                .wanted
                .iter()
                .find(|wanted| (wanted.from_ns..=wanted.to_ns).contains(&stamp_ns));
            put(Step::Begin(why.map_or("", |wanted| &wanted.why)))?;
        }
        for frame in self.waiting.drain(..left) {
            if let Some(newest) = self.captured_ns.back_mut() {
                newest.1 = frame.stamp_ns;
            }
            put(Step::Frame(&frame))?;
        }
        Ok(())
    }

    /// Gives up frames that are older than what any window without a verdict asks for, or of a time to come, after the clock was set back.
    fn give_up(&mut self, now_ns: u64, put: Put<'_>) -> Result<(), RecordError> {
        let mut given_up = false;
        while let Some(&RawFrame { stamp_ns, .. }) = self.waiting.front()
            && (self.waiting.len() > FRAMES_MAX || !self.is_held(stamp_ns, now_ns))
        {
            self.waiting.pop_front();
            if stamp_ns <= now_ns {
                self.gone_ns = self.gone_ns.max(stamp_ns);
            }
            given_up = true;
        }
        if given_up && self.open {
            self.open = false;
            put(Step::End)?;
        }
        Ok(())
    }

    /// Whether a frame may still be asked for.
    fn is_held(&self, stamp_ns: u64, now_ns: u64) -> bool {
        let is_asked = |start: &u64| stamp_ns >= start.saturating_sub(self.before_ns);
        stamp_ns.abs_diff(now_ns) <= self.held_ns || self.unassessed.iter().any(is_asked)
    }
}

/// How long frames wait for someone who asks for them, by a configuration, s; longer while windows wait for their verdict.
#[must_use]
pub fn held_s(config: &Config) -> f64 {
    config.output().capture_before_s + 1e-3 * config.window().duration_ms + 1e-9 * SPARE_NS as f64
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

    use hmd_core::frame::FrameFlags;
    use proptest::prelude::*;

    use super::*;

    const MS: u64 = 1_000_000;
    const START: u64 = 1_700_000_000_000 * MS;

    /// What was put, frame by frame: its number, and whether it began a capture. `End` is `None`.
    type Put = Vec<Option<(u32, bool)>>;

    struct Bench {
        capture: Capture,
        next: u32,
        begun: bool,
        put: Put,
    }

    impl Bench {
        fn new() -> Self {
            let text = "[output]\nraw_frames = false\ncapture_before_s = 2\ncapture_after_s = 1";
            Self {
                capture: Capture::of(&Config::from_toml_str(text, "test").unwrap(), START).unwrap(),
                next: 0,
                begun: false,
                put: Put::new(),
            }
        }

        fn act<T>(&mut self, act: impl FnOnce(&mut Capture, super::Put<'_>) -> Result<T, RecordError>) -> T {
            let (begun, put) = (&mut self.begun, &mut self.put);
            act(&mut self.capture, &mut |step| {
                match step {
                    Step::Begin(why) => {
                        assert!(!why.is_empty());
                        *begun = true;
                    }
                    Step::Frame(frame) => put.push(Some((frame.id(), std::mem::take(begun)))),
                    Step::End => put.push(None),
                }
                Ok(())
            })
            .unwrap()
        }

        fn push(&mut self, stamp_ns: u64) {
            let frame = RawFrame::new(stamp_ns, 0, self.next, FrameFlags::EXTENDED, &[]).unwrap();
            self.next += 1;
            self.act(|capture, put| capture.push(&frame, put));
        }

        fn want(&mut self, from_ns: u64, to_ns: u64) -> Found {
            self.act(|capture, put| capture.want((from_ns, to_ns), "why".to_owned(), put))
        }
    }

    #[test]
    fn two_windows_close_together_are_one_capture_and_later_ones_another() {
        let mut bench = Bench::new();
        let at = |n: u64| START + n * 100 * MS;
        for n in 0..400 {
            bench.push(at(n));
            match n {
                55 => assert_eq!(bench.want(at(40), at(45)), Found::All),
                95 => assert_eq!(bench.want(at(80), at(85)), Found::All),
                300 => assert_eq!(bench.want(at(290), at(295)), Found::All),
                _ => {}
            }
        }
        bench.act(|capture, put| capture.tick(at(500), put));
        let put = bench.put;
        let ends: Vec<_> = (0..put.len()).filter(|n| put[*n].is_none()).collect();
        let (first, second) = (&put[..ends[0]], &put[ends[0] + 1..ends[1]]);
        assert_eq!(
            (first[0], first[first.len() - 1]),
            (Some((20, true)), Some((95, false)))
        );
        assert_eq!(
            (second[0], second[second.len() - 1]),
            (Some((270, true)), Some((305, false)))
        );
        assert_eq!((first.len(), second.len(), ends.len()), (76, 36, 2));
    }

    #[test]
    fn frames_that_wait_are_bounded_in_number_and_by_a_clock_that_is_set_back() {
        let mut bench = Bench::new();
        for _ in 0..FRAMES_MAX + 10 {
            bench.push(START);
        }
        assert_eq!(bench.capture.waiting.len(), FRAMES_MAX);
        bench.push(START - 3_600_000 * MS);
        assert_eq!(bench.capture.waiting.len(), 1);
        for _ in 0..2 * INTERVALS_MAX {
            bench.want(START, START);
        }
        assert_eq!(bench.capture.wanted.len(), INTERVALS_MAX);
        bench.act(|capture, put| capture.tick(START + 60_000 * MS, put));
        assert_eq!((bench.capture.wanted.len(), bench.capture.waiting.len()), (0, 0));
        assert_eq!(bench.put, []);
    }

    #[test]
    fn frames_wait_as_long_as_their_window_and_what_is_gone_is_told() {
        let mut bench = Bench::new();
        let at = |n: u64| START + n * 100 * MS;
        assert_eq!(
            bench.want(START - 60_000 * MS, START - 60_000 * MS),
            Found::NotAll,
            "before the run"
        );
        for n in 0..1_500 {
            bench.push(at(n));
            match n {
                100 => bench.capture.begin_wait(at(90)),
                200 => bench.capture.begin_wait(at(190)),
                1_000 => {
                    assert_eq!(bench.want(at(90), at(95)), Found::All, "90 s later");
                    bench.capture.end_wait(at(90));
                    assert_eq!(bench.want(at(92), at(93)), Found::All, "in that capture");
                }
                1_300 => {
                    // The window was dropped.
                    bench.capture.end_wait(at(190));
                }
                1_400 => assert_eq!(bench.want(at(190), at(195)), Found::NotAll),
                _ => {}
            }
        }
        let put: Vec<u32> = bench.put.iter().flatten().map(|(frame, _)| *frame).collect();
        assert_eq!(put, (70..=105).collect::<Vec<u32>>());
        assert!(bench.capture.unassessed.is_empty());
    }

    #[test]
    fn frames_of_earlier_captures_are_still_there() {
        let mut bench = Bench::new();
        let at = |n: u64| START + n * 100 * MS;
        let mut found = Vec::new();
        for n in 0..100 * (CAPTURES_MAX as u64 + 2) {
            bench.push(at(n));
            if n % 100 == 55 {
                found.push(bench.want(at(n - 5), at(n)));
            }
        }
        assert!(found.iter().all(|found| *found == Found::All));
        for capture in [0, 2, 40, CAPTURES_MAX as u64] {
            let middle = 100 * capture + 52;
            let expected = if capture < 2 { Found::NotAll } else { Found::All };
            assert_eq!(bench.want(at(middle), at(middle)), expected, "capture {capture}");
        }
        assert_eq!(bench.want(at(110), at(110)), Found::NotAll, "between two");
    }

    #[test]
    fn a_clock_that_was_set_back_hides_no_frames() {
        let mut bench = Bench::new();
        for n in 0..200 {
            bench.push(START + n * 100 * MS);
        }
        let back = START - 3_600_000 * MS;
        for n in 0..20 {
            bench.push(back + n * 100 * MS);
        }
        assert_eq!(bench.want(back, back + 1_000 * MS), Found::All);
        assert_eq!(bench.want(back - 1_000 * MS, back), Found::NotAll);
    }

    proptest! {
        #[test]
        fn frames_are_put_once_in_order_whole_and_as_wanted(
            acts in prop::collection::vec((0..20u64, 0..900u64, 0..8_000u64, 0..1_000u64), 1..400),
        ) {
            let mut bench = Bench::new();
            let (mut now_ns, mut wanted, mut expected) = (START, Vec::new(), Vec::new());
            for (act, later_ms, ago_ms, length_ms) in acts {
                now_ns += later_ms * MS;
                match act {
                    0 => {
                        let from_ns = now_ns - ago_ms * MS;
                        bench.want(from_ns, from_ns + length_ms * MS);
                        wanted.push(from_ns - 2_000 * MS..=from_ns + (length_ms + 1_000) * MS);
                    }
                    1 => bench.act(|capture, put| capture.tick(now_ns, put)),
                    _ => {
                        if wanted.iter().any(|wanted| wanted.contains(&now_ns)) {
                            expected.push(bench.next);
                        }
                        bench.push(now_ns);
                    }
                }
            }
            let put: Vec<u32> = bench.put.iter().flatten().map(|(frame, _)| *frame).collect();
            prop_assert!(put.is_sorted_by(|a, b| a < b));
            prop_assert!(expected.iter().all(|frame| put.contains(frame)));
            let mut before = None;
            for step in &bench.put {
                if let Some((frame, begins)) = step {
                    prop_assert_eq!(before == frame.checked_sub(1) && before.is_some(), !begins);
                }
                before = step.map(|(frame, _)| frame);
            }
        }
    }
}
