//! The end of motion, and how it is told from a stall.
//!
//! Motion has ended when fresh answers say so, several in a row where the protocol's file asks for it; or when the
//! queue has come to the move. A device has stalled when its *position* has not changed for a while: an answer alone
//! is no progress. Where the answers about the state do not hold the position it is asked for, too, now and then.

use super::task::{Asking, Check, take_answers};
use super::*;

/// Waiting for the end of motion.
#[derive(Debug)]
pub(super) struct Settle {
    pub(super) stall: Duration,
    pub(super) ask: Asking,
    pub(super) idle_in_a_row: u32,
    pub(super) last: Vec<Option<f64>>,
    pub(super) last_state: Option<MotionState>,
    pub(super) progress: Timestamp,
    pub(super) answered: Timestamp,
    /// When the positions are asked for, too, where the answers about the state do not hold them.
    pub(super) look_where: Timestamp,
}

/// How often the positions are asked for in the time after which a device without progress has stalled.
const LOOKS_A_STALL: f64 = 4.0;

impl Engine {
    /// What is known of a motion that has just begun.
    pub(super) fn settle(&mut self, stall: Duration, expected: Option<Duration>, now: Timestamp) -> Settle {
        self.rested_at = None;
        Settle {
            stall,
            ask: Asking { ends: expected.map(|lasts| now.after(lasts)), ..self.asking(now) },
            idle_in_a_row: 0,
            last: Vec::new(),
            last_state: None,
            progress: now,
            answered: now,
            look_where: now.after(stall.div_f64(LOOKS_A_STALL)),
        }
    }

    /// Whether motion has ended: fresh answers that say so, several in a row where the file asks it.
    pub(super) fn check_settle(
        &mut self,
        settle: &mut Settle,
        answers: &mut VecDeque<(Ticket, Outcome)>,
        now: Timestamp,
    ) -> Check {
        if let Some(failure) = self.flag_failure.take() {
            return Check::Failed(failure);
        }
        // The device says that it has arrived: ask at once whether that is so.
        if let Some(event) = &self.spec.done.event
            && let Some(at) = self.classes_seen.iter().position(|r| r.class == *event)
        {
            self.classes_seen.remove(at);
            (settle.ask.due, settle.ask.look) = (now, now);
        }
        let (all_answered, replies, failed) = take_answers(&mut settle.ask, answers);
        if let Some(failure) = failed {
            return Check::Failed(failure);
        }
        let field = self.spec.done.field.clone();
        let index = field.and_then(|f| replies.iter().find_map(|r| r.fields.get(&f).and_then(Value::as_i64)));
        if settle.ask.asked && self.spec.done.method == DoneMethod::QueueIndex {
            if let (Some(now_at), Some(wanted)) = (index, self.queue_index)
                && now_at >= wanted
            {
                return Check::Met;
            }
            if index.is_some() {
                settle.answered = now;
            }
        } else if settle.ask.asked && all_answered && self.state_reports > settle.ask.reports {
            settle.ask.reports = self.state_reports;
            settle.ask.asked = false;
            settle.answered = now;
            match self.state() {
                Some(MotionState::Idle) => {
                    settle.idle_in_a_row += 1;
                    self.rested_at.get_or_insert(now);
                }
                Some(MotionState::Alarm) => {
                    return Check::Failed(Failure::Alarm {
                        code: "state".to_owned(),
                        text: "the device is locked by an alarm".to_owned(),
                        trust: Trust::Lost,
                        recover: None,
                        next: "home it".to_owned(),
                    });
                }
                state => {
                    settle.idle_in_a_row = 0;
                    self.rested_at = None;
                    if state != settle.last_state {
                        settle.progress = now;
                    }
                    settle.last_state = state;
                }
            }
            if settle.idle_in_a_row >= self.spec.done.confirm_n {
                return Check::Met;
            }
        }
        // Progress is a position that changes: an answer alone is none.
        let here: Vec<Option<f64>> = self.positions().iter().map(|r| r.map(|r| r.value)).collect();
        if here != settle.last {
            settle.last = here;
            settle.progress = now;
        }
        let silence = settle.stall.max(Duration::from_millis(2000)).mul_f64(self.patience);
        if now.since(settle.answered) >= silence && !self.is_silent() {
            return Check::Failed(Failure::NoReply {
                what: "questions about the state".to_owned(),
                waited: silence,
            });
        }
        let stalled = now.since(settle.progress) >= settle.stall.mul_f64(self.patience.max(1.0));
        let may_move =
            settle.last_state == Some(MotionState::Moving) || self.spec.done.method == DoneMethod::QueueIndex;
        if stalled && may_move && settle.idle_in_a_row == 0 {
            return Check::Failed(Failure::Stalled { stall: settle.stall });
        }
        let asked_before = settle.ask.tickets.len();
        self.ask(&mut settle.ask, now);
        if settle.ask.tickets.len() > asked_before && now >= settle.look_where {
            settle.look_where = now.after(settle.stall.div_f64(LOOKS_A_STALL));
            let name = self.spec.position.command.clone();
            for (name, axis, fields) in name.map_or_else(Vec::new, |name| self.addresses(&name)) {
                let ticket = self.ticket();
                if self.exchange.submit(ticket, &name, axis, fields, None).is_ok() {
                    settle.ask.tickets.push(ticket);
                }
            }
        }
        Check::Waiting
    }
}
