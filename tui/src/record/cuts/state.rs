//! State of the buses at the start of a capture.
//!
//! ```text
//! evicted ──▶ decoder ─┬─ ring: first item │ … │ first frame of the capture │ …
//!                      └─ clone ──────────────▶ bus file
//! ```
//! A decoder follows the oldest item of the ring, so that its memory does not depend on the duration. Another one follows
//! the oldest item in the files of a ring on disk.

use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Buses, NoObserver, SessionOptions};

use super::super::disk::RecordDisk;
use super::super::item::{PendingItem, RecordItem};

/// Suffix of a bus file.
const SUFFIX: &str = "toml";

/// Text of a bus file with the state of the buses, for this path and with this title.
pub type StateText = Box<dyn Fn(Buses<'_>, &Path, &str) -> anyhow::Result<String> + Send>;

/// State of the buses at a place in the ring.
#[derive(Clone)]
pub(super) struct BusState {
    decoder: Decoder,
    names: BusNames,
}

/// State before the oldest item in memory, and before the oldest one in files.
pub(in super::super) struct StateFollower {
    pub(super) in_memory: BusState,
    pub(super) in_files: BusState,
    text: StateText,
}

impl StateFollower {
    /// A follower before the first item.
    pub(in super::super) fn new(session: SessionOptions, text: StateText) -> Self {
        let state = BusState { decoder: Decoder::new(session), names: BusNames::default() };
        Self { in_memory: state.clone(), in_files: state, text }
    }

    /// Text of the bus file `path` with this state.
    ///
    /// # Errors
    /// If the text cannot be written.
    pub(super) fn bus_file_text(&self, state: &BusState, path: &Path) -> anyhow::Result<String> {
        let capture = path.with_extension("pcapng");
        let capture = capture.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (self.text)(state.decoder.buses(), path, &format!("State before the first frame of {capture}"))
    }
}

impl BusState {
    /// Decodes an item, whose bus may have another index here; `buses` contains the names of the buses.
    pub(super) fn push(&mut self, item: &PendingItem, buses: &[String]) {
        let Self { decoder, names } = self;
        let name = buses.get(item.bus).map_or("", String::as_str);
        let Some(bus) = names.index_of(name.as_bytes()) else { return };
        match &item.what {
            RecordItem::Frame(frame) => decoder.push(&Frame { bus, ..*frame }, names, &mut NoObserver),
            RecordItem::Notice(notice) => {
                let mut notice = notice.clone();
                if let Notice::LostFrames { bus: own, .. }
                | Notice::Link { bus: own, .. }
                | Notice::ClockSet { bus: own, .. } = &mut notice
                {
                    *own = bus;
                }
                decoder.on_notice(&notice, names, &mut NoObserver);
            }
            RecordItem::Commented(_) | RecordItem::Trigger(_) => (),
        }
    }
}

/// Path of the bus file of a capture.
pub(super) fn path_of(capture: &Path) -> PathBuf {
    capture.with_extension(SUFFIX)
}

/// Writes the bus file; replaces one of the same capture.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_bus_file(mut disk: Box<dyn RecordDisk>, path: &Path, text: &str) -> io::Result<()> {
    let new = path.with_extension(format!("new.{SUFFIX}"));
    match disk.remove_file(&new) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => (),
    }
    let mut file = disk.create_file(&new)?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.sync_to_disk());
    drop(file);
    let renamed = written.and_then(|()| disk.rename_file(&new, path));
    if renamed.is_err() {
        // The error is reported; a remaining part of the file does not matter.
        let _ = disk.remove_file(&new);
    }
    renamed
}
