//! Detection of CANopen on a bus.
//!
//! Confirmed by evidence: a valid heartbeat or guarding response, an NMT command, or an SDO request with a
//! response for the same object. Rejected by contradiction: identifier 0 with a length other than 2 bytes,
//! 0x700 + n other than 1 byte, or many frames on PDO and EMCY identifiers without evidence. The traffic of
//! a car must be rejected; a short capture of a machine between two heartbeats must not.

use crate::session::options::ProtocolChoice;
use crate::words::count_noun;

/// Frames on PDO and EMCY identifiers without evidence after which CANopen is rejected.
const UNSUPPORTED_LIMIT: u32 = 1_000;

/// The same for a slow bus: number of frames, and min duration in ns (several heartbeats).
const UNSUPPORTED_SLOW: (u32, i64) = (50, 5_000_000_000);

/// Number of SYNCs that prevent a rejection: a bus may have only SYNC and PDOs.
const ENOUGH_SYNCS: u32 = 10;

/// Node-IDs on PDO and EMCY identifiers without evidence after which CANopen is rejected. A network of that
/// many nodes would have shown a heartbeat; a car uses identifiers from the whole range.
const UNSUPPORTED_NODES: u32 = 20;

/// Contradictions after which CANopen is rejected.
const CONTRADICTION_LIMIT: u32 = 3;

/// Frames on SDO identifiers with other content after which CANopen is rejected, without evidence.
const FOREIGN_SDO_LIMIT: u32 = 3;

/// Result of the detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum ProtocolStatus {
    /// Evidence was found, or the user chose the protocol.
    Confirmed,
    /// Neither evidence nor contradiction yet: events are marked as presumed.
    Presumed,
    /// The protocol is not used: frames are not decoded.
    Rejected,
}

/// State of the detection: evidence and contradictions so far.
#[derive(Debug, Clone)]
pub(in crate::session) struct CanopenDetection {
    choice: ProtocolChoice,
    status: ProtocolStatus,
    /// Messages were decoded as CANopen without evidence.
    has_presumed: bool,
    evidence: u32,
    contradictions: u32,
    /// Frames on SDO identifiers with other content.
    foreign_sdo: u32,
    unsupported: u32,
    unsupported_nodes: u128,
    /// Monotonic time of the first and the last frame counted in `unsupported`.
    unsupported_since: Option<i64>,
    unsupported_until: i64,
    syncs: u32,
    /// Node and multiplexer of the last SDO request.
    request: Option<(u8, [u8; 3])>,
}

impl CanopenDetection {
    pub(in crate::session) fn new(choice: ProtocolChoice) -> Self {
        let status = match choice {
            ProtocolChoice::Auto | ProtocolChoice::J1939 => ProtocolStatus::Presumed,
            ProtocolChoice::Canopen => ProtocolStatus::Confirmed,
            ProtocolChoice::None => ProtocolStatus::Rejected,
        };
        Self {
            choice,
            status,
            has_presumed: false,
            evidence: 0,
            contradictions: 0,
            foreign_sdo: 0,
            unsupported: 0,
            unsupported_nodes: 0,
            unsupported_since: None,
            unsupported_until: 0,
            syncs: 0,
            request: None,
        }
    }

    #[inline]
    pub(in crate::session) fn protocol_status(&self) -> ProtocolStatus {
        self.status
    }

    #[inline]
    pub(in crate::session) fn is_confirmed(&self) -> bool {
        self.status == ProtocolStatus::Confirmed
    }

    /// Notes a message that is decoded as CANopen without evidence.
    #[inline]
    pub(in crate::session) fn note_presumed(&mut self) {
        self.has_presumed = true;
    }

    /// Whether messages were decoded as CANopen, and there is neither evidence nor contradiction.
    pub(in crate::session) fn is_presumed(&self) -> bool {
        self.has_presumed && self.status == ProtocolStatus::Presumed
    }

