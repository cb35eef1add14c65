//! What is late, lost or asked for again: lines sent again by number, questions asked again, outcomes that stay unknown.
//!
//! Only what the protocol file marks as harmless is sent twice; a move that is not answered ends as unknown.

use super::*;

impl Exchange {
    pub(super) fn on_resend(&mut self, reply: &Reply, now: Timestamp) {
        let field =
            self.spec.line.as_ref().and_then(|l| l.numbering.as_ref()).map(|n| n.resend_field.clone());
        let Some(n) = field.and_then(|f| reply.fields.get(&f).and_then(Value::as_i64)) else { return };
        let due = now.after(Duration::from_millis(RESEND_GRACE_MS).mul_f64(self.patience));
        let Some(front) = self.flight.front_mut() else { return };
        front.refused = None;
        if n >= self.next_line {
            // It asks for what comes next: it has everything we sent.
            front.received = true;
            front.deadline = due;
            self.notes.push(format!("the device has line {} already", n - 1));
        } else {
            self.resend = Some(Resend { from: n, due });
        }
    }

    pub(super) fn send_again(&mut self, from: i64, now: Timestamp) -> Vec<(Ticket, Outcome)> {
        let known = self.history.front().is_some_and(|(first, _)| *first <= from);
        let tried = self.flight.front().map_or(0, |f| f.queued.attempts);
        if !known || tried >= MAX_ATTEMPTS {
            self.numbers_set = false;
            return self.end_all(&Failure::ResendLoop { line: from });
        }
        self.notes.push(format!("sending again from line {from}"));
        let lines = self.history.iter().filter(|(n, _)| *n >= from);
        self.again.extend(lines.flat_map(|(_, bytes)| bytes.iter().copied()));
        for f in &mut self.flight {
            f.queued.attempts += 1;
            f.deadline = now.after(f.timeout);
        }
        Vec::new()
    }

    /// Does what is due: lines asked for without an `ok`, replies that do not come.
    pub(in crate::protocol::engine) fn on_time(&mut self, now: Timestamp) -> Vec<(Ticket, Outcome)> {
        if let Some(resend) = self.resend.take_if(|r| r.due <= now) {
            return self.send_again(resend.from, now);
        }
        let mut finished = Vec::new();
        let due = |f: &Flight| f.deadline <= now;
        while let Some(at) = self.flight.iter().position(due) {
            // In order protocols only the oldest can be judged; the others wait for it.
            let at = if self.spec.flow.mode == FlowMode::IdMatched { at } else { 0 };
            if !due(&self.flight[at]) {
                break;
            }
            finished.extend(self.overdue(at, now));
        }
        finished
    }

    fn overdue(&mut self, at: usize, now: Timestamp) -> Vec<(Ticket, Outcome)> {
        let flight = &mut self.flight[at];
        if flight.received {
            return self.accept(at);
        }
        if let Some(failure) = flight.refused.take() {
            return self.end(at, Err(failure));
        }
        let retry = self.spec.cmd[&flight.queued.name].retry;
        let name = flight.queued.name.clone();
        let tries_left = flight.queued.attempts < MAX_ATTEMPTS;
        match retry {
            Retry::Resync if flight.number.is_some() && tries_left => {
                self.notes.push(format!("no reply to {name}: sending the same line again"));
                flight.queued.attempts += 1;
                flight.deadline = now.after(flight.timeout);
                self.again.extend(&flight.bytes);
                Vec::new()
            }
            Retry::Idempotent if tries_left => {
                self.notes.push(format!("no reply to {name}: asking again"));
                let flight = self.flight.remove(at).expect("the index is valid");
                self.aside.push_front(flight.queued);
                Vec::new()
            }
            _ => {
                let failure = Failure::NoReply { what: name, waited: flight.timeout };
                if flight.queued.ticket == NOBODY {
                    // What keeps the dialogue in step has failed: nothing behind it can be sent.
                    self.numbers_set = false;
                    return self.end_all(&failure);
                }
                self.distrust_acks();
                self.end(at, Err(failure))
            }
        }
    }
}
