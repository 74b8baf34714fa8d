//! A device is somewhere else than before, or not where it says.

use crate::event::{AddressClaim, ClaimAction, Event, EventKind, FrameRange};
use crate::finding::About;
use crate::frame::CanId;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::lss::Content;
use crate::wire::j1939::Pgn;

declare_rule! {
    /// # What it checks
    /// A node-ID set by LSS is in use and was not stored. After a change of its node-ID a node still sends or takes PDOs
    /// on identifiers that belong to the old one. A J1939 device moves to another address without having been told to.
    /// A J1939 device that comes onto the bus sends messages before it claims its address; a capture that begins while
    /// it is running does not count.
    ///
    /// # Why it matters
    /// After the next power-on the device is where nobody expects it; the next device with the old number sends on the
    /// same identifiers; masters go on talking to the old address.
    ///
    /// # Source
    /// CiA 305 §3.9.3 (store configuration); CiA 301 §7.3.5 (predefined connection set); SAE J1939-81 §4.2.2, §4.5
    ///
    /// # What to look at first
    /// For CANopen 1400:01 to 1803:01 of the node, and whether the LSS master stores; for J1939 the claims before.
    ///
    /// # Mutation
    /// move a device to another address by a claim nobody told it to make
    "identity-move", Warning, "a device is at another number than before",
    kinds: ["lss", "node-id-change", "pdo", "address-claim", "j1939-request", "j1939-message"],
    word: "IDENT",
    tolerances: &[
        tolerance("store-ms", 10_000.0, "ms", "from the use of a node-ID to its storing"),
        tolerance("settled-ms", 2_000.0, "ms", "from the beginning of the capture, in which devices may have been running"),
        tolerance("before-ms", 1_000.0, "ms", "before its claim, in which a device sent its first message"),
    ],
}

/// LSS commands (CiA 305 §3.9.3): configure node-ID, store configuration.
const CONFIGURE: u8 = 0x11;
const STORE: u8 = 0x17;

/// Nanoseconds within which a claim is the answer to a request for it.
const ANSWER: i64 = 1_250_000_000;

/// A node-ID that LSS brought.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Configured {
    Accepted,
    Stored,
}

struct IdentityMove {
    store: i64,
    settled: i64,
    before: i64,
    configured: Option<Configured>,
    /// Nodes that use a node-ID of LSS which was not stored yet, and the frame of the change.
    unstored: NodeMap<u64>,
    /// Node-IDs before, of nodes that changed theirs.
    moved: NodeMap<u8>,
    has_moved: bool,
    began: i64,
    /// Last request for claims.
    asked: Option<i64>,
    /// First message of an address: time and frame.
    first: NodeMap<(i64, u64)>,
}

fn new(policy: &Policy) -> IdentityMove {
    let time = |key| policy.nanoseconds(&DECLARATION, key);
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
    }
}

impl IdentityMove {
    /// The slave says that it did as it was told.
    fn lss_done(&mut self, command: u8) {
        match command {
            CONFIGURE => self.configured = Some(Configured::Accepted),
            STORE => {
                self.configured = self.configured.map(|_| Configured::Stored);
                // Which node it was is not always known: none is blamed.
                self.unstored = NodeMap::default();
            }
            _ => {}
        }
    }

    fn changed(&mut self, event: &Event, from: Option<u8>, by: &str, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        if let (Some(from), Some(slot)) = (from, self.moved.entry(node)) {
            *slot = from;
            self.has_moved = true;
        }
        if by != "lss" {
            return;
        }
        match self.configured.take() {
            Some(Configured::Stored) => context.pass(),
            Some(Configured::Accepted) => {
                if let Some(slot) = self.unstored.entry(node) {
                    *slot = event.frames.last;
                    context.wake_at(context.now.saturating_add(self.store), u64::from(node.number()));
                }
            }
            None => {}
        }
    }

    /// A PDO of a node that changed its node-ID.
    #[cold]
    fn pdo(&self, event: &Event, id: CanId, context: &mut Context<'_>) {
        let Some((node, from)) = event.node.and_then(|node| Some((node, *self.moved.get(node)?))) else {
            return;
        };
        let CanId::Standard(number) = id else { return };
        let low = number & 0x7F;
        if low == u16::from(node.number()) {
            context.pass();
        } else if low == u16::from(from) {
            let alarm = context.fail(event).about(About::Id(id));
            alarm.say(|| format!("PDO on {id}, which belongs to its old node-ID {from}"));
        }
    }

    fn claim(&mut self, event: &Event, claim: &AddressClaim, context: &mut Context<'_>) {
        if claim.action != ClaimAction::Claimed {
            return;
        }
        let to = claim.source;
        if let Some(from) = claim.from {
            if claim.commanded != 0 {
                return context.pass();
            }
            let alarm = context.fail(event);
            return alarm.say(|| {
                format!("NAME {:016X} moved from {from:02X} to {to:02X}, and nobody told it to", claim.name.0)
            });
        }
        self.first_claim(event, context);
    }

    fn first_claim(&self, event: &Event, context: &mut Context<'_>) {
        let now = context.now;
        let Some(node) = event.node else { return };
        let Some((sent, frame)) = self.first.get(node).copied() else { return context.pass() };
        // Asked for its claim, a device that has been running for long answers.
        let is_answer = self.asked.is_some_and(|asked| now.saturating_sub(asked) < ANSWER);
        let was_running =
            sent.saturating_sub(self.began) < self.settled || now.saturating_sub(sent) > self.before;
        if is_answer || was_running || !context.has_time {
            return;
        }
        let frames = FrameRange { first: frame, last: event.frames.last };
        let alarm = context.fail(event).frames(frames).about(About::Name("before its claim".into()));
        alarm.say(|| {
            let early = now.saturating_sub(sent) / 1_000_000;
            format!("sent {early} ms before it claimed its address {{{frame}}}")
        });
    }
}

impl Rule for IdentityMove {
    fn wants_pdos(&self) -> bool {
        self.has_moved
    }

    fn begin(&mut self, context: &mut Context<'_>) {
        self.began = context.now;
    }

    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if self.has_moved => self.pdo(event, pdo.cob_id, context),
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
            EventKind::Lss { command, from_master: false, content: Content::Result { code: 0, .. } } => {
                self.lss_done(*command);
            }
            EventKind::NodeIdChange { from, by, .. } => self.changed(event, *from, by, context),
            EventKind::J1939Request(request) if request.pgn == Pgn::ADDRESS_CLAIMED => {
                self.asked = Some(context.now);
            }
            EventKind::AddressClaim(claim) => self.claim(event, claim, context),
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Ok(number) = u8::try_from(token) else { return };
        let node = NodeId::Canopen(number);
        let Some(frame) = self.unstored.remove(node) else { return };
        let alarm = context.fail_at(context.now, Some(node), FrameRange::one(frame));
        let seconds = self.store / 1_000_000_000;
        alarm.say(|| {
            format!("node-ID {number} was set by LSS and not stored within {seconds} s: gone after power-on")
        });
    }
}
