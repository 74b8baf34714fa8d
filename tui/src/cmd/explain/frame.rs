//! One frame in candump's log form: what its identifier means, and what the decoder makes of it alone.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::capture::{Batch, Item, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::{CanId, Frame};
use cobscope_decoder::profile::{self, Device, Owner};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, ProtocolChoice, SessionOptions};
use cobscope_decoder::sink::text::{PdoLines, Text, TextOptions};
use cobscope_decoder::wire::canopen::sdo::{self, Phase};

use super::asked::Asked;
use super::{code, identifier};

/// The frame's readings; `None` if it is none.
pub(super) fn frame(thing: &str, asked: &Asked) -> Option<String> {
    let line = format!("can0 {thing}\n");
    let mut reader = Reader::open(line.as_bytes(), &ReadOptions::default()).ok()?;
    let mut batch = Batch::new();
    let mut head = String::new();
    let mut lines = Vec::new();
    let mut codes = Vec::new();
    let mut frames = 0;
    while reader.read(&mut batch).ok()? {
        for item in batch.items() {
            let Item::Frame(frame) = item else { continue };
            if let CanId::Standard(id) = frame.id {
                head = identifier::identifier(id);
            }
            head.push_str(&command(frame));
            let mut decoder = Decoder::new(options(frame.id, asked));
            let mut text = Text::new(
                &mut lines,
                TextOptions {
                    pdo: PdoLines::All,
                    all: true,
                    frames: true,
                    verbose: true,
                    ..TextOptions::default()
                },
            );
            let mut see = |event: &Event, bus: &Bus| {
                text.write(event, bus);
                codes.extend(explained(event, asked));
            };
            // Without `finish`: a single frame of a transfer is no unfinished transfer.
            decoder.push(frame, reader.buses(), &mut see);
            frames += 1;
        }
    }
    let text = format!("{head}{}", String::from_utf8_lossy(&lines));
    (frames > 0).then(|| std::iter::once(text).chain(codes).collect::<Vec<_>>().join("\n"))
}

/// The node of the frame is the device that was named.
fn options(id: CanId, asked: &Asked) -> SessionOptions {
    let assign = |device: &Arc<Device>| {
        let one = |node| Assignment { bus: None, node, device: Arc::clone(device), by: AssignedBy::Option };
        nodes(id, device).into_iter().map(one).collect()
    };
    SessionOptions {
        protocol: ProtocolChoice::Canopen,
        assignments: asked.device.as_ref().map(assign).unwrap_or_default(),
        ..SessionOptions::default()
    }
}

/// The node a frame belongs to; all where the device has identifiers of its own.
fn nodes(id: CanId, device: &Device) -> Vec<u8> {
    if device.pdos.iter().any(|pdo| pdo.cob_id.is_some()) {
        return (1..=127).collect();
    }
    let CanId::Standard(id) = id else { return Vec::new() };
    match profile::connection_set().owner(id) {
        Owner::Emcy(node) | Owner::Pdo(_, node) | Owner::Sdo(_, node) | Owner::ErrorControl(node) => {
            vec![node]
        }
        _ => Vec::new(),
    }
}

/// What the manuals say of the error in an event.
fn explained(event: &Event, asked: &Asked) -> Option<String> {
    match &event.kind {
        EventKind::Emcy(emergency) => {
            let code = emergency.code.filter(|code| *code != 0)?;
            code::emcy(asked, code, false)
        }
        EventKind::SdoTransfer(transfer) => Some(code::abort(asked, transfer.abort?.code)),
        _ => None,
    }
}

/// An SDO frame's own message, which the decoder only tells of whole transfers.
fn command(frame: &Frame) -> String {
    let CanId::Standard(id) = frame.id else {
        return "29-bit identifier: no default use in CANopen\n".into();
    };
    let Owner::Sdo(side, _) = profile::connection_set().owner(id) else { return String::new() };
    let parsed = sdo::parse(frame.data(), side, Phase::Commands);
    let mut text = match parsed {
        Ok(message) => format!("     {}\n", message.describe()),
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!(
                "     too short for its command: {available} of {needed} bytes there from byte {offset}\n"
            )
        }
    };
    if let Ok(sdo::Sdo::BlockSegment { sequence, last, .. }) =
        sdo::parse(frame.data(), side, Phase::BlockSegments)
        && sequence > 0
        && matches!(
            parsed,
            Ok(sdo::Sdo::DownloadSegment(_) | sdo::Sdo::UploadSegment(_) | sdo::Sdo::Unknown { .. })
        )
    {
        let last = if last { ", the last one" } else { "" };
        let _ = writeln!(text, "     within a block transfer: segment {sequence}{last}");
    }
    text
}
