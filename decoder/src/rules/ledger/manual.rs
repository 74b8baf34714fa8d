//! Manual sections that findings cite.

use std::sync::Arc;

use crate::finding::{FindingSubject, RuleInfo, RuleOrigin};
use crate::profile::DeviceProfile;
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

/// Manual and section of a finding: of the rule, if it belongs to a device, else of the subject in the profile
/// of the node. `None` if the profile does not describe the subject.
pub(super) fn cite_manual(rule: &RuleInfo, about: &FindingSubject, node: Option<&Node>) -> Option<Arc<str>> {
    if rule.origin == RuleOrigin::Device {
        return rule.source.clone();
    }
    let node = node.filter(|node| node.assigned_by().is_some())?;
    let section = manual_section(node.device(), about)?;
    Some(node.device().cite_section(section).into())
}

fn manual_section<'a>(device: &'a DeviceProfile, about: &FindingSubject) -> Option<&'a str> {
    match about {
        FindingSubject::Object(object) => object_section(device, *object),
        FindingSubject::Code(code) => device.error_entry(*code).map(|error| error.source.as_str()),
        FindingSubject::Fault(spn, fmi) => {
            device.trouble_code_entry(*spn, *fmi).map(|fault| fault.source.as_str())
        }
        FindingSubject::Pgn(pgn) => {
            let covers = |first: u32, count| (first..first.saturating_add(count)).contains(pgn);
            let mut messages = device.messages.iter();
            messages.find(|it| covers(it.pgn, u32::from(it.count))).map(|message| message.source.as_str())
        }
        FindingSubject::Name(name) => {
            let procedure = device.procedures.iter().find(|it| *it.name == **name).map(|it| &it.source);
            let pdo = || device.pdos.iter().find(|it| it.pdo.to_string() == **name).map(|it| &it.source);
            procedure.or_else(pdo).map(String::as_str)
        }
        FindingSubject::Whole | FindingSubject::Id(_) => None,
    }
}

fn object_section(device: &DeviceProfile, object: ObjectAddress) -> Option<&str> {
    let found = device.dictionary.find_object(object).filter(|_| device.dictionary.is_own(object))?;
    let entry = found.entry.map(|entry| entry.source.as_str()).filter(|source| !source.is_empty());
    Some(entry.unwrap_or(&found.object.source))
}
