//! Unexpected or incomplete changes of a node-ID or address.

use crate::event::{AddressClaim, ClaimAction, Event, EventKind, FrameRange, Kind, NodeIdSource};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::canopen::lss::LssContent;
use crate::wire::j1939::{J1939Name, Pgn};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A node-ID set by LSS is not stored, or a node still uses PDO identifiers of its old node-ID. A J1939
    /// device changes its address without a command, or sends messages before it claims its address. Devices
    /// that were already running at the start of the capture are exempt. So is a device that lost its address
    /// to a lower NAME, or could not claim one: it must claim another address.
    ///
    /// # Why it matters
    /// After the next power-on, the device has an unexpected node-ID or address. Another device with the old
    /// node-ID uses the same identifiers. Masters still send to the old address.
    ///
    /// # Source
    /// CiA 305 §3.9.3 (store configuration); CiA 301 §7.3.5 (predefined connection set); SAE J1939-81 §4.2.2,
    /// §4.4.3 (loss of an address), §4.5
    ///
    /// # What to look at first
    /// Check the preceding LSS commands or address claims. For CANopen, check 1400:01 to 1803:01 of the node,
    /// and whether the LSS master stores the node-ID.
    ///
    /// # Mutation
    /// move a device to another address by a claim that was not commanded
    "identity-move", Warning, "unexpected node-ID or address change",
    kinds: [
        Kind::Lss, Kind::NodeIdChange, Kind::Pdo, Kind::AddressClaim, Kind::J1939Request, Kind::J1939Message,
    ],
    needs: "a change of a node-ID by LSS, or an address claim",
    word: "IDENT",
    tolerances: &[
        define_tolerance("store-ms", 10_000.0, "ms", "from the use of a node-ID to its storage"),
        define_tolerance("settled-ms", 2_000.0, "ms", "after the start of the capture, in which devices may have been running"),
        define_tolerance("before-ms", 1_000.0, "ms", "maximum time from the first message to the address claim"),
    ],
}

/// LSS commands (CiA 305 §3.9.3): configure node-ID, store configuration.
const CONFIGURE: u8 = 0x11;
const STORE: u8 = 0x17;

/// Time within which a claim is a response to a request, in nanoseconds.
const ANSWER: i64 = 1_250_000_000;

/// Devices without their address that are stored; the oldest is dropped first.
const DISPLACED_LIMIT: usize = 64;

/// State of a node-ID that was configured by LSS.
#[derive(Clone, Copy, PartialEq, Eq)]
enum ConfiguredNodeId {
    Accepted,
    Stored,
}

struct IdentityMove {
    store: i64,
    settled: i64,
    before: i64,
    configured: Option<ConfiguredNodeId>,
    /// Nodes with an unstored node-ID from LSS, and the frame of the change.
    unstored: NodeMap<u64>,
    /// Previous node-IDs of nodes that changed their node-ID.
    moved: NodeMap<u8>,
    has_moved: bool,
    began: i64,
    /// Time of the latest request for address claims.
    asked: Option<i64>,
    /// Time and frame of the first message per address.
    first: NodeMap<(i64, u64)>,
    /// Devices that lost their address and have not claimed another one.
    displaced: Vec<J1939Name>,
}

fn new(policy: &RulePolicy) -> IdentityMove {
    let time = |key| policy.tolerance_ns(&DECLARATION, key);
    IdentityMove {
        store: time("store-ms"),
        settled: time("settled-ms"),
        before: time("before-ms"),
        configured: None,
        unstored: NodeMap::default(),
        moved: NodeMap::default(),
        has_moved: false,
        began: 0,
        asked: None,
        first: NodeMap::default(),
        displaced: Vec::new(),
    }
}

impl IdentityMove {
    /// Records a command that the LSS slave confirmed.
    fn lss_done(&mut self, command: u8) {
        match command {
            CONFIGURE => self.configured = Some(ConfiguredNodeId::Accepted),
            STORE => {
                self.configured = self.configured.map(|_| ConfiguredNodeId::Stored);
                // The node is not always identifiable, so all nodes are cleared.
                self.unstored = NodeMap::default();
            }
            _ => {}
        }
    }

    fn on_changed(
        &mut self,
        event: &Event,
        from: Option<u8>,
        by: NodeIdSource,
        context: &mut RuleContext<'_>,
    ) {
        let Some(node) = event.node else { return };
        if let (Some(from), Some(slot)) = (from, self.moved.entry(node)) {
            *slot = from;
            self.has_moved = true;
        }
        if by != NodeIdSource::Lss {
            return;
        }
        match self.configured.take() {
            Some(ConfiguredNodeId::Stored) => context.count_pass(),
            Some(ConfiguredNodeId::Accepted) => {
                if let Some(slot) = self.unstored.entry(node) {
                    *slot = event.frames.last;
                    context.wake_at(context.now.saturating_add(self.store), u64::from(node.number()));
                }
            }
            None => {}
        }
    }

