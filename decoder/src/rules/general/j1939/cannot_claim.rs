//! A J1939 device finds no address.

use crate::event::{ClaimAction, Event, EventKind};
use crate::finding::About;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A device says that it cannot claim an address: its claim comes from address 254. One finding a NAME, until it
    /// claims an address.
    ///
    /// # Why it matters
    /// Without an address it may send nothing else: the function it has is missing on the bus.
    ///
    /// # Source
    /// SAE J1939-81 §4.2.2.3 (cannot claim)
    ///
    /// # What to look at first
    /// Which device has the address it wanted, whether both are configured alike, whether it may choose another one
    /// (arbitrary address capable).
    ///
    /// # Mutation
    /// insert a claim from address 254
    "cannot-claim", Error, "a device finds no address",
    kinds: ["address-claim"],
    word: "CLAIM",
}

#[derive(Default)]
struct CannotClaim {
    /// NAMEs without address; further ones are told and never closed.
    without: Vec<u64>,
}

/// NAMEs remembered.
const NAME_LIMIT: usize = 256;

fn new(_policy: &Policy) -> CannotClaim {
    CannotClaim::default()
}

fn about(name: u64) -> About {
    About::Name(format!("NAME {name:016X}").into())
}

impl Rule for CannotClaim {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::AddressClaim(claim) = &event.kind else { return };
        let name = claim.name.0;
        match claim.action {
            ClaimAction::CannotClaim => {
                if self.without.len() < NAME_LIMIT && !self.without.contains(&name) {
                    self.without.push(name);
                }
                let before = claim.from.map_or_else(String::new, |from| format!(", it had {from:02X}"));
                let may_choose = claim.name.fields().arbitrary_address_capable;
                let may = if may_choose { "may choose one" } else { "may not choose another one" };
                let alarm = context.fail(event).about(about(name)).ongoing();
                alarm.say(|| format!("cannot claim an address{before}; it {may}"));
            }
            ClaimAction::Claimed | ClaimAction::Confirmed => {
                context.pass();
                if let Some(place) = self.without.iter().position(|known| *known == name) {
                    self.without.swap_remove(place);
                    context.close(None, about(name));
                }
            }
            ClaimAction::Lost => {}
        }
    }
}
