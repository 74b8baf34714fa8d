//! Periodic TPDOs that end.

use super::pdo_period::{MISSING, PeriodSource, is_operational, tpdo_silence};
use crate::event::{Event, EventKind, FrameRange, Kind, SdoOutcome};
use crate::finding::{FindingSubject, Severity};
use crate::profile::PdoName;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{PdoSlot, PdoSubset, PdoTraffic, Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A periodic TPDO is missing for `periods` periods and `least-ms`, while its node is operational. The
    /// period is the event timer (18xx:05), n SYNCs for transmission types 1 to 240, or the usual interval of
    /// PDOs with unchanged content. A synchronous TPDO is lost at the third missing PDO. TPDOs sent on change,
    /// on request or with type 0 are exempt. A usual interval does not apply if SYNC or the RPDOs of the node
    /// end too.
    ///
    /// # Why it matters
    /// Consumers continue with the last value, or enter their safe state.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (transmission type, event timer)
    ///
    /// # What to look at first
    /// Read 18xx:01, 18xx:02 and 18xx:05 of the node. Check its last EMCY and its load.
    ///
    /// # Mutation
    /// drop all PDOs of a periodic TPDO in the second half
    "pdo-lost", Error, "periodic TPDO missing",
    kinds: [
        Kind::Pdo, Kind::Sync, Kind::Heartbeat, Kind::GuardReply, Kind::BootUp, Kind::SdoTransfer,
        Kind::NmtCommand,
    ],
    pdos: PdoSubset::Transmitted,
    transfers: TransferSubset::Communication,
    needs: "a periodic TPDO of an operational node",
    is_timing: true,
    word: "LOST",
    tolerances: &[
        define_tolerance("periods", 3.0, "", "missing periods of a TPDO with an event timer or a usual interval"),
        define_tolerance("least-ms", 500.0, "ms", "minimum silence of such a TPDO"),
    ],
}

/// Time in ns in which a report of the NMT state counts as monitoring of the node.
const MONITORED: i64 = 10_000_000_000;

/// Minimum silence of a node that nothing monitors, in ns. A restart of most devices is shorter.
const SILENT: i64 = 2_000_000_000;

/// A TPDO, by the index of its identifier.
#[derive(Debug, Default)]
struct TpdoStream {
    of: Option<(PdoName, NodeId, PeriodSource)>,
    /// Time and frame of the SYNC of the first missing PDO.
    expected: Option<(i64, u64)>,
    /// The finding is open, about this subject.
    reported: Option<FindingSubject>,
    /// The TPDO is overdue, and the state of its node is not reported yet.
    is_overdue: bool,
    /// A wake-up is scheduled.
    is_queued: bool,
}

struct PdoLost {
    times: f64,
    least: i64,
    streams: Vec<TpdoStream>,
    /// Indices of the streams with a number of SYNCs.
    synced: Vec<usize>,
    /// Time of the last report of operational.
    operational: NodeMap<i64>,
    /// Time of the last start or configuration.
    changed: NodeMap<i64>,
    /// Number of open findings.
    open: usize,
    /// A TPDO may be overdue.
    may_be_overdue: bool,
}

fn new(policy: &RulePolicy) -> PdoLost {
    PdoLost {
        times: policy.tolerance_value(&DECLARATION, "periods"),
        least: policy.tolerance_ns(&DECLARATION, "least-ms"),
        streams: Vec::new(),
        synced: Vec::new(),
        operational: NodeMap::default(),
        changed: NodeMap::default(),
        open: 0,
        may_be_overdue: false,
    }
}

impl PdoLost {
    /// Starts to watch a TPDO once its period is known.
    fn watch_tpdo(&mut self, slot: &PdoSlot, context: &mut RuleContext<'_>) {
        let Some((name, node)) = context.bus.identifiers().pdo_on(slot.id).filter(|(name, _)| name.is_sent())
        else {
            return;
        };
        let changed = self.changed.get(node).copied().unwrap_or(i64::MIN);
        if slot.last < changed {
            return;
        }
        let Some(period) = PeriodSource::period_of((name, node), slot, changed, context) else { return };
        let Some(stream) = self.streams.get_mut(slot.place) else { return };
        stream.of = Some((name, node, period));
        if matches!(period, PeriodSource::Syncs(_)) {
            self.synced.push(slot.place);
        } else if !std::mem::replace(&mut stream.is_queued, true) {
            let limit = period.loss_limit(self.times, self.least);
            context.wake_at(slot.last.saturating_add(limit), slot.place as u64);
        }
        context.count_pass();
    }

