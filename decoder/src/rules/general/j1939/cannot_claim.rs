//! Failed address claims.

use crate::event::{ClaimAction, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// A device reports that it cannot claim an address (claim from address 254). There is one finding per
    /// NAME, open until the device claims an address.
    ///
    /// # Why it matters
    /// Without an address, the device must not send other messages, so its function is missing on the bus.
    ///
    /// # Source
    /// SAE J1939-81 §4.2.2.3 (cannot claim)
    ///
    /// # What to look at first
    /// Find the device that uses the address. Check whether both have the same configuration, and whether the
    /// device is arbitrary address capable.
    ///
    /// # Mutation
    /// insert a claim from address 254
    "cannot-claim", Error, "address claim failed",
    kinds: [Kind::AddressClaim],
    needs: "an address claim",
    word: "CLAIM",
}

#[derive(Default)]
struct CannotClaim {
    /// NAMEs without an address; the findings of further ones stay open.
    without: Vec<u64>,
}

/// Maximum number of NAMEs without an address.
const NAME_LIMIT: usize = 256;

fn new(_policy: &RulePolicy) -> CannotClaim {
    CannotClaim::default()
}

fn name_subject(name: u64) -> FindingSubject {
    FindingSubject::Name(format!("NAME {name:016X}").into())
}

impl Rule for CannotClaim {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::AddressClaim(claim) = &event.kind else { return };
        let name = claim.name.0;
        match claim.action {
            ClaimAction::CannotClaim => {
                if self.without.len() < NAME_LIMIT && !self.without.contains(&name) {
                    self.without.push(name);
                }
                let before = claim.from.map_or_else(String::new, |from| format!("previously {from:02X}, "));
                let may_choose = claim.name.fields().arbitrary_address_capable;
                let may =
                    if may_choose { "arbitrary address capable" } else { "not arbitrary address capable" };
                let alarm = context.start_finding(event).with_subject(name_subject(name)).mark_ongoing();
                alarm.report_finding(|| format!("address claim failed ({before}{may})"));
            }
            ClaimAction::Claimed | ClaimAction::Confirmed => {
                context.count_pass();
                if let Some(place) = self.without.iter().position(|known| *known == name) {
                    self.without.swap_remove(place);
                    context.close_condition(None, name_subject(name));
                }
            }
            ClaimAction::Lost => {}
        }
    }
}
