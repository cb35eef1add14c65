//! Small values that protocol files are written in: bytes, patterns, fields.

use serde::de::{Deserializer, Error as _};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A run of bytes: text as it stands, or `hex:18 0d` for bytes that are not text.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Bytes(pub Vec<u8>);

impl Bytes {
    /// Reads the notation of protocol files.
    pub fn parse(text: &str) -> Result<Bytes, String> {
        match text.strip_prefix("hex:") {
            Some(digits) => parse_hex(digits).map(Bytes),
            None => Ok(Bytes(text.as_bytes().to_vec())),
        }
    }
}

/// Reads pairs of hex digits, blanks allowed between the pairs.
pub fn parse_hex(digits: &str) -> Result<Vec<u8>, String> {
    let compact: Vec<u8> = digits.bytes().filter(|b| !b.is_ascii_whitespace()).collect();
    if !compact.len().is_multiple_of(2) {
        return Err(format!("\"{digits}\" has an odd number of hex digits; write two for each byte"));
    }
    compact
        .chunks(2)
        .map(|pair| {
            let digit = |b: u8| (b as char).to_digit(16);
            match (digit(pair[0]), digit(pair[1])) {
                (Some(high), Some(low)) => Ok((high * 16 + low) as u8),
                _ => Err(format!("\"{digits}\" is not hexadecimal; write pairs of 0-9 a-f")),
            }
        })
        .collect()
}

/// Writes bytes as pairs of hex digits with blanks between.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" ")
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        Bytes::parse(&String::deserialize(d)?).map_err(D::Error::custom)
    }
}

/// A regular expression over bytes; linear time whatever the device sends.
#[derive(Debug, Clone)]
pub struct Pattern(regex::bytes::Regex);

impl Pattern {
    /// Compiles an expression.
    pub fn new(text: &str) -> Result<Pattern, String> {
        regex::bytes::RegexBuilder::new(text)
            .unicode(false)
            .build()
            .map(Pattern)
            .map_err(|e| format!("not a regular expression: {e}"))
    }

    /// Whether the expression is found in `bytes`.
    pub fn is_match(&self, bytes: &[u8]) -> bool {
        self.0.is_match(bytes)
    }

    /// The named groups that took part in a match, or `None` when there is no match.
    pub fn captures(&self, bytes: &[u8]) -> Option<Fields> {
        let caps = self.0.captures(bytes)?;
        let groups = self.0.capture_names().flatten();
        Some(
            groups
                .filter_map(|name| {
                    let text = String::from_utf8_lossy(caps.name(name)?.as_bytes()).into_owned();
                    Some((name.to_owned(), Value::Text(text)))
                })
                .collect(),
        )
    }

    /// Names of the groups.
    pub fn groups(&self) -> impl Iterator<Item = &str> {
        self.0.capture_names().flatten()
    }

    /// The expression as written.
    pub fn as_str(&self) -> &str {
        self.0.as_str()
    }
}

impl PartialEq for Pattern {
    fn eq(&self, other: &Self) -> bool {
        self.as_str() == other.as_str()
    }
}

impl<'de> Deserialize<'de> for Pattern {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        Pattern::new(&String::deserialize(d)?).map_err(D::Error::custom)
    }
}

/// What a field of a command or of a reply holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A whole number.
    Int(i64),
    /// A number with a fraction.
    Num(f64),
    /// Text, as captured.
    Text(String),
    /// Numbers separated by the list sign, such as a position of several axes.
    List(Vec<f64>),
}

impl Value {
    /// The value as a number, if it is one or reads as one.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Value::Int(i) => Some(*i as f64),
            Value::Num(x) => Some(*x),
            Value::Text(t) => t.trim().parse().ok().filter(|x: &f64| x.is_finite()),
            Value::List(list) => match list[..] {
                [only] => Some(only),
                _ => None,
            },
        }
    }

    /// The value as a whole number, if it is one or reads as one.
    pub fn as_i64(&self) -> Option<i64> {
        match self {
            Value::Int(i) => Some(*i),
            Value::Num(x) => (x.fract() == 0.0 && x.abs() < 9e15).then_some(*x as i64),
            Value::Text(t) => t.trim().parse().ok(),
            Value::List(_) => None,
        }
    }

    /// The value as a list of numbers: `1.0,2.0` or a single number.
    pub fn as_list(&self) -> Option<Vec<f64>> {
        match self {
            Value::List(list) => Some(list.clone()),
            other => other.as_f64().map(|x| vec![x]),
        }
    }

    /// The value as text.
    pub fn to_text(&self) -> String {
        match self {
            Value::Int(i) => i.to_string(),
            Value::Num(x) => x.to_string(),
            Value::Text(t) => t.clone(),
            Value::List(list) => list.iter().map(f64::to_string).collect::<Vec<_>>().join(","),
        }
    }

    /// Whether two values mean the same: numbers by value, anything else as text.
    pub fn same(&self, other: &Value) -> bool {
        match (self.as_list(), other.as_list()) {
            (Some(a), Some(b)) => a.len() == b.len() && a.iter().zip(&b).all(|(x, y)| (x - y).abs() < 1e-9),
            _ => self.to_text() == other.to_text(),
        }
    }
}

impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Value::Num(x)
    }
}

impl From<i64> for Value {
    fn from(i: i64) -> Self {
        Value::Int(i)
    }
}

impl From<&str> for Value {
    fn from(t: &str) -> Self {
        Value::Text(t.to_owned())
    }
}

/// Named values: the arguments of a command, or what a reply carried.
pub type Fields = BTreeMap<String, Value>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_text_or_hex() {
        assert_eq!(Bytes::parse("\r\n").unwrap().0, b"\r\n");
        assert_eq!(Bytes::parse("hex:18 0D").unwrap().0, [0x18, 0x0d]);
        assert!(Bytes::parse("hex:1").is_err());
        assert!(Bytes::parse("hex:zz").is_err());
    }

    #[test]
    fn patterns_match_bytes_that_are_not_text() {
        let p = Pattern::new("^ok(?: (?P<text>.*))?$").unwrap();
        assert!(p.captures(b"ok \xff\xfe").unwrap().contains_key("text"));
        assert!(p.captures(b"\xffok").is_none());
    }
}
