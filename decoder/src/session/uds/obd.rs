//! Known pairs of 11-bit identifiers for OBD and UDS (ISO 15765-4 §6.3.2.2): requests on 7DF to all and on 7E0 to
//! 7E7 to one server, responses on 7E8 to 7EF.
//!
//! Machines also use these identifiers for other purposes. So a pair is decoded from its first response on: a
//! valid ISO-TP message of the service that was requested. On a CANopen bus, 7E4 and 7E5 stay LSS (CiA 305).

use std::sync::Arc;

use crate::bus_file::UdsPair;
use crate::frame::{CanId, Frame, FrameFlags};
use crate::profile;
use crate::session::bus::UdsLink;
use crate::session::context::MachineContext;
use crate::session::options::ProtocolChoice;
use crate::wire::isotp::{self, IsoTpFrame};

/// Identifier of requests to all servers.
const FUNCTIONAL: u16 = 0x7DF;

/// Identifiers of the requests to the first server and of its responses.
const REQUEST: u16 = 0x7E0;
const RESPONSE: u16 = 0x7E8;

/// Number of servers.
const SERVERS: u16 = 8;

/// Servers whose request identifiers belong to LSS in a CANopen network: 7E4 and 7E5.
const LSS: [u16; 2] = [4, 5];

/// Time in ns after which a response no longer belongs to a request (P2*server_max, ISO 14229-2 §7.2).
const LATEST: i64 = 5_000_000_000;

/// Offset from request to response SID, and SID of a negative response (ISO 14229-1 §8.3, §8.7).
const ANSWER: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

/// Last valid request on each identifier of OBD that is not decoded yet.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct ObdPairs {
    functional: Option<Box<Frame>>,
    physical: [Option<Box<Frame>>; SERVERS as usize],
}

/// A pair that its first response revealed.
pub(in crate::session) struct ObdPair {
    /// Direction of the request.
    pub(in crate::session) request: UdsLink,
    /// Direction of the response.
    pub(in crate::session) response: UdsLink,
    /// Frame of the request.
    pub(in crate::session) frame: Box<Frame>,
}

impl ObdPairs {
    /// Whether an identifier is one of OBD.
    #[inline]
    pub(in crate::session) const fn is_obd_identifier(id: CanId) -> bool {
        matches!(id, CanId::Standard(FUNCTIONAL | 0x7E0..=0x7EF))
    }

    /// Whether an identifier is that of requests to all servers.
    #[inline]
    pub(in crate::session) const fn is_functional(id: CanId) -> bool {
        matches!(id, CanId::Standard(FUNCTIONAL))
    }

    /// Stores a valid request.
    pub(in crate::session) fn note_request(&mut self, frame: &Frame) {
        let CanId::Standard(id) = frame.id else { return };
        let slot = match id.checked_sub(REQUEST) {
            None if id == FUNCTIONAL => &mut self.functional,
            Some(server) => match self.physical.get_mut(usize::from(server)) {
                Some(slot) => slot,
                None => return,
            },
            None => return,
        };
        if first_byte(frame).is_some_and(|service| {
            service & ANSWER == 0
                && profile::uds_names().service_by_id(service).is_some()
                && frame.length == 8
        }) {
            *slot = Some(Box::new(*frame));
        }
    }

    /// Evaluates a frame that is not decoded; a response to a request makes both identifiers a pair.
    pub(in crate::session) fn take_frame(
        &mut self,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) -> Option<ObdPair> {
        let is_plain = !frame.flags.contains(FrameFlags::REMOTE) && !frame.flags.contains(FrameFlags::FD);
        if !is_plain || cx.bus.options.protocol == ProtocolChoice::None {
            return None;
        }
        self.note_request(frame);
        let CanId::Standard(id) = frame.id else { return None };
        let server = id.checked_sub(RESPONSE).filter(|server| *server < SERVERS)?;
        if LSS.contains(&server) && cx.bus.protocols.canopen.is_confirmed() {
            return None;
        }
        let physical = self.physical.get(usize::from(server)).and_then(Option::as_deref);
        let physical = physical.filter(|request| answers_request(frame, request));
        let functional = self.functional.as_deref().filter(|request| answers_request(frame, request));
        let request = physical.or(functional).map(|request| Box::new(*request))?;
        let pair = UdsPair {
            request: CanId::from_standard(REQUEST + server),
            response: frame.id,
            functional: Some(CanId::from_standard(FUNCTIONAL)),
            name: Some(format!("OBD {}", frame.id)),
            extended_addressing: false,
        };
        let links = Arc::make_mut(&mut cx.bus.uds_pairs).add_pair(pair);
        for &(id, link) in &links {
            cx.bus.routes.assign_link(id, link);
        }
        let link = |wanted: CanId| links.iter().find(|(id, _)| *id == wanted).map(|(_, link)| *link);
        let text = format!("{} responds to {}: decoded as OBD and UDS (ISO 15765-4)", frame.id, request.id);
        cx.emit_note(frame, text);
        Some(ObdPair { request: link(request.id)?, response: link(frame.id)?, frame: request })
    }
}

/// First byte of a message that a frame starts.
fn first_byte(frame: &Frame) -> Option<u8> {
    started_message(frame)?.first().copied()
}

fn started_message(frame: &Frame) -> Option<&[u8]> {
    match isotp::parse(frame.data(), frame.data().len()) {
        Ok(IsoTpFrame::Single { data } | IsoTpFrame::First { data, .. }) => Some(data),
        _ => None,
    }
}

/// Whether a frame is a positive or negative response to a request.
fn answers_request(frame: &Frame, request: &Frame) -> bool {
    let Some((data, asked)) = started_message(frame).zip(first_byte(request)) else { return false };
    let is_in_time = match (frame.time, request.time) {
        (Some(now), Some(then)) => (0..=LATEST).contains(&now.since(then)),
        _ => true,
    };
    is_in_time
        && match data {
            [NEGATIVE, refused, _, ..] => *refused == asked,
            [service, ..] => *service == asked | ANSWER,
            [] => false,
        }
}
