//! Sequences: procedures of the protocol file, moves, and waiting for the end of motion.
//!
//! One task runs at a time. Its steps come from a closed set of verbs: send a command, send
//! real-time bytes, wait for a class of reply, wait for a state, sleep, wait for the end of motion ([`super::settle`]).

use super::settle::Settle;
use super::*;

/// One verb with its wait.
#[derive(Debug, Clone)]
pub(super) enum Act {
    Send { name: String, axis: Option<usize>, fields: Fields, or_send: Option<String>, timeout: Option<u64> },
    Realtime(String),
    Expect { class: String, timeout: u64 },
    Until { words: Vec<String>, timeout: u64 },
    Sleep(u64),
    Settle { stall: Duration, expected: Option<Duration> },
    AskPositions,
    Wake,
}

/// A verb, and what to do when its time is up.
#[derive(Debug, Clone)]
pub(super) struct Move {
    pub(super) act: Act,
    pub(super) optional: bool,
    /// Begin again at this many acts before, this often.
    pub(super) retry: u32,
    pub(super) back: usize,
}

#[derive(Debug)]
enum Wait {
    /// The act has not begun.
    Begin,
    /// For the reply to a command.
    Reply(Ticket),
    /// For a class of replies, until.
    Class(String, Timestamp),
    /// For a state, until; the next question is due then.
    State { words: Vec<String>, until: Timestamp, ask: Asking },
    /// For an instant.
    Until(Timestamp),
    /// For the end of motion.
    Settle(Settle),
    /// For the answers to a round of questions.
    Answers(Vec<Ticket>),
}

/// Rounds of questions about the state.
#[derive(Debug)]
pub(super) struct Asking {
    pub(super) due: Timestamp,
    /// When to look again: `due`, or later while the last question is still unanswered or the device mute.
    pub(super) look: Timestamp,
    pub(super) tickets: Vec<Ticket>,
    /// Count of state reports when the last question was sent.
    pub(super) reports: u64,
    pub(super) asked: bool,
    /// When the motion should end: the instant from which a question more or less costs nobody's time but ours.
    pub(super) ends: Option<Timestamp>,
}

/// How much more often questions are asked once a motion should have ended, and how many of these there are: a device
/// that is slower than thought is then asked as patiently as before.
const OFTENER: u32 = 5;
const HASTY_QUESTIONS: u32 = 10;

/// A sequence that runs.
#[derive(Debug)]
pub(super) struct Task {
    pub(super) ticket: Ticket,
    acts: Vec<Move>,
    at: usize,
    wait: Wait,
    replies: Vec<Reply>,
    pub(super) answers: VecDeque<(Ticket, Outcome)>,
    /// A stop or a recovery is not ended by the alarm it may cause.
    pub(super) survives_alarm: bool,
    /// A search for references: it has found none while the device says so.
    pub(super) homes: bool,
    retries: u32,
    pub(super) trust: Trust,
}

/// The steps at the beginning of a stop that only send; `asks` is the command whose answer later steps may need.
pub(super) fn leading_sends<'a>(procedure: &'a Procedure, asks: Option<&str>) -> Vec<&'a Step> {
    let bare = |s: &&Step| {
        (s.send.is_some() || s.realtime.is_some())
            && s.sleep_ms.is_none()
            && s.until_state.is_empty()
            && (s.send.is_none() || s.send.as_deref() != asks)
    };
    let mut sends = Vec::new();
    for step in procedure.steps.iter().take_while(bare) {
        // A reset ends what can be sent ahead: what follows needs its banner.
        let waits = step.expect.is_some();
        if waits && !sends.is_empty() {
            break;
        }
        sends.push(step);
        if waits {
            break;
        }
    }
    sends
}

impl Task {
    pub(super) fn new(ticket: Ticket, acts: Vec<Move>) -> Task {
        Task {
            ticket,
            acts,
            at: 0,
            wait: Wait::Begin,
            replies: Vec::new(),
            answers: VecDeque::new(),
            survives_alarm: false,
            homes: false,
            retries: 0,
            trust: Trust::Keep,
        }
    }

    pub(super) fn waits_for(&self, ticket: Ticket) -> bool {
        match &self.wait {
            Wait::Reply(t) => *t == ticket,
            Wait::State { ask, .. } => ask.tickets.contains(&ticket),
            Wait::Settle(s) => s.ask.tickets.contains(&ticket),
            Wait::Answers(tickets) => tickets.contains(&ticket),
            _ => false,
        }
    }

