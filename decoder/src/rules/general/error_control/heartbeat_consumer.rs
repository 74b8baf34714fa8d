//! Heartbeat consumer times against the producer times.

use crate::event::{Event, EventKind, Kind, SdoOutcome, SdoTransfer};
use crate::finding::FindingSubject;
use crate::rules::general::facts::confirmed_number;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A consumer time (1016) must be longer than the producer time (1017) of the monitored node. A consumer
    /// must not report 8130 unless a monitored producer is late. Only values that were written or read count.
    /// If a consumer reports a communication error (81xx) while a monitored heartbeat is late, its time must be at
    /// least 1.5 × the usual interval of the heartbeat.
    ///
    /// # Why it matters
    /// A consumer time that is too short stops the machine repeatedly without a reason.
    ///
    /// # Source
    /// CiA 301 §7.5.2.18 (1016), §7.2.8.2.2 (heartbeat consumer)
    ///
    /// # What to look at first
    /// Set the consumer time (1016) to at least 1.5 × 1017.
    ///
    /// # Mutation
    /// change the time written to 1016:01
    "heartbeat-consumer", Warning, "heartbeat consumer and producer time mismatch",
    kinds: [Kind::Heartbeat, Kind::Emcy, Kind::SdoTransfer, Kind::BootUp],
    needs: "1016 of a consumer and 1017:00 of the node that it monitors",
    cases: &["7.104", "7.105", "7.106", "7.107"],
    is_timing: true,
    word: "BEAT",
}

/// Maximum number of entries of 1016.
const ENTRIES: u8 = 127;

/// Maximum number of monitored producers of all consumers.
const CONTRACT_LIMIT: usize = 1024;

/// Heartbeat error (CiA 301 table 26).
const HEARTBEAT_ERROR: u16 = 0x8130;

/// Class of communication errors.
const COMMUNICATION: u16 = 0x8100;

struct ConsumerContract {
    consumer: NodeId,
    sub: u8,
    producer: NodeId,
    time: i64,
}

#[derive(Default)]
struct HeartbeatConsumer {
    contracts: Vec<ConsumerContract>,
    /// Consumers with a changed list.
    changed: Vec<NodeId>,
    beats: NodeMap<ProducerHeartbeats>,
}

/// Heartbeats of a producer, in ns.
#[derive(Debug, Clone, Copy, Default)]
struct ProducerHeartbeats {
    last: i64,
    /// Interval before the last heartbeat.
    interval: Option<i64>,
    /// Two successive intervals that differ by at most a tenth.
    usual: Option<i64>,
}

impl ProducerHeartbeats {
    fn add_heartbeat(&mut self, now: i64) {
        let interval = now.saturating_sub(self.last);
        let is_usual = self.interval.is_some_and(|known| interval.saturating_sub(known).abs() <= known / 10);
        if is_usual {
            self.usual = Some(interval);
        }
        self.interval = (self.last != 0).then_some(interval);
        self.last = now;
    }
}

fn new(_policy: &RulePolicy) -> HeartbeatConsumer {
    HeartbeatConsumer::default()
}

impl HeartbeatConsumer {
    /// Reads the changed consumer lists. This is deferred because the event of a transfer precedes the new
    /// value.
    fn refresh_lists(&mut self, context: &RuleContext<'_>) {
        for consumer in std::mem::take(&mut self.changed) {
            self.contracts.retain(|contract| contract.consumer != consumer);
            let Some(node) = context.bus.node(consumer) else { continue };
            let entries = (1..=ENTRIES).filter_map(|sub| Some((sub, confirmed_number(node, 0x1016, sub)?)));
            for (sub, entry) in entries {
                let id = u8::try_from(entry >> 16 & 0x7F).unwrap_or(0);
                let time = i64::try_from(entry & 0xFFFF).unwrap_or(0).saturating_mul(1_000_000);
                if id != 0 && time != 0 && self.contracts.len() < CONTRACT_LIMIT {
                    self.contracts.push(ConsumerContract {
                        consumer,
                        sub,
                        producer: NodeId::Canopen(id),
                        time,
                    });
                }
            }
        }
    }

