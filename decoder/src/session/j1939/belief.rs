//! Whether the 29-bit frames of a bus are J1939 at all.
//!
//! Believed on evidence: an address claim, a request, an announced transfer, diagnostics, each as its
//! standard shapes it. Doubted when such messages have another shape, or when more addresses send than a
//! bus of devices has before any evidence was seen.

use crate::session::ProtocolChoice;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Misshapen messages before they count.
const CONTRADICTION_LIMIT: u32 = 3;

/// Source addresses without evidence: a network of so many devices shows a request or a fault sooner.
const UNSUPPORTED_SOURCES: u32 = 48;

/// How far the 29-bit frames are believed to be J1939.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standing {
    Believed,
    Presumed,
    Doubted,
}

/// Evidence and contradictions so far.
#[derive(Debug, Clone)]
pub(in crate::session) struct J1939Belief {
    standing: Standing,
    evidence: u32,
    contradictions: u32,
    sources: [u64; 4],
    said: bool,
}

impl J1939Belief {
    pub(in crate::session) fn new(choice: ProtocolChoice) -> Self {
        let standing = match choice {
            ProtocolChoice::Auto | ProtocolChoice::Canopen => Standing::Presumed,
            ProtocolChoice::J1939 => Standing::Believed,
            ProtocolChoice::None => Standing::Doubted,
        };
        // A choice of the user needs no word about it.
        let said = choice == ProtocolChoice::None;
        Self { standing, evidence: 0, contradictions: 0, sources: [0; 4], said }
    }

    #[inline]
    pub(in crate::session) fn is_believed(&self) -> bool {
        self.standing == Standing::Believed
    }

    pub(in crate::session) fn is_doubted(&self) -> bool {
        self.standing == Standing::Doubted
    }

    /// The user, or a device, says that there is one.
    pub(in crate::session) fn support(&mut self) {
        if !(self.said && self.is_doubted()) {
            self.evidence = self.evidence.saturating_add(1);
            self.standing = Standing::Believed;
        }
    }

    /// Takes a frame for or against it; only called until there is evidence.
    pub(super) fn weigh(&mut self, id: J1939Id, data: &[u8], is_plain: bool) {
        if self.said && self.standing == Standing::Doubted {
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
        self.standing = if self.contradictions >= CONTRADICTION_LIMIT && self.contradictions > self.evidence {
            Standing::Doubted
        } else if self.evidence > 0 && self.contradictions == 0 {
            Standing::Believed
        } else if sources >= UNSUPPORTED_SOURCES {
            Standing::Doubted
        } else {
            self.standing
        };
    }

    /// Why it is not believed, once.
    pub(super) fn take_reason(&mut self) -> Option<String> {
        if !self.is_doubted() || std::mem::replace(&mut self.said, true) {
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

    fn weighed(frames: &[(u32, &[u8])]) -> J1939Belief {
        let mut belief = J1939Belief::new(ProtocolChoice::Auto);
        for (id, data) in frames {
            belief.weigh(J1939Id::of(*id).unwrap(), data, true);
        }
        belief
    }

    #[test]
    fn a_request_is_enough_where_nothing_contradicts() {
        assert!(!weighed(&[(0x0CF0_0400, &[0; 8])]).is_believed());
        assert!(weighed(&[(0x0CF0_0400, &[0; 8]), (0x18EA_FFF9, &[0xEB, 0xFE, 0])]).is_believed());
        let mixed = weighed(&[(0x18EA_FFF9, &[0xEB]), (0x18EA_FFF9, &[0xEB, 0xFE, 0])]);
        assert!(!mixed.is_believed() && !mixed.is_doubted());
    }

    #[test]
    fn another_shape_contradicts() {
        let mut belief = weighed(&[(0x18EA_FFF9, &[1]), (0x18EE_FF00, &[1; 3]), (0x1CEC_FF00, &[99; 8])]);
        assert!(belief.is_doubted());
        assert!(belief.take_reason().is_some() && belief.take_reason().is_none(), "said once");
    }

    #[test]
    fn too_many_addresses_without_evidence_are_no_network() {
        let frames: Vec<(u32, &[u8])> =
            (0..48).map(|source| (0x18FF_0000 + source, &[0_u8; 8][..])).collect();
        assert!(weighed(&frames).is_doubted());
        assert!(!weighed(&frames[..47]).is_doubted());
    }
}
