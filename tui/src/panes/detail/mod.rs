//! Detail: bits, fields, findings, transfer and links of the event at the cursor.
//!
//! ```text
//! 7.204 s {104} can0 0A0 EMCY of 32
//! 32/20 EMCY 8305 spool position error → FAULT HOLD …
//! byte         0        1        2            the selected field is highlighted; left and right select a bit
//! bits  00000101 10000011 00100001
//! field aaaaaaaa aaaaaaaa bbbbbbbb
//! error emcy-raised: …                        findings with the text of the rule
//! a error code  8305h spool position error    fields, transfer, links, all event fields
//! ```
//!
//! From 110 columns the bits are to the left of the text.

mod advice;
mod document;
mod exchange;
mod item;
mod judged;
mod keys;
mod payload;
mod services;
mod text;

use cobscope_decoder::event::EventProtocol;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::EventPosition;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest};
use crate::action::Action;
use crate::state::UiState;
use crate::theme::{Glyph, TextRole, role_of};
use crate::timeline::ReplayRow;
use crate::widgets::bits::{self, PayloadBits};
use crate::widgets::draw;
use crate::widgets::text_lines::TextLines;
use item::{DetailItem, ItemTarget};
use payload::PayloadBytes;

/// Width from which bits and text are next to each other.
const WIDE: u16 = 110;
/// Widths of four and of eight bytes as bits.
const FOUR_BYTES: u16 = 42;
const EIGHT_BYTES: u16 = 78;
/// Maximum height of the bits above the text.
const MOST_BITS: u16 = 8;

/// The details of the event at the cursor.
#[derive(Debug, Default)]
pub struct DetailPane {
    /// Position of the event, and whether the cursor has reached it.
    spot: Option<(EventPosition, bool)>,
    /// Index of the selected item.
    selected: usize,
    /// The selected bit.
    bit: Option<u16>,
    /// Index of the frame of the transfer whose bits are shown.
    frame: Option<usize>,
}

/// Screen areas of this pane.
struct DetailAreas {
    title: Rect,
    bits: Rect,
    text: Rect,
}

/// Content at the cursor.
struct DetailContent<'a> {
    row: Option<&'a ReplayRow>,
    payload: PayloadBytes,
    items: Vec<DetailItem>,
}

