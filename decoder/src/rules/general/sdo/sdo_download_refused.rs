//! A device refuses a write.

use crate::event::{Abort, Direction, Event, EventKind, Mode, Outcome, SdoTransfer};
use crate::finding::About;
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::canopen::ObjectAddress;
use crate::words::plural;

declare_rule! {
    /// # What it checks
    /// An SDO download is aborted by the server. One finding an object; where a node refuses writes of more than
    /// 32 objects, the rest is one finding. Nothing is said where a conformance test marks its cases on the bus,
    /// which asks for refusals on purpose.
    ///
    /// # Why it matters
    /// The device does not have the setting that the master wants it to have, and works with another one.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17 (abort SDO transfer)
    ///
    /// # What to look at first
    /// The code: access, range, length, or a state in which the device does not take this object; then the
    /// master's configuration against the EDS of this firmware.
    ///
    /// # Mutation
    /// turn the answer to a download into an abort
    "sdo-download-refused", Error, "a device refused a write",
    kinds: ["sdo-transfer"],
    word: "REFUSE",
}

/// Objects of a node whose refusals are told apart.
const OBJECT_LIMIT: usize = 32;

/// Command specifier not valid or unknown (CiA 301 table 22): the server has no block transfer.
const NO_BLOCKS: u32 = 0x0504_0001;

#[derive(Default)]
struct SdoDownloadRefused {
    refused: NodeMap<Vec<ObjectAddress>>,
}

fn new(_policy: &Policy) -> SdoDownloadRefused {
    SdoDownloadRefused::default()
}

impl SdoDownloadRefused {
    fn refused(&mut self, event: &Event, transfer: &SdoTransfer, code: u32, context: &mut Context<'_>) {
        let known = event.node.and_then(|node| self.refused.entry(node)).zip(transfer.object);
        let is_one_of_many = known.is_some_and(|(known, object)| {
            let is_told = known.contains(&object);
            if !is_told && known.len() < OBJECT_LIMIT {
                known.push(object);
                return false;
            }
            !is_told
        });
        let about = if is_one_of_many { About::Whole } else { about(transfer) };
        let device = record::device(event, context.bus);
        let own = device.abort(code, transfer.object).map(|own| own.text.as_str());
        let text = own.unwrap_or_else(|| abort_codes().text(code));
        context.fail(event).about(about).say(|| {
            let what = if is_one_of_many { "write of a further object" } else { "write" };
            format!("{what} of {} refused: {code:08X} {text}", value(transfer))
        });
    }
}

/// What was to be written, as people write it.
fn value(transfer: &SdoTransfer) -> String {
    match &transfer.meaning {
        Some(meaning) if !transfer.truncated && !transfer.data.is_empty() => {
            meaning.show(&meaning.decode(&transfer.data))
        }
        _ => plural(transfer.size, "byte"),
    }
}

impl Rule for SdoDownloadRefused {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.direction != Some(Direction::Download) || context.is_tested {
            return;
        }
        match (transfer.outcome, transfer.abort) {
            (Outcome::Complete, _) => context.pass(),
            // A client that asks for blocks goes on without them.
            (Outcome::Aborted, Some(Abort { code: NO_BLOCKS, .. })) if transfer.mode == Some(Mode::Block) => {
            }
            (Outcome::Aborted, Some(Abort { code, by_client: false })) => {
                self.refused(event, transfer, code, context);
            }
            _ => {}
        }
    }
}
