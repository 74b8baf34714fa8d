//! Fields of node events: NMT state, boot-up, loss, EMCY, LSS.

use super::{FieldValue, Fields, number_or_null};
use crate::event::{BootCause, Certainty, Emergency, NodeIdSource, Silence, StateChange};
use crate::profile::{self, Device};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;

/// `states`: presumed state before and after the command.
pub(super) fn nmt_command(
    service: NmtService,
    target: u8,
    states: [Option<NmtState>; 2],
    fields: &mut dyn Fields,
) {
    fields.field("command", FieldValue::Text(service.name()));
    fields.field("target", FieldValue::Unsigned(u64::from(target)));
    if target != 0 {
        for (key, state) in ["from", "to"].into_iter().zip(states) {
            fields.field(key, state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())));
        }
    }
}

pub(super) fn state_change(change: &StateChange, fields: &mut dyn Fields) {
    fields.field("from", change.from.map_or(FieldValue::Null, |from| FieldValue::Text(from.name())));
    fields.field("to", FieldValue::Text(change.to.name()));
    fields.field("cause", FieldValue::Text(change.cause.name()));
    fields.field("cause_frame", FieldValue::Unsigned(change.cause_frame));
    fields.field("certainty", FieldValue::Text(certainty(change.certainty)));
    if let Some(after) = change.after {
        fields.field("after", FieldValue::Seconds(after));
    }
}

const fn certainty(certainty: Certainty) -> &'static str {
    match certainty {
        Certainty::Presumed => "presumed",
        Certainty::Confirmed => "confirmed",
    }
}

pub(super) fn boot_up(cause: BootCause, lost: u32, fields: &mut dyn Fields) {
    if lost > 0 {
        fields.field("settings_lost", FieldValue::Unsigned(u64::from(lost)));
    }
    match cause {
        BootCause::Commanded { frame } => {
            fields.field("cause", FieldValue::Text("commanded"));
            if frame > 0 {
                fields.field("cause_frame", FieldValue::Unsigned(frame));
            }
        }
        BootCause::PresumedPowerOn { sign } => {
            fields.field("cause", FieldValue::Text("presumed-power-on"));
            if let Some(sign) = sign {
                fields.field("sign", FieldValue::Text(sign.name()));
            }
        }
    }
}

pub(super) fn node_state(state: Option<NmtState>, code: u8, fields: &mut dyn Fields) {
    fields.field("state", state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())));
    if state.is_none() {
        fields.field("state_code", FieldValue::Unsigned(u64::from(code)));
    }
}

pub(super) fn guard_reply(
    state: Option<NmtState>,
    code: u8,
    toggle: bool,
    is_toggle_wrong: bool,
    fields: &mut dyn Fields,
) {
    node_state(state, code, fields);
    fields.field("toggle", FieldValue::Unsigned(u64::from(toggle)));
    if is_toggle_wrong {
        fields.field("toggle_error", FieldValue::Bool(true));
    }
}

pub(super) fn node_id_change(from: Option<u8>, to: u8, by: NodeIdSource, fields: &mut dyn Fields) {
    fields.field("from", number_or_null(from));
    fields.field("to", FieldValue::Unsigned(u64::from(to)));
    fields.field("by", FieldValue::Text(by.name()));
}

pub(super) fn node_silence(silence: &Silence, fields: &mut dyn Fields) {
    fields.field("last_frame", FieldValue::Unsigned(silence.last_frame));
    fields.field(
        "last_state",
        silence.last_state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())),
    );
    fields.field(
        "last_emcy",
        silence.last_emcy.map_or(FieldValue::Null, |code| FieldValue::Code(u64::from(code), 4)),
    );
    fields.field("gap", FieldValue::Seconds(silence.gap));
    fields.field("monitored_by", FieldValue::Text(silence.monitored_by.name()));
}

