//! Nodes at the cursor: one row per node with its set points, actual values, gates and errors.
//!
//! ```text
//! ID/hex Name     Device  NMT   State        Set → actual                    Eff Alive      Errors
//!   – –  PLC      master  –     –            SYNC 10.0 ms, jitter max 4.2    –   guards 2,5 –
//!   1 01 rotator  MD2 amp OPER  c1 ACTIVE    c1 +24.0 % → no actual          yes HB 0.4/1.0 2311 12s
//!                               c2 FAULT     c2 +10.0 %                      NO  R stuck
//!  32 20 boom     PVEA    OPER  FAULT HOLD   spool +37.5 % → 0.0 %           NO  rx 0.1     8305 41s
//! SA 80  boom2    PVEA    J1939 EXTEND       flow +42.0 % → +41 %            yes AVC .1/.25 –
//!   ? –  444      orphan  –     10.0 ms      since 3.110 s, no known consumer –  rx 0.0     –
//! ──────────────────────────────────────────────────────────────────────────────────────────────────
//! node 32/20 boom · PVEA …                            details of the selected row
//! ```

mod detail;
mod gates;
mod line;
mod node;
mod order;
mod others;
mod values;
mod wishes;

use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

use self::line::{Key, Line, StyledCell};
use self::node::Subject;
use self::order::{EFFECT, Order, VALUES, columns};
use self::wishes::{filter_of, signals, subject, to_events};
use super::common::chosen;
use super::legend::{self, Legend};
use super::{Effect, Pane, Sorting};
use crate::action::Action;
use crate::state::{Core, DIFFERS, NodeKey};
use crate::theme::{Glyph, Role};
use crate::widgets::draw;
use crate::widgets::table::{Cell, Column, Row, Table, TableState};
use crate::widgets::text_lines::TextLines;

/// Minimum height of the details, and height of the pane from which they are shown.
const DETAIL: (u16, u16) = (6, 14);

/// The table of nodes.
#[derive(Debug)]
pub struct Nodes {
    order: Order,
    /// Subject of the selected row; `place` is used if that row no longer exists.
    key: Option<Key>,
    place: usize,
    column: usize,
    /// First visible line of the gates; None while they are closed.
    gates: Option<usize>,
}

/// The column of gates is selected at first, so Enter opens them at once.
impl Default for Nodes {
    fn default() -> Self {
        Self { order: Order::default(), key: None, place: 0, column: EFFECT, gates: None }
    }
}

impl Nodes {
    fn lines(&self, core: &Core) -> Vec<Line> {
        let Some(world) = core.world() else { return Vec::new() };
        let mut all = Vec::new();
        for bus in world.buses() {
            let lines = self.of_bus(core, world, bus);
            if world.buses().len() > 1 && !lines.is_empty() {
                let mut head = Line::new(Key::Bus(bus.index()));
                head.name = escape(bus.name()).into_owned();
                all.push(head);
            }
            all.extend(lines);
        }
        all
    }

    fn of_bus(&self, core: &Core, world: &ReplayState, bus: &Bus) -> Vec<Line> {
        let now = core.time();
        let mut blocks: Vec<Vec<Line>> =
            others::master(world, bus).into_iter().map(|line| vec![line]).collect();
        for node in bus.nodes().filter(|node| is_there(world, node)) {
            blocks.push(Subject::new(world, bus, node, now).lines());
        }
        blocks.extend(others::orphans(world, bus, now).into_iter().map(|line| vec![line]));
        // All outputs of a node stay together.
        match self.order {
            Order::Number => {}
            Order::Worst => blocks.sort_by_key(|lines| lines.iter().map(|line| line.grade).min()),
            Order::Name => blocks.sort_by_key(|lines| first(lines, |line| &line.name)),
            Order::Device => blocks.sort_by_key(|lines| first(lines, |line| &line.device)),
        }
        blocks.into_iter().flatten().collect()
    }

