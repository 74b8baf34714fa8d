//! Which protocols a bus uses, by evidence from the traffic and by the user.

use super::named::NamedNodes;
use super::omissions::OmittedFrames;
use crate::profile::is_fast_packet;
use crate::session::bus::identifiers::{IdentifierService, SdoChannels};
use crate::session::bus::nodes::Node;
use crate::session::detection::{CanopenDetection, J1939Detection, ProtocolStatus};
use crate::session::options::ProtocolChoice;
use crate::standard_tables::{RvCEvidence, Standard, is_fast_group};
use crate::wire::NodeId;
use crate::wire::j1939::Pgn;

/// Protocols of one bus.
#[derive(Debug, Clone)]
pub struct BusProtocols {
    pub(in crate::session) choice: ProtocolChoice,
    pub(in crate::session) canopen: CanopenDetection,
    pub(in crate::session) j1939: J1939Detection,
    /// Nodes whose protocol is settled.
    pub(in crate::session) named: NamedNodes,
    /// Frames that are not decoded, by reason.
    pub(in crate::session) omissions: OmittedFrames,
    /// Number of undecoded frames, and of those with 29-bit identifiers.
    pub(in crate::session) undecoded: (u64, u64),
    /// Whether the frames on the identifier of TIME are not a clock.
    pub(in crate::session) is_time_rejected: bool,
    /// At least one UDS request received a response.
    pub(in crate::session) has_uds: bool,
    /// A group of NMEA 2000 was received.
    pub(in crate::session) has_nmea2000: bool,
    /// Groups of RV-C that were received.
    rv_c: RvCEvidence,
}

impl BusProtocols {
    /// State before the first frame.
    pub(in crate::session) fn new(choice: ProtocolChoice) -> Self {
        Self {
            choice,
            canopen: CanopenDetection::new(choice),
            j1939: J1939Detection::new(choice),
            named: NamedNodes::default(),
            omissions: OmittedFrames::default(),
            undecoded: (0, 0),
            is_time_rejected: false,
            has_uds: false,
            has_nmea2000: false,
            rv_c: RvCEvidence::default(),
        }
    }

    /// Whether the traffic is confirmed as CANopen, or contains a node that the user named.
    pub fn is_canopen(&self) -> bool {
        self.canopen.is_confirmed() || self.named.has_canopen()
    }

    /// Whether messages were decoded as CANopen although nothing confirms that the bus uses it.
    pub fn is_canopen_presumed(&self) -> bool {
        self.canopen.is_presumed() && !self.named.has_canopen()
    }

    /// Whether the 29-bit frames are confirmed as J1939, or contain an address that the user named.
    pub fn is_j1939(&self) -> bool {
        self.j1939.is_confirmed() || self.named.has_j1939()
    }

    /// Whether the protocol of a node is confirmed by evidence or by the user; without a node, that of the CANopen
    /// services of the whole bus.
    pub fn is_settled(&self, node: Option<NodeId>) -> bool {
        match node {
            Some(id @ NodeId::J1939(_)) => self.j1939.is_confirmed() || self.named.contains(id),
            Some(id) => self.canopen.is_confirmed() || self.named.contains(id),
            None => self.is_canopen(),
        }
    }

    /// Whether CANopen was rejected; only nodes that the user named are decoded.
    pub fn is_canopen_rejected(&self) -> bool {
        self.canopen.protocol_status() == ProtocolStatus::Rejected
    }

    /// Whether the events of a node, or of the CANopen services of the bus, were withdrawn: the traffic proved not to
    /// be CANopen, and nobody named the node.
    pub fn is_withdrawn(&self, node: Option<NodeId>) -> bool {
        let is_canopen = node.is_none_or(|id| id.canopen().is_some());
        is_canopen && self.is_canopen_rejected() && !self.is_settled(node)
    }

    /// Whether TIME events were withdrawn, because their identifier proved not to be a clock.
    pub fn is_time_withdrawn(&self) -> bool {
        self.is_time_rejected || self.is_withdrawn(None)
    }

