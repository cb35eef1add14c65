//! The terminal, key by key; put back as it was when this is dropped.

use super::keys::Key;
use crossterm::event::{
    DisableFocusChange, EnableFocusChange, KeyboardEnhancementFlags, PopKeyboardEnhancementFlags,
    PushKeyboardEnhancementFlags,
};
use crossterm::{cursor, execute, terminal};
use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::sync::mpsc;

/// Whether there is one.
pub(super) fn is_one() -> bool {
    io::stdin().is_terminal() && io::stderr().is_terminal()
}

/// A terminal that gives single keys.
pub(super) struct Terminal {
    keys: mpsc::UnboundedReceiver<Key>,
    tells_repeats: bool,
    closed: Arc<AtomicBool>,
}

/// How often the reading thread looks whether it is still wanted.
const LOOK_UP: Duration = Duration::from_millis(50);

impl Terminal {
    pub(super) fn open() -> io::Result<Terminal> {
        terminal::enable_raw_mode()?;
        // From here on a drop puts everything back.
        let (sender, keys) = mpsc::unbounded_channel();
        let mut opened = Terminal { keys, tells_repeats: false, closed: Arc::default() };
        // A terminal that does not answer the question has no such reports.
        opened.tells_repeats = terminal::supports_keyboard_enhancement().unwrap_or(false);
        TELLS_REPEATS.store(opened.tells_repeats, Ordering::SeqCst);
        if opened.tells_repeats {
            let flags = KeyboardEnhancementFlags::DISAMBIGUATE_ESCAPE_CODES
                | KeyboardEnhancementFlags::REPORT_EVENT_TYPES;
            execute!(io::stderr(), PushKeyboardEnhancementFlags(flags))?;
        }
        execute!(io::stderr(), EnableFocusChange, cursor::Hide)?;
        let closed = opened.closed.clone();
        std::thread::Builder::new().name("keys".into()).spawn(move || {
            while !closed.load(Ordering::SeqCst) {
                match crossterm::event::poll(LOOK_UP) {
                    Ok(false) => {}
                    Ok(true) => match crossterm::event::read() {
                        Ok(event) => match sender.send(event) {
                            Ok(()) => {}
                            Err(_nobody_listens) => break,
                        },
                        Err(_) => break,
                    },
                    Err(_) => break,
                }
            }
        })?;
        Ok(opened)
    }

    /// Whether repeats and releases are told.
    pub(super) fn tells_repeats(&self) -> bool {
        self.tells_repeats
    }

    /// The next key; `None` when the terminal is gone.
    pub(super) async fn key(&mut self) -> Option<Key> {
        self.keys.recv().await
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.closed.store(true, Ordering::SeqCst);
        put_back();
    }
}

/// Whether the terminal was told to tell repeats.
static TELLS_REPEATS: AtomicBool = AtomicBool::new(false);

/// Puts the terminal back as it was. One that is gone needs no putting back.
pub(super) fn put_back() {
    if TELLS_REPEATS.swap(false, Ordering::SeqCst) {
        _ = execute!(io::stderr(), PopKeyboardEnhancementFlags);
    }
    _ = execute!(io::stderr(), DisableFocusChange, cursor::Show);
    _ = terminal::disable_raw_mode();
}
