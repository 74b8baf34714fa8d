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

mod dialect;
mod field;
mod number;
mod row;
mod write;

use dialect::{ColumnMeaning, CsvLayout};

use crate::capture::CaptureFormat;
use crate::capture::text::columns::NumberBase;
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, first_lines,
};

pub(super) use write::WRITABLE;

/// Number of lines at the start within which the header must occur.
const DETECTING_LINES: usize = 40;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "csv",
    title: CsvFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| first_lines(head, DETECTING_LINES).any(|line| CsvLayout::of_header(line).is_some()),
    parser: |_| Box::new(LineParser::new(CsvFormat::default())),
};

/// State that affects later lines.
#[derive(Clone, Default)]
struct CsvFormat {
    layout: Option<CsvLayout>,
    preface: CsvPreface,
    /// Buffer for a bus name whose quotes were removed.
    bus: Vec<u8>,
    clock: row::CsvClock,
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

    /// Sets the bases stated before the header in its layout.
    fn apply_to(&self, mut layout: CsvLayout) -> CsvLayout {
        for meaning in &mut layout.columns {
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
                Some(layout) => self.layout = Some(self.preface.apply_to(layout)),
                None => self.preface.read_line(text),
            }
            return Ok(None);
        };
        match row::read_row(text, layout, &mut self.bus, &mut self.clock, assumptions) {
            Ok(seen) => Ok(seen),
            // Concatenated captures in one file have one header each.
            Err(reason) => match CsvLayout::of_header(text) {
                Some(layout) => {
                    self.layout = Some(self.preface.apply_to(layout));
                    Ok(None)
                }
                None => Err(reason),
            },
        }
    }
}

#[cfg(test)]
mod tests;
