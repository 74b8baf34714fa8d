//! Header line: buses, defects of the capture, findings, time.

use cobscope_decoder::frame::LinkState;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use crate::source::live::Live;
use crate::state::{Core, DIFFERS};
use crate::theme::Role;
use crate::widgets::draw;

/// Interval of the mean load, in ns.
const SECOND: i64 = 1_000_000_000;

/// Draws the header. Text without room is cut on the right; the time is always shown.
pub(super) fn draw(core: &Core, area: Rect, buf: &mut Buffer) {
    let base = core.theme.style(Role::Header);
    buf.set_style(area.intersection(buf.area), base);
    let time = match core.time_words(core.time(), 3) {
        Some(time) => format!("t {time}"),
        None if core.zero().is_some() => "t unknown".to_owned(),
        None => "no times".to_owned(),
    };
    let right = Line::styled(time, base);
    let room = area.width.saturating_sub(draw::cells(right.width()) + 2);
    let mut spans = Vec::new();
    for (text, role) in parts(core) {
        let style = if role == Role::Header { base } else { base.patch(front(core, role)) };
        spans.push(Span::styled(text, style));
        spans.push(Span::styled("  ", base));
    }
    draw::line(buf, Rect { width: room, ..area }, &Line::from(spans), draw::Align::Left, &core.theme);
    draw::line(buf, area, &right, draw::Align::Right, &core.theme);
}

/// A style without background: the header has its own.
fn front(core: &Core, role: Role) -> Style {
    Style { bg: None, ..core.theme.style(role) }
}

fn parts(core: &Core) -> Vec<(String, Role)> {
    let mut parts = Vec::new();
    if let Some(name) = core.timeline.changed() {
        parts.push((format!("CHANGED {name}"), Role::Bad));
    }
    if let Some(failure) = core.timeline.failure() {
        parts.push((format!("INCOMPLETE: {failure}"), Role::Bad));
    }
    if let Some(live) = core.timeline.live() {
        troubles(core, &live.get(), &mut parts);
    }
    parts.extend(buses(core).into_iter().map(|text| (text, Role::Header)));
    let survey = core.timeline.survey();
    let quality = &survey.overview.statistics.quality;
    let counts = core.timeline.end().map_or_else(
        || core.world().map(cobscope_decoder::replay::ReplayState::counts).unwrap_or_default(),
        |end| end.counts(),
    );
    let wrong = |count: u64| if count > 0 { Role::Bad } else { Role::Header };
    if let Some((errors, warnings)) = findings(&survey) {
        let role = match (errors, warnings) {
            (0, 0) => Role::Header,
            (0, _) => Role::Caution,
            _ => Role::Bad,
        };
        let so_far = if survey.is_complete { "" } else { " …" };
        parts.push((format!("FINDINGS {errors} err {warnings} warn{so_far}"), role));
    }
    parts.extend(against(core));
    parts.push((format!("errframes {}", counts.errors), wrong(counts.errors)));
    parts.push((format!("lost {}", counts.lost), wrong(counts.lost)));
    if counts.unreadable > 0 {
        parts.push((format!("bad lines {}", counts.unreadable), Role::Bad));
    }
    if let Some(record) = core.timeline.live().and_then(|live| live.get().record.clone()) {
        let role = if record.missing > 0 { Role::Bad } else { Role::Header };
        parts.push((format!("REC {record}"), role));
        let remarks = if record.missing > 0 { record.remarks() } else { Vec::new() };
        parts.extend(remarks.into_iter().take(1).map(|remark| (remark, Role::Bad)));
    }
    if let Some(stamps) = core.timeline.live().and_then(|live| stamps(&live.get())) {
        parts.push((format!("timestamps of {stamps}"), Role::Header));
    } else if let Some(granularity) = quality.granularity() {
        parts.push((format!("timestamps ±{}", step(granularity)), Role::Header));
    }
    parts
}