    /// Ends the observation of a node's TPDOs: their periods may have changed.
    #[cold]
    fn forget_node(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        self.changed.insert(node, context.now);
        for place in 0..self.streams.len() {
            let of = self.streams.get(place).and_then(|stream| stream.of);
            if of.is_some_and(|(_, of, _)| of == node) {
                self.close_finding(place, context);
                if let Some(stream) = self.streams.get_mut(place) {
                    (stream.of, stream.is_overdue, stream.expected) = (None, false, None);
                }
                self.synced.retain(|synced| *synced != place);
            }
        }
    }

    /// Ends a finding.
    fn close_finding(&mut self, place: usize, context: &mut RuleContext<'_>) {
        let Some(stream) = self.streams.get_mut(place) else { return };
        if let (Some(about), Some((_, node, _))) = (stream.reported.take(), stream.of) {
            self.open -= 1;
            context.close_condition(Some(node), about);
        }
    }

    /// Checks the TPDOs with a number of SYNCs.
    fn on_sync(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let mut due = 0;
        for place in &self.synced {
            let (Some(stream), Some(slot)) =
                (self.streams.get_mut(*place), context.traffic.slots().get(*place))
            else {
                continue;
            };
            let Some((_, _, PeriodSource::Syncs(syncs))) = stream.of else { continue };
            let since = context.traffic.syncs_since(slot);
            if since == syncs {
                stream.expected = Some((context.now, event.frames.last));
            } else if since > MISSING * syncs {
                stream.is_overdue = stream.reported.is_none();
                due += usize::from(stream.is_overdue);
            }
        }
        if due > 0 {
            self.may_be_overdue = true;
            self.judge_overdue(context);
        }
    }

    #[cold]
    fn judge_overdue(&mut self, context: &mut RuleContext<'_>) {
        for place in 0..self.streams.len() {
            if self.streams.get(place).is_some_and(|stream| stream.is_overdue) {
                self.judge_tpdo(place, context);
            }
        }
        self.may_be_overdue = self.streams.iter().any(|stream| stream.is_overdue);
    }

    /// Reports an overdue TPDO if a sign after its silence shows that the node is operational, or if nothing
    /// monitors the node.
    fn judge_tpdo(&mut self, place: usize, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.slots().get(place) else { return };
        let Some(stream) = self.streams.get(place).filter(|stream| stream.reported.is_none()) else { return };
        let Some((_, node, period)) = stream.of else { return };
        let limit = period.loss_limit(self.times, self.least);
        let Some(silence) = tpdo_silence(period, node, slot, limit, context) else { return };
        if !is_operational(node, context) || !context.bus.protocols().is_settled(Some(node)) {
            return;
        }
        let first_missing = match (period, stream.expected) {
            (PeriodSource::Timer(time) | PeriodSource::Usual(time), _) => slot.last.saturating_add(time),
            (PeriodSource::Syncs(_), expected) => expected.map_or(slot.last, |(time, _)| time),
        };
        if self.is_alive(node, first_missing, context) {
            let is_configured = !matches!(period, PeriodSource::Usual(_));
            return self.report_lost(
                place,
                if is_configured { Severity::Error } else { Severity::Warning },
                context,
            );
        }
        let last_report = self.operational.get(node).copied();
        let is_monitored = last_report.is_some_and(|time| slot.last.saturating_sub(time) < MONITORED);
        if is_monitored || silence < self.least {
            return;
        }
        if !is_silent(node, context) {
            self.report_lost(place, Severity::Warning, context);
        } else if silence >= SILENT {
            self.report_silent(node, context);
        }
    }

    /// Whether the node reported operational or sent another TPDO after a time.
    fn is_alive(&self, node: NodeId, time: i64, context: &RuleContext<'_>) -> bool {
        self.operational.get(node).is_some_and(|reported| *reported > time)
            || sent_tpdos(node, context).any(|(_, slot)| slot.last > time)
    }

