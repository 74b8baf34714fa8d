//! Shared parts of event lines: nodes, frames, data, times.

use super::tone::LineTone;
use crate::ascii::{push_blanks, push_code, push_decimal, push_enclosed, push_spaced_hex};
use crate::escape::push_escaped;
use crate::event::FrameRange;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of data bytes in a line.
const SHOWN_BYTES: usize = 16;

/// KIND column, text and tone of an event of a node or of the bus.
pub(super) type LineContent = (&'static str, String, LineTone);

/// Columns of an event, except for PDO, SDO transfer and EMCY.
#[derive(Default)]
pub(super) struct EventWords {
    pub(super) who: String,
    pub(super) kind: &'static str,
    pub(super) what: String,
    pub(super) tone: LineTone,
}

/// `32/20 boom`, `SA80 boom2`.
pub(super) fn node_label(node: NodeId, bus: &Bus) -> String {
    text_of(|out| push_node(node, bus, out))
}

/// Appends `32/20 boom`, `SA80 boom2`.
pub(super) fn push_node(node: NodeId, bus: &Bus, out: &mut Vec<u8>) {
    if let NodeId::Canopen(id) = node {
        push_decimal(out, u64::from(id));
        out.push(b'/');
    } else {
        out.extend_from_slice(b"SA");
    }
    push_code(out, u32::from(node.number()), 2);
    push_node_name(node, bus, out);
}

/// `32 boom`, `SA80 boom2`.
pub(super) fn node_short(node: NodeId, bus: &Bus) -> String {
    text_of(|out| push_node_short(node, bus, out))
}

/// Appends `32 boom`, `SA80 boom2`.
pub(super) fn push_node_short(node: NodeId, bus: &Bus, out: &mut Vec<u8>) {
    match node {
        NodeId::Canopen(id) => push_decimal(out, u64::from(id)),
        NodeId::J1939(address) => {
            out.extend_from_slice(b"SA");
            push_code(out, u32::from(address), 2);
        }
    }
    push_node_name(node, bus, out);
}

/// Appends the name of a node after a space, if it has one.
fn push_node_name(node: NodeId, bus: &Bus, out: &mut Vec<u8>) {
    if let Some(name) = bus.node(node).and_then(|node| node.name()) {
        out.push(b' ');
        out.extend_from_slice(name.as_bytes());
    }
}

/// Appends `1018:01`.
pub(super) fn push_object(object: ObjectAddress, out: &mut Vec<u8>) {
    push_code(out, u32::from(object.index), 4);
    out.push(b':');
    push_code(out, u32::from(object.sub), 2);
}

/// Text that a function appends.
pub(super) fn text_of(push: impl FnOnce(&mut Vec<u8>)) -> String {
    let mut out = Vec::new();
    push(&mut out);
    String::from_utf8(out).unwrap_or_default()
}

/// Appends ` {118}`, ` {118-121}` and the line end.
#[inline]
pub(super) fn push_frames(FrameRange { first, last }: FrameRange, out: &mut Vec<u8>) {
    if first == last && last != 0 {
        push_enclosed(out, *b" {", last, *b"}\n");
    } else {
        push_frame_range(first, last, out);
    }
}

fn push_frame_range(first: u64, last: u64, out: &mut Vec<u8>) {
    if last != 0 {
        out.extend_from_slice(b" {");
        push_decimal(out, first);
        out.push(b'-');
        push_decimal(out, last);
        out.push(b'}');
    }
    out.push(b'\n');
}

pub(super) fn format_bytes(data: &[u8]) -> String {
    text_of(|out| push_bytes(out, data))
}

/// Appends the first bytes of data as hex.
pub(super) fn push_bytes(out: &mut Vec<u8>, data: &[u8]) {
    let shown = data.get(..SHOWN_BYTES).unwrap_or(data);
    if let Some((first, rest)) = shown.split_first() {
        push_code(out, u32::from(*first), 2);
        push_spaced_hex(out, rest);
    }
    if shown.len() < data.len() {
        out.extend_from_slice(" …".as_bytes());
    }
}

pub(super) fn format_millis(nanoseconds: i64) -> String {
    text_of(|out| push_millis(nanoseconds, out))
}

/// Appends a time in milliseconds with one decimal.
pub(super) fn push_millis(nanoseconds: i64, out: &mut Vec<u8>) {
    let tenths = nanoseconds.unsigned_abs() / 100_000;
    push_decimal(out, tenths / 10);
    out.push(b'.');
    push_decimal(out, tenths % 10);
}

/// Appends the columns between the time and the text of an event, with control characters escaped.
pub(super) fn push_columns(bus: &Bus, who: &[u8], kind: &str, color: &str, line: &mut Vec<u8>) {
    line.extend_from_slice(b"  ");
    let mut width = 0;
    if bus.index().0 != 0 {
        push_escaped(line, bus.name().as_bytes());
        line.push(b' ');
        width = character_count(bus.name().as_bytes()) + 1;
    }
    push_escaped(line, who);
    push_blanks(line, 16, width + character_count(who));
    line.extend_from_slice(b"  ");
    line.extend_from_slice(color.as_bytes());
    line.extend_from_slice(kind.as_bytes());
    push_blanks(line, 6, kind.len());
    line.push(b' ');
}

/// Number of characters in UTF-8 text.
pub(super) fn character_count(text: &[u8]) -> usize {
    text.iter().filter(|byte| **byte & 0xC0 != 0x80).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_end_the_line() {
        let frames = |first, last| text_of(|out| push_frames(FrameRange { first, last }, out));
        assert_eq!([frames(0, 0), frames(118, 118), frames(118, 121)], ["\n", " {118}\n", " {118-121}\n"]);
    }

    #[test]
    fn milliseconds_have_one_decimal() {
        assert_eq!(
            [format_millis(0), format_millis(1_049_999), format_millis(-312_950_000)],
            ["0.0", "1.0", "312.9"]
        );
    }
}
