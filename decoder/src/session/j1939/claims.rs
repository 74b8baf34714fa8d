//! J1939 addresses: claims, contention and commanded addresses.
//!
//! The state of a device belongs to its NAME; the table of addresses changes over time. Only node names from
//! the user stay with their address.
//!
//! ```text
//! claim of address S by NAME N (J1939-81 §4.2.2)
//!  S is free, or holder unnamed     N takes S                  claimed
//!  N has S                          nothing changes            confirmed
//!  N has another address            N moves with its state     claimed, from
//!  M has S, N is lower              M loses S to N             claimed, contention
//!  M has S, N is higher             N is without address       lost, contention
//!  S is 254                         N is without address       cannot-claim
//! ```

use super::evidence::mark_sender_alive;
use super::payload::GroupPayload;
use super::trouble_codes::{cancel_dm1_deadline, schedule_dm1_deadline};
use crate::event::{AddressClaim, AddressConflict, ClaimAction, CommandedAddress, EventKind, EvictedState};
use crate::frame::{Frame, FrameFlags};
use crate::session::bus::{Bus, Node};
use crate::session::context::MachineContext;
use crate::session::identity::refresh_messages;
use crate::session::limits::{ADDRESSLESS_LIMIT, COMMANDED_LIMIT};
use crate::session::machine::ProtocolMachine;
use crate::wire::j1939::{J1939Id, J1939Name, NO_ADDRESS, commanded_address};
use crate::wire::{MalformedPayload, NodeId};

/// Time in ns within which the holder of an address must respond to a contending claim with its own claim
/// (J1939-81 §4.2.2); a holder that does not respond is absent.
const DEFENCE: i64 = 250_000_000;

/// Bytes of an address claim.
const CLAIM_BYTES: u8 = 8;

/// A commanded address.
#[derive(Debug, Clone, Copy)]
struct PendingAddress {
    name: J1939Name,
    address: u8,
    frame: u64,
}

/// Devices without an address, and pending commanded addresses.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct ClaimMachine {
    /// Devices that lost their address, stored under that address; the latest is last.
    without_address: Vec<Node>,
    /// Commanded addresses not yet claimed; the latest is last.
    commands: Vec<PendingAddress>,
    /// Devices evicted since the last `evicted` event.
    evicted: u64,
}

impl ClaimMachine {
    /// Last address of a device that has none now.
    fn last_address(&self, name: J1939Name) -> Option<u8> {
        let node = self.without_address.iter().find(|node| node.j1939_name() == Some(name))?;
        node.id().j1939()
    }

    fn recall_node(&mut self, name: J1939Name) -> Option<Node> {
        let place = self.without_address.iter().position(|node| node.j1939_name() == Some(name))?;
        Some(self.without_address.remove(place))
    }

    fn remember_node(&mut self, node: Node) {
        if self.without_address.len() >= ADDRESSLESS_LIMIT {
            self.without_address.remove(0);
            self.evicted = self.evicted.saturating_add(1);
        }
        self.without_address.push(node);
    }

    /// Stores a commanded address; returns whether an old one was evicted.
    fn store_command(&mut self, command: PendingAddress) -> bool {
        self.commands.retain(|known| known.name != command.name);
        let is_full = self.commands.len() >= COMMANDED_LIMIT;
        if is_full {
            self.commands.remove(0);
        }
        self.commands.push(command);
        is_full
    }

    /// Frame of the commanded address that a claim obeys; 0 for none.
    fn obeyed_command(&mut self, name: J1939Name, address: u8, action: ClaimAction) -> u64 {
        if !matches!(action, ClaimAction::Claimed | ClaimAction::Lost) {
            return 0;
        }
        let known = self.commands.iter().position(|command| command.name == name);
        let Some(command) = known.map(|place| self.commands.remove(place)) else { return 0 };
        if command.address == address { command.frame } else { 0 }
    }
}

impl ProtocolMachine for ClaimMachine {
    type Route<'a> = J1939Id;
    type Product = ();