impl DetailPane {
    fn detail_content<'a>(&self, core: &'a UiState) -> DetailContent<'a> {
        let row = cursor_row(core);
        let frames = core.window.as_ref().map_or(&[][..], |window| &window.frames);
        let chosen = self.frame.and_then(|frame| frames.get(frame));
        let payload = payload::payload_of(core, row, chosen);
        let items = document::document_items(core, row, &payload, self.frame);
        DetailContent { row, payload, items }
    }

    /// The selected part of the payload.
    fn selected_part(&self, reported: &DetailContent<'_>) -> Option<usize> {
        match reported.items.get(self.selected_item(reported)).map(|item| &item.leads) {
            Some(ItemTarget::Part(part))
                if self.bit.is_none_or(|bit| part_at(&reported.payload, bit).is_some()) =>
            {
                Some(*part)
            }
            _ => None,
        }
    }

    /// The selected item; after a heading, the item below it.
    fn selected_item(&self, reported: &DetailContent<'_>) -> usize {
        let rest = reported.items.iter().enumerate().skip(self.selected);
        let mut rest = rest.filter(|(_, item)| item.can_be_selected());
        rest.next().map_or_else(
            || reported.items.iter().rposition(DetailItem::can_be_selected).unwrap_or(0),
            |(index, _)| index,
        )
    }

    fn step_selection(&mut self, reported: &DetailContent<'_>, delta: isize) {
        let places = reported.items.iter().enumerate().filter(|(_, item)| item.can_be_selected());
        let places: Vec<usize> = places.map(|(index, _)| index).collect();
        let at = places.partition_point(|index| *index < self.selected_item(reported));
        let to = at.saturating_add_signed(delta).min(places.len().saturating_sub(1));
        self.selected = places.get(to).copied().unwrap_or(0);
        self.bit = None;
    }

    /// Moves the bit cursor in screen order.
    fn step_bit(&mut self, reported: &DetailContent<'_>, delta: i16) {
        let count = u16::try_from(reported.payload.bytes.len().min(64) * 8).unwrap_or(0);
        if count == 0 {
            return;
        }
        let part = self.selected_part(reported).and_then(|part| reported.payload.parts.get(part));
        let place = match (self.bit, part) {
            (Some(bit), _) => bits::on_screen(bit).saturating_add_signed(delta),
            (None, Some(part)) => first_on_screen(part),
            (None, None) => 0,
        };
        self.select_bit(reported, bits::on_screen(place.min(count - 1)));
    }

    /// Selects a bit and the part that contains it.
    fn select_bit(&mut self, reported: &DetailContent<'_>, bit: u16) {
        self.bit = Some(bit);
        if let Some(part) = part_at(&reported.payload, bit) {
            let is_it = |item: &DetailItem| item.leads == ItemTarget::Part(part);
            self.selected = reported.items.iter().position(is_it).unwrap_or(self.selected);
        }
    }

    fn open_target(&mut self, core: &UiState) -> Vec<PaneRequest> {
        let reported = self.detail_content(core);
        match reported.items.get(self.selected_item(&reported)).map(|item| item.leads.clone()) {
            Some(ItemTarget::Place(place)) => vec![PaneRequest::Go(place)],
            Some(ItemTarget::Frame(frame)) => {
                self.frame = if self.frame == Some(frame) { None } else { Some(frame) };
                self.bit = None;
                // The items above may have changed.
                let reported = self.detail_content(core);
                let is_it = |item: &DetailItem| item.leads == ItemTarget::Frame(frame);
                self.selected = reported.items.iter().position(is_it).unwrap_or(0);
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    fn plot_signals(&self, core: &UiState) -> Vec<PaneRequest> {
        let reported = self.detail_content(core);
        let part = self.selected_part(&reported).and_then(|part| reported.payload.parts.get(part));
        match part.and_then(|part| part.signal.clone()) {
            Some(signal) => {
                let text = format!("{} added to the plot", signal.name);
                vec![PaneRequest::Plot(signal), PaneRequest::Say(text)]
            }
            None => vec![PaneRequest::Refuse("select a field of a PDO or message to plot it".into())],
        }
    }
}

/// The event at the cursor; None after a frame without a shown event.
fn cursor_row(core: &UiState) -> Option<&ReplayRow> {
    core.cursor_row().filter(|row| {
        let frame = core.cursor.frame;
        row.spot.frame == frame || row.event.frames.last == frame || core.cursor.ordinal != u32::MAX
    })
}

fn payload_fields(payload: &PayloadBytes) -> Vec<bits::PayloadField<'_>> {
    let mut all = Vec::new();
    for (number, part) in payload.parts.iter().enumerate() {
        all.push(bits::PayloadField {
            name: part.name.as_str().into(),
            start_bit: part.bit,
            bits: part.bits,
            order: part.order,
            role_index: u8::try_from(number % 256).unwrap_or(0),
        });
    }
    all
}

fn part_at(payload: &PayloadBytes, bit: u16) -> Option<usize> {
    bits::field_at(&payload_fields(payload), bit)
}

fn first_on_screen(part: &payload::PayloadPart) -> u16 {
    use cobscope_decoder::profile::BitOrder;
    match part.order {
        BitOrder::BigEndian => bits::on_screen(part.bit),
        BitOrder::LittleEndian => {
            let last = part.bit.saturating_add(part.bits.saturating_sub(1));
            let byte = part.bit | 7;
            bits::on_screen(last.min(byte))
        }
    }
}

/// Areas for title, bits and text.
fn text_areas(reported: &DetailContent<'_>, title_lines: u16, area: Rect) -> DetailAreas {
    let title = Rect { height: title_lines.min(area.height), ..area };
    let rest = Rect { y: area.y + title.height, height: area.height - title.height, ..area };
    if reported.payload.bytes.is_empty() {
        return DetailAreas { title, bits: Rect { height: 0, ..rest }, text: rest };
    }
    if area.width >= WIDE {
        let width = if area.width >= EIGHT_BYTES + 72 { EIGHT_BYTES } else { FOUR_BYTES };
        let bits = Rect { width, ..rest };
        let text = Rect { x: rest.x + width + 1, width: rest.width - width - 1, ..rest };
        return DetailAreas { title, bits, text };
    }
    let block = if reported.payload.parts.is_empty() { 3 } else { 4 };
    let bytes_a_row = if area.width >= EIGHT_BYTES - 1 { 8 } else { 4 };
    let blocks = draw::to_cells(reported.payload.bytes.len().min(64).div_ceil(bytes_a_row));
    let height = (blocks * block).min(MOST_BITS).min(rest.height / 2);
    let bits = Rect { height, ..rest };
    DetailAreas { title, bits, text: Rect { y: rest.y + height, height: rest.height - height, ..rest } }
}

/// Time and place of the event, and its text.
fn title_text_lines(core: &UiState, reported: &DetailContent<'_>) -> Vec<Line<'static>> {
    let time = reported.row.map_or_else(|| core.cursor_time(), |row| row.event.time);
    let mut place: Vec<String> = core.time_words(time, 6).into_iter().collect();
    place.extend(time.and_then(date_text));
    let quiet = |place: &[String]| {
        let text = cobscope_decoder::sink::escape(&place.join("  ")).into_owned();
        Line::styled(text, core.theme.role_style(TextRole::Quiet))
    };
    let Some(row) = reported.row else {
        place.push(format!("frame {{{}}}", core.cursor.frame));
        place.push(reported.payload.title.clone());
        return vec![quiet(&place)];
    };
    match (row.event.frames.first, row.event.frames.last) {
        (0, 0) => {}
        (first, last) if first == last => place.push(format!("{{{last}}}")),
        (first, last) => place.push(format!("{{{first}}}..{{{last}}}")),
    }
    place.push(row.bus.clone());
    place.extend(Some(reported.payload.title.clone()).filter(|title| !title.is_empty()));
    place.extend(row.event.presumed.then(|| presumed_text(row.event.protocol).to_owned()));
    let text = format!("{} {} {}", row.who, row.kind, row.what).trim_start().to_owned();
    vec![quiet(&place), Line::styled(text, core.theme.role_style(role_of(row.tone)))]
}

/// Protocol of an event that no evidence confirms so far.
const fn presumed_text(protocol: EventProtocol) -> &'static str {
    match protocol {
        EventProtocol::Canopen => "presumed CANopen",
        EventProtocol::J1939 => "presumed J1939",
        EventProtocol::Uds => "presumed UDS",
        _ => "presumed",
    }
}

/// Date and time of a timestamp from 1973 on; earlier ones count from the start of the capture.
fn date_text(time: Timestamp) -> Option<String> {
    const FIRST: i64 = 100_000_000_000_000_000;
    let stamp = jiff::Timestamp::from_nanosecond(i128::from(time.0)).ok().filter(|_| time.0 >= FIRST)?;
    Some(stamp.strftime("%Y-%m-%d %H:%M:%S UTC").to_string())
}

/// Height of the title.
fn title_lines(core: &UiState, title: &[Line<'static>], area: Rect) -> u16 {
    draw::to_cells(TextLines::new(&core.theme, title).line_count(area.width)).min(area.height / 4).max(1)
}

impl Pane for DetailPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        if core.window.is_none() {
            draw::put_text(
                buf,
                area.x,
                area.y,
                area.width,
                "reading …",
                core.theme.role_style(TextRole::Quiet),
            );
            return;
        }
        let reported = self.detail_content(core);
        let title = title_text_lines(core, &reported);
        let parts = text_areas(&reported, title_lines(core, &title, area), area);
        TextLines::new(&core.theme, &title).render(parts.title, buf);
        let fields = payload_fields(&reported.payload);
        PayloadBits::new(&core.theme, &reported.payload.bytes)
            .with_fields(&fields)
            .select_field(self.selected_part(&reported))
            .with_cursor(self.bit)
            .without_legend()
            .render(parts.bits, buf);
        if parts.text.x > area.x {
            for y in parts.text.top()..parts.text.bottom() {
                let glyph = core.theme.glyph(Glyph::Vertical);
                draw::put_text(buf, parts.text.x - 1, y, 1, glyph, core.theme.role_style(TextRole::Border));
            }
        }
        self.draw_text(core, &reported, parts.text, buf);
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let reported = self.detail_content(core);
        let page = isize::try_from(core.height / 3).unwrap_or(1).max(1);
        match action {
            Action::Down => self.step_selection(&reported, 1),
            Action::Up => self.step_selection(&reported, -1),
            Action::PageDown => self.step_selection(&reported, page),
            Action::PageUp => self.step_selection(&reported, -page),
            Action::Top => self.step_selection(&reported, isize::MIN),
            Action::Bottom => self.step_selection(&reported, isize::MAX),
            Action::Left => self.step_bit(&reported, -1),
            Action::Right => self.step_bit(&reported, 1),
            Action::Open | Action::Toggle => return self.open_target(core),
            Action::Plot => return self.plot_signals(core),
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let reported = self.detail_content(core);
        let parts = text_areas(&reported, title_lines(core, &title_text_lines(core, &reported), area), area);
        let fields = payload_fields(&reported.payload);
        let bits = PayloadBits::new(&core.theme, &reported.payload.bytes).with_fields(&fields);
        let bits = bits.select_field(self.selected_part(&reported)).with_cursor(self.bit).without_legend();
        if let Some(bit) = bits.bit_at(parts.bits, x, y) {
            self.select_bit(&reported, bit);
        } else if let Some(item) = self.item_at(core, &reported, parts.text, x, y) {
            self.selected = item;
            self.bit = None;
        }
        Vec::new()
    }

    fn refresh_state(&mut self, core: &UiState) {
        let spot = core.cursor_row().map(|row| row.spot).filter(|_| cursor_row(core).is_some());
        let spot = spot.unwrap_or(core.cursor);
        let spot = Some((spot, spot <= core.cursor));
        if self.spot != spot {
            *self = Self { spot, ..Self::default() };
        }
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::DETAIL
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Plot]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
        &[
            Action::Back,
            Action::Down,
            Action::Right,
            Action::Open,
            Action::FilterCell,
            Action::Plot,
            Action::NextFinding,
            Action::NextError,
        ]
    }

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let reported = self.detail_content(core);
        let item = reported.items.get(self.selected_item(&reported))?;
        let part = self.selected_part(&reported).and_then(|part| reported.payload.parts.get(part));
        let of_part = part
            .and_then(|part| part.signal.as_ref())
            .map(|signal| format!("signals.name == {:?}", signal.name));
        item.filter.clone().or(of_part)
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let reported = self.detail_content(core);
        reported.items.get(self.selected_item(&reported)).map(DetailItem::clipboard_text)
    }
}
