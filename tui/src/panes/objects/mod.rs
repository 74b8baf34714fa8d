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
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::Line;

use super::common::{act_on_column, chosen, move_in};
use super::legend::{self, Legend};
use super::{Effect, Pane, Sorting};
use crate::action::Action;
use crate::state::{Core, DIFFERS, JumpPlace, NodeKey};
use crate::theme::Role;
use crate::widgets::draw;
use crate::widgets::table::{Cell, Column, Row, Table, TableState, Width};
use crate::widgets::text_lines::TextLines;
use rows::{KnownObject, Subject};

/// Maximum number of lines of the details.
const ABOUT: u16 = 7;

/// The table of objects.
#[derive(Debug, Default)]
pub struct Objects {
    state: TableState,
    /// Selected object; the selection stays on it when rows are added.
    object: Option<ObjectAddress>,
    search: String,
    /// Node shown last; another node resets the selection.
    node: Option<NodeKey>,
}

/// Columns in the order of [`Subject::cell`].
fn columns() -> Vec<Column> {
    vec![
        Column::new("Object", Width::Fixed(7)),
        Column::new("Name", Width::Min(24)),
        Column::new("Value", Width::Min(16)).priority(9),
        Column::new("Raw", Width::Fixed(12)).priority(4),
        Column::new("Origin", Width::Fixed(16)).priority(8),
        Column::new("Age", Width::Fixed(9)).right().priority(5),
        Column::new("Persists", Width::Fixed(8)).priority(3),
        Column::new("Pending", Width::Fixed(24)).priority(2),
    ]
}

/// Areas of head, table and details.
fn layout(area: Rect) -> [Rect; 3] {
    let head = Rect { height: 1.min(area.height), ..area };
    let rest = area.height - head.height;
    let about = ABOUT.min(rest / 3);
    let table = Rect { y: head.bottom(), height: rest - about, ..area };
    [head, table, Rect { y: table.bottom(), height: about, ..area }]
}

impl Objects {
    fn rows<'a>(&self, subject: &Subject<'a>) -> Vec<KnownObject<'a>> {
        let mut rows = subject.rows(&self.search);
        if let Some((column, is_descending)) = self.state.sort {
            rows.sort_by(|one, other| {
                let order = subject.compare(one, other, column);
                if is_descending { order.reverse() } else { order }
            });
        }
        rows
    }

    fn go(&mut self, core: &Core, action: Action) {
        let Some(subject) = Subject::of(core) else { return };
        let rows = self.rows(&subject);
        let len = rows.len();
        self.state = self.state(&rows);
        let [_, table, _] = layout(Rect::new(0, 0, 80, core.height));
        let height = Table::height(table);
        move_in(&mut self.state, action, height, len);
        self.object = rows.get(self.state.selected).map(KnownObject::address);
    }

    /// Indices of the visible columns.
    fn shown(&self, core: &Core) -> Vec<usize> {
        let [_, table, _] = layout(Rect::new(0, 0, core.width, core.height));
        let count = Subject::of(core).map_or(0, |subject| self.rows(&subject).len());
        let columns = chosen(core, "objects", columns(), columns());
        Table::new(&core.theme, &columns).row_count(count).shown(table)
    }

    /// The table state with the current row of the selected object.
    fn state(&self, rows: &[KnownObject<'_>]) -> TableState {
        let place = rows.iter().position(|known| Some(known.address()) == self.object);
        let mut state = TableState { selected: place.unwrap_or(self.state.selected), ..self.state.clone() };
        state.clamp(rows.len());
        state
    }

    fn selected<'a, 'b>(&self, rows: &'b [KnownObject<'a>]) -> Option<&'b KnownObject<'a>> {
        rows.get(self.state(rows).selected)
    }

    fn next_node(core: &Core) -> Vec<Effect> {
        let all = rows::nodes(core);
        let present = Subject::of(core).map(|subject| subject.key());
        let at = all.iter().position(|key| Some(*key) == present);
        let next = at.map_or(0, |at| (at + 1) % all.len().max(1));
        match all.get(next) {
            Some(node) if all.len() > 1 => vec![Effect::Node(*node)],
            _ => vec![Effect::Refuse("no other node has known objects".into())],
        }
    }

    fn head(&self, core: &Core, subject: &Subject<'_>, count: usize) -> Line<'static> {
        let found = if self.search.is_empty() {
            plural(count, "object")
        } else {
            format!("{count} with \"{}\"", self.search)
        };
        let time = core.time_words(core.time(), 3).map_or(String::new(), |time| format!(" at {time}"));
        let others = rows::nodes(core).len().saturating_sub(1);
        let more = if others > 0 { format!("  (x: next of {} nodes)", others + 1) } else { String::new() };
        let other = core.compared_name().unwrap_or_default();
        let differ = match subject.differences(core) {
            0 => String::new(),
            count => format!(", {count} {DIFFERS} {other}"),
        };
        let text = format!("{}: {found}{differ}{time}{more}", subject.label());
        Line::styled(cobscope_decoder::sink::escape(&text).into_owned(), core.theme.style(Role::Title))
    }
}

