//! All mismatches of a file at once, although serde stops at the first.
//!
//! After each error the tree is repaired where it was wrong (an unknown key goes, a missing or
//! mistyped one becomes a placeholder that fits) and read again. What was repaired is *doubtful*:
//! later findings about it or its neighbours in the same table may be consequences, and are dropped.

use super::reader::{Fault, ReadError, Reader};
use super::suggest::closest;
use super::tree::{Node, Origin, Path, Step, Value};
use crate::problem::Problem;
use serde::de::DeserializeOwned;

/// Repairs that are tried at most; a file with more to report has been enough of a lesson.
const MOST_REPAIRS: usize = 200;

/// A typed value, or what prevents one, and what was found on the way.
pub struct Gathered<T> {
    /// The value; with placeholders wherever `problems` is not empty.
    pub value: Option<T>,
    /// What does not fit the type, in order of discovery.
    pub problems: Vec<Problem>,
    doubtful: Vec<Path>,
    placeholders: Vec<Path>,
}

impl<T> Gathered<T> {
    /// Where something else was read than was written.
    pub fn placeholders(&self) -> &[Path] {
        &self.placeholders
    }

    /// Whether a finding about `key` may be a consequence of a repair.
    pub fn is_doubtful(&self, key: &str) -> bool {
        let Some(path) = Path::parse(key) else { return false };
        (self.doubtful.iter())
            .any(|d| path.starts_with(d) || d.starts_with(&path) || path.parent() == d.parent())
    }
}

/// Reads a `T`, repairing as often as needed.
pub fn gather<T: DeserializeOwned>(root: &Node) -> Gathered<T> {
    let mut tree = root.clone();
    let mut out = Gathered { value: None, problems: vec![], doubtful: vec![], placeholders: vec![] };
    for _ in 0..MOST_REPAIRS {
        let error = match T::deserialize(Reader(&tree)) {
            Ok(value) => {
                out.value = Some(value);
                return out;
            }
            Err(error) => error,
        };
        let (path, found) = locate::<T>(&tree, &error);
        let is_consequence = out.doubtful.iter().any(|d| path.starts_with(d));
        if !is_consequence && !was_misspelt(&mut out.problems, &path, &found) {
            out.problems.push(describe::<T>(&tree, &path, &found));
        }
        out.doubtful.push(path.clone());
        match &found.fault {
            Fault::Unknown { .. } => tree.remove(&path),
            _ if !put_placeholder::<T>(&mut tree, &path, &found) => return out,
            _ => out.placeholders.push(path),
        }
    }
    out
}

/// Whether a missing key is there after all, misspelt. Types that let unknown keys pass cannot say
/// what they know, so the suggestion is made here.
fn was_misspelt(problems: &mut [Problem], path: &Path, error: &ReadError) -> bool {
    let Fault::Missing { key: missing } = &error.fault else { return false };
    for problem in problems.iter_mut().filter(|p| p.value.ends_with(UNKNOWN)) {
        let unknown = Path::parse(&problem.key).unwrap_or_default();
        if let Some(Step::Key(written)) = unknown.0.last()
            && unknown.parent() == path.parent()
            && closest(written, std::iter::once(missing.as_str())).is_some()
        {
            problem.next = format!("did you mean `{missing}`?");
            return true;
        }
    }
    false
}

/// How [`crate::protocol::Pattern`] begins to say what is wrong with it.
const NOT_A: &str = "not a regular expression";

/// Marks the value of a key that no type knows.
const UNKNOWN: &str = "(unknown key)";

/// The path of the value at fault. Inside a table that is told apart by a tag, serde has lost the
/// path: the child whose replacement cures the table is the one.
fn locate<T: DeserializeOwned>(tree: &Node, error: &ReadError) -> (Path, ReadError) {
    let path = error.path();
    match &error.fault {
        Fault::Unknown { key, .. } | Fault::Missing { key } => {
            (path.then(Step::Key(key.clone())), error.clone())
        }
        Fault::Type { found_table: false, .. } | Fault::Variant { .. } => {
            let children = match tree.at(&path).map(|n| &n.value) {
                Some(Value::Table(entries)) => entries.as_slice(),
                _ => &[],
            };
            for (key, _) in children {
                let child = path.then(Step::Key(key.clone()));
                let cures = candidates(error).into_iter().any(|value| {
                    let mut trial = tree.clone();
                    let put = trial.put(&child, Node { value, origin: Origin::Line(0) });
                    put.is_ok() && gets_past::<T>(&trial, &path, error)
                });
                if cures {
                    return (child, error.clone());
                }
            }
            (path, error.clone())
        }
        _ => (path, error.clone()),
    }
}

