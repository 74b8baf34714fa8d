//! Contention for an address, and messages from an address that the device has lost.

use crate::event::{AddressClaim, ClaimAction, Event, EventKind, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;
use crate::wire::j1939::J1939Name;

declare_rule! {
    /// # What it checks
    /// Two NAMEs claim one address, which goes to the lower NAME. It is a note if the other device may choose
    /// another address. A device that still sends from a lost address is an error, reported only while no
    /// other device may use the address.
    ///
    /// # Why it matters
    /// The device that loses is absent, or uses an unexpected address. Two devices that send from one address
    /// are mistaken for each other.
    ///
    /// # Source
    /// SAE J1939-81 §4.2.2.1 (claim, 250 ms before sending), §4.2.2.3, §4.5 (initialization)
    ///
    /// # What to look at first
    /// Compare the address settings of both devices. Check which device was added or replaced last.
    ///
    /// # Mutation
    /// insert the claim of a lower NAME for an address in use
    "address-contention", Error, "address claimed by two devices",
    kinds: [Kind::AddressClaim, Kind::J1939Message],
    needs: "an address claim",
    word: "CLAIM",
    tolerances: &[define_tolerance("grace-ms", 20.0, "ms", "after the loss of the address, in which queued messages are permitted")],
}

/// Addresses whose claimant must wait before it sends (J1939-81 §4.5).
const WAITS: std::ops::RangeInclusive<u8> = 128..=247;

/// Waiting time after such a claim, in nanoseconds.
const WAIT: i64 = 250_000_000;

/// Time for which messages from a vacated address are attributed to its last owner, in nanoseconds.
const LEFT: i64 = 5_000_000_000;

/// Maximum number of vacated addresses.
const WATCH_LIMIT: usize = 64;

/// Address that a device must no longer use.
struct VacatedAddress {
    address: u8,
    name: J1939Name,
    frame: u64,
    since: i64,
    until: i64,
}

struct AddressContention {
    grace: i64,
    left: Vec<VacatedAddress>,
}

fn new(policy: &RulePolicy) -> AddressContention {
    AddressContention { grace: policy.tolerance_ns(&DECLARATION, "grace-ms"), left: Vec::new() }
}

impl AddressContention {
    fn watch_claim(
        &mut self,
        address: u8,
        name: J1939Name,
        lasts: i64,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) {
        self.left.retain(|left| left.address != address);
        if context.has_time && self.left.len() < WATCH_LIMIT {
            let (frame, since) = (event.frames.last, context.now);
            context.ask_again();
            self.left.push(VacatedAddress {
                address,
                name,
                frame,
                since,
                until: since.saturating_add(lasts),
            });
        }
    }

    fn on_claim(&mut self, event: &Event, claim: &AddressClaim, context: &mut RuleContext<'_>) {
        let has_it = matches!(claim.action, ClaimAction::Claimed | ClaimAction::Confirmed);
        if has_it {
            self.left.retain(|left| left.address != claim.source);
            context.ask_again();
        }
        if let Some(from) = claim.from.filter(|from| *from != claim.source) {
            let is_free =
                context.bus.node(NodeId::J1939(from)).is_none_or(|node| node.j1939_name().is_none());
            if is_free {
                self.watch_claim(from, claim.name, LEFT, event, context);
            }
        }
        let Some(contention) = claim.contention else {
            if has_it {
                context.count_pass();
            }
            return;
        };
        let winner = contention.winner;
        let loser = if winner == claim.name { contention.other } else { claim.name };
        if has_it && WAITS.contains(&claim.source) {
            self.watch_claim(claim.source, loser, WAIT, event, context);
        }
        let may_choose = loser.fields().arbitrary_address_capable;
        let severity = if may_choose { Severity::Note } else { Severity::Warning };
        let alarm = context.start_finding(event).with_severity(severity);
        alarm.report_finding(|| {
            let address = claim.source;
            let then = if may_choose { "may claim another address" } else { "no other address" };
            format!(
                "address {address:02X} claimed by NAME {:016X} (wins) and NAME {:016X} (loses, {then})",
                winner.0, loser.0
            )
        });
    }

    fn on_message(&mut self, event: &Event, source: u8, context: &mut RuleContext<'_>) {
        let Some(place) = self.left.iter().position(|left| left.address == source) else { return };
        let Some(left) = self.left.get(place) else { return };
        if context.now > left.until {
            self.left.swap_remove(place);
            context.ask_again();
            return;
        }
        let late = context.now.saturating_sub(left.since);
        if late <= self.grace {
            return;
        }
        let (name, frame) = (left.name, left.frame);
        let alarm = context.start_finding(event).with_subject(FindingSubject::Name("still sending".into()));
        alarm.report_finding(|| {
            let [milliseconds, limit] = [late, self.grace].map(|time| time / 1_000_000);
            format!(
                "message from {source:02X} {milliseconds} ms after NAME {:016X} lost or left the address {{{frame}}} \
                 (limit {limit} ms)",
                name.0
            )
        });
    }
}

impl Rule for AddressContention {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match &event.kind {
            EventKind::J1939Message(message)
                if self.left.iter().all(|left| left.address != message.id.source) =>
            {
                FrameNeed::NOTHING
            }
            _ => FrameNeed::EACH,
        }
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::AddressClaim(claim) => self.on_claim(event, claim, context),
            EventKind::J1939Message(message) if !self.left.is_empty() => {
                self.on_message(event, message.id.source, context);
            }
            _ => {}
        }
    }
}
