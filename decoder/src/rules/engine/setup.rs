//! What is judged and how strictly: the rules there are, with what the bus file says of them.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::bus_file::{self, BusFile, RuleSettings, Suppression};
use crate::finding::{About, Group, RuleInfo, Severity, SuppressionUse};
use crate::profile::device::DeviceRule;
use crate::profile::{Catalogue, TextError};
use crate::query::fields::distance;
use crate::rules::declaration::Declaration;
use crate::rules::declarations;
use crate::rules::expectation::Expectation;
use crate::session::Bus;
use crate::wire::NodeId;

/// Rules, tolerances, suppressions.
#[derive(Debug, Clone)]
pub struct Setup {
    rules: Vec<RuleInfo>,
    severities: HashMap<String, Severity>,
    /// Rules of devices that are not to be judged.
    off: Vec<String>,
    tolerances: HashMap<(&'static str, &'static str), f64>,
    suppressions: Vec<Suppression>,
    today: Option<String>,
    /// Expectations with the places of their rules.
    expectations: Vec<(u16, Expectation)>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            rules: declarations().map(Declaration::info).collect(),
            severities: HashMap::new(),
            off: Vec::new(),
            tolerances: HashMap::new(),
            suppressions: Vec::new(),
            today: None,
            expectations: Vec::new(),
        }
    }
}

impl Setup {
    /// The rules with what `file`, read from `text`, says of them. `today` as `2026-01-31` ends suppressions
    /// that ran out.
    ///
    /// # Errors
    /// Rules and tolerances that do not exist, values that are none, expressions that cannot be understood; with the
    /// place in `text`.
    pub fn new(file: &BusFile, text: &str, today: Option<String>) -> Result<Self, TextError> {
        let mut setup = Self { suppressions: file.judgement.suppressions.clone(), today, ..Self::default() };
        for written in &file.judgement.expectations {
            setup.expect(written, text)?;
        }
        for settings in &file.judgement.rules {
            setup.take(settings, text)?;
        }
        for suppression in &setup.suppressions {
            let known = setup.knows(&suppression.rule);
            if !known {
                let message = setup.unknown(&suppression.rule);
                return Err(TextError::at(text, suppression.span.clone(), message));
            }
        }
        Ok(setup)
    }

    /// Whether there is such a rule, for who names it on the command line.
    ///
    /// # Errors
    /// There is none; the text says which are like it.
    pub fn check_name(&self, rule: &str) -> Result<(), String> {
        if self.knows(rule) { Ok(()) } else { Err(self.unknown(rule)) }
    }

    /// Holds what the bus file says of the rules of devices to the profiles there are.
    ///
    /// # Errors
    /// Profiles, rules and tolerances that do not exist, with the place in `text`.
    pub fn check_devices(&self, file: &BusFile, text: &str, catalogue: &Catalogue) -> Result<(), TextError> {
        for settings in &file.judgement.rules {
            check_tolerances(settings, catalogue, text)?;
        }
        let settings = file.judgement.rules.iter().map(|one| (&one.rule, &one.span));
        let suppressed = self.suppressions.iter().map(|one| (&one.rule, &one.span));
        for (rule, span) in settings.chain(suppressed) {
            if let Some((profile, name)) = rule.split_once(':') {
                device_rule(catalogue, profile, name)
                    .map(|_| ())
                    .map_err(|message| TextError::at(text, span.clone(), message))?;
            }
        }
        Ok(())
    }

    fn expect(&mut self, written: &bus_file::Expectation, text: &str) -> Result<(), TextError> {
        let expectation = Expectation::compile(written, text)?;
        let id = &written.id;
        let place = u16::try_from(self.rules.len()).ok().filter(|_| !self.knows(&id.text));
        let Some(place) = place else {
            let message = format!("'{}' is the name of a rule already", id.text);
            return Err(TextError::at(text, id.span.clone(), message));
        };
        self.rules.push(expectation.info().clone());
        self.expectations.push((place, expectation));
        Ok(())
    }

    /// A name with a colon is a device's rule, which is known once the device is.
    fn knows(&self, rule: &str) -> bool {
        rule.contains(':') || self.rules.iter().any(|known| *known.name == *rule)
    }

    fn unknown(&self, rule: &str) -> String {
        let near = self.rules.iter().map(|known| &*known.name).find(|known| is_near(known, rule));
        match near {
            Some(near) => format!("there is no rule '{rule}'; did you mean '{near}'?"),
            None => format!("there is no rule '{rule}': cobscope rules lists all"),
        }
    }

