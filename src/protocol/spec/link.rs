//! The lower half of a protocol file: port, framing, flow control.

use crate::protocol::checksum::ChecksumKind;
use crate::protocol::template::Template;
use crate::protocol::value::{Bytes, Fields, Pattern};
use serde::de::{Deserializer, Error as _};
use serde::{Deserialize, Serialize};

/// `[link]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Usual baud rate.
    pub baud: u32,
    /// Other rates the firmware is built with.
    #[serde(default)]
    pub baud_alternatives: Vec<u32>,
    /// Handshake lines.
    #[serde(default)]
    pub flow: PortFlow,
    /// What to do with DTR on opening.
    #[serde(default)]
    pub dtr: DtrPolicy,
    /// Time a board needs after opening (boot loaders).
    #[serde(default)]
    pub open_settle_ms: u64,
    /// Bytes that make the firmware introduce itself.
    pub wake: Option<Bytes>,
    /// Class of the banner that answers `wake`; waited for on connecting when `wake` is set.
    pub banner_timeout_ms: Option<u64>,
}

/// Handshake of the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PortFlow {
    /// None.
    #[default]
    None,
    /// XON/XOFF.
    Software,
    /// RTS/CTS.
    Hardware,
}

/// What to do with DTR on opening; many boards reset on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DtrPolicy {
    /// As the driver does.
    #[default]
    Leave,
    /// Hold it on.
    Assert,
    /// Hold it off.
    Deassert,
    /// Off, then on: a deliberate reset.
    Pulse,
}

/// `[line]`: framing of a line protocol.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineSpec {
    /// What ends a line we send.
    pub tx_eol: Bytes,
    /// What ends a line we receive; with `\n` a trailing CR is dropped.
    pub rx_eol: Bytes,
    /// Longest line that may be sent, without its end.
    pub max_line: Option<usize>,
    /// Put around every command's `tx`, e.g. `/{device} {axis} {id:02}{sp}{body}`; `{sp}` is a blank
    /// when the body is not empty.
    pub envelope: Option<Template>,
    /// Checksum of lines.
    pub checksum: Option<LineChecksum>,
    /// Line numbers.
    pub numbering: Option<Numbering>,
}

/// `[line.checksum]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineChecksum {
    /// How it is computed.
    pub kind: ChecksumKind,
    /// Sign between text and checksum.
    pub separator: char,
    /// Bytes at the beginning of a line that do not count.
    #[serde(default)]
    pub skip: usize,
    /// How the number is written.
    pub digits: ChecksumDigits,
    /// Which sent lines carry it.
    #[serde(default)]
    pub tx: ChecksumTx,
    /// What to do with received lines.
    #[serde(default)]
    pub rx: ChecksumRx,
}

/// How a checksum is written in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChecksumDigits {
    /// Decimal without padding.
    Decimal,
    /// Two upper-case hex digits.
    HexUpper,
}

/// Which sent lines carry a checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChecksumTx {
    /// Every line.
    #[default]
    Always,
    /// Lines with a number.
    Numbered,
}

/// What to do with checksums of received lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChecksumRx {
    /// Received lines have none.
    #[default]
    Ignore,
    /// Check it where there is one, drop the line when it is wrong.
    VerifyIfPresent,
}

/// `[line.numbering]`: numbered lines that the device can ask for again.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Numbering {
    /// A numbered line, from `{n}` and `{body}`.
    pub line: Template,
    /// Command that sets the counter to its field `n`; sent as line `n`.
    pub reset: String,
    /// Class that asks for a line again.
    pub resend: String,
    /// Its group that names the line.
    pub resend_field: String,
    /// Lines kept for sending again.
    pub history: usize,
}

/// `[frame]`: framing of a binary protocol.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameSpec {
    /// Bytes every frame begins with.
    #[serde(default)]
    pub sync: Bytes,
    /// Header fields after the sync bytes.
    pub header: Vec<FieldSpec>,
    /// Where the length of the payload is.
    pub length: LengthSpec,
    /// Order of bytes in numbers.
    #[serde(default)]
    pub endian: Endian,
    /// Checksum after the payload.
    pub checksum: Option<FrameChecksum>,
    /// Sequence that never occurs inside a frame.
    pub stuffing: Option<Stuffing>,
    /// A frame whose bytes pause longer than this was cut off.
    pub inter_byte_timeout_ms: u64,
    /// Longest payload that is believed.
    pub max_payload: usize,
}

/// `[frame.length]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LengthSpec {
    /// Header field that holds it.
    pub field: String,
    /// What the number counts beside the payload: payload = number - extra.
    #[serde(default)]
    pub extra: usize,
    /// A payload is present only when this header field has these bits; otherwise the length field
    /// is an argument like any other.
    pub only_when: Option<BitTest>,
}

/// A test of bits in a header field.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BitTest {
    /// The field.
    pub field: String,
    /// Any of these bits.
    pub mask: u64,
}

