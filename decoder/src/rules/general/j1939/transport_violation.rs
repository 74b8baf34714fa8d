//! A J1939 transfer of several packets goes wrong.

use crate::event::{
    Event, EventKind, Irregularity, IrregularityKind, J1939Transfer, Outcome, Protocol, TransportAbort,
    TransportMode,
};
use crate::finding::{About, Severity};
use crate::profile;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};
use crate::wire::j1939::Pgn;

declare_rule! {
    /// # What it checks
    /// Transfers by broadcast (BAM), connection (RTS/CTS) and the extended protocol: they end by a time-out (T1 to T4) or
    /// an abort, packets are missing or out of order, sizes contradict each other, an answer comes later than Tr or Th,
    /// packets of a broadcast come too fast or too slowly. What the capture may have cut off at its beginning or end is
    /// not judged, nor a missing answer where no frame of the receiver was seen at all.
    ///
    /// # Why it matters
    /// The message is lost, or arrives late; displays and service tools show old values.
    ///
    /// # Source
    /// SAE J1939-21 §5.10.2.4 (time-outs), §5.10.2.5 and §5.10.3 (broadcast, connection); ISO 11783-3 §5.11 (extended
    /// protocol; broadcasts with 10 ms between packets)
    ///
    /// # What to look at first
    /// Who was silent, the sender or the receiver; the load of the bus, as packets have a low priority; a second transfer
    /// of the same two devices at the time.
    ///
    /// # Mutation
    /// drop a packet of a broadcast
    "transport-violation", Error, "a transfer of several packets goes wrong",
    kinds: ["j1939-transfer", "transport-irregularity", "malformed"],
    word: "TP",
    tolerances: &[
        tolerance("broadcast-note-ms", 50.0, "ms", "between packets of a broadcast, less is a note"),
        tolerance("broadcast-least-ms", 10.0, "ms", "between packets of a broadcast, less is a warning"),
        tolerance("broadcast-most-ms", 200.0, "ms", "between packets of a broadcast, more is a warning"),
        tolerance("grace-ms", 2_000.0, "ms", "from the beginning of the capture, in which transfers may have begun before it"),
    ],
}

/// A stamp may be a millisecond early or late.
const STAMP: i64 = 1_000_000;

/// Reasons of an abort that say nothing bad: busy with another transfer (J1939-21 §5.10.3.4).
const BUSY: [u8; 2] = [1, 2];

struct TransportViolation {
    note: i64,
    least: i64,
    most: i64,
    grace: i64,
    began: i64,
}

fn new(policy: &Policy) -> TransportViolation {
    let time = |key| policy.nanoseconds(&DECLARATION, key);
    TransportViolation {
        note: time("broadcast-note-ms"),
        least: time("broadcast-least-ms"),
        most: time("broadcast-most-ms"),
        grace: time("grace-ms"),
        began: 0,
    }
}

fn about(pgn: Option<Pgn>) -> About {
    pgn.map_or(About::Whole, |pgn| About::Pgn(pgn.number()))
}

impl TransportViolation {
    fn transfer(&self, event: &Event, transfer: &J1939Transfer, context: &mut Context<'_>) {
        if transfer.cut_start {
            return;
        }
        match transfer.outcome {
            Outcome::Complete => self.spacing(event, transfer, context),
            Outcome::Timeout => Self::timed_out(event, transfer, context),
            Outcome::Aborted => {
                if let Some(abort) = transfer.abort {
                    Self::aborted(event, transfer, abort, context);
                }
            }
            Outcome::Incomplete => {
                let missing = transfer.missing;
                let alarm = context.fail(event).about(about(transfer.pgn));
                let of = transfer.packets.map_or_else(String::new, |packets| format!(" of {packets}"));
                alarm.say(|| format!("packets missing: {missing}{of}"));
            }
            Outcome::Superseded => {
                let alarm = context.fail(event).about(about(transfer.pgn)).severity(Severity::Warning);
                let seen = transfer.size;
                alarm.say(|| format!("given up after {seen} bytes: the sender began another one"));
            }
            Outcome::Unfinished => {}
        }
    }

