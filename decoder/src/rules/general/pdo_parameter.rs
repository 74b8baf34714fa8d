//! Communication parameters of TPDOs, looked up once and again when something may have changed them: rules of
//! PDOs are asked for every frame.

use super::facts::sure;
use crate::event::{Event, EventKind, Pdo};
use crate::profile::PdoDirection;
use crate::rules::Context;
use crate::wire::NodeId;

/// One parameter of the TPDOs of a bus, by the place of their identifiers.
#[derive(Default)]
pub(super) struct PdoParameter {
    sub: u8,
    generation: u32,
    known: Vec<(u32, Option<u64>)>,
}

impl PdoParameter {
    /// Sub-index `sub` of 1800 and up.
    pub(super) fn new(sub: u8) -> Self {
        Self { sub, generation: 1, known: Vec::new() }
    }

    /// An event may change it; whether it does.
    pub(super) fn changes(&mut self, event: &Event) -> bool {
        let changes = match &event.kind {
            EventKind::SdoTransfer(transfer) => transfer
                .object
                .is_some_and(|object| matches!(object.index, 0x1005..=0x1007 | 0x1400..=0x1BFF)),
            EventKind::BootUp { .. } | EventKind::NmtState(_) | EventKind::LostFrames { .. } => true,
            _ => false,
        };
        self.generation = self.generation.wrapping_add(u32::from(changes));
        changes
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
        place: usize,
        context: &Context<'_>,
    ) -> Option<u64> {
        match self.known.get(place) {
            Some((generation, value)) if *generation == self.generation => *value,
            _ => self.look_up(event.node?, pdo, place, context),
        }
    }

    #[cold]
    fn look_up(&mut self, node: NodeId, pdo: &Pdo, place: usize, context: &Context<'_>) -> Option<u64> {
        let is_sent = pdo.name.direction == PdoDirection::Transmit;
        let node = context.bus.node(node).filter(|_| is_sent);
        let value = node.and_then(|node| sure(node, pdo.name.communication_index(), self.sub));
        if self.known.len() <= place {
            self.known.resize(place + 1, (0, None));
        }
        if let Some(known) = self.known.get_mut(place) {
            *known = (self.generation, value);
        }
        value
    }
}
