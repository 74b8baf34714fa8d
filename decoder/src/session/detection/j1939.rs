//! Detection of J1939 in the 29-bit frames of a bus.
//!
//! Confirmed by evidence: an address claim, a request, an announced transfer or diagnostics with the format
//! of the standard; otherwise by steady groups with a public definition from several addresses. Rejected if
//! such messages have another format, or if too many addresses send before any evidence.

use super::public_groups::PublicGroups;
use crate::session::options::ProtocolChoice;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Messages with a wrong format after which J1939 is rejected.
const CONTRADICTION_LIMIT: u32 = 3;

/// Source addresses without evidence after which J1939 is rejected: so many devices would have sent a request
/// or a fault.
const UNSUPPORTED_SOURCES: u32 = 48;

/// Result of the detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum J1939Status {
    Confirmed,
    Presumed,
    Rejected,
}

/// State of the detection: evidence and contradictions so far.
#[derive(Debug, Clone)]
pub(in crate::session) struct J1939Detection {
    status: J1939Status,
    evidence: u32,
    contradictions: u32,
    sources: [u64; 4],
    groups: PublicGroups,
    is_reported: bool,
}

impl J1939Detection {
    pub(in crate::session) fn new(choice: ProtocolChoice) -> Self {
        let status = match choice {
            ProtocolChoice::Auto | ProtocolChoice::Canopen => J1939Status::Presumed,
            ProtocolChoice::J1939 => J1939Status::Confirmed,
            ProtocolChoice::None => J1939Status::Rejected,
        };
        // No note is needed for the user's own choice.
        let is_reported = choice == ProtocolChoice::None;
        Self {
            status,
            evidence: 0,
            contradictions: 0,
            sources: [0; 4],
            groups: PublicGroups::default(),
            is_reported,
        }
    }

    #[inline]
    pub(in crate::session) fn is_confirmed(&self) -> bool {
        self.status == J1939Status::Confirmed
    }

    pub(in crate::session) fn is_rejected(&self) -> bool {
        self.status == J1939Status::Rejected
    }

    /// Confirms J1939 by an assignment of the user, or by a detected device.
    pub(in crate::session) fn add_evidence(&mut self) {
        if !(self.is_reported && self.is_rejected()) {
            self.evidence = self.evidence.saturating_add(1);
            self.status = J1939Status::Confirmed;
        }
    }

    /// Whether messages of a group can prove or contradict J1939.
    pub(in crate::session) fn is_evidence(&self, id: J1939Id) -> bool {
        !self.is_confirmed() && (group_evidence(id, &[]).is_some() || id.pgn == Pgn::ADDRESS_CLAIMED)
    }

    /// Evaluates a frame as evidence or contradiction; called only until J1939 is confirmed.
    pub(in crate::session) fn weigh_frame(&mut self, id: J1939Id, data: &[u8], is_plain: bool) {
        if self.is_reported && self.status == J1939Status::Rejected {
            return;
        }
        match group_evidence(id, data) {
            _ if !is_plain => {}
            Some(true) => self.evidence = self.evidence.saturating_add(1),
            Some(false) => self.contradictions = self.contradictions.saturating_add(1),
            None => {}
        }
        if let Some(word) = self.sources.get_mut(usize::from(id.source >> 6)) {
            *word |= 1 << (id.source & 63);
        }
        if is_plain {
            self.groups.count_frame(id);
        }
        let sources: u32 = self.sources.iter().map(|word| word.count_ones()).sum();
        self.status = if self.contradictions >= CONTRADICTION_LIMIT && self.contradictions > self.evidence {
            J1939Status::Rejected
        } else if self.contradictions == 0 && (self.evidence > 0 || self.groups.are_evidence()) {
            J1939Status::Confirmed
        } else if sources >= UNSUPPORTED_SOURCES {
            J1939Status::Rejected
        } else {
            self.status
        };
    }