    fn take(&mut self, settings: &RuleSettings, text: &str) -> Result<(), TextError> {
        let wrong =
            |span: &std::ops::Range<usize>, message: String| TextError::at(text, span.clone(), message);
        let name = settings.rule.as_str();
        if !self.knows(name) {
            return Err(wrong(&settings.span, self.unknown(name)));
        }
        if let Some(severity) = settings.severity {
            if let Some(rule) = self.rules.iter_mut().find(|rule| *rule.name == *name) {
                rule.is_on = severity.is_some();
                rule.severity = severity.unwrap_or(rule.severity);
            } else if severity.is_none() {
                self.off.push(name.to_owned());
            }
            self.severities.extend(severity.map(|severity| (name.to_owned(), severity)));
        }
        // Those of a device's rule are known with its profile.
        if name.contains(':') {
            return Ok(());
        }
        let declaration = declarations().find(|declaration| declaration.name == name);
        for (key, span, value) in &settings.tolerances {
            let tolerances = declaration.map_or(&[][..], |declaration| declaration.tolerances);
            let known = tolerances.iter().find(|tolerance| tolerance.key == key).zip(declaration);
            let Some((tolerance, declaration)) = known else {
                let keys: Vec<_> = tolerances.iter().map(|tolerance| tolerance.key).collect();
                return Err(wrong(span, no_tolerance(name, &keys, key)));
            };
            self.tolerances.insert((declaration.name, tolerance.key), *value);
        }
        Ok(())
    }

    /// All rules.
    pub fn rules(&self) -> &[RuleInfo] {
        &self.rules
    }

    /// Expectations about a bus, with the places of their rules.
    pub(in crate::rules) fn expectations_on(&self, bus: &str) -> impl Iterator<Item = (u16, &Expectation)> {
        let all = self.expectations.iter().filter(move |(_, one)| one.is_about(bus));
        all.map(|(place, one)| (*place, one))
    }

    /// Expectations about none of these buses, with the places of their rules and the bus they are about.
    pub(in crate::rules) fn expectations_elsewhere(
        &self,
        buses: &[Bus],
    ) -> impl Iterator<Item = (u16, &str)> {
        let all = self.expectations.iter().filter_map(|(place, one)| Some((*place, one.bus()?)));
        all.filter(|(_, own)| buses.iter().all(|bus| bus.name() != *own))
    }

    /// A tolerance of a rule: what the bus file says, else its default.
    pub fn tolerance(&self, declaration: &Declaration, key: &'static str) -> f64 {
        let given = self.tolerances.get(&(declaration.name, key)).copied();
        let default = declaration.tolerances.iter().find(|tolerance| tolerance.key == key);
        given.or(default.map(|tolerance| tolerance.default)).unwrap_or(f64::INFINITY)
    }

    /// A tolerance in milliseconds, as nanoseconds.
    pub fn nanoseconds(&self, declaration: &Declaration, key: &'static str) -> i64 {
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let value = (self.tolerance(declaration, key) * 1e6) as i64;
        value
    }

    /// The severity the bus file gives a rule.
    pub(in crate::rules) fn severity(&self, rule: &str) -> Option<Severity> {
        self.severities.get(rule).copied()
    }

    /// Whether the bus file switches a device's rule off.
    pub(in crate::rules) fn is_off(&self, rule: &str) -> bool {
        self.off.iter().any(|off| off == rule)
    }

    /// Why a group does not count.
    pub(in crate::rules) fn suppression(&self, group: &Group) -> Option<Arc<str>> {
        let mut all = self.suppressions.iter().filter(|one| !self.is_over(one));
        all.find(|one| covers(one, group)).map(|one| Arc::clone(&one.reason))
    }

    fn is_over(&self, suppression: &Suppression) -> bool {
        // Dates as 2026-01-31 sort as text.
        matches!((&suppression.until, &self.today), (Some(until), Some(today)) if until < today)
    }

    /// What each suppression came to.
    pub(in crate::rules) fn uses(&self, groups: &[Group]) -> Vec<SuppressionUse> {
        let uses = self.suppressions.iter().map(|one| {
            let is_over = self.is_over(one);
            let met = if is_over { 0 } else { groups.iter().filter(|group| covers(one, group)).count() };
            let ended = one.until.clone().filter(|_| is_over);
            SuppressionUse { what: what(one), reason: Arc::clone(&one.reason), ended, met }
        });
        uses.collect()
    }
}

/// `node-lost of can0 node 5 1018:01`.
fn what(suppression: &Suppression) -> String {
    let node = suppression.node.map(NodeId::words);
    let parts = [suppression.bus.clone(), node, suppression.about.clone()];
    let of: Vec<_> = parts.into_iter().flatten().collect();
    let of = if of.is_empty() { String::new() } else { format!(" of {}", of.join(" ")) };
    format!("{}{of}", suppression.rule)
}

fn covers(suppression: &Suppression, group: &Group) -> bool {
    *suppression.rule == *group.rule
        && suppression.bus.as_deref().is_none_or(|bus| *bus == *group.bus)
        && suppression.node.is_none_or(|node| group.key.node == Some(node))
        && suppression.about.as_deref().is_none_or(|about| is_about(&group.key.about, about))
}

/// Whether it is what a user writes so: objects in any of their notations, codes and identifiers with `0x` or without.
fn is_about(about: &About, written: &str) -> bool {
    let bare = written.strip_prefix("0x").unwrap_or(written);
    match about {
        About::Object(object) => written.parse() == Ok(*object),
        About::Code(_) | About::Id(_) => about.to_string().eq_ignore_ascii_case(bare),
        _ => about.to_string() == written,
    }
}

