//! XDD and XDC (CiA 311).
//!
//! A `CANopenObject` has the properties of an EDS entry, either itself or by a `uniqueIDRef` to a `parameter`
//! of the application process. The `parameter` can follow later, so all elements are collected before they
//! are combined.

use super::code::element_type;
use super::problem::DescriptionProblems;
use super::xdd_object::{self, DescribedValue, Descriptions, RawObject};
use super::xml::{XmlElement, XmlParser, XmlToken};
use super::{DescriptionKind, DeviceDescriptionError, DeviceFile, LONGEST_VALUE, MOST_ENTRIES};
use crate::profile::quoted::quote_start;

/// Elements collected so far.
struct XddContent {
    file: DeviceFile,
    problems: DescriptionProblems,
    objects: Vec<RawObject>,
    descriptions: Descriptions,
    /// Nesting depth.
    depth: usize,
    /// Description in progress: its depth and `uniqueID`.
    open: Option<(usize, String, DescribedValue)>,
    /// Identity element in progress, and its line.
    identity: Option<(XddIdentity, usize)>,
    /// Text of the identity element so far.
    text: String,
}

#[derive(Debug, Clone, Copy)]
enum XddIdentity {
    VendorName,
    VendorId,
    ProductName,
    ProductId,
}

/// Parses an XDD or XDC.
pub(super) fn parse_xdd(text: &str) -> Result<DeviceFile, DeviceDescriptionError> {
    let mut content = XddContent {
        file: DeviceFile::new(DescriptionKind::Xdd),
        problems: DescriptionProblems::default(),
        objects: Vec::new(),
        descriptions: Descriptions::default(),
        depth: 0,
        open: None,
        identity: None,
        text: String::new(),
    };
    let mut xml = XmlParser::new(text);
    while let Some(token) = xml.next(&mut content.problems) {
        match token {
            XmlToken::Open(element) => content.begin_element(&element),
            XmlToken::Close => content.end_element(),
            XmlToken::Text(text) if content.identity.is_some() => content.text.push_str(&text),
            XmlToken::Text(_) => {}
        }
    }
    let XddContent { mut file, mut problems, objects, descriptions, .. } = content;
    if objects.is_empty() {
        return Err(DeviceDescriptionError::NoObject);
    }
    file.objects = xdd_object::convert_entries(&objects, &descriptions, &mut problems);
    if file.objects.iter().any(|object| object.value.is_some()) {
        file.kind = DescriptionKind::Xdc;
    }
    file.bit_rates.sort_unstable();
    file.bit_rates.dedup();
    file.complete_identity(&mut problems);
    file.problems = problems.finish();
    Ok(file)
}

impl XddContent {
    fn begin_element(&mut self, element: &XmlElement<'_>) {
        self.depth = self.depth.saturating_add(1);
        if self.open.is_some() {
            self.add_description(element);
            return;
        }
        match element.name() {
            name @ ("CANopenObject" | "CANopenSubObject") => {
                self.begin_object(name == "CANopenSubObject", element);
            }
            "parameter" | "parameterTemplate" | "array" | "derived" | "enum" | "varDeclaration" => {
                let attributes = element.read_attributes(&mut self.problems);
                let Some(id) = attributes.get("uniqueID") else { return };
                let described = DescribedValue {
                    access: attributes.get("access").map(str::to_owned),
                    reference: attributes.get("templateIDRef").map(str::to_owned),
                    ..DescribedValue::default()
                };
                self.open = Some((self.depth, id.to_owned(), described));
            }
            "vendorName" => self.identity = Some((XddIdentity::VendorName, element.line)),
            "vendorID" => self.identity = Some((XddIdentity::VendorId, element.line)),
            "productName" => self.identity = Some((XddIdentity::ProductName, element.line)),
            "productID" => self.identity = Some((XddIdentity::ProductId, element.line)),
            "supportedBaudRate" => {
                let attributes = element.read_attributes(&mut self.problems);
                self.file.bit_rates.extend(attributes.get("value").and_then(bit_rate));
            }
            "deviceCommissioning" | "DeviceCommissioning" => self.parse_commissioning(element),
            _ => {}
        }
    }

    fn begin_object(&mut self, is_sub: bool, element: &XmlElement<'_>) {
        let left_out = self.objects.len().checked_sub(MOST_ENTRIES);
        if left_out.is_none() {
            let attributes = element.read_attributes(&mut self.problems);
            self.objects.push(RawObject { is_sub, attributes, line: element.line });
            if self.objects.len() == MOST_ENTRIES {
                self.problems.add_problem(
                    element.line,
                    format!("objects after this one skipped (max {MOST_ENTRIES})"),
                );
            }
        }
    }

