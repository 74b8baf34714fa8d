//! Nodes whose identity contradicts the profile that the user assigned.

use crate::event::{Event, EventKind, Kind, SdoDirection, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::profile::ReportedIdentity;
use crate::rules::general::facts::{confirmed_value, transfer_number};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::{AssignedBy, Node};
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// Vendor-ID, product code or device profile number (1018:01, 1018:02, lower half of 1000:00) of a node differ
    /// from the profile that an option or the bus file assigned. An error if the profile states the value. A
    /// note if it does not, but another profile states the identity, or the device profile is another one.
    ///
    /// # Why it matters
    /// All values, states and faults of the node are decoded by the manual of another device.
    ///
    /// # Source
    /// CiA 301 §7.5.2.1 (1000), §7.5.2.19 (1018); identity in the device manual
    ///
    /// # What to look at first
    /// Check the node-ID and the profile of --node or of the bus file.
    ///
    /// # Mutation
    /// let a read of 1018:01 return the vendor-ID of another maker
    "identity-mismatch", Error, "identity of another device",
    kinds: [Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "a read of 1000:00 or 1018 of a node with an assigned profile",
    word: "IDENT",
}

const DEVICE_TYPE: ObjectAddress = ObjectAddress::new(0x1000, 0);
const VENDOR: ObjectAddress = ObjectAddress::new(0x1018, 1);
const PRODUCT: ObjectAddress = ObjectAddress::new(0x1018, 2);

struct IdentityMismatch;

const fn new(_policy: &RulePolicy) -> IdentityMismatch {
    IdentityMismatch
}

/// Part of a value that names the device: the lower half of a device type is the device profile number.
const fn relevant_part(object: ObjectAddress, value: u32) -> u32 {
    if object.index == DEVICE_TYPE.index { value & 0xFFFF } else { value }
}

/// Values that the profile states for an identity object.
fn stated_values(node: &Node, object: ObjectAddress) -> Vec<u32> {
    let device = node.device();
    let identities = device.identities.iter().filter_map(|identity| match object {
        DEVICE_TYPE => identity.device_type.or(identity.profile_number.map(u32::from)),
        VENDOR => identity.vendor_id,
        _ => identity.product_code,
    });
    let entry = device.dictionary.find_object(object).and_then(|found| found.entry);
    let default = entry.and_then(|entry| entry.default_number(None));
    let default = default.and_then(|default| u32::try_from(default).ok());
    identities.chain(default).map(|value| relevant_part(object, value)).collect()
}

/// Other profile that the identity of the node matches, with the value just read.
fn other_profile(
    node: &Node,
    (read, value): (ObjectAddress, u32),
    context: &RuleContext<'_>,
) -> Option<String> {
    let known = |object| {
        let held = || confirmed_value(node, object).and_then(|value| u32::try_from(value).ok());
        if object == read { Some(value) } else { held() }
    };
    let identity = ReportedIdentity {
        vendor_id: known(VENDOR),
        product_code: known(PRODUCT),
        device_type: known(DEVICE_TYPE),
        ..ReportedIdentity::default()
    };
    let own = node.device_id()?;
    let own = own.split(':').next()?;
    let mut others = context.bus.catalogue().identify_node(&identity);
    others.retain(|other| !context.bus.catalogue().is_generic(other));
    let is_own = others.iter().any(|other| other.split(':').next() == Some(own));
    others.into_iter().next().filter(|_| !is_own)
}

/// Number of the CiA device profile that a device implements.
fn device_profile(node: &Node) -> Option<u32> {
    node.device().extends.iter().find_map(|standard| {
        let number = standard.strip_prefix("cia")?.parse().ok()?;
        (number >= 401).then_some(number)
    })
}

fn judge_identity(event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
    let is_read = transfer.direction == Some(SdoDirection::Upload);
    let Some(object) =
        transfer.object.filter(|object| is_read && [DEVICE_TYPE, VENDOR, PRODUCT].contains(object))
    else {
        return;
    };
    let is_assigned =
        |node: &&Node| matches!(node.assigned_by(), Some(AssignedBy::Option | AssignedBy::BusFile));
    let Some(node) = context.event_node(event).filter(is_assigned) else { return };
    let Some(value) = transfer_number(transfer).and_then(|value| u32::try_from(value).ok()) else { return };
    let is = relevant_part(object, value);
    let stated = stated_values(node, object);
    let profile = node.device_id().unwrap_or_default();
    let about = FindingSubject::Object(object);
    let show = |value: u32| if object == DEVICE_TYPE { value.to_string() } else { format!("{value:08X}h") };
    if let Some(expected) = stated.first() {
        if stated.contains(&is) {
            return context.count_pass();
        }
        return context.start_finding(event).with_subject(about).report_finding(|| {
            let (is, expected) = (show(is), show(*expected));
            format!("{object} = {is}, profile {profile} states {expected}: another device")
        });
    }
    let other = other_profile(node, (object, value), context).map(|other| format!("identity of {other}"));
    let other = other.or_else(|| {
        let own = device_profile(node).filter(|own| object == DEVICE_TYPE && is != 0 && *own != is)?;
        Some(format!("device profile of {profile} is CiA {own}"))
    });
    match other {
        Some(other) => {
            context.start_finding(event).with_subject(about).with_severity(Severity::Note).report_finding(
                || {
                    format!(
                        "{object} = {}, {other}: another device? (profile {profile} states no value)",
                        show(is)
                    )
                },
            );
        }
        None if object == DEVICE_TYPE && device_profile(node).is_some() => context.count_pass(),
        None => {}
    }
}

impl Rule for IdentityMismatch {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::SdoTransfer(transfer) = &event.kind {
            judge_identity(event, transfer, context);
        }
    }
}
