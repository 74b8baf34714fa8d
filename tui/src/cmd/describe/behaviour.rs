//! Text on the behaviour of a device in its profile: PDOs, states, gates, procedures, errors.

use std::fmt::Write as _;

use cobscope_decoder::profile::device::{
    Condition, ErrorCode, ExpectedValue, Gate, GateFallback, Machine, Mapping, NmtName, PdoSpec, Procedure,
    State, Transition, Trigger,
};
use cobscope_decoder::profile::object::Numbers;
use cobscope_decoder::profile::{self, Device};

use super::object::{equals, named, plain, when};

/// Name of an NMT state.
pub(in crate::cmd) fn nmt(name: NmtName) -> &'static str {
    name.state().name()
}

/// Text of a condition.
pub(in crate::cmd) fn condition(device: &Device, condition: &Condition) -> String {
    match condition {
        Condition::Nmt(state) => format!("NMT {}", nmt(*state)),
        Condition::Object { object, mask, values, negated } => {
            let sign = if *negated { "≠" } else { "=" };
            if *mask == u64::MAX {
                return equals(device, object.object, values, sign);
            }
            let list: Vec<_> = match values {
                Numbers::One(one) => vec![format!("{one:02X}h")],
                Numbers::Any(any) => any.iter().map(|number| format!("{number:02X}h")).collect(),
            };
            format!("{} & {mask:02X}h {sign} {}", object.object, list.join(" or "))
        }
        Condition::Inside { object, range: [least, most] } => {
            format!("{least} ≤ {} ≤ {most}", object.object)
        }
        Condition::State(states) => format!("state {}", states.join(" or ")),
        Condition::Sync => "SYNC with the node's own identifier received".into(),
        Condition::NoError => "no active error".into(),
        Condition::NoProcedure => "no active procedure in control".into(),
        Condition::Younger(ms) => format!("the previous PDO is at most {ms} ms old"),
        Condition::Invisible => "not visible on the bus".into(),
        Condition::Other(all) => {
            let all: Vec<_> = all.0.iter().map(|one| self::condition(device, one)).collect();
            format!("another device of this type has {}", all.join(" and "))
        }
        Condition::Alone => "no other CANopen node on the bus".into(),
    }
}

/// Text of a trigger.
pub(in crate::cmd) fn trigger(device: &Device, trigger: &Trigger) -> String {
    let of = |wanted: &Option<ExpectedValue>| match wanted {
        None => String::new(),
        Some(ExpectedValue::Text(text)) => format!(" of \"{text}\""),
        Some(ExpectedValue::Numbers(Numbers::One(one))) => format!(" of {}", plain(*one)),
        Some(ExpectedValue::Numbers(Numbers::Any(any))) => {
            format!(" of {}", any.iter().map(|one| plain(*one)).collect::<Vec<_>>().join(" or "))
        }
    };
    match trigger {
        Trigger::Write(object, value) => format!("a write{} to {}", of(value), object.object),
        Trigger::Read(object, value) => format!("a read{} from {}", of(value), object.object),
        Trigger::Bit(bit, becomes) => {
            format!("bit {} of {} changing to {}", bit.bit, bit.object.object, u8::from(*becomes))
        }
        Trigger::Pdo(pdo) => pdo.to_string(),
        Trigger::Message(message) => {
            let times = if message.times > 1 { format!("{} × ", message.times) } else { String::new() };
            let when: Vec<_> = message.when.0.iter().map(|when| condition(device, when)).collect();
            let when = if when.is_empty() { String::new() } else { format!(" with {}", when.join(" and ")) };
            format!("{times}{}{when}", message.name)
        }
        Trigger::Dtc(None) => "a fault in DM1".into(),
        Trigger::Dtc(Some((spn, fmi))) => format!("SPN {spn} FMI {fmi} in DM1"),
        Trigger::Nmt(command) => format!("NMT {command}"),
        Trigger::State(states) => format!("state {}", states.join(" or ")),
        Trigger::Sync => "SYNC".into(),
        Trigger::Emcy(code) => format!("EMCY {code:04X}"),
        Trigger::Boot => "a boot-up".into(),
        Trigger::PowerOn => "a power-on".into(),
        Trigger::Set(set) => format!("a value of {}", set.object.object),
        Trigger::Shows(set) => format!("a report of {}", set.object.object),
        Trigger::Reports(states) => format!("NMT state {} reported", states.join(" or ")),
        Trigger::Writes(range) => format!("a write to {range}"),
        Trigger::Lss(lss) => format!("LSS {}", lss.service),
        Trigger::Guard => "a guarding request".into(),
    }
}

/// `RPDO1 if 6043:00 = -3 (pQ)`.
pub(in crate::cmd) fn pdo_name(device: &Device, pdo: &PdoSpec) -> String {
    let condition = pdo.when.as_ref().map(|it| format!(" if {}", when(device, it, it.object.object)));
    format!("{}{}", pdo.pdo, condition.unwrap_or_default())
}

