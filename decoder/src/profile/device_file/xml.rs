//! Parses XML into elements and text, up to the first syntax error.
//!
//! The document type is ignored: only the five entities of XML itself and character references are resolved,
//! so that no entity can expand without limit or load another file.

use memchr::memchr_iter;
use quick_xml::XmlVersion;
use quick_xml::escape::resolve_xml_entity;
use quick_xml::events::{BytesRef, BytesStart, Event};
use quick_xml::reader::Reader;

use super::problem::DescriptionProblems;
use crate::profile::quoted::quote_start;

/// Token of an XML document.
#[derive(Debug)]
pub(super) enum XmlToken<'a> {
    /// Start of an element; an empty element is followed by `Close`.
    Open(XmlElement<'a>),
    /// End of the innermost open element.
    Close,
    /// Part of the text.
    Text(String),
}

/// Start tag of an element.
#[derive(Debug)]
pub(super) struct XmlElement<'a> {
    tag: BytesStart<'a>,
    /// Line of the tag, from 1.
    pub(super) line: usize,
}

/// Attributes in document order, names without prefix.
#[derive(Debug, Default)]
pub(super) struct XmlAttributes(Vec<(String, String)>);

/// Parser with the current position and line.
pub(super) struct XmlParser<'a> {
    text: &'a str,
    reader: Reader<&'a [u8]>,
    counted: usize,
    line: usize,
}

impl<'a> XmlParser<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        let mut reader = Reader::from_str(text);
        let config = reader.config_mut();
        config.expand_empty_elements = true;
        // End tags are counted, not compared, so that a wrong name has no further effect.
        config.check_end_names = false;
        config.allow_unmatched_ends = true;
        config.allow_dangling_amp = true;
        Self { text, reader, counted: 0, line: 1 }
    }

    /// Next token; `None` at the end, or at a syntax error, which is reported.
    pub(super) fn next(&mut self, problems: &mut DescriptionProblems) -> Option<XmlToken<'a>> {
        loop {
            let start = self.reader.buffer_position();
            match self.reader.read_event() {
                Ok(Event::Start(tag) | Event::Empty(tag)) => {
                    let line = self.line_at(start);
                    return Some(XmlToken::Open(XmlElement { tag, line }));
                }
                Ok(Event::End(_)) => return Some(XmlToken::Close),
                Ok(Event::Text(text)) => return Some(XmlToken::Text(text.into_inner().into_owned())),
                Ok(Event::CData(text)) => return Some(XmlToken::Text(text.into_inner().into_owned())),
                Ok(Event::GeneralRef(reference)) => {
                    return Some(XmlToken::Text(self.resolve_reference(&reference, problems)));
                }
                Ok(Event::DocType(_)) => {
                    let line = self.line_at(start);
                    problems.add_problem(line, "document type ignored: its entities are not resolved");
                }
                Ok(Event::Comment(_) | Event::Decl(_) | Event::PI(_)) => {}
                Ok(Event::Eof) => return None,
                Err(error) => {
                    let line = self.line_at(self.reader.error_position());
                    problems.add_problem(line, format!("rest of the file skipped: {error}"));
                    return None;
                }
            }
        }
    }

    /// Line of a byte, from 1. Positions only increase, so each byte is examined once.
    fn line_at(&mut self, position: u64) -> usize {
        let position = usize::try_from(position).unwrap_or(usize::MAX).min(self.text.len());
        if let Some(passed) = self.text.as_bytes().get(self.counted..position) {
            self.line = self.line.saturating_add(memchr_iter(b'\n', passed).count());
            self.counted = position;
        }
        self.line
    }

    fn resolve_reference(&mut self, reference: &BytesRef<'_>, problems: &mut DescriptionProblems) -> String {
        if let Ok(Some(character)) = reference.resolve_char_ref() {
            return character.to_string();
        }
        resolve_xml_entity(reference).map_or_else(
            || {
                let line = self.line_at(self.reader.buffer_position());
                problems.add_problem(
                    line,
                    format!("{}: unknown XML entity; not resolved", quote_start(reference)),
                );
                format!("&{};", &**reference)
            },
            str::to_owned,
        )
    }
}

impl XmlElement<'_> {
    /// Name without namespace prefix.
    pub(super) fn name(&self) -> &str {
        self.tag.local_name().into_inner()
    }

    /// All attributes; reports invalid ones.
    pub(super) fn read_attributes(&self, problems: &mut DescriptionProblems) -> XmlAttributes {
        let mut found = Vec::new();
        // A check for duplicates would take quadratic time.
        for attribute in self.tag.attributes().with_checks(false) {
            let attribute = match attribute {
                Ok(attribute) => attribute,
                Err(error) => {
                    problems.add_problem(self.line, format!("<{}>: {error}", self.name()));
                    continue;
                }
            };
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).unwrap_or_else(|error| {
                problems.add_problem(self.line, format!("{}: {error}", quote_start(&attribute.value)));
                attribute.value.clone()
            });
            found.push((attribute.key.local_name().into_inner().to_owned(), value.into_owned()));
        }
        XmlAttributes(found)
    }
}

impl XmlAttributes {
    /// Trimmed value of an attribute, with its name in any letter case; `None` if empty.
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        let (_, value) = self.0.iter().find(|(key, _)| key.eq_ignore_ascii_case(name))?;
        Some(value.trim()).filter(|value| !value.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;

    fn read(text: &str) -> (String, Vec<String>) {
        let mut problems = DescriptionProblems::default();
        let mut xml = XmlParser::new(text);
        let mut shown = String::new();
        while let Some(token) = xml.next(&mut problems) {
            match token {
                XmlToken::Open(element) => {
                    let value = element.read_attributes(&mut problems);
                    write!(shown, "<{}:{} {:?}>", element.name(), element.line, value.get("A")).unwrap();
                }
                XmlToken::Close => shown += "</>",
                XmlToken::Text(text) => shown += &text,
            }
        }
        (shown, problems.finish().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn elements_text_and_the_five_entities() {
        let (shown, problems) =
            read("<?xml version='1.0'?><!-- x --><q:p>\n<e a=' 1 &amp; &#x41; '/>a&lt;b&#66;</q:p>");
        assert_eq!(shown, "<p:1 None>\n<e:2 Some(\"1 & A\")></>a<bB</>");
        assert!(problems.is_empty(), "{problems:?}");
    }

    #[test]
    fn declared_entities_stay_as_they_are() {
        let (shown, problems) = read(
            "<!DOCTYPE p [<!ENTITY e SYSTEM \"file:///etc/passwd\"><!ENTITY f \"&e;&e;\">]>\n<p a='&f;'>&e;</p>",
        );
        assert_eq!(shown, "\n<p:2 Some(\"&f;\")>&e;</>");
        assert_eq!(problems.len(), 3, "{problems:?}");
        assert!(problems[0].starts_with("line 1: document type ignored"), "{problems:?}");
    }

    #[test]
    fn broken_xml_is_read_to_where_it_breaks() {
        let (shown, problems) = read("<p>\n<e a='1'></x></p></p>\n<f a=1 b");
        assert_eq!(shown, "<p:1 None>\n<e:2 Some(\"1\")></></></>\n");
        assert_eq!(problems.len(), 1, "{problems:?}");
        assert!(problems[0].starts_with("line 3: rest of the file skipped"), "{problems:?}");
    }
}