pub(super) fn emcy(emergency: &Emergency, device: &Device, fields: &mut dyn Fields) {
    fields.field("cob_id", FieldValue::Id(emergency.cob_id));
    match emergency.code {
        Some(code) => {
            fields.field("code", FieldValue::Code(u64::from(code), 4));
            fields.field("text", FieldValue::Text(device.error_text(code)));
        }
        None => fields.field("code", FieldValue::Null),
    }
    if let Some(register) = emergency.register {
        fields.field("register", FieldValue::Code(u64::from(register), 2));
        fields.open_list("register_bits");
        for name in profile::error_register().names(u32::from(register)) {
            fields.field("", FieldValue::Text(name));
        }
        fields.close_list();
    }
    vendor(emergency, device, fields);
    if let Some(reaction) = emergency.code.and_then(|code| device.error(code)?.reaction.as_deref()) {
        fields.field("reaction", FieldValue::Text(reaction));
    }
    fields.field("action", FieldValue::Text(emergency.action.name()));
    fields.field("active", FieldValue::Unsigned(u64::from(emergency.active)));
    fields.field("byte_order", FieldValue::Text(emergency.byte_order.name()));
    fields.field("byte_order_origin", FieldValue::Text(emergency.byte_order_by.name()));
    if let Some(cause) = emergency.boot {
        fields.open("boot");
        boot_up(cause, 0, fields);
        fields.close();
    }
    if let Some(code) = emergency.alternative {
        fields.field("alternative", FieldValue::Code(u64::from(code), 4));
        fields.field("alternative_text", FieldValue::Text(device.error_text(code)));
    }
}

/// Manufacturer-specific bytes, and the values in them that the profile defines.
fn vendor(emergency: &Emergency, device: &Device, fields: &mut dyn Fields) {
    if emergency.vendor_length == 0 {
        return;
    }
    let data = emergency.vendor.get(..usize::from(emergency.vendor_length)).unwrap_or_default();
    fields.field("vendor_data", FieldValue::Bytes(data));
    let mut values =
        device.emcy.vendor.iter().filter_map(|field| Some((field, field.value(data)?))).peekable();
    if values.peek().is_none() {
        return;
    }
    fields.open_list("vendor");
    for (field, value) in values {
        fields.open("");
        fields.field("name", FieldValue::Text(&field.name));
        fields.field("value", FieldValue::Unsigned(value));
        fields.close();
    }
    fields.close_list();
}

pub(super) fn lss(command: u8, from_master: bool, content: &Content, fields: &mut dyn Fields) {
    fields.field("service", FieldValue::Text(profile::lss().service(command)));
    fields.field("direction", FieldValue::Text(if from_master { "request" } else { "response" }));
    match *content {
        Content::Nothing => {}
        Content::Mode(mode) => {
            let mode = match mode {
                0 => FieldValue::Text("waiting"),
                1 => FieldValue::Text("configuration"),
                other => FieldValue::Unsigned(u64::from(other)),
            };
            fields.field("mode", mode);
        }
        Content::NodeId(id) => fields.field("node_id", FieldValue::Unsigned(u64::from(id))),
        Content::BitTiming { table, entry } => {
            fields.field("table", FieldValue::Unsigned(u64::from(table)));
            fields.field("index", FieldValue::Unsigned(u64::from(entry)));
            if let Some(rate) = profile::lss().bit_rate(entry).filter(|_| table == 0) {
                fields.field("bit_rate", FieldValue::Unsigned(u64::from(rate) * 1000));
            }
        }
        Content::Delay(delay) => fields.field("delay_ms", FieldValue::Unsigned(u64::from(delay))),
        Content::Number(number) => {
            fields.field(profile::lss().number_key(command), FieldValue::Code(u64::from(number), 8));
        }
        Content::Result { code, specific } => {
            fields.field("error", FieldValue::Unsigned(u64::from(code)));
            fields.field("result", FieldValue::Text(if code == 0 { "ok" } else { "error" }));
            if code != 0 {
                fields.field("text", FieldValue::Text(profile::lss().result(command, code)));
            }
            if code == u8::MAX {
                fields.field("specific", FieldValue::Unsigned(u64::from(specific)));
            }
        }
        Content::FastScan { number, bit, sub, next } => {
            fields.field("id_number", FieldValue::Code(u64::from(number), 8));
            fields.field("bit_check", FieldValue::Unsigned(u64::from(bit)));
            fields.field("lss_sub", FieldValue::Unsigned(u64::from(sub)));
            fields.field("lss_next", FieldValue::Unsigned(u64::from(next)));
        }
    }
}
