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

use dialect::{Layout, Meaning};

use crate::capture::Format;
use crate::capture::text::columns::Base;
use crate::capture::text::line_format::{
    Assumptions, Fault, LineFormat, LineParser, ParsedLine, first_lines,
};

pub(super) use write::WRITABLE;

/// Number of lines at the start within which the header must occur.
const DETECTING_LINES: usize = 40;

pub(super) const FORMAT: Format = Format {
    name: "csv",
    title: Csv::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| first_lines(head, DETECTING_LINES).any(|line| Layout::of_header(line).is_some()),
    parser: |_| Box::new(LineParser::new(Csv::default())),
};

/// State that affects later lines.
#[derive(Clone, Default)]
struct Csv {
    layout: Option<Layout>,
    preface: Preface,
    /// Buffer for a bus name whose quotes were removed.
    bus: Vec<u8>,
    clock: row::Clock,
}

/// Content of the lines before the header.
#[derive(Clone, Default)]
struct Preface {
    lines: usize,
    id: Option<Base>,
    data: Option<Base>,
}

impl Preface {
    /// Reads a line of Kvaser's converter: `Format of id field,HEX`.
    fn read(&mut self, line: &[u8]) {
        self.lines += 1;
        let base = match line {
            [.., b'H', b'E', b'X'] => Base::Hex,
            [.., b'D', b'E', b'C'] => Base::Decimal,
            _ => return,
        };
        if line.starts_with(b"Format of id field") {
            self.id = Some(base);
        } else if line.starts_with(b"Format of data field") {
            self.data = Some(base);
        }
    }

    /// Sets the bases stated before the header in its layout.
    fn applied(&self, mut layout: Layout) -> Layout {
        for meaning in &mut layout.columns {
            match (meaning, self.id, self.data) {
                (Meaning::Id(base), Some(id), _) => *base = id,
                (Meaning::Byte(base), _, Some(data)) => *base = data,
                _ => {}
            }
        }
        layout
    }
}

impl LineFormat for Csv {
    const TITLE: &'static str = "CSV with a known header";

    fn line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut Assumptions,
    ) -> Result<Option<ParsedLine<'a>>, Fault> {
        let text = text.trim_ascii();
        let Some(layout) = &self.layout else {
            if self.preface.lines > DETECTING_LINES {
                return Err("header: expected the column names of a known program".into());
            }
            match Layout::of_header(text) {
                Some(layout) => self.layout = Some(self.preface.applied(layout)),
                None => self.preface.read(text),
            }
            return Ok(None);
        };
        match row::read(text, layout, &mut self.bus, &mut self.clock, assumptions) {
            Ok(seen) => Ok(seen),
            // Concatenated captures in one file have one header each.
            Err(reason) => match Layout::of_header(text) {
                Some(layout) => {
                    self.layout = Some(self.preface.applied(layout));
                    Ok(None)
                }
                None => Err(reason),
            },
        }
    }
}

#[cfg(test)]
mod tests;
