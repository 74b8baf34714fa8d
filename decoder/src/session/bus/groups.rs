//! J1939 parameter groups: name and layout from the profile, a database or the standard.

use std::sync::Arc;

use super::nodes::{ConcernedDevice, layout_of_profile};
use super::state::Bus;
use crate::frame::CanId;
use crate::profile::{EntryResolver, LayoutOrigin, NoValues, PayloadLayout, isobus, pgn_name};
use crate::standard_tables::standard_group;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Max message size without transport protocol, in bytes.
const FRAME_BYTES: usize = 8;

/// Name and layout of a parameter group for one sender.
pub(in crate::session) struct SenderGroup {
    pub(in crate::session) name: Option<Arc<str>>,
    pub(in crate::session) layout: Option<Arc<PayloadLayout>>,
    /// Bits of the first eight bytes that decide about the layout.
    pub(in crate::session) deciding: u64,
}

impl SenderGroup {
    const fn new(name: Option<Arc<str>>, layout: Option<Arc<PayloadLayout>>) -> Self {
        Self { name, layout, deciding: 0 }
    }
}

impl Bus {
    /// Name and layout of a parameter group for a payload.
    pub(in crate::session) fn sender_group(&self, id: J1939Id, payload: &[u8]) -> SenderGroup {
        self.group_with(id, payload, self.nodes.concerned_device(id).as_ref())
    }

    pub(in crate::session) fn group_with(
        &self,
        id: J1939Id,
        payload: &[u8],
        concerned: Option<&ConcernedDevice>,
    ) -> SenderGroup {
        let of_device = concerned.and_then(|concerned| {
            let spec = concerned.message_spec()?;
            let node = self.node(concerned.node)?;
            let mut resolver = node.resolver();
            let mut layout = layout_of_profile(&spec.fields, LayoutOrigin::Profile, false, &mut resolver)?;
            layout.depends = resolver.looked_at;
            Some((spec.title_of(id.pgn), layout))
        });
        if let Some((name, layout)) = of_device {
            return SenderGroup::new(Some(name.into()), Some(Arc::new(layout)));
        }
        if let Some(group) = self.database_group(id.pgn, payload.len()) {
            return group;
        }
        match of_standard(id.pgn) {
            Some((name, layout)) => SenderGroup::new(Some(name.into()), Some(Arc::new(layout))),
            None => self.table_group(id.pgn, payload),
        }
    }

    /// Name and layout of a group in the tables of public standards. Our own names precede those of the tables,
    /// except for messages of manufacturers and groups of RV-C, which the number of the group does not identify.
    fn table_group(&self, pgn: Pgn, payload: &[u8]) -> SenderGroup {
        let own = pgn_name(pgn).map(Arc::from);
        let Some(found) = standard_group(self.protocols.standards(), pgn, payload) else {
            return SenderGroup::new(own, None);
        };
        let is_named = !found.name.is_empty();
        let precedes = pgn.is_proprietary() || found.layout.origin == LayoutOrigin::RvC;
        let name = match own {
            Some(own) if !(is_named && precedes) => Some(own),
            _ => is_named.then_some(found.name),
        };
        SenderGroup { deciding: found.deciding, ..SenderGroup::new(name, Some(found.layout)) }
    }

    /// Name and layout of a group from the user's databases. The layout of a message longer than one frame is
    /// not applied to a single frame.
    pub(in crate::session) fn database_group(&self, pgn: Pgn, length: usize) -> Option<SenderGroup> {
        let message = self.database.message_by_pgn(pgn)?;
        let is_long = message.length.is_none_or(|length| usize::from(length) > FRAME_BYTES);
        let layout = (length > FRAME_BYTES || !is_long).then(|| Arc::clone(&message.layout));
        Some(SenderGroup::new(Some(message.name.as_str().into()), layout))
    }

    /// Meaning of a J1939 identifier as text: `FE30 AVC valve 0 of F1`, `EA00 request, F1 to 80`.
    pub(in crate::session) fn describe_group(&self, id: CanId) -> String {
        let CanId::Extended(id) = id else { return String::new() };
        let Some(id) = J1939Id::from_identifier(id) else { return String::new() };
        let name = self
            .sender_group(id, &[u8::MAX; FRAME_BYTES])
            .name
            .map_or(String::new(), |name| format!(" {name}"));
        let ends = match (id.pgn.is_addressed(), id.destination) {
            (false, _) => format!(" of {:02X}", id.source),
            (true, ALL) => format!(", {:02X} to all", id.source),
            (true, destination) => format!(", {:02X} to {destination:02X}", id.source),
        };
        format!("{:04X}{name}{ends}", id.pgn.number())
    }

    /// Name of a group, for any sender.
    pub(in crate::session) fn group_name(&self, pgn: Pgn) -> Option<Arc<str>> {
        let own = self.database.message_by_pgn(pgn).map(|message| message.name.as_str().into());
        own.or_else(|| self.table_group(pgn, &[u8::MAX; FRAME_BYTES]).name)
    }
}

/// Name and layout of a group in ISO 11783.
pub(in crate::session) fn of_standard(pgn: Pgn) -> Option<(String, PayloadLayout)> {
    let standard = isobus();
    let spec = standard.messages.iter().find(|spec| spec.number_of(pgn).is_some())?;
    let mut resolver = EntryResolver::new(&standard.dictionary, &NoValues);
    let layout = layout_of_profile(&spec.fields, LayoutOrigin::Standard, false, &mut resolver)?;
    Some((spec.title_of(pgn), layout))
}
