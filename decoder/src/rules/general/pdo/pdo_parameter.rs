//! Cache for communication parameters of TPDOs. PDO rules run for every frame, so a parameter is only looked
//! up again after it may have changed.

use crate::event::{DecodedPdo, Event, EventKind};
use crate::profile::PdoDirection;
use crate::rules::general::facts::confirmed_number;
use crate::rules::{BySlot, PdoSlot, RuleContext};
use crate::wire::NodeId;

/// Number of PDOs without the parameter before it counts as absent on this bus; more than there are
/// identifiers.
const ENOUGH: u32 = 4096;

/// One parameter of all TPDOs of a bus.
#[derive(Default)]
pub(super) struct PdoParameter {
    sub: u8,
    generation: u32,
    known: BySlot<(u32, Option<u64>)>,
    /// The parameter was found for a PDO since the last change.
    is_known: bool,
    /// Number of PDOs without the parameter since the last change.
    in_vain: u32,
}

/// Result of the last look-up of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LookedUp {
    /// It may have changed since.
    NotYet,
    /// No confirmed value.
    Unknown,
    /// Confirmed value.
    Value(u64),
}

impl PdoParameter {
    /// Sub-index `sub` of 1800 and up.
    pub(super) fn new(sub: u8) -> Self {
        Self { sub, generation: 1, known: BySlot::default(), is_known: false, in_vain: 0 }
    }

    /// Processes an event; returns whether the parameter may have changed.
    pub(super) fn on_event(&mut self, event: &Event) -> bool {
        let changes = match &event.kind {
            EventKind::SdoTransfer(transfer) => transfer
                .object
                .is_some_and(|object| matches!(object.index, 0x1005..=0x1007 | 0x1400..=0x1BFF)),
            EventKind::BootUp { .. }
            | EventKind::NmtState(_)
            | EventKind::LostFrames { .. }
            | EventKind::BusSilent { .. }
            | EventKind::Link { .. } => true,
            _ => false,
        };
        if changes {
            self.generation = self.generation.wrapping_add(1);
            (self.is_known, self.in_vain) = (false, 0);
        }
        changes
    }

    /// Whether a look-up can succeed: false if no recent PDO had the parameter and nothing has changed since.
    pub(super) fn may_be_known(&self) -> bool {
        self.is_known || self.in_vain < ENOUGH
    }

    /// The value as far as it was looked up since the last change.
    pub(super) fn looked_up(&self, slot: &PdoSlot) -> LookedUp {
        match self.known.get(slot.place) {
            Some((generation, value)) if *generation == self.generation => {
                value.map_or(LookedUp::Unknown, LookedUp::Value)
            }
            _ => LookedUp::NotYet,
        }
    }

    /// Number of possible changes so far.
    pub(super) fn generation(&self) -> u32 {
        self.generation
    }

    /// Confirmed value of the parameter for a TPDO.
    #[inline]
    pub(super) fn value_for(
        &mut self,
        event: &Event,
        pdo: &DecodedPdo,
        slot: &PdoSlot,
        context: &RuleContext<'_>,
    ) -> Option<u64> {
        let value = match self.known.entry_of(slot) {
            Some((generation, value)) if *generation == self.generation => *value,
            _ => self.look_up(event.node?, pdo, slot, context),
        };
        if value.is_none() {
            self.in_vain = self.in_vain.saturating_add(1);
        }
        value
    }

    #[cold]
    fn look_up(
        &mut self,
        node: NodeId,
        pdo: &DecodedPdo,
        slot: &PdoSlot,
        context: &RuleContext<'_>,
    ) -> Option<u64> {
        let is_sent = pdo.name.direction == PdoDirection::Transmit;
        let node = context.bus.node(node).filter(|_| is_sent);
        let value = node.and_then(|node| confirmed_number(node, pdo.name.communication_index(), self.sub));
        self.is_known |= value.is_some();
        if let Some(known) = self.known.entry_of(slot) {
            *known = (self.generation, value);
        }
        value
    }
}
