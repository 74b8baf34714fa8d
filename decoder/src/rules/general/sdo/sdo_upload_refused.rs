//! A device refuses a read.

use crate::event::{Abort, Direction, Event, EventKind, Outcome};
use crate::profile::abort_codes;
use crate::query::record;
use crate::rules::general::facts::about;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// An SDO upload is aborted by the server. Where a node was asked for several objects that do not exist, the
    /// client looks for what there is: then only other codes are told.
    ///
    /// # Why it matters
    /// The client does not get a value that it may need. Mostly it is only curious.
    ///
    /// # Source
    /// CiA 301 §7.2.4.3.17 (abort SDO transfer)
    ///
    /// # What to look at first
    /// The client's configuration against the EDS of this firmware.
    ///
    /// # Mutation
    /// turn the answer to an upload into an abort
    "sdo-upload-refused", Note, "a device refused a read",
    kinds: ["sdo-transfer"],
    is_on: false,
    word: "REFUSE",
    tolerances: &[tolerance("missing", 5.0, "", "of objects that do not exist, before it is a scan")],
}

struct SdoUploadRefused {
    most: f64,
    missing: NodeMap<f64>,
}

fn new(policy: &Policy) -> SdoUploadRefused {
    SdoUploadRefused { most: policy.tolerance(&DECLARATION, "missing"), missing: NodeMap::default() }
}

/// Object does not exist, sub-index does not exist.
const MISSING: [u32; 2] = [0x0602_0000, 0x0609_0011];

impl Rule for SdoUploadRefused {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::SdoTransfer(transfer) = &event.kind else { return };
        if transfer.direction != Some(Direction::Upload) || context.is_tested {
            return;
        }
        let code = match (transfer.outcome, transfer.abort) {
            (Outcome::Complete, _) => return context.pass(),
            (Outcome::Aborted, Some(Abort { code, by_client: false })) => code,
            _ => return,
        };
        if let Some(count) =
            event.node.and_then(|node| self.missing.entry(node)).filter(|_| MISSING.contains(&code))
        {
            *count += 1.0;
            if *count > self.most {
                return;
            }
        }
        let own = record::device(event, context.bus).abort(code, transfer.object);
        let text = own.map_or_else(|| abort_codes().text(code), |own| &own.text);
        context.fail(event).about(about(transfer)).say(|| format!("read refused: {code:08X} {text}"));
    }
}