fn no_tolerance(rule: &str, keys: &[&str], key: &str) -> String {
    let has = if keys.is_empty() { "no tolerance".to_owned() } else { keys.join(", ") };
    format!("{rule} has severity and {has}, not '{key}'")
}

/// Holds the numbers that are set of a device's rule to those it has.
fn check_tolerances(settings: &RuleSettings, catalogue: &Catalogue, text: &str) -> Result<(), TextError> {
    let Some((profile, name)) = settings.rule.split_once(':') else { return Ok(()) };
    let rule = device_rule(catalogue, profile, name)
        .map_err(|message| TextError::at(text, settings.span.clone(), message))?;
    let keys: Vec<_> = rule.tolerances().collect();
    for (key, span, value) in &settings.tolerances {
        let message = if !keys.contains(&key.as_str()) {
            no_tolerance(&settings.rule, &keys, key)
        } else if *value <= 0.0 {
            format!("{key} is more than 0")
        } else {
            continue;
        };
        return Err(TextError::at(text, span.clone(), message));
    }
    Ok(())
}

/// A rule of a profile, in any of its variants.
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

/// Whether two names differ by a letter or two, or one begins the other.
fn is_near(known: &str, given: &str) -> bool {
    given.len() > 3 && (known.starts_with(given) || given.starts_with(known)) || distance(known, given) <= 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::canopen::ObjectAddress;

    fn setup(text: &str) -> Result<Setup, String> {
        let file = BusFile::parse(text).map_err(|error| error.to_string())?;
        Setup::new(&file, text, Some("2026-06-01".into())).map_err(|error| error.to_string())
    }

    #[test]
    fn severities_and_tolerances_are_taken_by_name() {
        let setup = setup("[rules.sdo-no-response]\nseverity = \"note\"\nwarning-ms = 300\n").unwrap();
        let declaration = declarations().find(|rule| rule.name == "sdo-no-response").unwrap();
        assert_eq!(setup.nanoseconds(declaration, "warning-ms"), 300_000_000);
        assert_eq!(setup.severity("sdo-no-response"), Some(Severity::Note));
    }

    #[test]
    fn what_a_suppression_is_about_is_written_as_people_do() {
        let object = About::Object(ObjectAddress::new(0x5208, 2));
        for written in ["5208:02", "5208:2", "0x5208:02", "5208sub2"] {
            assert!(is_about(&object, written), "{written}");
        }
        assert!(!is_about(&object, "5208"));
        for written in ["FF10", "ff10", "0xFF10"] {
            assert!(is_about(&About::Code(0xFF10), written), "{written}");
        }
        assert!(is_about(&About::Name("lamp".into()), "lamp") && !is_about(&About::Whole, "5208:02"));
    }

    #[test]
    fn rules_of_devices_are_those_of_the_profiles() {
        let check = |text: &str| {
            let file = BusFile::parse(text).unwrap();
            let setup = Setup::new(&file, text, None).unwrap();
            setup.check_devices(&file, text, &Catalogue::default()).map_err(|error| error.to_string())
        };
        let known = "[rules.\"wandfluh-md2:control-mode-of-controller\"]\nseverity = \"off\"\n\
                     [[suppress]]\nrule = \"rexroth-sydfec:offset-before-gain\"\nreason = \"x\"\n";
        assert_eq!(check(known), Ok(()));
        let error =
            check("[rules.\"rexroth-sydfec:offset-before-gian\"]\nseverity = \"note\"\n").unwrap_err();
        let said = "1:8: profile 'rexroth-sydfec' has no rule 'offset-before-gian'; did you mean \
                    'rexroth-sydfec:offset-before-gain'?";
        assert!(error.starts_with(said), "{error}");
        let gap = |key: &str| format!("[rules.\"danfoss-pve-ci:avc-gap\"]\n{key}\n");
        assert_eq!(check(&gap("ms = 300")), Ok(()));
        let error = check(&gap("milliseconds = 300")).unwrap_err();
        assert!(
            error.starts_with("2:1: danfoss-pve-ci:avc-gap has severity and ms, not 'milliseconds'"),
            "{error}"
        );
        let error = check(&gap("ms = 0")).unwrap_err();
        assert!(error.starts_with("2:1: ms is more than 0"), "{error}");
        let error = check("[[suppress]]\nrule = \"acme:x\"\nreason = \"x\"\n").unwrap_err();
        assert!(error.starts_with("2:8: there is no profile 'acme'"), "{error}");
    }

    #[test]
    fn what_does_not_exist_is_an_error_with_its_place() {
        let error = setup("[rules.sdo-no-respons]\nseverity = \"note\"\n").unwrap_err();
        assert!(error.starts_with("1:8: there is no rule 'sdo-no-respons'; did you mean 'sdo-no-response'?"));
        let error = setup("[rules.sdo-no-response]\nwarn = 3\n").unwrap_err();
        assert!(error.starts_with("2:1: sdo-no-response has severity and warning-ms"), "{error}");
        let error = setup("[[suppress]]\nrule = \"nothing-like-it\"\nreason = \"x\"\n").unwrap_err();
        assert!(error.starts_with("2:8: there is no rule 'nothing-like-it'"), "{error}");
    }
}
