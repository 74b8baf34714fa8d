//! A payload in hex and bits, with its fields.
//!
//! ```text
//! byte         0        1        2        3
//! hex         0F      *01       F4       01     a changed byte is marked
//! bits  00001111 00000001 11110100 00000001
//! field ····bbba cccccccc dddddddd dddddddd     one letter per field, so that no colours are needed
//! a enable  b mode  c status  d pressure
//! ```

use std::borrow::Cow;

use cobscope_decoder::profile::BitOrder;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};

use crate::theme::{Glyph, TextRole, Theme};
use crate::widgets::draw;

/// Maximum payload: that of a CAN FD frame.
const MOST_BYTES: usize = 64;
/// Width of a byte with a space.
const BYTE: u16 = 9;
/// Width of the line labels.
const LABEL: u16 = 6;
/// Space between two names of the legend.
const LEGEND_SPACE: u16 = 2;

/// A named field of a payload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PayloadField<'a> {
    /// Name in the legend.
    pub name: Cow<'a, str>,
    /// First bit: bit 0 is bit 0 of byte 0, bit 8 is bit 0 of byte 1. The lowest bit of a little-endian
    /// field, the most significant bit of a big-endian field.
    pub start_bit: u16,
    /// Number of bits.
    pub bits: u16,
    /// Byte order.
    pub order: BitOrder,
    /// Number of its [`TextRole::Highlight`].
    pub role_index: u8,
}

impl PayloadField<'_> {
    /// Whether the field contains a bit.
    pub fn has_bit(&self, bit: u16) -> bool {
        let (first, bit) = match self.order {
            BitOrder::LittleEndian => (self.start_bit, bit),
            BitOrder::BigEndian => (on_screen(self.start_bit), on_screen(bit)),
        };
        (first..first.saturating_add(self.bits)).contains(&bit)
    }
}

/// Converts bit numbers to screen order, the most significant bit of each byte first, and back.
pub const fn on_screen(bit: u16) -> u16 {
    bit ^ 7
}

/// The field that contains a bit; the smallest one if fields overlap.
pub fn field_at(fields: &[PayloadField<'_>], bit: u16) -> Option<usize> {
    let found = fields.iter().enumerate().filter(|(_, field)| field.has_bit(bit));
    found.min_by_key(|(_, field)| field.bits).map(|(index, _)| index)
}

/// Letter of a field in the field line and the legend.
pub fn field_letter(field: usize) -> char {
    ('a'..='z').chain('A'..='Z').nth(field).unwrap_or('*')
}

/// A payload as bits.
#[derive(Clone, Copy, Debug)]
pub struct PayloadBits<'a> {
    theme: &'a Theme,
    bytes: &'a [u8],
    fields: &'a [PayloadField<'a>],
    selected: Option<usize>,
    cursor: Option<u16>,
    has_legend: bool,
    changed: u64,
}

impl<'a> PayloadBits<'a> {
    /// A payload, cut after 64 bytes.
    pub fn new(theme: &'a Theme, bytes: &'a [u8]) -> Self {
        let bytes = bytes.get(..MOST_BYTES).unwrap_or(bytes);
        Self { theme, bytes, fields: &[], selected: None, cursor: None, has_legend: true, changed: 0 }
    }