    /// Counts a message that only CANopen uses.
    pub(in crate::session) fn add_evidence(&mut self) {
        self.evidence = self.evidence.saturating_add(1);
        self.judge_evidence();
    }

    /// Counts a SYNC, empty or with a counter: no evidence, but it can prevent a rejection.
    pub(in crate::session) fn count_sync(&mut self) {
        self.syncs = self.syncs.saturating_add(1);
    }

    /// Counts a message that CANopen never uses.
    pub(in crate::session) fn add_contradiction(&mut self) {
        self.contradictions = self.contradictions.saturating_add(1);
        self.judge_evidence();
    }

    /// Counts a frame on a PDO, EMCY or SDO identifier of a node at monotonic time `now`; not evidence.
    pub(in crate::session) fn count_unsupported(&mut self, node: u8, now: i64) {
        if self.status == ProtocolStatus::Presumed {
            self.unsupported += 1;
            self.unsupported_since.get_or_insert(now);
            self.unsupported_until = now;
            self.unsupported_nodes |= 1 << (node & 0x7F);
            if self.is_unsupported() {
                self.judge_evidence();
            }
        }
    }

    fn is_unsupported(&self) -> bool {
        let elapsed = self.unsupported_until.saturating_sub(self.unsupported_since.unwrap_or(i64::MAX));
        let (few, long) = UNSUPPORTED_SLOW;
        let many = self.unsupported >= UNSUPPORTED_LIMIT
            || self.unsupported_nodes.count_ones() >= UNSUPPORTED_NODES
            || (self.unsupported >= few && elapsed >= long);
        many && self.syncs < ENOUGH_SYNCS
    }

    /// Counts a frame on an SDO identifier that is no SDO message; it counts only until there is evidence, because a capture
    /// may start within a transfer.
    pub(in crate::session) fn add_foreign_sdo(&mut self) {
        self.foreign_sdo = self.foreign_sdo.saturating_add(1);
        self.judge_evidence();
    }

    /// Stores an SDO request for comparison with its response.
    pub(in crate::session) fn note_request(&mut self, node: u8, data: &[u8]) {
        if !self.is_confirmed() {
            self.request = parse_multiplexer(data).map(|multiplexer| (node, multiplexer));
        }
    }

    /// Compares an SDO response with the last request; a match is evidence.
    pub(in crate::session) fn note_response(&mut self, node: u8, data: &[u8]) {
        if self.is_confirmed() || self.request.is_none() {
            return;
        }
        if parse_multiplexer(data).map(|multiplexer| (node, multiplexer)) == self.request {
            self.request = None;
            self.add_evidence();
        }
    }

    /// Reason for the rejection, as text.
    pub(in crate::session) fn rejection_reason(&self) -> String {
        if self.contradictions >= CONTRADICTION_LIMIT {
            let count = self.contradictions;
            format!(
                "{} with wrong length (identifier 000 without 2 bytes, or 701 to 77F without 1 byte)",
                count_noun(count, "frame")
            )
        } else {
            if self.foreign_sdo >= FOREIGN_SDO_LIMIT {
                let frames = count_noun(u64::from(self.foreign_sdo), "frame");
                return format!(
                    "no heartbeat, NMT command or SDO response, but {frames} on SDO identifiers without a command of SDO"
                );
            }
            let (frames, nodes) = (self.unsupported, self.unsupported_nodes.count_ones());
            format!(
                "no heartbeat, NMT command or SDO response, but {} on PDO and EMCY identifiers of {}",
                count_noun(frames, "frame"),
                count_noun(nodes, "node-ID")
            )
        }
    }

    fn judge_evidence(&mut self) {
        if !matches!(self.choice, ProtocolChoice::Auto | ProtocolChoice::J1939) {
            return;
        }
        let contradicted =
            self.contradictions >= CONTRADICTION_LIMIT && self.contradictions > self.evidence / 4;
        self.status = if contradicted {
            ProtocolStatus::Rejected
        } else if self.evidence > 0 {
            ProtocolStatus::Confirmed
        } else if self.is_unsupported() || self.foreign_sdo >= FOREIGN_SDO_LIMIT {
            ProtocolStatus::Rejected
        } else {
            ProtocolStatus::Presumed
        };
    }
}

