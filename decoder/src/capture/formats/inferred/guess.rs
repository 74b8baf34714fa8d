//! Infers the layout from the first lines: proposes layouts, reads the lines with each one, and compares.
//!
//! A layout is accepted if it reads at least 90 % of the lines with bytes, if there is sufficient evidence for it, and if
//! no other layout with the same evidence reads other frames.

use std::fmt::Write as _;

use super::cells::propose_cells;
use super::facts::agree;
use super::layout::Layout;
use super::proposal::{Proposal, propose_layouts};
use super::records::first_word;
use super::row::{Row, RowFault};
use super::sample::{Sample, SampleLine, split_lines};
use super::token::{Dialect, Tokens};
use super::words::column_name;
use crate::capture::column_list::ColumnRole;
use crate::capture::text::lines::line_excerpt;
use crate::frame::{CanId, FrameFlags};

/// Evidence that an accepted layout has at least.
const ENOUGH: i32 = 5;

/// Difference of evidence below which a second layout makes the first one ambiguous.
const MARGIN: i32 = 2;

/// Maximum number of lines before the first frame that starts on several lines.
const FIRST_WORDS: usize = 200;

/// A layout, and how it fits the first lines.
#[derive(Debug, Clone)]
pub(super) struct LayoutGuess {
    /// The layout.
    pub(super) layout: Layout,
    /// Number of lines that are frames.
    pub(super) fits: usize,
    /// Number of lines with bytes that are not frames.
    pub(super) spoils: usize,
    /// Number of other lines.
    pub(super) others: usize,
    /// First line with bytes but without a frame: its number and text.
    pub(super) first_spoil: Option<(u64, String)>,
    /// Evidence for the layout.
    pub(super) score: i32,
    /// Ignored parts of the lines.
    pub(super) remarks: Vec<&'static str>,
    /// Reason for a refusal.
    pub(super) defect: Option<&'static str>,
}

impl LayoutGuess {
    /// Whether captures of this layout are read without the user's confirmation.
    pub(super) fn is_accepted(&self) -> bool {
        self.defect.is_none()
    }

    /// One line that describes the layout: `columns: time (ms), identifier, length, 8 bytes; 412 of 420 lines`.
    pub(super) fn describe(&self) -> String {
        let all = self.fits + self.spoils + self.others;
        let certainty = if self.score >= 2 * ENOUGH { "certain" } else { "presumed" };
        let mut text = format!(
            "no known format: columns: {}; {} of the first {all} lines; {certainty}",
            self.layout.describe_columns(),
            self.fits
        );
        for remark in &self.remarks {
            text.push_str("; ");
            text.push_str(remark);
        }
        text.push_str("; to correct: --columns '");
        text.push_str(&self.layout.columns_text());
        text.push('\'');
        text
    }

    /// Description of a refused layout.
    pub(super) fn describe_refusal(&self) -> String {
        let all = self.fits + self.spoils + self.others;
        let mut text = format!(
            "nearest layout: --columns '{}' ({} of {all} lines",
            self.layout.columns_text(),
            self.fits
        );
        if let Some((line, excerpt)) = &self.first_spoil {
            let _ = write!(text, "; first other line {line}: {excerpt}");
        }
        text.push(')');
        if let Some(defect) = self.defect {
            text.push_str(": ");
            text.push_str(defect);
        }
        text
    }
}

/// Infers the layout of the lines in `head`; `None` if no line resembles a frame.
pub(super) fn infer_layout(head: &[u8]) -> Option<LayoutGuess> {
    if is_binary(head) {
        return None;
    }
    let mut best: Option<LayoutGuess> = None;
    for (dialect, start) in shapes(head) {
        // Frames on several lines only if single lines are not frames.
        if start.is_some() && best.as_ref().is_some_and(LayoutGuess::is_accepted) {
            break;
        }
        let sample = Sample::new(head, dialect, start);
        if let Some(guess) = best_of_sample(&sample)
            && best.as_ref().is_none_or(|best| rank(&guess) > rank(best))
        {
            best = Some(guess);
        }
    }
    best
}

