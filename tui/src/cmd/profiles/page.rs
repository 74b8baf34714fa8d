//! A profile as text: `cobscope profiles show`.

use std::fmt::Write as _;

use cobscope_decoder::profile::DeviceProfile;
use cobscope_decoder::profile::device::{
    AbortText, DeviceErrorCode, DeviceProcedure, DeviceRule, DeviceTroubleCode, Gate, MaskedWord,
    MessageSpec, PdoSpec, StateMachine, UdsIdentifier, UdsNrc,
};
use cobscope_decoder::sink::escape;

use crate::run::describe::network::{self, NetworkProperty};
use crate::run::describe::{behaviour, fold_text, j1939, object, section_text as cite, uds};

/// The complete profile, one line per entry.
pub(super) fn profile_page(device: &DeviceProfile) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{}  {}", escape(&device.full_id), escape(&device.title));
    let what = [&device.vendor, &device.description].map(String::as_str);
    let what = what.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(": ");
    for (first, line) in [("", &what), ("source: ", &device.source), ("note: ", &device.note)] {
        if !line.is_empty() {
            fold_text(&mut text, first, line, first.len());
        }
    }
    push_section(
        &mut text,
        "Variants",
        device.variants.iter().map(|it| format!("{:<12} {}", it.id, it.title)),
    );
    push_section(&mut text, "Network", network::network_facts(device).iter().map(fact_line));
    push_section(&mut text, "PDOs", device.pdos.iter().map(|it| pdo_line(device, it)));
    let messages = device.messages.iter().map(|it| message_line(device, it));
    push_section(&mut text, "J1939 messages", messages);
    for machine in behaviour::first_machines(device) {
        let title = format!("State machine \"{}\"{}", machine.name, behaviour::channels_text(device));
        push_section(&mut text, &title, machine_lines(machine));
    }
    push_section(
        &mut text,
        "Gates of set points",
        behaviour::first_gates(device).map(|it| gate_line(device, it)),
    );
    push_section(&mut text, "Procedures", device.procedures.iter().map(|it| procedure_line(device, it)));
    push_section(&mut text, "EMCY codes", device.emcy.code.iter().map(emcy_line));
    push_section(&mut text, "J1939 faults (SPN/FMI)", device.j1939.dtc.iter().map(dtc_line));
    push_section(&mut text, "SDO abort codes", device.aborts.iter().map(abort_line));
    push_section(&mut text, "UDS identifiers", device.uds.identifier.iter().map(|it| uds_line(it.get_ref())));
    push_section(&mut text, "UDS negative responses", device.uds.nrc.iter().map(nrc_line));
    push_section(&mut text, "Rules", group_rules(&device.rules).into_iter().map(rule_line));
    let waivers =
        device.waivers.iter().map(|it| format!("{}: {}  {}", it.rule.get_ref(), it.text, cite(&it.source)));
    push_section(&mut text, "Waived rules", waivers);
    let entries =
        device.dictionary.own_objects().iter().flat_map(|it| it.entries.iter().map(move |entry| (it, entry)));
    push_section(
        &mut text,
        "Objects",
        entries.flat_map(|(it, entry)| object::entry_lines(device, it, entry, None)),
    );
    text
}

fn push_section(text: &mut String, title: &str, lines: impl IntoIterator<Item = String>) {
    let mut lines = lines.into_iter().peekable();
    if lines.peek().is_none() {
        return;
    }
    let _ = writeln!(text, "\n{title}");
    for line in lines {
        let shown = line.trim_start();
        let indent = line.len() - shown.len() + 2;
        fold_text(text, &" ".repeat(indent), shown, indent + 4);
    }
}

fn fact_line(fact: &NetworkProperty) -> String {
    format!("{}: {}  {}", fact.heading, fact.text, cite(&fact.source))
}

fn pdo_line(device: &DeviceProfile, pdo: &PdoSpec) -> String {
    let (name, contents) = (behaviour::pdo_name(device, pdo), behaviour::pdo_contents(device, pdo));
    format!("{name}: {contents}  {}", cite(&pdo.source))
}

fn message_line(device: &DeviceProfile, message: &MessageSpec) -> String {
    let (name, contents) = (j1939::message_name(message), j1939::message_contents(device, message));
    format!("{name}: {contents}  {}", cite(&message.source))
}

fn dtc_line(dtc: &DeviceTroubleCode) -> String {
    format!("{}  {}  {}", j1939::dtc_code(dtc), j1939::dtc_text(dtc), cite(&dtc.source))
}

