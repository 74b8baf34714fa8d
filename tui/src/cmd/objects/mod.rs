//! `cobscope objects`: object values of nodes, with their origin.

mod entry;
mod want;

use std::borrow::Cow;
use std::fmt::Write as _;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::objects::{ObjectCount, ObjectRecord};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::{Persistence, Value};
use cobscope_decoder::session::{Bus, Buses, Entry, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::words::plural;

use super::decoding::{CaptureJob, report};
use super::messages::complain;
use crate::cli::{ObjectsArgs, ReportFormat};
use crate::exit_code::Exit;
use crate::select::TimeLimit;
use crate::words::present;
use entry::{label, place};
use want::Want;

/// Maximum widths of the name and value columns; most lines then fit 100 columns.
const WIDEST_NAME: usize = 50;
const WIDEST_VALUE: usize = 24;

/// Maximum number of bytes printed per value.
const SHOWN_BYTES: usize = 16;

/// Runs the command.
pub fn run(arguments: &ObjectsArgs) -> Exit {
    let want = match arguments.want.as_deref().map(|path| Want::new(path, arguments)).transpose() {
        Ok(want) => want,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let several = arguments.input.captures.len() > 1;
    report(&arguments.input, |series, options, output| {
        let job = CaptureJob::new(series, &arguments.input, options, None);
        let until = TimeLimit::new(arguments.at, None);
        let read = job.read_from(until, |until, first, span| until.begin(first, span))?;
        let name = series.name();
        read.report();
        let (until, buses) = (&read.summary.part, read.summary.buses());
        if several
            && !series.is_joined_from(&arguments.input.captures)
            && arguments.format == ReportFormat::Text
        {
            let _ = writeln!(output, "== {}", escape(&name));
        }
        if let Some(want) = &want {
            want.compare(buses, until.first(), &name, output);
        } else {
            for bus in buses {
                print_bus(bus, arguments, until.first(), &name, output);
            }
        }
        // A node of `--node` is reported for every command.
        let of_file = want.as_ref().filter(|_| arguments.input.node.is_empty()).map(Want::chosen);
        let absent = of_file.and_then(|chosen| absent(buses, chosen, until.passed().as_deref()));
        if let Some(absent) = absent {
            complain(&anyhow::anyhow!("{name}: {absent}"));
        }
        Ok(read.failure)
    })
}

/// Prints the chosen node, or an overview of all nodes, of one bus.
fn print_bus(
    bus: &Bus,
    arguments: &ObjectsArgs,
    first: Option<Timestamp>,
    capture: &str,
    output: &mut String,
) {
    let nodes = bus.nodes().filter(|node| !node.store().is_empty());
    let Some(wanted) = arguments.input.node.iter().find(|node| node.profile.is_none()) else {
        for node in nodes {
            overview(bus, node, arguments.format, capture, output);
        }
        return;
    };
    if wanted.bus.as_deref().is_some_and(|name| name != bus.name()) {
        return;
    }
    let Some(node) = bus.node(wanted.id) else { return };
    if arguments.format == ReportFormat::Text {
        let _ = writeln!(output, "{}: {}", label(bus, node), plural(node.store().len(), "object"));
    }
    if arguments.format == ReportFormat::Text {
        return table(node, first, output);
    }
    for object in node.store().sorted() {
        output.push_str(&format_line(&ObjectRecord::new((bus, node), object, capture)));
    }
}

fn overview(bus: &Bus, node: &Node, format: ReportFormat, capture: &str, output: &mut String) {
    match format {
        ReportFormat::Text => {
            let count = plural(node.store().len(), "object");
            let _ = writeln!(output, "{}: {count} (--node {})", label(bus, node), node.id());
        }
        ReportFormat::Json => output.push_str(&format_line(&ObjectCount::new(bus, node, capture))),
    }
}

/// Prints all objects in columns; long names and values are truncated.
fn table(node: &Node, first: Option<Timestamp>, output: &mut String) {
    let row = |(object, entry)| Row::of(node, object, entry);
    let rows: Vec<_> = node.store().sorted().into_iter().map(row).collect();
    let names = rows.iter().map(|row| column(&row.name, WIDEST_NAME)).max().unwrap_or_default();
    let values = rows.iter().map(|row| column(&row.value, WIDEST_VALUE)).max().unwrap_or_default();
    for row in &rows {
        let (name, value) = (cut(&row.name, names), cut(&row.value, values));
        let line = format!(
            "{}  {name:<names$}  {value:<values$}  {:<7}{}  {}{}",
            row.object,
            row.entry.origin.kind.verb(),
            place(row.entry, first),
            data(row.entry),
            future(node, row.object),
        );
        let _ = writeln!(output, "{}", line.trim_end());
    }
}

/// One object with escaped texts.
struct Row<'a> {
    object: ObjectAddress,
    name: String,
    value: String,
    entry: &'a Entry,
}

impl<'a> Row<'a> {
    fn of(node: &Node, object: ObjectAddress, entry: &'a Entry) -> Self {
        let known = node.meaning(object);
        let value = match known.as_ref().map(|known| (known, known.decode(&entry.value))) {
            Some((_, Value::Bytes(_))) | None => String::new(),
            Some((known, value)) => known.show(&value),
        };
        let stale = if entry.stale { "?" } else { "" };
        let name = known.as_ref().map_or(String::new(), |known| escape(&known.name).into_owned());
        Self { object, name, value: format!("{}{stale}", escape(&value)), entry }
    }
}

/// Width of a cell, limited to `most`.
fn column(cell: &str, most: usize) -> usize {
    cell.chars().count().min(most)
}

/// A cell truncated to `width`.
fn cut(cell: &str, width: usize) -> Cow<'_, str> {
    if cell.chars().count() <= width {
        return cell.into();
    }
    let mut cut: String = cell.chars().take(width.saturating_sub(1)).collect();
    cut.push('…');
    cut.into()
}

