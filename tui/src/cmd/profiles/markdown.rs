//! A profile as Markdown: `cobscope profiles show --format markdown`.

use std::fmt::Write as _;

use cobscope_decoder::profile::DeviceProfile;
use cobscope_decoder::profile::device::UdsIdentifier;
use cobscope_decoder::sink::escape;

use super::counts::entry_counts;
use crate::run::describe::{FIRM, behaviour, j1939, network, uds};

/// The profile as tables, without its objects.
pub(super) fn profile_markdown(device: &DeviceProfile) -> String {
    let mut text = format!("## {}\n\n", escape_cell(&device.full_id));
    let (title, vendor, description) = (&device.title, &device.vendor, &device.description);
    let what = format!("{title}, {vendor}: {description}. Source: {}.", device.source);
    let _ = writeln!(text, "{}", escape_cell(&what));
    if !device.note.is_empty() {
        let _ = writeln!(text, "\nNote: {}.", escape_cell(&device.note));
    }
    let counted = entry_counts(device);
    let names: Vec<&str> = counted.iter().map(|(name, _)| *name).collect();
    let numbers = counted.iter().map(|(_, number)| number.to_string()).collect();
    text.push('\n');
    push_rows(&mut text, &names, vec![numbers]);
    let network = network::network_facts(device).into_iter();
    let network = network.map(|fact| vec![fact.heading.to_owned(), fact.text, fact.source]).collect();
    push_table(&mut text, "Network", &["property", "value", "section"], network);
    push_table(&mut text, "PDOs", &["PDO", "contents", "mapping", "section"], pdo_rows(device));
    let columns = ["message", "contents", "section"];
    push_table(&mut text, "J1939 messages", &columns, message_rows(device));
    push_states(&mut text, device);
    push_table(
        &mut text,
        "Gates",
        &["gate", "set points", "condition", "description", "section"],
        gate_rows(device),
    );
    push_table(&mut text, "Procedures", &["procedure", "detection", "section"], procedure_rows(device));
    let columns = ["code", "meaning", "register", "reaction", "check", "section"];
    push_table(&mut text, "EMCY codes", &columns, error_rows(device));
    let columns = ["SPN/FMI", "meaning", "check", "section"];
    push_table(&mut text, "J1939 faults", &columns, fault_rows(device));
    push_table(
        &mut text,
        "SDO abort codes",
        &["code", "meaning", "of objects", "section"],
        abort_rows(device),
    );
    let columns = ["identifier", "name", "description", "section"];
    push_table(&mut text, "UDS identifiers", &columns, uds_identifiers(device));
    let columns = ["code", "meaning", "applies to", "section"];
    push_table(&mut text, "UDS negative responses", &columns, uds_codes(device));
    let columns = ["name", "defect", "severity", "section"];
    push_table(&mut text, "Rules", &columns, rule_rows(device));
    push_table(&mut text, "Waived rules", &["rule", "reason", "section"], waiver_rows(device));
    text
}

/// Text escaped for a table cell.
fn escape_cell(text: &str) -> String {
    let text = escape(text).replace(FIRM, " ");
    text.replace('\\', "\\\\").replace('|', "\\|").replace('<', "&lt;").replace('*', "\\*")
}

fn push_table(text: &mut String, title: &str, columns: &[&str], lines: Vec<Vec<String>>) {
    if !lines.is_empty() {
        let _ = writeln!(text, "\n### {title}\n");
        push_rows(text, columns, lines);
    }
}

fn push_rows(text: &mut String, columns: &[&str], lines: Vec<Vec<String>>) {
    let _ = writeln!(text, "| {} |", columns.join(" | "));
    let _ = writeln!(text, "|{}", " --- |".repeat(columns.len()));
    for line in lines {
        let cells: Vec<_> = line.iter().map(|it| escape_cell(it)).collect();
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
}

fn pdo_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.pdos.iter().map(|pdo| {
        let (name, contents) = (behaviour::pdo_name(device, pdo), behaviour::pdo_contents(device, pdo));
        vec![name, contents, behaviour::mapping_name(pdo.mapping).into(), pdo.source.clone()]
    });
    rows.collect()
}

