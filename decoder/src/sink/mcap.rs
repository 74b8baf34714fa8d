//! Events as MCAP, for Foxglove and PlotJuggler. Each group of values is a topic that can be plotted
//! directly.
//!
//! ```text
//! /can/can0            the frames                                     can_msgs/msg/Frame
//! /node/2/tpdo1        {"Actual_pressure":102.3, …}                   JSON, with a schema that has names and units
//! /node/2/objects      changes of the object store                    as in JSON Lines
//! /events  /findings   everything else                                as in JSON Lines
//! /log                 event lines as text                            foxglove.Log
//! ```

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Write};
use std::sync::Arc;

use serde_json::json;

use super::jsonl::object::JsonObjectWriter;
use super::text::{EventLine, LineTone};
use super::values::{self, ValueGroupKey};
use super::{EventContent, EventFormat, EventSink, escape, jsonl};
use crate::capture::{CaptureCompression, FrameWriter as _, McapWriter, Notice, WrittenTopic};
use crate::event::{Event, EventKind};
use crate::finding::Severity;
use crate::frame::Frame;
use crate::profile::{DataType, PayloadLayout};
use crate::query::record::{FieldValue, visit_event};
use crate::session::Bus;

/// Levels of `foxglove.Log`.
const INFO: u8 = 2;
const WARNING: u8 = 3;
const ERROR: u8 = 4;

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "mcap",
    suffix: "events.mcap",
    title: "events as MCAP",
    help: "Frames, values, events and event lines for Foxglove and PlotJuggler; requires -o",
    content: EventContent::Capture,
    is_binary: true,
    sink: |files, options| Ok(Box::new(McapSink::new(files.whole_file()?, options.packing))),
};

/// Writer for frames and events as MCAP. After the first write error nothing more is written; `finish`
/// returns the error.
struct McapSink<W: Write + Send> {
    file: McapWriter<W>,
    groups: Vec<ValueGroup>,
    /// Index in `groups` by group and schema. Layouts whose texts differ in length only share a topic.
    topics: HashMap<(ValueGroupKey, String), usize>,
    /// Index in `groups` of the last layout of each group.
    present: HashMap<ValueGroupKey, usize>,
    /// By topic.
    records: BTreeMap<String, WrittenTopic>,
    line: Vec<u8>,
    /// Profile ids of the known devices, by `bus:node`.
    devices: BTreeMap<String, String>,
    /// Source document of each profile, by profile id.
    profiles: BTreeMap<String, String>,
    error: Option<io::Error>,
}

/// A group of values.
struct ValueGroup {
    topic: WrittenTopic,
    layout: Arc<PayloadLayout>,
    /// Beginnings of the JSON members, `"key":`.
    keys: Vec<String>,
    /// Last label of each field.
    labels: Vec<values::LabelCache>,
}

impl<W: Write + Send> McapSink<W> {
    fn new(output: W, packing: CaptureCompression) -> Self {
        Self {
            file: McapWriter::new(output, packing),
            groups: Vec::new(),
            topics: HashMap::new(),
            present: HashMap::new(),
            records: BTreeMap::new(),
            line: Vec::with_capacity(1024),
            devices: BTreeMap::new(),
            profiles: BTreeMap::new(),
            error: None,
        }
    }

