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

use self::line::{NodeRow, NodeRowKey, StyledCell};
use self::node::ShownNode;
use self::order::{EFFECT, NodeOrder, VALUES, node_columns};
use self::wishes::{filter_of, row_signals, shown_node, to_events};
use super::common::chosen_columns;
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest, Sorting};
use crate::action::Action;
use crate::state::{DIFFERS, NodeKey, UiState};
use crate::theme::{Glyph, TextRole};
use crate::widgets::draw;
use crate::widgets::table::{TableCell, TableColumn, TableRow, TableState, TableWidget};
use crate::widgets::text_lines::TextLines;

/// Minimum height of the details, and height of the pane from which they are shown.
const DETAIL: (u16, u16) = (6, 14);

/// The table of nodes.
#[derive(Debug)]
pub struct NodesPane {
    order: NodeOrder,
    /// Subject of the selected row; `place` is used if that row no longer exists.
    key: Option<NodeRowKey>,
    place: usize,
    column: usize,
    /// First visible line of the gates; None while they are closed.
    gates: Option<usize>,
}

/// The column of gates is selected at first, so Enter opens them at once.
impl Default for NodesPane {
    fn default() -> Self {
        Self { order: NodeOrder::default(), key: None, place: 0, column: EFFECT, gates: None }
    }
}

impl NodesPane {
    fn node_rows(&self, core: &UiState) -> Vec<NodeRow> {
        let Some(world) = core.bus_state() else { return Vec::new() };
        let mut all = Vec::new();
        for bus in world.buses() {
            let lines = self.of_bus(core, world, bus);
            if world.buses().len() > 1 && !lines.is_empty() {
                let mut head = NodeRow::new(NodeRowKey::Bus(bus.index()));
                head.name = escape(bus.name()).into_owned();
                all.push(head);
            }
            all.extend(lines);
        }
        all
    }

    fn of_bus(&self, core: &UiState, world: &ReplayState, bus: &Bus) -> Vec<NodeRow> {
        let now = core.cursor_time();
        let mut blocks: Vec<Vec<NodeRow>> =
            others::master_row(world, bus).into_iter().map(|line| vec![line]).collect();
        for node in bus.nodes().filter(|node| is_there(world, node)) {
            blocks.push(ShownNode::new(world, bus, node, now).node_rows());
        }
        blocks.extend(others::orphan_rows(world, bus, now).into_iter().map(|line| vec![line]));
        // All outputs of a node stay together.
        match self.order {
            NodeOrder::Number => {}
            NodeOrder::Worst => blocks.sort_by_key(|lines| lines.iter().map(|line| line.grade).min()),
            NodeOrder::Name => blocks.sort_by_key(|lines| first_text(lines, |line| &line.name)),
            NodeOrder::Device => blocks.sort_by_key(|lines| first_text(lines, |line| &line.device)),
        }
        blocks.into_iter().flatten().collect()
    }

    /// Index of the selected row.
    fn selected_index(&self, lines: &[NodeRow]) -> usize {
        let at = match self.key {
            Some(key) => {
                let own = lines.iter().position(|line| line.key == key);
                // Its outputs may have rows of their own by now.
                let same = |line: &NodeRow| key.node().is_some() && line.key.node() == key.node();
                own.or_else(|| lines.iter().position(same))
            }
            // Without a selection: the first node.
            None => lines.iter().position(|line| line.key.node().is_some()),
        };
        at.unwrap_or(self.place).min(lines.len().saturating_sub(1))
    }

    fn select_row(&mut self, lines: &[NodeRow], place: usize) -> Vec<PaneRequest> {
        self.place = place.min(lines.len().saturating_sub(1));
        self.key = lines.get(self.place).map(|line| line.key);
        self.key.and_then(NodeRowKey::node).map(PaneRequest::Node).into_iter().collect()
    }

    fn chosen_key(&self, core: &UiState) -> Option<NodeRowKey> {
        let lines = self.node_rows(core);
        lines.get(self.selected_index(&lines)).map(|line| line.key)
    }

    fn table_state(&self, lines: &[NodeRow]) -> TableState {
        let sort = self.order.sorted_column();
        TableState {
            selected: self.selected_index(lines),
            column: self.column,
            sort,
            ..TableState::default()
        }
    }

    /// Indices of the visible columns.
    fn visible_columns(&self, core: &UiState) -> Vec<usize> {
        let count = self.node_rows(core).len();
        let (table, _) = split_area(Rect::new(0, 0, core.width, core.height), count);
        let columns = chosen_columns(core, "nodes", node_columns(0), node_columns(core.width));
        TableWidget::new(&core.theme, &columns).row_count(count).visible_columns(table)
    }

