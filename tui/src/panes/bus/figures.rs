//! What stands below the bars: figures of the bus, and how far the capture can be trusted.
//!
//! ```text
//! frames   181 frames, 29.5/s, 1691 bit/s; worst second 47 frames, 2436 bit from 2.849 s
//! master   NMT start 1
//! wiring   cannot be judged: this capture has no error frames
//! stamps   in steps of 0.001 ms
//! capture  a.log: candump text, 12.3 kB
//! ```

use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::BusStatistics;
use cobscope_decoder::words::plural;
use ratatui::text::Line;

use crate::figures::bytes;
use crate::panes::common::Labelled;
use crate::state::Core;
use crate::theme::Role;
use crate::timeline::Survey;
use crate::words::{commands, error_frames, faults, rates, stamps};

/// Columns for labels.
const LABEL: u16 = 9;

/// All of it; what is wrong stands out.
pub(super) fn lines(
    core: &Core,
    survey: &Survey,
    bus: Option<(&Bus, &BusStatistics)>,
    buses: usize,
) -> Labelled {
    let mut told = Vec::new();
    if !survey.is_complete {
        told.push(("so far", Role::Note, format!("looked at {}", plural(survey.frames, "frame"))));
    }
    if let Some((bus, statistics)) = bus {
        told.extend(rates_of(survey, bus, statistics).into_iter().map(|text| ("frames", Role::Text, text)));
        let start = survey.statistics.quality.first.unwrap_or(0);
        told.extend(commands(statistics, start).into_iter().map(|text| ("master", Role::Text, text)));
        if statistics.undecoded + statistics.malformed > 0 {
            let role = if statistics.malformed > 0 { Role::Caution } else { Role::Text };
            let (undecoded, malformed) = (statistics.undecoded, statistics.malformed);
            told.push((
                "unknown",
                role,
                format!("{} of no known service, {malformed} malformed", plural(undecoded, "frame")),
            ));
        }
    }
    told.extend(quality(core, survey, buses));
    told.extend(core.unknown_buses(survey).into_iter().map(|text| ("names", Role::Caution, text)));
    told.extend(files(core).into_iter().map(|text| ("capture", Role::Text, text)));
    let line = |(label, role, text): (&'static str, Role, String)| {
        (label, Line::styled(escape(&text).into_owned(), core.theme.style(role)))
    };
    Labelled { room: LABEL, lines: told.into_iter().map(line).collect() }
}

/// Frames and load of a bus.
pub(super) fn rates_of(survey: &Survey, bus: &Bus, statistics: &BusStatistics) -> Vec<String> {
    let quality = &survey.statistics.quality;
    let hint = format!("bitrate = 250000 below [bus.{}] in a bus file (--bus)", bus.name());
    rates(statistics, quality.duration(), quality.first.unwrap_or(0), bus.bit_rate(), &hint)
}

/// How far the capture can be trusted.
fn quality(core: &Core, survey: &Survey, buses: usize) -> Vec<(&'static str, Role, String)> {
    let quality = &survey.statistics.quality;
    let mut told = Vec::new();
    if quality.error_frames == 0 {
        let text = "cannot be judged: this capture has no error frames";
        told.push(("wiring", Role::Note, text.to_owned()));
    } else {
        let of = if buses > 1 { ", of all buses" } else { "" };
        told.push(("wiring", Role::Bad, format!("{}{of}", error_frames(quality))));
    }
    match stamps(quality) {
        Some(text) => {
            let role = if quality.made_up_interval().is_some() { Role::Caution } else { Role::Text };
            told.push(("stamps", role, text.strip_prefix("stamps ").unwrap_or(&text).to_owned()));
        }
        None => told.push(("stamps", Role::Caution, "none: this capture has no times".to_owned())),
    }
    told.extend(faults(quality).into_iter().map(|text| ("quality", Role::Bad, text)));
    if let Some(failure) = core.timeline.failure() {
        told.push(("unread", Role::Bad, failure));
    }
    told
}

/// The captures with format and size.
fn files(core: &Core) -> Vec<String> {
    let file = |lane: &crate::timeline::Lane| {
        let (length, is_all) = lane.store.length();
        let so_far = if is_all { "" } else { " so far" };
        format!("{}: {}, {}{so_far}", lane.store.name(), lane.format, bytes(length))
    };
    core.timeline.lanes().iter().map(file).collect()
}