    /// Index of the selected row.
    fn selected(&self, lines: &[Line]) -> usize {
        let at = match self.key {
            Some(key) => {
                let own = lines.iter().position(|line| line.key == key);
                // Its outputs may have rows of their own by now.
                let same = |line: &Line| key.node().is_some() && line.key.node() == key.node();
                own.or_else(|| lines.iter().position(same))
            }
            // Without a selection: the first node.
            None => lines.iter().position(|line| line.key.node().is_some()),
        };
        at.unwrap_or(self.place).min(lines.len().saturating_sub(1))
    }

    fn select(&mut self, lines: &[Line], place: usize) -> Vec<Effect> {
        self.place = place.min(lines.len().saturating_sub(1));
        self.key = lines.get(self.place).map(|line| line.key);
        self.key.and_then(Key::node).map(Effect::Node).into_iter().collect()
    }

    fn chosen(&self, core: &Core) -> Option<Key> {
        let lines = self.lines(core);
        lines.get(self.selected(&lines)).map(|line| line.key)
    }

    fn state(&self, lines: &[Line]) -> TableState {
        let sort = self.order.column();
        TableState { selected: self.selected(lines), column: self.column, sort, ..TableState::default() }
    }

    /// Indices of the visible columns.
    fn shown(&self, core: &Core) -> Vec<usize> {
        let count = self.lines(core).len();
        let (table, _) = split(Rect::new(0, 0, core.width, core.height), count);
        let columns = chosen(core, "nodes", columns(0), columns(core.width));
        Table::new(&core.theme, &columns).row_count(count).shown(table)
    }

    fn open(&mut self, core: &Core) -> Vec<Effect> {
        let Some(key) = self.chosen(core) else { return Vec::new() };
        let column = self.state(&self.lines(core)).column_in(&self.shown(core));
        if let Some(node) = key.node().filter(|_| column == EFFECT) {
            self.gates = Some(0);
            return vec![Effect::Node(node)];
        }
        let filter = self.filter_of_cell(core);
        filter.map_or_else(Vec::new, |filter| to_events(core, key.node(), filter))
    }

    fn plot(&self, core: &Core) -> Vec<Effect> {
        let signals = self.chosen(core).map_or_else(Vec::new, |key| signals(core, key));
        if signals.is_empty() {
            return vec![Effect::Refuse("no set point or actual value to plot".into())];
        }
        let names: Vec<_> = signals.iter().map(|signal| signal.name.clone()).collect();
        let said = Effect::Say(format!("plotted: {}", names.join(", ")));
        let shown = Effect::ShowSignals;
        signals.into_iter().map(Effect::Plot).chain([shown, said]).collect()
    }

    fn scroll_gates(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let Some(scroll) = &mut self.gates else { return Vec::new() };
        let page = usize::from(core.height.saturating_sub(4)).max(1);
        match action {
            Action::Down => *scroll += 1,
            Action::Up => *scroll = scroll.saturating_sub(1),
            Action::PageDown => *scroll += page,
            Action::PageUp => *scroll = scroll.saturating_sub(page),
            Action::Back | Action::Open => {
                self.gates = None;
                // With an empty result the application would go to the previous pane.
                let node = self.key.and_then(Key::node).or(core.node);
                return node.map(Effect::Node).into_iter().collect();
            }
            _ => {}
        }
        Vec::new()
    }

    fn draw_detail(core: &Core, line: Option<&Line>, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let rule = theme.glyph(Glyph::Horizontal).repeat(usize::from(area.width));
        draw::put(buf, area.x, area.y, area.width, &rule, theme.style(Role::Border));
        let below = Rect { y: area.y + 1, height: area.height.saturating_sub(1), ..area };
        let Some(line) = line else { return };
        let lines = match line.key.node().and_then(|node| subject(core, node)) {
            Some(subject) => detail::of_node(core, &subject, line.key.channel()),
            None => detail::of_other(core, line.key),
        };
        TextLines::new(theme, &lines).render(below, buf);
    }

