//! Captures in columns that a header names: ours, and those of other programs.
//!
//! ```text
//! text of the program          some programs write lines of their own before the header
//! header                       names tell which program's columns these are: `dialect.rs`
//! row                          a frame a line, RFC 4180's quotes, no line break within them
//! ```
//!
//! Our own, in which every frame comes back as it was:
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
use crate::capture::text::line_format::{Assumptions, Fault, LineFormat, LineParser, Seen, first_lines};

pub(super) use write::WRITABLE;

/// Lines at the start among which the header must be.
const DETECTING_LINES: usize = 40;

pub(super) const FORMAT: Format = Format {
    name: "csv",
    title: Csv::TITLE,
    is_text: true,
    detect: |head| first_lines(head, DETECTING_LINES).any(|line| Layout::of_header(line).is_some()),
    parser: |_| Box::new(LineParser::new(Csv::default())),
};

/// What the lines so far say of later ones.
#[derive(Clone, Default)]
struct Csv {
    layout: Option<Layout>,
    preface: Preface,
    /// Name of a bus that had to be taken out of its quotes.
    bus: Vec<u8>,
}

/// What stood before the header.
#[derive(Clone, Default)]
struct Preface {
    lines: usize,
    id: Option<Base>,
    data: Option<Base>,
}

impl Preface {
    /// Kvaser's converter: `Format of id field,HEX`.
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

    /// The layout a header gives, in the bases that stood before it.
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
    ) -> Result<Option<Seen<'a>>, Fault> {
        let text = text.trim_ascii();
        let Some(layout) = &self.layout else {
            if self.preface.lines > DETECTING_LINES {
                return Err("header: expected the names of a known program's columns".into());
            }
            match Layout::of_header(text) {
                Some(layout) => self.layout = Some(self.preface.applied(layout)),
                None => self.preface.read(text),
            }
            return Ok(None);
        };
        match row::read(text, layout, &mut self.bus, assumptions) {
            Ok(seen) => Ok(seen),
            // Captures behind one another in a file have a header each.
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
