//! Errors in J1939 multi-packet transfers.

use crate::event::{
    Event, EventKind, EventProtocol, IrregularityKind, J1939Transfer, Kind, SdoOutcome, TransferIrregularity,
    TransportAbort, TransportMode,
};
use crate::finding::{FindingSubject, Severity};
use crate::profile;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::j1939::Pgn;
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A transfer by broadcast (BAM), connection (RTS/CTS) or the extended protocol times out (T1 to T4), is
    /// aborted, or has missing, misplaced or contradictory packets. Responses later than Tr or Th, and wrong
    /// packet spacing of a broadcast, are reported too. So are fast packets of NMEA 2000 with missing or repeated
    /// frames. Transfers cut off by the capture, and receivers
    /// without any frame, are exempt.
    ///
    /// # Why it matters
    /// The message is lost or late. Displays and service tools show old values.
    ///
    /// # Source
    /// SAE J1939-21 §5.10.2.4 (time-outs), §5.10.2.5 and §5.10.3 (broadcast, connection); ISO 11783-3 §5.11
    /// (extended protocol; broadcasts with 10 ms between packets)
    ///
    /// # What to look at first
    /// Check whether the sender or the receiver stopped. Check the load of the bus, because packets have a
    /// low priority, and look for a second transfer between the same devices.
    ///
    /// # Mutation
    /// drop a packet of a broadcast
    "transport-violation", Error, "error in a multi-packet transfer",
    kinds: [Kind::J1939Transfer, Kind::TransportIrregularity, Kind::Malformed],
    needs: "a multi-packet transfer",
    skips_holes: true,
    word: "TP",
    tolerances: &[
        define_tolerance("broadcast-note-ms", 50.0, "ms", "minimum broadcast packet spacing, else a note"),
        define_tolerance("broadcast-least-ms", 10.0, "ms", "minimum broadcast packet spacing, else a warning"),
        define_tolerance("broadcast-most-ms", 200.0, "ms", "maximum broadcast packet spacing, else a warning"),
        define_tolerance("grace-ms", 2_000.0, "ms", "after the start of the capture, in which transfers may have begun earlier"),
    ],
}

/// Rounding error of timestamps, in nanoseconds.
const STAMP: i64 = 1_000_000;

/// Abort reasons that are not an error: busy with another transfer (J1939-21 §5.10.3.4).
const BUSY: [u8; 2] = [1, 2];

struct TransportViolation {
    note: i64,
    least: i64,
    most: i64,
    grace: i64,
    began: i64,
}

fn new(policy: &RulePolicy) -> TransportViolation {
    let time = |key| policy.tolerance_ns(&DECLARATION, key);
    TransportViolation {
        note: time("broadcast-note-ms"),
        least: time("broadcast-least-ms"),
        most: time("broadcast-most-ms"),
        grace: time("grace-ms"),
        began: 0,
    }
}

fn group_subject(pgn: Option<Pgn>) -> FindingSubject {
    pgn.map_or(FindingSubject::Whole, |pgn| FindingSubject::Pgn(pgn.number()))
}