    fn write_in_order(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        match values::carried_values(event) {
            // The transfer is an event in addition to the values that it carries.
            Some(carried) if matches!(event.kind, EventKind::J1939Transfer(_)) => self
                .write_values(event, bus, &carried)
                .and_then(|()| self.write_record(event, bus))
                .and_then(|()| self.write_log(event, bus)),
            Some(carried) => self.write_values(event, bus, &carried),
            None if matches!(
                event.kind,
                EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_)
            ) =>
            {
                Ok(())
            }
            None => self.write_record(event, bus).and_then(|()| self.write_log(event, bus)),
        }
    }

    fn write_values(
        &mut self,
        event: &Event,
        bus: &Bus,
        carried: &values::EventValues<'_>,
    ) -> io::Result<()> {
        let present = self.present.get(&carried.group).copied();
        let known = present.and_then(|place| self.groups.get(place));
        let place = match (present, known) {
            (Some(place), Some(known)) if Arc::ptr_eq(&known.layout, carried.layout) => place,
            _ => {
                let place = self.add_value_topic(bus, carried)?;
                self.write_device(event, bus);
                place
            }
        };
        let Some(group) = self.groups.get_mut(place) else { return Ok(()) };
        self.line.clear();
        self.line.push(b'{');
        for (signal, (key, label)) in carried.zip_values(group.keys.iter().zip(&mut group.labels)) {
            let reading = values::signal_reading(&signal, label);
            // A missing member leaves a gap in a plot.
            let has_value = match reading.value {
                FieldValue::Null => false,
                FieldValue::Real(value) => value.is_finite(),
                _ => true,
            };
            if has_value {
                push_member(&mut self.line, key, "", reading.value);
            }
            if let Some(label) = reading.label {
                push_member(&mut self.line, key, "_label", FieldValue::Text(label));
            }
        }
        self.line.push(b'}');
        self.file.write_message(&mut group.topic, event.time, &self.line)
    }

    /// Creates a topic for a new group of values, or for a layout with other fields; index of its group.
    fn add_value_topic(&mut self, bus: &Bus, carried: &values::EventValues<'_>) -> io::Result<usize> {
        let name = values::group_name(carried.group, bus);
        let keys = values::unique_keys(carried.layout);
        let schema = json_schema(&name, carried.layout, &keys);
        let labels = keys.iter().map(|_| values::LabelCache::default()).collect();
        let layout = Arc::clone(carried.layout);
        let known = self.topics.get(&(carried.group, schema.clone())).copied();
        let place = if let Some(place) = known {
            if let Some(group) = self.groups.get_mut(place) {
                (group.layout, group.labels) = (layout, labels);
            }
            place
        } else {
            let topic = self.file.json_topic(&format!("/{name}"), &name.replace('/', "."), &schema)?;
            let place = self.groups.len();
            self.groups.push(ValueGroup { topic, layout, keys, labels });
            self.topics.insert((carried.group, schema), place);
            place
        };
        self.present.insert(carried.group, place);
        Ok(place)
    }

    fn write_device(&mut self, event: &Event, bus: &Bus) {
        let Some(node) = event.node.and_then(|id| bus.node(id)) else { return };
        if let (Some(id), Some(device)) = (event.node, node.device_id()) {
            self.devices.insert(format!("{}:{}", bus.name(), id.label()), device.to_owned());
            self.profiles.insert(device.to_owned(), node.device().source.clone());
        }
    }

    /// Writes the event in the form of JSON Lines.
    fn write_record(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        let topic = match (&event.kind, event.node) {
            (EventKind::FindingOpened(_) | EventKind::FindingClosed(_), _) => "/findings".to_owned(),
            (EventKind::ObjectChange(_), Some(node)) if event.bus.0 == 0 => {
                format!("/node/{}/objects", node.number())
            }
            (EventKind::ObjectChange(_), Some(node)) => {
                format!("/{}/node/{}/objects", bus.name(), node.number())
            }
            _ => "/events".to_owned(),
        };
        let mut known = match self.records.get(&topic) {
            Some(known) => *known,
            None => self.file.json_topic(&topic, "cobscope.Event", include_str!("event.schema.json"))?,
        };
        if matches!(event.kind, EventKind::NodeIdentified(_)) {
            self.write_device(event, bus);
        }
        self.line.clear();
        let mut object = JsonObjectWriter::begin_object(&mut self.line);
        visit_event(event, bus, None, &mut object);
        object.end_object();
        let written = self.file.write_message(&mut known, event.time, self.line.trim_ascii_end());
        self.records.insert(topic, known);
        written
    }

    fn write_log(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        if event.routine {
            return Ok(());
        }
        let line = EventLine::describe_event(event, bus);
        let level = match (&event.kind, line.tone) {
            (EventKind::FindingOpened(news), _) if news.severity == Severity::Error => ERROR,
            (EventKind::FindingOpened(news), _) if news.severity == Severity::Warning => WARNING,
            (_, LineTone::Bad) => ERROR,
            (_, LineTone::Caution) => WARNING,
            _ => INFO,
        };
        let what = format!("{} {}", line.kind, escape(&line.what));
        self.file.write_log(event.time, level, &escape(&line.who), &what)
    }

    fn keep_error(&mut self, written: io::Result<()>) {
        if let Err(error) = written {
            self.error.get_or_insert(error);
        }
    }
}

