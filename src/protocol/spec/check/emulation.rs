//! The rules of an emulated device: groups that verbs read, placeholders that replies fill, words for every state.

use super::*;
use crate::protocol::emulation::{Dialect, RuleState, RuleVerb};

/// What a reply may name.
const PLACEHOLDERS: [&str; 6] = ["axis", "position", "feed", "state", "error", "identity"];
const RULES: &str = "emulator.dialect.rules";

impl Check<'_, '_> {
    pub(super) fn emulation(&mut self) {
        let Some(Dialect::Rules(rules)) = self.spec.emulator.as_ref().map(|e| &e.dialect) else { return };
        for (state, word) in RuleState::ALL {
            if !rules.states.contains_key(&state) {
                let known = list(rules.states.keys().map(|s| s.word()));
                let next = format!("add `{word} = ...`, what the device says then");
                let key = format!("{RULES}.states");
                self.problems.push(&key, format!("no {word}"), format!("every state, now: {known}"), next);
            }
        }
        for (i, rule) in rules.rule.iter().enumerate() {
            let groups: Vec<&str> = rule.matches.groups().collect();
            for (n, verb) in rule.does.iter().enumerate() {
                let (RuleVerb::MoveTo(group) | RuleVerb::MoveBy(group) | RuleVerb::SetFeed(group)) = verb
                else {
                    continue;
                };
                if !groups.contains(&group.as_str()) {
                    let known = list(groups.iter().copied());
                    let next = format!("choose one of them, or name the group (?P<{group}>...) in match");
                    let key = format!("{RULES}.rule[{i}].do[{n}]");
                    self.problems.push(&key, quoted(group), format!("a group of match: {known}"), next);
                }
            }
            for name in placeholders(rule.reply.as_deref().unwrap_or_default()) {
                if !PLACEHOLDERS.contains(&name) {
                    let key = format!("{RULES}.rule[{i}].reply");
                    let next = "choose one of them, or write the text itself";
                    self.problems.push(&key, format!("{{{name}}}"), list(PLACEHOLDERS), next);
                }
            }
        }
    }
}

/// The names in braces.
fn placeholders(reply: &str) -> impl Iterator<Item = &str> {
    reply.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name)
}
