//! Captures in CSV with a header: from cobscope and from other programs.
//!
//! ```text
//! text of the program          some programs write text lines before the header
//! header                       its names identify the program: `dialect.rs`
//! row                          one frame per line, quotes of RFC 4180, no line break in a field
//! ```
//!
//! The form of cobscope, which stores frames without loss:
//!
//! ```text
//! time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data
//! 1700000000.123456789,can0,701,0,0,0,0,0,0,rx,1,1,05
//! ```

mod clock;
mod dialect;
mod field;
mod number;
mod row;
mod write;

use clock::{CsvClock, UnitEvidence};
use dialect::{ColumnMeaning, CsvLayout, CsvTimeFormat, DataCoding, decode_text};

use super::inferred::words::column_name;
use crate::capture::column_list::ColumnRole;

use crate::capture::text::columns::NumberBase;
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, complete_lines, first_lines,
};
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, FormatParser, LARGEST_RECORD, ReadOptions, TimeUnit,
};

pub(super) use write::WRITABLE;

/// Number of lines at the start within which the header must occur.
const DETECTING_LINES: usize = 40;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "csv",
    title: CsvFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: is_csv,
    parser: |options| Box::new(CsvParser::new(options)),
};

/// Number of rows that decide whether a table has the form of ZLG's programs.
const DECIDING_ROWS: usize = 20;

/// Whether the header of a known program occurs. The names of ZLG's programs are common ones: one of their rows must be readable,
/// and no other column may contain times.
fn is_csv(head: &[u8]) -> bool {
    let mut lines = first_lines(head, DETECTING_LINES + DECIDING_ROWS);
    let header =
        lines.by_ref().take(DETECTING_LINES).find_map(|line| Some((CsvLayout::of_header(line)?, line)));
    let Some((layout, header)) = header else { return false };
    if !layout.has_column(ColumnMeaning::Data(DataCoding::Marked)) {
        return true;
    }
    // Quoted text is not a table of these programs.
    if header.starts_with(b">") {
        return false;
    }
    let names = decode_text(header, layout.is_gbk);
    let is_time = |name: &str| {
        column_name(name.as_bytes())
            .is_some_and(|name| matches!(name.role, ColumnRole::Time | ColumnRole::Delta))
    };
    let is_known = |meaning: &ColumnMeaning| matches!(meaning, ColumnMeaning::Time(_));
    if names.split(char::from(layout.separator)).any(is_time) && !layout.columns.iter().any(is_known) {
        return false;
    }
    let (mut bus, mut clock) = (Vec::new(), CsvClock::default());
    let mut assumptions = CaptureAssumptions::default();
    lines.take(DECIDING_ROWS).any(|row| {
        row::read_row(row, &layout, &mut bus, &mut clock, &mut assumptions).is_ok() && !row.contains(&b'(')
    })
}

/// Bytes at the start whose rows decide about the unit of the times.
const DECIDING: usize = LARGEST_RECORD / 2;

/// Parser of CSV.
#[derive(Clone)]
struct CsvParser {
    rows: LineParser<CsvFormat>,
    /// Whether the unit of the times is known.
    is_decided: bool,
}

impl CsvParser {
    fn new(options: &ReadOptions) -> Self {
        let format = CsvFormat { unit: options.time_unit, ..CsvFormat::default() };
        Self { rows: LineParser::new(format), is_decided: options.time_unit.is_some() }
    }

    /// Determines the unit of the times from the first rows; `false` requests more input.
    fn decide_unit(&mut self, input: &[u8], at_end: bool) -> bool {
        let start = input.get(..DECIDING);
        let head = start.map_or_else(|| if at_end { input } else { complete_lines(input) }, complete_lines);
        let header = first_lines(head, DETECTING_LINES + 1).find_map(CsvLayout::of_header);
        let is_open = |layout: &CsvLayout| layout.has_column(ColumnMeaning::Time(CsvTimeFormat::Gvret));
        if header.as_ref().is_none_or(is_open) {
            if !at_end && start.is_none() {
                return false;
            }
            self.rows.format_state().infer_unit(head);
        }
        self.is_decided = true;
        true
    }
}

