//! Sequences: procedures of the protocol file, moves, and waiting for the end of motion.
//!
//! One task runs at a time. Its steps come from a closed set of verbs: send a command, send
//! real-time bytes, wait for a class of reply, wait for a state, sleep, wait for the end of motion.

use super::*;
use crate::protocol::encode::encode;
use crate::protocol::template::{Template, decimal};

/// One verb with its wait.
#[derive(Debug, Clone)]
pub(super) enum Act {
    Send { name: String, axis: Option<usize>, fields: Fields, or_send: Option<String>, timeout: Option<u64> },
    Realtime(String),
    Expect { class: String, timeout: u64 },
    Until { words: Vec<String>, timeout: u64 },
    Sleep(u64),
    Settle(Duration),
    AskPositions,
    ExpectNothingSent,
}

/// A verb, and what to do when its time is up.
#[derive(Debug, Clone)]
pub(super) struct Move {
    act: Act,
    optional: bool,
    /// Begin again at this many acts before, this often.
    retry: u32,
    back: usize,
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
struct Asking {
    due: Timestamp,
    tickets: Vec<Ticket>,
    /// Count of state reports when the last question was sent.
    reports: u64,
    asked: bool,
}

#[derive(Debug)]
struct Settle {
    stall: Duration,
    ask: Asking,
    idle_in_a_row: u32,
    last: Vec<Option<f64>>,
    last_state: Option<MotionState>,
    progress: Timestamp,
    answered: Timestamp,
}

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
    survives_alarm: bool,
    retries: u32,
    trust: Trust,
}

