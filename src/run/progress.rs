//! Progress on the terminal: a bar with ETA and counts by status; plain lines where there is no terminal.
//!
//! A separate thread draws it, so that a terminal that is stopped, full or gone does not delay the thread that writes
//! finished jobs.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::outcome::Status;
use crate::terminal::{self, note, visible};

/// Failures shown during a run.
const FAILURES_SHOWN: usize = 10;
const DRAW_EVERY: Duration = Duration::from_millis(250);
const LINE_EVERY: Duration = Duration::from_secs(10);
/// How long the end of a run waits for the last line to be drawn.
const END_TIMEOUT: Duration = Duration::from_secs(1);

/// Counts finished jobs.
pub struct Progress {
    state: Arc<Mutex<State>>,
    /// Dropped to end the drawing thread.
    end: Option<Sender<()>>,
    ended: Receiver<()>,
}

#[derive(Clone, Default)]
struct State {
    counts: BTreeMap<Status, usize>,
    /// Lines that have not been printed yet.
    lines: Vec<String>,
}

impl State {
    fn done(&self) -> usize {
        self.counts.values().sum()
    }

    fn failed(&self) -> usize {
        self.done() - self.counts.get(&Status::Converged).copied().unwrap_or(0)
    }

    fn summary(&self) -> String {
        self.counts.iter().map(|(status, count)| format!("{count} {}", status.name())).collect::<Vec<_>>().join(", ")
    }
}

impl Progress {
    pub fn new(total: usize) -> Self {
        let state = Arc::<Mutex<State>>::default();
        let ((end, is_ending), (has_ended, ended)) = (mpsc::channel::<()>(), mpsc::channel());
        let seen = Arc::clone(&state);
        std::thread::spawn(move || {
            let mut screen = Screen::new(total);
            while is_ending.recv_timeout(DRAW_EVERY) == Err(RecvTimeoutError::Timeout) {
                screen.draw(take_state(&seen));
            }
            screen.draw(take_state(&seen));
            screen.end();
            let _ = has_ended.send(());
        });
        Self { state, end: Some(end), ended }
    }

    /// Counts a job. Prints the first failures, or every job with `--verbose`.
    pub fn finished(&self, index: usize, status: Status, error: Option<&str>) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        *state.counts.entry(status).or_default() += 1;
        if terminal::is_verbose() {
            let reason = error.map(|error| format!(": {error}")).unwrap_or_default();
            state.lines.push(format!("job {index}: {}{reason}", status.name()));
            return;
        }
        if status == Status::Converged {
            return;
        }
        match state.failed() {
            0..=FAILURES_SHOWN => {
                let text = format!("job {index}: {}: {}", status.name(), error.unwrap_or("no reason given"));
                state.lines.push(text);
            }
            failed if failed == FAILURES_SHOWN + 1 => {
                state.lines.push("… more failed jobs are only counted".to_owned());
            }
            _ => {}
        }
    }

    /// Prints the final state and ends the drawing thread.
    pub fn end(&mut self) {
        if self.end.take().is_some() {
            let _ = self.ended.recv_timeout(END_TIMEOUT);
        }
    }
}

fn take_state(state: &Mutex<State>) -> State {
    let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
    let lines = std::mem::take(&mut state.lines);
    State { lines, ..state.clone() }
}

struct Screen {
    bar: Option<ProgressBar>,
    total: usize,
    started: Instant,
    last_line: Instant,
    /// Number of jobs in the last line.
    counted: usize,
}

impl Screen {
    fn new(total: usize) -> Self {
        let style = ProgressStyle::with_template("{elapsed_precise} [{bar:24}] {pos}/{len} jobs, ETA {eta}  {msg}")
            .expect("the template is valid")
            .progress_chars("=> ");
        let is_shown = total > 0 && std::io::stderr().is_terminal() && !terminal::is_quiet();
        let bar = is_shown.then(|| ProgressBar::new(total as u64).with_style(style));
        let now = Instant::now();
        Self { bar, total, started: now, last_line: now, counted: 0 }
    }

    fn draw(&mut self, state: State) {
        let done = state.done();
        for line in &state.lines {
            match &self.bar {
                Some(bar) => bar.println(visible(line)),
                None => note(line),
            }
        }
        if let Some(bar) = &self.bar {
            bar.set_message(state.summary());
            bar.set_position(done as u64);
            bar.tick();
        } else if done > self.counted && (done == self.total || self.last_line.elapsed() >= LINE_EVERY) {
            (self.last_line, self.counted) = (Instant::now(), done);
            let elapsed = self.started.elapsed().as_secs_f64();
            let left = elapsed / done as f64 * (self.total - done) as f64;
            note(&format!("{done}/{} jobs after {elapsed:.1} s, ETA {left:.0} s: {}", self.total, state.summary()));
        }
    }

    fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish();
        }
    }
}