/// Reads the first lines of `head` by the columns that the user states.
pub(super) fn apply_columns(
    head: &[u8],
    columns: &[crate::capture::column_list::StatedColumn],
) -> Option<LayoutGuess> {
    let mut best: Option<LayoutGuess> = None;
    for (dialect, start) in shapes(head) {
        let sample = Sample::new(head, dialect, start);
        for layout in super::option::stated_layouts(&sample, columns) {
            let mut guess = evaluate(&sample, &Proposal { layout, ..Proposal::default() });
            guess.defect = None;
            if guess.fits > 0 && best.as_ref().is_none_or(|best| guess.fits > best.fits) {
                best = Some(guess);
            }
        }
    }
    best
}

/// An accepted layout precedes others, then one with fewer lines that do not fit.
fn rank(guess: &LayoutGuess) -> (bool, std::cmp::Reverse<usize>, usize, i32) {
    if guess.is_accepted() {
        return (true, std::cmp::Reverse(guess.spoils), 0, guess.score);
    }
    (false, std::cmp::Reverse(0), guess.fits, guess.score)
}

/// Whether the start is not text: it contains a zero byte.
fn is_binary(head: &[u8]) -> bool {
    memchr::memchr(0, head).is_some()
}

/// Dialects, and first words of frames on several lines, that are possible.
fn shapes(head: &[u8]) -> Vec<(Dialect, Option<Vec<u8>>)> {
    let lines: Vec<&[u8]> =
        split_lines(head).filter(|line| !line.trim_ascii().is_empty()).take(FIRST_WORDS).collect();
    let colon_bytes = lines.iter().any(|line| has_colon_bytes(line));
    let numbered_bytes = lines.iter().any(|line| has_numbered_bytes(line));
    let plain = Dialect { colon_bytes, numbered_bytes, ..Dialect::default() };
    let has_comma = lines.iter().any(|line| has_decimal_comma(line));
    // Bytes joined by commas would be fractions, and the rest of a run the data.
    let has_comma = has_comma && !lines.iter().any(|line| has_comma_bytes(line));
    let mut shapes: Vec<(Dialect, Option<Vec<u8>>)> = Vec::new();
    for separator in [b'\t', b';', b',', b'|'] {
        if has_cells(&lines, separator) {
            let dialect = Dialect { cell: Some(separator), ..plain };
            shapes.push((dialect, None));
            if has_comma && separator != b',' {
                shapes.push((Dialect { decimal_comma: true, ..dialect }, None));
            }
        }
    }
    shapes.push((plain, None));
    if has_comma {
        shapes.push((Dialect { decimal_comma: true, ..plain }, None));
    }
    shapes.extend(record_starts(&lines).into_iter().map(|start| (plain, Some(start))));
    shapes
}

/// Whether a line contains bytes joined by colons: four, or three that are not a time of day.
fn has_colon_bytes(line: &[u8]) -> bool {
    line.split(|byte| !byte.is_ascii_hexdigit() && *byte != b':').any(|word| {
        // A label before the first byte may end with hexadecimal letters.
        let parts: Vec<&[u8]> = word.split(|byte| *byte == b':').collect();
        let bytes =
            parts.get(usize::from(parts.first().is_some_and(|part| part.len() != 2))..).unwrap_or_default();
        let is_sexagesimal = |part: &&[u8]| matches!(part, [b'0'..=b'5', b'0'..=b'9']);
        bytes.iter().all(|part| part.len() == 2)
            && (bytes.len() >= 4 || (bytes.len() == 3 && !bytes.iter().skip(1).all(is_sexagesimal)))
    })
}

/// Whether a line contains bytes with their numbers, from 0: `0 = 11, 1 = 22`.
fn has_numbered_bytes(line: &[u8]) -> bool {
    let Some(first) = memchr::memmem::find(line, b"0 = ") else { return false };
    memchr::memmem::find(line.get(first..).unwrap_or_default(), b"1 = ").is_some()
}

/// Whether the lines are tables of cells: most lines have the same number of separators, or at least two.
fn has_cells(lines: &[&[u8]], separator: u8) -> bool {
    let mut counts: Vec<usize> =
        lines.iter().map(|line| memchr::memchr_iter(separator, line).count()).collect();
    counts.sort_unstable();
    let median = counts.get(counts.len() / 2).copied().unwrap_or(0);
    let similar = counts.iter().filter(|count| **count >= median.min(2)).count();
    median >= 1 && similar * 10 >= counts.len() * 6
}

fn has_decimal_comma(line: &[u8]) -> bool {
    line.windows(3).any(|part| matches!(part, [b'0'..=b'9', b',', b'0'..=b'9']))
}

