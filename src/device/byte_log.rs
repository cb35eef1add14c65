//! A byte-exact log of one port: every read and every write with its instant.
//!
//! One record a line, in the form of recorded transcripts: seconds, `>` for sent or `<` for
//! received (`!` for a stop's bytes, `#` for a remark), then the bytes as text with escapes. Any
//! field failure can so be replayed. The file is rotated at a size and the older half kept, so a
//! long session cannot fill the disk.

use crate::clock::Timestamp;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Size at which a file is rotated: days of polling, still opened by any editor.
const ROTATE_BYTES: u64 = 16 << 20;

/// Which way bytes went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// To the device.
    Sent,
    /// From the device.
    Received,
    /// To the device, by a stop.
    Stop,
}

/// An open log.
#[derive(Debug)]
pub struct ByteLog {
    path: PathBuf,
    /// Not buffered: a killed session is the one whose log is wanted.
    file: File,
    written: u64,
    rotate_at: u64,
    begun: Option<Timestamp>,
}

impl ByteLog {
    /// Begins a log at `path`; an older file of that name is kept as `<path>.1`.
    pub fn create(path: &Path) -> io::Result<ByteLog> {
        Self::with_limit(path, ROTATE_BYTES)
    }

    fn with_limit(path: &Path, rotate_at: u64) -> io::Result<ByteLog> {
        if path.exists() {
            std::fs::rename(path, older(path))?;
        }
        let file = File::create(path)?;
        Ok(ByteLog { path: path.to_owned(), file, written: 0, rotate_at, begun: None })
    }

    /// Writes down bytes.
    pub fn bytes(&mut self, at: Timestamp, direction: Direction, bytes: &[u8]) -> io::Result<()> {
        let sign = match direction {
            Direction::Sent => '>',
            Direction::Received => '<',
            Direction::Stop => '!',
        };
        self.record(at, sign, &escape(bytes))
    }

    /// Writes down something to know.
    pub fn remark(&mut self, at: Timestamp, text: &str) -> io::Result<()> {
        self.record(at, '#', &escape(text.as_bytes()))
    }

    fn record(&mut self, at: Timestamp, sign: char, text: &str) -> io::Result<()> {
        let begun = *self.begun.get_or_insert(at);
        let line = format!("{:12.6} {sign} {text}\n", at.seconds_since(begun));
        self.file.write_all(line.as_bytes())?;
        self.written += line.len() as u64;
        if self.written >= self.rotate_at {
            std::fs::rename(&self.path, older(&self.path))?;
            self.file = File::create(&self.path)?;
            self.written = 0;
        }
        Ok(())
    }
}

fn older(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".1");
    PathBuf::from(name)
}

fn escape(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len() + 8);
    for b in bytes {
        match b {
            b'\\' => out.push_str("\\\\"),
            b'\n' => out.push_str("\\n"),
            b'\r' => out.push_str("\\r"),
            0x20..=0x7e => out.push(*b as char),
            _ => out.push_str(&format!("\\x{b:02x}")),
        }
    }
    out
}

/// One record of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Seconds since the log began.
    pub seconds: f64,
    /// `>`, `<`, `!` or `#`.
    pub sign: char,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Reads a line of a log; `None` when it is not one.
pub fn read_record(line: &str) -> Option<Record> {
    let mut parts = line.trim_start().splitn(3, ' ');
    let seconds = parts.next()?.parse().ok()?;
    let sign = parts.next()?.chars().next().filter(|c| "><!#".contains(*c))?;
    Some(Record { seconds, sign, bytes: unescape(parts.next().unwrap_or(""))? })
}

fn unescape(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let mut chars = text.bytes();
    while let Some(b) = chars.next() {
        if b != b'\\' {
            out.push(b);
            continue;
        }
        out.push(match chars.next()? {
            b'n' => b'\n',
            b'r' => b'\r',
            b'\\' => b'\\',
            b'x' => {
                let digits = [chars.next()?, chars.next()?];
                u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?
            }
            _ => return None,
        });
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_byte_comes_back(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            let line = format!("{:12.6} < {}", 1.5, escape(&bytes));
            prop_assert_eq!(read_record(&line).unwrap().bytes, bytes);
        }
    }

    #[test]
    fn a_full_log_is_rotated_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port.log");
        let mut log = ByteLog::with_limit(&path, 200).unwrap();
        for i in 0..20 {
            log.bytes(Timestamp(i * 1_000_000), Direction::Sent, b"$J=G90 X1\n").unwrap();
        }
        let names = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names, 2);
        assert!(std::fs::metadata(&path).unwrap().len() <= 240);
    }
}
