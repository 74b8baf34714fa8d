//! Text on the behaviour of a device in its profile: PDOs, states, gates, procedures, errors.

use std::fmt::Write as _;

use cobscope_decoder::profile::device::{
    DeviceCondition, DeviceErrorCode, DeviceProcedure, ExpectedValue, Gate, GateFallback, MappingSource,
    NmtName, PdoSpec, ProfileTrigger, StateDefinition, StateMachine, StateTransition,
};
use cobscope_decoder::profile::object::NumberList;
use cobscope_decoder::profile::{self, DeviceProfile};

use super::object::{condition_text, equality_text, object_title, plain_number};

/// Name of an NMT state.
pub fn nmt_name(name: NmtName) -> &'static str {
    name.state().name()
}

/// Text of a condition.
pub fn device_condition_text(device: &DeviceProfile, condition: &DeviceCondition) -> String {
    match condition {
        DeviceCondition::Nmt(state) => format!("NMT {}", nmt_name(*state)),
        DeviceCondition::Object { object, mask, values, negated } => {
            let sign = if *negated { "≠" } else { "=" };
            if *mask == u64::MAX {
                return equality_text(device, object.object, values, sign);
            }
            let list: Vec<_> = match values {
                NumberList::One(one) => vec![format!("{one:02X}h")],
                NumberList::Any(any) => any.iter().map(|number| format!("{number:02X}h")).collect(),
            };
            format!("{} & {mask:02X}h {sign} {}", object.object, list.join(" or "))
        }
        DeviceCondition::Inside { object, range: [least, most] } => {
            format!("{least} ≤ {} ≤ {most}", object.object)
        }
        DeviceCondition::Known(object) => format!("{} seen, and used by the sender", object.object),
        DeviceCondition::State(states) => format!("state {}", states.join(" or ")),
        DeviceCondition::Sync => "SYNC with the node's own identifier received".into(),
        DeviceCondition::NoError => "no active error".into(),
        DeviceCondition::NoProcedure => "no active procedure in control".into(),
        DeviceCondition::Younger(ms) => format!("the previous PDO is at most {ms} ms old"),
        DeviceCondition::Invisible => "not visible on the bus".into(),
        DeviceCondition::Other(all) => {
            let all: Vec<_> = all.0.iter().map(|one| device_condition_text(device, one)).collect();
            format!("another device of this type has {}", all.join(" and "))
        }
        DeviceCondition::Alone => "no other CANopen node on the bus".into(),
    }
}

/// Text of a trigger.
pub fn trigger_text(device: &DeviceProfile, trigger: &ProfileTrigger) -> String {
    let of = |wanted: &Option<ExpectedValue>| match wanted {
        None => String::new(),
        Some(ExpectedValue::Text(text)) => format!(" of \"{text}\""),
        Some(ExpectedValue::Numbers(NumberList::One(one))) => format!(" of {}", plain_number(*one)),
        Some(ExpectedValue::Numbers(NumberList::Any(any))) => {
            format!(" of {}", any.iter().map(|one| plain_number(*one)).collect::<Vec<_>>().join(" or "))
        }
    };
    match trigger {
        ProfileTrigger::Write(object, value) => format!("a write{} to {}", of(value), object.object),
        ProfileTrigger::Read(object, value) => format!("a read{} from {}", of(value), object.object),
        ProfileTrigger::Bit(bit, becomes) => {
            format!("bit {} of {} changing to {}", bit.bit, bit.object.object, u8::from(*becomes))
        }
        ProfileTrigger::Pdo(pdo) => pdo.to_string(),
        ProfileTrigger::Message(message) => {
            let times = if message.times > 1 { format!("{} × ", message.times) } else { String::new() };
            let when: Vec<_> =
                message.when.0.iter().map(|when| device_condition_text(device, when)).collect();
            let when = if when.is_empty() { String::new() } else { format!(" with {}", when.join(" and ")) };
            format!("{times}{}{when}", message.name)
        }
        ProfileTrigger::Dtc(None) => "a fault in DM1".into(),
        ProfileTrigger::Dtc(Some((spn, fmi))) => format!("SPN {spn} FMI {fmi} in DM1"),
        ProfileTrigger::Nmt(command) => format!("NMT {command}"),
        ProfileTrigger::State(states) => format!("state {}", states.join(" or ")),
        ProfileTrigger::Sync => "SYNC".into(),
        ProfileTrigger::Emcy(code) => format!("EMCY {code:04X}"),
        ProfileTrigger::Boot => "a boot-up".into(),
        ProfileTrigger::PowerOn => "a power-on".into(),
        ProfileTrigger::Set(set) => format!("a value of {}", set.object.object),
        ProfileTrigger::Shows(set) => format!("a report of {}", set.object.object),
        ProfileTrigger::Reports(states) => format!("NMT state {} reported", states.join(" or ")),
        ProfileTrigger::Writes(range) => format!("a write to {range}"),
        ProfileTrigger::Lss(lss) => format!("LSS {}", lss.service),
        ProfileTrigger::Guard => "a guarding request".into(),
    }
}

