//! All output to the terminal. A failed write never fails a run, and a blocked terminal does not delay it.

use std::io::{IsTerminal, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, SyncSender};
use std::time::Duration;

/// The first error of standard output, except a broken pipe.
static FAILURE: OnceLock<std::io::Error> = OnceLock::new();
/// Number of notes that can wait for standard error; further ones are lost.
const QUEUE_LENGTH: usize = 1024;
/// How long to wait until a note is written, so that notes and tables stay in order.
const NOTE_TIMEOUT: Duration = Duration::from_millis(200);
/// Characters per line if standard output is not a terminal.
const DEFAULT_WIDTH: usize = 80;
/// Smallest number of characters per line; narrower terminals wrap lines themselves.
const MIN_WIDTH: usize = 40;

/// The user's choices for the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Voice {
    pub color: Color,
    /// Print only errors and the last line.
    pub quiet: bool,
    /// Print a line for each finished job.
    pub verbose: bool,
}

/// When to use colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Color {
    /// On a terminal, unless NO_COLOR is set.
    #[default]
    Auto,
    Always,
    Never,
}

static VOICE: OnceLock<Voice> = OnceLock::new();

/// Sets the user's choices for the output. Only the first call has an effect.
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

/// Whether output is in colour, depending on whether it goes to a terminal.
pub fn uses_color(is_terminal: bool) -> bool {
    let is_allowed = || std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    match voice().color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => is_terminal && is_allowed(),
    }
}

/// Whether standard output is in colour.
pub fn is_colored() -> bool {
    uses_color(std::io::stdout().is_terminal())
}

/// Characters per line of standard output; [`DEFAULT_WIDTH`] if that is not a terminal.
pub fn width() -> usize {
    let size = terminal_size::terminal_size_of(std::io::stdout());
    size.map_or(DEFAULT_WIDTH, |(width, _)| usize::from(width.0)).max(MIN_WIDTH)
}

/// A heading; bold if colour is used.
pub fn heading(text: &str) -> String {
    if is_colored() { format!("\x1b[1m{text}\x1b[0m") } else { text.to_owned() }
}

/// A warning; yellow if colour is used.
pub fn warning(text: &str) -> String {
    if is_colored() { format!("\x1b[33m{text}\x1b[0m") } else { text.to_owned() }
}

/// Prints a line on standard output. A broken pipe (`sinew show … | head`) is not an error.
pub fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let text = if uses_color(out.is_terminal()) { colored(text) } else { visible(text) };
    if let Err(error) = writeln!(out, "{text}").and_then(|()| out.flush())
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        let _ = FAILURE.set(error);
    }
}

/// The first error of standard output, if any.
pub fn failure() -> Option<&'static std::io::Error> {
    FAILURE.get()
}

/// Prints a note on standard error, unless `--quiet` is set. The note is lost if standard error is blocked or closed.
pub fn note(text: &str) {
    if !is_quiet() {
        error(text);
    }
}

/// Prints an error on standard error.
pub fn error(text: &str) {
    static IS_STUCK: AtomicBool = AtomicBool::new(false);
    let (written, is_written) = mpsc::sync_channel(1);
    let text = if uses_color(std::io::stderr().is_terminal()) { colored(text) } else { visible(text) };
    if writer().try_send((text, written)).is_ok()
        && !IS_STUCK.load(Ordering::Relaxed)
        && is_written.recv_timeout(NOTE_TIMEOUT) == Err(mpsc::RecvTimeoutError::Timeout)
    {
        IS_STUCK.store(true, Ordering::Relaxed);
    }
}

type PendingNote = (String, SyncSender<()>);

/// Writes notes in a separate thread, because a pipe that nobody reads blocks its writer.
fn writer() -> &'static SyncSender<PendingNote> {
    static WRITER: OnceLock<SyncSender<PendingNote>> = OnceLock::new();
    WRITER.get_or_init(|| {
        let (send, receive) = mpsc::sync_channel::<PendingNote>(QUEUE_LENGTH);
        std::thread::spawn(move || {
            for (text, written) in receive {
                let _ = writeln!(std::io::stderr(), "{text}");
                let _ = written.send(());
            }
        });
        send
    })
}

/// Makes control characters visible, so that names from files cannot move the cursor. Line breaks and tabs are kept.
pub fn visible(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '\n' | '\t' => c,
            '\0'..='\x1f' => char::from_u32(0x2400 + c as u32).expect("control pictures"),
            '\x7f' => '␡',
            // 8-bit control characters, and characters that change the direction of text.
            '\u{80}'..='\u{9f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => char::REPLACEMENT_CHARACTER,
            _ => c,
        })
        .collect()
}

/// Like [`visible`], but keeps colours (`ESC [ 31 m`).
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
    fn control_characters_are_made_visible() {
        assert_eq!(visible("a\x1b[2Jb\r\n\tc\u{9b}1m\u{202e}"), "a␛[2Jb␍\n\tc\u{fffd}1m\u{fffd}");
        assert_eq!(colored("\x1b[1;31mred\x1b[0m \x1b[2J\x1b]0;title\x07"), "\x1b[1;31mred\x1b[0m ␛[2J␛]0;title␇");
    }
}
