//! Step lists, and the tables of errors, alarms and flags that lead to them.

use super::*;

impl Check<'_, '_> {
    pub(super) fn procedures(&mut self) {
        let spec = self.spec;
        if !spec.stop.contains_key("emergency") {
            let next = "add [stop.emergency] with its steps";
            self.problems.push("stop", "no [stop.emergency]", "a way to stop at once", next);
        }
        for name in spec.stop.keys().filter(|n| !["emergency", "controlled", "homing"].contains(&n.as_str()))
        {
            let next = "rename it; only these are ever run";
            self.problems.push(&format!("stop.{name}"), quoted(name), "emergency, controlled, homing", next);
        }
        self.procedure("init", &spec.init);
        self.procedure("home", &spec.home);
        if let Some(cancel) = &spec.motion.jog_cancel {
            self.procedure("motion.jog_cancel", cancel);
        }
        for (name, procedure) in &spec.stop {
            self.procedure(&format!("stop.{name}"), procedure);
        }
        for (name, procedure) in &spec.recover {
            self.procedure(&format!("recover.{name}"), procedure);
        }
    }

    fn procedure(&mut self, key: &str, procedure: &Procedure) {
        const STATES: [&str; 6] = ["idle", "moving", "homing", "hold", "alarm", "off"];
        let mut asked_where = false;
        for (i, step) in procedure.steps.iter().enumerate() {
            let at = format!("{key}.steps[{i}]");
            for cmd in [&step.send, &step.or_send].into_iter().flatten() {
                self.command(&at, cmd);
                if !asked_where && self.spec.cmd.get(cmd).is_some_and(fills_here) {
                    let asks = self.spec.position.command.as_deref();
                    let asks = asks.unwrap_or("the command that asks for positions");
                    let allowed =
                        format!("after a step that sends {asks}: {HERE_COUNTS} is what that has told");
                    self.problems.push(&at, quoted(cmd), allowed, "put that step before it");
                }
                asked_where |= self.spec.position.command.as_ref() == Some(cmd);
            }
            if let Some(name) = &step.realtime {
                self.realtime(&at, name);
            }
            if let Some(class) = &step.expect {
                self.class(&at, class);
            }
            for word in &step.until_state {
                let state = word.split(':').next().unwrap_or_default();
                if !STATES.contains(&state) {
                    let allowed = format!("{}, with `:sub` where a sub-state counts", STATES.join(", "));
                    self.problems.push(&at, quoted(word), allowed, "write our word, not the device's");
                }
            }
            let waits = step.expect.is_some() || !step.until_state.is_empty();
            if waits && step.send.is_none() && step.timeout_ms.is_none() {
                let next = "add timeout_ms, the longest that this may take";
                self.problems.push(&at, "a wait without end", "a wait with timeout_ms", next);
            }
            if step.send.is_some() && step.realtime.is_some() {
                let next = "make it two steps";
                self.problems.push(&at, "send and realtime", "one step sends one thing", next);
            }
        }
    }

    pub(super) fn faults(&mut self) {
        let spec = self.spec;
        for (table, faults) in [("errors", &spec.errors), ("alarms", &spec.alarms)] {
            for (code, fault) in faults {
                if let Some(name) = &fault.recover
                    && !spec.recover.contains_key(name)
                {
                    let known = list(spec.recover.keys().map(String::as_str));
                    let next = format!("choose one of them, or add a table [recover.{name}]");
                    let key = format!("{table}.\"{code}\".recover");
                    self.problems.push(&key, quoted(name), format!("a recovery: {known}"), next);
                }
            }
        }
        for (code, flag) in &spec.flags {
            if let Some(cmd) = &flag.clear {
                self.command(&format!("flags.\"{code}\".clear"), cmd);
            }
        }
    }
}

/// Whether a command tells an axis to stay where it was last reported.
fn fills_here(cmd: &CommandSpec) -> bool {
    cmd.payload.iter().any(|field| field.name == HERE_COUNTS)
        || cmd.tx.as_ref().is_some_and(|tx| tx.names().any(|name| name == HERE_COUNTS))
}