impl Pane for Objects {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let [head, table, about] = layout(area);
        let Some(subject) = Subject::of(core) else {
            let text =
                if core.window.is_none() { "reading …" } else { "no objects known up to the cursor" };
            draw::put(buf, head.x, head.y, head.width, text, core.theme.style(Role::Quiet));
            return;
        };
        let rows = self.rows(&subject);
        draw::line(buf, head, &self.head(core, &subject, rows.len()), draw::Align::Left, &core.theme);
        let row = |index: usize| -> Row<'_> {
            rows.get(index).map_or_else(Row::default, |known| {
                let style = |column| {
                    subject.role(core, known, column).map_or(Style::new(), |role| core.theme.style(role))
                };
                let cells = (0..columns().len())
                    .map(|column| Cell::new(subject.cell(core, known, column), style(column)));
                Row::new(cells)
            })
        };
        let columns = chosen(core, "objects", columns(), columns());
        let state = self.state(&rows);
        let empty = if self.search.is_empty() {
            "no objects of this node known up to the cursor"
        } else {
            "no index or name matches; c shows all objects"
        };
        Table::new(&core.theme, &columns)
            .row_count(rows.len())
            .rows(row)
            .state(&state)
            .empty(empty)
            .render(table, buf);
        if let Some(known) = self.selected(&rows) {
            let lines: Vec<Line<'_>> = subject
                .about(core, known)
                .into_iter()
                .map(|text| Line::styled(text, core.theme.style(Role::Quiet)))
                .collect();
            TextLines::new(&core.theme, &lines).render(about, buf);
        }
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                self.go(core, action);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.shown(core);
                act_on_column(&mut self.state, action, &shown);
            }
            Action::Clear => self.search.clear(),
            Action::Toggle => return Self::next_node(core),
            Action::Open => {
                let Some(subject) = Subject::of(core) else { return Vec::new() };
                let rows = self.rows(&subject);
                let Some(frame) = self.selected(&rows).and_then(KnownObject::frame) else {
                    return vec![Effect::Refuse("this value is not from a frame".into())];
                };
                // The node stays selected when the user comes back to its objects.
                let node = Effect::Node(subject.key());
                return vec![node, Effect::Go(JumpPlace::Frame(frame)), Effect::ShowDetail];
            }
            Action::Back if !self.search.is_empty() => {
                self.search.clear();
                return vec![Effect::Say("all objects".into())];
            }
            _ => {}
        }
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let [_, place, _] = layout(area);
        let Some(subject) = Subject::of(core) else { return Vec::new() };
        let columns = chosen(core, "objects", columns(), columns());
        let rows = self.rows(&subject);
        let table = Table::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(place, x) {
            self.state.column = column;
        }
        if Table::is_title_at(place, y) {
            self.state.cycle_sort(&table.shown(place));
        } else if let Some(row) = table.row_at(place, y, &self.state(&rows)) {
            self.state.selected = row;
            self.object = rows.get(row).map(KnownObject::address);
        }
        Vec::new()
    }

    fn refresh(&mut self, core: &Core) {
        let node = Subject::of(core).map(|subject| subject.key());
        if node.is_some() && node != self.node {
            self.node = node;
            self.object = None;
            self.state =
                TableState { sort: self.state.sort, column: self.state.column, ..TableState::default() };
        }
    }

    fn search(&mut self, text: &str, _core: &Core) -> bool {
        text.trim().clone_into(&mut self.search);
        self.state.home();
        self.object = None;
        true
    }

    fn sought(&self) -> Option<&str> {
        Some(&self.search)
    }

    fn sorting(&self) -> Sorting {
        self.state.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.state.sort = sorting;
    }

    fn legend(&self) -> &'static Legend {
        &legend::OBJECTS
    }

    fn heads(&self) -> Vec<Column> {
        columns()
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Sort]
    }

    fn actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        let subject = Subject::of(core)?;
        let rows = self.rows(&subject);
        let known = self.selected(&rows)?;
        Some(format!("object == 0x{}", known.address()))
    }

    fn line(&self, core: &Core) -> Option<String> {
        let subject = Subject::of(core)?;
        let rows = self.rows(&subject);
        let known = self.selected(&rows)?;
        let cells = (0..columns().len()).map(|column| subject.cell(core, known, column));
        Some(cells.filter(|cell| !cell.is_empty()).collect::<Vec<_>>().join("  "))
    }
}
