//! JSON Schemas of answers, made from the types of the library and their doc comments.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Map, Value, json};
use syn::{Attribute, Expr, Fields, GenericArgument, Item, Lit, Meta, PathArguments, Type};

use crate::support::workspace;

/// Sources with the types of answers.
const SOURCES: [&str; 3] =
    ["decoder/src/answers", "decoder/src/sink/findings/records.rs", "decoder/src/sink/exact_json.rs"];

/// Values of a field, in the form of a schema: type, field, keyword, values.
pub type Choices<'a> = (&'a str, &'a str, &'a str, Vec<&'a str>);

/// All types of answers by name.
pub struct AnswerTypes {
    types: BTreeMap<String, Item>,
    is_closed: bool,
    choices: Vec<Choices<'static>>,
}

impl AnswerTypes {
    /// Reads the sources. `is_closed` forbids keys that are not in the schema.
    pub fn read(is_closed: bool, choices: &[Choices<'static>]) -> Self {
        let mut types = BTreeMap::new();
        for source in SOURCES {
            collect(&workspace().join(source), &mut types);
        }
        Self { types, is_closed, choices: choices.to_vec() }
    }

    /// The schema of a struct.
    pub fn object(&self, name: &str) -> Value {
        let Some(Item::Struct(item)) = self.types.get(name) else { panic!("{name}: unknown struct") };
        let (mut properties, mut required) = (Map::new(), Vec::new());
        let Fields::Named(fields) = &item.fields else { panic!("{name}: no named fields") };
        for field in &fields.named {
            let key = field.ident.as_ref().unwrap().to_string();
            let serde = serde_words(&field.attrs);
            if serde.contains(&"flatten".to_owned()) {
                let inner = self.value(&field.ty);
                properties.extend(inner["properties"].as_object().unwrap().clone());
                required.extend(inner["required"].as_array().unwrap().clone());
                continue;
            }
            let is_optional = serde.contains(&"skip_serializing_if".to_owned());
            let ty = if is_optional { argument(&field.ty, "Option").unwrap_or(&field.ty) } else { &field.ty };
            let mut value = self.value(ty);
            value["description"] = description(&field.attrs).into();
            for (_, _, keyword, words) in
                self.choices.iter().filter(|(ty, field, ..)| (*ty, *field) == (name, key.as_str()))
            {
                value[*keyword] = json!(words);
            }
            if !is_optional {
                required.push(key.clone().into());
            }
            properties.insert(key, value);
        }
        let is_open = !self.is_closed;
        json!({"type": "object", "required": required, "properties": properties, "additionalProperties": is_open})
    }

    fn value(&self, ty: &Type) -> Value {
        match ty {
            Type::Reference(reference) => self.value(&reference.elem),
            Type::Slice(slice) => json!({"type": "array", "items": self.value(&slice.elem)}),
            Type::Array(array) => {
                let Expr::Lit(length) = &array.len else { panic!("length of an array") };
                let Lit::Int(length) = &length.lit else { panic!("length of an array") };
                let length: u64 = length.base10_parse().unwrap();
                let items = self.value(&array.elem);
                json!({"type": "array", "items": items, "minItems": length, "maxItems": length})
            }
            Type::Path(path) => {
                let name = path.path.segments.last().unwrap().ident.to_string();
                self.named(&name, ty)
            }
            _ => panic!("type of a field"),
        }
    }

    fn named(&self, name: &str, ty: &Type) -> Value {
        match name {
            "String" | "str" => json!({"type": "string"}),
            "bool" => json!({"type": "boolean"}),
            "u8" | "u16" | "u32" | "u64" | "usize" => json!({"type": "integer", "minimum": 0}),
            "i64" => json!({"type": "integer"}),
            "f64" | "ExactNumber" => json!({"type": "number"}),
            "EventObject" => {
                let Some(Item::Struct(item)) = self.types.get(name) else { panic!("{name}: unknown") };
                json!({"type": "object", "required": ["frames", "kind"], "description": description(&item.attrs)})
            }
            "Option" => {
                let mut value = self.value(argument(ty, name).unwrap());
                let inner = value["type"].take();
                let inner = inner.as_array().cloned().unwrap_or_else(|| vec![inner]);
                value["type"] = inner.into_iter().chain(["null".into()]).collect();
                value
            }
            "Vec" => json!({"type": "array", "items": self.value(argument(ty, name).unwrap())}),
            "BTreeMap" => {
                json!({"type": "object", "additionalProperties": self.value(argument(ty, name).unwrap())})
            }
            _ => match self.types.get(name) {
                Some(Item::Enum(item)) => {
                    let fields = item.variants.iter().flat_map(|variant| &variant.fields);
                    let mut types: Vec<_> =
                        fields.map(|field| self.value(&field.ty)["type"].clone()).collect();
                    // An integer is a number.
                    types.retain(|ty| ty != "integer");
                    json!({"type": types})
                }
                _ => self.object(name),
            },
        }
    }
}

fn collect(path: &Path, types: &mut BTreeMap<String, Item>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).unwrap() {
            collect(&entry.unwrap().path(), types);
        }
        return;
    }
    let file = syn::parse_file(&fs::read_to_string(path).unwrap()).unwrap();
    for item in file.items {
        let name = match &item {
            Item::Struct(item) => item.ident.to_string(),
            Item::Enum(item) => item.ident.to_string(),
            _ => continue,
        };
        types.insert(name, item);
    }
}

