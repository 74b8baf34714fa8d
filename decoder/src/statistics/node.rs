//! Figures of one node.

use super::{CodeCounts, Distribution, Intervals, MOST_CODES, dtc_key};
use crate::event::{DtcAction, Event, EventKind, Outcome, SdoTransfer};
use crate::frame::CanId;
use crate::profile::PdoName;

/// What one node did.
#[derive(Debug, Clone, Default)]
pub struct NodeStatistics {
    /// Time between heartbeats; a boot-up or silence interrupts.
    pub heartbeat: Intervals,
    /// The same intervals by size.
    pub heartbeat_distribution: Distribution,
    last_heartbeat: Option<i64>,
    /// Guarding requests to it, and its replies.
    pub guarding: (u64, u64),
    /// Boot-ups.
    pub boots: u64,
    /// Times it was lost.
    pub lost: u64,
    /// EMCYs other than 0000, by code.
    pub emcy: CodeCounts,
    /// SDO transfers it served: complete, aborted, unanswered, others.
    pub sdo: SdoCounts,
    /// Duration of complete and aborted transfers.
    pub sdo_duration: Distribution,
    /// Time from the end of a transfer to the client's next request.
    pub think_time: Distribution,
    last_transfer: Option<i64>,
    /// Abort codes of transfers with it.
    pub aborts: CodeCounts,
    /// Time between guarding requests to it.
    pub guard_requests: Intervals,
    /// Address claims of a J1939 device, those it lost among them.
    pub claims: u64,
    /// Trouble codes it raised, by [`dtc_key`].
    pub dtcs: CodeCounts,
    /// PDOs it sent and received.
    pub pdos: u64,
    /// Their names and identifiers, the first [`MOST_CODES`].
    pub pdo_ids: Vec<(PdoName, CanId)>,
}

/// Transfers by outcome.
#[derive(Debug, Clone, Copy, Default)]
pub struct SdoCounts {
    /// Complete.
    pub complete: u64,
    /// Aborted by either side.
    pub aborted: u64,
    /// Without answer.
    pub timeout: u64,
    /// Given up, or unfinished at the end.
    pub other: u64,
}

impl NodeStatistics {
    /// Whether the node was heard or served anything: an address without that may not exist.
    pub fn is_present(&self) -> bool {
        self.heartbeat.count() > 0
            || self.last_heartbeat.is_some()
            || self.boots + self.pdos + self.guarding.1 + self.sdo.complete + self.sdo.aborted > 0
            || !self.emcy.codes.is_empty()
    }

    /// Takes an event about this node.
    pub fn event(&mut self, event: &Event) {
        let time = event.time.map(|time| time.0);
        match &event.kind {
            EventKind::Heartbeat { .. } => self.beat(time),
            EventKind::BootUp { .. } => {
                self.boots += 1;
                self.last_heartbeat = None;
                self.heartbeat.interrupt();
            }
            EventKind::GuardRequest => {
                self.guarding.0 += 1;
                if let Some(time) = time {
                    self.guard_requests.add(time);
                }
            }
            EventKind::GuardReply { .. } => self.guarding.1 += 1,
            EventKind::NodeLost(_) => self.lost += 1,
            EventKind::Emcy(emergency) => {
                if let Some(code) = emergency.code.filter(|code| *code != 0) {
                    self.emcy.add(u32::from(code));
                }
            }
            EventKind::Pdo(pdo) => {
                self.pdos += 1;
                let id = (pdo.name, pdo.cob_id);
                if !self.pdo_ids.contains(&id) && self.pdo_ids.len() < MOST_CODES {
                    self.pdo_ids.push(id);
                }
            }
            EventKind::SdoTransfer(transfer) => self.transfer(transfer, time),
            EventKind::AddressClaim(_) => self.claims += 1,
            EventKind::Dtc(dtc) if dtc.action == DtcAction::Raised => {
                self.dtcs.add(dtc_key(dtc.spn, dtc.fmi));
            }
            _ => {}
        }
    }

    fn beat(&mut self, time: Option<i64>) {
        let Some(time) = time else { return };
        if let Some(last) = self.last_heartbeat.replace(time).filter(|last| *last <= time) {
            self.heartbeat_distribution.add(time.saturating_sub(last));
        }
        self.heartbeat.add(time);
    }

    fn transfer(&mut self, transfer: &SdoTransfer, end: Option<i64>) {
        match transfer.outcome {
            _ if transfer.waited.is_some() => self.sdo.timeout += 1,
            Outcome::Complete => self.sdo.complete += 1,
            Outcome::Aborted => self.sdo.aborted += 1,
            Outcome::Timeout => self.sdo.timeout += 1,
            Outcome::Superseded | Outcome::Incomplete | Outcome::Unfinished => self.sdo.other += 1,
        }
        if let Some(abort) = transfer.abort {
            self.aborts.add(abort.code);
        }
        let answered =
            matches!(transfer.outcome, Outcome::Complete | Outcome::Aborted) && transfer.waited.is_none();
        let (Some(end), Some(duration)) = (end, transfer.duration) else { return };
        if answered && transfer.frame_count > 1 {
            self.sdo_duration.add(duration);
        }
        let start = end.saturating_sub(duration);
        if let Some(last) = self.last_transfer.filter(|last| *last <= start) {
            self.think_time.add(start.saturating_sub(last));
        }
        self.last_transfer = answered.then_some(end);
    }
}
