//! Statistics of one node.

use super::{
    CodeCounts, DeviceProduct, DurationDistribution, FirstFrame, IntervalStatistics, MOST_CODES,
    ReactionTimes, dtc_key,
};
use crate::event::{DtcAction, Event, EventKind, SdoOutcome, SdoTransfer};
use crate::frame::CanId;
use crate::profile::PdoName;

/// Statistics of one node.
#[derive(Debug, Clone, Default)]
pub struct NodeStatistics {
    /// First frame of a CANopen node, with its time in ns; `None` if it sent none.
    pub first_frame: Option<(FirstFrame, Option<i64>)>,
    /// Time between heartbeats; a boot-up or silence starts a new series.
    pub heartbeat: IntervalStatistics,
    /// Distribution of the time between heartbeats.
    pub heartbeat_distribution: DurationDistribution,
    last_heartbeat: Option<i64>,
    /// Number of guarding requests and responses.
    pub guarding: (u64, u64),
    /// Number of boot-ups.
    pub boots: u64,
    /// Number of times the node was lost.
    pub lost: u64,
    /// EMCY messages by error code, except 0000.
    pub emcy: CodeCounts,
    /// SDO transfers with the node as server, by outcome.
    pub sdo: SdoCounts,
    /// Duration of complete and aborted transfers.
    pub sdo_duration: DurationDistribution,
    /// Time from the end of a transfer to the client's next request.
    pub think_time: DurationDistribution,
    last_transfer: Option<i64>,
    /// SDO transfers with the node as server, by abort code.
    pub aborts: CodeCounts,
    /// Time between guarding requests to the node.
    pub guard_requests: IntervalStatistics,
    /// Number of address claims of a J1939 device, including lost ones.
    pub claims: u64,
    /// J1939 diagnostic trouble codes, by [`dtc_key`].
    pub dtcs: CodeCounts,
    /// Product data of a J1939 device.
    pub product: DeviceProduct,
    /// Number of PDOs sent and received.
    pub pdos: u64,
    /// Names and COB-IDs of PDOs, up to [`MOST_CODES`].
    pub pdo_ids: Vec<(PdoName, CanId)>,
    /// Index in `pdo_ids` of the PDO that is expected next.
    next_pdo_id: usize,
    /// Reaction times of the controller.
    pub reactions: ReactionTimes,
}

/// Number of transfers by outcome.
#[derive(Debug, Clone, Copy, Default)]
pub struct SdoCounts {
    /// Complete.
    pub complete: u64,
    /// Aborted by client or server.
    pub aborted: u64,
    /// Without response.
    pub timeout: u64,
    /// Superseded, or unfinished at the end.
    pub other: u64,
}

impl NodeStatistics {
    /// Whether the node sent or served anything; otherwise the node-ID may be unused.
    pub fn is_present(&self) -> bool {
        self.heartbeat.count() > 0
            || self.last_heartbeat.is_some()
            || self.boots + self.pdos + self.guarding.1 + self.sdo.complete + self.sdo.aborted > 0
            || !self.emcy.codes.is_empty()
    }

    /// Whether all its events are PDOs.
    pub(super) fn has_only_pdos(&self) -> bool {
        self.pdos > 0 && !Self { pdos: 0, ..self.clone() }.is_present()
    }

    /// Counts an event of this node.
    pub fn count_event(&mut self, event: &Event) {
        let time = event.time.map(|time| time.0);
        if self.first_frame.is_none() {
            self.first_frame = FirstFrame::meaning_of(event).map(|first| (first, time));
        }
        self.reactions.take_event(event);
        match &event.kind {
            EventKind::Heartbeat { .. } => self.count_heartbeat(time),
            EventKind::BootUp { .. } => {
                self.boots += 1;
                self.last_heartbeat = None;
                self.heartbeat.interrupt_series();
            }
            EventKind::GuardRequest => {
                self.guarding.0 += 1;
                if let Some(time) = time {
                    self.guard_requests.add_time(time);
                }
            }
            EventKind::GuardReply { .. } => self.guarding.1 += 1,
            EventKind::NodeLost(_) => self.lost += 1,
            EventKind::Emcy(emergency) => {
                if let Some(code) = emergency.code.filter(|code| *code != 0) {
                    self.emcy.count_code(u32::from(code));
                }
            }
            EventKind::Pdo(pdo) => {
                self.pdos += 1;
                self.count_pdo_id((pdo.name, pdo.cob_id));
            }
            EventKind::SdoTransfer(transfer) => self.count_transfer(transfer, time),
            EventKind::AddressClaim(_) => self.claims += 1,
            EventKind::J1939Message(_) | EventKind::J1939Transfer(_) => self.product.take_event(event),
            EventKind::Dtc(dtc) if dtc.action == DtcAction::Raised => {
                self.dtcs.count_code(dtc_key(dtc.spn, dtc.fmi));
            }
            _ => {}
        }
    }

