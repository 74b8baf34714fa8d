//! Whether the 29-bit frames of a bus are J1939 at all.
//!
//! Confirmed on evidence: an address claim, a request, an announced transfer, diagnostics, each as its
//! standard shapes it. Rejected when such messages have another shape, or when more addresses send than a
//! bus of devices has before any evidence was seen.

use crate::session::options::ProtocolChoice;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Misshapen messages before they count.
const CONTRADICTION_LIMIT: u32 = 3;

/// Source addresses without evidence: a network of so many devices shows a request or a fault sooner.
const UNSUPPORTED_SOURCES: u32 = 48;

/// How far the 29-bit frames are believed to be J1939.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum J1939Status {
    Confirmed,
    Presumed,
    Rejected,
}

/// Evidence and contradictions so far.
#[derive(Debug, Clone)]
pub(in crate::session) struct J1939Detection {
    status: J1939Status,
    evidence: u32,
    contradictions: u32,
    sources: [u64; 4],
    is_reported: bool,
}

impl J1939Detection {
    pub(in crate::session) fn new(choice: ProtocolChoice) -> Self {
        let status = match choice {
            ProtocolChoice::Auto | ProtocolChoice::Canopen => J1939Status::Presumed,
            ProtocolChoice::J1939 => J1939Status::Confirmed,
            ProtocolChoice::None => J1939Status::Rejected,
        };
        // A choice of the user needs no word about it.
        let is_reported = choice == ProtocolChoice::None;
        Self { status, evidence: 0, contradictions: 0, sources: [0; 4], is_reported }
    }

    #[inline]
    pub(in crate::session) fn is_confirmed(&self) -> bool {
        self.status == J1939Status::Confirmed
    }

    pub(in crate::session) fn is_rejected(&self) -> bool {
        self.status == J1939Status::Rejected
    }

    /// The user, or a device, says that there is one.
    pub(in crate::session) fn add_evidence(&mut self) {
        if !(self.is_reported && self.is_rejected()) {
            self.evidence = self.evidence.saturating_add(1);
            self.status = J1939Status::Confirmed;
        }
    }

    /// Takes a frame for or against it; only called until there is evidence.
    pub(in crate::session) fn weigh(&mut self, id: J1939Id, data: &[u8], is_plain: bool) {
        if self.is_reported && self.status == J1939Status::Rejected {
            return;
        }
        match evidence(id, data) {
            _ if !is_plain => {}
            Some(true) => self.evidence = self.evidence.saturating_add(1),
            Some(false) => self.contradictions = self.contradictions.saturating_add(1),
            None => {}
        }
        if let Some(word) = self.sources.get_mut(usize::from(id.source >> 6)) {
            *word |= 1 << (id.source & 63);
        }
        let sources: u32 = self.sources.iter().map(|word| word.count_ones()).sum();
        self.status = if self.contradictions >= CONTRADICTION_LIMIT && self.contradictions > self.evidence {
            J1939Status::Rejected
        } else if self.evidence > 0 && self.contradictions == 0 {
            J1939Status::Confirmed
        } else if sources >= UNSUPPORTED_SOURCES {
            J1939Status::Rejected
        } else {
            self.status
        };
    }

    /// Why it is not believed, once.
    pub(in crate::session) fn take_reason(&mut self) -> Option<String> {
        if !self.is_rejected() || std::mem::replace(&mut self.is_reported, true) {
            return None;
        }
        Some(if self.contradictions >= CONTRADICTION_LIMIT {
            format!("{} messages of its management have another shape", self.contradictions)
        } else {
            format!("no claim, request or fault beside frames of {UNSUPPORTED_SOURCES} addresses")
        })
    }
}

/// Whether a message of the protocol's own groups has the shape it must have; `None` for other groups.
fn evidence(id: J1939Id, data: &[u8]) -> Option<bool> {
    Some(match id.pgn {
        Pgn::REQUEST => data.len() == 3,
        Pgn::ADDRESS_CLAIMED => data.len() == 8 && id.destination == ALL,
        Pgn::ACKNOWLEDGEMENT => data.len() == 8 && data.first().is_some_and(|control| *control <= 3),
        // Bytes 5 of RTS and BAM aside, all controls of TP.CM are few.
        Pgn::TP_CM => matches!(data, [16 | 17 | 19 | 32 | 255, _, _, _, _, _, _, _]),
        Pgn::ETP_CM => matches!(data, [20..=23 | 255, _, _, _, _, _, _, _]),
        Pgn::TP_DT | Pgn::DM1 => data.len() == 8,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighed(frames: &[(u32, &[u8])]) -> J1939Detection {
        let mut belief = J1939Detection::new(ProtocolChoice::Auto);
        for (id, data) in frames {
            belief.weigh(J1939Id::of(*id).unwrap(), data, true);
        }
        belief
    }

    #[test]
    fn a_request_is_enough_where_nothing_contradicts() {
        assert!(!weighed(&[(0x0CF0_0400, &[0; 8])]).is_confirmed());
        assert!(weighed(&[(0x0CF0_0400, &[0; 8]), (0x18EA_FFF9, &[0xEB, 0xFE, 0])]).is_confirmed());
        let mixed = weighed(&[(0x18EA_FFF9, &[0xEB]), (0x18EA_FFF9, &[0xEB, 0xFE, 0])]);
        assert!(!mixed.is_confirmed() && !mixed.is_rejected());
    }

    #[test]
    fn another_shape_contradicts() {
        let mut belief = weighed(&[(0x18EA_FFF9, &[1]), (0x18EE_FF00, &[1; 3]), (0x1CEC_FF00, &[99; 8])]);
        assert!(belief.is_rejected());
        assert!(belief.take_reason().is_some() && belief.take_reason().is_none(), "is_reported once");
    }

    #[test]
    fn too_many_addresses_without_evidence_are_no_network() {
        let frames: Vec<(u32, &[u8])> =
            (0..48).map(|source| (0x18FF_0000 + source, &[0_u8; 8][..])).collect();
        assert!(weighed(&frames).is_rejected());
        assert!(!weighed(&frames[..47]).is_rejected());
    }
}