    fn open_node(&mut self, core: &UiState) -> Vec<PaneRequest> {
        let Some(key) = self.chosen_key(core) else { return Vec::new() };
        let column = self.table_state(&self.node_rows(core)).column_in(&self.visible_columns(core));
        if let Some(node) = key.node().filter(|_| column == EFFECT) {
            self.gates = Some(0);
            return vec![PaneRequest::Node(node)];
        }
        let filter = self.filter_of_cell(core);
        filter.map_or_else(Vec::new, |filter| to_events(core, key.node(), filter))
    }

    fn plot_node(&self, core: &UiState) -> Vec<PaneRequest> {
        let signals = self.chosen_key(core).map_or_else(Vec::new, |key| row_signals(core, key));
        if signals.is_empty() {
            return vec![PaneRequest::Refuse("no set point or actual value to plot".into())];
        }
        let names: Vec<_> = signals.iter().map(|signal| signal.name.clone()).collect();
        let stated = PaneRequest::Say(format!("plotted: {}", names.join(", ")));
        let shown = PaneRequest::ShowSignals;
        signals.into_iter().map(PaneRequest::Plot).chain([shown, stated]).collect()
    }

    fn scroll_gates(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
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
                let node = self.key.and_then(NodeRowKey::node).or(core.node);
                return node.map(PaneRequest::Node).into_iter().collect();
            }
            _ => {}
        }
        Vec::new()
    }

    fn draw_detail(core: &UiState, line: Option<&NodeRow>, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let rule = theme.glyph(Glyph::Horizontal).repeat(usize::from(area.width));
        draw::put_text(buf, area.x, area.y, area.width, &rule, theme.role_style(TextRole::Border));
        let below = Rect { y: area.y + 1, height: area.height.saturating_sub(1), ..area };
        let Some(line) = line else { return };
        let lines = match line.key.node().and_then(|node| shown_node(core, node)) {
            Some(subject) => detail::of_node(core, &subject, line.key.channel()),
            None => detail::of_other(core, line.key),
        };
        TextLines::new(theme, &lines).render(below, buf);
    }

    fn table_row(core: &UiState, line: &NodeRow, room: u16) -> TableRow<'static> {
        let theme = &core.theme;
        let cell = |shown: &StyledCell| TableCell::new(shown.text.clone(), theme.role_style(shown.role));
        if let NodeRowKey::Bus(_) = line.key {
            let title = TableCell::new(line.name.clone(), theme.role_style(TextRole::Title));
            return TableRow::new([TableCell::default(), title]);
        }
        let quiet = theme.role_style(TextRole::Quiet);
        let values = line.values.fit_width(room, theme.glyph(Glyph::Arrow));
        let is_remark = line.values.pairs.is_empty() && line.key.node().is_none();
        let style = if is_remark { quiet } else { Style::new() };
        TableRow::new([
            line.id.clone().into(),
            marked_name(core, line),
            TableCell::new(line.device.clone(), if line.key.node().is_none() { quiet } else { Style::new() }),
            cell(&line.nmt),
            cell(&line.state),
            TableCell::new(values, style),
            cell(&line.effect_cell()),
            cell(&line.alive),
            cell(&line.errors),
        ])
    }
}