    /// Checks a PDO of a node that changed its node-ID.
    #[cold]
    fn on_pdo(&self, event: &Event, id: CanId, context: &mut RuleContext<'_>) {
        let Some((node, from)) = event.node.and_then(|node| Some((node, *self.moved.get(node)?))) else {
            return;
        };
        let CanId::Standard(number) = id else { return };
        let low = number & 0x7F;
        if low == u16::from(node.number()) {
            context.count_pass();
        } else if low == u16::from(from) {
            let alarm = context.start_finding(event).with_subject(FindingSubject::Id(id));
            alarm.report_finding(|| format!("PDO on {id} of the old node-ID {from}"));
        }
    }

    fn on_claim(&mut self, event: &Event, claim: &AddressClaim, context: &mut RuleContext<'_>) {
        match claim.action {
            ClaimAction::Claimed => {}
            ClaimAction::Confirmed => return,
            ClaimAction::Lost | ClaimAction::CannotClaim => return self.displace_device(claim.name),
        }
        let to = claim.source;
        let was_displaced = self.recover_device(claim.name);
        if let Some(from) = claim.from {
            // Later messages from the old address belong to another device.
            self.first.remove(NodeId::J1939(from));
            context.ask_again();
        }
        if let Some(contention) = claim.contention {
            // The messages before the claim belong to the device that lost the address.
            self.displace_device(contention.other);
            self.first.remove(NodeId::J1939(to));
            context.ask_again();
        }
        if was_displaced || claim.contention.is_some() && claim.from.is_none() {
            return context.count_pass();
        }
        if let Some(from) = claim.from {
            if claim.commanded != 0 {
                return context.count_pass();
            }
            let alarm = context.start_finding(event);
            return alarm.report_finding(|| {
                format!("NAME {:016X} moved from {from:02X} to {to:02X} without a command", claim.name.0)
            });
        }
        self.first_claim(event, context);
    }

    /// Stores a device that has to claim another address (J1939-81 §4.4.3).
    fn displace_device(&mut self, name: J1939Name) {
        self.recover_device(name);
        if self.displaced.len() >= DISPLACED_LIMIT {
            self.displaced.remove(0);
        }
        self.displaced.push(name);
    }

    /// Removes a device from those without an address; returns whether it was among them.
    fn recover_device(&mut self, name: J1939Name) -> bool {
        let known = self.displaced.iter().position(|displaced| *displaced == name);
        known.map(|place| self.displaced.remove(place)).is_some()
    }

    fn first_claim(&self, event: &Event, context: &mut RuleContext<'_>) {
        let now = context.now;
        let Some(node) = event.node else { return };
        let Some((sent, frame)) = self.first.get(node).copied() else { return context.count_pass() };
        // A device that has been running for long responds to a request for its claim.
        let is_answer = self.asked.is_some_and(|asked| now.saturating_sub(asked) < ANSWER);
        let was_running =
            sent.saturating_sub(self.began) < self.settled || now.saturating_sub(sent) > self.before;
        if is_answer || was_running || !context.has_time {
            return;
        }
        let frames = FrameRange { first: frame, last: event.frames.last };
        let alarm = context
            .start_finding(event)
            .with_frames(frames)
            .with_subject(FindingSubject::Name("before its claim".into()));
        alarm.report_finding(|| {
            let early = now.saturating_sub(sent) / 1_000_000;
            format!("message {{{frame}}} {early} ms before the address claim")
        });
    }
}

impl Rule for IdentityMove {
    fn wants_pdos(&self) -> bool {
        self.has_moved
    }

    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        let is_known = event.node.is_some_and(|node| self.first.get(node).is_some());
        let is_message = matches!(event.kind, EventKind::J1939Message(_));
        if is_message && is_known { FrameNeed::NOTHING } else { FrameNeed::EACH }
    }

    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.began = context.now;
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if self.has_moved => self.on_pdo(event, pdo.cob_id, context),
            EventKind::J1939Message(_) => {
                if let Some(node) = event.node {
                    let now = context.now;
                    if self.first.get(node).is_none()
                        && let Some(slot) = self.first.entry(node)
                    {
                        *slot = (now, event.frames.last);
                    }
                }
            }
            EventKind::Lss { command, from_master: false, content: LssContent::Result { code: 0, .. } } => {
                self.lss_done(*command);
            }
            EventKind::NodeIdChange { from, by, .. } => self.on_changed(event, *from, *by, context),
            EventKind::J1939Request(request) if request.pgn == Pgn::ADDRESS_CLAIMED => {
                self.asked = Some(context.now);
            }
            EventKind::AddressClaim(claim) => self.on_claim(event, claim, context),
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Ok(number) = u8::try_from(token) else { return };
        let node = NodeId::Canopen(number);
        let Some(frame) = self.unstored.remove(node) else { return };
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(frame));
        let seconds = self.store / 1_000_000_000;
        alarm.report_finding(|| {
            format!("node-ID {number} set by LSS but not stored within {seconds} s (lost at power-off)")
        });
    }
}
