//! [`Resampled`]: a log whose signals have their values at different times -> rows at the times of its currents, or at even times.
//!
//! A row is a sample where the base ([`Base`]) has one. Between their own values the other signals lie on their [`Course`]. Values further apart
//! than [`STEPS_MAX`] samples, and half a one by rounding and jitter, are no neighbours: what lies between them is missing.

use std::collections::VecDeque;

use super::course::{Course, News, Piece};
use super::log::{Between, Interpolated, SignalInfo, SignalLog, TextValue, Unusable};
use crate::damage::{Damage, Place};
use hmd_core::log_map::RotorFrame;

/// Most samples between two values of one signal.
pub(super) const STEPS_MAX: f64 = 8.0;

/// What rounding and jitter of their times add to that, samples.
const STEPS_MARGIN: f64 = 0.5;

/// First rows that show how far apart the values of each signal are.
const FIRST_ROWS: usize = 256;

/// Most rows that wait for a later value; the oldest goes on without it.
const QUEUE_MAX: usize = 1024;

/// What makes a sample.
#[derive(Clone, Copy, Debug)]
pub(super) enum Base {
    /// A value in this column.
    Column(usize),
    /// A step of time, in the log's numbers.
    Even {
        /// Its length.
        step: f64,
    },
}

/// A log with values for each of its samples.
#[derive(Debug)]
pub(super) struct Resampled {
    log: Box<dyn SignalLog>,
    time: usize,
    base: Base,
    /// First time of the log, and number of the next even step from there.
    even: Option<(f64, f64)>,
    courses: Vec<Course>,
    /// Where phase currents are interpolated; `None`: as they are.
    frame: Option<RotorFrame>,
    /// Rows of the log that were read ahead, each with its place.
    ahead: VecDeque<(Place, Result<Vec<f64>, Damage>)>,
    queue: VecDeque<Result<Waiting, Damage>>,
    /// Time of the sample before, and how far apart samples usually are, in the log's numbers.
    last_sample: f64,
    usual_step: UsualStep,
    /// Time of the row before.
    last_row: f64,
    /// Where the row taken last is, and the one handed out last.
    place_taken: Place,
    place: Place,
    ended: bool,
}

/// The usual distance of times, the median of the newest: two stamps that jitter do not change it.
#[derive(Debug, Default)]
struct UsualStep {
    newest: VecDeque<f64>,
    median: Option<f64>,
}

impl UsualStep {
    const NEWEST: usize = 15;

    fn add(&mut self, step: f64) {
        if step.is_finite() && step > 0.0 {
            if self.newest.len() == Self::NEWEST {
                self.newest.pop_front();
            }
            self.newest.push_back(step);
            self.median = median(self.newest.iter().copied());
        }
    }
}

/// The upper one of two in the middle.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// A row that waits for its values.
#[derive(Debug)]
struct Waiting {
    place: Place,
    row: Vec<f64>,
    /// It lies before the first or behind the last value of a signal.
    is_outside: bool,
}

impl Resampled {
    /// `log` with these signals selected; `time` is a place among them.
    pub(super) fn new(log: Box<dyn SignalLog>, selected: &[(usize, Between)], time: usize, base: Base) -> Self {
        Self {
            place_taken: log.place(),
            place: log.place(),
            log,
            time,
            base,
            even: None,
            courses: selected.iter().map(|(_, between)| Course::new(*between)).collect(),
            frame: None,
            ahead: VecDeque::new(),
            queue: VecDeque::new(),
            last_sample: f64::NAN,
            usual_step: UsualStep::default(),
            last_row: f64::NAN,
            ended: false,
        }
    }

    /// The same with phase currents interpolated in the frame of the rotor.
    pub(super) fn in_frame(self, frame: Option<RotorFrame>) -> Self {
        Self { frame, ..self }
    }