    /// Adds an element inside a description: data types from direct children, values from any depth.
    fn add_description(&mut self, element: &XmlElement<'_>) {
        let Some((depth, _, described)) = &mut self.open else { return };
        let is_child = depth.checked_add(1) == Some(self.depth);
        if is_child && let Some(data_type) = element_type(element.name()) {
            described.data_type.get_or_insert(data_type);
            return;
        }
        let (place, attribute) = match element.name() {
            "dataTypeIDRef" if is_child => (&mut described.reference, "uniqueIDRef"),
            "defaultValue" => (&mut described.default, "value"),
            "actualValue" => (&mut described.actual, "value"),
            "minValue" => (&mut described.low, "value"),
            "maxValue" => (&mut described.high, "value"),
            _ => return,
        };
        if place.is_none() {
            *place = element.read_attributes(&mut self.problems).get(attribute).map(str::to_owned);
        }
    }

    fn end_element(&mut self) {
        if let Some((depth, id, described)) = self.open.take() {
            if depth == self.depth {
                self.descriptions.entry(id).or_insert(described);
            } else {
                self.open = Some((depth, id, described));
            }
        }
        self.depth = self.depth.saturating_sub(1);
        let text = std::mem::take(&mut self.text);
        let text = text.trim();
        let Some((identity, line)) = self.identity.take().filter(|_| !text.is_empty()) else { return };
        match identity {
            XddIdentity::VendorName => set_name(&mut self.file.vendor_name, text),
            XddIdentity::ProductName => set_name(&mut self.file.product_name, text),
            XddIdentity::VendorId => self.file.vendor_id = self.parse_number(line, "vendorID", text),
            XddIdentity::ProductId => self.file.product_code = self.parse_number(line, "productID", text),
        }
    }

    /// Parses `deviceCommissioning` of an XDC.
    fn parse_commissioning(&mut self, element: &XmlElement<'_>) {
        self.file.kind = DescriptionKind::Xdc;
        let attributes = element.read_attributes(&mut self.problems);
        set_name(&mut self.file.node_name, attributes.get("nodeName").unwrap_or_default());
        self.file.bit_rate = attributes.get("actualBaudRate").and_then(bit_rate);
        let Some(text) = attributes.get("nodeID") else { return };
        let number = super::number::parse_integer(text).and_then(|found| u8::try_from(found.value).ok());
        self.file.node_id = number.filter(|id| (1..=127).contains(id));
        if self.file.node_id.is_none() {
            self.problems
                .add_problem(element.line, format!("nodeID {}: expected 1 to 127", quote_start(text)));
        }
    }

    fn parse_number(&mut self, line: usize, name: &str, text: &str) -> Option<u32> {
        let number = super::number::parse_integer(text).and_then(|found| u32::try_from(found.value).ok());
        if number.is_none() {
            self.problems
                .add_problem(line, format!("{name} {}: expected a 32-bit number", quote_start(text)));
        }
        number
    }
}

/// Stores the first non-empty name, limited in length.
fn set_name(place: &mut String, text: &str) {
    if place.is_empty() {
        *place = text.chars().take(LONGEST_VALUE).collect();
    }
}

/// Converts a bit rate such as `250 Kbps` to bit/s.
fn bit_rate(text: &str) -> Option<u32> {
    let digits = text.trim_end_matches(|letter: char| !letter.is_ascii_digit());
    let unit = text.strip_prefix(digits)?.trim();
    let factor = match unit.as_bytes().first()? {
        b'K' | b'k' => 1000,
        b'M' | b'm' => 1_000_000,
        _ => return None,
    };
    digits.parse::<u32>().ok()?.checked_mul(factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_identity_is_text_of_elements() {
        let file = parse_xdd(
            "<p><q1:vendorName> A &amp; B </q1:vendorName><vendorID>0x1F</vendorID><productName/><productID>x</productID>\
             <supportedBaudRate value='250 Kbps'/><CANopenObject index='2000' dataType='07'/></p>",
        )
        .unwrap();
        assert_eq!((file.vendor_name.as_str(), file.vendor_id), ("A & B", Some(31)));
        assert_eq!((file.product_name.as_str(), file.product_code), ("", None));
        assert_eq!(file.bit_rates, [250_000]);
        assert!(file.problems[0].reason.starts_with("productID \"x\""), "{:?}", file.problems);
    }

    #[test]
    fn bit_rates_have_a_unit() {
        assert_eq!(bit_rate("1000 Kbps"), Some(1_000_000));
        assert_eq!(bit_rate("1 Mbps"), Some(1_000_000));
        for text in ["auto-baudRate", "", "250", "99999999999 Kbps", "5000000 Kbps"] {
            assert_eq!(bit_rate(text), None, "{text}");
        }
    }
}
