//! Configuration of the rules: defaults, and severities, tolerances, suppressions and expectations of the bus
//! file.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::bus_file::{BusFile, NodeRule, RuleSettings};
use crate::finding::RuleInfo;
use crate::profile::device::DeviceRule;
use crate::profile::{Catalogue, ExpectEntry, TextError};
use crate::query::fields::edit_distance;
use crate::rules::declaration::Declaration;
use crate::rules::device::node_rule_info;
use crate::rules::expectation::CompiledExpectation;
use crate::rules::general::all_declarations;
use crate::rules::policy::RulePolicy;
use crate::rules::selection::RuleSelection;
use crate::session::Buses;

/// Configured rules and expectations.
#[derive(Debug, Clone)]
pub struct RuleSetup {
    pub(super) policy: Arc<RulePolicy>,
    /// Expectations with the indices of their rules.
    expectations: Vec<(u16, CompiledExpectation)>,
}

impl Default for RuleSetup {
    fn default() -> Self {
        Self { policy: Arc::new(default_policy()), expectations: Vec::new() }
    }
}

/// Default policy: all general rules with their default settings.
fn default_policy() -> RulePolicy {
    RulePolicy { rules: all_declarations().map(Declaration::rule_info).collect(), ..RulePolicy::default() }
}

impl RuleSetup {
    /// Applies `file` to the default rules; `text` is the source of `file`. `today` (`2026-01-31`) disables
    /// suppressions after their end date.
    ///
    /// # Errors
    /// An unknown rule or tolerance, an invalid value or an expression with an error, with its position in
    /// `text`.
    pub fn new(file: &BusFile, text: &str, today: Option<String>) -> Result<Self, TextError> {
        let suppressions = file.judgement.suppressions.clone();
        let mut policy = RulePolicy { suppressions, today, ..default_policy() };
        let mut expectations = Vec::new();
        for written in &file.judgement.expectations {
            expectations.push(add_expectation(&mut policy, written, text)?);
        }
        for written in &file.judgement.node_rules {
            add_node_rule(&mut policy, written, text)?;
        }
        for given in &file.judgement.rules {
            take_settings(&mut policy, given, text)?;
        }
        for suppression in &policy.suppressions {
            if !policy.knows_rule(&suppression.rule) {
                let message = unknown_rule(&policy, &suppression.rule);
                return Err(TextError::at_place(text, suppression.span.clone(), message));
            }
        }
        Ok(Self { policy: Arc::new(policy), expectations })
    }

    /// Activates only the selected rules.
    ///
    /// # Errors
    /// A name that means no rule; the text suggests a similar one.
    pub fn select_rules(mut self, selection: RuleSelection) -> Result<Self, String> {
        let policy = Arc::make_mut(&mut self.policy);
        for pattern in selection.select.iter().chain(&selection.ignore) {
            check_pattern(policy, pattern)?;
        }
        for rule in &mut policy.rules {
            rule.is_on &= selection.admits_rule(&rule.name);
        }
        policy.selection = selection;
        Ok(self)
    }

    /// Checks a name or pattern of a selection of rules.
    ///
    /// # Errors
    /// It means no rule; the text suggests a similar name.
    pub fn check_pattern(&self, pattern: &str) -> Result<(), String> {
        check_pattern(&self.policy, pattern)
    }

    /// Checks a rule name given on the command line.
    ///
    /// # Errors
    /// The rule is unknown; the text suggests a similar name.
    pub fn check_name(&self, rule: &str) -> Result<(), String> {
        if self.policy.knows_rule(rule) { Ok(()) } else { Err(unknown_rule(&self.policy, rule)) }
    }

    /// Checks a rule name given on the command line, also the name of a device rule: `rexroth-sydfec:eeprom-wear`.
    ///
    /// # Errors
    /// The rule or its profile is unknown; the text suggests a similar name.
    pub fn check_rule(&self, rule: &str, catalogue: &Catalogue) -> Result<(), String> {
        match rule.split_once(':') {
            Some((profile, name)) => device_rule(catalogue, profile, name).map(|_| ()),
            None => self.check_name(rule),
        }
    }

    /// Checks the settings for device rules in the bus file against the profiles.
    ///
    /// # Errors
    /// An unknown profile, rule or tolerance, with its position in `text`.
    pub fn check_devices(&self, file: &BusFile, text: &str, catalogue: &Catalogue) -> Result<(), TextError> {
        for settings in &file.judgement.rules {
            check_tolerances(settings, catalogue, text)?;
        }
        let settings = file.judgement.rules.iter().map(|one| (&one.rule, &one.span));
        let suppressed = self.policy.suppressions.iter().map(|one| (&one.rule, &one.span));
        for (rule, span) in settings.chain(suppressed) {
            if let Some((profile, name)) = rule.split_once(':') {
                device_rule(catalogue, profile, name)
                    .map(|_| ())
                    .map_err(|message| TextError::at_place(text, span.clone(), message))?;
            }
        }
        Ok(())
    }