/// Index and sub-index of an SDO message.
fn parse_multiplexer(data: &[u8]) -> Option<[u8; 3]> {
    match data {
        [_, low, high, sub, ..] => Some([*low, *high, *sub]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_heartbeat_is_enough_and_contradictions_outweigh_it() {
        let mut detection = CanopenDetection::new(ProtocolChoice::Auto);
        assert_eq!(detection.protocol_status(), ProtocolStatus::Presumed);
        detection.add_evidence();
        assert_eq!(detection.protocol_status(), ProtocolStatus::Confirmed);
        (0..3).for_each(|_| detection.add_contradiction());
        assert_eq!(detection.protocol_status(), ProtocolStatus::Rejected);
        (0..20).for_each(|_| detection.add_evidence());
        assert_eq!(detection.protocol_status(), ProtocolStatus::Confirmed);
    }

    #[test]
    fn pdo_identifiers_alone_are_doubted_until_evidence_comes() {
        let mut detection = CanopenDetection::new(ProtocolChoice::Auto);
        (0..UNSUPPORTED_LIMIT).for_each(|_| detection.count_unsupported(5, 0));
        assert_eq!(detection.protocol_status(), ProtocolStatus::Rejected);
        detection.note_request(5, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
        detection.note_response(5, &[0x43, 0x18, 0x10, 1, 1, 2, 3, 4]);
        assert_eq!(detection.protocol_status(), ProtocolStatus::Confirmed);
    }

    #[test]
    fn many_nodes_without_evidence_are_doubted_soon() {
        let mut detection = CanopenDetection::new(ProtocolChoice::Auto);
        (1..20).for_each(|node| detection.count_unsupported(node, 0));
        assert_eq!(detection.protocol_status(), ProtocolStatus::Presumed);
        detection.count_unsupported(20, 0);
        assert_eq!(detection.protocol_status(), ProtocolStatus::Rejected);
    }

    #[test]
    fn a_slow_bus_is_doubted_after_several_heartbeats_unless_it_has_a_sync() {
        for (syncs, status) in [(0, ProtocolStatus::Rejected), (10, ProtocolStatus::Presumed)] {
            let mut detection = CanopenDetection::new(ProtocolChoice::Auto);
            (0..syncs).for_each(|_| detection.count_sync());
            (0..=50).for_each(|count| detection.count_unsupported(5, count * 100_000_000));
            assert_eq!(detection.protocol_status(), status);
        }
    }

    #[test]
    fn frames_that_are_no_sdo_are_evidence_against_canopen_until_there_is_evidence() {
        for count in 0..FOREIGN_SDO_LIMIT + 2 {
            let mut detection = CanopenDetection::new(ProtocolChoice::Auto);
            (0..count).for_each(|_| detection.add_foreign_sdo());
            let is_rejected = detection.protocol_status() == ProtocolStatus::Rejected;
            assert_eq!(is_rejected, count >= FOREIGN_SDO_LIMIT, "{count}");
            // A capture that starts within a block transfer is CANopen as soon as a heartbeat follows.
            detection.add_evidence();
            (0..count).for_each(|_| detection.add_foreign_sdo());
            assert!(detection.is_confirmed());
        }
    }

    #[test]
    fn the_user_has_the_last_word() {
        let mut detection = CanopenDetection::new(ProtocolChoice::Canopen);
        (0..100).for_each(|_| detection.add_contradiction());
        assert_eq!(detection.protocol_status(), ProtocolStatus::Confirmed);
        let mut detection = CanopenDetection::new(ProtocolChoice::None);
        detection.add_evidence();
        assert_eq!(detection.protocol_status(), ProtocolStatus::Rejected);
    }
}
