//! Header line: buses, defects of the capture, findings, time.

use cobscope_decoder::figures::format_load;
use cobscope_decoder::frame::LinkState;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use crate::source::live::LiveBusState;
use crate::state::{DIFFERS, UiState};
use crate::theme::TextRole;
use crate::widgets::draw;

/// Interval of the mean load, in ns.
const SECOND: i64 = 1_000_000_000;

/// Draws the header. Text without room is cut on the right; the time is always shown.
pub(in crate::app) fn draw_header(core: &UiState, area: Rect, buf: &mut Buffer) {
    let base = core.theme.role_style(TextRole::Header);
    buf.set_style(area.intersection(buf.area), base);
    let time = match core.time_words(core.cursor_time(), 3) {
        Some(time) => format!("t {time}"),
        None if core.first_time().is_some() => "t unknown".to_owned(),
        None => "no times".to_owned(),
    };
    let right = Line::styled(time, base);
    let room = area.width.saturating_sub(draw::to_cells(right.width()) + 2);
    let mut spans = Vec::new();
    for (text, role) in header_parts(core) {
        let style = if role == TextRole::Header { base } else { base.patch(foreground_style(core, role)) };
        spans.push(Span::styled(text, style));
        spans.push(Span::styled("  ", base));
    }
    draw::draw_line(
        buf,
        Rect { width: room, ..area },
        &Line::from(spans),
        draw::TextAlignment::Left,
        &core.theme,
    );
    draw::draw_line(buf, area, &right, draw::TextAlignment::Right, &core.theme);
}

/// A style without background: the header has its own.
fn foreground_style(core: &UiState, role: TextRole) -> Style {
    Style { bg: None, ..core.theme.role_style(role) }
}

fn header_parts(core: &UiState) -> Vec<(String, TextRole)> {
    let mut parts = Vec::new();
    if let Some(name) = core.timeline.changed_capture() {
        parts.push((format!("CHANGED {name}"), TextRole::Bad));
    }
    if let Some(failure) = core.timeline.failure() {
        parts.push((format!("INCOMPLETE: {failure}"), TextRole::Bad));
    }
    if let Some(live) = core.timeline.live() {
        push_troubles(core, &live.get(), &mut parts);
    }
    parts.extend(bus_texts(core).into_iter().map(|text| (text, TextRole::Header)));
    let survey = core.timeline.survey();
    let quality = &survey.overview.statistics.quality;
    let counts = core.timeline.end_state().map_or_else(
        || core.bus_state().map(cobscope_decoder::replay::ReplayState::problem_counts).unwrap_or_default(),
        |end| end.problem_counts(),
    );
    let wrong = |count: u64| if count > 0 { TextRole::Bad } else { TextRole::Header };
    if let Some((errors, warnings)) = finding_counts(&survey) {
        let role = match (errors, warnings) {
            (0, 0) => TextRole::Header,
            (0, _) => TextRole::Caution,
            _ => TextRole::Bad,
        };
        let so_far = if survey.is_complete { "" } else { " …" };
        parts.push((format!("FINDINGS {errors} err {warnings} warn{so_far}"), role));
    }
    parts.extend(comparison_part(core));
    parts.push((format!("errframes {}", counts.errors), wrong(counts.errors)));
    parts.push((format!("lost {}", counts.lost), wrong(counts.lost)));
    if counts.unreadable > 0 {
        parts.push((format!("bad lines {}", counts.unreadable), TextRole::Bad));
    }
    if let Some(record) = core.timeline.live().and_then(|live| live.get().record.clone()) {
        let role = if record.missing > 0 { TextRole::Bad } else { TextRole::Header };
        parts.push((format!("REC {record}"), role));
        let remarks = if record.missing > 0 { record.remark_texts() } else { Vec::new() };
        parts.extend(remarks.into_iter().take(1).map(|remark| (remark, TextRole::Bad)));
    }
    if let Some(stamps) = core.timeline.live().and_then(|live| clock_text(&live.get())) {
        parts.push((format!("timestamps of {stamps}"), TextRole::Header));
    } else if let Some(granularity) = quality.granularity() {
        parts.push((format!("timestamps ±{}", format_step(granularity)), TextRole::Header));
    }
    parts
}