    /// The first curve whose values are usually too far apart to interpolate between them, and how far, in the log's numbers; by the first rows.
    pub(super) fn too_coarse(&mut self, text: TextValue<'_>) -> Option<(usize, f64)> {
        while self.ahead.len() < FIRST_ROWS {
            match self.read(text) {
                Some(row) => self.ahead.push_back(row),
                None => break,
            }
        }
        let rows = || self.ahead.iter().filter_map(|(_, row)| row.as_ref().ok());
        let Base::Even { step } = self.base else { return None };
        let step_max = STEPS_MAX * step;
        let curves = self.courses.iter().enumerate().filter(|(_, course)| course.is_curve());
        let steps = |n: usize| {
            let times: Vec<f64> = rows()
                .filter(|row| row[n].is_finite())
                .map(|row| row[self.time])
                .collect();
            median(times.windows(2).map(|two| two[1] - two[0]).filter(|step| *step > 0.0))
        };
        let mut steps = curves.filter_map(|(n, _)| Some((n, steps(n)?)));
        steps.find(|(_, step)| *step >= step_max)
    }

    fn read(&mut self, text: TextValue<'_>) -> Option<(Place, Result<Vec<f64>, Damage>)> {
        let mut row = vec![f64::NAN; self.courses.len()];
        let read = self.log.next_row(&mut row, text)?;
        Some((self.log.place(), read.map(|()| row)))
    }

    /// Longest distance of two values that are neighbours.
    fn step_max(&self) -> f64 {
        let step = match self.base {
            Base::Column(_) => self.usual_step.median.unwrap_or(f64::INFINITY),
            Base::Even { step } => step,
        };
        (STEPS_MAX + STEPS_MARGIN) * step
    }

    /// Whether the oldest row waits for nothing.
    fn is_ready(&self) -> bool {
        let is_complete = |row: &[f64]| {
            let mut values = self.courses.iter().zip(row);
            values.all(|(course, value)| !course.is_curve() || value.is_finite())
        };
        match self.queue.front() {
            Some(Ok(waiting)) => {
                self.ended || waiting.is_outside || self.queue.len() > QUEUE_MAX || is_complete(&waiting.row)
            }
            Some(Err(_)) => true,
            None => false,
        }
    }

    fn take(&mut self, mut row: Vec<f64>) {
        let time = row[self.time];
        let is_sample = match self.base {
            Base::Column(base) => {
                let is_sample = row[base].is_finite();
                if is_sample {
                    self.usual_step.add(time - self.last_sample);
                }
                is_sample
            }
            Base::Even { step } => self.add_even(&row, step),
        };
        if is_sample {
            self.last_sample = time;
        }
        let step_max = self.step_max();
        for (n, course) in self.courses.iter_mut().enumerate() {
            let value = row[n];
            if !value.is_finite() {
                row[n] = course.held();
            } else if !course.is_curve() {
                course.hold(value);
            } else if time.is_finite() {
                match course.push(time, value, step_max) {
                    News::Begins => {
                        for waiting in self.queue.iter_mut().flatten() {
                            waiting.is_outside |= time - waiting.row[self.time] <= step_max;
                        }
                    }
                    News::Known(Some(piece)) => complete(&mut self.queue, self.time, n, course, &piece),
                    News::Known(None) => {}
                }
            }
        }
        if is_sample {
            self.queue.push_back(Ok(Waiting {
                place: self.place_taken,
                row,
                is_outside: false,
            }));
        }
    }

    /// Adds the even steps before a time, which wait for the values at that time; across a longer pause there are none. Whether one
    /// falls on the time itself.
    fn add_even(&mut self, values: &[f64], step: f64) -> bool {
        /// A step that is this near to a time, in steps, falls on it.
        const SAME: f64 = 1e-6;
        let time = values[self.time];
        if !time.is_finite() {
            return false;
        }
        let before = std::mem::replace(&mut self.last_row, time);
        let (first, next) = self.even.unwrap_or((time, 0.0));
        let number = (time - first) / step;
        // Beyond lies a pause, or a clock that was set back.
        let is_near = (-1.0..=STEPS_MAX).contains(&(number - next));
        let mut next = if is_near { next } else { (number - SAME).ceil() };
        while next < number - SAME {
            let at = first + next * step;
            // A command may have changed anywhere between two rows: the nearer one has it.
            let is_nearer = time - at < at - before;
            let held = self.courses.iter().zip(values).map(|(course, value)| {
                let is_new = is_nearer && !course.is_curve() && value.is_finite();
                if is_new { *value } else { course.held() }
            });
            let mut row: Vec<f64> = held.collect();
            row[self.time] = at;
            self.queue.push_back(Ok(Waiting {
                place: self.place_taken,
                row,
                is_outside: false,
            }));
            next += 1.0;
        }
        let falls_on = next <= number + SAME;
        self.even = Some((first, if falls_on { next + 1.0 } else { next }));
        falls_on
    }

