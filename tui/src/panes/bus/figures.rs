//! Text below the bars: figures of the bus and quality of the capture.
//!
//! ```text
//! frames      181 frames, 29.5/s, 1691 bit/s; worst second 47 frames, 2436 bit from 2.849 s
//! master      NMT start 1
//! controller  acknowledges frames (listen-only off)
//! wiring      cannot be judged: this capture has no error frames
//! timestamps  in steps of 0.001 ms
//! capture     a.log: candump text, 12.3 kB
//! ```

use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::BusStatistics;
use cobscope_decoder::words::count_noun;
use ratatui::text::Line;

use crate::panes::common::LabelledLines;
use crate::state::UiState;
use crate::theme::TextRole;
use crate::timeline::SurveyResults;
use cobscope_decoder::answers::statistics::phrases::{
    capture_defects, command_texts, error_frames, granularity_text, rate_texts,
};
use cobscope_decoder::figures::format_bytes;

/// Width of the labels.
const LABEL: u16 = 12;

/// All lines; defects have the role of an error or warning.
pub(super) fn figure_lines(
    core: &UiState,
    survey: &SurveyResults,
    bus: Option<(&Bus, &BusStatistics)>,
    buses: usize,
) -> LabelledLines {
    let mut reported = Vec::new();
    if !survey.is_complete {
        reported.push((
            "progress",
            TextRole::Note,
            format!("{} analysed", count_noun(survey.frames, "frame")),
        ));
    }
    if let Some((bus, statistics)) = bus {
        reported.extend(
            rates_of(survey, bus, statistics).into_iter().map(|text| ("frames", TextRole::Text, text)),
        );
        let quality = &survey.overview.statistics.quality;
        reported.extend(
            command_texts(statistics, quality).into_iter().map(|text| ("master", TextRole::Text, text)),
        );
        if statistics.undecoded + statistics.malformed > 0 {
            let role = if statistics.malformed > 0 { TextRole::Caution } else { TextRole::Text };
            let (undecoded, malformed) = (statistics.undecoded, statistics.malformed);
            reported.push((
                "unknown",
                role,
                format!("{} of unknown services, {malformed} malformed", count_noun(undecoded, "frame")),
            ));
        }
    }
    reported.extend(bus.and_then(|(bus, _)| controller_figure(core, bus)));
    reported.extend(quality_figures(core, survey, buses));
    reported.extend(core.unknown_buses(survey).into_iter().map(|text| ("names", TextRole::Caution, text)));
    reported.extend(file_texts(core).into_iter().map(|text| ("capture", TextRole::Text, text)));
    let line = |(label, role, text): (&'static str, TextRole, String)| {
        (label, Line::styled(escape(&text).into_owned(), core.theme.role_style(role)))
    };
    LabelledLines { room: LABEL, lines: reported.into_iter().map(line).collect() }
}

/// Frame rate and load of a bus.
pub(super) fn rates_of(survey: &SurveyResults, bus: &Bus, statistics: &BusStatistics) -> Vec<String> {
    let quality = &survey.overview.statistics.quality;
    let hint = format!("set bitrate = 250000 in [bus.{}] of a bus file (--bus)", bus.name());
    rate_texts(statistics, quality.duration(), quality.first.unwrap_or(0), bus.bit_rate(), &hint)
}

/// Mode of the controller of a live bus: one in normal mode takes part in the traffic.
fn controller_figure(core: &UiState, bus: &Bus) -> Option<(&'static str, TextRole, String)> {
    let live = core.timeline.live()?.get();
    let mode = live.buses.iter().find(|status| status.name == bus.name())?.mode?;
    let role = if mode.is_listen_only() { TextRole::Text } else { TextRole::Caution };
    Some(("controller", role, mode.mode_text().to_owned()))
}

/// Quality of the capture.
fn quality_figures(
    core: &UiState,
    survey: &SurveyResults,
    buses: usize,
) -> Vec<(&'static str, TextRole, String)> {
    let quality = &survey.overview.statistics.quality;
    let mut reported = Vec::new();
    if quality.error_frames == 0 {
        let text = "cannot be judged: this capture has no error frames";
        reported.push(("wiring", TextRole::Note, text.to_owned()));
    } else {
        let of = if buses > 1 { ", all buses" } else { "" };
        reported.push(("wiring", TextRole::Bad, format!("{}{of}", error_frames(quality))));
    }
    match granularity_text(quality) {
        Some(text) => {
            let role = if quality.is_timed() { TextRole::Text } else { TextRole::Caution };
            let figure = text.strip_prefix("timestamps ").unwrap_or(&text).to_owned();
            reported.push(("timestamps", role, figure));
        }
        None => reported.push(("timestamps", TextRole::Caution, "none".to_owned())),
    }
    reported.extend(capture_defects(quality).into_iter().map(|text| ("quality", TextRole::Bad, text)));
    if let Some(failure) = core.timeline.failure() {
        reported.push(("failure", TextRole::Bad, failure));
    }
    reported
}

/// The captures with their format and size.
fn file_texts(core: &UiState) -> Vec<String> {
    let file = |lane: &crate::timeline::TimelineCapture| {
        let (length, is_all) = lane.store.length();
        let so_far = if is_all { "" } else { " so far" };
        format!("{}: {}, {}{so_far}", lane.store.name(), lane.format, format_bytes(length))
    };
    core.timeline.open_captures().iter().map(file).collect()
}
