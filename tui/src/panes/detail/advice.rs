//! Statements of the manual about an error, and what to check.
//!
//! ```text
//! device reaction: safe state
//! check: supply voltage
//! manual: RE 12345, 14.3.1
//! ```

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::profile::{DeviceProfile, emcy_codes};
use cobscope_decoder::session::Node;

use super::item::DetailItem;
use crate::theme::TextRole;

/// Advice for an error event or a change of the device state; empty for other events.
pub(super) fn advice_items(node: Option<&Node>, event: &Event) -> Vec<DetailItem> {
    let device = node.map(|node| &**node.device());
    let mut rows: Vec<(&str, String)> = Vec::new();
    match &event.kind {
        EventKind::Emcy(emergency) => {
            let Some(code) = emergency.code.filter(|code| *code != 0) else { return Vec::new() };
            push_emcy(device, code, &mut rows);
        }
        EventKind::Dtc(dtc) => {
            let Some(known) = device.and_then(|device| device.trouble_code_entry(dtc.spn, dtc.fmi)) else {
                return Vec::new();
            };
            rows.push(("fault", known.text.clone()));
            rows.push(("severity", known.severity.clone()));
            rows.push(("device reaction", known.reaction.clone()));
            rows.push(("recovery", known.recovery.clone()));
            rows.extend(known.causes.iter().map(|cause| ("check", cause.clone())));
        }
        EventKind::DeviceState(state) => {
            rows.push(("to leave", state.leave.clone().unwrap_or_default()));
        }
        _ => {}
    }
    let reported = rows.iter().filter(|(_, text)| !text.is_empty());
    reported.map(|(key, text)| DetailItem::new(&format!("{key}: {text}"), TextRole::Text)).collect()
}

fn push_emcy(device: Option<&DeviceProfile>, code: u16, rows: &mut Vec<(&str, String)>) {
    let standard =
        emcy_codes().find_code(u32::from(code)).map(|known| format!("{}. {}", known.text, known.hint));
    if let Some((device, known)) = device.and_then(|device| Some((device, device.error_entry(code)?))) {
        rows.push(("device reaction", known.reaction.clone().unwrap_or_default()));
        rows.extend(known.causes.iter().map(|cause| ("check", cause.clone())));
        rows.push(("note", known.note.clone()));
        let section = [device.source.as_str(), known.source.as_str()];
        let section: Vec<_> = section.into_iter().filter(|part| !part.is_empty()).collect();
        rows.push(("manual", section.join(", ")));
    }
    rows.push(("CiA 301", standard.unwrap_or_default()));
}
