//! `cobscope decode`, and how events are printed.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use cobscope_decoder::sink::{EVENT_FORMATS, EventFormat};

use super::{Color, InputArgs, SelectArgs};

/// `cobscope decode`.
#[derive(Debug, Args)]
pub struct DecodeArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    #[command(flatten)]
    pub print: PrintArgs,
}

/// How events are printed.
#[derive(Debug, Args)]
pub struct PrintArgs {
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text", value_parser = formats())]
    pub format: PrintFormat,
    /// Write to FILE instead of standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Which PDOs, J1939 messages and frames a DBC describes to print: those that say something new, all or
    /// none (default: change for text, all for others)
    #[arg(long, value_name = "WHICH")]
    pub pdo: Option<Pdo>,
    /// Print repetitions too: heartbeats, SYNC, guarding (text; other formats always have them)
    #[arg(long)]
    pub all: bool,
    /// Print frames too that no protocol explains
    #[arg(long)]
    pub frames: bool,
    /// Print everything known of each event, on further lines (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Time column: a(bsolute), d(elta), z(ero: since the first frame), A (date, UTC) (text)
    #[arg(short = 't', value_name = "COLUMN", default_value = "z")]
    pub time_column: TimeColumn,
    /// How chunks of MCAP are packed
    #[arg(long, value_name = "METHOD", default_value = "zstd")]
    pub packing: Packing,
    /// Do not judge: no findings among the events
    #[arg(long)]
    pub no_findings: bool,
    /// Colours: auto uses them on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// Format of the events printed; `None` prints nothing.
#[derive(Debug, Clone, Copy)]
pub struct PrintFormat(pub Option<&'static EventFormat>);

/// The formats of events, and `none`.
fn formats() -> impl TypedValueParser<Value = PrintFormat> {
    let formats = EVENT_FORMATS.iter().map(|format| PossibleValue::new(format.name).help(format.help));
    let none = PossibleValue::new("none").help("Nothing: reads and decodes only");
    PossibleValuesParser::new(formats.chain([none]))
        .map(|name| PrintFormat(EVENT_FORMATS.iter().find(|format| format.name == name)))
}

/// How chunks of MCAP are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Packing {
    /// Not at all
    None,
    /// Quickly
    Lz4,
    /// Small
    Zstd,
}

impl From<Packing> for cobscope_decoder::capture::Packing {
    fn from(packing: Packing) -> Self {
        match packing {
            Packing::None => Self::None,
            Packing::Lz4 => Self::Lz4,
            Packing::Zstd => Self::Zstd,
        }
    }
}

/// Which PDOs are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Pdo {
    /// The first of each identifier and those that say something new
    Change,
    /// All
    All,
    /// None
    None,
}

/// Time columns, as candump's -t.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TimeColumn {
    /// Seconds as recorded
    #[value(name = "a")]
    Absolute,
    /// Seconds since the line before
    #[value(name = "d")]
    Delta,
    /// Seconds since the first frame
    #[value(name = "z")]
    Zero,
    /// Date and time, UTC
    #[value(name = "A")]
    Date,
}