/// `RPDO1 if 6043:00 = -3 (pQ)`.
pub fn pdo_name(device: &DeviceProfile, pdo: &PdoSpec) -> String {
    let condition =
        pdo.when.as_ref().map(|it| format!(" if {}", condition_text(device, it, it.object.object)));
    format!("{}{}", pdo.pdo, condition.unwrap_or_default())
}

/// `6040:00 Control word (16 bit), 6300:01 Set point (16 bit)`.
pub fn pdo_contents(device: &DeviceProfile, pdo: &PdoSpec) -> String {
    if pdo.fields.is_empty() {
        return match pdo.mapping {
            MappingSource::BusFile => {
                let name = pdo.pdo.to_string();
                let area = device.areas.iter().find(|area| area.pdos.contains(&name));
                let key = area.map_or("bus file", |area| area.name.as_str());
                format!("set in the manufacturer's tool: {key} in the bus file")
            }
            MappingSource::Fixed | MappingSource::Default => "contents not in the manual".into(),
        };
    }
    let fields = pdo.fields.iter().map(|field| match field.object {
        Some(object) => format!("{} ({} bit)", object_title(device, object.object), field.bits),
        None => format!("{} bit free", field.bits),
    });
    fields.collect::<Vec<_>>().join(", ")
}

/// `fixed`, `default`, `bus file`.
pub const fn mapping_name(mapping: MappingSource) -> &'static str {
    match mapping {
        MappingSource::Fixed => "fixed",
        MappingSource::Default => "default",
        MappingSource::BusFile => "bus file",
    }
}

/// Machines of the first channel; the other channels have equal ones.
pub fn first_machines(device: &DeviceProfile) -> impl Iterator<Item = &StateMachine> {
    device.machines.iter().filter(|machine| machine.channel.is_none_or(|channel| channel == 1))
}

/// `, one for each of 8 channels`.
pub fn channels_text(device: &DeviceProfile) -> String {
    match device.machines.iter().filter_map(|machine| machine.channel).max() {
        Some(last) if last > 1 => format!(", one for each of {last} channels"),
        _ => String::new(),
    }
}

/// Bits of the status word in a state: `status & 0F = 0B`.
pub fn state_bits(machine: &StateMachine, state: &StateDefinition) -> String {
    format!("status & {:02X} = {:02X}", state.mask.unwrap_or(machine.status.mask), state.value)
}

/// Kind of a state: `fault`, `set points act`.
pub const fn state_word(state: &StateDefinition) -> &'static str {
    match (state.fault, state.active) {
        (true, _) => "fault",
        (_, true) => "set points act",
        _ => "",
    }
}

/// `INIT → DISABLED: control & 01 = 01`.
pub fn transition_text(transition: &StateTransition) -> String {
    let from = transition.from.0.join(", ");
    let StateTransition { to, mask, value, edge, .. } = transition;
    let mut text = format!("{from} → {to}: control & {mask:02X} = {value:02X}");
    if *edge != 0 {
        let bits: Vec<_> = (0..64).filter(|bit| edge >> bit & 1 == 1).map(|bit| bit.to_string()).collect();
        let _ = write!(text, ", bit {} 0→1", bits.join(", "));
    }
    if let Some(hint) = &transition.text {
        let _ = write!(text, "; {hint}");
    }
    text
}