    /// Sets the fields.
    #[must_use]
    pub fn with_fields(self, fields: &'a [PayloadField<'a>]) -> Self {
        Self { fields, ..self }
    }

    /// Highlights a field.
    #[must_use]
    pub fn select_field(self, field: Option<usize>) -> Self {
        Self { selected: field, ..self }
    }

    /// Sets the bit cursor.
    #[must_use]
    pub fn with_cursor(self, bit: Option<u16>) -> Self {
        Self { cursor: bit, ..self }
    }

    /// Draws no legend.
    #[must_use]
    pub fn without_legend(self) -> Self {
        Self { has_legend: false, ..self }
    }

    /// Marks changed bytes: bit n for byte n.
    #[must_use]
    pub fn with_changed(self, bytes: u64) -> Self {
        Self { changed: bytes, ..self }
    }

    /// Number of lines for a width.
    pub fn height(&self, width: u16) -> u16 {
        let legend = self.legend_places(width).last().map_or(0, |(_, _, line)| line + 1);
        draw::to_cells(self.block_count(width)).saturating_mul(self.block_height()).saturating_add(legend)
    }

    /// The bit at a screen position: in the bit line, the field line or a hex digit.
    pub fn bit_at(&self, area: Rect, x: u16, y: u16) -> Option<u16> {
        let (label, per_row) = row_columns(area.width, self.bytes.len());
        let line = y.checked_sub(area.y).filter(|_| y < area.bottom())?;
        let x = x.checked_sub(area.x + label).filter(|_| x < area.right())?;
        let block = self.first_block(area) + usize::from(line / self.block_height());
        let slot = x / BYTE;
        let byte = block * per_row + usize::from(slot);
        let column = x % BYTE;
        let bit = match (line % self.block_height(), column) {
            (1, 6) => 4,
            (1, 7) => 0,
            (0 | 1, _) | (_, 8) => return None,
            _ => 7 - column,
        };
        (usize::from(slot) < per_row && byte < self.bytes.len()).then(|| draw::to_cells(byte) * 8 + bit)
    }

    /// Draws the payload. If the area is too small, it starts at the block of the selected field.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        let (label, per_row) = row_columns(area.width, self.bytes.len());
        let mut y = area.y;
        let names = ["byte", "hex", "bits", "field"];
        for block in self.first_block(area)..self.block_count(area.width) {
            for (line, name) in (y..area.bottom()).zip(names).take(usize::from(self.block_height())) {
                draw::put_text(buf, area.x, line, label, name, self.theme.role_style(TextRole::Quiet));
            }
            let bytes = self.bytes.iter().enumerate().skip(block * per_row).take(per_row);
            for (slot, (index, byte)) in bytes.enumerate() {
                let x = area.x + label + draw::to_cells(slot) * BYTE;
                let place = Rect { x, y, width: area.right().saturating_sub(x), height: area.bottom() - y };
                self.draw_byte(index, *byte, place, buf);
            }
            y = y.saturating_add(self.block_height()).min(area.bottom());
        }
        for (index, x, line) in self.legend_places(area.width) {
            let Some(field) = self.fields.get(index) else { continue };
            let line = y.saturating_add(line);
            if line < area.bottom() {
                let text = format!("{} {}", field_letter(index), field.name);
                draw::put_text(buf, area.x + x, line, area.width - x, &text, self.field_style(Some(index)));
            }
        }
    }

    fn draw_byte(&self, index: usize, byte: u8, place: Rect, buf: &mut Buffer) {
        let put = |buf: &mut Buffer, column: u16, line: u16, text: &str, style: Style| {
            if line < place.height && column < place.width {
                draw::put_text(buf, place.x + column, place.y + line, place.width - column, text, style);
            }
        };
        let first = draw::to_cells(index) * 8;
        put(buf, 0, 0, &format!("{index:>8}"), self.theme.role_style(TextRole::Quiet));
        let is_changed = self.changed >> index & 1 == 1;
        for (column, nibble, low) in [(6, byte >> 4, first + 4), (7, byte & 0xF, first)] {
            // A hex digit is coloured only if all its bits are in one field.
            let field = field_at(self.fields, low)
                .filter(|field| (low..low + 4).all(|bit| field_at(self.fields, bit) == Some(*field)));
            let mut style = self.field_style(field);
            if is_changed {
                style = style.patch(self.theme.role_style(TextRole::Changed));
            }
            put(buf, column, 1, &format!("{nibble:X}"), style);
        }
        if is_changed {
            put(buf, 5, 1, "*", self.theme.role_style(TextRole::Changed));
        }
        for bit in 0..8_u16 {
            let field = field_at(self.fields, first + bit);
            let is_cursor = self.cursor == Some(first + bit);
            let style = match (self.field_style(field), is_cursor) {
                (style, false) => style,
                // In a reversed field the cursor is drawn without reversing.
                (style, true) if style.add_modifier.contains(Modifier::REVERSED) => {
                    style.remove_modifier(Modifier::REVERSED).add_modifier(Modifier::UNDERLINED)
                }
                _ => self.theme.role_style(TextRole::Cursor),
            };
            put(buf, 7 - bit, 2, if byte >> bit & 1 == 1 { "1" } else { "0" }, style);
            if !self.fields.is_empty() {
                let dot = || self.theme.glyph(Glyph::Dot).to_owned();
                let mark = field.map_or_else(dot, |field| field_letter(field).to_string());
                put(buf, 7 - bit, 3, &mark, style);
            }
        }
    }

    fn field_style(&self, field: Option<usize>) -> Style {
        let Some((index, look)) = field.and_then(|index| Some((index, self.fields.get(index)?.role_index)))
        else {
            return self.theme.role_style(TextRole::Quiet);
        };
        let style = self.theme.role_style(TextRole::Highlight(look));
        if self.selected == Some(index) { style.add_modifier(Modifier::REVERSED) } else { style }
    }

    /// Field, column and line of each name in the legend.
    fn legend_places(&self, width: u16) -> Vec<(usize, u16, u16)> {
        let (mut x, mut line) = (0_u16, 0_u16);
        let place = |(index, field): (usize, &PayloadField<'_>)| {
            let wanted = draw::text_width(&field.name).saturating_add(2);
            if x > 0 && x.saturating_add(wanted) > width {
                (x, line) = (0, line.saturating_add(1));
            }
            let at = (index, x, line);
            x = x.saturating_add(wanted).saturating_add(LEGEND_SPACE);
            at
        };
        let named = if self.has_legend { self.fields } else { &[] };
        named.iter().enumerate().map(place).collect()
    }

    fn block_height(&self) -> u16 {
        if self.fields.is_empty() { 3 } else { 4 }
    }

    fn block_count(&self, width: u16) -> usize {
        self.bytes.len().div_ceil(row_columns(width, self.bytes.len()).1)
    }

    /// Index of the first visible block.
    fn first_block(&self, area: Rect) -> usize {
        if self.height(area.width) <= area.height {
            return 0;
        }
        let (_, per_row) = row_columns(area.width, self.bytes.len());
        let field = self.selected.and_then(|index| self.fields.get(index));
        let bit = self.cursor.or_else(|| field.map(|field| field.start_bit)).unwrap_or(0);
        let wanted = usize::from(bit / 8) / per_row;
        let in_view = usize::from(area.height / self.block_height()).max(1);
        if wanted < in_view { 0 } else { wanted.min(self.block_count(area.width).saturating_sub(in_view)) }
    }
}