    pub(super) fn ends_on_alarm(&self) -> bool {
        !self.survives_alarm
    }

    pub(super) fn wake(&self) -> Option<Timestamp> {
        match &self.wait {
            Wait::Begin => Some(Timestamp(0)),
            Wait::Class(_, until) | Wait::Until(until) => Some(*until),
            Wait::State { until, ask, .. } => Some((*until).min(ask.look)),
            Wait::Settle(s) => Some(s.ask.look),
            Wait::Reply(_) | Wait::Answers(_) => None,
        }
    }
}

pub(super) type Address = (String, Option<usize>, Fields);

/// A step of the file as acts; `address` gives the sendings of a command.
pub(super) fn expand(step: &Step, address: &dyn Fn(&str) -> Vec<Address>) -> Vec<Move> {
    let mut acts = Vec::new();
    let once = |act| Move { act, optional: step.optional, retry: 0, back: 0 };
    let timeout = step.timeout_ms.unwrap_or(2000);
    if let Some(name) = &step.send {
        for (name, axis, fields) in address(name) {
            let or_send = step.or_send.clone();
            acts.push(once(Act::Send { name, axis, fields, or_send, timeout: step.timeout_ms }));
        }
    }
    if let Some(name) = &step.realtime {
        acts.push(once(Act::Realtime(name.clone())));
    }
    let sends = acts.len();
    if let Some(class) = &step.expect {
        let act = Act::Expect { class: class.clone(), timeout };
        acts.push(Move { act, optional: step.optional, retry: step.retry, back: sends });
    }
    if !step.until_state.is_empty() {
        let act = Act::Until { words: step.until_state.clone(), timeout };
        acts.push(Move { act, optional: step.optional, retry: step.retry, back: sends });
    }
    if let Some(ms) = step.sleep_ms {
        acts.push(once(Act::Sleep(ms)));
    }
    acts
}

impl Engine {
    /// Lets the task go as far as it can without waiting.
    pub(super) fn run_tasks(&mut self, now: Timestamp) {
        loop {
            let mut task = match self.task.take() {
                Some(task) => task,
                None => match self.tasks.pop_front() {
                    Some(task) => task,
                    None => break,
                },
            };
            match self.advance(&mut task, now) {
                Progress::Waiting => {
                    self.task = Some(task);
                    break;
                }
                Progress::Ended(outcome) => {
                    let outcome = match self.unreferenced().filter(|_| task.homes && outcome.is_ok()) {
                        Some(failure) => Err(failure),
                        None => outcome,
                    };
                    if task.trust == Trust::Lost && outcome.is_ok() {
                        self.events.push(Event::TrustLost("the procedure loses the position".to_owned()));
                    }
                    self.events.push(Event::Finished(task.ticket, outcome));
                }
            }
        }
        if self.task.is_none() {
            self.classes_seen.clear();
        }
    }

    fn advance(&mut self, task: &mut Task, now: Timestamp) -> Progress {
        loop {
            let Some(step) = task.acts.get(task.at).cloned() else {
                return Progress::Ended(Ok(std::mem::take(&mut task.replies)));
            };
            if matches!(task.wait, Wait::Begin) {
                task.wait = match self.begin(&step, now) {
                    Ok(Some(wait)) => wait,
                    Ok(None) => {
                        task.at += 1;
                        continue;
                    }
                    Err(failure) => return Progress::Ended(Err(failure)),
                };
            }
            match self.check(task, &step, now) {
                Check::Waiting => return Progress::Waiting,
                Check::Met => {}
                Check::Failed(failure) => {
                    let timed_out = matches!(failure, Failure::NoReply { .. });
                    if timed_out && task.retries < step.retry {
                        task.retries += 1;
                        task.at -= step.back;
                        task.wait = Wait::Begin;
                        continue;
                    }
                    if let (Act::Send { or_send: Some(other), .. }, Failure::Refused { .. }) =
                        (&step.act, &failure)
                    {
                        let instead = self.addresses(other).into_iter().map(|(name, axis, fields)| Move {
                            act: Act::Send { name, axis, fields, or_send: None, timeout: None },
                            optional: step.optional,
                            retry: 0,
                            back: 0,
                        });
                        task.acts.splice(task.at..=task.at, instead);
                        task.wait = Wait::Begin;
                        continue;
                    }
                    let refused = matches!(failure, Failure::Refused { .. });
                    if !(step.optional && (timed_out || refused)) {
                        return Progress::Ended(Err(failure));
                    }
                }
            }
            task.at += 1;
            task.wait = Wait::Begin;
            task.retries = 0;
        }
    }