impl Pane for NodesPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let lines = self.node_rows(core);
        let (table, below) = split_area(area, lines.len());
        let columns = chosen_columns(core, "nodes", node_columns(0), node_columns(area.width));
        let scrolls = u16::from(lines.len() > TableWidget::visible_height(table));
        let room = values_width(&columns, table.width - scrolls.min(table.width));
        let state = self.table_state(&lines);
        let row = |index: usize| {
            lines.get(index).map_or_else(TableRow::default, |line| Self::table_row(core, line, room))
        };
        let doubt = core
            .bus_state()
            .and_then(|world| world.buses().iter().find_map(|bus| bus.protocols().detection_doubt()));
        let empty = match (core.bus_state(), doubt) {
            (None, _) => "reading …".to_owned(),
            (Some(_), Some(doubt)) => format!("no nodes: {doubt}"),
            (Some(_), None) => "no nodes yet".to_owned(),
        };
        let drawn =
            TableWidget::new(&core.theme, &columns).row_count(lines.len()).with_rows(row).with_state(&state);
        drawn.with_empty_text(&empty).render(table, buf);
        if !below.is_empty() {
            Self::draw_detail(core, lines.get(state.selected), below, buf);
        }
        let chosen = self.gates.zip(lines.get(state.selected));
        if let Some((scroll, line)) = chosen
            && let Some(subject) = line.key.node().and_then(|node| shown_node(core, node))
        {
            gates::draw_gates(core, &subject, line.key.channel(), scroll, area, buf);
        }
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        if self.gates.is_some() {
            return self.scroll_gates(action, core);
        }
        let lines = self.node_rows(core);
        let at = self.selected_index(&lines);
        let page = usize::from(core.height.saturating_sub(DETAIL.0 + 2)).max(1);
        match action {
            Action::Down => self.select_row(&lines, at + 1),
            Action::Up => self.select_row(&lines, at.saturating_sub(1)),
            Action::PageDown => self.select_row(&lines, at + page),
            Action::PageUp => self.select_row(&lines, at.saturating_sub(page)),
            Action::Top => self.select_row(&lines, 0),
            Action::Bottom => self.select_row(&lines, usize::MAX),
            Action::Left | Action::Right => {
                let mut state = self.table_state(&lines);
                state.move_column(if action == Action::Left { -1 } else { 1 }, &self.visible_columns(core));
                self.column = state.column;
                Vec::new()
            }
            Action::Sort => {
                self.key = lines.get(at).map(|line| line.key);
                self.order = self.order.next();
                vec![PaneRequest::Say(self.order.order_text().into())]
            }
            Action::Open => self.open_node(core),
            Action::Plot => self.plot_node(core),
            _ => Vec::new(),
        }
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        if self.gates.take().is_some() {
            return Vec::new();
        }
        let lines = self.node_rows(core);
        let (inside, _) = split_area(area, lines.len());
        let columns = chosen_columns(core, "nodes", node_columns(0), node_columns(area.width));
        let state = self.table_state(&lines);
        let table = TableWidget::new(&core.theme, &columns).row_count(lines.len());
        if let Some(column) = table.column_at(inside, x) {
            self.column = column;
        }
        table.row_at(inside, y, &state).map_or_else(Vec::new, |row| self.select_row(&lines, row))
    }

    fn on_request(&mut self, effect: &PaneRequest, _core: &UiState) {
        if let PaneRequest::Node((bus, node)) = effect
            && self.key.and_then(NodeRowKey::node) != Some((*bus, *node))
        {
            self.key = Some(NodeRowKey::Node(*bus, *node, None));
        }
    }

    fn table_sorting(&self) -> Sorting {
        self.order.sorted_column()
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.order = NodeOrder::of_column(sorting);
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::NODES
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        node_columns(0)
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort, Action::Plot]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        match self.chosen_key(core)? {
            NodeRowKey::Node(bus, node, _) => Some(filter_of(core, (bus, node))),
            NodeRowKey::Orphan(_, id) => Some(format!("can.id == 0x{:X}", id.number())),
            NodeRowKey::Master(_) => Some("kind in {\"nmt-command\", \"sync\", \"guard-request\"}".into()),
            NodeRowKey::Bus(index) => {
                let bus = core.bus_state()?.buses().iter().find(|bus| bus.index() == index)?;
                Some(format!("bus == {:?}", bus.name()))
            }
        }
    }

    fn selected_node(&self, core: &UiState) -> Option<NodeKey> {
        self.chosen_key(core).and_then(NodeRowKey::node)
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let lines = self.node_rows(core);
        let line = lines.get(self.selected_index(&lines))?;
        let values = line.values.fit_width(u16::MAX, core.theme.glyph(Glyph::Arrow));
        let cells = [
            line.id.as_str(),
            &line.name,
            &line.device,
            &line.nmt.text,
            &line.state.text,
            &values,
            &line.effect_cell().text,
            &line.alive.text,
            &line.errors.text,
        ];
        Some(cells.join("  "))
    }
}

/// The name of a row, with a mark if the node differs from the other capture.
fn marked_name(core: &UiState, line: &NodeRow) -> TableCell<'static> {
    match line.key.node() {
        Some(node) if !core.against.differences_of(core.bus_state(), node).is_empty() => {
            TableCell::new(format!("{DIFFERS} {}", line.name), core.theme.role_style(TextRole::Caution))
        }
        _ => line.name.clone().into(),
    }
}

/// Whether the node has a row: it sent a frame, or the user named it and no other bus has it.
fn is_there(world: &ReplayState, node: &Node) -> bool {
    let is_received = |node: &Node| node.last_seen().0 != 0;
    let elsewhere = || world.buses().iter().filter_map(|bus| bus.node(node.id())).any(is_received);
    is_received(node) || ((node.assigned_by().is_some() || node.name().is_some()) && !elsewhere())
}

fn first_text(lines: &[NodeRow], text: impl Fn(&NodeRow) -> &String) -> (bool, String) {
    let text = lines.first().map_or_else(String::new, |line| text(line).to_lowercase());
    (text.is_empty(), text)
}

/// Areas of table and details; the details take the space that the rows leave.
fn split_area(area: Rect, rows: usize) -> (Rect, Rect) {
    let (least, wanted) = DETAIL;
    if area.height < wanted {
        return (area, Rect::ZERO);
    }
    // The column heads and a line between.
    let needed = draw::to_cells(rows).saturating_add(2);
    let below = area.height.saturating_sub(needed).max(least);
    let table = Rect { height: area.height - below, ..area };
    (table, Rect { y: table.bottom(), height: below, ..area })
}

/// Width of the column of set points.
fn values_width(columns: &[TableColumn], width: u16) -> u16 {
    TableWidget::width_of(columns, VALUES, width)
}
