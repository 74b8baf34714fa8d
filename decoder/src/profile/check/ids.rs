//! Checks of the profile and variant ids, which options use as in `--node 5=ID:VARIANT`.

use serde::Deserialize;
use toml::Spanned;

use super::is_kebab;
use crate::profile::position::TextError;

/// The keys of a profile that this check needs.
#[derive(Deserialize)]
struct ProfileIds {
    id: Option<Spanned<String>>,
    #[serde(default)]
    variant: Vec<VariantIds>,
}

#[derive(Deserialize)]
struct VariantIds {
    id: Spanned<String>,
}

/// Reports ids that no option can name; `text` must parse as a profile.
pub fn check_ids(text: &str) -> Vec<TextError> {
    let Ok(ProfileIds { id, variant }) = toml::from_str::<ProfileIds>(text) else { return Vec::new() };
    let Some(id) = id else {
        return vec![TextError::at_place(text, 0..0, "id is missing; every profile requires one".to_owned())];
    };
    let all = std::iter::once(id).chain(variant.into_iter().map(|variant| variant.id));
    let wrong = all.filter(|id| !is_kebab(id.get_ref()));
    wrong
        .map(|id| {
            let message = format!("invalid id '{}'; expected a-z, 0-9 and hyphens", id.get_ref());
            TextError::at_place(text, id.span(), message)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(text: &str) -> Vec<String> {
        check_ids(text).iter().map(|it| format!("{}: {}", it.line, it.message)).collect()
    }

    #[test]
    fn ids_can_be_named_in_options() {
        assert_eq!(errors("id = \"acme-pump2\"\n[[variant]]\nid = \"a\"\n"), [""; 0]);
        for id in ["", "acme pump", "acme:pump", "Acme"] {
            let stated = format!("1: invalid id '{id}'; expected a-z, 0-9 and hyphens");
            assert_eq!(errors(&format!("id = \"{id}\"\n")), [stated]);
        }
        let stated = "3: invalid id 'B'; expected a-z, 0-9 and hyphens";
        assert_eq!(errors("id = \"a\"\n[[variant]]\nid = \"B\"\n"), [stated]);
        assert_eq!(errors("title = \"a\"\n"), ["1: id is missing; every profile requires one"]);
    }
}