    /// All rules; expectations come after the general rules.
    pub fn rules(&self) -> &[RuleInfo] {
        &self.policy.rules
    }

    /// Expectations about a bus, with the indices of their rules.
    pub(super) fn expectations_on(&self, bus: &str) -> impl Iterator<Item = (u16, &CompiledExpectation)> {
        let all = self.expectations.iter().filter(move |(_, one)| one.is_about(bus));
        all.map(|(place, one)| (*place, one))
    }

    /// Expectations about a bus that does not exist, with the index of the rule and the name of that bus.
    pub(super) fn expectations_elsewhere(&self, buses: Buses<'_>) -> impl Iterator<Item = (u16, &str)> {
        let all = self.expectations.iter().filter_map(|(place, one)| Some((*place, one.bus_name()?)));
        all.filter(move |(_, own)| buses.iter().all(|bus| bus.name() != *own))
    }
}

/// Adds an expectation as a rule; returns its index.
fn add_expectation(
    policy: &mut RulePolicy,
    written: &ExpectEntry,
    text: &str,
) -> Result<(u16, CompiledExpectation), TextError> {
    let expectation = CompiledExpectation::compile_entry(written, text)?;
    let id = &written.id;
    let place = u16::try_from(policy.rules.len()).ok().filter(|_| !policy.knows_rule(&id.text));
    let Some(place) = place else {
        let message = format!("duplicate rule name '{}'", id.text);
        return Err(TextError::at_place(text, id.span.clone(), message));
    };
    policy.rules.push(expectation.rule_info().clone());
    Ok((place, expectation))
}

/// Adds a rule of a node, once for all its repeats.
fn add_node_rule(policy: &mut RulePolicy, written: &NodeRule, text: &str) -> Result<(), TextError> {
    let is_repeat = policy.node_rules.iter().any(|known| known.rule.name == written.rule.name);
    if !is_repeat {
        if policy.knows_rule(&written.rule.name) {
            let message = format!("duplicate rule name '{}'", written.rule.name);
            return Err(TextError::at_place(text, written.span.clone(), message));
        }
        policy.rules.push(node_rule_info(&written.rule));
    }
    policy.node_rules.push(written.clone());
    Ok(())
}

fn check_pattern(policy: &RulePolicy, pattern: &str) -> Result<(), String> {
    if policy.knows_pattern(pattern) { Ok(()) } else { Err(unknown_rule(policy, pattern)) }
}

fn unknown_rule(policy: &RulePolicy, rule: &str) -> String {
    let near = policy.rules.iter().map(|known| &*known.name).find(|known| is_near(known, rule));
    match near {
        Some(near) => format!("unknown rule '{rule}'; did you mean '{near}'?"),
        None => format!("unknown rule '{rule}'; cobscope rules lists all rules"),
    }
}

fn take_settings(policy: &mut RulePolicy, given: &RuleSettings, text: &str) -> Result<(), TextError> {
    let wrong =
        |span: &std::ops::Range<usize>, message: String| TextError::at_place(text, span.clone(), message);
    let name = given.rule.as_str();
    if !policy.knows_rule(name) {
        return Err(wrong(&given.span, unknown_rule(policy, name)));
    }
    if let Some(severity) = given.severity {
        if let Some(rule) = policy.rules.iter_mut().find(|rule| *rule.name == *name) {
            rule.is_on = severity.is_some();
            rule.severity = severity.unwrap_or(rule.severity);
        } else if severity.is_none() {
            policy.off.push(name.to_owned());
        }
        policy.severities.extend(severity.map(|severity| (name.to_owned(), severity)));
    }
    // Tolerances of a device rule are checked with its profile, see `check_tolerances`.
    if name.contains(':') {
        return Ok(());
    }
    let declaration = all_declarations().find(|declaration| declaration.name == name);
    for (key, span, value) in &given.tolerances {
        let tolerances = declaration.map_or(&[][..], |declaration| declaration.tolerances);
        let known = tolerances.iter().find(|tolerance| tolerance.key == key).zip(declaration);
        let Some((tolerance, declaration)) = known else {
            let keys: Vec<_> = tolerances.iter().map(|tolerance| tolerance.key).collect();
            return Err(wrong(span, no_tolerance(name, &keys, key)));
        };
        policy.tolerances.insert((declaration.name, tolerance.key), *value);
    }
    Ok(())
}

fn no_tolerance(rule: &str, keys: &[&str], key: &str) -> String {
    let known = [&["severity"][..], keys].concat().join(", ");
    format!("unknown key '{key}' of {rule}; expected {known}")
}

/// Checks tolerances that are set for a device rule.
fn check_tolerances(settings: &RuleSettings, catalogue: &Catalogue, text: &str) -> Result<(), TextError> {
    let Some((profile, name)) = settings.rule.split_once(':') else { return Ok(()) };
    let rule = device_rule(catalogue, profile, name)
        .map_err(|message| TextError::at_place(text, settings.span.clone(), message))?;
    let keys: Vec<_> = rule.tolerances().map(|one| one.key).collect();
    for (key, span, value) in &settings.tolerances {
        let message = if !keys.contains(&key.as_str()) {
            no_tolerance(&settings.rule, &keys, key)
        } else if *value <= 0.0 {
            format!("{key} must be greater than 0")
        } else {
            continue;
        };
        return Err(TextError::at_place(text, span.clone(), message));
    }
    Ok(())
}