    /// Handles an address claim or a cannot-claim message.
    #[cold]
    fn on_frame(&mut self, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return cx.emit_undecoded(frame, None);
        }
        let name = match (J1939Name::read(frame.data()), frame.data().len()) {
            (Some(name), 8) => name,
            (_, length) => {
                let available = u8::try_from(length).unwrap_or(u8::MAX);
                let error =
                    MalformedPayload { layer: "address-claim", offset: 0, needed: CLAIM_BYTES, available };
                return cx.emit_malformed_j1939(id, error, "an address claim has eight bytes", frame);
            }
        };
        let mut claim = if id.source == NO_ADDRESS {
            self.on_cannot_claim(name, cx)
        } else {
            self.on_claim(name, id.source, cx)
        };
        claim.commanded = self.obeyed_command(name, id.source, claim.action);
        // The frame of a device that loses does not come from the holder of the address.
        if matches!(claim.action, ClaimAction::Claimed | ClaimAction::Confirmed) {
            mark_sender_alive(&mut cx.bus, id.source, frame);
        }
        let routine = claim.action == ClaimAction::Confirmed;
        let mut event = cx.j1939_event(frame, id, EventKind::AddressClaim(claim));
        event.routine = routine;
        cx.send_event(&event);
        let count = std::mem::take(&mut self.evicted);
        if count > 0 {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::DeviceWithoutAddress, count });
        }
    }

    fn memory_size(&self) -> usize {
        self.without_address.iter().map(Node::footprint).sum::<usize>()
            + self.commands.capacity() * size_of::<PendingAddress>()
    }
}

impl ClaimMachine {
    /// Handles a commanded address, which needs two packets.
    pub(in crate::session) fn on_command(
        &mut self,
        payload: GroupPayload<'_>,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        let GroupPayload { id, data, frames } = payload;
        let (name, address) = match commanded_address(data) {
            Ok(command) => command,
            Err(error) => {
                return cx.emit_malformed_j1939(id, error, "a commanded address has nine bytes", frame);
            }
        };
        let present = cx.bus.nodes.address_of(name);
        let evicted = self.store_command(PendingAddress { name, address, frame: frame.number });
        let command = CommandedAddress { name, address, source: id.source, present };
        let mut event = cx.j1939_event(frame, id, EventKind::CommandedAddress(command));
        event.frames = frames;
        cx.send_event(&event);
        if evicted {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::CommandedAddress, count: 1 });
        }
    }

    /// Result of an address claim.
    fn on_claim(&mut self, name: J1939Name, source: u8, cx: &mut MachineContext<'_>) -> AddressClaim {
        let holder = cx.bus.node(NodeId::J1939(source)).and_then(Node::j1939_name);
        let had = cx.bus.nodes.address_of(name).or_else(|| self.last_address(name));
        let contention =
            holder.filter(|it| *it != name).map(|other| AddressConflict { other, winner: other.min(name) });
        let (action, contention) = match contention {
            None if holder.is_some() => {
                note_defence(source, &mut cx.bus);
                (ClaimAction::Confirmed, None)
            }
            Some(contention) if contention.winner != name => {
                if is_undefended(source, name, &mut cx.bus) {
                    self.take_address(name, source, cx);
                    (ClaimAction::Claimed, None)
                } else {
                    self.leave_address(name, cx);
                    (ClaimAction::Lost, Some(contention))
                }
            }
            contention => {
                self.take_address(name, source, cx);
                (ClaimAction::Claimed, contention)
            }
        };
        let from = had.filter(|had| *had != source);
        AddressClaim { action, name, source, from, contention, commanded: 0 }
    }

    /// Handles a cannot-claim message.
    fn on_cannot_claim(&mut self, name: J1939Name, cx: &mut MachineContext<'_>) -> AddressClaim {
        let from = cx.bus.nodes.address_of(name).or_else(|| self.last_address(name));
        self.leave_address(name, cx);
        let action = ClaimAction::CannotClaim;
        AddressClaim { action, name, source: NO_ADDRESS, from, contention: None, commanded: 0 }
    }

    /// Assigns an address to the device with this NAME, with all its state.
    fn take_address(&mut self, name: J1939Name, address: u8, cx: &mut MachineContext<'_>) {
        let present = cx.bus.nodes.address_of(name);
        refresh_assigned(&[present, Some(address)], cx);
        let known = match present {
            Some(present) => remove_resident(present, cx),
            None => self.recall_node(name),
        };
        // A device that had no address sends messages again.
        if present.is_none() && known.as_ref().is_some_and(|known| known.assigned.is_some()) {
            refresh_messages(cx);
        }
        let resident = remove_resident(address, cx);
        let mut node = match (known, resident) {
            (Some(known), Some(resident)) if resident.j1939_name().is_none() => merge_nodes(known, resident),
            // The capture may have started after the first claim of the device.
            (None, Some(resident)) if resident.j1939_name().is_none() => resident,
            (known, resident) => {
                if let Some(resident) = resident {
                    self.remember_node(resident);
                }
                known.unwrap_or_else(|| Node::new(NodeId::J1939(address), None))
            }
        };
        node.j1939_state().name = Some(name);
        node.j1939_state().challenged = None;
        store_node(address, node, cx);
    }

    /// Removes the address of a device; its state is stored until its next claim.
    fn leave_address(&mut self, name: J1939Name, cx: &mut MachineContext<'_>) {
        let Some(present) = cx.bus.nodes.address_of(name) else { return };
        refresh_assigned(&[Some(present)], cx);
        if let Some(node) = remove_resident(present, cx) {
            self.remember_node(node);
        }
    }
}