    fn row(core: &Core, line: &Line, room: u16) -> Row<'static> {
        let theme = &core.theme;
        let cell = |shown: &StyledCell| Cell::new(shown.text.clone(), theme.style(shown.role));
        if let Key::Bus(_) = line.key {
            let title = Cell::new(line.name.clone(), theme.style(Role::Title));
            return Row::new([Cell::default(), title]);
        }
        let quiet = theme.style(Role::Quiet);
        let values = line.values.fit(room, theme.glyph(Glyph::Arrow));
        let is_remark = line.values.pairs.is_empty() && line.key.node().is_none();
        let style = if is_remark { quiet } else { Style::new() };
        Row::new([
            line.id.clone().into(),
            marked_name(core, line),
            Cell::new(line.device.clone(), if line.key.node().is_none() { quiet } else { Style::new() }),
            cell(&line.nmt),
            cell(&line.state),
            Cell::new(values, style),
            cell(&line.effect()),
            cell(&line.alive),
            cell(&line.errors),
        ])
    }
}

impl Pane for Nodes {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let lines = self.lines(core);
        let (table, below) = split(area, lines.len());
        let columns = chosen(core, "nodes", columns(0), columns(area.width));
        let scrolls = u16::from(lines.len() > Table::height(table));
        let room = room(&columns, table.width - scrolls.min(table.width));
        let state = self.state(&lines);
        let row =
            |index: usize| lines.get(index).map_or_else(Row::default, |line| Self::row(core, line, room));
        let doubt = core.world().and_then(|world| world.buses().iter().find_map(Bus::doubt));
        let empty = match (core.world(), doubt) {
            (None, _) => "reading …".to_owned(),
            (Some(_), Some(doubt)) => format!("no nodes: {doubt}"),
            (Some(_), None) => "no nodes yet".to_owned(),
        };
        let drawn = Table::new(&core.theme, &columns).row_count(lines.len()).rows(row).state(&state);
        drawn.empty(&empty).render(table, buf);
        if !below.is_empty() {
            Self::draw_detail(core, lines.get(state.selected), below, buf);
        }
        let chosen = self.gates.zip(lines.get(state.selected));
        if let Some((scroll, line)) = chosen
            && let Some(subject) = line.key.node().and_then(|node| subject(core, node))
        {
            gates::draw(core, &subject, line.key.channel(), scroll, area, buf);
        }
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        if self.gates.is_some() {
            return self.scroll_gates(action, core);
        }
        let lines = self.lines(core);
        let at = self.selected(&lines);
        let page = usize::from(core.height.saturating_sub(DETAIL.0 + 2)).max(1);
        match action {
            Action::Down => self.select(&lines, at + 1),
            Action::Up => self.select(&lines, at.saturating_sub(1)),
            Action::PageDown => self.select(&lines, at + page),
            Action::PageUp => self.select(&lines, at.saturating_sub(page)),
            Action::Top => self.select(&lines, 0),
            Action::Bottom => self.select(&lines, usize::MAX),
            Action::Left | Action::Right => {
                let mut state = self.state(&lines);
                state.move_column(if action == Action::Left { -1 } else { 1 }, &self.shown(core));
                self.column = state.column;
                Vec::new()
            }
            Action::Sort => {
                self.key = lines.get(at).map(|line| line.key);
                self.order = self.order.next();
                vec![Effect::Say(self.order.words().into())]
            }
            Action::Open => self.open(core),
            Action::Plot => self.plot(core),
            _ => Vec::new(),
        }
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        if self.gates.take().is_some() {
            return Vec::new();
        }
        let lines = self.lines(core);
        let (inside, _) = split(area, lines.len());
        let columns = chosen(core, "nodes", columns(0), columns(area.width));
        let state = self.state(&lines);
        let table = Table::new(&core.theme, &columns).row_count(lines.len());
        if let Some(column) = table.column_at(inside, x) {
            self.column = column;
        }
        table.row_at(inside, y, &state).map_or_else(Vec::new, |row| self.select(&lines, row))
    }

    fn offer(&mut self, effect: &Effect, _core: &Core) {
        if let Effect::Node((bus, node)) = effect
            && self.key.and_then(Key::node) != Some((*bus, *node))
        {
            self.key = Some(Key::Node(*bus, *node, None));
        }
    }

    fn sorting(&self) -> Sorting {
        self.order.column()
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.order = Order::of_column(sorting);
    }

    fn legend(&self) -> &'static Legend {
        &legend::NODES
    }

    fn heads(&self) -> Vec<Column> {
        columns(0)
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort, Action::Plot]
    }

    fn actions(&self) -> &'static [Action] {
        if self.gates.is_some() {
            return &[Action::Back, Action::Down, Action::Up];
        }
        &[
            Action::Open,
            Action::Sort,
            Action::Plot,
            Action::Assign,
            Action::FilterCell,
            Action::NextFinding,
            Action::NextError,
            Action::GoTo,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        match self.chosen(core)? {
            Key::Node(bus, node, _) => Some(filter_of(core, (bus, node))),
            Key::Orphan(_, id) => Some(format!("can.id == 0x{:X}", id.number())),
            Key::Master(_) => Some("kind in {\"nmt-command\", \"sync\", \"guard-request\"}".into()),
            Key::Bus(index) => {
                let bus = core.world()?.buses().iter().find(|bus| bus.index() == index)?;
                Some(format!("bus == {:?}", bus.name()))
            }
        }
    }

    fn node(&self, core: &Core) -> Option<NodeKey> {
        self.chosen(core).and_then(Key::node)
    }

    fn line(&self, core: &Core) -> Option<String> {
        let lines = self.lines(core);
        let line = lines.get(self.selected(&lines))?;
        let values = line.values.fit(u16::MAX, core.theme.glyph(Glyph::Arrow));
        let cells = [
            line.id.as_str(),
            &line.name,
            &line.device,
            &line.nmt.text,
            &line.state.text,
            &values,
            &line.effect().text,
            &line.alive.text,
            &line.errors.text,
        ];
        Some(cells.join("  "))
    }
}

