//! Options for printed events.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use cobscope_decoder::sink::{EVENT_FORMATS, EventFormat};

use crate::run::arguments::Color;

/// Options for printed events.
#[derive(Debug, Args)]
pub struct PrintArgs {
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text", value_parser = event_formats())]
    pub format: PrintFormat,
    /// Write to FILE instead of stdout
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Overwrite FILE of --output if it exists
    #[arg(long, requires = "output")]
    pub force: bool,
    /// Print these PDOs, J1939 messages and DBC messages: new information, all or none (default: change for
    /// text, all for other formats)
    #[arg(long, value_name = "WHICH")]
    pub pdo: Option<PdoOption>,
    /// Also print repeated events: heartbeat, SYNC, guarding (text; other formats always contain them)
    #[arg(long)]
    pub all: bool,
    /// Also print frames of no known protocol
    #[arg(long)]
    pub frames: bool,
    /// Print all fields of each event on further lines (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Print times as a (absolute), d (since the previous line), z (since the first frame) or A (date, UTC)
    /// (text)
    #[arg(short = 't', value_name = "COLUMN", default_value = "z")]
    pub time_column: TimeColumnChoice,
    /// Compress MCAP chunks with METHOD
    #[arg(long, value_name = "METHOD", default_value = "zstd")]
    pub packing: McapCompression,
    /// Do not run rules; print events only
    #[arg(long)]
    pub no_findings: bool,
    /// Use colours; auto: on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// Format of the events printed; `None` prints nothing.
#[derive(Debug, Clone, Copy)]
pub struct PrintFormat(pub Option<&'static EventFormat>);

/// Parser for event formats and `none`.
fn event_formats() -> impl TypedValueParser<Value = PrintFormat> {
    let formats = EVENT_FORMATS.iter().map(|format| PossibleValue::new(format.name).help(format.help));
    let none = PossibleValue::new("none").help("No output: read and decode only");
    PossibleValuesParser::new(formats.chain([none]))
        .map(|name| PrintFormat(EVENT_FORMATS.iter().find(|format| format.name == name)))
}

/// Compression of MCAP chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum McapCompression {
    /// No compression
    None,
    /// Fast
    Lz4,
    /// Small files
    Zstd,
}

impl From<McapCompression> for cobscope_decoder::capture::CaptureCompression {
    fn from(packing: McapCompression) -> Self {
        match packing {
            McapCompression::None => Self::None,
            McapCompression::Lz4 => Self::Lz4,
            McapCompression::Zstd => Self::Zstd,
        }
    }
}

/// PDOs and messages to print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PdoOption {
    /// The first message of an identifier and those with new information
    Change,
    /// All
    All,
    /// None
    None,
}

/// Time column, as for candump's -t.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum TimeColumnChoice {
    /// Seconds as in the capture
    #[value(name = "a")]
    Absolute,
    /// Seconds since the previous line
    #[value(name = "d")]
    Delta,
    /// Seconds since the first frame
    #[value(name = "z")]
    Zero,
    /// Date and time, UTC
    #[value(name = "A")]
    Date,
}
