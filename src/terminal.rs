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

/// Prints a line of the answer. That the reader has gone (`sinew show … | head`) is no failure.
pub fn print(text: &str) {
    let mut out = std::io::stdout().lock();
    let text = if out.is_terminal() { coloured(text) } else { visible(text) };
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

/// Says something beside the answer, on standard error. Where that is full or gone, it is not said.
pub fn note(text: &str) {
    static IS_STUCK: AtomicBool = AtomicBool::new(false);
    let (written, is_written) = mpsc::sync_channel(1);
    let text = if std::io::stderr().is_terminal() { coloured(text) } else { visible(text) };
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
fn coloured(text: &str) -> String {
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
        assert_eq!(coloured("\x1b[1;31mred\x1b[0m \x1b[2J\x1b]0;title\x07"), "\x1b[1;31mred\x1b[0m ␛[2J␛]0;title␇");
    }
}
