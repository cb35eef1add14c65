//! A configuration file as a tree of values that know where they were written.

use std::fmt;
use toml::de::{DeTable, DeValue};

/// Where a value was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// On this line of the file, from 1.
    Line(usize),
    /// By this `--set KEY=VALUE`.
    Set(String),
}

/// A value and where it was written. For the value of a key, that is the line of the key.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// What was written.
    pub value: Value,
    /// Where.
    pub origin: Origin,
}

/// A TOML value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Stands where something is missing; fits nothing, so that asking for it tells what is wanted.
    Nothing,
    /// Text.
    String(String),
    /// A whole number.
    Integer(i64),
    /// A number.
    Float(f64),
    /// True or false.
    Boolean(bool),
    /// Dates and times; no setting is one, so they are kept as text for messages alone.
    Datetime(String),
    /// A list.
    Array(Vec<Node>),
    /// A table, in the order of the file.
    Table(Vec<(String, Node)>),
}

/// One step on the way to a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Into a table.
    Key(String),
    /// Into a list.
    Index(usize),
}

/// The way from the root to a value.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Path(pub Vec<Step>);

impl Path {
    /// Reads `a.b[2].c`. Quotes around a key protect dots: `a."x.y"`.
    pub fn parse(text: &str) -> Option<Path> {
        let mut steps = Vec::new();
        let mut rest = text.trim();
        while !rest.is_empty() {
            if let Some(inner) = rest.strip_prefix('[') {
                let end = inner.find(']')?;
                steps.push(Step::Index(inner[..end].parse().ok()?));
                rest = &inner[end + 1..];
            } else if let Some(inner) = rest.strip_prefix('"') {
                let end = inner.find('"')?;
                steps.push(Step::Key(inner[..end].to_owned()));
                rest = &inner[end + 1..];
            } else {
                let end = rest.find(['.', '[']).unwrap_or(rest.len());
                let key = rest[..end].trim();
                if key.is_empty() {
                    return None;
                }
                steps.push(Step::Key(key.to_owned()));
                rest = &rest[end..];
            }
            if let Some(next) = rest.strip_prefix('.') {
                if next.is_empty() {
                    return None;
                }
                rest = next;
            }
        }
        Some(Path(steps))
    }

    /// Whether this path is `other` or leads through it.
    pub fn starts_with(&self, other: &Path) -> bool {
        self.0.starts_with(&other.0)
    }

    /// The path of the enclosing table or list.
    pub fn parent(&self) -> Path {
        Path(self.0[..self.0.len().saturating_sub(1)].to_vec())
    }

    /// This path and one step more.
    pub fn then(&self, step: Step) -> Path {
        let mut steps = self.0.clone();
        steps.push(step);
        Path(steps)
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, step) in self.0.iter().enumerate() {
            match step {
                Step::Key(key) if key.contains(['.', '[']) => {
                    write!(f, "{}\"{key}\"", if i > 0 { "." } else { "" })?;
                }
                Step::Key(key) => write!(f, "{}{key}", if i > 0 { "." } else { "" })?,
                Step::Index(index) => write!(f, "[{index}]")?,
            }
        }
        Ok(())
    }
}

/// A place where the text is not TOML.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SyntaxError {
    /// Line, from 1.
    pub line: usize,
    /// What the parser says.
    pub message: String,
}

impl Node {
    /// Reads a TOML document; all syntax errors at once.
    pub fn parse(text: &str) -> Result<Node, Vec<SyntaxError>> {
        let (table, errors) = DeTable::parse_recoverable(text);
        let lines = Lines::of_text(text);
        if !errors.is_empty() {
            let at = |e: &toml::de::Error| lines.line_at(e.span().map_or(0, |s| s.start));
            let errors = errors.iter().map(|e| SyntaxError { line: at(e), message: e.message().to_owned() });
            return Err(errors.collect());
        }
        let table = Value::Table(entries(table.get_ref(), &lines));
        Ok(Node { value: table, origin: Origin::Line(1) })
    }

    /// Reads the value of a `--set`: TOML, a number written as `.5` or `5.`, or a bare word, which is text.
    pub fn parse_set(setting: &str, value: &str) -> Result<Node, String> {
        let value = value.trim();
        let bare = |c: char| c.is_alphanumeric() || "_-./: ".contains(c);
        let read = match (DeValue::parse(value), number(value)) {
            (Ok(parsed), _) => convert(parsed.get_ref(), &Lines::of_text(value)),
            (Err(_), Some(number)) => Value::Float(number),
            (Err(_), None) if !value.is_empty() && value.chars().all(bare) => Value::String(value.to_owned()),
            (Err(error), None) => return Err(error.message().to_owned()),
        };
        let mut node = Node { value: read, origin: Origin::Set(setting.to_owned()) };
        node.claim(&Origin::Set(setting.to_owned()));
        Ok(node)
    }

