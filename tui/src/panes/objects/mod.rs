//! Objects: known object values of a node at the cursor, with their origin.
//!
//! ```text
//! node 32/20 on can0, Danfoss PVE: 4 objects at 7.204 s   x next node  / index or name
//! Object   Name                     Value       Raw        Origin            Age     Persists Pending
//! 6300:01  Spool set point          37.5 %      00 18      sent {69}         3.194 s
//! 2100:00  Node-ID                  32          20         written {88}      5.200 s yes      33 after reset
//! ```
//!
//! The details of the selected object are below. `/` searches index and name, also in objects with a default
//! only.

mod rows;

use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Line;

use super::common::{act_on_column, chosen_columns, move_in};
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest, Sorting};
use crate::action::Action;
use crate::state::{DIFFERS, JumpPlace, NodeKey, UiState};
use crate::theme::TextRole;
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableCell, TableColumn, TableRow, TableState, TableWidget};
use crate::widgets::text_lines::TextLines;
use rows::{KnownObject, ObjectsNode};

/// Maximum number of lines of the details.
const ABOUT: u16 = 7;

/// The table of objects.
#[derive(Debug, Default)]
pub struct ObjectsPane {
    state: TableState,
    /// Selected object; the selection stays on it when rows are added.
    object: Option<ObjectAddress>,
    search: String,
    /// Node shown last; another node resets the selection.
    node: Option<NodeKey>,
}

/// Columns in the order of [`ObjectsNode::cell_text`].
fn object_columns() -> Vec<TableColumn> {
    vec![
        TableColumn::new("Object", ColumnWidth::Fixed(7)),
        TableColumn::new("Name", ColumnWidth::Min(24)),
        TableColumn::new("Value", ColumnWidth::Min(16)).with_priority(9),
        TableColumn::new("Raw", ColumnWidth::Fixed(12)).with_priority(4),
        TableColumn::new("Origin", ColumnWidth::Fixed(16)).with_priority(8),
        TableColumn::new("Age", ColumnWidth::Fixed(9)).align_right().with_priority(5),
        TableColumn::new("Persists", ColumnWidth::Fixed(8)).with_priority(3),
        TableColumn::new("Pending", ColumnWidth::Fixed(24)).with_priority(2),
    ]
}

/// Areas of head, table and details.
fn pane_areas(area: Rect) -> [Rect; 3] {
    let head = Rect { height: 1.min(area.height), ..area };
    let rest = area.height - head.height;
    let about = ABOUT.min(rest / 3);
    let table = Rect { y: head.bottom(), height: rest - about, ..area };
    [head, table, Rect { y: table.bottom(), height: about, ..area }]
}

impl ObjectsPane {
    fn known_objects<'a>(&self, subject: &ObjectsNode<'a>) -> Vec<KnownObject<'a>> {
        let mut rows = subject.object_rows(&self.search);
        if let Some((column, is_descending)) = self.state.sort {
            rows.sort_by(|one, other| {
                let order = subject.compare_objects(one, other, column);
                if is_descending { order.reverse() } else { order }
            });
        }
        rows
    }

    fn move_selection(&mut self, core: &UiState, action: Action) {
        let Some(subject) = ObjectsNode::selected_node(core) else { return };
        let rows = self.known_objects(&subject);
        let len = rows.len();
        self.state = self.table_state(&rows);
        let [_, table, _] = pane_areas(Rect::new(0, 0, 80, core.height));
        let height = TableWidget::visible_height(table);
        move_in(&mut self.state, action, height, len);
        self.object = rows.get(self.state.selected).map(KnownObject::address);
    }

    /// Indices of the visible columns.
    fn visible_columns(&self, core: &UiState) -> Vec<usize> {
        let [_, table, _] = pane_areas(Rect::new(0, 0, core.width, core.height));
        let count = ObjectsNode::selected_node(core).map_or(0, |subject| self.known_objects(&subject).len());
        let columns = chosen_columns(core, "objects", object_columns(), object_columns());
        TableWidget::new(&core.theme, &columns).row_count(count).visible_columns(table)
    }

    /// The table state with the current row of the selected object.
    fn table_state(&self, rows: &[KnownObject<'_>]) -> TableState {
        let place = rows.iter().position(|known| Some(known.address()) == self.object);
        let mut state = TableState { selected: place.unwrap_or(self.state.selected), ..self.state.clone() };
        state.clamp_to(rows.len());
        state
    }

    fn selected_object<'a, 'b>(&self, rows: &'b [KnownObject<'a>]) -> Option<&'b KnownObject<'a>> {
        rows.get(self.table_state(rows).selected)
    }

    fn next_node(core: &UiState) -> Vec<PaneRequest> {
        let all = rows::known_nodes(core);
        let present = ObjectsNode::selected_node(core).map(|subject| subject.key());
        let at = all.iter().position(|key| Some(*key) == present);
        let next = at.map_or(0, |at| (at + 1) % all.len().max(1));
        match all.get(next) {
            Some(node) if all.len() > 1 => vec![PaneRequest::Node(*node)],
            _ => vec![PaneRequest::Refuse("no other node has known objects".into())],
        }
    }

    fn head_line(&self, core: &UiState, subject: &ObjectsNode<'_>, count: usize) -> Line<'static> {
        let found = if self.search.is_empty() {
            count_noun(count, "object")
        } else {
            format!("{count} with \"{}\"", self.search)
        };
        let time = core.time_words(core.cursor_time(), 3).map_or(String::new(), |time| format!(" at {time}"));
        let others = rows::known_nodes(core).len().saturating_sub(1);
        let more = if others > 0 { format!("  (x: next of {} nodes)", others + 1) } else { String::new() };
        let other = core.against.compared_name().unwrap_or_default();
        let differ = match subject.difference_count(core) {
            0 => String::new(),
            count => format!(", {count} {DIFFERS} {other}"),
        };
        let text = format!("{}: {found}{differ}{time}{more}", subject.label());
        Line::styled(
            cobscope_decoder::sink::escape(&text).into_owned(),
            core.theme.role_style(TextRole::Title),
        )
    }
}