fn machine_lines(machine: &StateMachine) -> Vec<String> {
    let word =
        |part: &str, word: MaskedWord| format!("{part} in {}, bits {:02X}", word.object.object, word.mask);
    let head = format!(
        "{}; {}  {}",
        word("state", machine.status),
        word("commands", machine.control),
        cite(&machine.source)
    );
    let states = machine.states.iter().map(|state| {
        let word = behaviour::state_word(state);
        let word = if word.is_empty() { String::new() } else { format!(", {word}") };
        format!("{}: {}{word}", behaviour::state_bits(machine, state), state.name)
    });
    let transitions = machine.transitions.iter().map(behaviour::transition_text);
    std::iter::once(head)
        .chain(states)
        .chain(transitions)
        .chain(behaviour::forced_transitions(machine))
        .collect()
}

fn gate_line(device: &DeviceProfile, gate: &Gate) -> String {
    let of = behaviour::gate_for(device, gate);
    let of = if of.is_empty() { of } else { format!(" ({of})") };
    let text = if gate.text.is_empty() { String::new() } else { format!("; {}", gate.text) };
    format!("{}{of}: {}{text}  {}", gate.name, behaviour::gate_open(device, gate), cite(&gate.source))
}

fn procedure_line(device: &DeviceProfile, procedure: &DeviceProcedure) -> String {
    let facts = behaviour::procedure_facts(device, procedure).join("; ");
    format!("{}: {facts}  {}", procedure.name, cite(&procedure.source))
}

fn emcy_line(error: &DeviceErrorCode) -> String {
    let register = error.register.filter(|register| *register != 0);
    let register = register.map(|register| format!(", register {}", behaviour::register_text(register)));
    let reaction = behaviour::reaction_text(error);
    let reaction = if reaction.is_empty() { reaction } else { format!(" → {reaction}") };
    format!(
        "{:04X}  {}{}{reaction}  {}",
        error.code,
        error.text,
        register.unwrap_or_default(),
        cite(&error.source)
    )
}

fn abort_line(abort: &AbortText) -> String {
    let objects: Vec<_> = abort.objects.iter().map(ToString::to_string).collect();
    let of = if objects.is_empty() { String::new() } else { format!(" (of {})", objects.join(", ")) };
    format!("{:08X}  {}{of}  {}", abort.code, abort.text, cite(&abort.source))
}

fn uds_line(identifier: &UdsIdentifier) -> String {
    let note = if identifier.note.is_empty() { String::new() } else { format!("; {}", identifier.note) };
    let what = uds::identifier_text(identifier);
    format!("{:04X}  {}: {what}{note}  {}", identifier.id, identifier.name, cite(&identifier.source))
}

fn nrc_line(nrc: &UdsNrc) -> String {
    let of = uds::scope_text(nrc);
    let of = if of.is_empty() { of } else { format!(" (of {of})") };
    format!("{:02X}  {}{of}  {}", nrc.code, nrc.text, cite(&nrc.source))
}

fn rule_line((name, rule): (String, &DeviceRule)) -> String {
    format!("{name}: {}  ({})  {}", rule.text, rule.severity.name(), cite(&rule.source))
}

/// Rules by name; adjacent rules that differ only in a number are merged.
pub(super) fn group_rules(rules: &[DeviceRule]) -> Vec<(String, &DeviceRule)> {
    let mut groups: Vec<(String, &DeviceRule, Vec<u32>)> = Vec::new();
    for rule in rules {
        let (pattern, number) = name_pattern(&rule.name);
        let alike = |(known, first, _): &&mut (String, &DeviceRule, Vec<u32>)| {
            let same =
                (&first.text, first.severity, &first.source) == (&rule.text, rule.severity, &rule.source);
            *known == pattern && same
        };
        match groups.last_mut().filter(alike) {
            Some((.., numbers)) => numbers.extend(number),
            None => groups.push((pattern, rule, number.into_iter().collect())),
        }
    }
    groups
        .into_iter()
        .map(|(pattern, rule, numbers)| (pattern.replace('#', &number_list(&numbers)), rule))
        .collect()
}

/// A name with `#` instead of its number, and the number; `None` if it contains no or different numbers.
fn name_pattern(name: &str) -> (String, Option<u32>) {
    let mut numbers: Vec<u32> =
        name.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect();
    numbers.dedup();
    let &[number] = numbers.as_slice() else { return (name.to_owned(), None) };
    (name.replace(&number.to_string(), "#"), Some(number))
}

/// `1…8`, `1,3,4`.
fn number_list(numbers: &[u32]) -> String {
    let (first, last) = (numbers.first().copied().unwrap_or(0), numbers.last().copied().unwrap_or(0));
    if numbers.len() > 2 && (first..=last).eq(numbers.iter().copied()) {
        return format!("{first}…{last}");
    }
    numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(",")
}
