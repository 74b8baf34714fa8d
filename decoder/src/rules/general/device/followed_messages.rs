//! J1939 messages that carry set points or measured values of a device.

use std::collections::HashMap;
use std::sync::Arc;

use foldhash::fast::FixedState;

use crate::event::J1939Message;
use crate::frame::CanId;
use crate::profile::{PayloadLayout, SignalId};
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Maximum number of identifiers per bus; further ones are not checked.
const MESSAGE_LIMIT: usize = 256;

/// Fields of one identifier.
#[derive(Default)]
pub(super) struct FollowedMessage {
    layout: Option<Arc<PayloadLayout>>,
    /// Device that the message commands, or that sends it.
    pub(super) node: Option<NodeId>,
    pub(super) is_command: bool,
    /// Index of a measured value, and its set point.
    pub(super) measured: Vec<(usize, ObjectAddress)>,
    /// Index of a state, and the values in which measured values do not follow.
    open_loop: Vec<(usize, Vec<i64>)>,
}

/// Fields by identifier.
#[derive(Default)]
pub(super) struct FollowedMessages {
    by_id: HashMap<CanId, FollowedMessage, FixedState>,
}

impl FollowedMessages {
    /// Fields of a message; `None` without a layout.
    pub(super) fn followed_message(&mut self, message: &J1939Message, bus: &Bus) -> Option<&FollowedMessage> {
        let layout = message.layout.as_ref()?;
        let fits = self.by_id.len() < MESSAGE_LIMIT || self.by_id.contains_key(&message.can_id);
        let known = fits.then(|| self.by_id.entry(message.can_id).or_default())?;
        if known.layout.as_ref().is_none_or(|learnt| !Arc::ptr_eq(learnt, layout)) {
            *known = FollowedMessage::new(message, layout, bus);
        }
        Some(known)
    }
}

impl FollowedMessage {
    #[cold]
    fn new(message: &J1939Message, layout: &Arc<PayloadLayout>, bus: &Bus) -> Self {
        let commanded = bus.identifiers().awaited_message(message.can_id).map(|(node, _)| node);
        let id = commanded.unwrap_or(NodeId::J1939(message.id.source));
        let mut fields = Self { layout: Some(Arc::clone(layout)), ..Self::default() };
        let Some(node) = bus.node(id) else { return fields };
        fields.node = Some(id);
        fields.is_command = commanded.is_some();
        for (place, field) in layout.fields.iter().enumerate() {
            let SignalId::Object(object) = field.id else { continue };
            if let (Some(of), false) = (field.meaning.as_deref().and_then(|it| it.of), fields.is_command) {
                fields.measured.push((place, of));
            }
            let entry = node.device().dictionary.find_object(object).and_then(|found| found.entry);
            if let Some(entry) = entry.filter(|entry| !entry.open_loop.is_empty()) {
                fields.open_loop.push((place, entry.open_loop.clone()));
            }
        }
        fields
    }

    /// Whether a state in the message excludes that measured values follow.
    pub(super) fn is_open_loop(&self, message: &J1939Message) -> bool {
        let Some(layout) = &self.layout else { return false };
        self.open_loop.iter().any(|(place, values)| {
            let field = layout.fields.get(*place);
            let raw = field.and_then(|field| field.extract_bits(message.payload()));
            raw.and_then(|raw| i64::try_from(raw).ok()).is_some_and(|raw| values.contains(&raw))
        })
    }
}