/// Values of every type, the likely ones for this error first.
fn candidates(error: &ReadError) -> Vec<Value> {
    let node = |value| Node { value, origin: Origin::Line(0) };
    let mut values = Vec::new();
    if let Fault::Variant { known } = &error.fault {
        values.extend(known.first().map(|word| Value::String(word.clone())));
    }
    values.extend([
        Value::Float(1.0),
        Value::Integer(1),
        Value::String(String::new()),
        // A field of a protocol's frame has a form of its own.
        Value::String("x:u8".to_owned()),
        Value::Boolean(false),
        Value::Table(vec![]),
        Value::Array(vec![]),
    ]);
    for length in 2..=4 {
        values.push(Value::Array(vec![node(Value::Integer(1)); length]));
    }
    values
}

/// Puts something at `path` with which reading gets past it.
fn put_placeholder<T: DeserializeOwned>(tree: &mut Node, path: &Path, error: &ReadError) -> bool {
    // Asking for what is not there, or for no word, tells which words an enum knows.
    let asked = |value| {
        let mut trial = tree.clone();
        trial.put(path, Node { value, origin: Origin::Line(0) }).ok()?;
        T::deserialize(Reader(&trial)).err().filter(|e| matches!(e.fault, Fault::Variant { .. }))
    };
    let words = [Value::Nothing, Value::String(String::new())].into_iter().find_map(asked);
    let best = words.as_ref().unwrap_or(error);
    for value in candidates(best) {
        let mut trial = tree.clone();
        if trial.put(path, Node { value, origin: Origin::Line(0) }).is_err() {
            return false;
        }
        if gets_past::<T>(&trial, path, error) {
            *tree = trial;
            return true;
        }
    }
    false
}

/// Whether reading `trial` gets further than the table or value at `path`, where `error` was.
fn gets_past<T: DeserializeOwned>(trial: &Node, path: &Path, error: &ReadError) -> bool {
    match T::deserialize(Reader(trial)) {
        Ok(_) => true,
        Err(next) => match &next.fault {
            // An empty table that wants its keys is a table in the right place.
            Fault::Missing { .. } => next.path() == *path || !next.path().starts_with(path),
            _ => !next.path().starts_with(path) && next != *error,
        },
    }
}

fn describe<T: DeserializeOwned>(tree: &Node, path: &Path, error: &ReadError) -> Problem {
    let key = path.to_string();
    let written = tree.at(path).map_or_else(|| "missing".to_owned(), Node::to_string);
    match &error.fault {
        Fault::Unknown { key: name, known } => {
            let mut neighbours: Vec<String> = known.clone();
            neighbours.sort();
            let next = match closest(name, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "remove it".to_owned(),
            };
            let allowed = if known.is_empty() {
                "no such key here".to_owned()
            } else {
                format!("one of {}", neighbours.join(", "))
            };
            Problem { key, value: format!("{written} {UNKNOWN}"), allowed, next }
        }
        Fault::Missing { key: name } => {
            let wanted = wanted_at::<T>(tree, path);
            let table = path.parent();
            let place =
                if table.0.is_empty() { "the top of the file".to_owned() } else { format!("[{table}]") };
            let next = if wanted == "a table" {
                format!("add a table [{path}]")
            } else {
                format!("add `{name} = ...` to {place}")
            };
            Problem { key, value: "missing".to_owned(), allowed: wanted, next }
        }
        Fault::Variant { known } => {
            let near = tree.at(path).and_then(|n| match &n.value {
                Value::String(word) => closest(word, known.iter().map(String::as_str)),
                _ => None,
            });
            let next = match near {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => "choose one of them".to_owned(),
            };
            Problem { key, value: written, allowed: one_of(known), next }
        }
        Fault::Type { wanted, .. } => {
            let wanted = plainly(wanted);
            Problem { key, value: written, next: format!("write {wanted}"), allowed: wanted }
        }
        // A type of ours that says what it wants: the part in the line is in the value already.
        Fault::Other(message) if message.starts_with(NOT_A) => {
            let (reason, wanted) = (message.lines().last().unwrap_or_default(), "a regular expression");
            let allowed = format!("{wanted} ({})", reason.trim().trim_start_matches("error: "));
            Problem { key, value: written, allowed, next: "correct the expression".to_owned() }
        }
        Fault::Other(message) if message.starts_with(&format!("{written} is not ")) => {
            let wanted = message[written.len() + " is not ".len()..].to_owned();
            Problem { key, value: written, next: format!("write {wanted}"), allowed: wanted }
        }
        Fault::Other(message) if message.starts_with(&format!("{written}: ")) => {
            let (value, allowed) = (message.clone(), "what can be read, as in the shipped files".to_owned());
            Problem { key, value, allowed, next: "correct it".to_owned() }
        }
        Fault::Other(message) => {
            let next = "see the comments in the shipped files".to_owned();
            let allowed = if message.contains("untagged enum") {
                "one of the forms that the shipped files show".to_owned()
            } else {
                message.clone()
            };
            Problem { key, value: written, allowed, next }
        }
    }
}

fn one_of(words: &[String]) -> String {
    let quoted: Vec<String> = words.iter().map(|w| format!("\"{w}\"")).collect();
    quoted.join(", ")
}

