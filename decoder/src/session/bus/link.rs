//! ISO-TP links: one direction between two addresses. The frames of a link form its messages.
//!
//! Identifiers that differ only in priority belong to one link. Flow control and responses use the link
//! [`Link::back`].

use std::sync::Arc;

use crate::bus_file::UdsPair;
use crate::event::Endpoints;
use crate::frame::CanId;
use crate::wire::isotp::{Addresses, Scheme};

/// Sender and receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(in crate::session) enum Link {
    /// Addresses in the identifier.
    Addressed { scheme: Scheme, functional: bool, source: u16, target: u16 },
    /// Identifiers of a pair in the bus file.
    Named { pair: u16, from_client: bool },
    /// Functional identifier in the bus file: an index in [`Pairs::groups`].
    Group(u16),
}

impl Link {
    /// Link defined by the addresses in a 29-bit identifier.
    pub(in crate::session) fn of(id: CanId) -> Option<Self> {
        let CanId::Extended(id) = id else { return None };
        let Addresses { scheme, functional, source, target, .. } = Addresses::of(id)?;
        Some(Self::Addressed { scheme, functional, source, target })
    }

    /// Link of the opposite direction.
    pub(in crate::session) const fn back(self) -> Self {
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
        matches!(self, Self::Addressed { scheme: Scheme::Net, .. })
    }

    /// Address of the receiver; `None` for a group or another net.
    pub(in crate::session) fn server(self) -> Option<u8> {
        match self {
            Self::Addressed { functional: false, target, .. } => u8::try_from(target).ok(),
            _ => None,
        }
    }
}

/// Pairs of UDS identifiers in the bus file.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Pairs {
    list: Vec<UdsPair>,
    names: Vec<Option<Arc<str>>>,
    groups: Vec<CanId>,
}

impl Pairs {
    /// Collects the pairs of a bus.
    pub(in crate::session) fn new(pairs: Vec<UdsPair>) -> Self {
        let mut groups: Vec<CanId> = pairs.iter().filter_map(|pair| pair.functional).collect();
        groups.sort_unstable();
        groups.dedup();
        let names = pairs.iter().map(|pair| pair.name.as_deref().map(Into::into)).collect();
        Self { list: pairs, names, groups }
    }

    /// All identifiers, each with its link.
    pub(in crate::session) fn links(&self) -> impl Iterator<Item = (CanId, Link)> {
        let number = |place: usize| u16::try_from(place).unwrap_or(u16::MAX);
        let pairs = self.list.iter().enumerate().flat_map(move |(place, pair)| {
            let link = |from_client| Link::Named { pair: number(place), from_client };
            [(pair.request, link(true)), (pair.response, link(false))]
        });
        let groups = self.groups.iter().enumerate();
        pairs.chain(groups.map(move |(place, id)| (*id, Link::Group(number(place)))))
    }

    /// Adds a pair; returns its identifiers with their links, the functional one last.
    pub(in crate::session) fn add(&mut self, pair: UdsPair) -> Vec<(CanId, Link)> {
        let number = |place: usize| u16::try_from(place).unwrap_or(u16::MAX);
        let place = number(self.list.len());
        let link = |from_client| Link::Named { pair: place, from_client };
        let mut links = vec![(pair.request, link(true)), (pair.response, link(false))];
        if let Some(functional) = pair.functional {
            // An index in `groups` must not change, so that a new one is appended.
            let known = self.groups.iter().position(|group| *group == functional);
            let group = known.unwrap_or(self.groups.len());
            if known.is_none() {
                self.groups.push(functional);
            }
            links.push((functional, Link::Group(number(group))));
        }
        self.names.push(pair.name.as_deref().map(Into::into));
        self.list.push(pair);
        links
    }

    /// All pairs: those of the bus file, then those that the traffic revealed.
    pub(in crate::session) fn list(&self) -> &[UdsPair] {
        &self.list
    }

    fn pair(&self, pair: u16) -> Option<&UdsPair> {
        self.list.get(usize::from(pair))
    }