    fn report_lost(&mut self, place: usize, severity: Severity, context: &mut RuleContext<'_>) {
        let limits = (self.times, self.least);
        let Some(stream) = self.streams.get_mut(place) else { return };
        let (Some((name, node, period)), Some(slot)) = (stream.of, context.traffic.slots().get(place)) else {
            return;
        };
        stream.is_overdue = false;
        stream.reported = Some(FindingSubject::Id(slot.id));
        self.open += 1;
        let (first, last) = (stream.expected.map_or(slot.frames.0, |(_, frame)| frame), slot.frames.0);
        let since = context.timestamp_of(stream.expected.map_or(slot.last, |(time, _)| time));
        let values = actual_values(slot, context);
        let about = FindingSubject::Id(slot.id);
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(first));
        alarm.with_subject(about).with_severity(severity).started_at(since).report_finding(|| {
            let limit = milliseconds_text(period.loss_limit(limits.0, limits.1));
            let reason = match period {
                PeriodSource::Timer(time) => {
                    format!("limit {limit}; event timer {}", milliseconds_text(time))
                }
                PeriodSource::Usual(time) => {
                    format!("limit {limit}; usual period {}", milliseconds_text(time))
                }
                PeriodSource::Syncs(syncs) => {
                    format!("{MISSING} missing, transmission type {syncs}; first missing at SYNC {{{first}}}")
                }
            };
            match values {
                Some(values) => {
                    format!("{name} missing: no actual value of {values} since {{{last}}} ({reason})")
                }
                None => format!("{name} missing after {{{last}}} ({reason})"),
            }
        });
    }

    /// Reports one finding for all TPDOs of a node that sends nothing, once all of them are overdue.
    fn report_silent(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        let (times, least) = (self.times, self.least);
        let of_node =
            |stream: &TpdoStream| stream.reported.is_none() && stream.of.is_some_and(|(_, of, _)| of == node);
        let is_due = |(place, stream): (usize, &TpdoStream)| {
            let (Some((.., period)), Some(slot)) = (stream.of, context.traffic.slots().get(place)) else {
                return true;
            };
            tpdo_silence(period, node, slot, period.loss_limit(times, least), context).is_some()
        };
        if !self.streams.iter().enumerate().filter(|(_, stream)| of_node(stream)).all(is_due) {
            return;
        }
        let mut names = Vec::new();
        let mut newest = (i64::MIN, 0);
        for (place, stream) in self.streams.iter_mut().enumerate().filter(|(_, stream)| of_node(stream)) {
            let (Some((name, ..)), Some(slot)) = (stream.of, context.traffic.slots().get(place)) else {
                continue;
            };
            names.push(name.to_string());
            newest = newest.max((slot.last, slot.frames.0));
            stream.is_overdue = false;
            stream.reported = Some(FindingSubject::Whole);
            self.open += 1;
        }
        let since = context.timestamp_of(newest.0);
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(newest.1));
        alarm.with_severity(Severity::Warning).started_at(since).report_finding(|| {
            let names = names.join(", ");
            format!("node silent after {{{}}}: {names} missing; not monitored, NMT state unknown", newest.1)
        });
    }
}

/// TPDOs of a node on the bus.
fn sent_tpdos<'a>(node: NodeId, context: &RuleContext<'a>) -> impl Iterator<Item = (PdoName, &'a PdoSlot)> {
    let bus = context.bus;
    context.traffic.slots().iter().filter_map(move |slot| {
        let (name, _) =
            bus.identifiers().pdo_on(slot.id).filter(|(name, of)| *of == node && name.is_sent())?;
        Some((name, slot))
    })
}

/// Whether the last frame of a node is one of its TPDOs, apart from the present frame: a deadline precedes it.
fn is_silent(node: NodeId, context: &RuleContext<'_>) -> bool {
    let last = context.bus.node(node).map_or(0, |node| node.last_seen().0);
    last == context.bus.last_frame() || sent_tpdos(node, context).any(|(_, slot)| slot.frames.0 == last)
}