/// Other causes of transitions: `NMT reset communication → FAULT HOLD`.
pub fn forced_transitions(machine: &StateMachine) -> Vec<String> {
    use profile::device::EmcyCodes;
    let list = machine.forced.iter().map(|forced| {
        let emcy = forced.emcy.as_ref().map(|codes| match codes {
            EmcyCodes::Any(_) => "any EMCY".to_owned(),
            EmcyCodes::One(code) => format!("EMCY {code:04X}"),
            EmcyCodes::List(list) => {
                let codes: Vec<_> = list.iter().map(|code| format!("{code:04X}")).collect();
                format!("EMCY {}", codes.join(" "))
            }
        });
        let nmt = forced.nmt.as_ref().map(|command| format!("NMT {command}"));
        let event = forced.event.map(|event| super::spaced_name(event.name()));
        let cause = [nmt, emcy, event].into_iter().flatten().collect::<Vec<_>>().join(", ");
        let from = if forced.from.0.is_empty() {
            String::new()
        } else {
            format!(" from {}", forced.from.0.join(", "))
        };
        format!("{cause}{from} → {}", forced.to)
    });
    list.collect()
}

/// Gates of the first channel; the other channels have equal ones.
pub fn first_gates(device: &DeviceProfile) -> impl Iterator<Item = &Gate> {
    device.gates.iter().filter(|gate| gate.channel.is_none_or(|channel| channel == 1))
}

/// Set points of a gate; empty for all.
pub fn gate_for(device: &DeviceProfile, gate: &Gate) -> String {
    let of = if gate.closes.is_empty() { &gate.of } else { &gate.closes };
    let list: Vec<_> = of.iter().map(|of| object_title(device, of.object)).collect();
    let pdo = gate.pdo.map(|pdo| format!("by {pdo}"));
    [Some(list.join(", ")).filter(|list| !list.is_empty()), pdo]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(" ")
}

/// Condition of a gate: `open if NMT operational`.
pub fn gate_open(device: &DeviceProfile, gate: &Gate) -> String {
    if gate.open.0 == [DeviceCondition::Invisible] {
        return "not visible on the bus".into();
    }
    let list: Vec<_> = gate.open.0.iter().map(|open| device_condition_text(device, open)).collect();
    let mut text = format!("open if {}", list.join(" and "));
    if gate.otherwise == GateFallback::Unknown {
        text.push_str(", else unknown");
    }
    text
}

/// Start, duration and end of a procedure.
pub fn procedure_facts(device: &DeviceProfile, procedure: &DeviceProcedure) -> Vec<String> {
    let mut facts = vec![format!("starts with {}", trigger_text(device, &procedure.start))];
    if let Some(seconds) = procedure.seconds {
        facts.push(format!("about {seconds} s"));
    }
    if let Some(status) = &procedure.status {
        facts.push(format!("status in {}", status.object.object));
    }
    if let Some(result) = procedure.result {
        facts.push(format!("result in {}", result.object));
    }
    if let Some(end) = &procedure.end {
        facts.push(format!("ends with {}", trigger_text(device, end)));
    }
    if procedure.takes_over {
        facts.push("CAN set points ignored".into());
    }
    facts
}

/// Error register with the names of its bits: `10 (communication)`.
pub fn register_text(register: u8) -> String {
    let names: Vec<_> = profile::error_register().set_names(u32::from(register)).collect();
    if names.is_empty() {
        format!("{register:02X}")
    } else {
        format!("{register:02X} ({})", names.join(", "))
    }
}

/// Reaction of the device to an error.
pub fn reaction_text(error: &DeviceErrorCode) -> String {
    let goes = error.nmt.map(|state| format!("NMT {}", nmt_name(state)));
    let own = error.reaction.clone().filter(|it| error.nmt.is_none_or(|state| nmt_name(state) != it));
    own.into_iter().chain(goes).collect::<Vec<_>>().join(", ")
}
