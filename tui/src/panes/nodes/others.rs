//! Rows of what is no node: the NMT master, and identifiers nobody owns.

use cobscope_decoder::frame::{CanId, Timestamp};
use cobscope_decoder::profile::PdoDirection;
use cobscope_decoder::replay::World;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;

use super::line::{Key, Line, Shown, period, seconds};
use super::values::Values;
use crate::theme::Role;

/// Intervals from which on one may speak of a period.
const ENOUGH: u64 = 3;

/// Identifier of NMT commands.
const NMT: CanId = CanId::Standard(0);

/// The one who sends NMT commands, SYNC and guarding requests: CAN does not tell whether it is one.
pub fn master(world: &World, bus: &Bus) -> Option<Line> {
    let rows = world.identifiers().rows();
    let of = |id: CanId| rows.iter().find(|row| row.bus == bus.index() && row.id == id && !row.is_remote);
    let guarded: Vec<_> =
        bus.nodes().filter(|node| node.is_guarded()).map(|node| node.id().number().to_string()).collect();
    let sync = bus.last_sync().and_then(of);
    let has_commands = bus.is_canopen() && of(NMT).is_some();
    if sync.is_none() && !has_commands && guarded.is_empty() {
        return None;
    }
    let mut line = Line::new(Key::Master(bus.index()));
    line.id = "– –".into();
    line.name = bus.master_name().map_or_else(String::new, |name| escape(name).into_owned());
    line.device = "master".into();
    line.values = match sync {
        Some(row) => rhythm(row),
        None if has_commands => Values::remark("NMT commands", ""),
        None => Values::default(),
    };
    if !guarded.is_empty() {
        line.alive = Shown::new(format!("guards {}", guarded.join(",")), Role::Text);
    }
    Some(line)
}

/// `SYNC 10.0 ms, jitter 4.2 ms`, the largest deviation so far.
fn rhythm(row: &IdentifierRow) -> Values {
    let intervals = &row.intervals;
    match (intervals.mean(), intervals.jitter()) {
        (Some(mean), Some(jitter)) if intervals.count() >= ENOUGH => {
            let (mean, jitter) = (period(mean), period(jitter));
            Values::remark(format!("SYNC {mean}, jitter {jitter}"), format!("SYNC {mean} ±{jitter}"))
        }
        _ => Values::remark(format!("SYNC × {}", row.count), ""),
    }
}

/// Periodic identifiers for which there is neither a sender nor a reader.
pub fn orphans(world: &World, bus: &Bus, now: Option<Timestamp>) -> Vec<Line> {
    if !bus.is_canopen() && !bus.is_j1939() {
        return Vec::new();
    }
    let rows = world.identifiers().rows().iter();
    let rows = rows.filter(|row| row.bus == bus.index() && !row.is_remote && is_orphan(bus, row));
    rows.filter_map(|row| orphan(row, world.zero(), now)).collect()
}

/// Nobody owns it, and it comes with a beat.
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
        // The predefined connection set gives every identifier a node, there or not.
        (Some(node), Some(pdo)) if pdo.direction == PdoDirection::Receive => {
            bus.node(node).is_some_and(|node| {
                node.last_seen().0 != 0 || node.assigned().is_some() || node.name().is_some()
            })
        }
        (Some(_), _) => true,
        (None, _) => !bus.describe_id(row.id).is_empty(),
    }
}

fn orphan(row: &IdentifierRow, zero: Option<Timestamp>, now: Option<Timestamp>) -> Option<Line> {
    let mean = row.intervals.mean()?;
    let mut line = Line::new(Key::Orphan(row.bus, row.id));
    line.id = "? –".into();
    line.name = row.id.to_string();
    line.device = "orphan".into();
    line.state = Shown::new(period(mean), Role::Text);
    let since = row.intervals.began().zip(zero);
    let since = since.map_or(0, |(began, zero)| Timestamp(began).since(zero)).max(0) / 1_000_000;
    let since = format!("since {}.{:03} s", since / 1_000, since % 1_000);
    line.values = Values::remark(format!("{since}, no known reader"), format!("{since}, no reader"));
    let past = now?.since(row.last_time?);
    let role = if past > mean.saturating_mul(2) { Role::Bad } else { Role::Text };
    line.alive = Shown::new(format!("rx {}", seconds(past)), role);
    Some(line)
}
