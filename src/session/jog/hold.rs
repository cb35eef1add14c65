//! Whether a key is held: from touches and their instants to steps and glides.
//!
//! A terminal tells of a key that is held by repeating it, about thirty times a second after an initial half second;
//! some also tell when it is let go, and when their window loses the focus. A key that was touched
//! means one step. Its repeats mean that it is held, and are the dead-man's switch: when none has come for
//! [`DEAD_MAN`], nothing is wanted any more. Where repeats look like touches (most terminals), a
//! touch that follows another one within that time is a repeat.

use crate::motion::Coordinate;
use std::time::Duration;
use tokio::time::Instant;

/// A key whose repeats stay out for so long is let go. Keyboards repeat every 25 to 50 ms.
pub const DEAD_MAN: Duration = Duration::from_millis(150);

/// A coordinate and the way along it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Direction {
    /// Along, or about, which.
    pub coordinate: Coordinate,
    /// Towards larger values.
    pub positive: bool,
}

impl Direction {
    /// +1 or -1.
    pub fn sign(self) -> f64 {
        if self.positive { 1.0 } else { -1.0 }
    }
}

/// What a keyboard tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    /// A key goes down; or repeats, where the terminal does not tell the difference.
    Press(Direction),
    /// A key that is down repeats.
    Repeat(Direction),
    /// A key is let go.
    Release(Direction),
    /// The keys go to another window from now on.
    FocusLost,
}

/// What is known of the keys.
#[derive(Debug, Default)]
pub struct Hold {
    /// The terminal tells repeats from touches.
    tells_repeats: bool,
    key: Option<Key>,
    step: Option<Direction>,
}

#[derive(Debug, Clone, Copy)]
struct Key {
    direction: Direction,
    /// When it was last heard of.
    last: Instant,
    /// It has repeated: it is held.
    repeats: bool,
}

impl Hold {
    /// Nothing is touched. `tells_repeats`: the terminal tells repeats from touches.
    pub fn new(tells_repeats: bool) -> Hold {
        Hold { tells_repeats, key: None, step: None }
    }

    /// Takes in a touch.
    pub fn take(&mut self, touch: Touch, now: Instant) {
        match touch {
            Touch::Press(direction) => {
                let goes_on = |key: &Key| key.direction == direction && now - key.last <= DEAD_MAN;
                let is_repeat = !self.tells_repeats && self.key.as_ref().is_some_and(goes_on);
                if !is_repeat {
                    self.step = Some(direction);
                }
                self.key = Some(Key { direction, last: now, repeats: is_repeat });
            }
            Touch::Repeat(direction) => {
                // A repeat of a key that was let go, or that never went down here, is nobody's wish.
                if let Some(key) = self.key.as_mut().filter(|key| key.direction == direction) {
                    (key.last, key.repeats) = (now, true);
                }
            }
            Touch::Release(direction) => {
                if self.key.is_some_and(|key| key.direction == direction) {
                    self.key = None;
                }
            }
            Touch::FocusLost => self.let_go(),
        }
    }

    /// The direction of a key that is held now.
    pub fn gliding(&self, now: Instant) -> Option<Direction> {
        let alive = |key: &Key| key.repeats && now.saturating_duration_since(key.last) <= DEAD_MAN;
        self.key.as_ref().filter(|key| alive(key)).map(|key| key.direction)
    }

    /// When the key that is held will count as let go unless it is heard of again.
    pub fn heard_until(&self) -> Option<Instant> {
        self.key.as_ref().filter(|key| key.repeats).map(|key| key.last + DEAD_MAN)
    }

    /// The step that is due, once.
    pub fn take_step(&mut self) -> Option<Direction> {
        self.step.take()
    }

    /// No step is due any more.
    pub fn forget_step(&mut self) {
        self.step = None;
    }

