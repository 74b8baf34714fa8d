//! What several panes write alike.
//!
//! ```text
//!   7.204   -0.502   node == 5   can0
//! ```

use std::sync::Arc;

use cobscope_decoder::finding::Severity;
use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::replay::World;
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use crate::app::Core;
use crate::figures::seconds;
use crate::theme::{Glyph, Role, Theme};
use crate::widgets::draw;

/// Seconds from the first frame.
pub(super) fn time(core: &Core, time: Option<Timestamp>) -> String {
    time.zip(core.zero()).map_or(String::new(), |(time, zero)| seconds(time.since(zero)))
}

/// Seconds from the cursor: `-0.502` lies before it, `+1.200` behind it.
pub(super) fn ahead(core: &Core, time: Option<Timestamp>) -> String {
    let Some((time, cursor)) = time.zip(core.time().or(core.zero())) else { return String::new() };
    let ahead = time.since(cursor);
    let sign = if ahead > 0 { "+" } else { "" };
    format!("{sign}{}", seconds(ahead))
}

/// The filter that shows events of a node.
pub(super) fn node_filter(node: NodeId) -> String {
    match node {
        NodeId::Canopen(id) => format!("node == {id}"),
        NodeId::J1939(address) => format!("source_address == 0x{address:02X}"),
    }
}

/// The world that knows most buses: that of the end, once it is known.
fn widest(core: &Core) -> Option<Arc<World>> {
    core.timeline.end().or_else(|| core.window.as_ref().map(|window| Arc::clone(&window.world)))
}

/// Name of a bus, escaped.
pub(super) fn bus_name(core: &Core, bus: BusIndex) -> String {
    let world = widest(core);
    let bus = world.as_ref().and_then(|world| world.buses().get(usize::from(bus.0)));
    bus.map_or(String::new(), |bus| escape(bus.name()).into_owned())
}

/// Whether there is more than one bus.
pub(super) fn has_buses(core: &Core) -> bool {
    widest(core).is_some_and(|world| world.buses().len() > 1)
}

/// How a severity looks.
pub(super) const fn severity_role(severity: Severity) -> Role {
    match severity {
        Severity::Error => Role::Bad,
        Severity::Warning => Role::Caution,
        Severity::Note => Role::Note,
    }
}

/// A line across, with a title in it.
pub(super) fn divider(theme: &Theme, area: Rect, title: &str, buf: &mut Buffer) {
    let (line, style) = (theme.glyph(Glyph::Horizontal), theme.style(Role::Border));
    let all = line.repeat(usize::from(area.width));
    draw::put(buf, area.x, area.y, area.width, &all, style);
    if !title.is_empty() {
        let title = format!(" {title} ");
        let room = area.width.saturating_sub(2);
        draw::put(buf, area.x.saturating_add(2), area.y, room, &title, theme.style(Role::Title));
    }
}
