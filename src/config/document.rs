//! One file on its way from text to a checked value, collecting what is wrong with it.

use super::gather::gather;
use super::lookup::SourceFile;
use super::report::{COMMAND_LINE, Finding};
use super::suggest::closest;
use super::tree::{Node, Origin, Path, Step, Value};
use crate::problem::{Problem, Problems};
use serde::de::DeserializeOwned;

/// A file as its type, and how far it can be relied on.
#[derive(Debug)]
pub struct Reading<T, C> {
    /// What it says; placeholders stand where [`holds`](Self::holds) denies.
    pub value: T,
    /// What its own check made of it.
    pub checked: C,
    is_sound: bool,
    wrong: Vec<Path>,
}

impl<T, C> Reading<T, C> {
    /// Whether nothing at all is wrong with the file.
    pub fn is_sound(&self) -> bool {
        self.is_sound
    }

    /// Whether nothing is wrong at a key, below it or around it, so that what follows from it may be
    /// looked at. Unknown keys do not matter here: nothing is read from them.
    pub fn holds(&self, key: &str) -> bool {
        let key = Path::parse(key).unwrap_or_default();
        !self.wrong.iter().any(|w| w.starts_with(&key) || key.starts_with(w))
    }

    /// What the check made of a file that is sound.
    pub fn into_sound(self) -> Option<C> {
        self.is_sound.then_some(self.checked)
    }
}

/// A file that is TOML.
#[derive(Debug, Clone)]
pub struct Document {
    /// The file.
    pub source: SourceFile,
    tree: Node,
}

impl Document {
    /// Parses a file; syntax errors go to `findings`.
    pub fn parse(source: SourceFile, findings: &mut Vec<Finding>) -> Option<Self> {
        match Node::parse(&source.text) {
            Ok(tree) => Some(Self { source, tree }),
            Err(mut errors) => {
                // One mistake makes the parser stumble more than once on its line.
                errors.dedup_by_key(|e| e.line);
                findings.extend(errors.into_iter().map(|e| Finding {
                    file: source.path.clone(),
                    at: Some(Origin::Line(e.line)),
                    key: String::new(),
                    value: e.message,
                    allowed: "TOML, see https://toml.io".to_owned(),
                    next: "correct this line".to_owned(),
                }));
                None
            }
        }
    }

    /// Applies an override. `setting` is the whole `KEY=VALUE`, `key` the path within this file.
    pub fn set(&mut self, setting: &str, key: &Path, value: Node, findings: &mut Vec<Finding>) {
        if let Err(blocked) = self.tree.put(key, value) {
            let around = blocked.parent();
            let why = match blocked.0.last() {
                Some(Step::Index(i)) => format!("there is no {around}[{i}]"),
                _ => format!("{around} is no table"),
            };
            findings.push(Finding {
                file: self.source.path.clone(),
                at: Some(Origin::Set(setting.to_owned())),
                key: key.to_string(),
                value: why,
                allowed: "a key of a table, or an element of a list that is there".to_owned(),
                next: "correct the key".to_owned(),
            });
        }
    }

    /// Reads the file as a `T` and lets `check` judge it. Everything wrong goes to `findings`. `None`
    /// when it is so far from a `T` that nothing more can be said.
    pub fn read<T: DeserializeOwned, C>(
        &self,
        check: impl FnOnce(&T, &mut Problems) -> C,
        findings: &mut Vec<Finding>,
    ) -> Option<Reading<T, C>> {
        let mut gathered = gather::<T>(&self.tree);
        findings.extend(gathered.problems.iter().map(|p| self.finding(p)));
        let value = gathered.value.take()?;
        let doubted = gathered.placeholders().iter().map(Path::to_string).collect();
        let mut problems = Problems::doubting(doubted);
        let checked = check(&value, &mut problems);
        let problems = problems.into_vec();
        let is_sound = gathered.problems.is_empty() && problems.is_empty();
        let mut wrong = gathered.placeholders().to_vec();
        for problem in problems {
            wrong.push(Path::parse(&problem.key).unwrap_or_default());
            if !gathered.is_doubtful(&problem.key) {
                findings.push(self.finding(&problem));
            }
        }
        Some(Reading { value, checked, is_sound, wrong })
    }

