//! Frames from records with the field names of the ASAM bus logging standard.

use super::field::{GroupRecord, RecordField};
use super::group::{FrameGroup, GroupContent};
use super::records::VariableValues;
use crate::capture::bus_error::{Violation, violation_frame};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length, is_fd_length};

/// Error types, by their numbers.
const ERRORS: &[Violation] = &[
    Violation::Other,
    Violation::Bit,
    Violation::Form,
    Violation::Stuff,
    Violation::Checksum,
    Violation::Acknowledgement,
];

/// A frame, and its channel if the record states it.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChannelFrame {
    pub(super) frame: Frame,
    pub(super) channel: Option<u64>,
}

/// Converts a record to a frame.
///
/// # Errors
/// Description of the invalid part.
pub(super) fn convert_record(
    frames: &FrameGroup,
    file: &[u8],
    record: GroupRecord<'_>,
    values: &mut VariableValues,
) -> Result<ChannelFrame, &'static str> {
    let fields = &frames.fields;
    let channel = read_number(fields.channel, record);
    let flags = match read_number(fields.direction, record) {
        // Some writers store the direction as text.
        Some(1 | 0x54) => FrameFlags::TRANSMITTED,
        Some(0 | 0x52) => FrameFlags::RECEIVED,
        _ => FrameFlags::default(),
    };
    let is_sending = flags == FrameFlags::TRANSMITTED;
    let frame = match frames.kind {
        GroupContent::Data => read_data(frames, file, record, values)?,
        GroupContent::Remote => remote_frame(frames, record)?,
        GroupContent::Error => {
            let kind = read_number(fields.error, record).and_then(|kind| usize::try_from(kind).ok());
            let kind = kind.and_then(|kind| ERRORS.get(kind)).copied();
            violation_frame(kind.unwrap_or(Violation::Other), is_sending, 0, None)
        }
        GroupContent::Overload => violation_frame(Violation::Overload, is_sending, 0, None),
    };
    Ok(ChannelFrame { frame: Frame { flags: frame.flags.with(flags), ..frame }, channel })
}

fn read_number(field: Option<RecordField>, record: GroupRecord<'_>) -> Option<u64> {
    field?.number_of(record)
}

fn is_set(field: Option<RecordField>, record: GroupRecord<'_>) -> bool {
    read_number(field, record).is_some_and(|value| value != 0)
}

fn id(frames: &FrameGroup, record: GroupRecord<'_>) -> Result<CanId, &'static str> {
    let id = read_number(frames.fields.id, record).and_then(|id| u32::try_from(id).ok());
    let id = id.ok_or("identifier missing")?;
    // Without the field, the value of the identifier decides.
    let is_extended = match read_number(frames.fields.extended, record) {
        Some(value) => value != 0,
        None => id > 0x7FF,
    };
    match u16::try_from(id) {
        _ if is_extended => Ok(CanId::from_extended(id)),
        Ok(id @ 0..=0x7FF) => Ok(CanId::from_standard(id)),
        _ => Err("identifier: expected up to 7FF in a base frame"),
    }
}

fn read_data(
    frames: &FrameGroup,
    file: &[u8],
    record: GroupRecord<'_>,
    values: &mut VariableValues,
) -> Result<Frame, &'static str> {
    const MISSING: &str = "data of the frame missing";
    let fields = &frames.fields;
    let id = id(frames, record)?;
    let field = fields.data.ok_or(MISSING)?;
    let bytes = if field.is_variable() {
        values.get(file, field.number_of(record).ok_or(MISSING)?).ok_or(MISSING)?
    } else {
        field.field_bytes(record.bytes).ok_or(MISSING)?
    };
    let dlc = read_number(fields.dlc, record).and_then(|dlc| u8::try_from(dlc).ok()).filter(|dlc| *dlc <= 15);
    let is_fd = is_set(fields.is_fd, record);
    let by_dlc = dlc.map(|dlc| if is_fd { fd_length(dlc) } else { dlc.min(8) }).map(usize::from);
    let length = read_number(fields.length, record).and_then(|length| usize::try_from(length).ok());
    let length = length.or(by_dlc.filter(|_| !field.is_variable())).unwrap_or(bytes.len());
    let bytes = bytes.get(..length).ok_or(MISSING)?;
    if bytes.len() > if is_fd { MAX_DATA } else { 8 } {
        return Err("data: longer than the frame type allows");
    }
    if is_fd && !u8::try_from(length).is_ok_and(is_fd_length) {
        return Err("data: expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes");
    }
    let mut frame = Frame::data_frame(id, bytes);
    if is_fd {
        let add =
            |flags: FrameFlags, flag, field| if is_set(field, record) { flags.with(flag) } else { flags };
        let flags = add(FrameFlags::FD, FrameFlags::BIT_RATE_SWITCH, fields.bit_rate_switch);
        frame.flags = add(flags, FrameFlags::ERROR_STATE, fields.error_state);
    } else if bytes.len() == 8 {
        frame.raw_dlc = dlc.filter(|dlc| *dlc > 8).unwrap_or(0);
    }
    Ok(frame)
}

fn remote_frame(frames: &FrameGroup, record: GroupRecord<'_>) -> Result<Frame, &'static str> {
    let id = id(frames, record)?;
    let dlc = read_number(frames.fields.dlc, record)
        .or_else(|| read_number(frames.fields.length, record))
        .unwrap_or(0);
    let dlc = u8::try_from(dlc).ok().filter(|dlc| *dlc <= 15).ok_or("DLC: expected 0 to 15")?;
    let raw_dlc = if dlc > 8 { dlc } else { 0 };
    Ok(Frame { id, flags: FrameFlags::REMOTE, length: dlc.min(8), raw_dlc, ..Frame::EMPTY })
}