impl<W: Write + Send> EventSink for McapSink<W> {
    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none() {
            let written = self.write_in_order(event, bus);
            self.keep_error(written);
        }
        true
    }

    fn write_frame(&mut self, frame: &Frame, bus: &str) {
        if self.error.is_none() {
            let written = self.file.write(frame, bus);
            self.keep_error(written);
        }
    }

    fn write_notice(&mut self, notice: &Notice, bus: &str) {
        if self.error.is_none() {
            let written = self.file.notice(notice, bus).map(|_| ());
            self.keep_error(written);
        }
    }

    fn attach_file(&mut self, name: &str, media_type: &str, bytes: &[u8]) {
        let written = self.file.attach_file(name, media_type, bytes);
        self.keep_error(written);
    }

    fn write_metadata(&mut self, name: &str, values: BTreeMap<String, String>) {
        let written = self.file.write_metadata(name, values);
        self.keep_error(written);
    }

    /// Ends the current chunk, so that the file is readable up to here. An error is returned by `finish`.
    fn flush(&mut self) -> io::Result<()> {
        if self.error.is_none() {
            let written = self.file.flush();
            self.keep_error(written);
        }
        Ok(())
    }

    fn finish_output(&mut self) -> io::Result<()> {
        if self.error.is_none() && !self.devices.is_empty() {
            let devices = std::mem::take(&mut self.devices);
            self.write_metadata("cobscope.devices", devices);
            let profiles = std::mem::take(&mut self.profiles);
            self.write_metadata("cobscope.profiles", profiles);
        }
        match self.error.take() {
            Some(error) => Err(error),
            None => self.file.finish(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// Appends `"key":value`.
fn push_member(line: &mut Vec<u8>, key: &str, ending: &str, value: FieldValue<'_>) {
    if line.len() > 1 {
        line.push(b',');
    }
    line.push(b'"');
    line.extend_from_slice(key.as_bytes());
    line.extend_from_slice(ending.as_bytes());
    line.extend_from_slice(b"\":");
    jsonl::object::push(value, line);
}

/// JSON Schema for the messages of a group.
fn json_schema(name: &str, layout: &PayloadLayout, keys: &[String]) -> String {
    let mut properties = serde_json::Map::new();
    for (field, key) in layout.fields.iter().zip(keys) {
        let unit = values::field_unit(field);
        let id = field.id.to_string();
        let parts = [unit, id.as_str()];
        let description: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let title = values::field_name(field);
        let kind = if is_text(field.data_type) { "string" } else { "number" };
        properties.insert(
            key.clone(),
            json!({"type": kind, "title": title, "description": description.join("; ")}),
        );
        let has_labels = field.meaning.as_deref().is_some_and(|meaning| {
            let has_names = meaning.values.is_some() || meaning.special.is_some();
            has_names || meaning.indicators.is_some() || meaning.is_composed()
        });
        if has_labels {
            properties.insert(format!("{key}_label"), json!({"type": "string", "title": title}));
        }
    }
    json!({"title": name, "type": "object", "properties": properties}).to_string()
}

/// Whether values of a type are strings in JSON.
fn is_text(data_type: DataType) -> bool {
    matches!(
        data_type,
        DataType::VisibleString | DataType::OctetString | DataType::UnicodeString | DataType::Domain
    )
}