/// What the type wants at a path: asked by putting nothing there.
fn wanted_at<T: DeserializeOwned>(tree: &Node, path: &Path) -> String {
    let mut trial = tree.clone();
    let put = trial.put(path, Node { value: Value::Nothing, origin: Origin::Line(0) });
    match put.ok().and_then(|()| T::deserialize(Reader(&trial)).err()).map(|e| e.fault) {
        Some(Fault::Type { wanted, .. }) => plainly(&wanted),
        Some(Fault::Variant { known }) => one_of(&known),
        _ => "a value".to_owned(),
    }
}

/// serde's words for a type in those of a user.
fn plainly(wanted: &str) -> String {
    match wanted {
        "f32" | "f64" => "a number".to_owned(),
        "i8" | "i16" | "i32" | "i64" => "a whole number".to_owned(),
        "u8" => "a whole number from 0 to 255".to_owned(),
        "u16" => "a whole number from 0 to 65535".to_owned(),
        "u32" | "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        "a string" => "text in quotes".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "a table".to_owned(),
        "any value" => "a value".to_owned(),
        other => match other.strip_prefix("an array of length ") {
            Some(length) => format!("a list of {length} values"),
            None if other.starts_with("struct ") || other.starts_with("internally tagged") => {
                "a table".to_owned()
            }
            None => other.to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        count: u32,
        ratio: Option<f64>,
        point: [f64; 2],
        word: Word,
        inner: Inner,
        shape: Shape,
        many: Vec<Inner>,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(rename_all = "snake_case")]
    enum Word {
        FirstWord,
        Second,
    }

    /// Does not deny unknown keys; the reader does.
    #[derive(Debug, Deserialize, PartialEq)]
    struct Inner {
        name: String,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
    enum Shape {
        Ball { radius: f64 },
        Box { x: f64, y: f64 },
    }

    const SOUND: &str = "count = 1\npoint = [1, 2.5]\nword = \"second\"\ninner = { name = \"a\" }\n\
                         shape = { kind = \"ball\", radius = 2 }\nmany = []\n";

    fn problems(text: &str) -> Vec<(String, String)> {
        let gathered = gather::<Outer>(&Node::parse(text).unwrap());
        gathered.problems.into_iter().map(|p| (p.key, p.next)).collect()
    }

    fn keys(text: &str) -> Vec<String> {
        problems(text).into_iter().map(|(key, _)| key).collect()
    }

    #[test]
    fn what_fits_is_read() {
        let gathered = gather::<Outer>(&Node::parse(SOUND).unwrap());
        let value = gathered.value.unwrap();
        assert_eq!((value.count, value.ratio, value.point), (1, None, [1.0, 2.5]));
        assert_eq!((value.word, value.shape), (Word::Second, Shape::Ball { radius: 2.0 }));
    }

    #[test]
    fn nothing_at_all_is_every_missing_key() {
        assert_eq!(keys(""), ["count", "point", "word", "inner", "shape", "many"]);
    }

    #[test]
    fn many_mistakes_are_one_report() {
        let text = "count = -1\nratio = \"half\"\npoint = [1]\nword = \"secnd\"\ncolour = 1\n\
                    many = [{ name = \"a\" }, { nam = \"b\" }, { name = 3 }]\n\
                    inner = { name = \"a\", extra = 2 }\nshape = { kind = \"ball\", radius = \"big\" }\n";
        let found = problems(text);
        let mut keys: Vec<&str> = found.iter().map(|(key, _)| key.as_str()).collect();
        keys.sort_unstable();
        assert_eq!(
            keys,
            [
                "colour",
                "count",
                "inner.extra",
                "many[1].nam",
                "many[2].name",
                "point",
                "ratio",
                "shape.radius",
                "word"
            ]
        );
        let next = |key: &str| found.iter().find(|(k, _)| k == key).unwrap().1.clone();
        assert_eq!(next("word"), "did you mean \"second\"?");
        assert_eq!(next("many[1].nam"), "did you mean `name`?");
    }

    #[test]
    fn a_tagged_table_names_its_unknown_and_missing_keys() {
        let text = SOUND.replace("radius = 2", "radius = 2, edge = 1");
        assert_eq!(keys(&text), ["shape.edge"]);
        assert_eq!(keys(&SOUND.replace("kind = \"ball\", radius = 2", "kind = \"box\", x = 1")), ["shape.y"]);
        assert_eq!(keys(&SOUND.replace("kind = \"ball\", ", "")), ["shape.kind"]);
        assert_eq!(keys(&SOUND.replace("\"ball\"", "\"bal\"")), ["shape.kind"]);
    }

    #[test]
    fn neighbours_of_a_repair_are_doubtful_and_others_are_not() {
        let text = SOUND.replace("name = \"a\"", "name = 3");
        let gathered = gather::<Outer>(&Node::parse(&text).unwrap());
        assert!(gathered.is_doubtful("inner.name") && gathered.is_doubtful("inner.other"));
        assert!(gathered.is_doubtful("inner") && !gathered.is_doubtful("shape.radius"));
    }
}