impl Pane for ObjectsPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let [head, table, about] = pane_areas(area);
        let Some(subject) = ObjectsNode::selected_node(core) else {
            let text =
                if core.window.is_none() { "reading …" } else { "no objects known up to the cursor" };
            draw::put_text(buf, head.x, head.y, head.width, text, core.theme.role_style(TextRole::Quiet));
            return;
        };
        let rows = self.known_objects(&subject);
        draw::draw_line(
            buf,
            head,
            &self.head_line(core, &subject, rows.len()),
            draw::TextAlignment::Left,
            &core.theme,
        );
        let row = |index: usize| -> TableRow<'_> {
            rows.get(index).map_or_else(TableRow::default, |known| {
                let style = |column| {
                    subject
                        .cell_role(core, known, column)
                        .map_or(Style::new(), |role| core.theme.role_style(role))
                };
                let cells = (0..object_columns().len())
                    .map(|column| TableCell::new(subject.cell_text(core, known, column), style(column)));
                TableRow::new(cells)
            })
        };
        let columns = chosen_columns(core, "objects", object_columns(), object_columns());
        let state = self.table_state(&rows);
        let empty = if self.search.is_empty() {
            "no objects of this node known up to the cursor"
        } else {
            "no index or name matches; c shows all objects"
        };
        TableWidget::new(&core.theme, &columns)
            .row_count(rows.len())
            .with_rows(row)
            .with_state(&state)
            .with_empty_text(empty)
            .render(table, buf);
        if let Some(known) = self.selected_object(&rows) {
            let lines: Vec<Line<'_>> = subject
                .detail_lines(core, known)
                .into_iter()
                .map(|text| Line::styled(text, core.theme.role_style(TextRole::Quiet)))
                .collect();
            TextLines::new(&core.theme, &lines).render(about, buf);
        }
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                self.move_selection(core, action);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.visible_columns(core);
                act_on_column(&mut self.state, action, &shown);
            }
            Action::Clear => self.search.clear(),
            Action::Toggle => return Self::next_node(core),
            Action::Open => {
                let Some(subject) = ObjectsNode::selected_node(core) else { return Vec::new() };
                let rows = self.known_objects(&subject);
                let Some(frame) = self.selected_object(&rows).and_then(KnownObject::frame) else {
                    return vec![PaneRequest::Refuse("this value is not from a frame".into())];
                };
                // The node stays selected when the user comes back to its objects.
                let node = PaneRequest::Node(subject.key());
                return vec![node, PaneRequest::Go(JumpPlace::Frame(frame)), PaneRequest::ShowDetail];
            }
            Action::Back if !self.search.is_empty() => {
                self.search.clear();
                return vec![PaneRequest::Say("all objects".into())];
            }
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let [_, place, _] = pane_areas(area);
        let Some(subject) = ObjectsNode::selected_node(core) else { return Vec::new() };
        let columns = chosen_columns(core, "objects", object_columns(), object_columns());
        let rows = self.known_objects(&subject);
        let table = TableWidget::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(place, x) {
            self.state.column = column;
        }
        if TableWidget::is_title_at(place, y) {
            self.state.cycle_sort(&table.visible_columns(place));
        } else if let Some(row) = table.row_at(place, y, &self.table_state(&rows)) {
            self.state.selected = row;
            self.object = rows.get(row).map(KnownObject::address);
        }
        Vec::new()
    }

    fn refresh_state(&mut self, core: &UiState) {
        let node = ObjectsNode::selected_node(core).map(|subject| subject.key());
        if node.is_some() && node != self.node {
            self.node = node;
            self.object = None;
            self.state =
                TableState { sort: self.state.sort, column: self.state.column, ..TableState::default() };
        }
    }

    fn search_text(&mut self, text: &str, _core: &UiState) -> bool {
        text.trim().clone_into(&mut self.search);
        self.state.select_first();
        self.object = None;
        true
    }

    fn sought_text(&self) -> Option<&str> {
        Some(&self.search)
    }

    fn table_sorting(&self) -> Sorting {
        self.state.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.state.sort = sorting;
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::OBJECTS
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        object_columns()
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Sort]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
        &[
            Action::Search,
            Action::Toggle,
            Action::Sort,
            Action::Open,
            Action::FilterCell,
            Action::NextFinding,
            Action::GoTo,
        ]
    }

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let subject = ObjectsNode::selected_node(core)?;
        let rows = self.known_objects(&subject);
        let known = self.selected_object(&rows)?;
        Some(format!("object == 0x{}", known.address()))
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let subject = ObjectsNode::selected_node(core)?;
        let rows = self.known_objects(&subject);
        let known = self.selected_object(&rows)?;
        let cells = (0..object_columns().len()).map(|column| subject.cell_text(core, known, column));
        Some(cells.filter(|cell| !cell.is_empty()).collect::<Vec<_>>().join("  "))
    }
}
