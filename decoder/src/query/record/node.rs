//! Fields of node events: NMT state, boot-up, loss, EMCY, LSS.

use super::{FieldConsumer, FieldValue, number_or_null};
use crate::event::{BootCause, Emergency, NodeIdSource, NodeSilence, StateCertainty, StateChange};
use crate::profile::{self, DeviceProfile};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::lss::LssContent;
use crate::wire::canopen::nmt::NmtService;

/// `states`: presumed state before and after the command.
pub(super) fn nmt_command(
    service: NmtService,
    target: u8,
    states: [Option<NmtState>; 2],
    fields: &mut dyn FieldConsumer,
) {
    fields.add_field("command", FieldValue::Text(service.name()));
    fields.add_field("target", FieldValue::Unsigned(u64::from(target)));
    if target != 0 {
        for (key, state) in ["from", "to"].into_iter().zip(states) {
            fields.add_field(key, state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())));
        }
    }
}

pub(super) fn state_change(change: &StateChange, fields: &mut dyn FieldConsumer) {
    fields.add_field("from", change.from.map_or(FieldValue::Null, |from| FieldValue::Text(from.name())));
    fields.add_field("to", FieldValue::Text(change.to.name()));
    fields.add_field("cause", FieldValue::Text(change.cause.name()));
    fields.add_field("cause_frame", FieldValue::Unsigned(change.cause_frame));
    fields.add_field("certainty", FieldValue::Text(certainty_name(change.certainty)));
    if let Some(after) = change.after {
        fields.add_field("after", FieldValue::Seconds(after));
    }
}

const fn certainty_name(certainty: StateCertainty) -> &'static str {
    match certainty {
        StateCertainty::Presumed => "presumed",
        StateCertainty::Confirmed => "confirmed",
    }
}

pub(super) fn boot_up(cause: BootCause, lost: u32, fields: &mut dyn FieldConsumer) {
    if lost > 0 {
        fields.add_field("settings_lost", FieldValue::Unsigned(u64::from(lost)));
    }
    match cause {
        BootCause::Commanded { frame } => {
            fields.add_field("cause", FieldValue::Text("commanded"));
            if frame > 0 {
                fields.add_field("cause_frame", FieldValue::Unsigned(frame));
            }
        }
        BootCause::PresumedPowerOn { sign } => {
            fields.add_field("cause", FieldValue::Text("presumed-power-on"));
            if let Some(sign) = sign {
                fields.add_field("sign", FieldValue::Text(sign.name()));
            }
        }
    }
}

pub(super) fn node_state(state: Option<NmtState>, code: u8, fields: &mut dyn FieldConsumer) {
    fields.add_field("state", state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())));
    if state.is_none() {
        fields.add_field("state_code", FieldValue::Unsigned(u64::from(code)));
    }
}

pub(super) fn guard_reply(
    state: Option<NmtState>,
    code: u8,
    toggle: bool,
    is_toggle_wrong: bool,
    fields: &mut dyn FieldConsumer,
) {
    node_state(state, code, fields);
    fields.add_field("toggle", FieldValue::Unsigned(u64::from(toggle)));
    if is_toggle_wrong {
        fields.add_field("toggle_error", FieldValue::Bool(true));
    }
}

pub(super) fn node_id_change(from: Option<u8>, to: u8, by: NodeIdSource, fields: &mut dyn FieldConsumer) {
    fields.add_field("from", number_or_null(from));
    fields.add_field("to", FieldValue::Unsigned(u64::from(to)));
    fields.add_field("by", FieldValue::Text(by.name()));
}

pub(super) fn node_silence(silence: &NodeSilence, fields: &mut dyn FieldConsumer) {
    fields.add_field("last_frame", FieldValue::Unsigned(silence.last_frame));
    fields.add_field(
        "last_state",
        silence.last_state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())),
    );
    fields.add_field(
        "last_emcy",
        silence.last_emcy.map_or(FieldValue::Null, |code| FieldValue::Code(u64::from(code), 4)),
    );
    fields.add_field("gap", FieldValue::Seconds(silence.gap));
    fields.add_field("monitored_by", FieldValue::Text(silence.monitored_by.name()));
    if silence.others_continue {
        fields.add_field("others_continue", FieldValue::Bool(true));
    }
    if let Some(boot) = silence.boot_frame {
        fields.add_field("boot_frame", FieldValue::Unsigned(boot));
    }
}

