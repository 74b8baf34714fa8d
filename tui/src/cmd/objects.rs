//! `cobscope objects`: object values of nodes, with their origin.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::objects::{ExpectedValues, ObjectCount, ObjectRecord, text};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::device_file::DescriptionKind;
use cobscope_decoder::session::{Bus, Buses, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::count_noun;

use crate::exit_code::ExitStatus;
use crate::path_text::path_text;
use crate::run::arguments::{InputArgs, NODE_HELP, ReportFormat, examples};
use crate::run::capture_job::{CaptureJob, report};
use crate::run::input::device_files;
use crate::run::messages::print_error;
use crate::select::{RangeBound, TimeLimit};
use crate::words::present_nodes;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope objects customer.log",
    "cobscope objects --node 5 --at 12.5 customer.log",
    "cobscope objects --node 5 --want pump.dcf customer.log",
];

/// Print the object values of nodes, with their origin
///
/// Without --node, the nodes with known objects are listed. --node 5 selects the node; --node 5=PROFILE
/// assigns its profile. They can be combined. Long names and values are truncated; -f json contains them
/// completely.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
pub struct ObjectsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Print values at TIME: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date, or
    /// both (default: end)
    #[arg(long, value_name = "TIME")]
    pub at: Option<RangeBound>,
    /// Compare with the values that a DCF or XDC configures for --node, or for the node of the file
    #[arg(long, value_name = "FILE")]
    pub want: Option<PathBuf>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

/// Runs the command.
pub fn run(arguments: &ObjectsArgs) -> ExitStatus {
    let want = match arguments.want.as_deref().map(|path| read_expected(path, arguments)).transpose() {
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
            match arguments.format {
                ReportFormat::Text => want.write_text(buses, until.first_time(), output),
                ReportFormat::Json => {
                    want.records(buses, &name).for_each(|record| output.push_str(&format_line(&record)));
                }
            }
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

/// Expected values of the node of the command line, else of the node of the file.
///
/// # Errors
/// If the file is unreadable or contains no values, or if the node is unknown.
fn read_expected(path: &Path, arguments: &ObjectsArgs) -> anyhow::Result<ExpectedValues> {
    let shown = path_text(path);
    let file = device_files::read_device_file(path)?;
    let wants = file.objects.iter().any(|object| object.value.is_some());
    let why = match file.kind {
        DescriptionKind::Eds | DescriptionKind::Xdd => "EDS and XDD files have no values; use a DCF or XDC",
        DescriptionKind::Dcf => "no ParameterValue",
        DescriptionKind::Xdc => "no actualValue",
    };
    anyhow::ensure!(wants, "{shown}: no values to compare: {why}");
    let chosen = arguments.input.node.iter().find(|node| node.profile.is_none());
    let Some(node) = chosen.map(|node| node.id).or(file.node_id.map(NodeId::Canopen)) else {
        anyhow::bail!("{shown}: no node-ID in the file; add --node");
    };
    Ok(ExpectedValues {
        name: device_files::file_name(path),
        bus: chosen.and_then(|node| node.bus.clone()),
        node,
        file,
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
        let _ =
            writeln!(output, "{}: {}", text::node_label(bus, node), count_noun(node.store().len(), "object"));
    }
    if arguments.format == ReportFormat::Text {
        return text::write_table(node, first, output);
    }
    for object in node.store().sorted() {
        output.push_str(&format_line(&ObjectRecord::new((bus, node), object, capture)));
    }
}

fn node_overview(bus: &Bus, node: &Node, format: ReportFormat, capture: &str, output: &mut String) {
    match format {
        ReportFormat::Text => {
            let count = count_noun(node.store().len(), "object");
            let _ = writeln!(output, "{}: {count} (--node {})", text::node_label(bus, node), node.id());
        }
        ReportFormat::Json => output.push_str(&format_line(&ObjectCount::new(bus, node, capture))),
    }
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