/// The holder of an address defended it.
fn note_defence(address: u8, bus: &mut Bus) {
    if let Some(state) = bus.nodes.node_mut(NodeId::J1939(address)).and_then(|node| node.j1939.as_deref_mut())
    {
        state.challenged = None;
    }
}

/// Whether the holder did not defend its address against an earlier claim of the same NAME: it is then
/// absent, also if its NAME is lower. Stores the claim.
fn is_undefended(address: u8, name: J1939Name, bus: &mut Bus) -> bool {
    let (now, runs) = (bus.clock.now(), bus.clock.has_timestamps());
    let Some(node) = bus.nodes.node_mut(NodeId::J1939(address)) else { return false };
    let challenged = &mut node.j1939_state().challenged;
    match *challenged {
        Some((known, since)) if known == name => runs && now.saturating_sub(since) > DEFENCE,
        _ => {
            *challenged = Some((name, now));
            false
        }
    }
}

/// Resets the messages if one of these devices has a profile.
fn refresh_assigned(addresses: &[Option<u8>], cx: &mut MachineContext<'_>) {
    let mut nodes = addresses.iter().flatten().filter_map(|address| cx.bus.node(NodeId::J1939(*address)));
    if nodes.any(|node| node.assigned.is_some()) {
        refresh_messages(cx);
    }
}

/// Removes a device from its address and puts an unknown device there.
fn remove_resident(address: u8, cx: &mut MachineContext<'_>) -> Option<Node> {
    let id = NodeId::J1939(address);
    cx.bus.node(id)?;
    let name = cx.bus.nodes.given_name(id);
    cancel_dm1_deadline(id, cx);
    let node = cx.bus.nodes.node_mut(id)?;
    Some(std::mem::replace(node, Node::new(id, name)))
}

/// Stores a device under an address.
fn store_node(address: u8, mut node: Node, cx: &mut MachineContext<'_>) {
    let id = NodeId::J1939(address);
    node.id = id;
    node.name = cx.bus.nodes.given_name(id);
    if let Some(place) = cx.bus.nodes.node_mut(id) {
        *place = node;
    }
    schedule_dm1_deadline(id, cx);
}

