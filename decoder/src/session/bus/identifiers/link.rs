//! ISO-TP links: one direction between two addresses. The frames of a link form its messages.
//!
//! Identifiers that differ only in priority belong to one link. Flow control and responses use the link
//! [`UdsLink::opposite_link`].

use std::sync::Arc;

use crate::bus_file::UdsPair;
use crate::event::UdsEndpoints;
use crate::frame::CanId;
use crate::wire::isotp::{AddressScheme, IsoTpAddresses};

/// Sender and receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(in crate::session) enum UdsLink {
    /// Addresses in the identifier.
    Addressed { scheme: AddressScheme, functional: bool, source: u16, target: u16 },
    /// Identifiers of a pair in the bus file.
    Named { pair: u16, from_client: bool },
    /// Functional identifier in the bus file: an index in [`UdsPairs::groups`].
    Group(u16),
}

impl UdsLink {
    /// Link defined by the addresses in a 29-bit identifier.
    pub(in crate::session) fn link_of(id: CanId) -> Option<Self> {
        let CanId::Extended(id) = id else { return None };
        let IsoTpAddresses { scheme, functional, source, target, .. } = IsoTpAddresses::from_identifier(id)?;
        Some(Self::Addressed { scheme, functional, source, target })
    }

    /// Link of the opposite direction.
    pub(in crate::session) const fn opposite_link(self) -> Self {
        match self {
            Self::Addressed { scheme, functional, source, target } => {
                Self::Addressed { scheme, functional, source: target, target: source }
            }
            Self::Named { pair, from_client } => Self::Named { pair, from_client: !from_client },
            Self::Group(group) => Self::Group(group),
        }
    }

    /// Whether the receiver is a group of servers.
    pub(in crate::session) const fn is_functional(self) -> bool {
        matches!(self, Self::Addressed { functional: true, .. } | Self::Group(_))
    }

    /// Whether only the bits of the identifier suggest ISO-TP. Some networks use identifiers with EDP and DP
    /// set for other purposes.
    pub(in crate::session) const fn needs_evidence(self) -> bool {
        matches!(self, Self::Addressed { scheme: AddressScheme::Net, .. })
    }

    /// Address of the receiver; `None` for a group or another net.
    pub(in crate::session) fn server_address(self) -> Option<u8> {
        match self {
            Self::Addressed { functional: false, target, .. } => u8::try_from(target).ok(),
            _ => None,
        }
    }
}

/// Pairs of UDS identifiers in the bus file.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct UdsPairs {
    list: Vec<UdsPair>,
    names: Vec<Option<Arc<str>>>,
    groups: Vec<CanId>,
}

impl UdsPairs {
    /// Collects the pairs of a bus.
    pub(in crate::session) fn new(pairs: Vec<UdsPair>) -> Self {
        let mut groups: Vec<CanId> = pairs.iter().filter_map(|pair| pair.functional).collect();
        groups.sort_unstable();
        groups.dedup();
        let names = pairs.iter().map(|pair| pair.name.as_deref().map(Into::into)).collect();
        Self { list: pairs, names, groups }
    }

    /// All identifiers, each with its link.
    pub(in crate::session) fn identifier_links(&self) -> impl Iterator<Item = (CanId, UdsLink)> {
        let number = |place: usize| u16::try_from(place).unwrap_or(u16::MAX);
        let pairs = self.list.iter().enumerate().flat_map(move |(place, pair)| {
            let link = |from_client| UdsLink::Named { pair: number(place), from_client };
            [(pair.request, link(true)), (pair.response, link(false))]
        });
        let groups = self.groups.iter().enumerate();
        pairs.chain(groups.map(move |(place, id)| (*id, UdsLink::Group(number(place)))))
    }

    /// Adds a pair; returns its identifiers with their links, the functional one last.
    pub(in crate::session) fn add_pair(&mut self, pair: UdsPair) -> Vec<(CanId, UdsLink)> {
        let number = |place: usize| u16::try_from(place).unwrap_or(u16::MAX);
        let place = number(self.list.len());
        let link = |from_client| UdsLink::Named { pair: place, from_client };
        let mut links = vec![(pair.request, link(true)), (pair.response, link(false))];
        if let Some(functional) = pair.functional {
            // An index in `groups` must not change, so that a new one is appended.
            let known = self.groups.iter().position(|group| *group == functional);
            let group = known.unwrap_or(self.groups.len());
            if known.is_none() {
                self.groups.push(functional);
            }
            links.push((functional, UdsLink::Group(number(group))));
        }
        self.names.push(pair.name.as_deref().map(Into::into));
        self.list.push(pair);
        links
    }

    /// All pairs: those of the bus file, then those that the traffic revealed.
    pub(in crate::session) fn all_pairs(&self) -> &[UdsPair] {
        &self.list
    }