    /// Nothing is wanted any more, whatever is still held.
    pub fn let_go(&mut self) {
        (self.key, self.step) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RIGHT: Direction = Direction { coordinate: Coordinate::X, positive: true };
    const UP: Direction = Direction { coordinate: Coordinate::Z, positive: true };

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_touch_is_one_step_and_no_glide() {
        for tells_repeats in [false, true] {
            let (mut hold, t) = (Hold::new(tells_repeats), Instant::now());
            hold.take(Touch::Press(RIGHT), t);
            assert_eq!(hold.gliding(t), None);
            assert_eq!((hold.take_step(), hold.take_step()), (Some(RIGHT), None));
        }
    }

    #[test]
    fn repeats_keep_it_going_and_their_end_ends_it() {
        let (mut hold, t) = (Hold::new(true), Instant::now());
        hold.take(Touch::Press(RIGHT), t);
        // The first repeat comes late, as keyboards have it.
        hold.take(Touch::Repeat(RIGHT), t + ms(500));
        assert_eq!(hold.gliding(t + ms(500)), Some(RIGHT));
        hold.take(Touch::Repeat(RIGHT), t + ms(530));
        assert_eq!(hold.heard_until(), Some(t + ms(680)));
        assert_eq!(hold.gliding(t + ms(680)), Some(RIGHT));
        assert_eq!(hold.gliding(t + ms(681)), None, "the dead-man's time is up");
        hold.take(Touch::Repeat(RIGHT), t + ms(900));
        hold.take(Touch::Release(RIGHT), t + ms(910));
        assert_eq!(hold.gliding(t + ms(910)), None);
        hold.take(Touch::Repeat(RIGHT), t + ms(920));
        assert_eq!(hold.gliding(t + ms(920)), None, "it was let go");
    }

    #[test]
    fn a_terminal_that_tells_nothing_is_understood() {
        let (mut hold, t) = (Hold::new(false), Instant::now());
        for at in [0, 500, 530, 560] {
            hold.take(Touch::Press(RIGHT), t + ms(at));
        }
        assert_eq!(hold.gliding(t + ms(560)), Some(RIGHT));
        assert_eq!(hold.gliding(t + ms(711)), None);
        // Tapping slowly is no holding.
        let (mut hold, mut steps) = (Hold::new(false), 0);
        for i in 0..5 {
            let at = t + ms(i * 200);
            hold.take(Touch::Press(RIGHT), at);
            steps += u32::from(hold.take_step().is_some());
            assert_eq!(hold.gliding(at), None);
        }
        assert_eq!(steps, 5);
    }

    #[test]
    fn another_key_and_another_window_end_it() {
        let (mut hold, t) = (Hold::new(true), Instant::now());
        hold.take(Touch::Press(RIGHT), t);
        hold.take(Touch::Repeat(RIGHT), t + ms(400));
        hold.take(Touch::Press(UP), t + ms(410));
        assert_eq!(hold.gliding(t + ms(410)), None);
        hold.take(Touch::Repeat(RIGHT), t + ms(420));
        assert_eq!(hold.gliding(t + ms(420)), None, "the older key repeats no more");
        hold.take(Touch::Repeat(UP), t + ms(430));
        assert_eq!(hold.gliding(t + ms(430)), Some(UP));
        hold.take(Touch::FocusLost, t + ms(440));
        assert_eq!((hold.gliding(t + ms(440)), hold.take_step()), (None, None));
    }

    fn touches() -> impl Strategy<Value = Vec<(u8, u64)>> {
        proptest::collection::vec((0_u8..7, 0_u64..400), 1..60)
    }

    proptest! {
        #[test]
        fn nothing_glides_that_was_not_heard_of_within_the_dead_mans_time(
            touches in touches(), tells_repeats: bool, later in 151_u64..10_000
        ) {
            let (mut hold, mut t) = (Hold::new(tells_repeats), Instant::now());
            let mut heard = [None::<Instant>; 2];
            for (what, after) in touches {
                t += ms(after);
                let direction = if what % 2 == 0 { RIGHT } else { UP };
                if what < 4 {
                    heard[usize::from(what % 2)] = Some(t);
                }
                hold.take(match what {
                    0 | 1 => Touch::Press(direction),
                    2 | 3 => Touch::Repeat(direction),
                    4 | 5 => Touch::Release(direction),
                    _ => Touch::FocusLost,
                }, t);
                if let Some(gliding) = hold.gliding(t) {
                    let last = heard[usize::from(gliding == UP)];
                    prop_assert!(last.is_some_and(|last| t - last <= DEAD_MAN), "{gliding:?} was not heard of");
                    prop_assert!(what != 6 && !(what >= 4 && gliding == direction), "it was let go");
                }
            }
            prop_assert_eq!(hold.gliding(t + ms(later)), None);
        }
    }
}