/// The name of a row, with a mark if the node differs from the other capture.
fn marked_name(core: &Core, line: &Line) -> Cell<'static> {
    match line.key.node() {
        Some(node) if !core.differences_of(node).is_empty() => {
            Cell::new(format!("{DIFFERS} {}", line.name), core.theme.style(Role::Caution))
        }
        _ => line.name.clone().into(),
    }
}

/// Whether the node has a row: it sent a frame, or the user named it and no other bus has it.
fn is_there(world: &ReplayState, node: &Node) -> bool {
    let is_heard = |node: &Node| node.last_seen().0 != 0;
    let elsewhere = || world.buses().iter().filter_map(|bus| bus.node(node.id())).any(is_heard);
    is_heard(node) || ((node.assigned().is_some() || node.name().is_some()) && !elsewhere())
}

fn first(lines: &[Line], text: impl Fn(&Line) -> &String) -> (bool, String) {
    let text = lines.first().map_or_else(String::new, |line| text(line).to_lowercase());
    (text.is_empty(), text)
}

/// Areas of table and details; the details take the space that the rows leave.
fn split(area: Rect, rows: usize) -> (Rect, Rect) {
    let (least, wanted) = DETAIL;
    if area.height < wanted {
        return (area, Rect::ZERO);
    }
    // The column heads and a line between.
    let needed = draw::cells(rows).saturating_add(2);
    let below = area.height.saturating_sub(needed).max(least);
    let table = Rect { height: area.height - below, ..area };
    (table, Rect { y: table.bottom(), height: below, ..area })
}

/// Width of the column of set points.
fn room(columns: &[Column], width: u16) -> u16 {
    Table::width_of(columns, VALUES, width)
}
