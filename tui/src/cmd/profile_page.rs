//! A device as a page of text: `cobscope profiles show`.

use std::fmt::Write as _;

use cobscope_decoder::profile::Device;
use cobscope_decoder::profile::device::{Gate, Machine, PdoSpec, Procedure};
use cobscope_decoder::profile::{NothingKnown, Object, Resolver};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::canopen::ObjectAddress;

/// Everything the profile says, in short.
pub(super) fn page(device: &Device) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{}  {}", device.full_id, escape(&device.title));
    let _ = writeln!(text, "{}: {}", escape(&device.vendor), escape(&device.description));
    let _ = writeln!(text, "after {}", escape(&device.source));
    section(&mut text, "Variants", device.variants.iter().map(|it| format!("{:<12} {}", it.id, it.title)));
    section(&mut text, "PDOs", device.pdos.iter().map(|pdo| pdo_line(device, pdo)));
    section(&mut text, "State machine", device.machines.first().map(machine_line).into_iter());
    section(&mut text, "Gates of set points", device.gates.iter().filter(|it| is_first(it)).map(gate_line));
    section(&mut text, "Procedures", device.procedures.iter().map(procedure_line));
    let emcy = device.emcy.code.iter().map(|it| format!("{:04X}  {}  [{}]", it.code, it.text, it.source));
    section(&mut text, "EMCY codes", emcy);
    let aborts = device.aborts.iter().map(|it| format!("{:08X}  {}  [{}]", it.code, it.text, it.source));
    section(&mut text, "SDO abort codes", aborts);
    let rules = device.rules.iter().map(|it| format!("{}: {}  [{}]", it.name, it.text, it.source));
    section(&mut text, "Statements a capture can violate", rules);
    let waivers = device.waivers.iter().map(|it| format!("{}: {}  [{}]", it.rule, it.text, it.source));
    section(&mut text, "Waived rules", waivers);
    section(&mut text, "Objects", device.dictionary.own().iter().flat_map(|it| object_lines(device, it)));
    text
}

fn section(text: &mut String, title: &str, lines: impl Iterator<Item = String>) {
    let mut lines = lines.peekable();
    if lines.peek().is_none() {
        return;
    }
    let _ = writeln!(text, "\n{title}");
    for line in lines {
        let _ = writeln!(text, "  {}", escape(&line));
    }
}

fn pdo_line(device: &Device, pdo: &PdoSpec) -> String {
    let name = |object: ObjectAddress| {
        let found = device.dictionary.find(object);
        found.map_or_else(|| object.to_string(), |found| format!("{object} {}", found.name()))
    };
    let fields: Vec<_> = pdo
        .fields
        .iter()
        .map(|field| match field.object {
            Some(object) => format!("{} ({} bit)", name(object.object), field.bits),
            None => format!("{} bit free", field.bits),
        })
        .collect();
    let when = pdo.when.as_ref().map_or(String::new(), |when| format!(" when {} fits", when.object.object));
    format!("{}{when}: {}  [{}]", pdo.pdo, fields.join(", "), pdo.source)
}

fn machine_line(machine: &Machine) -> String {
    let states: Vec<_> = machine.states.iter().map(|state| state.name.as_str()).collect();
    format!(
        "{} in {}: {}  [{}]",
        machine.name,
        machine.status.object.object,
        states.join(", "),
        machine.source
    )
}

/// Gates of further channels say the same again.
fn is_first(gate: &Gate) -> bool {
    gate.channel.is_none_or(|channel| channel == 1)
}

fn gate_line(gate: &Gate) -> String {
    let text = if gate.text.is_empty() { String::new() } else { format!(": {}", gate.text) };
    format!("{}{text}  [{}]", gate.name, gate.source)
}

fn procedure_line(procedure: &Procedure) -> String {
    let time = procedure.seconds.map_or(String::new(), |seconds| format!(", about {seconds} s"));
    format!("{}{time}  [{}]", procedure.name, procedure.source)
}

fn object_lines(device: &Device, object: &Object) -> Vec<String> {
    let repeats = match object.repeat.count {
        1 => String::new(),
        count => format!(" (× {count}, each +{:X}h)", object.repeat.stride),
    };
    let mut resolver = Resolver::new(&device.dictionary, &NothingKnown);
    let entries = object.entries.iter().filter_map(|entry| {
        let address = ObjectAddress::new(object.index, entry.sub);
        let meaning = resolver.meaning(address)?;
        let mut line = format!("{address}{repeats}  {}", meaning.name);
        if let Some(data_type) = entry.data_type {
            let _ = write!(line, ", {}", data_type.name());
        }
        if let Some(access) = entry.access {
            let _ = write!(line, " {}", access.name());
        }
        if !meaning.unit.is_empty() {
            let _ = write!(line, ", {}", meaning.unit);
        }
        let _ = write!(line, "  [{}]", entry.source);
        Some(line)
    });
    entries.collect()
}