    fn timed_out(event: &Event, transfer: &J1939Transfer, context: &mut Context<'_>) {
        let packets = u64::from(transfer.packets.unwrap_or(0));
        // Not a frame of the receiver: it may be missing in the capture alone.
        let is_one_sided = transfer.mode != Some(TransportMode::Broadcast)
            && transfer.size > 0
            && transfer.frame_count <= 1 + packets;
        if is_one_sided {
            return;
        }
        let timer = transfer.timer.map_or("time-out", |timer| timer.name());
        let (missing, destination) = (transfer.missing, transfer.destination);
        let alarm = context.fail(event).about(about(transfer.pgn));
        alarm.say(|| match (transfer.size, missing) {
            (0, _) if transfer.mode != Some(TransportMode::Broadcast) => {
                format!("{destination:02X} does not answer: {timer} passed before the first packet")
            }
            (_, 0) => format!("all packets came and {destination:02X} does not acknowledge: {timer} passed"),
            _ => format!("{timer} passed, packets missing: {missing}"),
        });
    }

    fn aborted(event: &Event, transfer: &J1939Transfer, abort: TransportAbort, context: &mut Context<'_>) {
        let reason = u32::from(abort.reason);
        let severity = if BUSY.contains(&abort.reason) { Severity::Note } else { Severity::Warning };
        let by = if abort.by_sender { transfer.source } else { transfer.destination };
        let alarm = context.fail(event).about(about(transfer.pgn)).severity(severity);
        alarm.say(|| {
            let text =
                profile::transport_aborts().find(reason).map_or("unknown reason", |code| code.text.as_str());
            format!("aborted by {by:02X}, reason {reason}: {text}")
        });
    }

    /// Times between the packets of a broadcast.
    fn spacing(&self, event: &Event, transfer: &J1939Transfer, context: &mut Context<'_>) {
        let Some((shortest, longest)) = transfer.spacing else { return context.pass() };
        let milliseconds = |time: i64| time / 1_000_000;
        let (note, least, most) =
            (milliseconds(self.note), milliseconds(self.least), milliseconds(self.most));
        let (short, long) = (milliseconds(shortest), milliseconds(longest));
        if longest > self.most + STAMP {
            let alarm = context.fail(event).about(about(transfer.pgn)).severity(Severity::Warning);
            return alarm.say(|| format!("{long} ms between packets of a broadcast; {most} ms is the most"));
        }
        if shortest + STAMP < self.note {
            let severity = if shortest + STAMP < self.least { Severity::Warning } else { Severity::Note };
            let alarm = context.fail(event).about(about(transfer.pgn)).severity(severity);
            return alarm.say(|| {
                format!("{short} ms between packets of a broadcast; {note} ms is the least, {least} ms in ISO 11783")
            });
        }
        context.pass();
    }

    fn irregular(&self, event: &Event, odd: &Irregularity, context: &mut Context<'_>) {
        let is_early = context.now.saturating_sub(self.began) < self.grace;
        let severity = match odd.what {
            // What a gap comes to the end of the transfer tells.
            IrregularityKind::Gap => return,
            IrregularityKind::Unexpected if is_early => return,
            IrregularityKind::Unexpected => Severity::Warning,
            IrregularityKind::Duplicate | IrregularityKind::Retransmission | IrregularityKind::Late => {
                Severity::Note
            }
        };
        let message = odd.message;
        let alarm = context.fail(event).about(about(odd.pgn)).severity(severity);
        alarm.say(|| match (odd.what, odd.packet, odd.expected, odd.timer.zip(odd.delay)) {
            (IrregularityKind::Duplicate, Some(packet), ..) => format!("packet {packet} came twice"),
            (IrregularityKind::Retransmission, _, Some(from), _) => {
                format!("packets are asked for again from {from} on")
            }
            (IrregularityKind::Late, .., Some((timer, delay))) => {
                format!("{message} after {} ms, later than {}", delay / 1_000_000, timer.name())
            }
            (IrregularityKind::Retransmission, ..) => format!("{message} again"),
            _ => format!("{message} that no transfer explains"),
        });
    }
}

impl Rule for TransportViolation {
    fn begin(&mut self, context: &mut Context<'_>) {
        self.began = context.now;
    }

    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::J1939Transfer(transfer) => self.transfer(event, transfer, context),
            EventKind::TransportIrregularity(odd) if event.protocol == Protocol::J1939 => {
                self.irregular(event, odd, context);
            }
            // Its bytes are enough, and contradict the protocol or each other.
            EventKind::Malformed { error, reason } if error.needed == 0 && is_transport(error.layer) => {
                context.fail(event).severity(Severity::Warning).say(|| (*reason).to_owned());
            }
            _ => {}
        }
    }
}

/// Whether a layer is connection management of a transport protocol.
pub(in crate::rules::general) fn is_transport(layer: &str) -> bool {
    matches!(layer, "tp.cm" | "etp.cm")
}
