//! What keys mean.

use crate::motion::Coordinate;
use crate::session::jog::{Direction, Touch, Wish};
use crossterm::event::{Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

/// What a terminal tells.
pub(super) type Key = Event;

/// What a key means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meaning {
    /// For the bench.
    Wish(Wish),
    /// A larger step, or a smaller one.
    Step(bool),
    /// A higher feed, or a lower one.
    Faster(bool),
}

/// What an event means, if anything.
pub(super) fn meaning(event: Event) -> Option<Meaning> {
    let key = match event {
        Event::Key(key) => key,
        Event::FocusLost => return Some(Meaning::Wish(Wish::Touch(Touch::FocusLost))),
        _ => return None,
    };
    if let Some(direction) = direction(key.code) {
        return Some(Meaning::Wish(Wish::Touch(match key.kind {
            KeyEventKind::Press => Touch::Press(direction),
            KeyEventKind::Repeat => Touch::Repeat(direction),
            KeyEventKind::Release => Touch::Release(direction),
        })));
    }
    if key.kind == KeyEventKind::Release {
        return None;
    }
    command(key)
}

fn direction(code: KeyCode) -> Option<Direction> {
    let (coordinate, positive) = match code {
        KeyCode::Left => (Coordinate::X, false),
        KeyCode::Right => (Coordinate::X, true),
        KeyCode::Up => (Coordinate::Y, false),
        KeyCode::Down => (Coordinate::Y, true),
        KeyCode::PageDown => (Coordinate::Z, false),
        KeyCode::PageUp => (Coordinate::Z, true),
        KeyCode::Char(',') => (Coordinate::Theta, false),
        KeyCode::Char('.') => (Coordinate::Theta, true),
        _ => return None,
    };
    Some(Direction { coordinate, positive })
}

fn command(key: KeyEvent) -> Option<Meaning> {
    Some(match key.code {
        KeyCode::Char('c' | 'C') if key.modifiers.contains(KeyModifiers::CONTROL) => {
            Meaning::Wish(Wish::Quit)
        }
        KeyCode::Char('q') | KeyCode::Esc => Meaning::Wish(Wish::Quit),
        KeyCode::Char(' ') => Meaning::Wish(Wish::Stop),
        KeyCode::Char('h') => Meaning::Wish(Wish::Home),
        KeyCode::Char('+' | '=') => Meaning::Step(true),
        KeyCode::Char('-') => Meaning::Step(false),
        KeyCode::Char('f') => Meaning::Faster(true),
        KeyCode::Char('s') => Meaning::Faster(false),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(code: KeyCode, kind: KeyEventKind) -> Option<Meaning> {
        meaning(Event::Key(KeyEvent::new_with_kind(code, KeyModifiers::NONE, kind)))
    }

    #[test]
    fn kinds_are_kept_apart_and_other_releases_mean_nothing() {
        let left = Direction { coordinate: Coordinate::X, positive: false };
        let wish = |touch| Some(Meaning::Wish(Wish::Touch(touch)));
        assert_eq!(key(KeyCode::Left, KeyEventKind::Press), wish(Touch::Press(left)));
        assert_eq!(key(KeyCode::Left, KeyEventKind::Repeat), wish(Touch::Repeat(left)));
        assert_eq!(key(KeyCode::Left, KeyEventKind::Release), wish(Touch::Release(left)));
        assert_eq!(key(KeyCode::Char('h'), KeyEventKind::Release), None);
        assert_eq!(key(KeyCode::Char('h'), KeyEventKind::Press), Some(Meaning::Wish(Wish::Home)));
        assert_eq!(meaning(Event::FocusLost), wish(Touch::FocusLost));
        let ctrl_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        assert_eq!(meaning(Event::Key(ctrl_c)), Some(Meaning::Wish(Wish::Quit)));
    }
}
