//! Error register (1001) against the EMCY messages of a node.

use crate::event::{EmcyAction, Emergency, Event, EventKind, Kind, SdoDirection};
use crate::finding::{FindingSubject, Severity};
use crate::profile::device::ClearMeaning;
use crate::rules::general::facts::transfer_number;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The error register (1001) must read as the OR of the registers of all active EMCY; after an EMCY 0000,
    /// as the register in it. For a device without a profile, the register of the last EMCY is permitted too.
    /// It is a note if bits of an error are missing whose end the device does not report. With
    /// `generic-bit = 1`, bit 0 must also be set in each EMCY with an error; many devices do not set it.
    ///
    /// # Why it matters
    /// A master that polls the register sees another device state than a consumer of its EMCY messages.
    ///
    /// # Source
    /// CiA 301 §7.5.2.2 (1001), §7.2.7.1 (emergency object)
    ///
    /// # What to look at first
    /// Check for errors that the device reports without EMCY. The inhibit time of EMCY (1015) can also
    /// suppress one.
    ///
    /// # Mutation
    /// change the value in the response to an upload of 1001
    "emcy-register", Warning, "error register differs from the active EMCY",
    kinds: [Kind::Emcy, Kind::SdoTransfer, Kind::BootUp],
    transfers: TransferSubset::Communication,
    needs: "an EMCY, then a read of 1001:00",
    cases: &["5.2", "5.5"],
    shows: &["5.2"],
    word: "EMCY",
    tolerances: &[define_tolerance("generic-bit", 0.0, "", "1: bit 0 must be set in each EMCY with an error")],
}

const REGISTER: ObjectAddress = ObjectAddress::new(0x1001, 0);

/// Maximum number of active errors per node; the oldest one is dropped.
const ERROR_LIMIT: usize = 64;

/// An active error as reported.
#[derive(Clone, Copy)]
struct ActiveError {
    code: u16,
    register: u8,
}

/// Registers that a node reported since its boot.
#[derive(Default)]
struct ReportedRegisters {
    /// Content of 1001 in the last EMCY 0000: the errors that remained, without their codes.
    remaining: u8,
    active: Vec<ActiveError>,
    /// Register and frame of the last EMCY; `None` if it had no register.
    last: Option<(u8, u64)>,
}

struct EmcyRegister {
    wants_generic: bool,
    nodes: NodeMap<ReportedRegisters>,
}

fn new(policy: &RulePolicy) -> EmcyRegister {
    EmcyRegister {
        wants_generic: policy.tolerance_value(&DECLARATION, "generic-bit") > 0.0,
        nodes: NodeMap::default(),
    }
}

impl ReportedRegisters {
    fn add_register(&mut self, emergency: &Emergency, frame: u64) {
        let register = emergency.register;
        self.last = register.map(|register| (register, frame));
        if let (EmcyAction::Raised, Some(code)) = (emergency.action, emergency.code) {
            self.active.retain(|error| error.code != code);
            if self.active.len() >= ERROR_LIMIT {
                self.active.remove(0);
            }
            self.active.extend(register.map(|register| ActiveError { code, register }));
        } else {
            self.active.clear();
            self.remaining = register.unwrap_or(0);
        }
    }

    fn all_bits(&self) -> u8 {
        self.active.iter().fold(self.remaining, |all, error| all | error.register)
    }

    /// `05h of EMCY 3422 | 21h of EMCY 8301`
    fn source_texts(&self) -> String {
        let remaining = (self.remaining != 0).then(|| format!("{:02X}h of EMCY 0000", self.remaining));
        let active =
            self.active.iter().map(|error| format!("{:02X}h of EMCY {:04X}", error.register, error.code));
        remaining.into_iter().chain(active).collect::<Vec<_>>().join(" | ")
    }
}

impl EmcyRegister {
    fn on_emcy(&mut self, event: &Event, node: NodeId, emergency: &Emergency, context: &mut RuleContext<'_>) {
        if let Some(registers) = self.nodes.entry(node) {
            registers.add_register(emergency, event.frames.last);
        }
        let (Some(register), Some(code)) = (emergency.register, emergency.code) else { return };
        if self.wants_generic && code != 0 && register & 1 == 0 {
            let alarm = context
                .start_finding(event)
                .with_subject(FindingSubject::Code(code))
                .with_severity(Severity::Note);
            alarm.report_finding(|| {
                format!("EMCY {code:04X} with error register {register:02X}h (bit 0 clear)")
            });
        }
    }

    fn on_read(&self, event: &Event, node: NodeId, read: u64, context: &mut RuleContext<'_>) {
        let Some(registers) = self.nodes.get(node) else { return };
        let Some((last, frame)) = registers.last else { return };
        let all = registers.all_bits();
        // CiA 301 §7.2.7.1: the register in an EMCY is the content of 1001.
        let is_plain = context.event_node(event).is_none_or(|node| node.assigned_by().is_none());
        if read == u64::from(all) || (is_plain && read == u64::from(last)) {
            return context.count_pass();
        }
        // Without an EMCY 0000 for each error, an error may have ended without notice.
        let reports_end = context
            .event_node(event)
            .map(Node::device)
            .is_none_or(|device| device.emcy.cleared == ClearMeaning::Each);
        let is_part = read != 0 && read & !u64::from(all) == 0;
        let may_have_ended = is_part && !reports_end;
        let mut alarm = context.start_finding(event).with_subject(FindingSubject::Object(REGISTER));
        if may_have_ended {
            alarm = alarm.with_severity(Severity::Note);
        }
        alarm.report_finding(|| match &registers.active[..] {
            [_, _, ..] => {
                let reason = if may_have_ended { "; or an error ended without EMCY" } else { "" };
                format!("read as {read:02X}h, but {all:02X}h active ({}){reason}", registers.source_texts())
            }
            _ => format!("read as {read:02X}h, but {last:02X}h in the last EMCY {{{frame}}}"),
        });
    }
}

impl Rule for EmcyRegister {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.nodes.remove(node);
                }
                self.on_emcy(event, node, emergency, context);
            }
            EventKind::BootUp { .. } => {
                self.nodes.remove(node);
            }
            EventKind::SdoTransfer(transfer) => {
                let is_read =
                    transfer.object == Some(REGISTER) && transfer.direction == Some(SdoDirection::Upload);
                if let Some(read) = transfer_number(transfer).filter(|_| is_read) {
                    self.on_read(event, node, read, context);
                }
            }
            _ => {}
        }
    }
}
