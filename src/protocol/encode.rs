//! Commands to bytes: templates and envelopes for lines, fields and stuffing for frames, checksums.

use super::checksum::ChecksumKind;
use super::spec::*;
use super::value::{Fields, Value};

/// Why a command could not be turned into bytes. Nothing was sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The protocol file has no such command.
    #[error("{protocol} has no command {command}; add [cmd.{command}] to its file")]
    Unknown {
        /// Name of the protocol.
        protocol: String,
        /// The command.
        command: String,
    },
    /// A field is missing or cannot be written as the file demands.
    #[error("command {command}: {reason}")]
    Field {
        /// The command.
        command: String,
        /// What is wrong.
        reason: String,
    },
    /// The line is longer than the device's buffer.
    #[error(
        "command {command} makes a line of {length} bytes; the device takes {max}: name fewer axes at once"
    )]
    TooLong {
        /// The command.
        command: String,
        /// Bytes of the line.
        length: usize,
        /// Bytes allowed.
        max: usize,
    },
}

/// Bytes of a command; `number` is the line number, where lines are numbered.
pub fn encode(spec: &Spec, name: &str, fields: &Fields, number: Option<i64>) -> Result<Vec<u8>, EncodeError> {
    let cmd = spec.cmd.get(name).ok_or_else(|| EncodeError::Unknown {
        protocol: spec.protocol.name.clone(),
        command: name.to_owned(),
    })?;
    let wrong = |reason: String| EncodeError::Field { command: name.to_owned(), reason };
    match (&spec.line, &spec.frame) {
        (Some(line), _) => {
            let bytes = encode_line(line, cmd, fields, number).map_err(wrong)?;
            let length = bytes.len() - line.tx_eol.0.len();
            match line.max_line {
                Some(max) if length > max => {
                    Err(EncodeError::TooLong { command: name.to_owned(), length, max })
                }
                _ => Ok(bytes),
            }
        }
        (None, Some(frame)) => encode_frame(frame, cmd, fields).map_err(wrong),
        (None, None) => Err(wrong("the protocol has neither lines nor frames".to_owned())),
    }
}

fn encode_line(
    line: &LineSpec,
    cmd: &CommandSpec,
    fields: &Fields,
    number: Option<i64>,
) -> Result<Vec<u8>, String> {
    let mut fields = fields.clone();
    let numbered = number.filter(|_| line.numbering.is_some());
    if let Some(n) = numbered {
        fields.insert("n".to_owned(), Value::Int(n));
    }
    let template = cmd.tx.as_ref().ok_or("the command has no tx")?;
    let mut text = template.fill(&fields)?.trim_end().to_owned();
    if let Some(envelope) = &line.envelope {
        let blank = if text.is_empty() { "" } else { " " };
        fields.insert("sp".to_owned(), Value::Text(blank.to_owned()));
        fields.insert("body".to_owned(), Value::Text(text));
        text = envelope.fill(&fields)?;
    }
    if let (Some(_), Some(numbering)) = (numbered, &line.numbering) {
        fields.insert("body".to_owned(), Value::Text(text));
        text = numbering.line.fill(&fields)?;
    }
    // A control character inside would be a second line, or a real-time byte.
    if let Some(c) = text.chars().find(|c| c.is_control() || !c.is_ascii()) {
        return Err(format!("the line {text:?} would hold {c:?}; only printable ASCII may be sent"));
    }
    if let Some(sum) = &line.checksum
        && (sum.tx == ChecksumTx::Always || numbered.is_some())
    {
        let value = sum.kind.of(text.as_bytes().get(sum.skip..).unwrap_or_default());
        text.push(sum.separator);
        text.push_str(&match sum.digits {
            ChecksumDigits::Decimal => value.to_string(),
            ChecksumDigits::HexUpper => format!("{value:02X}"),
        });
    }
    let mut bytes = text.into_bytes();
    bytes.extend(&line.tx_eol.0);
    Ok(bytes)
}

