//! A node starts anew: what waited takes effect, what was not kept is gone (DESIGN: a trace never shows a
//! power-on, so effects of one are presumed until something confirms or contradicts them).

use std::sync::Arc;

use crate::event::{BootCause, EventKind, ObjectChange};
use crate::frame::Frame;
use crate::profile::device::Order;
use crate::profile::object::Format;
use crate::profile::{Effect, Storage};
use crate::session::node::Node;
use crate::session::store::{Origin, OriginKind};
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// How thoroughly a node starts anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum Restart {
    /// NMT reset communication.
    Communication,
    /// NMT reset node.
    Node,
    /// Not commanded: a power-on, or a restart of the node's own.
    PowerOn,
}

impl Restart {
    /// Whether a value that waits for this takes effect.
    const fn brings(self, effect: Effect) -> bool {
        match effect {
            Effect::ResetCommunication => true,
            Effect::ResetNode => matches!(self, Self::Node | Self::PowerOn),
            Effect::PowerOn => matches!(self, Self::PowerOn),
            _ => false,
        }
    }
}

/// One value that is another one behind the restart.
struct Change {
    object: ObjectAddress,
    from: Option<Vec<u8>>,
    to: Option<Vec<u8>>,
    origin: &'static str,
}

impl Bus {
    /// Why a node starts now; the command that explains it is used up.
    pub(in crate::session) fn boot_cause(&mut self, id: NodeId) -> BootCause {
        let sign = self.power_sign(id);
        // A reset of all also means a node of which nothing was heard since.
        let before = self.node(id).map_or(0, |node| node.last_frame);
        let reset_of_all = self.reset_all.filter(|(reset, _)| *reset > before);
        let Some(node) = self.node_mut(id) else { return BootCause::PresumedPowerOn { sign } };
        let commanded = node.reset_frame.take().or(reset_of_all);
        node.restart = commanded.map_or(Restart::PowerOn, |(_, restart)| restart);
        match commanded {
            Some((frame, _)) => BootCause::Commanded { frame },
            None => BootCause::PresumedPowerOn { sign },
        }
    }

    /// Values that will be gone, of those written: for the event that tells the start.
    pub(in crate::session) fn settings_lost(&self, id: NodeId) -> u32 {
        let Some(node) = self.node(id) else { return 0 };
        let lost = lost(node).into_iter().filter(|change| {
            let entry = node.store.get(change.object);
            change.from != change.to && entry.is_some_and(|entry| entry.origin.kind == OriginKind::Download)
        });
        u32::try_from(lost.count()).unwrap_or(u32::MAX)
    }

    /// What a start does to the values known of a node.
    pub(in crate::session) fn restarted(
        &mut self,
        id: NodeId,
        cause: BootCause,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if matches!(cause, BootCause::PresumedPowerOn { .. }) {
            self.last_boot = Some((self.clock.now(), id));
        }
        let Some(node) = self.node_mut(id) else { return };
        node.boots = node.boots.saturating_add(1);
        node.just_booted = true;
        let presumed = node.restart == Restart::PowerOn;
        let comes = node.restart_brings();
        let waiting = Arc::make_mut(&mut node.store).take_waiting(comes);
        let lost = lost(node);
        let store = Arc::make_mut(&mut node.store);
        for change in &lost {
            match &change.to {
                Some(kept) => store.fall_back(change.object, kept),
                None => store.remove(change.object),
            }
        }
        let mut changes = lost;
        for (object, value) in waiting {
            let from = store.seen(object).map(|entry| entry.value.clone());
            let origin = Origin { kind: OriginKind::Download, frame: frame.number, time: frame.time };
            if store.set(object, &value, origin).is_ok() && presumed {
                store.doubt(object);
            }
            changes.push(Change { object, from, to: Some(value), origin: "restart" });
        }
        self.forget_unsaved(id);
        self.routes.refresh_pdos_of(id);
        self.device_restarted(id, frame);
        self.tell_changes(id, changes, frame, out);
    }

    fn tell_changes(&mut self, id: NodeId, changes: Vec<Change>, frame: &Frame, out: &mut dyn Observer) {
        for Change { object, from, to, origin } in changes {
            if from == to {
                continue;
            }
            self.fell_back(id, object);
            let kind = EventKind::ObjectChange(Box::new(ObjectChange {
                object,
                from,
                to,
                origin,
                effect: None,
                persists: None,
            }));
            self.emit(frame, id, origin != "restart", kind, out);
        }
    }

    /// An object has another value without a message: identifiers and times follow.
    fn fell_back(&mut self, id: NodeId, object: ObjectAddress) {
        if let Some(node) = self.node_mut(id) {
            let decides = node.device.emcy.byte_order.as_ref().and_then(Order::object) == Some(object);
            node.emcy_order = node.emcy_order.filter(|_| !decides);
        }
        let known = self.node(id).is_some_and(|node| node.store.seen(object).is_some());
        if known {
            self.take_effect(id, object);
        } else {
            self.forget_effect(id, object);
            self.delivered_acts(id, object);
        }
    }
}

/// What falls back: volatile objects, and those whose last write was not stored.
fn lost(node: &Node) -> Vec<Change> {
    let mut changes = Vec::new();
    for (object, entry) in node.store.sorted() {
        if matches!(entry.origin.kind, OriginKind::BusFile | OriginKind::DeviceFile) {
            continue;
        }
        let known = node.device.dictionary.find(object).and_then(|found| found.entry);
        // A signature is a command: nothing was set.
        let known = known.filter(|known| known.format != Format::Ascii);
        let kept = node.store.kept(object).map(<[u8]>::to_vec);
        let to = match known.map(|known| known.storage) {
            Some(Storage::Volatile) => None,
            Some(Storage::Save) if entry.origin.kind == OriginKind::Download => kept,
            _ => continue,
        };
        if to.as_ref() != Some(&entry.value) {
            changes.push(Change { object, from: Some(entry.value.clone()), to, origin: "reset" });
        }
    }
    changes
}

impl Node {
    /// Whether a waiting value takes effect at the present restart.
    fn restart_brings(&self) -> impl Fn(Effect) -> bool + use<> {
        let restart = self.restart;
        move |effect| restart.brings(effect)
    }
}
