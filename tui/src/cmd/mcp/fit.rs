//! Answers of a limited size: the longest lists are shortened, and the answer states it.

use cobscope_decoder::sink::escape_json;
use serde_json::{Map, Value, json};

/// Maximum length of a text in bytes, as it is written inside of an answer. With the rest of the answer it stays below
/// 64 KiB.
pub(super) const LONGEST: usize = 63 * 1024;

/// Elements of a list that is shortened last.
const FEW: usize = 8;

/// The value as JSON text that fits. Omitted elements are counted in `omitted`, by the path of their list; texts that are
/// too long end with `…`.
pub(super) fn fit_value(value: Value) -> String {
    fit_within(value, LONGEST)
}

/// The value as JSON text of at most `longest` bytes as it is written.
pub(super) fn fit_within(mut value: Value, longest: usize) -> String {
    loop {
        let text = escape_json(&value.to_string()).into_owned();
        if json_length(&text) <= longest {
            return text;
        }
        if !shorten_longest(&mut value) {
            return json!({"omitted": "the answer is too long"}).to_string();
        }
    }
}

/// The text, cut to the limit.
pub(super) fn fit_text(text: &str) -> String {
    let mut text = escape_json(text).into_owned();
    while json_length(&text) > LONGEST {
        text.truncate(text.floor_char_boundary(text.len().saturating_mul(9) / 10));
        text.push('…');
    }
    text
}

/// Length of a text as a JSON string.
pub(super) fn json_length(text: &str) -> usize {
    Value::from(text).to_string().len()
}

/// Halves the longest list or text; false if nothing is left to shorten.
fn shorten_longest(value: &mut Value) -> bool {
    let mut longest = LongestFit::default();
    longest.visit_value(value, &mut Vec::new());
    let Some((path, _)) = longest.found else { return false };
    let pointer =
        path.iter().fold(String::new(), |all, step| all + "/" + &step.replace('~', "~0").replace('/', "~1"));
    let dropped = match value.pointer_mut(&pointer) {
        Some(Value::Array(list)) => {
            let keep = list.len() / 2;
            let dropped = list.len().saturating_sub(keep);
            list.truncate(keep);
            dropped
        }
        Some(Value::String(text)) => {
            let kept: String = text.chars().take(text.chars().count() / 2).collect();
            *text = kept + "…";
            0
        }
        _ => return false,
    };
    if dropped > 0
        && let Some(members) = value.as_object_mut()
    {
        count_dropped(members, &path.join("."), dropped);
    }
    true
}

fn count_dropped(members: &mut Map<String, Value>, path: &str, dropped: usize) {
    let omitted = members.entry("omitted").or_insert_with(|| json!({}));
    if let Some(omitted) = omitted.as_object_mut() {
        let before = omitted.get(path).and_then(Value::as_u64).unwrap_or(0);
        omitted.insert(path.to_owned(), json!(before.saturating_add(dropped as u64)));
    }
}

/// Search for the list or text with the longest JSON text.
#[derive(Default)]
struct LongestFit {
    found: Option<(Vec<String>, usize)>,
}

impl LongestFit {
    fn visit_value(&mut self, value: &Value, path: &mut Vec<String>) {
        match value {
            Value::Array(list) => {
                // A short list, as that of the buses, is rather kept than the lists in it.
                let weight = if list.len() > FEW { 64 } else { 1 };
                if list.len() > 1 {
                    self.offer_path(path, value.to_string().len().saturating_mul(weight));
                }
                for (index, value) in list.iter().enumerate() {
                    path.push(index.to_string());
                    self.visit_value(value, path);
                    path.pop();
                }
            }
            Value::Object(members) => {
                for (key, value) in members.iter().filter(|(key, _)| *key != "omitted") {
                    path.push(key.clone());
                    self.visit_value(value, path);
                    path.pop();
                }
            }
            Value::String(text) if text.chars().count() > 1_000 => {
                self.offer_path(path, text.len().saturating_mul(64));
            }
            _ => {}
        }
    }

    fn offer_path(&mut self, path: &[String], length: usize) {
        if self.found.as_ref().is_none_or(|(_, longest)| length > *longest) {
            self.found = Some((path.to_vec(), length));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_answers_are_unchanged() {
        let value = json!({"a": [1, 2, 3], "b": "text"});
        assert_eq!(fit_value(value.clone()), value.to_string());
        assert_eq!(fit_text("text"), "text");
    }

    #[test]
    fn long_lists_are_shortened_and_counted() {
        let value = json!({"few": [1, 2], "inner": {"many": vec!["0123456789"; 10_000]}});
        let text = fit_value(value);
        assert!(json_length(&text) <= LONGEST && json_length(&text) > LONGEST / 4, "{}", text.len());
        let value: Value = serde_json::from_str(&text).unwrap();
        let kept = value["inner"]["many"].as_array().unwrap().len();
        assert_eq!(value["omitted"]["inner.many"], 10_000 - kept);
        assert_eq!(value["few"], json!([1, 2]));
    }

    #[test]
    fn a_long_text_is_cut_between_characters() {
        let text = fit_text(&"ü\u{1b}".repeat(100_000));
        assert!(json_length(&text) <= LONGEST && text.ends_with('…'));
        let value: Value = serde_json::from_str(&fit_value(json!({"text": "ü".repeat(100_000)}))).unwrap();
        assert!(value["text"].as_str().unwrap().ends_with('…'));
    }

    #[test]
    fn keys_with_any_characters_are_found() {
        let value = json!({"a/b~c": vec![0; 100_000]});
        let value: Value = serde_json::from_str(&fit_value(value)).unwrap();
        assert!(!value["a/b~c"].as_array().unwrap().is_empty());
        let keys: Map<String, Value> = (0..100_000).map(|key| (key.to_string(), json!(0))).collect();
        assert_eq!(fit_value(Value::Object(keys)), r#"{"omitted":"the answer is too long"}"#);
    }
}