/// `[frame.checksum]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameChecksum {
    /// How it is computed.
    pub kind: ChecksumKind,
    /// Header field it begins with; from the first sync byte when absent.
    pub from: Option<String>,
}

/// `[frame.stuffing]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stuffing {
    /// After this sequence inside the frame ...
    pub after: Bytes,
    /// ... this byte is inserted.
    pub insert: u8,
    /// Stuffing begins with this header field.
    pub from: String,
}

/// Order of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Endian {
    /// Low byte first.
    #[default]
    Little,
    /// High byte first.
    Big,
}

/// One number in a frame: `name:type` or `name:type=default`.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldSpec {
    /// Name of the field.
    pub name: String,
    /// Its type.
    pub kind: FieldType,
    /// Value when the command gives none.
    pub default: Option<f64>,
}

/// Type of a number in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum FieldType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    F32,
}

impl FieldType {
    /// Bytes it takes.
    pub fn width(self) -> usize {
        match self {
            FieldType::U8 | FieldType::I8 => 1,
            FieldType::U16 | FieldType::I16 => 2,
            FieldType::U32 | FieldType::I32 | FieldType::F32 => 4,
            FieldType::U64 => 8,
        }
    }
}

impl FieldSpec {
    /// Reads `name:type` or `name:type=default`.
    pub fn parse(text: &str) -> Result<FieldSpec, String> {
        let wrong =
            || format!("\"{text}\" is not name:type or name:type=default (u8 i8 u16 i16 u32 i32 u64 f32)");
        let (name, rest) = text.split_once(':').ok_or_else(wrong)?;
        let (kind, default) = match rest.split_once('=') {
            Some((kind, default)) => (kind, Some(number(default).ok_or_else(wrong)?)),
            None => (rest, None),
        };
        let kind = match kind {
            "u8" => FieldType::U8,
            "i8" => FieldType::I8,
            "u16" => FieldType::U16,
            "i16" => FieldType::I16,
            "u32" => FieldType::U32,
            "i32" => FieldType::I32,
            "u64" => FieldType::U64,
            "f32" => FieldType::F32,
            _ => return Err(wrong()),
        };
        Ok(FieldSpec { name: name.to_owned(), kind, default })
    }
}

fn number(text: &str) -> Option<f64> {
    match text.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16).ok().map(|i| i as f64),
        None => text.parse().ok(),
    }
}

impl<'de> Deserialize<'de> for FieldSpec {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        FieldSpec::parse(&String::deserialize(d)?).map_err(D::Error::custom)
    }
}

/// `[flow]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlowSpec {
    /// How much may be in flight.
    #[serde(default)]
    pub mode: FlowMode,
    /// Bytes that may be unacknowledged, for `char_count`.
    pub window_bytes: Option<usize>,
    /// Real-time bytes that reset the device.
    pub reset: Option<String>,
    /// The banner's class: after a reset every reply is ignored until it comes.
    pub after_reset: Option<String>,
    /// A harmless command that `needs` data of its own: sent after a lost reply, so that a late reply
    /// cannot be taken for the next command's.
    pub resync: Option<String>,
    /// Message ids, for `id_matched`.
    pub id: Option<MessageId>,
}

/// How much may be in flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FlowMode {
    /// One command, then its reply.
    #[default]
    OneInFlight,
    /// As many bytes as the device's buffer holds.
    CharCount,
    /// Replies name the command they answer.
    IdMatched,
    /// The device queues commands and numbers them.
    QueueIndex,
}

/// `[flow.id]`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageId {
    /// The field, in templates and in replies.
    pub field: String,
    /// First id used.
    #[serde(default)]
    pub min: u32,
    /// Last id before it begins again.
    pub max: u32,
    /// The id of stops.
    pub urgent: u32,
}

/// `[axis]`: how an axis is named and how its numbers are written.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisSpec {
    /// What a rig file's `wire` must match; its named groups are fields of templates.
    pub wire: Pattern,
    /// Fields where a command concerns the device as a whole.
    #[serde(default)]
    pub device_fields: Fields,
    /// Order of axes in lists, by wire name.
    #[serde(default)]
    pub order: Vec<String>,
    /// Decimals of positions and feeds.
    #[serde(default = "default_decimals")]
    pub decimals: usize,
    /// One axis in `{axes}`; default `{letter}{pos}`.
    pub word: Option<Template>,
    /// The number sent as `{feed}` for one unit per second (60 where the device counts minutes), and as `{feed_whole}`,
    /// a whole number of at least 1.
    #[serde(default = "one")]
    pub feed_scale: f64,
    /// The number sent as `{feed_counts}` for one count per second.
    #[serde(default = "one")]
    pub feed_counts_scale: f64,
    /// The number sent as `{accel_counts}` for one count per second squared.
    #[serde(default = "one")]
    pub accel_counts_scale: f64,
    /// Whether the rig file must give `counts_per_unit`.
    #[serde(default)]
    pub counts: bool,
}

fn default_decimals() -> usize {
    4
}

fn one() -> f64 {
    1.0
}
