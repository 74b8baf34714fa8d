//! Error register (1001) against the EMCY messages of a node.

use crate::event::{Direction, Emergency, Event, EventKind};
use crate::finding::{About, Severity};
use crate::rules::general::facts::number;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// The error register (1001) must read the same as in the last EMCY of the node. With `generic-bit = 1`,
    /// bit 0 must also be set in each EMCY with an error; many devices do not set it.
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
    "emcy-register", Warning, "error register differs from the last EMCY",
    kinds: ["emcy", "sdo-transfer", "boot-up"],
    needs: "an EMCY, then a read of 1001:00",
    cases: &["5.2", "5.5"],
    shows: &["5.2"],
    word: "EMCY",
    tolerances: &[tolerance("generic-bit", 0.0, "", "1: bit 0 must be set in each EMCY with an error")],
}

const REGISTER: ObjectAddress = ObjectAddress::new(0x1001, 0);

struct EmcyRegister {
    wants_generic: bool,
    /// Register and frame of the last EMCY.
    last: NodeMap<Option<(u8, u64)>>,
}

fn new(policy: &Policy) -> EmcyRegister {
    EmcyRegister {
        wants_generic: policy.tolerance(&DECLARATION, "generic-bit") > 0.0,
        last: NodeMap::default(),
    }
}

impl EmcyRegister {
    fn emcy(&mut self, event: &Event, node: NodeId, emergency: &Emergency, context: &mut Context<'_>) {
        if let Some(last) = self.last.entry(node) {
            *last = emergency.register.map(|register| (register, event.frames.last));
        }
        let (Some(register), Some(code)) = (emergency.register, emergency.code) else { return };
        if self.wants_generic && code != 0 && register & 1 == 0 {
            let alarm = context.fail(event).about(About::Code(code)).severity(Severity::Note);
            alarm.report(|| format!("EMCY {code:04X} with error register {register:02X}h (bit 0 clear)"));
        }
    }

    fn read(&self, event: &Event, node: NodeId, read: u64, context: &mut Context<'_>) {
        let Some((reported, frame)) = self.last.get(node).copied().flatten() else { return };
        if u64::from(reported) == read {
            return context.pass();
        }
        let alarm = context.fail(event).about(About::Object(REGISTER));
        alarm.report(|| format!("read as {read:02X}h, but {reported:02X}h in the last EMCY {{{frame}}}"));
    }
}

impl Rule for EmcyRegister {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Emcy(emergency) => self.emcy(event, node, emergency, context),
            EventKind::BootUp { .. } => {
                self.last.remove(node);
            }
            EventKind::SdoTransfer(transfer) => {
                let is_read =
                    transfer.object == Some(REGISTER) && transfer.direction == Some(Direction::Upload);
                if let Some(read) = number(transfer).filter(|_| is_read) {
                    self.read(event, node, read, context);
                }
            }
            _ => {}
        }
    }
}