    /// Everything below was written where `origin` says.
    fn claim(&mut self, origin: &Origin) {
        self.origin = origin.clone();
        match &mut self.value {
            Value::Array(items) => items.iter_mut().for_each(|n| n.claim(origin)),
            Value::Table(entries) => entries.iter_mut().for_each(|(_, n)| n.claim(origin)),
            _ => {}
        }
    }

    /// The value at a path.
    pub fn at(&self, path: &Path) -> Option<&Node> {
        path.0.iter().try_fold(self, |node, step| match (&node.value, step) {
            (Value::Table(entries), Step::Key(key)) => entries.iter().find(|(k, _)| k == key).map(|(_, n)| n),
            (Value::Array(items), Step::Index(i)) => items.get(*i),
            _ => None,
        })
    }

    fn at_mut(&mut self, path: &Path) -> Option<&mut Node> {
        path.0.iter().try_fold(self, |node, step| match (&mut node.value, step) {
            (Value::Table(entries), Step::Key(key)) => {
                entries.iter_mut().find(|(k, _)| k == key).map(|(_, n)| n)
            }
            (Value::Array(items), Step::Index(i)) => items.get_mut(*i),
            _ => None,
        })
    }

    /// Where the value at a path was written, or else the nearest table around it.
    pub fn origin_of(&self, path: &Path) -> &Origin {
        let mut path = path.clone();
        loop {
            if let Some(node) = self.at(&path) {
                return &node.origin;
            }
            path = path.parent();
        }
    }

    /// Puts a value at a path, making tables on the way. Fails with the path of what is no table.
    pub fn put(&mut self, path: &Path, value: Node) -> Result<(), Path> {
        let mut here = self;
        for (i, step) in path.0.iter().enumerate() {
            let blocked = Err(Path(path.0[..=i].to_vec()));
            here = match (&mut here.value, step) {
                (Value::Table(entries), Step::Key(key)) => {
                    let known = entries.iter().position(|(k, _)| k == key);
                    let at = known.unwrap_or_else(|| {
                        let table = Node { value: Value::Table(vec![]), origin: value.origin.clone() };
                        entries.push((key.clone(), table));
                        entries.len() - 1
                    });
                    &mut entries[at].1
                }
                (Value::Array(items), Step::Index(index)) => match items.get_mut(*index) {
                    Some(item) => item,
                    None => return blocked,
                },
                _ => return blocked,
            };
        }
        *here = value;
        Ok(())
    }

    /// Takes a key out of its table.
    pub fn remove(&mut self, path: &Path) {
        if let (Some(Node { value: Value::Table(entries), .. }), Some(Step::Key(key))) =
            (self.at_mut(&path.parent()), path.0.last())
        {
            entries.retain(|(k, _)| k != key);
        }
    }
}

/// The value as a user would write it, shortened.
impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.value {
            Value::Nothing => f.write_str("missing"),
            Value::String(s) => write!(f, "{s:?}"),
            Value::Integer(i) => write!(f, "{i}"),
            Value::Float(x) => write!(f, "{x:?}"),
            Value::Boolean(b) => write!(f, "{b}"),
            Value::Datetime(d) => f.write_str(d),
            Value::Array(items) if items.is_empty() => f.write_str("[]"),
            Value::Array(items) if items.len() <= 4 => {
                let items: Vec<String> = items.iter().map(Node::to_string).collect();
                write!(f, "[{}]", items.join(", "))
            }
            Value::Array(items) => write!(f, "a list of {}", items.len()),
            Value::Table(_) => f.write_str("a table"),
        }
    }
}

fn entries(table: &DeTable<'_>, lines: &Lines) -> Vec<(String, Node)> {
    table
        .iter()
        .map(|(key, value)| {
            let origin = Origin::Line(lines.line_at(key.span().start));
            (key.get_ref().to_string(), Node { value: convert(value.get_ref(), lines), origin })
        })
        .collect()
}

/// A number as people write them who do not know that TOML wants digits on both sides of the point.
fn number(text: &str) -> Option<f64> {
    let digits = text.chars().all(|c| c.is_ascii_digit() || "+-.eE".contains(c));
    text.parse().ok().filter(|number: &f64| digits && number.is_finite())
}