    /// Reason for the rejection, as text; returned only once.
    pub(in crate::session) fn take_reason(&mut self) -> Option<String> {
        if !self.is_rejected() || std::mem::replace(&mut self.is_reported, true) {
            return None;
        }
        self.rejection_reason()
    }

    /// Reason for the rejection, as text; `None` if not rejected.
    pub(in crate::session) fn rejection_reason(&self) -> Option<String> {
        self.is_rejected().then(|| {
            if self.contradictions >= CONTRADICTION_LIMIT {
                format!("{} network management messages with wrong format", self.contradictions)
            } else {
                format!("no address claim, request or fault, but frames from {UNSUPPORTED_SOURCES} addresses")
            }
        })
    }
}

/// Whether a message of a protocol group has the required format; `None` for other groups.
fn group_evidence(id: J1939Id, data: &[u8]) -> Option<bool> {
    Some(match id.pgn {
        Pgn::REQUEST => data.len() == 3,
        // Some devices repeat their claim to one address; J1939-81 §4.2.2 requires all addresses.
        Pgn::ADDRESS_CLAIMED if data.len() == 8 && id.destination != ALL => return None,
        Pgn::ACKNOWLEDGEMENT => data.len() == 8 && data.first().is_some_and(|control| *control <= 3),
        // TP.CM defines only these few control bytes.
        Pgn::TP_CM => matches!(data, [16 | 17 | 19 | 32 | 255, _, _, _, _, _, _, _]),
        Pgn::ETP_CM => matches!(data, [20..=23 | 255, _, _, _, _, _, _, _]),
        Pgn::ADDRESS_CLAIMED | Pgn::TP_DT | Pgn::DM1 => data.len() == 8,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighed(frames: &[(u32, &[u8])]) -> J1939Detection {
        let mut belief = J1939Detection::new(ProtocolChoice::Auto);
        for (id, data) in frames {
            belief.weigh_frame(J1939Id::from_identifier(*id).unwrap(), data, true);
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
    fn a_claim_to_one_address_neither_proves_nor_contradicts() {
        let name: &[u8] = &[1, 0, 0x20, 0, 0, 0x82, 0, 0xA0];
        let to_one = [(0x18EE_2180, name); 5];
        let detection = weighed(&to_one);
        assert!(!detection.is_confirmed() && !detection.is_rejected());
        let both = [&to_one[..], &[(0x18EE_FF80, name)], &to_one[..]].concat();
        assert!(weighed(&both).is_confirmed());
        // With another length, it contradicts like a claim to all.
        assert!(weighed(&[(0x18EE_2180, &name[..7]); 3]).is_rejected());
    }

    #[test]
    fn steady_public_groups_confirm_unless_a_message_contradicts() {
        // EEC1, ET1 and CCVS1 (61444, 65262, 65265) of 00, VDC1 (65103) of 0B.
        let ids = [0x0CF0_0400, 0x18FE_EE00, 0x18FE_F100, 0x18FE_4F0B];
        let frames: Vec<(u32, &[u8])> = (0..12).map(|number| (ids[number % 4], &[0_u8; 8][..])).collect();
        assert!(weighed(&frames).is_confirmed());
        let wrong: &[u8] = &[1];
        assert!(!weighed(&[&[(0x18EA_FFF9, wrong)], &frames[..]].concat()).is_confirmed());
    }

    #[test]
    fn another_shape_contradicts() {
        let mut belief = weighed(&[(0x18EA_FFF9, &[1]), (0x18EE_FF00, &[1; 3]), (0x1CEC_FF00, &[99; 8])]);
        assert!(belief.is_rejected());
        assert!(belief.take_reason().is_some() && belief.take_reason().is_none(), "reported once");
    }

    #[test]
    fn too_many_addresses_without_evidence_are_no_network() {
        let frames: Vec<(u32, &[u8])> =
            (0..48).map(|source| (0x18FF_0000 + source, &[0_u8; 8][..])).collect();
        assert!(weighed(&frames).is_rejected());
        assert!(!weighed(&frames[..47]).is_rejected());
    }
}
