//! Capture formats, one file or folder per format, and the lists of them.

mod asc;
mod blf;
mod busmaster;
mod can_msgs;
mod candump;
mod canking;
mod carbus;
mod crtd;
mod csv;
mod ctt;
mod elm327;
mod excerpt;
mod gvret;
pub(super) mod inferred;
mod isotpdump;
mod lawicel;
pub(super) mod mcap;
mod mdf4;
mod microchip;
mod nmea2000;
mod pcap;
mod pcapng;
mod roadster;
mod trc;
mod tshark;

use super::foreign::foreign_file;
use super::text::line_format::complete_lines;
use super::{CaptureFormat, WritableFormat};

/// All formats, binary before text, strict before lenient: the first format that matches reads the capture.
pub const FORMATS: &[CaptureFormat] = &[
    mcap::FORMAT,
    pcapng::FORMAT,
    pcap::FORMAT,
    blf::FORMAT,
    mdf4::FORMAT,
    gvret::FORMAT,
    trc::FORMAT,
    asc::FORMAT,
    busmaster::FORMAT,
    carbus::FORMAT,
    microchip::FORMAT,
    canking::FORMAT,
    crtd::FORMAT,
    roadster::FORMAT,
    csv::FORMAT,
    nmea2000::ACTISENSE,
    nmea2000::CANBOAT,
    nmea2000::CANBOAT_JSON,
    lawicel::FORMAT,
    elm327::FORMAT,
    can_msgs::FORMAT,
    isotpdump::FORMAT,
    tshark::FORMAT,
    ctt::FORMAT,
    candump::FORMAT,
    inferred::messages::FORMAT,
    excerpt::FORMAT,
    inferred::FORMAT,
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

/// The format that matches these first bytes. `is_whole` means that no data follows. In text only complete
/// lines are checked: the start of a line may match another format.
///
/// A log of messages, an excerpt and text with inferred columns have no sign of their own, so they are accepted only after all of their first
/// bytes are known: the same bytes decide for any size of the pieces in which a capture arrives.
pub fn detect_format(head: &[u8], is_whole: bool) -> Option<&'static CaptureFormat> {
    let lines = if is_whole { head } else { complete_lines(head) };
    let found = FORMATS
        .iter()
        .find(|format| !is_last_resort(format) && (format.detect)(if format.is_text { lines } else { head }));
    found.or_else(|| {
        let window = excerpt::decisive_lines(head, is_whole).filter(|window| !window.is_empty())?;
        // Tables of numbers occur in databases and device files, too.
        let is_foreign = foreign_file(window, None).is_some();
        let matching = |format: &&CaptureFormat| is_last_resort(format) && (format.detect)(window);
        FORMATS.iter().find(matching).filter(|format| format.name != inferred::FORMAT.name || !is_foreign)
    })
}

/// The format for columns that the user states: a binary format that matches the first bytes, otherwise text.
pub(super) fn stated_format(head: &[u8]) -> Option<&'static CaptureFormat> {
    let binary = FORMATS.iter().find(|format| !format.is_text && (format.detect)(head));
    binary.or_else(|| FORMATS.iter().find(|format| format.name == inferred::FORMAT.name && !head.is_empty()))
}

/// Whether a format has no sign of its own.
fn is_last_resort(format: &CaptureFormat) -> bool {
    [inferred::messages::FORMAT.name, excerpt::FORMAT.name, inferred::FORMAT.name].contains(&format.name)
}
