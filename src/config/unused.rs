//! Settings that were given and that the chosen mode does not use: whoever gives one expects it to do something.
//!
//! One that was given for this mode (by `--set`, or in a file that chooses the mode itself) is refused. A file may still hold
//! the settings of several modes for an override of the mode to choose from: those that it leaves idle are told, no more.

use super::agree::RigReading;
use super::document::Document;
use super::report::Finding;
use super::rig::OpticsMode;
use super::tree::{Node, Origin, Value};
use crate::elastomer::settings::OF_SOME_MODES;

/// A table of the rig file with a mode, and one of its keys that not every mode uses.
struct Idle<'a> {
    table: &'static str,
    key: &'static str,
    mode: &'static str,
    users: Vec<&'a str>,
}

/// Findings about keys that were given to no purpose, and words for those that another mode of the file is to use.
pub(super) fn look(document: &Document, rig: &RigReading, findings: &mut Vec<Finding>) -> Vec<String> {
    let mut warnings = Vec::new();
    for idle in idle(rig) {
        let path = format!("{}.{}", idle.table, idle.key);
        let mode = format!("{}.mode", idle.table);
        // What is wrong by itself is one finding already.
        let holds = rig.holds(&path) && rig.holds(&mode);
        let Some(node) = document.written(&path).filter(|_| holds) else { continue };
        let users: Vec<String> = idle.users.iter().map(|word| format!("\"{word}\"")).collect();
        let users = users.join(" or ");
        let chosen = document.written(&mode).map(|node| &node.origin);
        match (chosen, document.line_of(&path).filter(|_| !is_overridden(node))) {
            (Some(Origin::Set(setting)), Some(line)) => warnings.push(format!(
                "{path} = {node} ({}:{line}) does nothing with --set {setting}: only {mode} = {users} uses it",
                document.source.path
            )),
            _ => findings.push(document.complain(
                &path,
                format!("{node} (unused with {mode} = \"{}\")", idle.mode),
                format!("with {mode} = {users}"),
                format!("leave it out, or choose {mode} = \"{}\"", idle.users[0]),
            )),
        }
    }
    warnings
}

/// The keys that the modes of this rig do not use.
fn idle(rig: &RigReading) -> impl Iterator<Item = Idle<'static>> {
    let (elastomer, optics) = (rig.value.elastomer.mode, rig.value.optics.mode);
    let of_elastomer = OF_SOME_MODES.iter().filter(move |(_, users)| !users.contains(&elastomer));
    let of_elastomer = of_elastomer.map(move |(key, users)| Idle {
        table: "elastomer",
        key,
        mode: elastomer.name(),
        users: users.iter().map(|user| user.name()).collect(),
    });
    // (Samples and seed are those of the fast mode, too, where it falls back.)
    let of_optics = (optics != OpticsMode::Fast).then(|| Idle {
        table: "optics",
        key: "tolerance",
        mode: optics.name(),
        users: vec![OpticsMode::Fast.name()],
    });
    of_elastomer.chain(of_optics)
}

/// Whether a value or a part of it was given by an override.
fn is_overridden(node: &Node) -> bool {
    let is_set = |node: &Node| matches!(node.origin, Origin::Set(_));
    is_set(node) || matches!(&node.value, Value::Array(items) if items.iter().any(is_set))
}
