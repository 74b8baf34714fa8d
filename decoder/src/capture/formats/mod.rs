//! The formats of captures: a file or folder each, and which there are.

mod asc;
mod blf;
mod busmaster;
mod candump;
mod canking;
mod carbus;
mod crtd;
mod csv;
pub(super) mod mcap;
mod mdf4;
mod microchip;
mod pcap;
mod pcapng;
mod roadster;
mod trc;

use super::{Format, WritableFormat};

/// All formats, binary before text, strict before lenient: the first that recognises a capture reads it.
pub const FORMATS: &[Format] = &[
    mcap::FORMAT,
    pcapng::FORMAT,
    pcap::FORMAT,
    blf::FORMAT,
    mdf4::FORMAT,
    trc::FORMAT,
    asc::FORMAT,
    busmaster::FORMAT,
    carbus::FORMAT,
    microchip::FORMAT,
    canking::FORMAT,
    crtd::FORMAT,
    roadster::FORMAT,
    csv::FORMAT,
    candump::FORMAT,
];

/// All formats that can be written.
pub const WRITABLE: &[WritableFormat] = &[
    candump::WRITABLE,
    pcapng::WRITABLE,
    asc::WRITABLE,
    trc::WRITABLE,
    csv::WRITABLE,
    #[cfg(feature = "mcap")]
    mcap::WRITABLE,
];

/// The format that recognises these first bytes; `is_whole` where no more follow. Of text only whole lines tell: the
/// beginning of a line may look like that of another format.
pub fn detect(head: &[u8], is_whole: bool) -> Option<&'static Format> {
    let end = head.iter().rposition(|byte| matches!(byte, b'\n' | b'\r')).map_or(0, |end| end + 1);
    let lines = if is_whole { head } else { head.get(..end).unwrap_or_default() };
    FORMATS.iter().find(|format| (format.detect)(if format.is_text { lines } else { head }))
}
