//! Structure of a capture: its start, and its groups of frames.

use std::sync::Arc;

use super::block::{MdfBlock, TITLE};
use super::group::{ChannelGroup, DataGroup, FrameGroup, GroupReader, RecordSize};
use super::records::{KnownGroup, LastVariableValue, RecordReader, VariableValues};
use super::source::{GroupSource, GroupSourceArguments};
use super::stream::{Damage, DataSegment, DataStream, collect_segments};
use crate::capture::CaptureError;
use crate::capture::byte_order::ByteOrder::Little;

/// Size of the identification before the header, in bytes.
const IDENTIFICATION: u64 = 64;
const VERSION: usize = 28;
const FLAGS: usize = 60;
/// First supported version.
const FIRST_VERSION: u16 = 400;

/// Identification of an unfinished capture, whose flags state the missing steps.
pub(super) const UNFINISHED: &[u8] = b"UnFinMF ";
const RECORDS_NOT_COUNTED: u16 = 1;
const LENGTH_NOT_SET: u16 = 4;

const LOCAL_TIME: u8 = 1;

/// Maximum number of groups of frames.
const MOST_SOURCES: usize = 1_024;

/// Maximum number of names of other groups in a notice.
const SHOWN_NAMES: usize = 5;

/// Content of a capture.
#[derive(Default)]
pub(super) struct Mdf4Capture {
    /// Start in nanoseconds since 1970.
    pub(super) start: i64,
    /// Whether the start is in an unknown time zone.
    pub(super) is_local: bool,
    pub(super) sources: Vec<GroupSource>,
    pub(super) damages: Vec<Damage>,
    /// Number of records in groups without frames, as far as known before reading, and the names of these
    /// groups.
    pub(super) others: u64,
    pub(super) names: Vec<Vec<u8>>,
}

/// A data group and the location of its data.
struct LocatedDataGroup {
    group: DataGroup,
    segments: Vec<DataSegment>,
    /// Blocks of variable-length values, per group.
    values: Vec<Vec<DataSegment>>,
}

impl Mdf4Capture {
    /// Reads the description of the capture.
    ///
    /// # Errors
    /// If the header is missing or the version is too old.
    pub(super) fn open(file: &[u8]) -> Result<Self, CaptureError> {
        let version = Little.u16(file, VERSION).unwrap_or(0);
        if version < FIRST_VERSION {
            return Err(CaptureError::Header {
                format: TITLE,
                offset: VERSION as u64,
                found: format!("version {version}"),
                expected: "400 or later: convert the capture to MDF 4",
            });
        }
        let Some(header) = MdfBlock::parse_kind_at(file, IDENTIFICATION, *b"HD") else {
            return Err(CaptureError::Header {
                format: TITLE,
                offset: IDENTIFICATION,
                found: "no header".into(),
                expected: "an HD block",
            });
        };
        let unfinished = if file.starts_with(UNFINISHED) { Little.u16(file, FLAGS).unwrap_or(0) } else { 0 };
        let mut recording = Self {
            start: header.u64(0).and_then(|start| i64::try_from(start).ok()).unwrap_or(0),
            is_local: header.u8(12).is_some_and(|flags| flags & LOCAL_TIME != 0),
            ..Self::default()
        };
        let mut reading = GroupReader::default();
        let groups = reading.data_groups(file, header.link_target(0));
        recording.damages.append(&mut reading.damages);
        let mut shared: Vec<LocatedDataGroup> =
            groups.into_iter().map(|group| recording.locate_data(file, group)).collect();
        if unfinished & LENGTH_NOT_SET != 0 {
            extend_last(file, &mut shared, reading.seen.last().copied().unwrap_or(0));
        }
        for shared in shared {
            recording.add_sources(shared, unfinished & RECORDS_NOT_COUNTED == 0);
        }
        Ok(recording)
    }