    /// The log's last values are behind: rows that follow one of them closely are no samples.
    fn end(&mut self) {
        self.ended = true;
        for (n, course) in self.courses.iter_mut().enumerate() {
            if let Some(piece) = course.rest() {
                complete(&mut self.queue, self.time, n, course, &piece);
            }
        }
        let step_max = self.step_max();
        for waiting in self.queue.iter_mut().flatten() {
            let time = waiting.row[self.time];
            waiting.is_outside |= self.courses.iter().zip(&waiting.row).any(|(course, value)| {
                let is_behind = |last: f64| time >= last && time - last <= step_max;
                course.is_curve() && !value.is_finite() && course.last().is_some_and(is_behind)
            });
        }
    }
}

impl SignalLog for Resampled {
    fn signals(&self) -> &[SignalInfo] {
        self.log.signals()
    }

    fn select(&mut self, _: &[(usize, Between)]) -> Result<(), Unusable> {
        Err(Unusable::new("one selection of signals", "another"))
    }

    fn next_row(&mut self, row: &mut [f64], text: TextValue<'_>) -> Option<Result<(), Damage>> {
        loop {
            while self.is_ready() {
                match self.queue.pop_front()? {
                    Ok(waiting) if waiting.is_outside => {}
                    Ok(waiting) => {
                        row.copy_from_slice(&waiting.row);
                        if let Some(frame) = &self.frame {
                            frame.leave(row);
                        }
                        self.place = waiting.place;
                        return Some(Ok(()));
                    }
                    Err(damage) => return Some(Err(damage)),
                }
            }
            if self.ended {
                return None;
            }
            let Some((place, read)) = self.ahead.pop_front().or_else(|| self.read(text)) else {
                self.end();
                continue;
            };
            self.place_taken = place;
            match read {
                Ok(mut next) => {
                    for (course, value) in self.courses.iter_mut().zip(&mut next) {
                        *value = course.continued(*value);
                    }
                    if let Some(frame) = &self.frame {
                        frame.enter(&mut next);
                    }
                    self.take(next);
                }
                Err(damage) => self.queue.push_back(Err(damage)),
            }
        }
    }

    fn place(&self) -> Place {
        self.place
    }

    fn position(&self) -> Option<u64> {
        self.log.position()
    }

    fn interpolated(&self) -> Vec<Interpolated> {
        let mut all: Vec<Interpolated> = self.courses.iter().map(|course| course.interpolated).collect();
        // What the log below interpolated already; of phase currents it is in other numbers, and next to nothing.
        for (own, below) in all.iter_mut().zip(self.log.interpolated()) {
            own.values = own.values.max(below.values);
            own.error += below.error;
        }
        for (place, name) in self.frame.iter().flat_map(RotorFrame::names) {
            all[place] = Interpolated {
                in_frame: Some(name),
                ..self.courses[place].interpolated
            };
        }
        all
    }
}