    /// Limits of decoding on this bus, one text per reason: number of frames, reason, and the option to change it.
    pub fn limit_texts(&self) -> Vec<String> {
        let canopen = self.rejection_reason();
        let mut texts =
            self.omissions.omission_texts(canopen.as_deref(), self.j1939.rejection_reason().as_deref());
        // If CANopen was detected later, the frame is a single wrong one.
        let contradiction = self.named.contradiction().filter(|_| !self.canopen.is_confirmed());
        texts.extend(contradiction.map(str::to_owned));
        texts
    }

    /// Number of frames of no known service that no database describes, without those of [`Self::limit_texts`].
    pub fn unknown_frames(&self) -> u64 {
        self.undecoded.0.saturating_sub(self.omissions.undecoded_count())
    }

    /// Reason why the bus was not detected as CANopen; `None` if it was, if nothing contradicts CANopen, or if a node
    /// that the user named is present.
    pub fn detection_doubt(&self) -> Option<String> {
        self.rejection_reason().filter(|_| !self.named.has_canopen())
    }

    /// Reason why identifiers of nodes that nobody named are not decoded as CANopen.
    fn rejection_reason(&self) -> Option<String> {
        (self.canopen.protocol_status() == ProtocolStatus::Rejected).then(|| self.canopen.rejection_reason())
    }

    /// Whether at least one UDS request received a response.
    pub fn is_uds(&self) -> bool {
        self.has_uds
    }

    /// Counts the first message of an identifier as evidence of RV-C; returns whether it completes the evidence.
    pub(in crate::session) fn note_rv_c(&mut self, pgn: Pgn, length: usize) -> bool {
        let is_complete = self.rv_c.note_group(pgn, length, self.has_nmea2000);
        if is_complete {
            self.j1939.add_evidence();
        }
        is_complete
    }

    /// Standards whose tables describe the groups of this bus, in order of precedence.
    pub(in crate::session) fn standards(&self) -> &'static [Standard] {
        match (self.rv_c.is_established(), self.has_nmea2000) {
            (true, _) => &[Standard::RvC, Standard::J1939],
            (false, true) => &[Standard::Nmea2000, Standard::J1939],
            (false, false) => &[Standard::J1939],
        }
    }

    /// Whether frames of a group are parts of fast packets.
    #[inline]
    pub(in crate::session) fn sends_fast_packets(&self, pgn: Pgn) -> bool {
        /// Last group of data page 0; no fast packet is on it.
        const LAST_OF_PAGE_0: u32 = 0xFFFF;
        let is_fast = || is_fast_packet(pgn, self.has_nmea2000) || self.has_nmea2000 && is_fast_group(pgn);
        pgn.number() > LAST_OF_PAGE_0 && is_fast()
    }

    /// Whether the protocol of a service is settled, by evidence or by the user.
    pub(in crate::session) fn settles_service(
        &self,
        service: Option<IdentifierService>,
        channels: &SdoChannels,
    ) -> bool {
        match service {
            Some(
                IdentifierService::Emcy(node)
                | IdentifierService::Pdo(_, node)
                | IdentifierService::ErrorControl(node),
            ) => self.is_settled(Some(node)),
            Some(IdentifierService::Sdo(_, channel)) => {
                self.is_settled(channels.server_node(channel).map(NodeId::Canopen))
            }
            _ => self.is_settled(None),
        }
    }

    /// Whether the protocol of a PDO or message is confirmed, and its sender present in a known state.
    #[inline]
    pub(in crate::session) fn is_settled_sender(
        &self,
        service: IdentifierService,
        sender: Option<&Node>,
    ) -> bool {
        match service {
            IdentifierService::Pdo(..) => {
                self.canopen.is_confirmed() && sender.is_none_or(|sender| !sender.attention)
            }
            IdentifierService::J1939(_) => self.j1939.is_confirmed() && sender.is_some(),
            _ => false,
        }
    }
}