fn push_states(text: &mut String, device: &DeviceProfile) {
    for machine in behaviour::first_machines(device) {
        let title = format!("State machine \"{}\"{}", machine.name, behaviour::channels_text(device));
        let row = |state| {
            let bits = behaviour::state_bits(machine, state);
            vec![state.name.clone(), bits, behaviour::state_word(state).into()]
        };
        let states = machine.states.iter().map(row).collect();
        let (word, control) = (machine.status.object.object, machine.control.object.object);
        push_table(text, &title, &["state", &format!("status in {word}"), "kind"], states);
        let transitions = machine.transitions.iter().map(behaviour::transition_text);
        let _ = writeln!(text, "\nControl in {control}; section {}.\n", escape_cell(&machine.source));
        for line in transitions.chain(behaviour::forced_transitions(machine)) {
            let _ = writeln!(text, "- {}", escape_cell(&line));
        }
    }
}

fn gate_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = behaviour::first_gates(device).map(|gate| {
        let of = behaviour::gate_for(device, gate);
        let of = if of.is_empty() { "all".into() } else { of };
        vec![
            gate.name.clone(),
            of,
            behaviour::gate_open(device, gate),
            gate.text.clone(),
            gate.source.clone(),
        ]
    });
    rows.collect()
}

fn message_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.messages.iter().map(|message| {
        let contents = j1939::message_contents(device, message);
        vec![j1939::message_name(message), contents, message.source.clone()]
    });
    rows.collect()
}

fn fault_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.j1939.dtc.iter().map(|dtc| {
        vec![j1939::dtc_code(dtc), j1939::dtc_text(dtc), dtc.causes.join("; "), dtc.source.clone()]
    });
    rows.collect()
}

fn procedure_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.procedures.iter().map(|procedure| {
        let facts = behaviour::procedure_facts(device, procedure).join("; ");
        vec![procedure.name.clone(), facts, procedure.source.clone()]
    });
    rows.collect()
}

fn error_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.emcy.code.iter().map(|error| {
        vec![
            format!("{:04X}", error.code),
            error.text.clone(),
            error.register.map_or(String::new(), behaviour::register_text),
            behaviour::reaction_text(error),
            error.causes.join("; "),
            error.source.clone(),
        ]
    });
    rows.collect()
}

fn abort_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.aborts.iter().map(|abort| {
        let objects: Vec<_> = abort.objects.iter().map(ToString::to_string).collect();
        vec![format!("{:08X}", abort.code), abort.text.clone(), objects.join(", "), abort.source.clone()]
    });
    rows.collect()
}

fn uds_identifiers(device: &DeviceProfile) -> Vec<Vec<String>> {
    let row = |it: &UdsIdentifier| {
        vec![format!("{:04X}", it.id), it.name.clone(), uds::identifier_text(it), it.source.clone()]
    };
    device.uds.identifier.iter().map(|it| row(it.get_ref())).collect()
}

fn uds_codes(device: &DeviceProfile) -> Vec<Vec<String>> {
    let rows = device.uds.nrc.iter();
    rows.map(|it| vec![format!("{:02X}", it.code), it.text.clone(), uds::scope_text(it), it.source.clone()])
        .collect()
}

fn rule_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    super::page::group_rules(&device.rules)
        .into_iter()
        .map(|(name, rule)| vec![name, rule.text.clone(), rule.severity.name().into(), rule.source.clone()])
        .collect()
}

fn waiver_rows(device: &DeviceProfile) -> Vec<Vec<String>> {
    device
        .waivers
        .iter()
        .map(|it| vec![it.rule.get_ref().clone(), it.text.clone(), it.source.clone()])
        .collect()
}
