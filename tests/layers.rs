//! Imports go downward only: a module may use what stands on a lower rung, never its neighbours
//! on the same rung nor anything above. The rungs are those of the crate doc.

use std::path::Path;

/// Top-level modules by rung, lowest first.
const RUNGS: &[(&str, &[&str])] = &[
    ("0 vocabulary", &["cache", "clock", "draw", "frame", "percent", "pose", "problem", "units", "wakeful"]),
    ("1a shapes and images", &["image", "indenter"]),
    ("1b pure domains", &["elastomer", "motion", "optics", "protocol"]),
    ("2 uses", &["calibrate", "dataset", "device", "plan"]),
    ("3a activities", &["pairing", "session", "trial", "twin"]),
    ("3b whole collections", &["collection", "resim"]),
    ("4a configuration", &["config"]),
    ("4b assembly", &["assemble"]),
    ("5a faces", &["control", "live", "report"]),
    ("5b command line", &["cli"]),
];

fn rung_of(module: &str) -> Option<usize> {
    RUNGS.iter().position(|(_, modules)| modules.contains(&module))
}

fn rust_files(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("src can be listed") {
        let path = entry.expect("an entry of src").path();
        if path.is_dir() {
            if !path.ends_with("src/ffi") {
                rust_files(&path, found);
            }
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Modules of ours that a source text names as `crate::module`, without comments.
fn imports(text: &str) -> Vec<String> {
    let code: String =
        text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        if let Some(list) = rest.strip_prefix('{') {
            // `use crate::{a::X, b}`: the first word of each element at depth one.
            let (mut depth, mut word, mut taking) = (1, String::new(), true);
            for c in list.chars() {
                match c {
                    '{' => depth += 1,
                    '}' => depth -= 1,
                    _ => {}
                }
                if c.is_alphanumeric() || c == '_' {
                    if taking && depth == 1 {
                        word.push(c);
                    }
                } else if !word.is_empty() {
                    found.push(std::mem::take(&mut word));
                    taking = false;
                }
                if c == ',' && depth == 1 {
                    taking = true;
                }
                if depth == 0 {
                    break;
                }
            }
        } else {
            found.push(rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
        }
    }
    found
}

#[test]
fn imports_go_downward_only() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    let mut wrong = Vec::new();
    for file in files {
        let relative = file.strip_prefix(&src).expect("below src");
        let first = relative.components().next().expect("a name").as_os_str().to_string_lossy().into_owned();
        let module = first.trim_end_matches(".rs");
        if ["lib", "main", "physics", "fourier"].contains(&module) {
            continue;
        }
        if module.starts_with("ffi") {
            continue;
        }
        let rung = rung_of(module).unwrap_or_else(|| panic!("src/{module} has no rung: name it in RUNGS"));
        let text = std::fs::read_to_string(&file).expect("a source file");
        for import in imports(&text) {
            let Some(other) = rung_of(&import) else { continue };
            // The words of the vocabulary may explain each other: a frame bears a timestamp.
            let downward = other < rung || import == module || (rung == 0 && other == 0);
            if !downward {
                wrong.push(format!("{} imports crate::{import} ({})", relative.display(), RUNGS[other].0));
            }
        }
    }
    assert!(wrong.is_empty(), "imports that do not go downward:\n{}", wrong.join("\n"));
}

#[test]
fn the_reader_of_imports_sees_every_form() {
    let text = "use crate::{pose::{Pose, x}, motion};\nuse crate::device::Camera;\n// crate::cli\nlet a = crate::plan::b();";
    assert_eq!(imports(text), ["pose", "motion", "device", "plan"]);
}