/// The doc comment in one line, without its full stop.
fn description(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| match &attribute.meta {
        Meta::NameValue(meta) if meta.path.is_ident("doc") => match &meta.value {
            Expr::Lit(text) => match &text.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    });
    let text = lines.collect::<Vec<_>>().join(" ");
    text.trim_end_matches('.').replace("\\[", "[").replace("\\]", "]")
}

/// Names in `#[serde(…)]`.
fn serde_words(attributes: &[Attribute]) -> Vec<String> {
    let mut words = Vec::new();
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("serde")) {
        attribute
            .parse_nested_meta(|meta| {
                words.extend(meta.path.get_ident().map(ToString::to_string));
                if let Ok(value) = meta.value() {
                    value.parse::<Lit>()?;
                }
                Ok(())
            })
            .unwrap();
    }
    words
}

/// The last generic argument of a type of this name.
fn argument<'a>(ty: &'a Type, name: &str) -> Option<&'a Type> {
    let Type::Path(path) = ty else { return None };
    let segment = path.path.segments.last().filter(|segment| segment.ident == name)?;
    let PathArguments::AngleBracketed(arguments) = &segment.arguments else { return None };
    arguments.args.iter().rev().find_map(|argument| match argument {
        GenericArgument::Type(ty) => Some(ty),
        _ => None,
    })
}

/// Differences of a value from its schema, with the keys that it has in `seen`.
pub fn violations(value: &Value, schema: &Value, path: &str, seen: &mut Vec<String>) -> Vec<String> {
    let has_type = |name: &Value| match name.as_str().unwrap() {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "null" => value.is_null(),
        name => panic!("{name}: unknown type"),
    };
    let types = &schema["type"];
    if !types.as_array().map_or_else(|| has_type(types), |types| types.iter().any(has_type)) {
        return vec![format!("{path}: {value} is not {types}")];
    }
    let mut found = Vec::new();
    if let Some(words) = schema["enum"].as_array().filter(|words| !words.contains(value)) {
        found.push(format!("{path}: {value} is not one of {words:?}"));
    }
    if let Some(members) = value.as_object() {
        for key in schema["required"].as_array().into_iter().flatten() {
            if !members.contains_key(key.as_str().unwrap()) {
                found.push(format!("{path}: without {key}"));
            }
        }
        for (key, inner) in members {
            let place = format!("{path}.{key}");
            match (schema["properties"].get(key), &schema["additionalProperties"]) {
                (Some(own), _) => {
                    seen.push(place.clone());
                    found.extend(violations(inner, own, &place, seen));
                }
                (None, own) if own.is_object() => found.extend(violations(inner, own, &place, seen)),
                // Members of an event are in its own schema.
                (None, _) if schema.get("properties").is_none() => {}
                _ => found.push(format!("{place}: unknown key")),
            }
        }
    }
    let items = value.as_array().into_iter().flatten();
    found.extend(items.flat_map(|item| violations(item, &schema["items"], path, seen)));
    found
}
