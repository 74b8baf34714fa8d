//! SDO downloads that a device refuses.

use crate::event::{Abort, Direction, Event, EventKind, Kind, Mode, Outcome, SdoTransfer};
use crate::finding::{About, Merge};
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::about;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::wire::NodeMap;
use crate::wire::canopen::ObjectAddress;
use crate::words::plural;

declare_rule! {
    /// # What it checks
    /// The server aborts an SDO download. There is one finding per object, and a common one for all further
    /// objects of a node after the first 32. Captures with the case markers of a conformance test are exempt.
    ///
    /// # Why it matters
    /// The device does not have the setting that the master requires, and works with another one.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17 (abort SDO transfer)
    ///
    /// # What to look at first
    /// Check access, range and length of the object in the EDS. The device state may also prevent the write.
    /// Compare the configuration of the master with the EDS of this firmware.
    ///
    /// # Mutation
    /// turn the response to a download into an abort
    "sdo-download-refused", Error, "SDO download refused",
    kinds: [Kind::SdoTransfer],
    needs: "an SDO download",
    merge: Merge::Node,
    word: "REFUSE",
}

/// Maximum number of objects per node with their own finding.
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
        context.fail(event).about(about).reason(text).report(|| {
            let further = if is_one_of_many { " to a further object" } else { "" };
            format!("write of {}{further} refused: {code:08X} {text}", value(transfer))
        });
    }
}

/// The value of the write for display.
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
            // A client that requests a block transfer continues without it.
            (Outcome::Aborted, Some(Abort { code: NO_BLOCKS, .. })) if transfer.mode == Some(Mode::Block) => {
            }
            (Outcome::Aborted, Some(Abort { code, by_client: false })) => {
                self.refused(event, transfer, code, context);
            }
            _ => {}
        }
    }
}
