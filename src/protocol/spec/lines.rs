//! Where in a file a key stands: from a path such as `rx[2].code` to its line.

use toml::de::{DeTable, DeValue};

/// Line of a byte offset, from 1.
pub(super) fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes()[..offset.min(text.len())].iter().filter(|b| **b == b'\n').count() + 1
}

/// Line of the deepest part of a key that exists; 1 when nothing of it does.
pub(super) fn line_of(text: &str, key: &str) -> usize {
    let Ok(tree) = DeTable::parse(text) else { return 1 };
    let (mut table, mut line) = (tree.get_ref(), 1);
    let path = steps(key);
    let mut rest = path.as_slice();
    while let Some((name, tail)) = rest.split_first() {
        let Some((at, mut value)) = table.get_key_value(name.as_str()) else { break };
        line = line_at(text, at.span().start);
        rest = tail;
        if let (DeValue::Array(items), Some((index, tail))) = (value.get_ref(), rest.split_first())
            && let Some(item) = index.parse().ok().and_then(|i: usize| items.get(i))
        {
            line = line_at(text, item.span().start);
            (value, rest) = (item, tail);
        }
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            _ => break,
        }
    }
    line
}

/// `a."b c"[2].d` as `a`, `b c`, `2`, `d`.
fn steps(key: &str) -> Vec<String> {
    let (mut steps, mut word, mut quoted) = (Vec::new(), String::new(), false);
    for c in key.chars() {
        match c {
            '"' => quoted = !quoted,
            '.' | '[' | ']' if !quoted => steps.push(std::mem::take(&mut word)),
            c => word.push(c),
        }
    }
    steps.push(word);
    steps.retain(|s| !s.is_empty());
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_leads_to_its_line_or_as_far_as_there_is_one() {
        let text =
            "[a]\nx = 1\n\"b c\" = { d = 2 }\n[[r]]\ny = 1\n[[r]]\ny = 2\nsteps = [\n  1,\n  { z = 3 },\n]\n";
        let lines = ["a.x", "a.\"b c\".d", "r[1].y", "r[1].nowhere", "r[1].steps[1].z", "q"];
        assert_eq!(lines.map(|key| line_of(text, key)), [2, 3, 7, 6, 10, 1]);
    }
}
