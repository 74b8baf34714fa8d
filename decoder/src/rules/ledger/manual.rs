//! Manual sections that findings cite.

use std::sync::Arc;

use crate::finding::{About, RuleInfo, RuleOrigin};
use crate::profile::Device;
use crate::session::Node;
use crate::wire::canopen::ObjectAddress;

/// Manual and section of a finding: of the rule, if it belongs to a device, else of the subject in the profile
/// of the node. `None` if the profile does not describe the subject.
pub(super) fn cited(rule: &RuleInfo, about: &About, node: Option<&Node>) -> Option<Arc<str>> {
    if rule.origin == RuleOrigin::Device {
        return rule.source.clone();
    }
    let node = node.filter(|node| node.assigned().is_some())?;
    let section = section(node.device(), about)?;
    Some(node.device().cite(section).into())
}

fn section<'a>(device: &'a Device, about: &About) -> Option<&'a str> {
    match about {
        About::Object(object) => object_section(device, *object),
        About::Code(code) => device.error(*code).map(|error| error.source.as_str()),
        About::Fault(spn, fmi) => device.dtc(*spn, *fmi).map(|fault| fault.source.as_str()),
        About::Pgn(pgn) => {
            let covers = |first: u32, count| (first..first.saturating_add(count)).contains(pgn);
            let mut messages = device.messages.iter();
            messages.find(|it| covers(it.pgn, u32::from(it.count))).map(|message| message.source.as_str())
        }
        About::Name(name) => {
            let procedure = device.procedures.iter().find(|it| *it.name == **name).map(|it| &it.source);
            let pdo = || device.pdos.iter().find(|it| it.pdo.to_string() == **name).map(|it| &it.source);
            procedure.or_else(pdo).map(String::as_str)
        }
        About::Whole | About::Id(_) => None,
    }
}

fn object_section(device: &Device, object: ObjectAddress) -> Option<&str> {
    let found = device.dictionary.find(object).filter(|_| device.dictionary.is_own(object))?;
    let entry = found.entry.map(|entry| entry.source.as_str()).filter(|source| !source.is_empty());
    Some(entry.unwrap_or(&found.object.source))
}