/// Whether a line contains four bytes joined by commas.
fn has_comma_bytes(line: &[u8]) -> bool {
    let is_byte = |part: &[u8]| part.len() == 2 && part.iter().all(u8::is_ascii_hexdigit);
    let parts: Vec<bool> = line.split(|byte| *byte == b',').map(is_byte).collect();
    parts.windows(4).any(|run| run.iter().all(|is_byte| *is_byte))
}

/// First words of frames on several lines: words with a name of the identifier in their line, which start every second
/// to twelfth line.
fn record_starts(lines: &[&[u8]]) -> Vec<Vec<u8>> {
    let mut starts: Vec<(Vec<u8>, usize)> = Vec::new();
    for line in lines {
        let word = first_word(super::records::clean_line(line).as_ref()).to_ascii_lowercase();
        let known = starts.iter().position(|(known, _)| *known == word);
        if let Some((_, count)) = known.and_then(|known| starts.get_mut(known)) {
            *count += 1;
        } else if starts.len() < 40 && !word.is_empty() {
            starts.push((word, 1));
        }
    }
    let most = lines.len() / 2;
    let is_start = |(word, count): &(Vec<u8>, usize)| {
        *count <= most.max(1) && count * 14 >= lines.len() && !word.iter().all(u8::is_ascii_hexdigit)
    };
    let has_labels = |name: ColumnRole| {
        lines.iter().any(|line| {
            let line = super::records::clean_line(line);
            let label = line.split(|byte| matches!(byte, b':' | b'=')).next().unwrap_or_default();
            column_name(label.trim_ascii()).is_some_and(|found| found.role == name)
        })
    };
    if lines.len() < 2 || !has_labels(ColumnRole::Data) {
        return Vec::new();
    }
    starts.into_iter().filter(is_start).take(6).map(|(word, _)| word).collect()
}

/// The best layout of a sample, with the reason if it is refused.
fn best_of_sample(sample: &Sample) -> Option<LayoutGuess> {
    let has_cells = sample.dialect.cell.is_some();
    let proposals = if has_cells { propose_cells(sample) } else { propose_layouts(sample) };
    let mut all: Vec<LayoutGuess> = proposals.iter().map(|proposal| evaluate(sample, proposal)).collect();
    all.retain(|guess| guess.fits > 0);
    all.sort_by_key(|guess| {
        let is_fit = agree(guess.fits, guess.fits + guess.spoils);
        std::cmp::Reverse((is_fit, guess.defect.is_none(), guess.score))
    });
    let mut all = all.into_iter();
    let mut best = all.next()?;
    let other = all.find(|other| {
        best.score - other.score < MARGIN
            && other.defect.is_none()
            && agree(other.fits, best.fits)
            && reads_otherwise(sample, &best.layout, &other.layout)
    });
    if best.defect.is_none() && other.is_some() {
        best.defect = Some("ambiguous: another layout fits the same lines");
    }
    Some(best)
}

/// Whether two layouts read different frames.
fn reads_otherwise(sample: &Sample, one: &Layout, other: &Layout) -> bool {
    sample.lines.iter().any(|line| {
        let frame = |layout: &Layout| layout.read_row(&line.text, &line.tokens).ok().map(|row| row.frame);
        match (frame(one), frame(other)) {
            (Some(one), Some(other)) => one.id != other.id || one.data() != other.data(),
            _ => false,
        }
    })
}

/// Reads the sample with a layout.
fn evaluate(sample: &Sample, proposal: &Proposal) -> LayoutGuess {
    let mut layout = proposal.layout.clone();
    let mut reading = SampleReading::default();
    for line in &sample.lines {
        match layout.read_row(&line.text, &line.tokens) {
            Ok(row) => reading.add_row(&row),
            Err(fault) if fault == RowFault::Text && !resembles_frame(&line.tokens) => reading.others += 1,
            Err(_) => reading.add_spoil(line),
        }
    }
    layout.data.bytes = reading.bytes.unwrap_or_default();
    let score = proposal.score + reading.score(&layout);
    let defect = reading.defect(sample, &layout, proposal, score);
    LayoutGuess {
        layout,
        fits: reading.fits,
        spoils: reading.spoils,
        others: reading.others,
        first_spoil: reading.first_spoil,
        score,
        remarks: proposal.remarks.clone(),
        defect,
    }
}

/// Whether a line without a frame contains bytes: three numbers of one or two hexadecimal digits in a row.
fn resembles_frame(tokens: &Tokens) -> bool {
    let mut run = 0;
    tokens.list().iter().any(|token| {
        run = if token.is_byte() && token.width() == 2 { run + 1 } else { 0 };
        run >= 3
    })
}