/// Number of differences from the other capture.
fn against(core: &Core) -> Option<(String, Role)> {
    let against = core.against.as_ref()?;
    let name = &against.name;
    Some(match &against.result {
        None => (format!("AGAINST {name} …"), Role::Header),
        Some(Err(_)) => (format!("AGAINST {name} failed"), Role::Bad),
        Some(Ok(marks)) if marks.count() == 0 => (format!("AGAINST {name} equal"), Role::Header),
        Some(Ok(marks)) => (format!("AGAINST {name} {DIFFERS}{}", marks.count()), Role::Caution),
    })
}

/// Defects of live buses.
fn troubles(core: &Core, live: &Live, parts: &mut Vec<(String, Role)>) {
    if let Some(failure) = &live.failure {
        parts.push((format!("ENDED: {}", escape(failure)), Role::Bad));
    }
    for bus in &live.buses {
        let name = escape(&bus.name);
        if bus.state != LinkState::Up {
            parts.push((format!("{name} {}", bus.state.name().to_uppercase()), Role::Bad));
        }
        if let Some(controller) = bus.controller.as_ref().filter(|state| !state.starts_with("error active")) {
            parts.push((format!("{name} {}", escape(controller)), Role::Bad));
        }
    }
    if let Some((bus, change)) = &core.timeline.survey().overview.bit_rate_change {
        parts.push((format!("{bus}: {change}; change the interface too"), Role::Caution));
    }
    let dropped = core.timeline.dropped();
    if dropped > 0 {
        parts.push((format!("first frame kept #{}", dropped + 1), Role::Caution));
    }
}

/// `can0 250k load 34 %`; frames per second if the bit rate is unknown.
fn buses(core: &Core) -> Vec<String> {
    let Some(world) = core.world() else { return vec!["reading …".into()] };
    if let Some(live) = core.timeline.live()
        && world.buses().is_empty()
    {
        let live = live.get();
        return live.buses.iter().map(|bus| format!("{} listening", escape(&bus.name))).collect();
    }
    let survey = core.timeline.survey();
    let time = core.time().map(|time| time.0);
    let bus = |bus: &cobscope_decoder::session::Bus| {
        let name = escape(bus.name()).into_owned();
        let load = survey.overview.load.get(usize::from(bus.index().0));
        let step = load.zip(time).map(|(load, time)| load.over(time, SECOND));
        match (bus.bit_rate(), step) {
            (Some(rate), Some(step)) => {
                let share = step.bits.saturating_mul(100) / u64::from(rate).max(1);
                format!("{name} {}k load {share} %", rate / 1_000)
            }
            (Some(rate), None) => format!("{name} {}k", rate / 1_000),
            (None, Some(step)) => format!("{name} {}/s", step.frames),
            (None, None) => name,
        }
    };
    world.buses().iter().map(bus).collect()
}

/// The clock of the timestamps, if it is the same for all buses.
fn stamps(live: &Live) -> Option<&'static str> {
    let first = live.buses.first()?.stamps;
    live.buses.iter().all(|bus| bus.stamps == first).then(|| first.whose()).flatten()
}

/// Number of errors and warnings; None before the first frame.
fn findings(survey: &crate::timeline::SurveyResults) -> Option<(usize, usize)> {
    if let Some(findings) = &survey.findings {
        return Some((findings.number(Severity::Error), findings.number(Severity::Warning)));
    }
    let of =
        |severity| survey.overview.opened.iter().filter(|opened| opened.news.severity == severity).count();
    (survey.frames > 0).then(|| (of(Severity::Error), of(Severity::Warning)))
}

/// Resolution of the timestamps with its unit.
fn step(nanoseconds: i64) -> String {
    match nanoseconds {
        ..1_000 => format!("{nanoseconds} ns"),
        1_000..1_000_000 => format!("{} µs", nanoseconds / 1_000),
        1_000_000..SECOND => format!("{} ms", nanoseconds / 1_000_000),
        _ => format!("{} s", nanoseconds / SECOND),
    }
}
