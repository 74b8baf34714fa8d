//! Decodes the frames of a sample.

use std::fmt::Write as _;
use std::sync::Arc;

use crate::bus_file::{BusFile, BusSettings, InitialValue, ObjectValue};
use crate::capture::{Batch, BatchItem, CaptureReader, Notice, ReadOptions};
use crate::decoder::Decoder;
use crate::event::{Event, EventKind};
use crate::profile::DeviceProfile;
use crate::profile::device::ProfileSample;
use crate::profile::object::DefaultValue;
use crate::session::{AssignedBy, Assignment, Bus, ProtocolChoice, SessionOptions};
use crate::wire::NodeId;

const BUS: &str = "can0";

/// Interval between two frames, in ms.
const STEP: usize = 10;

/// Result of decoding the frames of a sample.
pub(super) struct SampleOutcomes {
    /// Events of the node caused by the last frame.
    pub(super) events: Vec<EventKind>,
    /// Decoder in its state after the last frame.
    pub(super) decoder: Decoder,
}

impl SampleOutcomes {
    /// Decodes all frames of the sample.
    pub(super) fn decode_sample(sample: &ProfileSample, device: &Arc<DeviceProfile>) -> Result<Self, String> {
        let mut capture = String::new();
        for (number, frame) in sample.frames.iter().enumerate() {
            let time = number.saturating_mul(STEP);
            let (seconds, thousandths) = (time / 1000, time % 1000);
            let _ = writeln!(capture, "({}.{thousandths:03}000) {BUS} {frame}", 1_000_000_000 + seconds);
        }
        let unreadable = || "invalid frame; expected a form such as 182#08A0, 701#R or 702#".to_owned();
        let mut reader =
            CaptureReader::open(capture.as_bytes(), &ReadOptions::default()).map_err(|_| unreadable())?;
        let mut outcomes =
            Self { events: Vec::new(), decoder: Decoder::new(sample_options(sample, device)?) };
        let mut batch = Batch::new();
        while reader.read(&mut batch).map_err(|_| unreadable())? {
            for item in batch.items() {
                match item {
                    BatchItem::Frame(frame) => {
                        outcomes.events.clear();
                        let events = &mut outcomes.events;
                        let mut keep = |event: &Event, _: &Bus| {
                            if event.node == Some(sample.node) || is_for_all(&event.kind) {
                                events.push(event.kind.clone());
                            }
                        };
                        outcomes.decoder.push(frame, reader.buses(), &mut keep);
                    }
                    BatchItem::Notice(Notice::Unreadable { place, reason }) => {
                        return Err(format!("frames: {place}: {reason}"));
                    }
                    BatchItem::Notice(_) => {}
                }
            }
        }
        Ok(outcomes)
    }

    pub(super) fn find_event<'a, T>(&'a self, pick: impl Fn(&'a EventKind) -> Option<T>) -> Option<T> {
        self.events.iter().find_map(pick)
    }

    /// Names of the events of the last frame, for error messages.
    pub(super) fn kind_names(&self) -> String {
        let names: Vec<_> = self.events.iter().map(EventKind::name).collect();
        if names.is_empty() { "nothing".into() } else { names.join(", ") }
    }
}

/// Whether the event also counts for the device if another node sent it: messages to a device.
fn is_for_all(kind: &EventKind) -> bool {
    matches!(kind, EventKind::J1939Message(_))
}

/// Options that assign the device to the node and set the values under `given`.
fn sample_options(sample: &ProfileSample, device: &Arc<DeviceProfile>) -> Result<SessionOptions, String> {
    let mut settings = BusSettings::default();
    for (object, value) in &sample.given {
        let address = object.parse().map_err(|error| format!("given: {object}: {error}"))?;
        let value = match value {
            DefaultValue::Number(number) => ObjectValue::Number(*number),
            DefaultValue::Text(text) => ObjectValue::Bytes(text.clone().into_bytes()),
            DefaultValue::Real(_) => {
                return Err(format!("given: {object}: value has decimals; expected the raw integer"));
            }
        };
        settings.objects.push(InitialValue::new(sample.node, address, value));
    }
    // A mapping takes effect when sub-index 0 is written (CiA 301 §7.5.2.36), so sub-index 0 is set last.
    settings.objects.sort_by_key(|object| object.address.sub == 0);
    for (name, entries) in &sample.areas {
        let entries = entries.iter().map(|entry| entry.parse().map_err(|error| format!("{name}: {error}")));
        settings.areas.push((sample.node, name.clone(), entries.collect::<Result<_, String>>()?));
    }
    Ok(SessionOptions {
        protocol: match sample.node {
            NodeId::Canopen(_) => ProtocolChoice::Canopen,
            NodeId::J1939(_) => ProtocolChoice::J1939,
        },
        bus_file: BusFile { everywhere: settings, ..BusFile::default() },
        assignments: vec![Assignment {
            bus: None,
            node: sample.node,
            device: Arc::clone(device),
            by: AssignedBy::Option,
        }],
        ..SessionOptions::default()
    })
}
