//! Bytes on their way out, in whole units: a line or frame that has begun is never cut into.
//!
//! Urgent bytes go before all others, but behind the unit that is being written; a stop drops whatever
//! has not begun. The same queue serves the link's task and the replay of its log.

use crate::protocol::Spec;
use std::collections::VecDeque;
use std::sync::Arc;

/// What is to be written.
#[derive(Debug)]
pub(crate) struct Outgoing {
    spec: Arc<Spec>,
    /// `offset` bytes of the first chunk are written.
    chunks: VecDeque<Vec<u8>>,
    offset: usize,
}

impl Outgoing {
    pub(crate) fn new(spec: Arc<Spec>) -> Self {
        Outgoing { spec, chunks: VecDeque::new(), offset: 0 }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.chunks.is_empty()
    }

    /// The unwritten part of the first chunk, and whether part of that chunk is written already.
    pub(crate) fn front(&self) -> Option<&[u8]> {
        self.chunks.front().map(|chunk| &chunk[self.offset..])
    }

    /// Adds bytes behind all others.
    pub(crate) fn push(&mut self, bytes: Vec<u8>) {
        if !bytes.is_empty() {
            self.chunks.push_back(bytes);
        }
    }

    /// Adds bytes before all others, but not inside a unit that has begun.
    pub(crate) fn push_urgent(&mut self, urgent: Vec<u8>) {
        if urgent.is_empty() {
            return;
        }
        let Some(rest) = self.rest_of_unit() else {
            self.chunks.push_front(urgent);
            return;
        };
        let first = self.chunks.pop_front().expect("a unit has begun");
        let behind = first[self.offset + rest.len()..].to_vec();
        if !behind.is_empty() {
            self.chunks.push_front(behind);
        }
        self.chunks.push_front(urgent);
        // The written part stays in front of the rest, so that `offset` keeps its meaning.
        self.chunks.push_front(first[..self.offset + rest.len()].to_vec());
    }

    /// That many bytes were written; returns them.
    pub(crate) fn wrote(&mut self, n: usize) -> Vec<u8> {
        let Some(first) = self.chunks.front() else { return Vec::new() };
        let bytes = first[self.offset..self.offset + n].to_vec();
        self.offset += n;
        if self.offset == first.len() {
            self.chunks.pop_front();
            self.offset = 0;
        }
        bytes
    }

    /// Drops what has not begun. What has is completed, lest a line cut short mean something else.
    pub(crate) fn drop_unbegun(&mut self) {
        let rest = self.rest_of_unit();
        self.chunks.clear();
        self.offset = 0;
        self.chunks.extend(rest);
    }

    /// The unwritten rest of a line or frame that has begun.
    pub(crate) fn rest_of_unit(&self) -> Option<Vec<u8>> {
        let first = self.chunks.front().filter(|_| self.offset > 0)?;
        let rest = &first[self.offset..];
        Some(rest[..self.unit_end(rest)].to_vec())
    }

    /// Bytes up to the end of the unit that `rest` is the rest of.
    fn unit_end(&self, rest: &[u8]) -> usize {
        match &self.spec.line {
            Some(line) => {
                let eol = line.tx_eol.0.as_slice();
                let end = rest.windows(eol.len().max(1)).position(|w| w == eol);
                end.map_or(rest.len(), |at| at + eol.len())
            }
            None => rest.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::conformance::tests::shipped;

    #[test]
    fn pitfall_27_urgent_bytes_wait_for_the_end_of_a_line_that_has_begun_and_for_nothing_else() {
        let mut out = Outgoing::new(shipped("grbl"));
        out.push(b"G1 X1\nG1 X2\n".to_vec());
        assert_eq!(out.wrote(2), b"G1");
        out.push_urgent(b"?".to_vec());
        assert_eq!(out.wrote(4), b" X1\n");
        assert_eq!(out.wrote(1), b"?");
        assert_eq!(out.front(), Some(&b"G1 X2\n"[..]));
        out.wrote(1);
        out.push(b"G1 X3\n".to_vec());
        out.drop_unbegun();
        assert_eq!(out.front(), Some(&b"1 X2\n"[..]));
        out.wrote(5);
        assert!(out.is_empty());
    }
}
