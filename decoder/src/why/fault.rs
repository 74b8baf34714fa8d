//! Classification of events as faults.

use crate::event::{
    BootCause, DeviceCause, DeviceState, DtcAction, EmcyAction, Event, EventKind, SdoDirection, SdoOutcome,
    SdoTransfer, StateCause, StateChange,
};
use crate::profile::device::ProcedureStatus;
use crate::session::Node;
use crate::wire::canopen::NmtState;

/// Severity of a fault; a lower grade is reported only if there is no higher one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaultGrade {
    /// The device rejected a request.
    Refused,
    /// No effect, but nothing is defective.
    Minor,
    /// A fault.
    Fault,
}

/// Kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// EMCY with this error code.
    Emcy(u16),
    /// J1939 diagnostic trouble code: SPN and FMI.
    Dtc(u32, u8),
    /// The device reports a fault state without a command.
    DeviceState,
    /// Life guarding expired.
    LifeGuard,
    /// A node stopped sending.
    NodeLost,
    /// An operational node restarted without a command.
    Restart,
    /// A node left operational without a command.
    LeftOperational,
    /// The CAN controller of the recorder is error-passive or bus-off.
    BusError,
    /// An NMT command forced the device into a fault state.
    CommandedFault,
    /// A set point other than 0 has no effect.
    SetPoint,
    /// The device left its active state without a cause on the bus.
    LeftActive,
    /// A procedure failed.
    Procedure,
    /// A write was rejected with this abort code.
    Refused(u32),
}

impl FaultKind {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Emcy(_) => "emcy",
            Self::Dtc(..) => "dtc",
            Self::DeviceState => "device-state",
            Self::LifeGuard => "life-guard",
            Self::NodeLost => "node-lost",
            Self::Restart => "restart",
            Self::LeftOperational => "left-operational",
            Self::BusError => "bus-error",
            Self::CommandedFault => "commanded-fault",
            Self::SetPoint => "set-point",
            Self::LeftActive => "left-active",
            Self::Procedure => "procedure",
            Self::Refused(_) => "sdo-refused",
        }
    }

    /// Rule that reports such a fault; its name is the key in `lookups/fault_hints.toml`.
    pub(super) const fn rule(self) -> &'static str {
        match self {
            Self::Emcy(_) => "emcy-raised",
            Self::Dtc(..) => "trouble-code",
            Self::DeviceState | Self::LeftActive | Self::CommandedFault => "state-lost",
            Self::LifeGuard => "guard-late",
            Self::NodeLost => "node-lost",
            Self::Restart => "unexpected-boot",
            Self::LeftOperational => "operational-lost",
            Self::BusError => "bus-health",
            Self::SetPoint => "setpoint-not-effective",
            Self::Procedure => "calibration",
            Self::Refused(_) => "sdo-download-refused",
        }
    }

    /// Severity of the fault.
    pub const fn fault_grade(self) -> FaultGrade {
        match self {
            Self::Emcy(_)
            | Self::Dtc(..)
            | Self::DeviceState
            | Self::LifeGuard
            | Self::NodeLost
            | Self::Restart
            | Self::LeftOperational
            | Self::BusError => FaultGrade::Fault,
            Self::CommandedFault | Self::SetPoint | Self::LeftActive | Self::Procedure => FaultGrade::Minor,
            Self::Refused(_) => FaultGrade::Refused,
        }
    }

    /// Title if there is no fault of a higher grade: `set point without effect`.
    pub const fn title(self) -> &'static str {
        match self {
            Self::CommandedFault => "fault state after an NMT command",
            Self::SetPoint => "set point without effect",
            Self::LeftActive => "active state left without a cause on the bus",
            Self::Procedure => "failed procedure",
            Self::Refused(_) => "rejected write",
            _ => "fault",
        }
    }

    /// Whether the cause is outside the gates of the node, which are closed as a consequence.
    pub(crate) const fn is_of_the_whole_node(self) -> bool {
        matches!(
            self,
            Self::NodeLost | Self::Restart | Self::BusError | Self::LifeGuard | Self::LeftOperational
        )
    }
}

