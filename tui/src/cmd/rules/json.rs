//! All rules as one JSON array.

use serde_json::{Value, json};

use super::ListedRule;

/// The array with a line end.
pub(super) fn rules_json(rules: &[ListedRule]) -> String {
    let all: Vec<Value> = rules.iter().map(rule_record).collect();
    let text = serde_json::to_string_pretty(&all).unwrap_or_default();
    format!("{text}\n")
}

fn rule_record(rule: &ListedRule) -> Value {
    let tolerances = rule.tolerances.iter().map(|tolerance| {
        json!({
            "key": tolerance.key,
            "default": tolerance.default,
            "unit": tolerance.unit,
            "text": tolerance.text,
        })
    });
    let waivers = rule.waivers.iter().map(|(device, text)| json!({"device": device, "text": text}));
    json!({
        "name": rule.name,
        "severity": rule.severity.name(),
        "on": rule.is_on,
        "timing": rule.is_timing,
        "origin": rule.origin.name(),
        "title": rule.title,
        "explanation": rule.explanation,
        "tolerances": tolerances.collect::<Vec<_>>(),
        "cases": rule.cases,
        "source": rule.source,
        "note": rule.note,
        "variants": rule.variants,
        "waivers": waivers.collect::<Vec<_>>(),
    })
}