/// Width of the labels, and bytes per row: a power of two, eight at 80 columns.
fn row_columns(width: u16, count: usize) -> (u16, usize) {
    let most: u16 = if count > 8 { 16 } else { 8 };
    let fits = |bytes: &u16| LABEL + bytes * BYTE - 1 <= width;
    let found = std::iter::successors(Some(most), |bytes| (*bytes > 1).then_some(bytes / 2)).find(fits);
    found.map_or((0, 1), |bytes| (LABEL, usize::from(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::theme::LineCharacters;
    use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

    fn with_fields() -> Vec<PayloadField<'static>> {
        let field = |name: &'static str, start_bit, bits, role_index| PayloadField {
            name: name.into(),
            start_bit,
            bits,
            order: BitOrder::LittleEndian,
            role_index,
        };
        vec![
            field("enable", 0, 1, 0),
            field("mode", 1, 3, 1),
            field("status", 8, 8, 2),
            field("pressure", 16, 16, 3),
        ]
    }

    const BYTES: [u8; 4] = [0x0F, 0x01, 0xF4, 0x01];

    fn drawn(bits: PayloadBits<'_>, width: u16, height: u16) -> Vec<String> {
        let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
        bits.render(buf.area, &mut buf);
        buffer_lines(&buf)
    }

    #[test]
    fn bytes_bits_and_fields() {
        let (theme, fields) = (plain_theme(LineCharacters::Unicode), with_fields());
        let bits = PayloadBits::new(&theme, &BYTES).with_fields(&fields).with_changed(0b10);
        assert_eq!(bits.height(80), 5);
        assert_eq!(
            drawn(bits, 80, 5),
            [
                "byte         0        1        2        3",
                "hex         0F      *01       F4       01",
                "bits  00001111 00000001 11110100 00000001",
                "field ····bbba cccccccc dddddddd dddddddd",
                "a enable  b mode  c status  d pressure",
            ]
        );
    }

    #[test]
    fn narrow_areas_have_fewer_bytes_in_a_row() {
        let (theme, fields) = (plain_theme(LineCharacters::Ascii), with_fields());
        let bits = PayloadBits::new(&theme, &BYTES[..3]).with_fields(&fields[..2]);
        assert_eq!(bits.height(30), 9);
        assert_eq!(
            drawn(bits, 30, 9),
            [
                "byte         0        1",
                "hex         0F       01",
                "bits  00001111 00000001",
                "field ....bbba ........",
                "byte         2",
                "hex         F4",
                "bits  11110100",
                "field ........",
                "a enable  b mode",
            ]
        );
        let bare = PayloadBits::new(&theme, &BYTES[..1]);
        assert_eq!(drawn(bare, 9, 4), ["       0", "      0F", "00001111", ""]);
        assert_eq!(
            [76, 77, 150, 149, 40, 13].map(|width| row_columns(width, 64)),
            [(6, 4), (6, 8), (6, 16), (6, 16), (6, 2), (0, 1)]
        );
        assert_eq!(row_columns(150, 8), (6, 8));
        assert_eq!(PayloadBits::new(&theme, &[0; 100]).height(80), 8 * 3);
    }

    #[test]
    fn the_selected_field_is_reversed_wherever_it_lies() {
        let (theme, fields) = (plain_theme(LineCharacters::Unicode), with_fields());
        let mut buf = Buffer::empty(Rect::new(0, 0, 80, 5));
        PayloadBits::new(&theme, &BYTES)
            .with_fields(&fields)
            .select_field(Some(1))
            .render(buf.area, &mut buf);
        let is_reversed = |x, y| buf[(x, y)].modifier.contains(Modifier::REVERSED);
        let columns = |y| (0..80).filter(|x| is_reversed(*x, y)).collect::<Vec<_>>();
        assert_eq!(columns(1), Vec::<u16>::new());
        assert_eq!(columns(2), [10, 11, 12]);
        assert_eq!(columns(3), [10, 11, 12]);
        assert_eq!(columns(4), [10, 11, 12, 13, 14, 15]);
        let mut buf = Buffer::empty(Rect::new(0, 0, 80, 5));
        PayloadBits::new(&theme, &BYTES)
            .with_fields(&fields)
            .select_field(Some(3))
            .render(buf.area, &mut buf);
        let hex: Vec<_> = (0..80).filter(|x| buf[(*x, 1)].modifier.contains(Modifier::REVERSED)).collect();
        assert_eq!(hex, [30, 31, 39, 40]);
    }

    #[test]
    fn where_not_all_has_room_the_selected_field_is_in_view() {
        let (theme, fields) = (plain_theme(LineCharacters::Unicode), with_fields());
        let bits = PayloadBits::new(&theme, &BYTES).with_fields(&fields).select_field(Some(3));
        assert_eq!(drawn(bits, 14, 4)[0], "byte         2");
        assert_eq!(drawn(bits.select_field(None), 14, 4)[0], "byte         0");
        assert_eq!(
            drawn(bits, 14, 8)[..5].join("/"),
            "byte         2/hex         F4/bits  11110100/field dddddddd/byte         3"
        );
    }

    #[test]
    fn bits_and_fields_find_each_other() {
        let mut fields = with_fields();
        assert!(fields[3].has_bit(16) && fields[3].has_bit(31) && !fields[3].has_bit(32));
        assert_eq!(
            [0, 1, 3, 4, 15, 31, 32].map(|bit| field_at(&fields, bit)),
            [Some(0), Some(1), Some(1), None, Some(2), Some(3), None]
        );
        let field =
            |start_bit, bits, order| PayloadField { name: "".into(), start_bit, bits, order, role_index: 4 };
        fields.push(field(20, 1, BitOrder::LittleEndian));
        assert_eq!(field_at(&fields, 20), Some(4));
        // Twelve bits from bit 3 of byte 0, big-endian: bits 3..0 of byte 0, then byte 1.
        let motorola = field(3, 12, BitOrder::BigEndian);
        let has: Vec<_> = (0..32).filter(|bit| motorola.has_bit(*bit)).collect();
        assert_eq!(has, [0, 1, 2, 3, 8, 9, 10, 11, 12, 13, 14, 15]);
        for order in [BitOrder::LittleEndian, BitOrder::BigEndian] {
            assert!(!field(u16::MAX, u16::MAX, order).has_bit(9));
        }
        assert_eq!((field_letter(0), field_letter(26), field_letter(52)), ('a', 'A', '*'));
    }

    #[test]
    fn clicks_find_bits() {
        let (theme, fields) = (plain_theme(LineCharacters::Unicode), with_fields());
        let bits = PayloadBits::new(&theme, &BYTES).with_fields(&fields);
        let area = Rect::new(2, 1, 30, 9);
        let at = |x, y| bits.bit_at(area, x, y);
        assert_eq!(at(8, 3), Some(7));
        assert_eq!(at(15, 3), Some(0));
        assert_eq!(at(16, 3), None);
        assert_eq!(at(17, 4), Some(15));
        assert_eq!(at(14, 2), Some(4));
        assert_eq!(at(15, 2), Some(0));
        assert_eq!(at(13, 2), None);
        assert_eq!(at(15, 7), Some(16));
        assert_eq!([at(7, 3), at(8, 1), at(8, 0), at(30, 3), at(8, 10)], [None; 5]);
    }

    #[test]
    fn every_small_size() {
        let (theme, fields) = (plain_theme(LineCharacters::Ascii), with_fields());
        for bytes in [&[][..], &BYTES] {
            let bits = PayloadBits::new(&theme, bytes)
                .with_fields(&fields)
                .select_field(Some(3))
                .with_changed(u64::MAX);
            in_every_small_size(|area, buf| {
                bits.render(area, buf);
                let _ = bits.bit_at(area, 3, 3);
            });
        }
    }
}