/// Completes the rows that waited for a stretch of a column.
fn complete(
    queue: &mut VecDeque<Result<Waiting, Damage>>,
    time_column: usize,
    column: usize,
    course: &mut Course,
    piece: &Piece,
) {
    for waiting in queue.iter_mut().flatten() {
        let at = waiting.row[time_column];
        if !waiting.row[column].is_finite() && (piece.from..=piece.to).contains(&at) {
            let (value, error) = piece.at(at);
            waiting.row[column] = value;
            course.made(error);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::signals::CsvLog;

    const CURVE: Between = Between::Curve { wraps_after: None };

    /// Rows of time, base, a signal between its values and a held one, and what was interpolated.
    fn rows(text: &str, between: Between) -> (Vec<Result<Vec<f64>, String>>, Interpolated) {
        let mut log = CsvLog::new(Cursor::new(text.to_owned()), "a.csv").unwrap();
        let selected = [
            (0, Between::Unknown),
            (1, Between::Unknown),
            (2, between),
            (3, Between::Held),
        ];
        log.select(&selected).unwrap();
        let mut log = Resampled::new(Box::new(log), &selected, 0, Base::Column(1));
        let mut rows = Vec::new();
        let mut row = [0.0; 4];
        while let Some(read) = log.next_row(&mut row, &|_, _| None) {
            rows.push(read.map(|()| row.to_vec()).map_err(|damage| damage.to_string()));
        }
        (rows, log.interpolated()[2])
    }

    #[test]
    fn between_its_values_a_signal_lies_on_its_curve() {
        // The angle at half the rate, x = t², the command once; a row of the angle alone is no sample.
        let text = "t,i,x,c\n0,1,0,7\n1,2,,\n2,3,4,\n2.5,,6.25,\n3,4,,\n4,5,16,8\n";
        let (rows, interpolated) = rows(text, CURVE);
        let rows: Vec<Vec<f64>> = rows.into_iter().map(Result::unwrap).collect();
        assert_eq!(
            rows,
            [
                vec![0.0, 1.0, 0.0, 7.0],
                vec![1.0, 2.0, 1.0, 7.0],
                vec![2.0, 3.0, 4.0, 7.0],
                vec![3.0, 4.0, 9.0, 7.0],
                vec![4.0, 5.0, 16.0, 8.0],
            ]
        );
        assert_eq!(interpolated.values, 2);
        // A line instead of the parabola, at 1.
        assert!((interpolated.error - 1.0).abs() < 1e-9, "{interpolated:?}");
    }

    #[test]
    fn an_angle_that_begins_again_takes_the_short_way() {
        let text = "t,i,x,c\n0,1,350,\n1,2,,\n2,3,10,\n";
        let wraps = Between::Curve {
            wraps_after: Some(360.0),
        };
        let (rows, _) = rows(text, wraps);
        let angle = rows[1].as_ref().unwrap()[2];
        assert!((angle - 360.0).abs() < 1e-9, "{angle}");
    }

    #[test]
    fn what_lies_too_far_apart_or_outside_is_not_made() {
        let mut text = "t,i,x,c\n".to_owned();
        for n in 0..60 {
            let x = if (4..20).contains(&n) || n % 2 == 0 && n < 50 {
                n.to_string()
            } else {
                String::new()
            };
            let x = if (20..40).contains(&n) || n < 3 {
                String::new()
            } else {
                x
            };
            text += &format!("{n},1,{x},\n");
        }
        let (rows, _) = rows(&text, CURVE);
        let rows: Vec<Vec<f64>> = rows.into_iter().map(Result::unwrap).collect();
        let times: Vec<f64> = rows.iter().map(|row| row[0]).collect();
        // Rows close to an end of the signal are left out, those further from it are there without a value.
        let expected: Vec<f64> = (4..=48).chain(57..60).map(f64::from).collect();
        assert_eq!(times, expected);
        for row in rows {
            let is_missing = (20.0..40.0).contains(&row[0]) || row[0] > 48.0;
            assert_eq!(row[2].is_nan(), is_missing, "{row:?}");
        }
    }

    #[test]
    fn even_steps_lie_between_the_rows_and_not_across_a_pause() {
        // 3 rows a unit of time; x = 3 t, the command changes at 1. Then a pause of 100.
        let mut text = "t,x,c\n".to_owned();
        for n in 0..=6 {
            let t = f64::from(n) / 3.0;
            text += &format!("{t},{n},{}\n", i32::from(t >= 1.0));
        }
        text += "102.1,0,5\n102.4,3,5\n";
        let mut log = CsvLog::new(Cursor::new(text), "a.csv").unwrap();
        let selected = [(0, Between::Unknown), (1, CURVE), (2, Between::Held)];
        log.select(&selected).unwrap();
        let mut log = Resampled::new(Box::new(log), &selected, 0, Base::Even { step: 0.25 });
        let (mut rows, mut row) = (Vec::new(), [0.0; 3]);
        while let Some(read) = log.next_row(&mut row, &|_, _| None) {
            read.unwrap();
            rows.push(row);
        }
        let times: Vec<f64> = rows.iter().map(|row| row[0]).collect();
        let expected: Vec<f64> = (0..=8).map(|n| f64::from(n) * 0.25).chain([102.25]).collect();
        assert_eq!(times, expected);
        for [t, x, c] in &rows[..9] {
            assert!((x - 3.0 * t).abs() < 1e-9, "{t} {x}");
            assert_eq!(*c > 0.5, *t >= 5.0 / 6.0, "{t}");
        }
        assert!((rows[9][1] - 1.5).abs() < 1e-9, "{:?}", rows[9]);
    }
}