/// `6040:00 Control word (16 bit), 6300:01 Set point (16 bit)`.
pub(in crate::cmd) fn pdo_contents(device: &Device, pdo: &PdoSpec) -> String {
    if pdo.fields.is_empty() {
        return match pdo.mapping {
            Mapping::BusFile => {
                let name = pdo.pdo.to_string();
                let area = device.areas.iter().find(|area| area.pdos.contains(&name));
                let key = area.map_or("bus file", |area| area.name.as_str());
                format!("set in the manufacturer's tool: {key} in the bus file")
            }
            Mapping::Fixed | Mapping::Default => "contents not in the manual".into(),
        };
    }
    let fields = pdo.fields.iter().map(|field| match field.object {
        Some(object) => format!("{} ({} bit)", named(device, object.object), field.bits),
        None => format!("{} bit free", field.bits),
    });
    fields.collect::<Vec<_>>().join(", ")
}

/// `fixed`, `default`, `bus file`.
pub(in crate::cmd) const fn mapping(mapping: Mapping) -> &'static str {
    match mapping {
        Mapping::Fixed => "fixed",
        Mapping::Default => "default",
        Mapping::BusFile => "bus file",
    }
}

/// Machines of the first channel; the other channels have equal ones.
pub(in crate::cmd) fn first_machines(device: &Device) -> impl Iterator<Item = &Machine> {
    device.machines.iter().filter(|machine| machine.channel.is_none_or(|channel| channel == 1))
}

/// `, one for each of 8 channels`.
pub(in crate::cmd) fn channels(device: &Device) -> String {
    match device.machines.iter().filter_map(|machine| machine.channel).max() {
        Some(last) if last > 1 => format!(", one for each of {last} channels"),
        _ => String::new(),
    }
}

/// Bits of the status word in a state: `status & 0F = 0B`.
pub(in crate::cmd) fn state_bits(machine: &Machine, state: &State) -> String {
    format!("status & {:02X} = {:02X}", state.mask.unwrap_or(machine.status.mask), state.value)
}

/// Kind of a state: `fault`, `set points act`.
pub(in crate::cmd) const fn state_word(state: &State) -> &'static str {
    match (state.fault, state.active) {
        (true, _) => "fault",
        (_, true) => "set points act",
        _ => "",
    }
}

/// `INIT → DISABLED: control & 01 = 01`.
pub(in crate::cmd) fn transition(transition: &Transition) -> String {
    let from = transition.from.0.join(", ");
    let Transition { to, mask, value, edge, .. } = transition;
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
pub(in crate::cmd) fn forced(machine: &Machine) -> Vec<String> {
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
        let event = forced.event.map(|event| super::spaced(event.name()));
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
pub(in crate::cmd) fn first_gates(device: &Device) -> impl Iterator<Item = &Gate> {
    device.gates.iter().filter(|gate| gate.channel.is_none_or(|channel| channel == 1))
}

/// Set points of a gate; empty for all.
pub(in crate::cmd) fn gate_for(device: &Device, gate: &Gate) -> String {
    let of = if gate.closes.is_empty() { &gate.of } else { &gate.closes };
    let list: Vec<_> = of.iter().map(|of| named(device, of.object)).collect();
    let pdo = gate.pdo.map(|pdo| format!("by {pdo}"));
    [Some(list.join(", ")).filter(|list| !list.is_empty()), pdo]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(" ")
}

/// Condition of a gate: `open if NMT operational`.
pub(in crate::cmd) fn gate_open(device: &Device, gate: &Gate) -> String {
    if gate.open.0 == [Condition::Invisible] {
        return "not visible on the bus".into();
    }
    let list: Vec<_> = gate.open.0.iter().map(|open| condition(device, open)).collect();
    let mut text = format!("open if {}", list.join(" and "));
    if gate.otherwise == GateFallback::Unknown {
        text.push_str(", else unknown");
    }
    text
}

/// Start, duration and end of a procedure.
pub(in crate::cmd) fn procedure_facts(device: &Device, procedure: &Procedure) -> Vec<String> {
    let mut facts = vec![format!("starts with {}", trigger(device, &procedure.start))];
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
        facts.push(format!("ends with {}", trigger(device, end)));
    }
    if procedure.takes_over {
        facts.push("CAN set points ignored".into());
    }
    facts
}

/// Error register with the names of its bits: `10 (communication)`.
pub(in crate::cmd) fn register(register: u8) -> String {
    let names: Vec<_> = profile::error_register().names(u32::from(register)).collect();
    if names.is_empty() {
        format!("{register:02X}")
    } else {
        format!("{register:02X} ({})", names.join(", "))
    }
}

/// Reaction of the device to an error.
pub(in crate::cmd) fn reaction(error: &ErrorCode) -> String {
    let goes = error.nmt.map(|state| format!("NMT {}", nmt(state)));
    let own = error.reaction.clone().filter(|it| error.nmt.is_none_or(|state| nmt(state) != it));
    own.into_iter().chain(goes).collect::<Vec<_>>().join(", ")
}
