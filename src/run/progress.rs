//! Progress on the terminal: one bar with ETA and counts by status; plain lines where there is no terminal.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::outcome::Status;

/// Failures shown while a run is at work.
const FAILURES_SHOWN: usize = 10;
const LINE_EVERY: Duration = Duration::from_secs(10);

pub struct Progress {
    bar: Option<ProgressBar>,
    total: usize,
    counts: BTreeMap<Status, usize>,
    started: Instant,
    last_line: Instant,
}

impl Progress {
    pub fn new(total: usize) -> Self {
        let style = ProgressStyle::with_template("{elapsed_precise} [{bar:32}] {pos}/{len} jobs, ETA {eta}  {msg}")
            .expect("the template is valid")
            .progress_chars("=> ");
        let bar = (total > 0 && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new(total as u64).with_style(style);
            bar.enable_steady_tick(Duration::from_millis(250));
            bar
        });
        let now = Instant::now();
        Self { bar, total, counts: BTreeMap::new(), started: now, last_line: now }
    }

    /// Counts a job; a failed one is shown at once.
    pub fn finished(&mut self, index: usize, status: Status, error: Option<&str>) {
        *self.counts.entry(status).or_default() += 1;
        if status != Status::Converged {
            self.failed(&format!("job {index}: {}: {}", status.name(), error.unwrap_or("no reason given")));
        }
        let done: usize = self.counts.values().sum();
        match &self.bar {
            Some(bar) => {
                bar.set_message(self.summary());
                bar.set_position(done as u64);
            }
            None if done == self.total || self.last_line.elapsed() >= LINE_EVERY => {
                self.last_line = Instant::now();
                let elapsed = self.started.elapsed().as_secs_f64();
                let left = elapsed / done as f64 * (self.total - done) as f64;
                eprintln!("{done}/{} jobs after {elapsed:.1} s, ETA {left:.0} s: {}", self.total, self.summary());
            }
            None => {}
        }
    }

    fn failed(&self, text: &str) {
        let failed: usize = self.counts.iter().filter(|(s, _)| **s != Status::Converged).map(|(_, count)| count).sum();
        let text = match failed {
            0..=FAILURES_SHOWN => text.to_owned(),
            _ if failed == FAILURES_SHOWN + 1 => "… further failed jobs are counted only".to_owned(),
            _ => return,
        };
        match &self.bar {
            Some(bar) => bar.println(text),
            None => eprintln!("{text}"),
        }
    }

    fn summary(&self) -> String {
        self.counts.iter().map(|(status, count)| format!("{count} {}", status.name())).collect::<Vec<_>>().join(", ")
    }

    pub fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish();
        }
    }
}
