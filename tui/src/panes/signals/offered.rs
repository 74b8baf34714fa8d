//! Signals of an event.
//!
//! ```text
//! PDO, J1939 message, DBC message   ▸ all its signals
//! set point, bits, object           ▸ the signal that carries the object
//! any other event of a node         ▸ its set points and actual values
//! ```

use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::profile::{ObjectRole, SignalField, ValueCarrier};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::canopen::ObjectAddress;

use crate::panes::PaneRequest;
use crate::state::UiState;
use crate::timeline::SignalKey;
use crate::timeline::signal::carried_layout;

/// Requests that plot the signals of the selected event.
pub fn plot_requests(core: &UiState) -> Vec<PaneRequest> {
    let Some(row) = core.cursor_row() else { return vec![PaneRequest::Refuse("no event selected".into())] };
    let end = core.timeline.end_state();
    // The state at the end of the capture knows more layouts than an early one.
    let mut found =
        core.bus_state().into_iter().chain(end.as_deref()).map(|world| event_signals(&row.event, world));
    match found.find(|signals| !signals.is_empty()) {
        Some(signals) => signals.into_iter().map(PaneRequest::Plot).collect(),
        None => vec![PaneRequest::Refuse("this event has no signals to plot".into())],
    }
}

/// The signals of an event in the layouts known to `world`.
fn event_signals(event: &Event, world: &ReplayState) -> Vec<SignalKey> {
    if let Some((id, layout, _)) = carried_layout(event) {
        // Bit fields and states are plotted only if there are no values.
        let is_value = |key: &SignalKey| layout.fields.get(key.field).is_some_and(|field| !is_word(field));
        let (values, words): (Vec<_>, Vec<_>) =
            SignalKey::signals_of(event.bus, id, layout).partition(is_value);
        return if values.is_empty() { words } else { values };
    }
    let mut rows =
        world.identifiers().rows().iter().filter(|row| {
            !row.is_remote && row.bus == event.bus && row.node.is_some() && row.node == event.node
        });
    let Some((object, carrier)) = event_object(event) else {
        return rows.flat_map(|row| of_row(row, is_commanded_or_measured)).collect();
    };
    let is_wanted = |field: &SignalField| field.object() == Some(object);
    let is_carrier = |row: &&IdentifierRow| match carrier {
        Some(ValueCarrier::Pdo(name)) => row.pdo == Some(*name),
        Some(ValueCarrier::Message(_)) | None => true,
    };
    let found = rows.clone().filter(is_carrier).find_map(|row| of_row(row, is_wanted).next());
    let others = || rows.find_map(|row| of_row(row, is_wanted).next());
    found.or_else(others).into_iter().collect()
}

/// Signals of an identifier whose fields are wanted.
fn of_row(row: &IdentifierRow, is_wanted: impl Fn(&SignalField) -> bool) -> impl Iterator<Item = SignalKey> {
    let fields = row.layout.iter().flat_map(|layout| {
        layout.fields.iter().enumerate().map(move |(place, field)| (layout, place, field))
    });
    fields
        .filter(move |(_, _, field)| is_wanted(field))
        .filter_map(|(layout, place, _)| SignalKey::new(row.bus, row.id, layout, place))
}

/// Whether a field is a bit field or an enumeration.
fn is_word(field: &SignalField) -> bool {
    field.meaning.as_deref().is_some_and(|meaning| meaning.bits.is_some() || meaning.values.is_some())
}

fn is_commanded_or_measured(field: &SignalField) -> bool {
    let role = field.meaning.as_deref().and_then(|meaning| meaning.role);
    matches!(role, Some(ObjectRole::SetPoint | ObjectRole::Actual))
}

/// The object of an event, and the PDO or message that carries it.
fn event_object(event: &Event) -> Option<(ObjectAddress, Option<&ValueCarrier>)> {
    match &event.kind {
        EventKind::SetPoint(set_point) => Some((set_point.object, Some(&set_point.carrier))),
        EventKind::BitsChanged(bits) => Some((bits.object, None)),
        EventKind::Mode(mode) => Some((mode.object, None)),
        _ => None,
    }
}
