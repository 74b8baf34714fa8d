//! All rules: the general ones, and those of the devices' manuals.

use std::collections::BTreeMap;
use std::sync::Arc;

use cobscope_decoder::finding::{RuleOrigin, Severity};
use cobscope_decoder::profile::device::DeviceRule;
use cobscope_decoder::profile::{Catalogue, Device};
use cobscope_decoder::query::fields::distance;
use cobscope_decoder::rules::{Tolerance, declarations, manual};

/// A rule with all that is known of it.
pub(in crate::cmd) struct Listed {
    pub(super) name: String,
    pub(super) severity: Severity,
    pub(super) is_on: bool,
    pub(super) is_timing: bool,
    pub(super) origin: RuleOrigin,
    pub(super) title: String,
    /// Headings and paragraphs; empty for a device's rule.
    pub(super) explanation: String,
    pub(super) tolerances: &'static [Tolerance],
    pub(super) cases: Vec<String>,
    /// Document and section of a device's rule.
    pub(super) source: String,
    /// What is assumed of a device's rule.
    pub(super) note: String,
    /// Variants it belongs to, where it is not of all.
    pub(super) variants: Vec<String>,
    /// Profiles that waive it, with variant, reason and section.
    pub(super) waivers: Vec<(String, String)>,
}

/// All rules, general ones first, in alphabetical order.
pub(in crate::cmd) fn listed(catalogue: &Catalogue) -> Vec<Listed> {
    let devices = devices(catalogue);
    let mut general: Vec<Listed> = declarations()
        .map(|rule| Listed {
            name: rule.name.to_owned(),
            severity: rule.severity,
            is_on: rule.is_on,
            is_timing: rule.is_timing,
            origin: RuleOrigin::General,
            title: rule.title.to_owned(),
            explanation: manual(rule.explanation),
            tolerances: rule.tolerances,
            cases: rule.cases.iter().map(|case| (*case).to_owned()).collect(),
            source: rule.section("Source").map(|text| text.trim().to_owned()).unwrap_or_default(),
            note: String::new(),
            variants: Vec::new(),
            waivers: waivers(rule.name, &devices),
        })
        .collect();
    general.sort_by(|one, other| one.name.cmp(&other.name));
    general.extend(of_devices(&devices));
    general
}

/// The rule of a name.
pub(in crate::cmd) fn find(catalogue: &Catalogue, name: &str) -> Option<Listed> {
    let is_general = declarations().any(|rule| rule.name == name);
    // Profiles are read only for who asks for one, or for the waivers of a rule.
    let may_be =
        is_general || name.split_once(':').is_some_and(|(id, _)| catalogue.ids().contains(&id.to_owned()));
    may_be.then(|| listed(catalogue).into_iter().find(|rule| rule.name == name)).flatten()
}

/// The name of the rule that is most likely meant: one that differs by a letter or two, or begins so.
pub(in crate::cmd) fn meant(catalogue: &Catalogue, name: &str) -> Option<String> {
    const SLIPS: usize = 2;
    const BEGINNING: usize = 4;
    // Codes and identifiers are no words.
    let is_word =
        name.len() >= BEGINNING && name.chars().any(|it| it.is_ascii_lowercase() && !it.is_ascii_hexdigit());
    let names = listed(catalogue).into_iter().filter(|_| is_word).map(|rule| rule.name);
    let near = names.filter_map(|known| {
        let slips = if known.starts_with(name) { 0 } else { distance(name, &known) };
        (slips <= SLIPS).then_some((slips, known))
    });
    near.min().map(|(_, known)| known)
}

/// Every device in each of its variants; a broken profile has none.
fn devices(catalogue: &Catalogue) -> Vec<(String, Arc<Device>)> {
    let mut all = Vec::new();
    for id in catalogue.ids() {
        let Ok(device) = catalogue.device(&id) else { continue };
        if device.variants.is_empty() {
            all.push((id, device));
            continue;
        }
        for variant in &device.variants {
            if let Ok(device) = catalogue.device(&format!("{id}:{}", variant.id)) {
                all.push((id.clone(), device));
            }
        }
    }
    all
}

fn waivers(rule: &str, devices: &[(String, Arc<Device>)]) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for (_, device) in devices {
        for waiver in device.waivers.iter().filter(|waiver| waiver.rule.get_ref() == rule) {
            let section =
                if waiver.source.is_empty() { String::new() } else { format!(" [{}]", waiver.source) };
            all.push((device.full_id.clone(), format!("{}{section}", waiver.text)));
        }
    }
    all
}

/// Rules of devices by profile and name; one that several variants have is one.
fn of_devices(devices: &[(String, Arc<Device>)]) -> Vec<Listed> {
    let mut all: BTreeMap<String, (Listed, usize)> = BTreeMap::new();
    for (id, device) in devices {
        let number = devices.iter().filter(|(other, _)| other == id).count();
        for rule in &device.rules {
            let name = format!("{id}:{}", rule.name);
            let entry = all.entry(name.clone()).or_insert_with(|| (of_device(name, rule, device), number));
            entry.0.variants.extend(device.variant.clone());
        }
    }
    let finished = all.into_values().map(|(mut rule, variants)| {
        if rule.variants.len() == variants {
            rule.variants.clear();
        }
        rule
    });
    finished.collect()
}

fn of_device(name: String, rule: &DeviceRule, device: &Device) -> Listed {
    let parts = [device.source.as_str(), rule.source.as_str()];
    let source: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    Listed {
        name,
        severity: rule.severity,
        is_on: true,
        is_timing: rule.ms.is_some(),
        origin: RuleOrigin::Device,
        title: rule.text.clone(),
        explanation: String::new(),
        tolerances: &[],
        cases: Vec::new(),
        source: source.join(", "),
        note: rule.note.clone(),
        variants: Vec::new(),
        waivers: Vec::new(),
    }
}

impl Listed {
    /// Lines of a bus file that set what can be set, with what holds without them.
    pub(super) fn snippet(&self) -> String {
        // A name with a colon is no bare key of TOML.
        let name = if self.name.contains(':') { format!("{:?}", self.name) } else { self.name.clone() };
        let severity = if self.is_on { self.severity.name() } else { "off" };
        let mut lines = vec![format!("[rules.{name}]"), format!("severity = \"{severity}\"")];
        for tolerance in self.tolerances {
            lines.push(format!("{} = {}", tolerance.key, tolerance.default));
        }
        lines.join("\n")
    }
}
