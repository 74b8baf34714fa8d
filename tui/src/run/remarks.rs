//! Notes on a decoded capture for stderr: limits of decoding, possible profiles.

use cobscope_decoder::session::{Bus, Buses};
use cobscope_decoder::sink::escape;
use cobscope_decoder::suggestion::firm_suggestions;
use cobscope_decoder::words::count_noun;

/// Limits of decoding per bus, each with the number of frames and the option that changes it.
pub fn decoding_limits(capture: &str, buses: Buses<'_>) -> Vec<String> {
    let of_bus = |bus: &Bus| {
        let place = format!("{capture}: {}", escape(bus.name()));
        bus.protocols()
            .limit_texts()
            .into_iter()
            .map(move |text| format!("{place}: {text}"))
            .collect::<Vec<_>>()
    };
    buses.iter().flat_map(of_bus).collect()
}

/// Frames without values in an output that contains only values, with the options that decode them.
pub fn without_values(capture: &str, buses: Buses<'_>) -> Vec<String> {
    let of_bus = |bus: &Bus| {
        let count = bus.protocols().unknown_frames();
        (count > 0).then(|| {
            format!(
                "{capture}: {}: {} of unknown service without values; --dbc or [[id]] in a bus file (--bus) decodes them",
                escape(bus.name()),
                count_noun(count, "frame")
            )
        })
    };
    buses.iter().filter_map(of_bus).collect()
}

/// Possible profiles of nodes without one, based on their behaviour.
pub fn possible_profiles(capture: &str, buses: Buses<'_>) -> Vec<String> {
    let is_only = buses.len() == 1;
    let of_bus = |bus: &Bus| {
        let found = firm_suggestions(bus);
        found.iter().map(|one| format!("{capture}: {}", one.text(bus, is_only))).collect::<Vec<_>>()
    };
    buses.iter().flat_map(of_bus).collect()
}
