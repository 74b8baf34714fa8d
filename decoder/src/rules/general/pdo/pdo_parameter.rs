//! Communication parameters of TPDOs, looked up once and again when something may have changed them: rules of
//! PDOs are asked for every frame.

use crate::event::{Event, EventKind, Pdo};
use crate::profile::PdoDirection;
use crate::rules::general::facts::sure;
use crate::rules::{BySlot, Context, PdoSlot};
use crate::wire::NodeId;

/// PDOs without the parameter after which none of the bus has it: more than there are identifiers.
const ENOUGH: u32 = 4096;

/// One parameter of the TPDOs of a bus, by the place of their identifiers.
#[derive(Default)]
pub(super) struct PdoParameter {
    sub: u8,
    generation: u32,
    known: BySlot<(u32, Option<u64>)>,
    /// It was found for some PDO since it may have changed.
    is_known: bool,
    /// PDOs since then for which it was not.
    in_vain: u32,
}

impl PdoParameter {
    /// Sub-index `sub` of 1800 and up.
    pub(super) fn new(sub: u8) -> Self {
        Self { sub, generation: 1, known: BySlot::default(), is_known: false, in_vain: 0 }
    }

    /// An event may change it; whether it does.
    pub(super) fn changes(&mut self, event: &Event) -> bool {
        let changes = match &event.kind {
            EventKind::SdoTransfer(transfer) => transfer
                .object
                .is_some_and(|object| matches!(object.index, 0x1005..=0x1007 | 0x1400..=0x1BFF)),
            EventKind::BootUp { .. }
            | EventKind::NmtState(_)
            | EventKind::LostFrames { .. }
            | EventKind::Link { .. } => true,
            _ => false,
        };
        if changes {
            self.generation = self.generation.wrapping_add(1);
            (self.is_known, self.in_vain) = (false, 0);
        }
        changes
    }

    /// Whether PDOs may have it: known of none of the last ones it will not be known of the next, until something changes.
    pub(super) fn may_be_known(&self) -> bool {
        self.is_known || self.in_vain < ENOUGH
    }

    /// Counts changes.
    pub(super) fn generation(&self) -> u32 {
        self.generation
    }

    /// The parameter of a TPDO, where it was surely seen.
    #[inline]
    pub(super) fn of(
        &mut self,
        event: &Event,
        pdo: &Pdo,
        slot: &PdoSlot,
        context: &Context<'_>,
    ) -> Option<u64> {
        let value = match self.known.of(slot) {
            Some((generation, value)) if *generation == self.generation => *value,
            _ => self.look_up(event.node?, pdo, slot, context),
        };
        if value.is_none() {
            self.in_vain = self.in_vain.saturating_add(1);
        }
        value
    }

    #[cold]
    fn look_up(&mut self, node: NodeId, pdo: &Pdo, slot: &PdoSlot, context: &Context<'_>) -> Option<u64> {
        let is_sent = pdo.name.direction == PdoDirection::Transmit;
        let node = context.bus.node(node).filter(|_| is_sent);
        let value = node.and_then(|node| sure(node, pdo.name.communication_index(), self.sub));
        self.is_known |= value.is_some();
        if let Some(known) = self.known.of(slot) {
            *known = (self.generation, value);
        }
        value
    }
}