fn encode_frame(frame: &FrameSpec, cmd: &CommandSpec, fields: &Fields) -> Result<Vec<u8>, String> {
    let mut payload = Vec::new();
    for field in &cmd.payload {
        let value = value_of(field, fields)?;
        put(&mut payload, field.kind, value, frame.endian)
            .map_err(|e| format!("field {}: {e}", field.name))?;
    }
    // The header is built with the length in place, since flags in it say whether there is a payload.
    let mut header: Vec<(&FieldSpec, f64)> = Vec::new();
    for field in &frame.header {
        let value = if field.name == frame.length.field
            && (frame.length.only_when.is_none() || !payload.is_empty())
        {
            (payload.len() + frame.length.extra) as f64
        } else if let Some(fixed) = cmd.header.get(&field.name) {
            *fixed as f64
        } else {
            value_of(field, fields)?
        };
        header.push((field, value));
    }
    if let Some(test) = frame.length.only_when.as_ref().filter(|_| !payload.is_empty())
        && let Some((_, value)) = header.iter_mut().find(|(f, _)| f.name == test.field)
    {
        *value = (*value as u64 | test.mask) as f64;
    }
    let mut bytes = frame.sync.0.clone();
    let mut starts = std::collections::BTreeMap::new();
    for (field, value) in header {
        starts.insert(field.name.as_str(), bytes.len());
        put(&mut bytes, field.kind, value, frame.endian)
            .map_err(|e| format!("header {}: {e}", field.name))?;
    }
    bytes.extend(&payload);
    if let Some(stuffing) = &frame.stuffing {
        let from = starts.get(stuffing.from.as_str()).copied().unwrap_or(0);
        let stuffed = stuff(&bytes[from..], stuffing);
        let extra = stuffed.len() - (bytes.len() - from);
        bytes.truncate(from);
        bytes.extend(stuffed);
        // Inserted bytes count in the length.
        if let Some(field) = frame.header.iter().find(|f| f.name == frame.length.field) {
            let length = (payload.len() + frame.length.extra + extra) as f64;
            let mut coded = Vec::new();
            put(&mut coded, field.kind, length, frame.endian)?;
            let at = starts[field.name.as_str()];
            bytes[at..at + coded.len()].copy_from_slice(&coded);
        }
    }
    if let Some(sum) = &frame.checksum {
        let from = sum.from.as_ref().and_then(|name| starts.get(name.as_str())).copied().unwrap_or(0);
        let value = sum.kind.of(&bytes[from..]);
        put_sum(&mut bytes, sum.kind, value, frame.endian);
    }
    Ok(bytes)
}

fn value_of(field: &FieldSpec, fields: &Fields) -> Result<f64, String> {
    match (fields.get(&field.name), field.default) {
        (Some(value), _) => {
            value.as_f64().ok_or_else(|| format!("field {} = {value:?} is not a number", field.name))
        }
        (None, Some(default)) => Ok(default),
        (None, None) => Err(format!("field {} has no value", field.name)),
    }
}

/// Appends a number in its type; refuses one that does not fit.
pub(super) fn put(out: &mut Vec<u8>, kind: FieldType, value: f64, endian: Endian) -> Result<(), String> {
    let (low, high) = match kind {
        FieldType::U8 => (0.0, f64::from(u8::MAX)),
        FieldType::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        FieldType::U16 => (0.0, f64::from(u16::MAX)),
        FieldType::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        FieldType::U32 => (0.0, f64::from(u32::MAX)),
        FieldType::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        FieldType::U64 => (0.0, 9.0e18),
        FieldType::F32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
    };
    if !(value >= low && value <= high) {
        return Err(format!("{value} does not fit {kind:?} ({low} to {high})"));
    }
    let little = match kind {
        FieldType::F32 => (value as f32).to_le_bytes().to_vec(),
        _ => (value.round() as i64).to_le_bytes()[..kind.width()].to_vec(),
    };
    match endian {
        Endian::Little => out.extend(little),
        Endian::Big => out.extend(little.iter().rev()),
    }
    Ok(())
}

/// Reads a number of that type; `bytes` has its width.
pub(super) fn take(bytes: &[u8], kind: FieldType, endian: Endian) -> Value {
    let mut wide = [0u8; 8];
    for (i, b) in bytes.iter().enumerate() {
        let at = if endian == Endian::Little { i } else { bytes.len() - 1 - i };
        wide[at] = *b;
    }
    let raw = i64::from_le_bytes(wide);
    match kind {
        FieldType::F32 => Value::Num(f64::from(f32::from_le_bytes([wide[0], wide[1], wide[2], wide[3]]))),
        FieldType::I8 => Value::Int(i64::from(raw as i8)),
        FieldType::I16 => Value::Int(i64::from(raw as i16)),
        FieldType::I32 => Value::Int(i64::from(raw as i32)),
        _ => Value::Int(raw),
    }
}

pub(super) fn put_sum(out: &mut Vec<u8>, kind: ChecksumKind, value: u16, endian: Endian) {
    let [low, high] = value.to_le_bytes();
    match (kind.width(), endian) {
        (1, _) => out.push(low),
        (_, Endian::Little) => out.extend([low, high]),
        (_, Endian::Big) => out.extend([high, low]),
    }
}

fn stuff(bytes: &[u8], stuffing: &Stuffing) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    for b in bytes {
        out.push(*b);
        if out.ends_with(&stuffing.after.0) {
            out.push(stuffing.insert);
        }
    }
    out
}

/// Takes inserted bytes out again.
pub(super) fn unstuff(bytes: &[u8], stuffing: &Stuffing) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::with_capacity(bytes.len());
    let mut skip = false;
    for b in bytes {
        if std::mem::take(&mut skip) && *b == stuffing.insert {
            continue;
        }
        out.push(*b);
        skip = out.ends_with(&stuffing.after.0);
    }
    out
}