impl TransportViolation {
    fn on_transfer(&self, event: &Event, transfer: &J1939Transfer, context: &mut RuleContext<'_>) {
        if transfer.cut_start {
            return;
        }
        if transfer.mode == Some(TransportMode::FastPacket) {
            return Self::fast_packet(event, transfer, context);
        }
        match transfer.outcome {
            SdoOutcome::Complete => self.check_spacing(event, transfer, context),
            SdoOutcome::Timeout => Self::timed_out(event, transfer, context),
            SdoOutcome::Aborted => {
                if let Some(abort) = transfer.abort {
                    Self::on_aborted(event, transfer, abort, context);
                }
            }
            SdoOutcome::Incomplete => {
                let missing = transfer.missing;
                let alarm = context.start_finding(event).with_subject(group_subject(transfer.pgn));
                let of = transfer.packets.map_or_else(String::new, |packets| format!(" of {packets}"));
                alarm.report_finding(|| format!("{missing}{of} packets missing"));
            }
            SdoOutcome::Superseded => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(group_subject(transfer.pgn))
                    .with_severity(Severity::Warning);
                let seen = transfer.size;
                alarm.report_finding(|| {
                    format!("cancelled after {seen} bytes: sender started another transfer")
                });
            }
            SdoOutcome::Unfinished => {}
        }
    }

    fn fast_packet(event: &Event, transfer: &J1939Transfer, context: &mut RuleContext<'_>) {
        match transfer.outcome {
            SdoOutcome::Complete => context.count_pass(),
            SdoOutcome::Unfinished => {}
            _ => {
                let alarm = context
                    .start_finding(event)
                    .with_subject(group_subject(transfer.pgn))
                    .with_severity(Severity::Note);
                let (missing, repeated) = (transfer.missing, transfer.repeated);
                let of = transfer.packets.map_or_else(String::new, |frames| format!(" of {frames}"));
                alarm.report_finding(|| match (missing, repeated) {
                    (0, 0) => "fast packet incomplete: frames out of order or too short".to_owned(),
                    (0, _) => format!("fast packet incomplete: {} repeated", count_noun(repeated, "frame")),
                    _ => format!("fast packet incomplete: {missing}{of} frames missing"),
                });
            }
        }
    }

    fn timed_out(event: &Event, transfer: &J1939Transfer, context: &mut RuleContext<'_>) {
        let packets = u64::from(transfer.packets.unwrap_or(0));
        // Without any frame of the receiver, the capture may lack its frames.
        let is_one_sided = transfer.mode != Some(TransportMode::Broadcast)
            && transfer.size > 0
            && transfer.frame_count <= 1 + packets;
        if is_one_sided {
            return;
        }
        let timer = transfer.timer.map_or("time-out", |timer| timer.name());
        let (missing, destination) = (transfer.missing, transfer.destination);
        let alarm = context.start_finding(event).with_subject(group_subject(transfer.pgn));
        alarm.report_finding(|| match (transfer.size, missing) {
            (0, _) if transfer.mode != Some(TransportMode::Broadcast) => {
                format!("no response from {destination:02X} before the first packet ({timer} expired)")
            }
            (_, 0) => {
                format!("no acknowledgement from {destination:02X} after the last packet ({timer} expired)")
            }
            _ => format!("{missing} packets missing ({timer} expired)"),
        });
    }

    fn on_aborted(
        event: &Event,
        transfer: &J1939Transfer,
        abort: TransportAbort,
        context: &mut RuleContext<'_>,
    ) {
        let reason = u32::from(abort.reason);
        let severity = if BUSY.contains(&abort.reason) { Severity::Note } else { Severity::Warning };
        let by = if abort.by_sender { transfer.source } else { transfer.destination };
        let alarm =
            context.start_finding(event).with_subject(group_subject(transfer.pgn)).with_severity(severity);
        alarm.report_finding(|| {
            let text = profile::transport_aborts()
                .find_code(reason)
                .map_or("unknown reason", |code| code.text.as_str());
            format!("aborted by {by:02X} (reason {reason}: {text})")
        });
    }

    /// Checks the packet spacing of a broadcast.
    fn check_spacing(&self, event: &Event, transfer: &J1939Transfer, context: &mut RuleContext<'_>) {
        let Some((shortest, longest)) = transfer.spacing else { return context.count_pass() };
        let milliseconds = |time: i64| time / 1_000_000;
        let (note, least, most) =
            (milliseconds(self.note), milliseconds(self.least), milliseconds(self.most));
        let (short, long) = (milliseconds(shortest), milliseconds(longest));
        if longest > self.most + STAMP {
            let alarm = context
                .start_finding(event)
                .with_subject(group_subject(transfer.pgn))
                .with_severity(Severity::Warning);
            return alarm.report_finding(|| format!("broadcast packet spacing {long} ms > {most} ms"));
        }
        if shortest + STAMP < self.note {
            let severity = if shortest + STAMP < self.least { Severity::Warning } else { Severity::Note };
            let alarm = context
                .start_finding(event)
                .with_subject(group_subject(transfer.pgn))
                .with_severity(severity);
            return alarm.report_finding(|| {
                format!("broadcast packet spacing {short} ms < {note} ms ({least} ms in ISO 11783)")
            });
        }
        context.count_pass();
    }

    fn on_irregularity(&self, event: &Event, odd: &TransferIrregularity, context: &mut RuleContext<'_>) {
        let is_early = context.now.saturating_sub(self.began) < self.grace;
        let severity = match odd.what {
            // The outcome of the transfer includes the gap.
            IrregularityKind::Gap => return,
            IrregularityKind::Unexpected if is_early => return,
            IrregularityKind::Unexpected => Severity::Warning,
            IrregularityKind::Duplicate | IrregularityKind::Retransmission | IrregularityKind::Late => {
                Severity::Note
            }
        };
        let message = odd.message;
        let alarm = context.start_finding(event).with_subject(group_subject(odd.pgn)).with_severity(severity);
        alarm.report_finding(|| match (odd.what, odd.packet, odd.expected, odd.timer.zip(odd.delay)) {
            (IrregularityKind::Duplicate, Some(packet), ..) => format!("packet {packet} received twice"),
            (IrregularityKind::Retransmission, _, Some(from), _) => {
                format!("packets requested again from {from} on")
            }
            (IrregularityKind::Late, .., Some((timer, delay))) => {
                format!("{message} after {} ms ({} expired)", delay / 1_000_000, timer.name())
            }
            (IrregularityKind::Retransmission, ..) => format!("{message} repeated"),
            _ => format!("{message} without an open transfer"),
        });
    }
}

impl Rule for TransportViolation {
    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.began = context.now;
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::J1939Transfer(transfer) => self.on_transfer(event, transfer, context),
            EventKind::TransportIrregularity(odd) if event.protocol == EventProtocol::J1939 => {
                self.on_irregularity(event, odd, context);
            }
            // The frame is long enough, but contradicts the protocol or itself.
            EventKind::Malformed { error, reason }
                if error.needed == 0 && error.is_of_connection_management() =>
            {
                context
                    .start_finding(event)
                    .with_severity(Severity::Warning)
                    .report_finding(|| (*reason).to_owned());
            }
            _ => {}
        }
    }
}