/// Looks up a rule of a profile in all variants.
fn device_rule(catalogue: &Catalogue, profile: &str, name: &str) -> Result<DeviceRule, String> {
    let device = catalogue.device(profile).map_err(|error| error.to_string())?;
    let mut rules = BTreeMap::new();
    let variants = device.variants.iter().map(|variant| format!("{profile}:{}", variant.id));
    for device in variants.filter_map(|variant| catalogue.device(&variant).ok()).chain([Arc::clone(&device)])
    {
        rules.extend(device.rules.iter().map(|rule| (rule.name.clone(), rule.clone())));
    }
    if let Some(rule) = rules.remove(name) {
        return Ok(rule);
    }
    let names = rules.keys();
    let near = names.into_iter().find(|known| is_near(known, name));
    let meant = near.map_or_else(String::new, |near| format!("; did you mean '{profile}:{near}'?"));
    Err(format!("profile '{profile}' has no rule '{name}'{meant}"))
}

/// Similar names: an edit distance of at most 2, or one is a prefix of the other.
fn is_near(known: &str, given: &str) -> bool {
    given.len() > 3 && (known.starts_with(given) || given.starts_with(known))
        || edit_distance(known, given) <= 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Severity;

    fn setup(text: &str) -> Result<RuleSetup, String> {
        let file = BusFile::parse(text).map_err(|error| error.to_string())?;
        RuleSetup::new(&file, text, Some("2026-06-01".into())).map_err(|error| error.to_string())
    }

    #[test]
    fn severities_and_tolerances_are_taken_by_name() {
        let setup = setup("[rules.sdo-no-response]\nseverity = \"note\"\nwarning-ms = 300\n").unwrap();
        let declaration = all_declarations().find(|rule| rule.name == "sdo-no-response").unwrap();
        assert_eq!(setup.policy.tolerance_ns(declaration, "warning-ms"), 300_000_000);
        assert_eq!(setup.policy.severity_of("sdo-no-response"), Some(Severity::Note));
    }

    #[test]
    fn rules_of_devices_are_those_of_the_profiles() {
        let check = |text: &str| {
            let file = BusFile::parse(text).unwrap();
            let setup = RuleSetup::new(&file, text, None).unwrap();
            setup.check_devices(&file, text, &Catalogue::default()).map_err(|error| error.to_string())
        };
        let known = "[rules.\"wandfluh-md2:control-mode-of-controller\"]\nseverity = \"off\"\n\
                     [[suppress]]\nrule = \"rexroth-sydfec:offset-before-gain\"\nreason = \"x\"\n";
        assert_eq!(check(known), Ok(()));
        let error =
            check("[rules.\"rexroth-sydfec:offset-before-gian\"]\nseverity = \"note\"\n").unwrap_err();
        let stated = "1:8: profile 'rexroth-sydfec' has no rule 'offset-before-gian'; did you mean \
                    'rexroth-sydfec:offset-before-gain'?";
        assert!(error.starts_with(stated), "{error}");
        let gap = |key: &str| format!("[rules.\"danfoss-pve-ci:avc-gap\"]\n{key}\n");
        assert_eq!(check(&gap("ms = 300")), Ok(()));
        let error = check(&gap("milliseconds = 300")).unwrap_err();
        let expected = "2:1: unknown key 'milliseconds' of danfoss-pve-ci:avc-gap; expected severity, ms";
        assert!(error.starts_with(expected), "{error}");
        let error = check(&gap("ms = 0")).unwrap_err();
        assert!(error.starts_with("2:1: ms must be greater than 0"), "{error}");
        let error = check("[[suppress]]\nrule = \"acme:x\"\nreason = \"x\"\n").unwrap_err();
        assert!(error.starts_with("2:8: unknown profile 'acme'"), "{error}");
    }

    #[test]
    fn what_does_not_exist_is_an_error_with_its_place() {
        let error = setup("[rules.sdo-no-respons]\nseverity = \"note\"\n").unwrap_err();
        assert!(error.starts_with("1:8: unknown rule 'sdo-no-respons'; did you mean 'sdo-no-response'?"));
        let error = setup("[rules.sdo-no-response]\nwarn = 3\n").unwrap_err();
        let expected = "2:1: unknown key 'warn' of sdo-no-response; expected severity, warning-ms";
        assert!(error.starts_with(expected), "{error}");
        let error = setup("[[suppress]]\nrule = \"nothing-like-it\"\nreason = \"x\"\n").unwrap_err();
        assert!(error.starts_with("2:8: unknown rule 'nothing-like-it'"), "{error}");
    }
}
