//! `cobscope objects`: object values of nodes, with their origin.

mod arguments;
mod entry;
mod want;

use std::borrow::Cow;
use std::fmt::Write as _;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::objects::{ObjectCount, ObjectRecord};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::{DecodedValue, Persistence};
use cobscope_decoder::session::{Bus, Buses, Node, StoredObject};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::words::count_noun;

use crate::exit_code::ExitStatus;
use crate::run::arguments::ReportFormat;
use crate::run::capture_job::{CaptureJob, report};
use crate::run::messages::print_error;
use crate::select::TimeLimit;
use crate::words::present_nodes;
pub use arguments::ObjectsArgs;
use entry::{node_label, value_place};
use want::ExpectedValues;

/// Maximum widths of the name and value columns; most lines then fit 100 columns.
const WIDEST_NAME: usize = 50;
const WIDEST_VALUE: usize = 24;

/// Maximum number of bytes printed per value.
const SHOWN_BYTES: usize = 16;

/// Runs the command.
pub fn run(arguments: &ObjectsArgs) -> ExitStatus {
    let want = match arguments.want.as_deref().map(|path| ExpectedValues::new(path, arguments)).transpose() {
        Ok(want) => want,
        Err(error) => {
            print_error(&error);
            return ExitStatus::Profile;
        }
    };
    let several = arguments.input.captures.len() > 1;
    report(&arguments.input, |series, options, output| {
        let job = CaptureJob::new(series, &arguments.input, options, None);
        let until = TimeLimit::new(arguments.at, None);
        let read = job.read_from(until, |until, first, span| until.begin_capture(first, span))?;
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
            want.compare_nodes(buses, until.first_time(), &name, output);
        } else {
            for bus in buses {
                print_bus(bus, arguments, until.first_time(), &name, output);
            }
        }
        // A node of `--node` is reported for every command.
        let of_file =
            want.as_ref().filter(|_| arguments.input.node.is_empty()).map(ExpectedValues::chosen_node);
        let absent = of_file.and_then(|chosen| absent_node(buses, chosen, until.passed_bound().as_deref()));
        if let Some(absent) = absent {
            print_error(&anyhow::anyhow!("{name}: {absent}"));
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
            node_overview(bus, node, arguments.format, capture, output);
        }
        return;
    };
    if wanted.bus.as_deref().is_some_and(|name| name != bus.name()) {
        return;
    }
    let Some(node) = bus.node(wanted.id) else { return };
    if arguments.format == ReportFormat::Text {
        let _ = writeln!(output, "{}: {}", node_label(bus, node), count_noun(node.store().len(), "object"));
    }
    if arguments.format == ReportFormat::Text {
        return object_table(node, first, output);
    }
    for object in node.store().sorted() {
        output.push_str(&format_line(&ObjectRecord::new((bus, node), object, capture)));
    }
}

fn node_overview(bus: &Bus, node: &Node, format: ReportFormat, capture: &str, output: &mut String) {
    match format {
        ReportFormat::Text => {
            let count = count_noun(node.store().len(), "object");
            let _ = writeln!(output, "{}: {count} (--node {})", node_label(bus, node), node.id());
        }
        ReportFormat::Json => output.push_str(&format_line(&ObjectCount::new(bus, node, capture))),
    }
}

/// Prints all objects in columns; long names and values are truncated.
fn object_table(node: &Node, first: Option<Timestamp>, output: &mut String) {
    let row = |(object, entry)| ObjectLine::row_of(node, object, entry);
    let rows: Vec<_> = node.store().sorted().into_iter().map(row).collect();
    let names = rows.iter().map(|row| column_width(&row.name, WIDEST_NAME)).max().unwrap_or_default();
    let values = rows.iter().map(|row| column_width(&row.value, WIDEST_VALUE)).max().unwrap_or_default();
    for row in &rows {
        let (name, value) = (cut_cell(&row.name, names), cut_cell(&row.value, values));
        let line = format!(
            "{}  {name:<names$}  {value:<values$}  {:<7}{}  {}{}",
            row.object,
            row.entry.origin.kind.origin_text(),
            value_place(row.entry, first),
            value_bytes(row.entry),
            pending_value(node, row.object),
        );
        let _ = writeln!(output, "{}", line.trim_end());
    }
}

/// One object with escaped texts.
struct ObjectLine<'a> {
    object: ObjectAddress,
    name: String,
    value: String,
    entry: &'a StoredObject,
}

impl<'a> ObjectLine<'a> {
    fn row_of(node: &Node, object: ObjectAddress, entry: &'a StoredObject) -> Self {
        let known = node.meaning(object);
        let value = match known.as_ref().map(|known| (known, known.decode(&entry.value))) {
            Some((_, DecodedValue::Bytes(_))) | None => String::new(),
            Some((known, value)) => known.format_value(&value),
        };
        let stale = if entry.stale { "?" } else { "" };
        let name = known.as_ref().map_or(String::new(), |known| escape(&known.name).into_owned());
        Self { object, name, value: format!("{}{stale}", escape(&value)), entry }
    }
}

/// Width of a cell, limited to `most`.
fn column_width(cell: &str, most: usize) -> usize {
    cell.chars().count().min(most)
}

/// A cell truncated to `width`.
fn cut_cell(cell: &str, width: usize) -> Cow<'_, str> {
    if cell.chars().count() <= width {
        return cell.into();
    }
    let mut cut: String = cell.chars().take(width.saturating_sub(1)).collect();
    cut.push('…');
    cut.into()
}

/// Bytes of a value, truncated if there are many.
fn value_bytes(entry: &StoredObject) -> String {
    let shown = entry.value.get(..SHOWN_BYTES).unwrap_or(&entry.value);
    let data = DecodedValue::Bytes(shown.to_vec());
    if entry.size > shown.len() as u64 {
        format!("{data} … {}", count_noun(entry.size, "byte"))
    } else {
        data.to_string()
    }
}

/// Pending new value and storage of an object.
fn pending_value(node: &Node, object: ObjectAddress) -> String {
    let waiting = node.store().waiting_value(object).map_or(String::new(), |waiting| {
        let meaning = node.meaning(object);
        let shown = meaning.map_or_else(
            || DecodedValue::Bytes(waiting.value.clone()).to_string(),
            |meaning| meaning.format_value(&meaning.decode(&waiting.value)),
        );
        format!("  → {} {}{}", escape(&shown), waiting.effect.time_text(), waiting.origin.origin_place())
    });
    let persists = match node.persistence_text(object) {
        Some(Persistence::No) => "  lost at a restart",
        Some(Persistence::NotStored) => "  not stored",
        _ => "",
    };
    format!("{waiting}{persists}")
}

/// Message if the chosen node is not present; `None` for an unknown bus, which was already reported.
fn absent_node(buses: Buses<'_>, (bus, node): (Option<&str>, NodeId), end: Option<&str>) -> Option<String> {
    let is_meant = |own: &&Bus| bus.is_none_or(|name| name == own.name());
    let is_present = |node: &Node| node.last_seen().0 > 0 || node.was_present() || !node.store().is_empty();
    let is_there = buses.iter().filter(is_meant).any(|bus| bus.node(node).is_some_and(is_present));
    if is_there || !buses.iter().any(|bus| is_meant(&bus)) {
        return None;
    }
    let end = end.map_or_else(String::new, |end| format!(" up to {end}"));
    let present = present_nodes(buses);
    Some(format!("{} not present{end}; nodes present: {present}", node.sentence_label()))
}
