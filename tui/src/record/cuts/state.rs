//! State of the buses at the start of a capture.
//!
//! ```text
//! evicted ──▶ decoder ─┬─ ring: first item │ … │ first frame of the capture │ …
//!                      └─ clone ──────────────▶ bus file
//! ```
//! The decoder follows the oldest item of the ring, so that its memory does not depend on the duration.

use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, Buses, Observer, Preview, SessionOptions};

use super::super::disk::Disk;
use super::super::item::RecordItem;
use super::ring::RingItem;

/// Suffix of a bus file.
const SUFFIX: &str = "toml";

/// Text of a bus file with the state of the buses, for this path and with this title.
pub type StateText = Box<dyn Fn(Buses<'_>, &Path, &str) -> anyhow::Result<String> + Send>;

/// Decoder of the frames before the ring.
pub(in super::super) struct StateFollower {
    decoder: Decoder,
    names: BusNames,
    text: StateText,
}

/// Receiver of events that needs none.
struct NoEvents;

impl Observer for NoEvents {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn needs(&self, _preview: &Preview, _bus: &Bus) -> bool {
        false
    }

    fn skip(&mut self, _preview: &Preview, _bus: &Bus) -> bool {
        true
    }
}

impl StateFollower {
    /// A follower before the first item.
    pub(in super::super) fn new(session: SessionOptions, text: StateText) -> Self {
        Self { decoder: Decoder::new(session), names: BusNames::default(), text }
    }

    /// Decodes items that leave the ring; `buses` contains the names of their buses.
    pub(super) fn follow(&mut self, items: &[RingItem], buses: &[String]) {
        for one in items {
            push(&mut self.decoder, &mut self.names, one, buses);
        }
    }

    /// Text of the bus file `path` with the state after `items`, which are the first items of the ring.
    ///
    /// # Errors
    /// If the text cannot be written.
    pub(super) fn text<'a>(
        &self,
        items: impl Iterator<Item = &'a RingItem>,
        buses: &[String],
        path: &Path,
    ) -> anyhow::Result<String> {
        let (mut decoder, mut names) = (self.decoder.clone(), self.names.clone());
        items.for_each(|one| push(&mut decoder, &mut names, one, buses));
        let capture = path.with_extension("pcapng");
        let capture = capture.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (self.text)(decoder.buses(), path, &format!("State before the first frame of {capture}"))
    }
}

/// Decodes an item; its bus may have another index here.
fn push(decoder: &mut Decoder, names: &mut BusNames, one: &RingItem, buses: &[String]) {
    let name = buses.get(one.item.bus).map_or("", String::as_str);
    let Some(bus) = names.index_of(name.as_bytes()) else { return };
    match &one.item.what {
        RecordItem::Frame(frame) => decoder.push(&Frame { bus, ..*frame }, names, &mut NoEvents),
        RecordItem::Notice(notice) => {
            let mut notice = notice.clone();
            if let Notice::LostFrames { bus: own, .. }
            | Notice::Link { bus: own, .. }
            | Notice::ClockSet { bus: own, .. } = &mut notice
            {
                *own = bus;
            }
            decoder.notice(&notice, names, &mut NoEvents);
        }
        RecordItem::Commented(_) | RecordItem::Trigger(_) => (),
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
pub(super) fn write(mut disk: Box<dyn Disk>, path: &Path, text: &str) -> io::Result<()> {
    let new = path.with_extension(format!("new.{SUFFIX}"));
    match disk.remove(&new) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        _ => (),
    }
    let mut file = disk.create(&new)?;
    let written = file.write_all(text.as_bytes()).and_then(|()| file.sync());
    drop(file);
    let renamed = written.and_then(|()| disk.rename(&new, path));
    if renamed.is_err() {
        // The error is reported; a remaining part of the file does not matter.
        let _ = disk.remove(&new);
    }
    renamed
}