/// Results of reading a sample.
#[derive(Debug, Default)]
struct SampleReading {
    fits: usize,
    spoils: usize,
    others: usize,
    first_spoil: Option<(u64, String)>,
    bytes: Option<(u8, u8)>,
    lengths: Vec<u32>,
    identifiers: Vec<(u32, usize)>,
    /// Whether each frame has eight bytes.
    is_full: bool,
    errors: usize,
}

impl SampleReading {
    fn add_row(&mut self, row: &Row<'_>) {
        if row.frame.flags.contains(FrameFlags::ERROR) {
            self.errors += 1;
            return;
        }
        let count = row.frame.data().len();
        self.is_full = (self.fits == 0 || self.is_full) && count == 8;
        self.fits += 1;
        let size = row.frame.length;
        self.bytes = Some(self.bytes.map_or((size, size), |(least, most)| (least.min(size), most.max(size))));
        if let Some(length) = row.length
            && !self.lengths.contains(&length)
        {
            self.lengths.push(length);
        }
        let id = match row.frame.id {
            CanId::Standard(id) => u32::from(id),
            CanId::Extended(id) => id,
        };
        self.identifiers.push((id, count));
    }

    fn add_spoil(&mut self, line: &SampleLine) {
        self.spoils += 1;
        if self.first_spoil.is_none() {
            self.first_spoil = Some((line.number, line_excerpt(&line.text)));
        }
    }

    /// Evidence from the frames.
    fn score(&self, layout: &Layout) -> i32 {
        let mut score = 0;
        let mut add = |points: i32, holds: bool| score += if holds { points } else { 0 };
        add(4, layout.data.has_length && self.lengths.len() >= 2);
        add(2, layout.data.has_length && self.lengths.len() < 2);
        add(2, self.is_full);
        add(1, self.fits >= 3);
        add(1, self.fits >= 8);
        add(-1, layout.data.is_packed && !layout.data.has_length && !layout.data.has_label && !self.is_full);
        add(-3, self.bytes.is_some_and(|(_, most)| most > 8) && !layout.data.has_length);
        score
    }

    /// Reason why the layout is refused.
    fn defect(
        &self,
        sample: &Sample,
        layout: &Layout,
        proposal: &Proposal,
        score: i32,
    ) -> Option<&'static str> {
        let all = sample.lines.len();
        if let Some(defect) = proposal.defect {
            return Some(defect);
        }
        if !agree(self.fits, self.fits + self.spoils) {
            return Some("less than 90 % of the lines with bytes fit");
        }
        let is_named = layout.id.label.is_some() || sample.heading_line.is_some();
        let is_proven = layout.data.has_length || is_named;
        let least = if is_proven { 5 } else { 8 };
        if self.fits * 10 < all * least && !(is_named && self.fits * 5 >= all && self.fits >= 3) {
            return Some("most lines are other text");
        }
        if self.bytes.is_none_or(|(_, most)| most == 0) {
            return Some("no line has data");
        }
        if self.are_addresses() {
            return Some("the identifiers are addresses of a dump");
        }
        if self.errors * 2 > self.fits {
            return Some("most lines are marked as errors");
        }
        (score < ENOUGH).then_some("the lines are not sufficient to distinguish frames from other numbers")
    }

    /// Whether the identifiers rise by the number of bytes, or always by the same small number.
    fn are_addresses(&self) -> bool {
        let step = |pair: &[(u32, usize)]| match pair {
            [(first, count), (second, _)] => {
                let step = usize::try_from(second.checked_sub(*first)?).ok()?;
                Some((step, step == *count && step > 0))
            }
            _ => None,
        };
        let steps: Vec<Option<(usize, bool)>> = self.identifiers.windows(2).map(step).collect();
        let by_count = steps.iter().filter(|step| step.is_some_and(|(_, is_count)| is_count)).count();
        let first = steps.first().copied().flatten().map(|(step, _)| step);
        let is_equal = |step: &&Option<(usize, bool)>| {
            step.is_some_and(|(step, _)| Some(step) == first && (1..=64).contains(&step))
        };
        let equal = steps.iter().filter(is_equal).count();
        !steps.is_empty() && (agree(by_count, steps.len()) || (steps.len() >= 3 && agree(equal, steps.len())))
    }
}
