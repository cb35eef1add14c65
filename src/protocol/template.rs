//! Templates of lines: text with `{name}` places, no loops and no conditions.
//!
//! `{name}` inserts a field as text, `{name:02}` a whole number padded with zeros, `{name:.3}` a
//! number with fixed decimals. A number is never written with an exponent.

use super::value::{Fields, Value};
use serde::Deserialize;
use serde::de::{Deserializer, Error as _};

/// A parsed template.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    parts: Vec<Part>,
}

#[derive(Debug, Clone, PartialEq)]
enum Part {
    Text(String),
    Field { name: String, format: Format },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Format {
    Plain,
    Padded(usize),
    Decimals(usize),
}

impl Template {
    /// Parses a template; `{{` and `}}` stand for braces.
    pub fn parse(text: &str) -> Result<Template, String> {
        let mut parts = Vec::new();
        let mut literal = String::new();
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            match c {
                '{' | '}' if chars.peek() == Some(&c) => {
                    chars.next();
                    literal.push(c);
                }
                '{' => {
                    let mut inside = String::new();
                    loop {
                        match chars.next() {
                            Some('}') => break,
                            Some(c) => inside.push(c),
                            None => return Err(format!("\"{text}\": a {{ is never closed")),
                        }
                    }
                    if !literal.is_empty() {
                        parts.push(Part::Text(std::mem::take(&mut literal)));
                    }
                    parts.push(field(text, &inside)?);
                }
                '}' => return Err(format!("\"{text}\": a }} without its {{")),
                c => literal.push(c),
            }
        }
        if !literal.is_empty() {
            parts.push(Part::Text(literal));
        }
        Ok(Template { parts })
    }

    /// Names of the fields the template needs.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().filter_map(|p| match p {
            Part::Field { name, .. } => Some(name.as_str()),
            Part::Text(_) => None,
        })
    }

    /// Fills the template; `Err` names a field that is missing or not of the needed kind.
    pub fn fill(&self, fields: &Fields) -> Result<String, String> {
        let mut out = String::new();
        for part in &self.parts {
            match part {
                Part::Text(t) => out.push_str(t),
                Part::Field { name, format } => {
                    let value = fields.get(name).ok_or_else(|| format!("field {name} has no value"))?;
                    out.push_str(&write(name, value, *format)?);
                }
            }
        }
        Ok(out)
    }
}

fn field(text: &str, inside: &str) -> Result<Part, String> {
    let (name, format) = inside.split_once(':').unwrap_or((inside, ""));
    let number = |digits: &str| digits.parse::<usize>().ok().filter(|n| *n <= 12);
    let format = match format {
        "" => Some(Format::Plain),
        f if f.starts_with('.') => number(&f[1..]).map(Format::Decimals),
        f if f.starts_with('0') => number(f).map(Format::Padded),
        _ => None,
    };
    let named = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    match (named, format) {
        (true, Some(format)) => Ok(Part::Field { name: name.to_owned(), format }),
        _ => Err(format!("\"{text}\": {{{inside}}} is not {{name}}, {{name:02}} or {{name:.3}}")),
    }
}

fn write(name: &str, value: &Value, format: Format) -> Result<String, String> {
    match format {
        Format::Plain => match value {
            Value::Num(x) => {
                decimal(*x, 6).ok_or_else(|| format!("field {name} = {x} is not a number to send"))
            }
            other => Ok(other.to_text()),
        },
        Format::Padded(width) => {
            let i =
                value.as_i64().ok_or_else(|| format!("field {name} = {value:?} is not a whole number"))?;
            Ok(format!("{i:0width$}"))
        }
        Format::Decimals(n) => {
            let x = value.as_f64().ok_or_else(|| format!("field {name} = {value:?} is not a number"))?;
            decimal(x, n).ok_or_else(|| format!("field {name} = {x} is not a number to send"))
        }
    }
}

/// A number in plain decimals without trailing zeros or exponent; `None` for NaN and infinities.
pub fn decimal(x: f64, decimals: usize) -> Option<String> {
    if !x.is_finite() {
        return None;
    }
    let mut text = format!("{x:.decimals$}");
    if text.contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
    Some(if text == "-0" { "0".to_owned() } else { text })
}

impl<'de> Deserialize<'de> for Template {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        Template::parse(&String::deserialize(d)?).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_never_carry_an_exponent() {
        assert_eq!(decimal(1e-5, 4).unwrap(), "0");
        assert_eq!(decimal(-0.00001, 3).unwrap(), "0");
        assert_eq!(decimal(1.25e-3, 4).unwrap(), "0.0013");
        assert_eq!(decimal(300.0, 4).unwrap(), "300");
        assert_eq!(decimal(f64::NAN, 4), None);
    }

    #[test]
    fn templates_fill_and_refuse() {
        let t = Template::parse("/{device} {id:02} {{x}} F{feed:.1}").unwrap();
        let fields: Fields = [("device", Value::Int(1)), ("id", Value::Int(7)), ("feed", Value::Num(60.0))]
            .map(|(k, v)| (k.to_owned(), v))
            .into();
        assert_eq!(t.fill(&fields).unwrap(), "/1 07 {x} F60");
        assert!(t.fill(&Fields::new()).unwrap_err().contains("device"));
        assert!(Template::parse("{a").is_err());
        assert!(Template::parse("{a:q}").is_err());
    }
}