    /// The text at a key, if there is one, whatever else is wrong with the file.
    pub fn text_at(&self, key: &str) -> Option<&str> {
        match &self.tree.at(&Path::parse(key)?)?.value {
            Value::String(text) => Some(text),
            _ => None,
        }
    }

    /// What was written at a key of this file or put there by an override; nothing where that was left out.
    pub fn written(&self, key: &str) -> Option<&Node> {
        self.tree.at(&Path::parse(key)?)
    }

    /// The line of a key of this file, or of the nearest table around it.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        match self.tree.origin_of(&Path::parse(key)?) {
            Origin::Line(line) => Some(*line),
            Origin::Set(_) => None,
        }
    }

    /// A problem with a key of this file, with the line.
    pub fn finding(&self, problem: &Problem) -> Finding {
        let path = Path::parse(&problem.key).unwrap_or_default();
        let has_line = !path.0.is_empty();
        Finding {
            file: self.source.path.clone(),
            at: has_line.then(|| self.tree.origin_of(&path).clone()),
            key: problem.key.clone(),
            value: problem.value.clone(),
            allowed: problem.allowed.clone(),
            next: problem.next.clone(),
        }
    }

    /// A problem found outside a domain's own check.
    pub fn complain(
        &self,
        key: &str,
        value: impl std::fmt::Display,
        allowed: impl Into<String>,
        next: impl Into<String>,
    ) -> Finding {
        let (value, allowed, next) = (value.to_string(), allowed.into(), next.into());
        self.finding(&Problem { key: key.to_owned(), value, allowed, next })
    }
}

/// One `--set KEY=VALUE`.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// As it was given.
    pub text: String,
    /// The key.
    pub key: Path,
    /// The value.
    pub value: Node,
}

impl Setting {
    /// Reads `KEY=VALUE`.
    pub fn parse(text: &str) -> Result<Self, Box<Finding>> {
        let complain = |key: &str, value: String, allowed: &str, next: &str| {
            Box::new(Finding {
                file: COMMAND_LINE.to_owned(),
                at: Some(Origin::Set(text.to_owned())),
                key: key.to_owned(),
                value,
                allowed: allowed.to_owned(),
                next: next.to_owned(),
            })
        };
        let Some((key, value)) = text.split_once('=') else {
            let next = "write e.g. --set elastomer.tolerance=0.01";
            return Err(complain("", "no `=`".to_owned(), "KEY=VALUE", next));
        };
        let Some(path) = Path::parse(key).filter(|p| matches!(p.0.first(), Some(Step::Key(_)))) else {
            let next = "write e.g. --set elastomer.tolerance=0.01";
            return Err(complain("", format!("key {key:?}"), "a dotted key, list elements as [2]", next));
        };
        match Node::parse_set(text, value) {
            Ok(value) => Ok(Self { text: text.to_owned(), key: path, value }),
            Err(message) => {
                let allowed = "a TOML value or a bare word";
                Err(complain(key, format!("{value} ({message})"), allowed, "quote text, close brackets"))
            }
        }
    }

    /// The first word of the key.
    pub fn domain(&self) -> &str {
        match self.key.0.first() {
            Some(Step::Key(key)) => key,
            _ => "",
        }
    }

    /// The key without its first word.
    pub fn within_domain(&self) -> Path {
        Path(self.key.0[1..].to_vec())
    }
}

/// The nearest of `names` to a mistyped one, as a next move.
pub fn near_or(typed: &str, names: &[&str], otherwise: &str) -> String {
    closest(typed, names.iter().copied())
        .map_or_else(|| otherwise.to_owned(), |near| format!("did you mean \"{near}\"?"))
}
