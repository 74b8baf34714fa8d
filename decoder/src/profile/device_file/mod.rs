//! Parses device descriptions: EDS and DCF (CiA 306-1), XDD and XDC (CiA 311).
//!
//! A part that cannot be parsed is reported as a [`DescriptionProblem`] with its line; all other parts are used.
//! Assumptions (about a leading zero, a duplicate section) are also reported. Unambiguous deviations from the
//! standard are accepted: comments after values, spaces in keywords, empty values, missing `ObjectType`, any
//! letter case and line end.
//!
//! ```text
//! bytes ─text─▶ str ─┬─ini─▶ sections ─eds, object─▶ DeviceFile
//!                    └─xml─▶ elements ─xdd, xdd_object▶ DeviceFile
//! ```

mod code;
mod eds;
mod encode;
mod file;
mod ini;
mod limits;
mod number;
mod object;
mod problem;
mod section;
mod text;
mod value;
mod xdd;
mod xdd_object;
mod xml;

pub use code::EntryAccess;
pub use file::{DescriptionKind, DeviceDescriptionError, DeviceFile, DeviceObject};
pub(crate) use limits::LONGEST_VALUE;
pub use limits::{MOST_ENTRIES, MOST_PROBLEMS};
pub use problem::DescriptionProblem;
pub(super) use text::decode_text;
pub use value::EntryValue;

/// Parses an EDS, DCF, XDD or XDC; XML starts with `<`. The text is UTF-16 with a byte order mark, UTF-8 if
/// valid, otherwise Windows-1252. Time and memory are linear in the length of `bytes`.
///
/// # Errors
/// The file contains no part of a device description.
pub fn parse_device_file(bytes: &[u8]) -> Result<DeviceFile, DeviceDescriptionError> {
    let text = decode_text(bytes);
    match text.trim_start().chars().next() {
        None => Err(DeviceDescriptionError::Empty),
        Some('<') => xdd::parse_xdd(&text),
        Some(_) => eds::parse_eds(&text),
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn the_content_says_the_kind() {
        let kind = |text: &[u8]| parse_device_file(text).map(|file| file.kind);
        assert_eq!(kind(b"[FileInfo]"), Ok(DescriptionKind::Eds));
        assert_eq!(kind(b"[1000]\nDefaultValue=1\nParameterValue="), Ok(DescriptionKind::Eds));
        assert_eq!(kind(b"[1000]\nParameterValue=1"), Ok(DescriptionKind::Dcf));
        assert_eq!(kind(b"[DeviceCommissioning]"), Ok(DescriptionKind::Dcf));
        assert_eq!(kind(b"\xEF\xBB\xBF <x><CANopenObject index='1000'/></x>"), Ok(DescriptionKind::Xdd));
        assert_eq!(
            kind(b"<CANopenObject index='1000' dataType='7' actualValue='1'/>"),
            Ok(DescriptionKind::Xdc)
        );
        assert_eq!(kind(b" \r\n"), Err(DeviceDescriptionError::Empty));
        assert_eq!(kind(b"(1.0) can0 123#00"), Err(DeviceDescriptionError::NoSection));
        assert_eq!(kind(b"[section]\nkey=value"), Err(DeviceDescriptionError::NoSection));
        assert_eq!(kind(b"<html/>"), Err(DeviceDescriptionError::NoObject));
    }

    #[test]
    fn the_identity_is_completed_from_object_1018() {
        let file = parse_device_file(
            b"[DeviceInfo]\nVendorNumber=0\nProductNumber=2\nRevisionNumber=\n[1018sub1]\nDataType=7\nDefaultValue=0x36\n\
              [1018sub2]\nDataType=7\nDefaultValue=3\n[1018sub3]\nDataType=7\nDefaultValue=0",
        )
        .unwrap();
        assert_eq!((file.vendor_id, file.product_code, file.revision), (Some(0x36), Some(2), None));
        assert!(
            file.problems
                .iter()
                .any(|problem| problem.to_string().contains("product code 0x3 in object 1018"))
        );
    }

    #[test]
    fn a_file_that_asks_for_more_entries_than_there_can_be_gets_the_first() {
        let mut text = String::new();
        for index in 0x2000..0x2200 {
            write!(text, "[{index:04X}]\nDataType=5\nObjectType=8\nCompactSubObj=254\n").unwrap();
        }
        let file = parse_device_file(text.as_bytes()).unwrap();
        assert_eq!(file.objects.len(), MOST_ENTRIES);
        assert!(
            file.problems
                .iter()
                .any(|problem| problem.reason == "objects from 2101 on skipped (max 65536 entries)")
        );
        assert!(file.find_object(ObjectAddress::new(0x2101, 0)).is_some());
        assert!(file.find_object(ObjectAddress::new(0x2101, 1)).is_none());
    }
}