/// The steps at the beginning of a stop that only send.
pub(super) fn leading_sends(procedure: &Procedure) -> Vec<&Step> {
    let bare = |s: &&Step| {
        (s.send.is_some() || s.realtime.is_some()) && s.sleep_ms.is_none() && s.until_state.is_empty()
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
    fn new(ticket: Ticket, acts: Vec<Move>) -> Task {
        Task {
            ticket,
            acts,
            at: 0,
            wait: Wait::Begin,
            replies: Vec::new(),
            answers: VecDeque::new(),
            survives_alarm: false,
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
            Wait::State { until, ask, .. } => Some((*until).min(ask.due)),
            Wait::Settle(s) => Some(s.ask.due),
            Wait::Reply(_) | Wait::Answers(_) => None,
        }
    }
}

type Address = (String, Option<usize>, Fields);

/// A step of the file as acts; `address` gives the sendings of a command.
fn expand(step: &Step, address: &dyn Fn(&str) -> Vec<Address>) -> Vec<Move> {
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
    /// A request as a sequence of acts.
    pub(super) fn plan(&self, ticket: Ticket, request: Request) -> Result<Task, Failure> {
        let plain = |act| Move { act, optional: false, retry: 0, back: 0 };
        let send = |(name, axis, fields): Address| {
            plain(Act::Send { name, axis, fields, or_send: None, timeout: None })
        };
        let acts = match request {
            Request::Command { name, fields, axis } => {
                let mut acts = Vec::new();
                for (name, at, mut address) in self.addresses(&name) {
                    if axis.is_none_or(|wanted| at == Some(wanted)) || at.is_none() {
                        address.extend(fields.clone());
                        self.validate(&name, &address)?;
                        acts.push(send((name, at, address)));
                    }
                }
                acts
            }
            Request::Wake => match &self.spec.link.wake {
                Some(_) => {
                    let banner = self.spec.rx.iter().find(|rx| rx.role == Role::Banner);
                    let class = banner.map(|rx| rx.class.clone()).unwrap_or_default();
                    let timeout = self.spec.link.banner_timeout_ms.unwrap_or(3000);
                    let expect = Act::Expect { class, timeout };
                    vec![
                        plain(Act::ExpectNothingSent),
                        Move { act: expect, optional: false, retry: 2, back: 1 },
                    ]
                }
                None => Vec::new(),
            },
            Request::Identify => {
                let name = self.spec.protocol.identify.clone();
                name.map_or_else(Vec::new, |n| self.addresses(&n).into_iter().map(send).collect())
            }
            Request::Move { targets, feed, jog } => {
                self.plan_move(&targets, feed, jog)?.into_iter().map(send).collect()
            }
            Request::Settle { stall } => vec![plain(Act::Settle(stall))],
            Request::Position => vec![plain(Act::AskPositions)],
            Request::Run(which) => return Ok(self.plan_procedure(ticket, &which)),
        };
        Ok(Task::new(ticket, acts))
    }

    /// A stop whose first `sent` steps are on the wire already.
    pub(super) fn plan_stop(&self, ticket: Ticket, procedure: &Procedure, sent: usize) -> Task {
        let mut acts = Vec::new();
        for (i, step) in procedure.steps.iter().enumerate() {
            let mut expanded = expand(step, &|name| self.addresses(name));
            if i < sent {
                expanded.retain(|m| !matches!(m.act, Act::Send { .. } | Act::Realtime(_)));
                // Begun again, if it must be, from the wait alone.
                expanded.iter_mut().for_each(|m| (m.retry, m.back) = (0, 0));
            }
            acts.extend(expanded);
        }
        Task { survives_alarm: true, ..Task::new(ticket, acts) }
    }

    fn plan_procedure(&self, ticket: Ticket, which: &Which) -> Task {
        let none = Procedure::default();
        let procedure = match which {
            Which::Init => &self.spec.init,
            Which::Home => &self.spec.home,
            Which::JogCancel => self.spec.motion.jog_cancel.as_ref().unwrap_or(&none),
            Which::Recover(name) => self.spec.recover.get(name).unwrap_or(&none),
        };
        let acts = procedure.steps.iter().flat_map(|s| expand(s, &|name| self.addresses(name))).collect();
        let survives_alarm = matches!(which, Which::Recover(_));
        Task { survives_alarm, trust: procedure.trust, ..Task::new(ticket, acts) }
    }

    /// Where a command goes: once, or once to each axis.
    fn addresses(&self, name: &str) -> Vec<Address> {
        match self.spec.cmd.get(name).map(|c| c.scope) {
            Some(Scope::Axis) => {
                let each = self.groups.iter().enumerate();
                each.map(|(i, fields)| (name.to_owned(), Some(i), fields.clone())).collect()
            }
            _ => vec![(name.to_owned(), None, self.device_fields(Fields::new()))],
        }
    }

    /// Refuses what cannot be written, or not in this state, before anything is sent.
    fn validate(&self, name: &str, fields: &Fields) -> Result<(), Failure> {
        let mut trial = fields.clone();
        if let Some(id) = &self.spec.flow.id {
            trial.insert(id.field.clone(), Value::Int(i64::from(id.max)));
        }
        trial.entry("n".to_owned()).or_insert(Value::Int(1));
        encode(&self.spec, name, &trial, None)?;
        let pre = &self.spec.cmd[name].pre;
        match self.state() {
            Some(state) if !pre.is_empty() && !pre.contains(&state) => {
                Err(Failure::WrongState { command: name.to_owned(), state })
            }
            _ => Ok(()),
        }
    }

    /// The commands of a move, all written once on trial, so that either all can be sent or none is.
    pub(super) fn plan_move(
        &self,
        targets: &[(usize, f64)],
        feed: f64,
        jog: bool,
    ) -> Result<Vec<Address>, Failure> {
        let names = if jog && !self.spec.motion.jog.is_empty() {
            &self.spec.motion.jog
        } else {
            &self.spec.motion.go
        };
        let axis = &self.spec.axis;
        let numbers = |at: usize, target: f64| {
            let mut fields = self.groups[at].clone();
            let scale = self.axes[at].counts_per_unit.unwrap_or(1.0);
            fields.insert("pos".to_owned(), Value::Text(decimal(target, axis.decimals).unwrap_or_default()));
            fields.insert("counts".to_owned(), Value::Int((target * scale).round() as i64));
            let counts = feed * scale.abs() * axis.feed_counts_scale;
            fields.insert("feed_counts".to_owned(), Value::Int(counts.round().max(1.0) as i64));
            fields.insert("feed".to_owned(), Value::Num(feed * axis.feed_scale));
            fields
        };
        let field = |reason: String| EncodeError::Field { command: "move".to_owned(), reason };
        if let Some((_, target)) = targets.iter().find(|(_, t)| !t.is_finite()) {
            return Err(field(format!("target {target} is not a number")).into());
        }
        if !(feed.is_finite() && feed > 0.0) {
            return Err(field(format!("feed {feed} is not positive")).into());
        }
        // Axes that a whole pose needs beside those asked for stay where they are.
        let mut whole = targets.to_vec();
        if self.spec.motion.whole_pose {
            for (at, reading) in self.positions().iter().enumerate() {
                if !whole.iter().any(|(i, _)| *i == at) {
                    let here = reading.ok_or_else(|| {
                        field(format!("the position of {} is not known", self.axes[at].name))
                    })?;
                    whole.push((at, here.value));
                }
            }
            whole.sort_by_key(|(i, _)| *i);
        }
        let word = match &axis.word {
            Some(word) => word.clone(),
            None => Template::parse("{letter}{pos}").expect("the default word is a template"),
        };
        let mut sends = Vec::new();
        for name in names {
            match self.spec.cmd[name].scope {
                Scope::Axis => {
                    sends.extend(whole.iter().map(|(at, t)| (name.clone(), Some(*at), numbers(*at, *t))));
                }
                Scope::Device => {
                    let mut fields = self.device_fields(Fields::new());
                    let mut words = Vec::new();
                    for (at, target) in &whole {
                        let own = numbers(*at, *target);
                        // Binary protocols have words of their own: a field named like the axis.
                        if self.spec.is_line() {
                            words.push(word.fill(&own).map_err(field)?);
                        }
                        fields.insert(self.axes[*at].wire.clone(), Value::Num(*target));
                    }
                    fields.insert("axes".to_owned(), Value::Text(words.join(" ")));
                    fields.insert("feed".to_owned(), Value::Num(feed * axis.feed_scale));
                    sends.push((name.clone(), None, fields));
                }
            }
        }
        for (name, _, fields) in &sends {
            self.validate(name, fields)?;
        }
        Ok(sends)
    }

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
                self.exchange.submit(ticket, name, *axis, fields.clone(), *timeout)?;
                (self.spec.cmd[name].reply != "none").then_some(Wait::Reply(ticket))
            }
            Act::Realtime(name) => {
                self.urgent.extend(self.spec.realtime.get(name).map(|b| b.0.clone()).unwrap_or_default());
                self.realtime_sent(name, now);
                None
            }
            Act::ExpectNothingSent => {
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
            Act::Settle(stall) => match (self.spec.done.method, self.spec.done.command.clone()) {
                (DoneMethod::Barrier, Some(name)) => {
                    let ticket = self.ticket();
                    self.exchange.submit(ticket, &name, None, self.device_fields(Fields::new()), None)?;
                    Some(Wait::Reply(ticket))
                }
                _ => Some(Wait::Settle(Settle {
                    stall: *stall,
                    ask: self.asking(now),
                    idle_in_a_row: 0,
                    last: Vec::new(),
                    last_state: None,
                    progress: now,
                    answered: now,
                })),
            },
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

    fn asking(&self, now: Timestamp) -> Asking {
        Asking { due: now, tickets: Vec::new(), reports: self.state_reports, asked: false }
    }

    /// Asks for the state when a question is due and the last one is answered.
    fn ask(&mut self, ask: &mut Asking, now: Timestamp) {
        if ask.due > now || self.is_silent() || !ask.tickets.is_empty() {
            return;
        }
        ask.reports = self.state_reports;
        ask.asked = true;
        // A question every few milliseconds of wall time is enough, however fast bench time runs.
        let period = Duration::from_millis(self.spec.done.period_ms)
            .max(Duration::from_millis(5).mul_f64(self.patience));
        ask.due = now.after(period);
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
        let names = match state {
            MotionState::Idle => "idle",
            MotionState::Moving => "moving",
            MotionState::Homing => "homing",
            MotionState::Hold => "hold",
            MotionState::Alarm => "alarm",
            MotionState::Off => "off",
        };
        name == names && sub.is_none_or(|s| self.sub_state.as_deref() == Some(s))
    }

    /// Whether motion has ended: fresh answers that say so, several in a row where the file asks it.
    fn check_settle(
        &mut self,
        settle: &mut Settle,
        answers: &mut VecDeque<(Ticket, Outcome)>,
        now: Timestamp,
    ) -> Check {
        if let Some(failure) = self.flag_failure.take() {
            return Check::Failed(failure);
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
                Some(MotionState::Idle) => settle.idle_in_a_row += 1,
                Some(MotionState::Alarm) => {
                    return Check::Failed(Failure::Alarm {
                        code: "state".to_owned(),
                        text: "the device is locked by an alarm; home it".to_owned(),
                        trust: Trust::Lost,
                        recover: None,
                    });
                }
                state => {
                    settle.idle_in_a_row = 0;
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
        // Progress is a position that changes; where none is reported, an answer has to do.
        let here: Vec<Option<f64>> = self.positions().iter().map(|r| r.map(|r| r.value)).collect();
        let asked_alone = self.spec.position.command.is_some();
        if here != settle.last || (asked_alone && settle.answered == now) {
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
        if stalled && settle.last_state == Some(MotionState::Moving) && settle.idle_in_a_row == 0 {
            return Check::Failed(Failure::Stalled { stall: settle.stall });
        }
        self.ask(&mut settle.ask, now);
        Check::Waiting
    }
}

/// Books the answers to questions: whether none is open, what they carried, whether one failed.
fn take_answers(
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

enum Check {
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