impl FormatParser for CsvParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        if !self.is_decided && !self.decide_unit(input, at_end) {
            return Ok(0);
        }
        self.rows.parse(input, at_end, batch)
    }

    fn buses(&self) -> &BusNames {
        self.rows.buses()
    }

    fn line_number(&self) -> Option<u64> {
        FormatParser::line_number(&self.rows)
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct CsvFormat {
    layout: Option<CsvLayout>,
    preface: CsvPreface,
    /// Buffer for a bus name whose quotes were removed.
    bus: Vec<u8>,
    clock: CsvClock,
    /// Unit of the times instead of that of the program.
    unit: Option<TimeUnit>,
    /// Assumption about the unit, until the first row.
    assumption: Option<&'static str>,
}

impl CsvFormat {
    /// Determines the unit of GVRET's times from the rows of `head`.
    fn infer_unit(&mut self, head: &[u8]) {
        let (mut rows, mut evidence) = (self.clone(), UnitEvidence::default());
        for line in first_lines(head, usize::MAX) {
            if let Ok(Some(row)) = rows.parse_line(line, &mut CaptureAssumptions::default()) {
                evidence.add_row(&row);
            }
        }
        if let Some((unit, assumption)) = evidence.other_unit() {
            (self.unit, self.assumption) = (Some(unit), Some(assumption));
        }
    }
}

/// Content of the lines before the header.
#[derive(Clone, Default)]
struct CsvPreface {
    lines: usize,
    id: Option<NumberBase>,
    data: Option<NumberBase>,
}

impl CsvPreface {
    /// Reads a line of Kvaser's converter: `Format of id field,HEX`.
    fn read_line(&mut self, line: &[u8]) {
        self.lines += 1;
        let base = match line {
            [.., b'H', b'E', b'X'] => NumberBase::Hex,
            [.., b'D', b'E', b'C'] => NumberBase::Decimal,
            _ => return,
        };
        if line.starts_with(b"Format of id field") {
            self.id = Some(base);
        } else if line.starts_with(b"Format of data field") {
            self.data = Some(base);
        }
    }

    /// Sets the bases stated before the header, and the unit of times if it is known, in the layout of the header.
    fn apply_to(&self, mut layout: CsvLayout, unit: Option<TimeUnit>) -> CsvLayout {
        for meaning in &mut layout.columns {
            if let (
                ColumnMeaning::Time(style @ (CsvTimeFormat::Unit(_) | CsvTimeFormat::Gvret)),
                Some(unit),
            ) = (&mut *meaning, unit)
            {
                *style = CsvTimeFormat::Unit(unit);
            }
            match (meaning, self.id, self.data) {
                (ColumnMeaning::Id(base), Some(id), _) => *base = id,
                (ColumnMeaning::Byte(base), _, Some(data)) => *base = data,
                _ => {}
            }
        }
        layout
    }
}

impl LineFormat for CsvFormat {
    const TITLE: &'static str = "CSV with a known header";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        let Some(layout) = &self.layout else {
            if self.preface.lines > DETECTING_LINES {
                return Err("header: expected the column names of a known program".into());
            }
            match CsvLayout::of_header(text) {
                Some(layout) => self.layout = Some(self.preface.apply_to(layout, self.unit)),
                None => self.preface.read_line(text),
            }
            return Ok(None);
        };
        if let Some(assumption) = self.assumption.take() {
            assumptions.add_assumption(assumption);
        }
        match row::read_row(text, layout, &mut self.bus, &mut self.clock, assumptions) {
            Ok(seen) => Ok(seen),
            // Concatenated captures in one file have one header each.
            Err(reason) => match CsvLayout::of_header(text) {
                Some(layout) => {
                    self.layout = Some(self.preface.apply_to(layout, self.unit));
                    Ok(None)
                }
                None => Err(reason),
            },
        }
    }
}

#[cfg(test)]
mod tests;