/// Number of differences from the other capture.
fn comparison_part(core: &UiState) -> Option<(String, TextRole)> {
    let against = core.against.0.as_ref()?;
    let name = &against.name;
    Some(match &against.result {
        None => (format!("AGAINST {name} …"), TextRole::Header),
        Some(Err(_)) => (format!("AGAINST {name} failed"), TextRole::Bad),
        Some(Ok(marks)) if marks.difference_count() == 0 => {
            (format!("AGAINST {name} equal"), TextRole::Header)
        }
        Some(Ok(marks)) => {
            (format!("AGAINST {name} {DIFFERS}{}", marks.difference_count()), TextRole::Caution)
        }
    })
}

/// Defects of live buses.
fn push_troubles(core: &UiState, live: &LiveBusState, parts: &mut Vec<(String, TextRole)>) {
    if let Some(failure) = &live.failure {
        parts.push((format!("ENDED: {}", escape(failure)), TextRole::Bad));
    }
    for bus in &live.buses {
        let name = escape(&bus.name);
        if bus.state != LinkState::Up {
            parts.push((format!("{name} {}", bus.state.name().to_uppercase()), TextRole::Bad));
        }
        if let Some(controller) = bus.controller.as_ref().filter(|state| !state.starts_with("error active")) {
            parts.push((format!("{name} {}", escape(controller)), TextRole::Bad));
        }
    }
    if let Some((bus, change)) = &core.timeline.survey().overview.bit_rate_change {
        parts.push((format!("{bus}: {change}; change the interface too"), TextRole::Caution));
    }
    let dropped = core.timeline.dropped_frames();
    if dropped > 0 {
        parts.push((format!("first frame kept #{}", dropped + 1), TextRole::Caution));
    }
}

/// `can0 250k load 3.4 % (1 s)`, in the second before the cursor; frames per second if the bit rate is unknown.
fn bus_texts(core: &UiState) -> Vec<String> {
    let Some(world) = core.bus_state() else { return vec!["reading …".into()] };
    if let Some(live) = core.timeline.live()
        && world.buses().is_empty()
    {
        let live = live.get();
        return live.buses.iter().map(|bus| format!("{} listening", escape(&bus.name))).collect();
    }
    let survey = core.timeline.survey();
    let time = core.cursor_time().map(|time| time.0);
    let bus = |bus: &cobscope_decoder::session::Bus| {
        let name = escape(bus.name()).into_owned();
        let load = survey.overview.load.get(usize::from(bus.index().0));
        let step = load.zip(time).map(|(load, time)| load.load_before(time, SECOND));
        match (bus.bit_rate(), step) {
            (Some(rate), Some(step)) => {
                let load = format_load(step.bits.into(), u128::from(SECOND.unsigned_abs()), rate);
                format!("{name} {}k load {load} (1 s)", rate / 1_000)
            }
            (Some(rate), None) => format!("{name} {}k", rate / 1_000),
            (None, Some(step)) => format!("{name} {}/s", step.frames),
            (None, None) => name,
        }
    };
    world.buses().iter().map(bus).collect()
}

/// The clock of the timestamps, if it is the same for all buses.
fn clock_text(live: &LiveBusState) -> Option<&'static str> {
    let first = live.buses.first()?.stamps;
    live.buses.iter().all(|bus| bus.stamps == first).then(|| first.clock_name()).flatten()
}

/// Number of errors and warnings; None before the first frame.
fn finding_counts(survey: &crate::timeline::SurveyResults) -> Option<(usize, usize)> {
    if let Some(findings) = &survey.findings {
        return Some((findings.reported_count(Severity::Error), findings.reported_count(Severity::Warning)));
    }
    let of =
        |severity| survey.overview.opened.iter().filter(|opened| opened.news.severity == severity).count();
    (survey.frames > 0).then(|| (of(Severity::Error), of(Severity::Warning)))
}

/// Resolution of the timestamps with its unit.
fn format_step(nanoseconds: i64) -> String {
    match nanoseconds {
        ..1_000 => format!("{nanoseconds} ns"),
        1_000..1_000_000 => format!("{} µs", nanoseconds / 1_000),
        1_000_000..SECOND => format!("{} ms", nanoseconds / 1_000_000),
        _ => format!("{} s", nanoseconds / SECOND),
    }
}