    fn pair_at(&self, pair: u16) -> Option<&UdsPair> {
        self.list.get(usize::from(pair))
    }

    /// Whether an address byte precedes each payload.
    pub(in crate::session) fn has_address_byte(&self, link: UdsLink) -> bool {
        match link {
            UdsLink::Addressed { .. } => false,
            UdsLink::Named { pair, .. } => self.pair_at(pair).is_some_and(|pair| pair.extended_addressing),
            UdsLink::Group(group) => {
                let id = self.groups.get(usize::from(group)).copied();
                self.list.iter().any(|pair| pair.functional == id && pair.extended_addressing)
            }
        }
    }

    /// Whether a request on `functional` reaches the server that responds on `answer`.
    pub(in crate::session) fn reaches_server(&self, functional: UdsLink, answer: UdsLink) -> bool {
        match (functional, answer) {
            (
                UdsLink::Addressed { scheme, functional: true, source, .. },
                UdsLink::Addressed { scheme: other, functional: false, target, .. },
            ) => scheme == other && source == target,
            (UdsLink::Group(group), UdsLink::Named { pair, from_client: false }) => {
                let id = self.groups.get(usize::from(group));
                id.is_some() && self.pair_at(pair).and_then(|pair| pair.functional).as_ref() == id
            }
            _ => false,
        }
    }

    /// Sender and receiver of a link, for an event.
    pub(in crate::session) fn link_endpoints(&self, link: UdsLink) -> UdsEndpoints {
        let unknown =
            UdsEndpoints { source: None, target: None, functional: link.is_functional(), server: None };
        match link {
            UdsLink::Addressed { source, target, .. } => {
                UdsEndpoints { source: Some(source), target: Some(target), ..unknown }
            }
            UdsLink::Named { pair, .. } => {
                UdsEndpoints { server: self.names.get(usize::from(pair)).cloned().flatten(), ..unknown }
            }
            UdsLink::Group(_) => unknown,
        }
    }

    /// Link as text: `UDS request to ECU`.
    pub(in crate::session) fn link_text(&self, link: UdsLink) -> String {
        match link {
            UdsLink::Addressed { functional: true, source, target, .. } => {
                format!("ISO-TP {source:02X} to group {target:02X}")
            }
            UdsLink::Addressed { source, target, .. } => format!("ISO-TP {source:02X} to {target:02X}"),
            UdsLink::Named { pair, from_client } => {
                let name = self.names.get(usize::from(pair)).and_then(|name| name.as_deref());
                let what = if from_client { "UDS request" } else { "UDS response" };
                let word = if from_client { "to" } else { "of" };
                name.map_or_else(|| what.to_owned(), |name| format!("{what} {word} {name}"))
            }
            UdsLink::Group(_) => "UDS request to all".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(id: u32) -> UdsLink {
        UdsLink::link_of(CanId::from_extended(id)).unwrap()
    }

    #[test]
    fn priorities_do_not_count_and_answers_come_back() {
        assert_eq!(link(0x18DA_20F1), link(0x0CDA_20F1));
        assert_eq!(link(0x18DA_20F1).opposite_link(), link(0x18DA_F120));
        assert_eq!(link(0x1BC7_8820).opposite_link(), link(0x1BC1_00F1));
        assert_eq!(link(0x18DA_20F1).server_address(), Some(0x20));
        assert_eq!(link(0x18DB_33F1).server_address(), None);
        assert_eq!(UdsLink::link_of(CanId::from_standard(0x7E0)), None);
    }

    #[test]
    fn functional_requests_reach_servers() {
        let pair = |request, response, functional: Option<u16>| UdsPair {
            request: CanId::from_standard(request),
            response: CanId::from_standard(response),
            functional: functional.map(CanId::from_standard),
            name: None,
            extended_addressing: false,
        };
        let pairs = UdsPairs::new(vec![
            pair(0x7E0, 0x7E8, Some(0x7DF)),
            pair(0x7E1, 0x7E9, Some(0x7DF)),
            pair(0x7E2, 0x7EA, None),
        ]);
        let links: Vec<_> = pairs.identifier_links().collect();
        assert_eq!(links.len(), 7);
        let all = UdsLink::Group(0);
        let answer = |pair| UdsLink::Named { pair, from_client: false };
        assert!(pairs.reaches_server(all, answer(0)) && pairs.reaches_server(all, answer(1)));
        assert!(!pairs.reaches_server(all, answer(2)));
        assert!(pairs.reaches_server(link(0x18DB_33F1), link(0x18DA_F120)));
        assert!(!pairs.reaches_server(link(0x18DB_33F1), link(0x18DA_F220)));
    }
}