/// Combines a device with the unnamed device at its new address. Settings of the user for that address
/// apply to it, except those for the device itself.
fn merge_nodes(known: Node, resident: Node) -> Node {
    let given = resident.j1939.as_ref().and_then(|state| state.conversion);
    let (mut node, other) = if known.assigned.is_none() && resident.assigned.is_some() {
        (resident, known)
    } else {
        (known, resident)
    };
    let of_other = other.j1939.unwrap_or_default();
    let state = node.j1939_state();
    state.conversion = state.conversion.or(given).or(of_other.conversion);
    if of_other.name.is_some() {
        state.faults = of_other.faults;
    }
    node
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bus_file::BusFile;
    use crate::event::Event;
    use crate::event::FrameRange;
    use crate::frame::{BusIndex, CanId, Timestamp};
    use crate::profile::Catalogue;
    use crate::session::BusDecoder;
    use crate::session::{AssignedBy, Assignment, SessionOptions};

    /// Sends a claim of a NAME with this identity number.
    fn on_claim(bus: &mut BusDecoder, number: u64, address: u8, identity: u64) -> AddressClaim {
        let mut claims = Vec::new();
        let mut observer = |event: &Event, _: &Bus| {
            if let EventKind::AddressClaim(claim) = &event.kind {
                claims.push(claim.clone());
            }
        };
        let id = CanId::from_extended(0x18EE_FF00 | u32::from(address));
        let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000));
        let frame = Frame { number, time, ..Frame::data_frame(id, &identity.to_le_bytes()) };
        bus.push(&frame, &mut observer);
        claims.pop().unwrap()
    }

    fn bus(options: SessionOptions) -> BusDecoder {
        BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
    }

    fn device(bus: &Bus, address: u8) -> (Option<&str>, Option<&str>) {
        let node = bus.node(NodeId::J1939(address)).unwrap();
        (node.name(), node.device_id())
    }

    #[test]
    fn names_stay_with_the_address_and_devices_go_with_the_name() {
        let device_of_80 = Catalogue::default().device("danfoss-pve-ci:pvea").unwrap();
        let file =
            "[node.\"sa:0x80\"]\nname = \"boom\"\n[node.\"sa:0x81\"]\nname = \"slew\"\nspn_conversion = 2";
        let mut bus = bus(SessionOptions {
            bus_file: BusFile::parse(file).unwrap(),
            assignments: vec![Assignment {
                bus: None,
                node: NodeId::J1939(0x80),
                device: device_of_80,
                by: AssignedBy::Option,
            }],
            ..SessionOptions::default()
        });
        // The device starts at 81; the settings for 80 apply once it has address 80.
        assert_eq!(on_claim(&mut bus, 1, 0x81, 7).from, None);
        assert_eq!(device(bus.bus(), 0x81), (Some("slew"), None));
        assert_eq!(on_claim(&mut bus, 2, 0x80, 7).from, Some(0x81));
        assert_eq!(device(bus.bus(), 0x80), (Some("boom"), Some("danfoss-pve-ci:pvea")));
        let state = bus.bus().node(NodeId::J1939(0x80)).unwrap().j1939.as_deref().unwrap();
        assert_eq!((state.name, state.conversion.is_some()), (Some(J1939Name(7)), true));
        // From then on they move with the device; another device at 80 does not get them.
        assert_eq!(on_claim(&mut bus, 3, 0x82, 7).from, Some(0x80));
        assert_eq!(device(bus.bus(), 0x82), (None, Some("danfoss-pve-ci:pvea")));
        assert_eq!(on_claim(&mut bus, 4, 0x80, 9).from, None);
        assert_eq!(device(bus.bus(), 0x80), (Some("boom"), None));
        // This also applies after a time without an address.
        assert_eq!(on_claim(&mut bus, 5, 0x82, 1).contention.unwrap().other, J1939Name(7));
        assert_eq!(device(bus.bus(), 0x82), (None, None));
        assert_eq!(on_claim(&mut bus, 6, 0x83, 7).from, Some(0x82));
        assert_eq!(device(bus.bus(), 0x83), (None, Some("danfoss-pve-ci:pvea")));
    }

    #[test]
    fn a_claim_follows_a_command() {
        let mut bus = bus(SessionOptions::default());
        on_claim(&mut bus, 1, 0x80, 7);
        let mut reported = Vec::new();
        let mut observer = |event: &Event, _: &Bus| reported.push((event.frames, event.kind.clone()));
        let payload = [7, 0, 0, 0, 0, 0, 0, 0, 0x85];
        // 1CFED8F9: commanded address (FED8) from F9, in frames 2 to 4.
        let id = J1939Id::from_identifier(0x1CFE_D8F9).unwrap();
        let frame = Frame { number: 4, ..Frame::EMPTY };
        let frames = FrameRange { first: 2, last: 4 };
        bus.on_payload(GroupPayload { id, data: &payload, frames }, &frame, &mut observer);
        let command =
            CommandedAddress { name: J1939Name(7), address: 0x85, source: 0xF9, present: Some(0x80) };
        match &reported[..] {
            [(range, EventKind::CommandedAddress(found))] => assert_eq!((*range, found), (frames, &command)),
            other => panic!("{other:?}"),
        }
        let followed = on_claim(&mut bus, 5, 0x85, 7);
        assert_eq!((followed.commanded, followed.from), (4, Some(0x80)));
        // A commanded address is obeyed only once, and only by a claim of that address.
        assert_eq!(on_claim(&mut bus, 6, 0x80, 7).commanded, 0);
        bus.on_payload(GroupPayload { id, data: &payload, frames }, &frame, &mut |_: &Event, _: &Bus| {});
        assert_eq!(on_claim(&mut bus, 7, 0x86, 7).commanded, 0);
    }

    #[test]
    fn commands_without_a_follower_are_cancelled() {
        let mut claims = ClaimMachine::default();
        let mut evicted = 0;
        for name in 0..200 {
            evicted += usize::from(claims.store_command(PendingAddress {
                name: J1939Name(name),
                address: 0x80,
                frame: 1,
            }));
        }
        assert_eq!((evicted, claims.commands.len()), (200 - COMMANDED_LIMIT, COMMANDED_LIMIT));
    }
}