    /// Begins an act; `None` when there is nothing to wait for.
    fn begin(&mut self, step: &Move, now: Timestamp) -> Result<Option<Wait>, Failure> {
        // A wait counts what has come since its own sending.
        let continues = matches!(step.act, Act::Expect { .. } | Act::Until { .. }) && step.back > 0;
        if !continues {
            self.classes_seen.clear();
        }
        let act = &step.act;
        Ok(match act {
            Act::Send { name, axis, fields, timeout, .. } => {
                if self.spec.cmd[name].moves {
                    self.flag_failure = None;
                }
                let ticket = self.ticket();
                let mut fields = fields.clone();
                if let Some(counts) = axis.and_then(|at| self.positions()[at]?.counts) {
                    fields.insert(HERE_COUNTS.to_owned(), Value::Int(counts.0));
                }
                self.exchange.submit(ticket, name, *axis, fields, *timeout)?;
                (self.spec.cmd[name].reply != "none").then_some(Wait::Reply(ticket))
            }
            Act::Realtime(name) => {
                self.urgent.extend(self.spec.realtime.get(name).map(|b| b.0.clone()).unwrap_or_default());
                self.realtime_sent(name, now);
                None
            }
            Act::Wake => {
                self.urgent.extend(self.spec.link.wake.as_ref().map(|b| b.0.clone()).unwrap_or_default());
                self.expect_banner(now);
                None
            }
            Act::Expect { class, timeout } => {
                Some(Wait::Class(class.clone(), now.after(self.patient(*timeout))))
            }
            Act::Until { words, timeout } => {
                let until = now.after(self.patient(*timeout));
                Some(Wait::State { words: words.clone(), until, ask: self.asking(now) })
            }
            Act::Sleep(ms) => Some(Wait::Until(now.after(Duration::from_millis(*ms)))),
            Act::Settle { stall, expected } => {
                match (self.spec.done.method, self.spec.done.command.clone()) {
                    (DoneMethod::Barrier, Some(name)) => {
                        let ticket = self.ticket();
                        self.exchange.submit(ticket, &name, None, self.device_fields(Fields::new()), None)?;
                        Some(Wait::Reply(ticket))
                    }
                    _ => Some(Wait::Settle(self.settle(*stall, *expected, now))),
                }
            }
            Act::AskPositions => {
                let mut tickets = Vec::new();
                if let Some(name) = self.spec.position.command.clone() {
                    for (name, axis, fields) in self.addresses(&name) {
                        let ticket = self.ticket();
                        self.exchange.submit(ticket, &name, axis, fields, None)?;
                        tickets.push(ticket);
                    }
                    Some(Wait::Answers(tickets))
                } else {
                    let name = self.spec.position.realtime.clone().unwrap_or_default();
                    self.urgent
                        .extend(self.spec.realtime.get(&name).map(|b| b.0.clone()).unwrap_or_default());
                    Some(Wait::Class(self.spec.position.class.clone(), now.after(self.patient(2000))))
                }
            }
        })
    }

    pub(super) fn asking(&self, now: Timestamp) -> Asking {
        let tickets = Vec::new();
        Asking { due: now, look: now, tickets, reports: self.state_reports, asked: false, ends: None }
    }

    /// Asks for the state when a question is due and the last one is answered.
    pub(super) fn ask(&mut self, ask: &mut Asking, now: Timestamp) {
        if ask.due > now {
            ask.look = ask.due;
            return;
        }
        let next = self.next_question(ask, now);
        ask.look = next;
        if self.is_silent() || !ask.tickets.is_empty() {
            return;
        }
        ask.reports = self.state_reports;
        ask.asked = true;
        ask.due = next;
        if let Some(name) = &self.spec.done.realtime {
            self.urgent.extend(self.spec.realtime.get(name).map(|b| b.0.clone()).unwrap_or_default());
        } else if let Some(name) =
            self.spec.done.command.clone().filter(|_| self.spec.done.method != DoneMethod::Barrier)
        {
            for (name, axis, fields) in self.addresses(&name) {
                let ticket = self.ticket();
                if self.exchange.submit(ticket, &name, axis, fields, None).is_ok() {
                    ask.tickets.push(ticket);
                }
            }
        }
    }

