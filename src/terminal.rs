//! The one place for output. Printing never fails a run, and a terminal that takes no more does not hold it up.

use std::io::{IsTerminal, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, SyncSender};
use std::time::Duration;

/// What standard output failed with, if not with a reader that has gone.
static FAILURE: OnceLock<std::io::Error> = OnceLock::new();
/// Notes that may wait for standard error; further ones are lost.
const WAITING: usize = 1024;
/// How long a note is waited for, so that notes and tables stay in order.
const PATIENCE: Duration = Duration::from_millis(200);
/// Characters in a line where there is no terminal to ask.
const WIDTH: usize = 80;
/// Narrower terminals wrap lines themselves.
const NARROWEST: usize = 40;

/// How the user wants to be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Voice {
    pub color: Color,
    /// Only errors and the last line.
    pub quiet: bool,
    /// A line for each finished job.
    pub verbose: bool,
}

/// When the output is in colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Color {
    /// On a terminal, unless NO_COLOR is set.
    #[default]
    Auto,
    Always,
    Never,
}

static VOICE: OnceLock<Voice> = OnceLock::new();

/// Sets how the program speaks; the first call counts.
pub fn speak(voice: Voice) {
    let _ = VOICE.set(voice);
}

fn voice() -> Voice {
    VOICE.get().copied().unwrap_or_default()
}

/// Whether the user wants a line for each finished job.
pub fn is_verbose() -> bool {
    voice().verbose
}

/// Whether the user wants only errors and the last line.
pub fn is_quiet() -> bool {
    voice().quiet
}

fn colors(is_terminal: bool) -> bool {
    let wanted = || std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    match voice().color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => is_terminal && wanted(),
    }
}

/// Whether standard output is in colour.
pub fn is_colored() -> bool {
    colors(std::io::stdout().is_terminal())
}

/// Characters in a line of standard output; [`WIDTH`] where that is not a terminal.
pub fn width() -> usize {
    let size = terminal_size::terminal_size_of(std::io::stdout());
    size.map_or(WIDTH, |(width, _)| usize::from(width.0)).max(NARROWEST)
}

/// A heading, bold where there is colour.
pub fn heading(text: &str) -> String {
    if is_colored() { format!("\x1b[1m{text}\x1b[0m") } else { text.to_owned() }
}

/// A warning, yellow where there is colour.
pub fn warning(text: &str) -> String {
    if is_colored() { format!("\x1b[33m{text}\x1b[0m") } else { text.to_owned() }
}

/// Prints a line of the answer. That the reader has gone (`sinew show … | head`) is no failure.
pub fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let text = if colors(out.is_terminal()) { colored(text) } else { visible(text) };
    if let Err(error) = writeln!(out, "{text}").and_then(|()| out.flush())
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        let _ = FAILURE.set(error);
    }
}

/// Why not all of the answer could be printed.
pub fn failure() -> Option<&'static std::io::Error> {
    FAILURE.get()
}

/// Prints a note beside the answer, on standard error; nothing with `--quiet`. Where standard error is full or gone, the
/// note is lost.
pub fn note(text: &str) {
    if !is_quiet() {
        error(text);
    }
}

/// Prints an error, on standard error.
pub fn error(text: &str) {
    static IS_STUCK: AtomicBool = AtomicBool::new(false);
    let (written, is_written) = mpsc::sync_channel(1);
    let text = if colors(std::io::stderr().is_terminal()) { colored(text) } else { visible(text) };
    if writer().try_send((text, written)).is_ok()
        && !IS_STUCK.load(Ordering::Relaxed)
        && is_written.recv_timeout(PATIENCE) == Err(mpsc::RecvTimeoutError::Timeout)
    {
        IS_STUCK.store(true, Ordering::Relaxed);
    }
}

type Note = (String, SyncSender<()>);

/// A thread of its own writes notes, because a pipe that nobody reads blocks whoever writes to it.
fn writer() -> &'static SyncSender<Note> {
    static WRITER: OnceLock<SyncSender<Note>> = OnceLock::new();
    WRITER.get_or_init(|| {
        let (send, receive) = mpsc::sync_channel::<Note>(WAITING);
        std::thread::spawn(move || {
            for (text, written) in receive {
                let _ = writeln!(std::io::stderr(), "{text}");
                let _ = written.send(());
            }
        });
        send
    })
}

/// A text with its control characters made visible: names from files shall not move the cursor. Lines and tabs stay.
pub fn visible(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '\n' | '\t' => c,
            '\0'..='\x1f' => char::from_u32(0x2400 + c as u32).expect("control pictures"),
            '\x7f' => '␡',
            // Controls of eight bits, and those that turn the direction of a text.
            '\u{80}'..='\u{9f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => char::REPLACEMENT_CHARACTER,
            _ => c,
        })
        .collect()
}

/// [`visible`], but colours stay (`ESC [ 31 m`).
fn colored(text: &str) -> String {
    let mut parts = text.split("\x1b[");
    let mut out = visible(parts.next().unwrap_or_default());
    for part in parts {
        let digits = part.bytes().take_while(|b| b.is_ascii_digit() || *b == b';').count();
        out.push_str(if part[digits..].starts_with('m') { "\x1b[" } else { "␛[" });
        out.push_str(&visible(part));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_do_nothing() {
        assert_eq!(visible("a\x1b[2Jb\r\n\tc\u{9b}1m\u{202e}"), "a␛[2Jb␍\n\tc\u{fffd}1m\u{fffd}");
        assert_eq!(colored("\x1b[1;31mred\x1b[0m \x1b[2J\x1b]0;title\x07"), "\x1b[1;31mred\x1b[0m ␛[2J␛]0;title␇");
    }
}
