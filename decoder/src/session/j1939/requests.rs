//! Requests for groups, and acknowledgements.

use super::trouble_codes::clear_trouble_codes;
use crate::event::{EventKind, J1939Acknowledgement, J1939Request};
use crate::frame::Frame;
use crate::session::context::MachineContext;
use crate::session::machine::ProtocolMachine;
use crate::wire::j1939::{Acknowledgement, J1939Id, Pgn, parse_request};

/// Control byte of a positive acknowledgement (J1939-21 §5.4.4).
const DONE: u8 = 0;

/// Requests and acknowledgements of all addresses.
#[derive(Debug, Clone)]
pub(in crate::session) struct RequestMachine;

impl ProtocolMachine for RequestMachine {
    type Route<'a> = J1939Id;
    type Product = ();

    fn on_frame(&mut self, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
        if id.pgn == Pgn::REQUEST {
            on_request(id, frame, cx);
        } else {
            on_acknowledgement(id, frame, cx);
        }
    }
}

fn on_request(id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
    match parse_request(frame.data()) {
        Ok(pgn) => {
            let name = cx.bus.group_name(pgn);
            let (source, destination) = (id.source, id.destination);
            let request = J1939Request { pgn, name, source, destination };
            cx.emit_j1939(frame, id, EventKind::J1939Request(request));
        }
        Err(error) => cx.emit_malformed_j1939(id, error, "a request has three bytes", frame),
    }
}

fn on_acknowledgement(id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
    match Acknowledgement::read(frame.data()) {
        Ok(message) => {
            let name = cx.bus.group_name(message.pgn);
            let (source, destination) = (id.source, id.destination);
            let answer = J1939Acknowledgement { message, name, source, destination };
            cx.emit_j1939(frame, id, EventKind::Acknowledgement(answer));
            if message.control == DONE {
                clear_trouble_codes(id.source, message.pgn, frame, cx);
            }
        }
        Err(error) => cx.emit_malformed_j1939(id, error, "an acknowledgement has eight bytes", frame),
    }
}