pub(super) fn visit_emcy(emergency: &Emergency, device: &DeviceProfile, fields: &mut dyn FieldConsumer) {
    fields.add_field("cob_id", FieldValue::Id(emergency.cob_id));
    match emergency.code {
        Some(code) => {
            fields.add_field("code", FieldValue::Code(u64::from(code), 4));
            fields.add_field("text", FieldValue::Text(device.error_text(code)));
        }
        None => fields.add_field("code", FieldValue::Null),
    }
    if let Some(register) = emergency.register {
        fields.add_field("register", FieldValue::Code(u64::from(register), 2));
        fields.open_list("register_bits");
        for name in profile::error_register().set_names(u32::from(register)) {
            fields.add_field("", FieldValue::Text(name));
        }
        fields.close_list();
    }
    visit_vendor(emergency, device, fields);
    if let Some(reaction) = emergency.code.and_then(|code| device.error_entry(code)?.reaction.as_deref()) {
        fields.add_field("reaction", FieldValue::Text(reaction));
    }
    fields.add_field("action", FieldValue::Text(emergency.action.name()));
    fields.add_field("active", FieldValue::Unsigned(u64::from(emergency.active)));
    fields.add_field("byte_order", FieldValue::Text(emergency.byte_order.name()));
    fields.add_field("byte_order_origin", FieldValue::Text(emergency.byte_order_by.name()));
    if let Some(cause) = emergency.boot {
        fields.open_group("boot");
        boot_up(cause, 0, fields);
        fields.close_group();
    }
    if let Some(code) = emergency.alternative {
        fields.add_field("alternative", FieldValue::Code(u64::from(code), 4));
        fields.add_field("alternative_text", FieldValue::Text(device.error_text(code)));
    }
}

/// Manufacturer-specific bytes, and the values in them that the profile defines.
fn visit_vendor(emergency: &Emergency, device: &DeviceProfile, fields: &mut dyn FieldConsumer) {
    if emergency.vendor_length == 0 {
        return;
    }
    let data = emergency.vendor.get(..usize::from(emergency.vendor_length)).unwrap_or_default();
    fields.add_field("vendor_data", FieldValue::Bytes(data));
    let mut values =
        device.emcy.vendor.iter().filter_map(|field| Some((field, field.vendor_number(data)?))).peekable();
    if values.peek().is_none() {
        return;
    }
    fields.open_list("vendor");
    for (field, value) in values {
        fields.open_group("");
        fields.add_field("name", FieldValue::Text(&field.name));
        fields.add_field("value", FieldValue::Unsigned(value));
        fields.close_group();
    }
    fields.close_list();
}

pub(super) fn visit_lss(
    command: u8,
    from_master: bool,
    content: &LssContent,
    fields: &mut dyn FieldConsumer,
) {
    fields.add_field("service", FieldValue::Text(profile::lss_names().service_name(command)));
    fields.add_field("direction", FieldValue::Text(if from_master { "request" } else { "response" }));
    match *content {
        LssContent::Nothing => {}
        LssContent::Mode(mode) => {
            let mode = match mode {
                0 => FieldValue::Text("waiting"),
                1 => FieldValue::Text("configuration"),
                other => FieldValue::Unsigned(u64::from(other)),
            };
            fields.add_field("mode", mode);
        }
        LssContent::NodeId(id) => fields.add_field("node_id", FieldValue::Unsigned(u64::from(id))),
        LssContent::BitTiming { table, entry } => {
            fields.add_field("table", FieldValue::Unsigned(u64::from(table)));
            fields.add_field("index", FieldValue::Unsigned(u64::from(entry)));
            if let Some(rate) = profile::lss_names().bit_rate(entry).filter(|_| table == 0) {
                fields.add_field("bit_rate", FieldValue::Unsigned(u64::from(rate) * 1000));
            }
        }
        LssContent::Delay(delay) => fields.add_field("delay_ms", FieldValue::Unsigned(u64::from(delay))),
        LssContent::Number(number) => {
            fields
                .add_field(profile::lss_names().number_key(command), FieldValue::Code(u64::from(number), 8));
        }
        LssContent::Result { code, specific } => {
            fields.add_field("error", FieldValue::Unsigned(u64::from(code)));
            fields.add_field("result", FieldValue::Text(if code == 0 { "ok" } else { "error" }));
            if code != 0 {
                fields.add_field("text", FieldValue::Text(profile::lss_names().result_text(command, code)));
            }
            if code == u8::MAX {
                fields.add_field("specific", FieldValue::Unsigned(u64::from(specific)));
            }
        }
        LssContent::FastScan { number, bit, sub, next } => {
            fields.add_field("id_number", FieldValue::Code(u64::from(number), 8));
            fields.add_field("bit_check", FieldValue::Unsigned(u64::from(bit)));
            fields.add_field("lss_sub", FieldValue::Unsigned(u64::from(sub)));
            fields.add_field("lss_next", FieldValue::Unsigned(u64::from(next)));
        }
    }
}
