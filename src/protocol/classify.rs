//! Units to replies: which class of the protocol file a line or frame belongs to, and its fields.

use super::deframe::Unit;
use super::encode::take;
use super::spec::*;
use super::value::{Fields, Value};

/// A classified unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// Name of the class.
    pub class: String,
    /// Its role; a refusal recognised by `nack_when` has role nack here.
    pub role: Role,
    /// What it carried.
    pub fields: Fields,
    /// The line as received, or a frame's payload in hex.
    pub raw: String,
}

impl Reply {
    /// A field as a number.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.fields.get(name).and_then(Value::as_f64)
    }

    /// A field as text, empty when absent.
    pub fn text(&self, name: &str) -> String {
        self.fields.get(name).map(Value::to_text).unwrap_or_default()
    }
}

/// Classifies a unit. `awaited` are the commands that wait for a reply. A line within a line comes
/// first in the list; an empty list means that the file does not know this unit.
pub fn classify(spec: &Spec, unit: &Unit, awaited: &[&str]) -> Vec<Reply> {
    match unit {
        Unit::Line(text) => {
            let found = classify_line(spec, text, awaited);
            if !found.is_empty() {
                return found;
            }
            // Noise of a booting board may be glued to the front of its first line.
            let clean = text.iter().rposition(|b| !(0x20..0x7f).contains(b)).map_or(0, |at| at + 1);
            if clean > 0 && clean < text.len() { classify_line(spec, &text[clean..], awaited) } else { found }
        }
        Unit::Frame { header, payload } => classify_frame(spec, header, payload, awaited),
        Unit::Garbled(_) => Vec::new(),
    }
}

fn expected(rx: &RxSpec, awaited: &[&str]) -> bool {
    rx.after.as_ref().is_none_or(|cmd| awaited.contains(&cmd.as_str()))
}

fn classify_line(spec: &Spec, text: &[u8], awaited: &[&str]) -> Vec<Reply> {
    for rx in spec.rx.iter().filter(|rx| expected(rx, awaited)) {
        let Some(mut fields) = rx.pattern.as_ref().and_then(|p| p.captures(text)) else { continue };
        let mut replies = Vec::new();
        if let Some(inner) = rx.inner.as_ref().and_then(|name| fields.get(name)) {
            replies = classify_line(spec, inner.to_text().as_bytes(), awaited);
            // Only what tells something may ride on another line; a bare word never acts by itself.
            replies.retain(|r| matches!(r.role, Role::Position | Role::Status | Role::Data));
        }
        if let Some(split) = &rx.split {
            split_field(split, &mut fields);
        }
        replies.push(reply(rx, fields, String::from_utf8_lossy(text).into_owned()));
        return replies;
    }
    Vec::new()
}

fn split_field(split: &Split, fields: &mut Fields) {
    let Some(text) = fields.remove(&split.field).map(|v| v.to_text()) else { return };
    for part in text.split(split.on) {
        let (name, value) = part.split_once(split.pair).unwrap_or((part, ""));
        let numbers: Option<Vec<f64>> =
            value.split(split.list).map(|n| n.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
        let value = numbers.map_or_else(|| Value::Text(value.to_owned()), Value::List);
        fields.insert(name.to_owned(), value);
    }
}

fn classify_frame(spec: &Spec, header: &Fields, payload: &[u8], awaited: &[&str]) -> Vec<Reply> {
    let endian = spec.frame.as_ref().map_or(Endian::Little, |f| f.endian);
    for rx in spec.rx.iter().filter(|rx| expected(rx, awaited)) {
        let holds = |(name, want): (&String, &i64)| header.get(name).and_then(Value::as_i64) == Some(*want);
        let length: usize = rx.payload.iter().map(|f| f.kind.width()).sum();
        if !rx.when.iter().all(holds) || (!rx.payload.is_empty() && payload.len() != length) {
            continue;
        }
        let mut fields = header.clone();
        let mut at = 0;
        for field in &rx.payload {
            let end = at + field.kind.width();
            fields.insert(field.name.clone(), take(&payload[at..end], field.kind, endian));
            at = end;
        }
        return vec![reply(rx, fields, super::value::hex(payload))];
    }
    Vec::new()
}

fn reply(rx: &RxSpec, fields: Fields, raw: String) -> Reply {
    let refused = !rx.nack_when.is_empty()
        && rx.nack_when.iter().all(|(name, want)| fields.get(name).is_some_and(|v| v.to_text() == *want));
    let role = if refused { Role::Nack } else { rx.role };
    Reply { class: rx.class.clone(), role, fields, raw }
}

/// The device's state, where the fields of a reply tell it. The sub-state is given with it.
pub fn state_of(spec: &Spec, fields: &Fields) -> Option<(MotionState, Option<String>)> {
    let state = spec.state.as_ref()?;
    let value = fields.get(&state.field)?;
    let sub = state.sub_field.as_ref().and_then(|name| fields.get(name)).map(Value::to_text);
    let tables = [
        (MotionState::Alarm, &state.alarm),
        (MotionState::Homing, &state.homing),
        (MotionState::Hold, &state.hold),
        (MotionState::Moving, &state.moving),
        (MotionState::Off, &state.off),
        (MotionState::Idle, &state.idle),
    ];
    // A word with a sub-state is more particular than the word alone.
    let particular = sub.as_ref().map(|s| format!("{}:{s}", value.to_text()));
    for exact in [particular.as_deref(), Some(&value.to_text()[..])].into_iter().flatten() {
        if let Some((found, _)) = tables.iter().find(|(_, words)| words.iter().any(|w| w == exact)) {
            return Some((*found, sub));
        }
    }
    let bits = value.as_i64()? as u64;
    tables.iter().find(|(_, words)| words.iter().any(|w| has_bits(w, bits))).map(|(found, _)| (*found, sub))
}

/// Whether the device says that its positions are not valid; `None` where a reply says nothing of it.
pub fn says_unreferenced(spec: &Spec, fields: &Fields) -> Option<bool> {
    let state = spec.state.as_ref().filter(|state| !state.unreferenced.is_empty())?;
    let value = fields.get(&state.field)?;
    let (text, bits) = (value.to_text(), value.as_i64());
    let holds = |word: &String| *word == text || bits.is_some_and(|bits| has_bits(word, bits as u64));
    Some(state.unreferenced.iter().any(holds))
}

/// Tests bits: `&0x30` for any of them, `!0x30` for none.
fn has_bits(word: &str, bits: u64) -> bool {
    match (word.strip_prefix('&'), word.strip_prefix('!')) {
        (Some(mask), _) => mask_of(mask).is_some_and(|m| bits & m != 0),
        (_, Some(mask)) => mask_of(mask).is_some_and(|m| bits & m == 0),
        _ => false,
    }
}

fn mask_of(text: &str) -> Option<u64> {
    match text.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}