/// Bytes of a value, truncated if there are many.
fn data(entry: &Entry) -> String {
    let shown = entry.value.get(..SHOWN_BYTES).unwrap_or(&entry.value);
    let data = Value::Bytes(shown.to_vec());
    if entry.size > shown.len() as u64 {
        format!("{data} … {}", plural(entry.size, "byte"))
    } else {
        data.to_string()
    }
}

/// Pending new value and storage of an object.
fn future(node: &Node, object: ObjectAddress) -> String {
    let waiting = node.store().waiting(object).map_or(String::new(), |waiting| {
        let meaning = node.meaning(object);
        let shown = meaning.map_or_else(
            || Value::Bytes(waiting.value.clone()).to_string(),
            |meaning| meaning.show(&meaning.decode(&waiting.value)),
        );
        format!("  → {} {}{}", escape(&shown), waiting.effect.when(), waiting.origin.place())
    });
    let persists = match node.persists(object) {
        Some(Persistence::No) => "  lost at a restart",
        Some(Persistence::NotStored) => "  not stored",
        _ => "",
    };
    format!("{waiting}{persists}")
}

/// Message if the chosen node is not present; `None` for an unknown bus, which was already reported.
fn absent(buses: Buses<'_>, (bus, node): (Option<&str>, NodeId), end: Option<&str>) -> Option<String> {
    let is_meant = |own: &&Bus| bus.is_none_or(|name| name == own.name());
    let is_present = |node: &Node| node.last_seen().0 > 0 || node.was_present() || !node.store().is_empty();
    let is_there = buses.iter().filter(is_meant).any(|bus| bus.node(node).is_some_and(is_present));
    if is_there || !buses.iter().any(|bus| is_meant(&bus)) {
        return None;
    }
    let end = end.map_or_else(String::new, |end| format!(" up to {end}"));
    let present = present(buses);
    Some(format!("{} not present{end}; nodes present: {present}", node.words()))
}
