//! Rows of the NMT master and of periodic identifiers without a known node.

use cobscope_decoder::frame::{CanId, Timestamp};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;

use super::line::{NodeRow, NodeRowKey, StyledCell, format_period, format_seconds};
use super::values::SetActualValues;
use crate::theme::TextRole;

/// Number of intervals from which a period is shown.
const ENOUGH: u64 = 3;

/// Identifier of NMT commands.
const NMT: CanId = CanId::Standard(0);

/// The sender of NMT commands, SYNC and guarding requests. CAN frames do not show whether it is one device.
pub fn master_row(world: &ReplayState, bus: &Bus) -> Option<NodeRow> {
    let rows = world.identifiers().rows();
    let of = |id: CanId| rows.iter().find(|row| row.bus == bus.index() && row.id == id && !row.is_remote);
    let guarded: Vec<_> =
        bus.nodes().filter(|node| node.is_guarded()).map(|node| node.id().number().to_string()).collect();
    let sync = bus.last_sync().and_then(of);
    let has_commands = bus.protocols().is_canopen() && of(NMT).is_some();
    if sync.is_none() && !has_commands && guarded.is_empty() {
        return None;
    }
    let mut line = NodeRow::new(NodeRowKey::Master(bus.index()));
    line.id = "– –".into();
    line.name = bus.master_name().map_or_else(String::new, |name| escape(name).into_owned());
    line.device = "master".into();
    line.values = match sync {
        Some(row) => rhythm_values(row),
        None if has_commands => SetActualValues::remark_only("NMT commands", ""),
        None => SetActualValues::default(),
    };
    if !guarded.is_empty() {
        line.alive = StyledCell::new(format!("guards {}", guarded.join(",")), TextRole::Text);
    }
    Some(line)
}

/// `SYNC 10.0 ms, jitter 4.2 ms`; the jitter is the largest deviation so far.
fn rhythm_values(row: &IdentifierRow) -> SetActualValues {
    let intervals = &row.intervals;
    match (intervals.mean(), intervals.jitter()) {
        (Some(mean), Some(jitter)) if intervals.count() >= ENOUGH => {
            let (mean, jitter) = (format_period(mean), format_period(jitter));
            SetActualValues::remark_only(
                format!("SYNC {mean}, jitter {jitter}"),
                format!("SYNC {mean} ±{jitter}"),
            )
        }
        _ => SetActualValues::remark_only(format!("SYNC × {}", row.count), ""),
    }
}

/// Periodic identifiers without a known producer or consumer.
pub fn orphan_rows(world: &ReplayState, bus: &Bus, now: Option<Timestamp>) -> Vec<NodeRow> {
    if !bus.protocols().is_canopen() && !bus.protocols().is_j1939() {
        return Vec::new();
    }
    let rows = world.identifiers().rows().iter();
    let rows = rows.filter(|row| row.bus == bus.index() && !row.is_remote && is_orphan(bus, row));
    rows.filter_map(|row| orphan_row(row, world.first_time(), now)).collect()
}

/// Whether the identifier is periodic and has no owner.
fn is_orphan(bus: &Bus, row: &IdentifierRow) -> bool {
    let (Some(mean), Some((longest, _))) = (row.intervals.mean(), row.intervals.longest()) else {
        return false;
    };
    let is_periodic = row.intervals.count() >= ENOUGH && longest <= mean.saturating_mul(3);
    is_periodic && !is_owned(bus, row)
}

fn is_owned(bus: &Bus, row: &IdentifierRow) -> bool {
    if row.layout.is_some() {
        return true;
    }
    match (row.node, row.pdo) {
        // The predefined connection set assigns every identifier to a node, present or not.
        (Some(node), Some(_)) => bus.node(node).is_some_and(|node| {
            node.last_seen().0 != 0 || node.assigned_by().is_some() || node.name().is_some()
        }),
        (Some(_), _) => true,
        (None, _) => !bus.describe_id(row.id).is_empty(),
    }
}

fn orphan_row(row: &IdentifierRow, zero: Option<Timestamp>, now: Option<Timestamp>) -> Option<NodeRow> {
    let mean = row.intervals.mean()?;
    let mut line = NodeRow::new(NodeRowKey::Orphan(row.bus, row.id));
    line.id = "? –".into();
    line.name = row.id.to_string();
    line.device = "orphan".into();
    line.state = StyledCell::new(format_period(mean), TextRole::Text);
    let since = row.intervals.first_time().zip(zero);
    let since = since.map_or(0, |(began, zero)| Timestamp(began).since(zero)).max(0) / 1_000_000;
    let since = format!("since {}.{:03} s", since / 1_000, since % 1_000);
    line.values =
        SetActualValues::remark_only(format!("{since}, no known consumer"), format!("{since}, no consumer"));
    let past = now?.since(row.last_time?);
    let role = if past > mean.saturating_mul(2) { TextRole::Bad } else { TextRole::Text };
    line.alive = StyledCell::new(format!("rx {}", format_seconds(past)), role);
    Some(line)
}
