//! Options of `live`, and of its triggers.

use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgGroup, Args};
use cobscope_decoder::query::Filter;

use crate::run::arguments::{
    FailOn, InputArgs, SelectArgs, examples, parse_duration, parse_side, parse_size, part_bytes,
};
use crate::run::print::PrintArgs;
use crate::run::screen::ScreenArgs;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope live can0",
    "cobscope live --print --record run.pcapng --record-size 100M can0",
    "cobscope live --check -T 5000 pcan:USB1@500k",
];

/// Show live buses: CAN interfaces, adapters, servers, growing files
///
/// SOURCE is an interface (can0, any; with candump's filters: can0,123:7FF,400~7F0,#FFFFFFFF), a serial
/// adapter (slcan:/dev/ttyACM0@500k), an adapter of PEAK (pcan:USB1@500k) or Kvaser (kvaser:0@500k) with its
/// installed driver, a gs_usb adapter such as candleLight or CANable 2 (gs_usb:@500k, gs_usb:SERIAL@500k), a bus of a server (socketcand://host/can0), - for candump text on stdin (ssh machine
/// candump -L any | cobscope live -), or a growing file with --follow. Without SOURCE the interfaces and
/// adapters of this computer are listed. No frame is ever transmitted. Adapters are opened in listen-only mode, or
/// refused. A CAN interface keeps the mode that the system has set, and a server decides about its own; in normal
/// mode they acknowledge frames.
#[derive(Debug, Args)]
#[command(
    mut_arg("captures", |arg| arg.value_name("SOURCE").help("Bus or file to show")),
    mut_arg("separate", |arg| arg.hide(true)),
    mut_arg("join", |arg| arg.hide(true)),
    mut_arg("part_gap", |arg| arg.hide(true)),
    after_help = EXAMPLES
)]
pub struct LiveArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Print events instead of showing them in the terminal UI
    #[arg(long)]
    pub print: bool,
    #[command(flatten)]
    pub lines: PrintArgs,
    /// Run rules, print findings and a summary as check does; exit with 1 for findings at or above --fail-on
    #[arg(long)]
    pub check: bool,
    /// Exit with status 1 for findings at or above SEVERITY
    #[arg(long, value_name = "SEVERITY", default_value = "error", requires = "check")]
    pub fail_on: FailOn,
    /// Stop at the first finding at or above --fail-on
    ///
    /// No later frame is decoded, counted or judged, except those of an open window of --trigger. --record can contain
    /// later frames.
    #[arg(long, requires = "check")]
    pub until_finding: bool,
    /// Stop after N frames (default: never)
    #[arg(short = 'n', value_name = "N")]
    pub frames_wanted: Option<u64>,
    /// Stop after MS milliseconds without a frame (default: never)
    #[arg(short = 'T', value_name = "MS", value_parser = clap::value_parser!(u64).range(1..))]
    pub timeout: Option<u64>,
    /// Record to FILE in the format of its suffix: .log, .pcapng, .mcap, …
    ///
    /// Without FILE, or if FILE is a folder, the file is named candump-DATE_TIME.log. With --trigger, FILE is a
    /// folder for the captures around triggers; it is created if its parent folder exists. - for stdout and a pipe
    /// receive pcapng as the frames come, without panes or text.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = ".")]
    pub record: Option<PathBuf>,
    /// Start a new file at SIZE bytes: 64k or more, 100M, 2G (k, M and G are powers of 1,024)
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = part_bytes)]
    pub record_size: Option<u64>,
    /// Start a new file after TIME: 90s, 10min, 1h
    #[arg(long, value_name = "TIME", requires = "record", value_parser = parse_duration)]
    pub record_time: Option<Duration>,
    /// Keep only the newest N files
    #[arg(long, value_name = "N", requires = "record")]
    pub record_files: Option<u32>,
    #[command(flatten)]
    pub triggers: TriggerArgs,
    /// Read files to their end and wait for appended data: candump text, TRC, ASC, CSV, pcapng, MCAP
    #[arg(long)]
    pub follow: bool,
    /// Keep up to SIZE bytes of data in the terminal UI; older frames are dropped with a note (k, M, G: powers of 1,024)
    #[arg(long, value_name = "SIZE", default_value = "2G", value_parser = parse_size)]
    pub keep: u64,
    #[command(flatten)]
    pub screen: ScreenArgs,
}

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