    /// Adds the name and COB-ID of a PDO. PDOs repeat in their order, so the one after the last PDO is compared first.
    #[inline]
    fn count_pdo_id(&mut self, id: (PdoName, CanId)) {
        if self.pdo_ids.get(self.next_pdo_id) != Some(&id) {
            match self.pdo_ids.iter().position(|known| *known == id) {
                Some(place) => self.next_pdo_id = place,
                None if self.pdo_ids.len() < MOST_CODES => {
                    self.next_pdo_id = self.pdo_ids.len();
                    self.pdo_ids.push(id);
                }
                None => return,
            }
        }
        self.next_pdo_id += 1;
        if self.next_pdo_id >= self.pdo_ids.len() {
            self.next_pdo_id = 0;
        }
    }

    /// Starts new series of intervals: the clock of the recorder was set.
    pub(super) fn interrupt_series(&mut self) {
        // No heartbeat is later than this one, but the node has sent one.
        self.last_heartbeat = self.last_heartbeat.map(|_| i64::MAX);
        self.heartbeat.interrupt_series();
        self.guard_requests.interrupt_series();
    }

    fn count_heartbeat(&mut self, time: Option<i64>) {
        let Some(time) = time else { return };
        if let Some(last) = self.last_heartbeat.replace(time).filter(|last| *last <= time) {
            self.heartbeat_distribution.add_duration(time.saturating_sub(last));
        }
        self.heartbeat.add_time(time);
    }

    fn count_transfer(&mut self, transfer: &SdoTransfer, end: Option<i64>) {
        match transfer.outcome {
            _ if transfer.waited.is_some() => self.sdo.timeout += 1,
            SdoOutcome::Complete => self.sdo.complete += 1,
            SdoOutcome::Aborted => self.sdo.aborted += 1,
            SdoOutcome::Timeout => self.sdo.timeout += 1,
            SdoOutcome::Superseded | SdoOutcome::Incomplete | SdoOutcome::Unfinished => self.sdo.other += 1,
        }
        if let Some(abort) = transfer.abort {
            self.aborts.count_code(abort.code);
        }
        let answered = matches!(transfer.outcome, SdoOutcome::Complete | SdoOutcome::Aborted)
            && transfer.waited.is_none();
        let (Some(end), Some(duration)) = (end, transfer.duration) else { return };
        if answered && transfer.frame_count > 1 {
            self.sdo_duration.add_duration(duration);
        }
        let start = end.saturating_sub(duration);
        if let Some(last) = self.last_transfer.filter(|last| *last <= start) {
            self.think_time.add_duration(start.saturating_sub(last));
        }
        self.last_transfer = answered.then_some(end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::PdoDirection;

    #[test]
    fn pdos_are_listed_once_in_order_of_appearance() {
        let pdo = |number: u16| {
            let name = PdoName { direction: PdoDirection::Transmit, number };
            (name, CanId::from_standard(0x180 + number))
        };
        let mut node = NodeStatistics::default();
        for number in [1, 2, 1, 2, 3, 1, 3, 2, 1, 2, 3] {
            node.count_pdo_id(pdo(number));
        }
        assert_eq!(node.pdo_ids, [1, 2, 3].map(pdo));
        for number in (1..=200).chain(1..=200) {
            node.count_pdo_id(pdo(number));
        }
        assert_eq!((node.pdo_ids.len(), node.pdo_ids.last()), (MOST_CODES, Some(&pdo(64))));
    }
}
