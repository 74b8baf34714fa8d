//! All rules: general ones and those of device profiles.

use std::collections::BTreeMap;
use std::sync::Arc;

use cobscope_decoder::finding::{RuleOrigin, Severity};
use cobscope_decoder::profile::device::{DeviceRule, RuleTolerance};
use cobscope_decoder::profile::{Catalogue, DeviceProfile};
use cobscope_decoder::query::fields::edit_distance;
use cobscope_decoder::rules::{Tolerance, all_declarations};

/// Description of a rule.
pub(in crate::cmd) struct ListedRule {
    pub(super) name: String,
    pub(super) severity: Severity,
    pub(super) is_on: bool,
    pub(super) is_timing: bool,
    pub(super) origin: RuleOrigin,
    pub(super) title: String,
    /// Headings and paragraphs; empty for a device rule.
    pub(super) explanation: String,
    pub(super) tolerances: Vec<ListedTolerance>,
    pub(super) cases: Vec<String>,
    /// Document and section; for a device rule.
    pub(super) source: String,
    /// Assumption of a device rule.
    pub(super) note: String,
    /// Variants with this rule; empty if all have it.
    pub(super) variants: Vec<String>,
    /// Profiles that waive the rule, with variant, reason and section.
    pub(super) waivers: Vec<(String, String)>,
}

/// Number of a rule that the bus file can override.
pub(super) struct ListedTolerance {
    pub(super) key: &'static str,
    pub(super) default: f64,
    /// Empty for a count or a factor.
    pub(super) unit: &'static str,
    pub(super) text: String,
}

impl From<&Tolerance> for ListedTolerance {
    fn from(tolerance: &Tolerance) -> Self {
        let Tolerance { key, default, unit, text } = *tolerance;
        Self { key, default, unit, text: text.to_owned() }
    }
}

impl From<RuleTolerance> for ListedTolerance {
    fn from(RuleTolerance { key, value, unit, text }: RuleTolerance) -> Self {
        Self { key, default: value, unit, text }
    }
}

/// All rules in alphabetical order, general ones first.
pub(in crate::cmd) fn list_rules(catalogue: &Catalogue) -> Vec<ListedRule> {
    let devices = all_devices(catalogue);
    let mut general: Vec<ListedRule> = all_declarations()
        .map(|rule| ListedRule {
            name: rule.name.to_owned(),
            severity: rule.severity,
            is_on: rule.is_on,
            is_timing: rule.is_timing,
            origin: RuleOrigin::General,
            title: rule.title.to_owned(),
            explanation: rule.manual_text(),
            tolerances: rule.tolerances.iter().map(ListedTolerance::from).collect(),
            cases: rule.cases.iter().map(|case| (*case).to_owned()).collect(),
            source: rule.doc_section("Source").map(|text| text.trim().to_owned()).unwrap_or_default(),
            note: String::new(),
            variants: Vec::new(),
            waivers: rule_waivers(rule.name, &devices),
        })
        .collect();
    general.sort_by(|one, other| one.name.cmp(&other.name));
    general.extend(of_devices(&devices));
    general
}

/// The rule with a given name.
pub(in crate::cmd) fn find_rule(catalogue: &Catalogue, name: &str) -> Option<ListedRule> {
    let is_general = all_declarations().any(|rule| rule.name == name);
    // Profiles are loaded only for the rule of a profile or the waivers of a rule.
    let may_be =
        is_general || name.split_once(':').is_some_and(|(id, _)| catalogue.ids().contains(&id.to_owned()));
    may_be.then(|| list_rules(catalogue).into_iter().find(|rule| rule.name == name)).flatten()
}

/// Nearest rule name, which differs in up to two letters, or starts with `name`.
pub(in crate::cmd) fn nearest_name(catalogue: &Catalogue, name: &str) -> Option<String> {
    const SLIPS: usize = 2;
    const BEGINNING: usize = 4;
    // Hexadecimal codes and identifiers are not rule names.
    let is_word =
        name.len() >= BEGINNING && name.chars().any(|it| it.is_ascii_lowercase() && !it.is_ascii_hexdigit());
    let names = list_rules(catalogue).into_iter().filter(|_| is_word).map(|rule| rule.name);
    let near = names.filter_map(|known| {
        let slips = if known.starts_with(name) { 0 } else { edit_distance(name, &known) };
        (slips <= SLIPS).then_some((slips, known))
    });
    near.min().map(|(_, known)| known)
}

/// All devices in all variants, except invalid profiles.
fn all_devices(catalogue: &Catalogue) -> Vec<(String, Arc<DeviceProfile>)> {
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

fn rule_waivers(rule: &str, devices: &[(String, Arc<DeviceProfile>)]) -> Vec<(String, String)> {
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

/// Device rules by profile and name; a rule of several variants is listed once.
fn of_devices(devices: &[(String, Arc<DeviceProfile>)]) -> Vec<ListedRule> {
    let mut all: BTreeMap<String, (ListedRule, usize)> = BTreeMap::new();
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

fn of_device(name: String, rule: &DeviceRule, device: &DeviceProfile) -> ListedRule {
    let parts = [device.source.as_str(), rule.source.as_str()];
    let source: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    ListedRule {
        name,
        severity: rule.severity,
        is_on: true,
        is_timing: rule.ms.is_some(),
        origin: RuleOrigin::Device,
        title: rule.text.clone(),
        explanation: String::new(),
        tolerances: rule.tolerances().map(ListedTolerance::from).collect(),
        cases: Vec::new(),
        source: source.join(", "),
        note: rule.note.clone(),
        variants: Vec::new(),
        waivers: Vec::new(),
    }
}

impl ListedRule {
    /// Bus file lines that configure the rule, with the default values.
    pub(super) fn bus_file_snippet(&self) -> String {
        // TOML requires quotes for a key with a colon.
        let name = if self.name.contains(':') { format!("{:?}", self.name) } else { self.name.clone() };
        let severity = if self.is_on { self.severity.name() } else { "off" };
        let mut lines = vec![format!("[rules.{name}]"), format!("severity = \"{severity}\"")];
        for tolerance in &self.tolerances {
            lines.push(format!("{} = {}", tolerance.key, tolerance.default));
        }
        lines.join("\n")
    }
}