/// Names of the actual values in a PDO that a set point is paired with; `None` without any.
fn actual_values(slot: &PdoSlot, context: &RuleContext<'_>) -> Option<String> {
    let fields = context.bus.identifiers().pdo_layout(slot.id)?.fields.iter();
    let names = fields.filter_map(|field| field.meaning.as_deref().filter(|meaning| meaning.of.is_some()));
    let names: Vec<_> = names.map(|meaning| meaning.name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

fn milliseconds_text(time: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time to read")]
    let milliseconds = time as f64 / 1e6;
    if milliseconds < 10.0 { format!("{milliseconds:.1} ms") } else { format!("{milliseconds:.0} ms") }
}

/// Whether a transfer concerns SYNC or a TPDO.
fn concerns_period(object: ObjectAddress) -> bool {
    matches!(object.index, 0x1005..=0x1007 | 0x1800..=0x1BFF)
}

impl Rule for PdoLost {
    /// Only a missing TPDO is awaited; [`RuleContext::traffic`] has the times of all others.
    fn wants_pdos(&self) -> bool {
        self.open > 0
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Pdo(pdo), _) if !pdo.is_request => self.on_pdo(context),
            (EventKind::Sync { .. }, _) if !self.synced.is_empty() => self.on_sync(event, context),
            (
                EventKind::Heartbeat { state: Some(NmtState::Operational), .. }
                | EventKind::GuardReply { state: Some(NmtState::Operational), .. },
                Some(node),
            ) => {
                self.operational.insert(node, context.now);
                if self.may_be_overdue {
                    self.judge_overdue(context);
                }
            }
            (EventKind::BootUp { .. }, Some(node)) => self.forget_node(node, context),
            (EventKind::NmtCommand { service, target, .. }, _) if *service != NmtService::Start => {
                for node in (1..=127).filter(|node| [0, *node].contains(target)) {
                    self.forget_node(NodeId::Canopen(node), context);
                }
            }
            (EventKind::SdoTransfer(transfer), Some(node))
                if transfer.object.is_some_and(concerns_period)
                    && transfer.outcome == SdoOutcome::Complete =>
            {
                self.forget_node(node, context);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(place) = usize::try_from(token).ok() else { return };
        let (Some(stream), Some(slot)) = (self.streams.get_mut(place), context.traffic.slots().get(place))
        else {
            return;
        };
        stream.is_queued = false;
        let Some((.., period)) = stream.of.filter(|_| stream.reported.is_none()) else { return };
        let limit = period.loss_limit(self.times, self.least);
        let due = slot.last.saturating_add(limit);
        stream.is_overdue = due <= context.now;
        if stream.is_overdue {
            self.may_be_overdue = true;
            self.judge_tpdo(place, context);
        }
        let Some(stream) = self.streams.get_mut(place).filter(|stream| stream.reported.is_none()) else {
            return;
        };
        stream.is_queued = true;
        context.wake_at(if due > context.now { due } else { context.now.saturating_add(limit) }, token);
    }

    /// The TPDO arrived in time.
    fn postponed_wake(&self, token: u64, now: i64, traffic: &PdoTraffic) -> Option<i64> {
        let place = usize::try_from(token).ok()?;
        let stream =
            self.streams.get(place).filter(|stream| stream.reported.is_none() && !stream.is_overdue)?;
        let (.., period) = stream.of?;
        let due = traffic.slots().get(place)?.last.saturating_add(period.loss_limit(self.times, self.least));
        (due > now).then_some(due)
    }

    fn on_second(&mut self, context: &mut RuleContext<'_>) {
        let slots = context.traffic.slots();
        self.streams.resize_with(slots.len(), TpdoStream::default);
        for slot in slots {
            if self.streams.get(slot.place).is_some_and(|stream| stream.of.is_none()) {
                self.watch_tpdo(slot, context);
            }
        }
    }
}

impl PdoLost {
    /// Closes the finding about a TPDO that returned.
    fn on_pdo(&mut self, context: &mut RuleContext<'_>) {
        let Some(place) = context.traffic.current_slot().map(|slot| slot.place) else { return };
        if let Some(stream) = self.streams.get_mut(place) {
            (stream.is_overdue, stream.expected) = (false, None);
            if stream.reported.is_some() {
                self.close_finding(place, context);
                self.restart_watch(place, context);
            }
        }
    }

    fn restart_watch(&mut self, place: usize, context: &mut RuleContext<'_>) {
        let Some(stream) = self.streams.get_mut(place) else { return };
        let Some((.., period)) = stream.of else { return };
        if !matches!(period, PeriodSource::Syncs(_)) && !std::mem::replace(&mut stream.is_queued, true) {
            let limit = period.loss_limit(self.times, self.least);
            context.wake_at(context.now.saturating_add(limit), place as u64);
        }
    }
}
