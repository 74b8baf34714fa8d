//! The gates of a node in a window over the table: conditions for its set points to act.
//!
//! ```text
//! ┌ 32/20 boom: spool NOT effective ────────────────────────────────────────┐
//! │ closed   device ACTIVE   FAULT HOLD              manual: Fault handling │
//! │          set points act in ACTIVE only                                  │
//! │ open     operational     operational                                    │
//! └──────────────────────────────────────────────────────────── esc closes ─┘
//! ```

use cobscope_decoder::session::{GateState, GateStatus};
use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line as Text, Span};
use ratatui::widgets::{Block, Clear, Widget as _};

use super::node::ShownNode;
use crate::state::UiState;
use crate::theme::TextRole;
use crate::widgets::text_lines::TextLines;

/// Draws the gates of an output, starting at line `scroll`.
pub fn draw_gates(
    core: &UiState,
    subject: &ShownNode<'_>,
    channel: Option<u8>,
    scroll: usize,
    area: Rect,
    buf: &mut Buffer,
) {
    let theme = &core.theme;
    let lines = set_point_lines(core, subject, channel);
    let name = subject.node.name().map_or_else(String::new, |name| format!(" {}", escape(name)));
    let channel = channel.map_or_else(String::new, |channel| format!(", c{channel}"));
    let title = format!(" {}{name}{channel}: gates ", subject.node.id().sentence_label());
    let height = u16::try_from(lines.len()).unwrap_or(u16::MAX).saturating_add(2).min(area.height);
    let y = area.y + (area.height - height) / 2;
    let margin = if area.width > 90 { 4 } else { 0 };
    let place = Rect { x: area.x + margin, y, width: area.width.saturating_sub(2 * margin), height };
    Clear.render(place, buf);
    let block = Block::bordered()
        .border_set(theme.border_set())
        .border_style(theme.role_style(TextRole::BorderActive))
        .title(Span::styled(title, theme.role_style(TextRole::Title)))
        .title_bottom(Text::styled(" esc closes ", theme.role_style(TextRole::Key)).right_aligned());
    let inside = block.inner(place);
    block.render(place, buf);
    let text = TextLines::new(theme, &lines);
    let scroll = scroll.min(text.last_scroll(inside));
    text.with_scroll(scroll).render(inside, buf);
}

/// A heading per set point with its gates: closed, then unknown, then open.
fn set_point_lines(core: &UiState, subject: &ShownNode<'_>, channel: Option<u8>) -> Vec<Text<'static>> {
    let theme = &core.theme;
    let mut lines = Vec::new();
    for (names, gates) in equal_gates(subject, channel) {
        lines.push(Text::styled(escape(&names.join(", ")).into_owned(), theme.role_style(TextRole::Title)));
        for gate in gates {
            lines.extend(gate_lines(core, gate));
        }
    }
    if lines.is_empty() {
        lines.push(Text::styled(no_gates_text(subject), theme.role_style(TextRole::Quiet)));
    }
    lines
}

/// Set points that have the same gates in the same state form one group.
fn equal_gates<'a>(
    subject: &'a ShownNode<'_>,
    channel: Option<u8>,
) -> Vec<(Vec<&'a str>, Vec<&'a GateState>)> {
    let mut groups: Vec<(Vec<&str>, Vec<&GateState>)> = Vec::new();
    let all: Vec<&GateState> = subject.gates_of(channel).collect();
    let mut points: Vec<_> = all.iter().map(|gate| (gate.set_point, gate.name.as_str())).collect();
    points.dedup();
    for (object, name) in points {
        let mut own: Vec<_> = all.iter().copied().filter(|gate| gate.set_point == object).collect();
        own.sort_by_key(|gate| gate_rank(gate.status));
        let alike = groups.iter_mut().find(|(_, gates)| {
            gates.len() == own.len()
                && gates.iter().zip(&own).all(|(a, b)| {
                    (a.status, &a.gate, &a.detail, &a.text) == (b.status, &b.gate, &b.detail, &b.text)
                })
        });
        match alike {
            Some((names, _)) => names.push(name),
            None => groups.push((vec![name], own)),
        }
    }
    groups
}

fn gate_rank(status: GateStatus) -> u8 {
    match status {
        GateStatus::Closed => 0,
        GateStatus::Unknown => 1,
        GateStatus::Open => 2,
        GateStatus::Invisible => 3,
    }
}

/// State and detail of a gate; if it is not open, also its meaning and what to check.
fn gate_lines(core: &UiState, gate: &GateState) -> Vec<Text<'static>> {
    let theme = &core.theme;
    let (word, role) = match gate.status {
        GateStatus::Closed => ("closed", TextRole::Bad),
        GateStatus::Unknown => ("unknown", TextRole::Caution),
        GateStatus::Open => ("open", TextRole::Good),
        GateStatus::Invisible => ("unseen", TextRole::Quiet),
    };
    let text = |text: &str| escape(text).into_owned();
    let found = if gate.detail.is_empty() { String::new() } else { format!(": {}", text(&gate.detail)) };
    let mut first = vec![
        Span::styled(format!("  {word:<8}"), theme.role_style(role)),
        Span::styled(format!("{}{found}", text(&gate.gate)), theme.role_style(TextRole::Text)),
    ];
    if !gate.source.is_empty() {
        first.push(Span::styled(
            format!("  (manual: {})", text(&gate.source)),
            theme.role_style(TextRole::Quiet),
        ));
    }
    let mut lines = vec![Text::from(first)];
    if gate.status == GateStatus::Open {
        return lines;
    }
    for remark in [&gate.text, &gate.check].into_iter().filter(|remark| !remark.is_empty()) {
        lines.push(Text::styled(format!("          {}", text(remark)), theme.role_style(TextRole::Text)));
    }
    if gate.status == GateStatus::Invisible && gate.text.is_empty() {
        lines.push(Text::styled("          never on the bus", theme.role_style(TextRole::Quiet)));
    }
    lines
}

/// Reason for an empty gate list.
fn no_gates_text(subject: &ShownNode<'_>) -> String {
    if subject.node.assigned_by().is_none() {
        return format!("set points unknown: no profile assigned (--node {}=PROFILE)", subject.node.id());
    }
    match (subject.lost_settings(), subject.node.set_points().next()) {
        (Some((lost, again)), _) => format!(
            "no set point since the last boot; {lost} settings written by SDO lost, {again} written again"
        ),
        (None, None) => "no set point yet".to_owned(),
        (None, Some(_)) => "its profile has no gates".to_owned(),
    }
}