    /// Finds the data blocks of a group.
    fn locate_data(&mut self, file: &[u8], group: DataGroup) -> LocatedDataGroup {
        let holds_frames = group.groups.iter().any(|group| group.frames.is_some());
        let data = group.data.filter(|_| holds_frames);
        let segments = collect_segments(file, data, &mut self.damages);
        let values = |group: &ChannelGroup| {
            let link = group.frames.as_ref().and_then(|frames| frames.values)?;
            // A link to another group is not a link to data blocks.
            MdfBlock::parse_kind_at(file, link, *b"CG")
                .is_none()
                .then(|| collect_segments(file, Some(link), &mut self.damages))
        };
        let values = group.groups.iter().map(values).map(Option::unwrap_or_default).collect();
        LocatedDataGroup { group, segments, values }
    }

    /// Creates sources for the groups of frames.
    fn add_sources(&mut self, shared: LocatedDataGroup, is_counted: bool) {
        let LocatedDataGroup { group: data, segments, values } = shared;
        let segments: Arc<[DataSegment]> = segments.into();
        if data.number_size == 0 && data.groups.len() > 1 {
            self.damages.push((
                data.at,
                "several channel groups without record numbers: only the first is read".into(),
            ));
        }
        let count = if data.number_size == 0 { 1 } else { data.groups.len() };
        let mut known: Vec<KnownGroup> = data.groups.iter().take(count).map(known_group).collect();
        known.sort_unstable_by_key(|known| known.number);
        let known: Arc<[KnownGroup]> = known.into();
        let records = |wanted| {
            RecordReader::new(DataStream::new(segments.clone()), data.number_size, known.clone(), wanted)
        };
        let holds_frames = data.groups.iter().any(|group| group.frames.is_some());
        let mut is_first = true;
        for (group, own) in data.groups.iter().zip(values).take(count) {
            let Some(frames) = group.frames else {
                self.add_other_group(group, holds_frames);
                continue;
            };
            if self.sources.len() >= MOST_SOURCES {
                self.damages.push((group.at, format!("more than {MOST_SOURCES} groups of frames")));
                return;
            }
            self.sources.push(GroupSource::new(GroupSourceArguments {
                frames,
                records: records(group.number),
                values: values_of(&frames, &data.groups, own, records),
                size: group.size,
                expected: Some(group.records).filter(|_| is_counted),
                at: group.at,
                is_first: std::mem::replace(&mut is_first, false),
            }));
        }
    }

    /// Handles a group without frames. If frames share its data, its records are counted while reading.
    fn add_other_group(&mut self, group: &ChannelGroup, is_counted_later: bool) {
        if group.size == RecordSize::Variable {
            return;
        }
        if !is_counted_later {
            self.others = self.others.saturating_add(group.records);
        }
        if self.names.len() < SHOWN_NAMES && !group.name.is_empty() && !self.names.contains(&group.name) {
            self.names.push(group.name.clone());
        }
    }
}

fn known_group(group: &ChannelGroup) -> KnownGroup {
    let is_other = group.frames.is_none() && group.size != RecordSize::Variable;
    KnownGroup { number: group.number, size: group.size, is_other }
}

/// Location of the variable-length values of a group: in blocks, or in another group.
fn values_of(
    frames: &FrameGroup,
    groups: &[ChannelGroup],
    blocks: Vec<DataSegment>,
    records: impl Fn(u64) -> RecordReader,
) -> VariableValues {
    let Some(link) = frames.values else { return VariableValues::None };
    match groups.iter().find(|group| group.at == link && group.size == RecordSize::Variable) {
        Some(group) => VariableValues::Records(records(group.number), 0, LastVariableValue::default()),
        None => VariableValues::Blocks(DataStream::new(blocks.into()), LastVariableValue::default()),
    }
}

/// Extends the last data block to the end of the capture, unless a description follows it.
fn extend_last(file: &[u8], shared: &mut [LocatedDataGroup], last_description: u64) {
    let all = shared
        .iter_mut()
        .flat_map(|shared| shared.segments.iter_mut().chain(shared.values.iter_mut().flatten()));
    let last = all.max_by_key(|segment| segment.at);
    if let Some(last) = last.filter(|last| last.at > last_description) {
        last.extend_to_end(file);
    }
}