fn convert(value: &DeValue<'_>, lines: &Lines) -> Value {
    match value {
        DeValue::String(s) => Value::String(s.to_string()),
        DeValue::Integer(i) => match i64::from_str_radix(i.as_str(), i.radix()) {
            Ok(whole) => Value::Integer(whole),
            // Beyond 64 bits: as a number it will be far out of any range, and be reported so.
            Err(_) => Value::Float(i.as_str().parse().unwrap_or(f64::INFINITY)),
        },
        DeValue::Float(x) => Value::Float(x.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(b) => Value::Boolean(*b),
        DeValue::Datetime(d) => Value::Datetime(d.to_string()),
        DeValue::Array(items) => Value::Array(
            items
                .iter()
                .map(|item| Node {
                    value: convert(item.get_ref(), lines),
                    origin: Origin::Line(lines.line_at(item.span().start)),
                })
                .collect(),
        ),
        DeValue::Table(table) => Value::Table(entries(table, lines)),
    }
}

/// Where the lines of a text end, in bytes.
struct Lines(Vec<usize>);

impl Lines {
    fn of_text(text: &str) -> Self {
        Self(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(at, _)| at).collect())
    }

    /// The line of the byte at `offset`, from 1.
    fn line_at(&self, offset: usize) -> usize {
        self.0.partition_point(|end| *end < offset) + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(text: &str) -> Path {
        Path::parse(text).unwrap()
    }

    #[test]
    fn values_know_their_lines_also_below_headers_and_in_lists() {
        let text = "a = 1\n\n[b.c]\nd = [\n  1,\n  2,\n]\n[[e]]\nf = 3\n[[e]]\nf = 4\n";
        let root = Node::parse(text).unwrap();
        for (key, line) in [("a", 1), ("b.c", 3), ("b.c.d", 4), ("b.c.d[1]", 6), ("e[1].f", 11)] {
            assert_eq!(root.origin_of(&path(key)), &Origin::Line(line), "{key}");
        }
        assert_eq!(root.origin_of(&path("b.c.missing")), &Origin::Line(3));
    }

    #[test]
    fn paths_read_back_as_they_are_written() {
        for text in ["a", "a.b[2].c", "[0].x", "devices.\"my.arm\".port"] {
            assert_eq!(path(text).to_string(), text);
        }
        for bad in ["a.", ".a", "a..b", "a[x]", "a[1", "a.\"b"] {
            assert_eq!(Path::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn a_set_is_toml_or_a_bare_word() {
        let value = |text| Node::parse_set("k", text).map(|n| n.value);
        assert_eq!(value("0.5"), Ok(Value::Float(0.5)));
        assert_eq!(value("3"), Ok(Value::Integer(3)));
        assert_eq!(value("true"), Ok(Value::Boolean(true)));
        assert_eq!(value("infinite"), Ok(Value::String("infinite".into())));
        assert_eq!(value("quasi_static"), Ok(Value::String("quasi_static".into())));
        assert_eq!(value("/dev/ttyUSB0"), Ok(Value::String("/dev/ttyUSB0".into())));
        assert_eq!(value("\"3\""), Ok(Value::String("3".into())));
        assert!(matches!(value("[11, 11, 5]"), Ok(Value::Array(items)) if items.len() == 3));
        assert!(value("[11, 11").is_err() && value("\"open").is_err() && value("").is_err());
    }

    #[test]
    fn every_syntax_error_has_its_line() {
        let errors = Node::parse("a = 1\nb = = 2\nc = \"open\nd = 1\n").unwrap_err();
        assert!(errors.iter().any(|e| e.line == 2) && errors.iter().any(|e| e.line == 3), "{errors:?}");
    }

    #[test]
    fn numbers_of_every_spelling_are_read() {
        let root = Node::parse("a = 1_000\nb = 0xff\nc = 1_0.5e1\nd = -inf\n").unwrap();
        let value = |key| root.at(&path(key)).unwrap().value.clone();
        assert_eq!(value("a"), Value::Integer(1000));
        assert_eq!(value("b"), Value::Integer(255));
        assert_eq!(value("c"), Value::Float(105.0));
        assert_eq!(value("d"), Value::Float(f64::NEG_INFINITY));
    }

    #[test]
    fn putting_makes_tables_and_refuses_to_replace_a_scalar_by_one() {
        let mut root = Node::parse("a = 1\nl = [1, 2]\n").unwrap();
        let node = |text| Node::parse_set("x", text).unwrap();
        root.put(&path("b.c"), node("2")).unwrap();
        root.put(&path("l[1]"), node("5")).unwrap();
        assert_eq!(root.at(&path("l[1]")).unwrap().value, Value::Integer(5));
        assert_eq!(root.origin_of(&path("b.c")), &Origin::Set("x".into()));
        assert_eq!(root.put(&path("a.b"), node("2")), Err(path("a.b")));
        assert_eq!(root.put(&path("l[2]"), node("2")), Err(path("l[2]")));
    }
}