    /// When to ask again after a question now: a period later, but at the instant when the motion should end, and
    /// oftener for a while from then on.
    fn next_question(&self, ask: &Asking, now: Timestamp) -> Timestamp {
        // A question every few milliseconds of wall time is enough, however fast bench time runs.
        let often = |period: Duration| period.max(Duration::from_millis(5).mul_f64(self.patience));
        let period = Duration::from_millis(self.spec.done.period_ms);
        let next = now.after(often(period));
        match ask.ends {
            Some(ends) if now < ends => next.min(ends),
            Some(ends) if now < ends.after(often(period / OFTENER) * HASTY_QUESTIONS) => {
                now.after(often(period / OFTENER))
            }
            _ => next,
        }
    }

    fn check(&mut self, task: &mut Task, step: &Move, now: Timestamp) -> Check {
        let mut wait = std::mem::replace(&mut task.wait, Wait::Begin);
        let verdict = match &mut wait {
            Wait::Begin => Check::Met,
            Wait::Reply(_) => match task.answers.pop_front().map(|(_, outcome)| outcome) {
                Some(Ok(replies)) => {
                    task.replies.extend(replies);
                    match self.flag_failure.take() {
                        Some(failure) if !task.survives_alarm => Check::Failed(failure),
                        _ => Check::Met,
                    }
                }
                Some(Err(failure)) => Check::Failed(failure),
                None => Check::Waiting,
            },
            Wait::Class(class, until) => {
                if let Some(reply) = self.classes_seen.iter().find(|r| r.class == *class) {
                    task.replies.push(reply.clone());
                    Check::Met
                } else if *until <= now {
                    Check::Failed(no_reply(class, &step.act))
                } else {
                    Check::Waiting
                }
            }
            Wait::Until(until) => {
                if *until <= now {
                    Check::Met
                } else {
                    Check::Waiting
                }
            }
            Wait::State { words, until, ask } => {
                let answered = self.state_reports > ask.reports && ask.asked;
                let all_answered = take_answers(ask, &mut task.answers).0;
                let state = self.state().filter(|_| answered && all_answered);
                if state.is_some_and(|s| words.iter().any(|w| self.is_state(w, s))) {
                    Check::Met
                } else if *until <= now {
                    Check::Failed(no_reply(&format!("state {}", words.join(" or ")), &step.act))
                } else {
                    self.ask(ask, now);
                    Check::Waiting
                }
            }
            Wait::Settle(settle) => self.check_settle(settle, &mut task.answers, now),
            Wait::Answers(tickets) => loop {
                match task.answers.pop_front() {
                    Some((ticket, Ok(more))) => {
                        task.replies.extend(more);
                        tickets.retain(|t| *t != ticket);
                    }
                    Some((_, Err(failure))) => break Check::Failed(failure),
                    None if tickets.is_empty() => break Check::Met,
                    None => break Check::Waiting,
                }
            },
        };
        if matches!(verdict, Check::Waiting) {
            task.wait = wait;
        }
        verdict
    }

    fn is_state(&self, word: &str, state: MotionState) -> bool {
        let (name, sub) = word.split_once(':').map_or((word, None), |(n, s)| (n, Some(s)));
        name == state.word() && sub.is_none_or(|s| self.sub_state.as_deref() == Some(s))
    }
}

/// Books the answers to questions: whether none is open, what they carried, whether one failed.
pub(super) fn take_answers(
    ask: &mut Asking,
    answers: &mut VecDeque<(Ticket, Outcome)>,
) -> (bool, Vec<Reply>, Option<Failure>) {
    let (mut replies, mut failed) = (Vec::new(), None);
    for (ticket, answer) in answers.drain(..) {
        ask.tickets.retain(|t| *t != ticket);
        match answer {
            Ok(more) => replies.extend(more),
            Err(failure) => failed = Some(failure),
        }
    }
    (ask.tickets.is_empty(), replies, failed)
}

enum Progress {
    Waiting,
    Ended(Outcome),
}

pub(super) enum Check {
    Waiting,
    Met,
    Failed(Failure),
}

fn no_reply(what: &str, act: &Act) -> Failure {
    let waited = match act {
        Act::Expect { timeout, .. } | Act::Until { timeout, .. } => Duration::from_millis(*timeout),
        _ => Duration::from_millis(2000),
    };
    Failure::NoReply { what: what.to_owned(), waited }
}