    /// Whether an address byte precedes each payload.
    pub(in crate::session) fn has_address_byte(&self, link: Link) -> bool {
        match link {
            Link::Addressed { .. } => false,
            Link::Named { pair, .. } => self.pair(pair).is_some_and(|pair| pair.extended_addressing),
            Link::Group(group) => {
                let id = self.groups.get(usize::from(group)).copied();
                self.list.iter().any(|pair| pair.functional == id && pair.extended_addressing)
            }
        }
    }

    /// Whether a request on `functional` reaches the server that responds on `answer`.
    pub(in crate::session) fn reaches(&self, functional: Link, answer: Link) -> bool {
        match (functional, answer) {
            (
                Link::Addressed { scheme, functional: true, source, .. },
                Link::Addressed { scheme: other, functional: false, target, .. },
            ) => scheme == other && source == target,
            (Link::Group(group), Link::Named { pair, from_client: false }) => {
                let id = self.groups.get(usize::from(group));
                id.is_some() && self.pair(pair).and_then(|pair| pair.functional).as_ref() == id
            }
            _ => false,
        }
    }

    /// Sender and receiver of a link, for an event.
    pub(in crate::session) fn ends(&self, link: Link) -> Endpoints {
        let unknown =
            Endpoints { source: None, target: None, functional: link.is_functional(), server: None };
        match link {
            Link::Addressed { source, target, .. } => {
                Endpoints { source: Some(source), target: Some(target), ..unknown }
            }
            Link::Named { pair, .. } => {
                Endpoints { server: self.names.get(usize::from(pair)).cloned().flatten(), ..unknown }
            }
            Link::Group(_) => unknown,
        }
    }

    /// Link as text: `UDS request to ECU`.
    pub(in crate::session) fn describe(&self, link: Link) -> String {
        match link {
            Link::Addressed { functional: true, source, target, .. } => {
                format!("ISO-TP {source:02X} to group {target:02X}")
            }
            Link::Addressed { source, target, .. } => format!("ISO-TP {source:02X} to {target:02X}"),
            Link::Named { pair, from_client } => {
                let name = self.names.get(usize::from(pair)).and_then(|name| name.as_deref());
                let what = if from_client { "UDS request" } else { "UDS response" };
                let word = if from_client { "to" } else { "of" };
                name.map_or_else(|| what.to_owned(), |name| format!("{what} {word} {name}"))
            }
            Link::Group(_) => "UDS request to all".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(id: u32) -> Link {
        Link::of(CanId::extended(id)).unwrap()
    }

    #[test]
    fn priorities_do_not_count_and_answers_come_back() {
        assert_eq!(link(0x18DA_20F1), link(0x0CDA_20F1));
        assert_eq!(link(0x18DA_20F1).back(), link(0x18DA_F120));
        assert_eq!(link(0x1BC7_8820).back(), link(0x1BC1_00F1));
        assert_eq!(link(0x18DA_20F1).server(), Some(0x20));
        assert_eq!(link(0x18DB_33F1).server(), None);
        assert_eq!(Link::of(CanId::standard(0x7E0)), None);
    }

    #[test]
    fn functional_requests_reach_servers() {
        let pair = |request, response, functional: Option<u16>| UdsPair {
            request: CanId::standard(request),
            response: CanId::standard(response),
            functional: functional.map(CanId::standard),
            name: None,
            extended_addressing: false,
        };
        let pairs = Pairs::new(vec![
            pair(0x7E0, 0x7E8, Some(0x7DF)),
            pair(0x7E1, 0x7E9, Some(0x7DF)),
            pair(0x7E2, 0x7EA, None),
        ]);
        let links: Vec<_> = pairs.links().collect();
        assert_eq!(links.len(), 7);
        let all = Link::Group(0);
        let answer = |pair| Link::Named { pair, from_client: false };
        assert!(pairs.reaches(all, answer(0)) && pairs.reaches(all, answer(1)));
        assert!(!pairs.reaches(all, answer(2)));
        assert!(pairs.reaches(link(0x18DB_33F1), link(0x18DA_F120)));
        assert!(!pairs.reaches(link(0x18DB_33F1), link(0x18DA_F220)));
    }
}
