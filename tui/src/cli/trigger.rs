//! Options of `live --trigger`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgGroup, Args};
use cobscope_decoder::query::Filter;

use super::duration::parse_side;
use super::size::{parse_size, part_bytes};

/// Heading of the options in the help.
const HEADING: &str = "Captures around triggers";

/// Long help of `--trigger`.
const TRIGGER_HELP: &str = "\
Record the frames around each event that matches EXPR, into the folder of --record (repeatable)

EXPR is an expression of decode --filter. Each trigger writes one capture in pcapng with the frames from --before \
until --after, to the frame: both bounds are inclusive, and the timestamps of the frames decide. --before counts from \
the first frame of the event or finding, or of the finding that caused it. Overlapping windows become one capture. Its \
name contains time, node and cause of its first trigger; comments name each trigger at its frame. A bus file next to it \
(.toml) contains the state at its first frame: decode --bus NAME.toml NAME.pcapng prints the values of the live bus.

A line is printed per trigger and per complete capture, with -f jsonl as JSON. --print adds events, --check findings and \
their report. No terminal UI is opened.

Frames wait in a ring in memory. It keeps one minute more than --before, up to --ring-size. A crash or power cut loses \
the ring, and at most the last second of a capture whose window is open. With --ring-files the ring is also in files, from \
which --before reaches further back, and at most the last second of all frames is lost. This writes about 60 bytes per \
frame: 60 kB/s at 1,000 frames/s; without it, only captures are written.

A capture is complete when no later window can overlap with it: --before and --after later than its last trigger. Ctrl-C \
completes it at once.";

/// Captures around triggers.
#[derive(Debug, Default, Args)]
#[command(group = ArgGroup::new("causes").args(["trigger", "trigger_finding"]).multiple(true))]
pub struct TriggerArgs {
    /// Record the frames around each event that matches EXPR, into the folder of --record (repeatable)
    #[arg(long, help_heading = HEADING, value_name = "EXPR", long_help = TRIGGER_HELP,
        requires = "record", conflicts_with_all = ["record_size", "record_time", "record_files"])]
    pub trigger: Vec<Filter>,
    /// Record the frames around each finding of RULE, such as guard-late (repeatable, or separated by commas)
    #[arg(long, help_heading = HEADING, value_name = "RULE", value_delimiter = ',',
        requires = "record", conflicts_with_all = ["record_size", "record_time", "record_files"])]
    pub trigger_finding: Vec<String>,
    /// Start each capture TIME before the first frame of its trigger: 500ms, 30s, 5min
    #[arg(long, help_heading = HEADING, value_name = "TIME", default_value = "30s", requires = "causes", value_parser = parse_side)]
    pub before: Duration,
    /// End each capture TIME after its last trigger
    #[arg(long, help_heading = HEADING, value_name = "TIME", default_value = "10s", requires = "causes", value_parser = parse_side)]
    pub after: Duration,
    /// Keep up to SIZE bytes of frames in memory (k, M and G are powers of 1,024)
    #[arg(long, help_heading = HEADING, value_name = "SIZE", default_value = "256M", requires = "causes", value_parser = part_bytes)]
    pub ring_size: u64,
    /// Also write the ring to files of up to SIZE bytes in total (k, M, G: powers of 1,024), which are removed at the end
    ///
    /// --before then reaches back as far as these files. After a crash or power cut they contain the frames up to the last
    /// second: ring-DATE_TIME-0001.pcapng, …
    #[arg(long, help_heading = HEADING, value_name = "SIZE", requires = "causes", value_parser = part_bytes)]
    pub ring_files: Option<u64>,
    /// Write at most N captures; later triggers are only printed
    #[arg(long, help_heading = HEADING, value_name = "N", default_value_t = 100, requires = "causes")]
    pub trigger_files: u32,
    /// Write captures of at most SIZE bytes in total (k, M, G: powers of 1,024); later triggers are only printed
    #[arg(long, help_heading = HEADING, value_name = "SIZE", default_value = "1G", requires = "causes", value_parser = parse_size)]
    pub trigger_size: u64,
    /// Run PROGRAM with the name of each complete capture as its only argument
    ///
    /// PROGRAM is a path, or a name in PATH. It runs without a shell and without input; its output appears on stderr.
    /// Recording does not wait for it, and a failure is reported. Runs follow one after the other.
    #[arg(long, help_heading = HEADING, value_name = "PROGRAM", requires = "causes")]
    pub on_trigger: Option<PathBuf>,
}

impl TriggerArgs {
    /// Whether there is a trigger.
    pub fn is_any(&self) -> bool {
        !self.trigger.is_empty() || !self.trigger_finding.is_empty()
    }
}
