//! Identifiers in use against the objects that set them.

use crate::event::{Direction, Event, EventKind, SdoTransfer};
use crate::finding::About;
use crate::frame::CanId;
use crate::rules::general::facts::{about, identifier, number, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// The identifiers of the first SDO server (1200:01, 1200:02) are those it is just asked on; an EMCY comes on the
    /// identifier that 1014 says, and none while 1014 says that there is none.
    ///
    /// # Why it matters
    /// Who configures itself by these objects listens on another identifier.
    ///
    /// # Source
    /// CiA 301 §7.5.2.16 (1014), §7.5.2.33 (1200), §7.3.3 (predefined connection set)
    ///
    /// # What to look at first
    /// Whether the node-ID was changed and the objects stayed; a second device on the identifier.
    ///
    /// # Mutation
    /// change the identifier in the answer to an upload of 1200:01
    "cob-id-mismatch", Warning, "a service uses another identifier than its object says",
    kinds: ["sdo-transfer", "emcy", "node-id-change"],
    cases: &["2.12", "5.1", "6.1", "7.4"],
    word: "COBID",
}

const EMCY_ID: ObjectAddress = ObjectAddress::new(0x1014, 0);

#[derive(Default)]
struct CobIdMismatch {
    /// Frame in which a node took another node-ID: what was read before need not hold.
    moved: NodeMap<u64>,
}

fn new(_policy: &Policy) -> CobIdMismatch {
    CobIdMismatch::default()
}

impl CobIdMismatch {
    fn server(event: &Event, transfer: &SdoTransfer, context: &mut Context<'_>) {
        let used = match transfer.object.map(|object| (object.index, object.sub)) {
            Some((0x1200, 1)) => transfer.request,
            Some((0x1200, 2)) => transfer.response,
            _ => return,
        };
        let is_read = transfer.direction == Some(Direction::Upload);
        let Some(cob_id) = number(transfer).filter(|_| is_read) else { return };
        if identifier(cob_id) == Some(used) {
            return context.pass();
        }
        // Another channel of the same server may be the one that is used.
        let predefined = event.node.and_then(NodeId::canopen).is_some_and(|node| {
            let offset = if used == transfer.request { 0x600 } else { 0x580 };
            used == CanId::standard(offset + u16::from(node))
        });
        if predefined {
            let alarm = context.fail(event).about(about(transfer));
            alarm.say(|| format!("says {cob_id:X}h, the server is asked and answers with {used} in use"));
        }
    }

    fn emcy(&self, event: &Event, used: CanId, context: &mut Context<'_>) {
        let Some(node) = context.node(event) else { return };
        let is_old = |frame: u64| self.moved.get(node.id()).is_some_and(|moved| frame < *moved);
        let known = node.store().seen(EMCY_ID).filter(|entry| !is_old(entry.origin.frame));
        let Some(cob_id) = known.and_then(|_| sure(node, EMCY_ID.index, EMCY_ID.sub)) else {
            let default = CanId::standard(0x80 + u16::from(node.id().number()));
            if used == default {
                context.pass();
            }
            return;
        };
        if identifier(cob_id) == Some(used) {
            return context.pass();
        }
        let alarm = context.fail(event).about(About::Id(used));
        alarm.say(|| format!("EMCY on {used}; 1014 says {cob_id:X}h"));
    }
}

impl Rule for CobIdMismatch {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::SdoTransfer(transfer) => Self::server(event, transfer, context),
            EventKind::Emcy(emergency) => self.emcy(event, emergency.cob_id, context),
            EventKind::NodeIdChange { .. } => {
                if let Some(moved) = event.node.and_then(|node| self.moved.entry(node)) {
                    *moved = event.frames.last;
                }
            }
            _ => {}
        }
    }
}
