//! Steps of a sequence: content of an event without times, frame numbers and values that vary from run to run.

use std::fmt::Write as _;

use crate::event::{EmcyAction, Event, EventKind, SdoDirection, SdoOutcome, SdoTransfer};
use crate::profile::DecodedValue;

/// Maximum number of bytes of a written value.
pub(super) const SHOWN_BYTES: usize = 64;

/// Text of a step; `None` for repetitions and for kinds outside procedures.
pub(super) fn step_text(event: &Event) -> Option<String> {
    if event.routine {
        return None;
    }
    Some(match &event.kind {
        EventKind::NmtCommand { service, target, .. } => {
            format!(
                "NMT {} to {}",
                service.name(),
                if *target == 0 { "all".into() } else { target.to_string() }
            )
        }
        EventKind::BootUp { .. } => "boot-up".to_owned(),
        EventKind::NmtState(change) if change.from != Some(change.to) => {
            format!("NMT state {}", change.to.name())
        }
        EventKind::NodeLost(_) => "lost".to_owned(),
        EventKind::NodeBack(_) => "received again".to_owned(),
        EventKind::Emcy(emergency) if emergency.action == EmcyAction::Raised => {
            format!("EMCY {:04X}", emergency.code.unwrap_or(0))
        }
        EventKind::SdoTransfer(transfer) => transfer_step(transfer),
        EventKind::DeviceState(state) => {
            let channel = state.channel.map_or(String::new(), |channel| format!(" c{channel}"));
            format!("{}{channel} {}", state.machine, state.to)
        }
        EventKind::Mode(mode) => format!("{} {} {}", mode.object, mode.name, mode.to),
        EventKind::Procedure(procedure) => format!("{} {}", procedure.procedure, procedure.phase.name()),
        EventKind::NodeIdChange { to, .. } => format!("node-ID {to}"),
        EventKind::AddressClaim(_) => "address claim".to_owned(),
        EventKind::Dtc(dtc) => format!("SPN {} FMI {} {}", dtc.spn, dtc.fmi, dtc.action.name()),
        EventKind::UdsExchange(exchange) => {
            let id = exchange.identifier.map_or(String::new(), |id| format!(" {id:04X}"));
            let nrc = exchange.nrc.map_or(String::new(), |nrc| format!(" NRC {nrc:02X}"));
            format!("UDS {:02X}{id} {}{nrc}", exchange.service, exchange.outcome.name())
        }
        _ => return None,
    })
}

/// Written value as text; of a long one its beginning.
pub(super) fn written_text(transfer: &SdoTransfer) -> String {
    let data = transfer.data.get(..SHOWN_BYTES).unwrap_or(&transfer.data);
    match &transfer.meaning {
        Some(meaning) => meaning.format_value(&meaning.decode(data)),
        None => DecodedValue::Bytes(data.to_vec()).to_string(),
    }
}

fn transfer_step(transfer: &SdoTransfer) -> String {
    let object = transfer.object.map_or_else(|| "?".to_owned(), |object| object.to_string());
    let verb = match transfer.direction {
        Some(SdoDirection::Download) => "write",
        Some(SdoDirection::Upload) => "read",
        None => "transfer",
    };
    let mut text = format!("SDO {verb} {object}");
    // A value that was read may be measured: it is not part of the step.
    if transfer.direction == Some(SdoDirection::Download) {
        let value = written_text(transfer);
        let _ = write!(text, " = {value}");
    }
    if let Some(abort) = transfer.abort {
        let _ = write!(text, ", abort {:08X}", abort.code);
    } else if transfer.outcome != SdoOutcome::Complete {
        let _ = write!(text, ", {}", transfer.outcome.name());
    }
    text
}