/// Kind of fault of an event; `node` is in the state after the event, `was_operational` refers to before it.
pub(super) fn fault_kind(event: &Event, node: Option<&Node>, was_operational: bool) -> Option<FaultKind> {
    match &event.kind {
        EventKind::Emcy(emergency) => match emergency.code {
            Some(code) if code != 0 && emergency.action == EmcyAction::Raised => Some(FaultKind::Emcy(code)),
            _ => emergency.boot.and_then(|boot| restart_fault(boot, was_operational)),
        },
        EventKind::Dtc(dtc) => matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred)
            .then_some(FaultKind::Dtc(dtc.spn, dtc.fmi)),
        EventKind::BootUp { cause, .. } => restart_fault(*cause, was_operational),
        EventKind::NodeLost(_) => Some(FaultKind::NodeLost),
        EventKind::NmtState(change) => nmt_state(change),
        EventKind::DeviceState(state) => device_state(state, node),
        EventKind::CanError(error) => error.is_grave().then_some(FaultKind::BusError),
        EventKind::Procedure(procedure) => {
            (procedure.status == ProcedureStatus::Error).then_some(FaultKind::Procedure)
        }
        EventKind::SdoTransfer(transfer) => refused_write(transfer),
        _ => None,
    }
}

fn restart_fault(cause: BootCause, was_operational: bool) -> Option<FaultKind> {
    let is_own = matches!(cause, BootCause::PresumedPowerOn { .. });
    (is_own && was_operational).then_some(FaultKind::Restart)
}

fn nmt_state(change: &StateChange) -> Option<FaultKind> {
    match change.cause {
        StateCause::LifeGuard => Some(FaultKind::LifeGuard),
        // After a command the state would already be presumed.
        StateCause::Heartbeat | StateCause::GuardReply
            if change.from == Some(NmtState::Operational) && change.to != NmtState::Operational =>
        {
            Some(FaultKind::LeftOperational)
        }
        _ => None,
    }
}

fn device_state(state: &DeviceState, node: Option<&Node>) -> Option<FaultKind> {
    match (state.fault, state.cause) {
        (true, DeviceCause::ControlWord) => None,
        (true, DeviceCause::NmtCommand) => Some(FaultKind::CommandedFault),
        (true, DeviceCause::LifeGuard) => Some(FaultKind::LifeGuard),
        (true, _) => Some(FaultKind::DeviceState),
        (false, DeviceCause::NotOnTheBus) => left_active(state, node?).then_some(FaultKind::LeftActive),
        (false, _) => None,
    }
}

fn left_active(state: &DeviceState, node: &Node) -> bool {
    let machine = node.device().machines.iter().find(|machine| machine.name == state.machine);
    let is_active = |name: &str| {
        machine.is_some_and(|machine| machine.states.iter().any(|state| state.name == name && state.active))
    };
    state.from.as_deref().is_some_and(is_active) && !is_active(&state.to)
}

/// A write rejected by the server. Rejected reads are normal during scans.
fn refused_write(transfer: &SdoTransfer) -> Option<FaultKind> {
    let abort = transfer.abort.filter(|abort| !abort.by_client)?;
    let is_write =
        transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Aborted;
    is_write.then_some(FaultKind::Refused(abort.code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile;
    use crate::wire::error_frame::ErrorFrameFields;

    #[test]
    fn every_kind_has_three_hints() {
        let all = [
            FaultKind::Emcy(0),
            FaultKind::Dtc(0, 0),
            FaultKind::DeviceState,
            FaultKind::LifeGuard,
            FaultKind::NodeLost,
            FaultKind::Restart,
            FaultKind::LeftOperational,
            FaultKind::BusError,
            FaultKind::CommandedFault,
            FaultKind::SetPoint,
            FaultKind::LeftActive,
            FaultKind::Procedure,
            FaultKind::Refused(0),
        ];
        for kind in all {
            assert_eq!(profile::fault_hints(kind.rule()).len(), 3, "{}", kind.name());
        }
        assert!(!profile::fault_hints("config-lost").is_empty());
        assert!(profile::fault_hints("no such rule").is_empty());
    }

    #[test]
    fn passive_and_off_are_grave() {
        let error = |classes, controller| ErrorFrameFields {
            classes,
            arbitration_bit: 0,
            controller,
            protocol: 0,
            location: 0,
            transceiver: 0,
            transmit_errors: 0,
            receive_errors: 0,
        };
        // linux/can/error.h: class 0x004 controller, 0x040 bus-off; passive 0x10 and 0x20, warning 0x04 and
        // 0x08.
        assert!(error(0x040, 0).is_grave());
        assert!(error(0x004, 0x10).is_grave() && error(0x204, 0x20).is_grave());
        assert!(!error(0x004, 0x0C).is_grave() && !error(0x080, 0x10).is_grave());
    }
}