    fn on_heartbeat(&mut self, event: &Event, node: &Node, context: &mut RuleContext<'_>) {
        let producer = node.id();
        if let Some(beat) = self.beats.entry(producer) {
            beat.add_heartbeat(context.now);
        }
        let Some(period) = confirmed_number(node, 0x1017, 0).and_then(|time| i64::try_from(time).ok()) else {
            return;
        };
        let period = period.saturating_mul(1_000_000);
        for contract in self.contracts.iter().filter(|contract| contract.producer == producer) {
            if period < contract.time {
                context.count_pass();
                continue;
            }
            let object = ObjectAddress::new(0x1016, contract.sub);
            let (period, time) = (period / 1_000_000, contract.time / 1_000_000);
            let alarm = context
                .start_finding(event)
                .at_node(Some(contract.consumer))
                .with_subject(FindingSubject::Object(object));
            alarm.report_finding(|| {
                format!(
                    "consumer time {time} ms ≤ {period} ms producer time of {} (1017:00)",
                    producer.sentence_label()
                )
            });
        }
    }

    /// Checks the margin of the consumer times after a communication error of their consumer.
    fn check_margin(&self, event: &Event, node: &Node, context: &mut RuleContext<'_>) {
        for contract in self.contracts.iter().filter(|contract| contract.consumer == node.id()) {
            let Some(beat) = self.beats.get(contract.producer) else { continue };
            let Some(usual) = beat.usual else { continue };
            let rests = context.now.saturating_sub(beat.last);
            let was_late = rests >= contract.time || beat.interval.is_some_and(|it| it >= contract.time);
            let is_short = contract.time < usual.saturating_add(usual / 2);
            if !was_late || !is_short || contract.time <= usual {
                continue;
            }
            let [time, usual] = [contract.time, usual].map(|time| (time + 500_000) / 1_000_000);
            let late = rests.max(beat.interval.unwrap_or(0)) / 1_000_000;
            let alarm = context
                .start_finding(event)
                .with_subject(FindingSubject::Object(ObjectAddress::new(0x1016, contract.sub)));
            alarm.report_finding(|| {
                let producer = contract.producer.sentence_label();
                format!(
                    "consumer time {time} ms for {producer} < 1.5 × its heartbeat interval {usual} ms; {late} ms since \
                     its last heartbeat"
                )
            });
        }
    }

    /// Checks an EMCY 8130 against the heartbeats of the monitored producers.
    fn on_emcy_8130(&self, event: &Event, node: &Node, context: &mut RuleContext<'_>) {
        let count = confirmed_number(node, 0x1016, 0)
            .and_then(|count| u8::try_from(count).ok())
            .filter(|count| *count > 0);
        let Some(count) = count else { return };
        let is_guarded =
            confirmed_number(node, 0x100C, 0) != Some(0) && confirmed_number(node, 0x100D, 0) != Some(0);
        if is_guarded || (1..=count).any(|sub| confirmed_number(node, 0x1016, sub).is_none()) {
            return;
        }
        let mut own = self.contracts.iter().filter(|contract| contract.consumer == node.id()).peekable();
        if own.peek().is_none() {
            return;
        }
        let late = own.any(|contract| {
            let beat = self.beats.get(contract.producer);
            beat.is_none_or(|beat| context.now.saturating_sub(beat.last) >= contract.time / 10 * 9)
        });
        if late {
            return context.count_pass();
        }
        let alarm = context.start_finding(event).with_subject(FindingSubject::Code(HEARTBEAT_ERROR));
        alarm.report_finding(|| "EMCY 8130 although all monitored heartbeats arrived in time".to_owned());
    }
}

/// Whether a transfer contains an entry of the consumer list.
fn is_list(transfer: &SdoTransfer) -> bool {
    transfer.outcome == SdoOutcome::Complete && transfer.object.is_some_and(|object| object.index == 0x1016)
}

impl Rule for HeartbeatConsumer {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !self.changed.is_empty() {
            self.refresh_lists(context);
        }
        let (Some(id), Some(node)) = (event.node, context.event_node(event)) else { return };
        match &event.kind {
            EventKind::Heartbeat { .. } => self.on_heartbeat(event, node, context),
            EventKind::Emcy(emergency) => {
                if emergency.code == Some(HEARTBEAT_ERROR) {
                    self.on_emcy_8130(event, node, context);
                }
                if emergency.code.is_some_and(|code| code & 0xFF00 == COMMUNICATION) {
                    self.check_margin(event, node, context);
                }
            }
            EventKind::SdoTransfer(transfer) if is_list(transfer) && !self.changed.contains(&id) => {
                self.changed.push(id);
            }
            EventKind::BootUp { .. } => {
                self.contracts.retain(|contract| contract.consumer != id);
                self.beats.remove(id);
            }
            _ => {}
        }
    }
}
