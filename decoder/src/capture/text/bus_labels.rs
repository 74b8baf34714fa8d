//! Names of numbered buses, which our writers store in comments: `// bus 1: can0`.

use crate::capture::{MAX_BUS_NAME, MAX_BUSES};

/// Bus numbers of a capture with their names.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct BusLabels(Vec<(Vec<u8>, Vec<u8>)>);

impl BusLabels {
    /// Takes the text after `bus ` of a comment, such as `1: can0`. Later text about the same number is ignored, and text
    /// about a number that has already had a frame: a bus has one name.
    pub(in crate::capture) fn learn_label(&mut self, text: &[u8]) {
        let Some(colon) = memchr::memchr(b':', text) else { return };
        let (number, name) =
            (text.get(..colon).unwrap_or_default(), text.get(colon + 1..).unwrap_or_default());
        let name = name.trim_ascii();
        let is_number = !number.is_empty() && number.len() <= 3 && number.iter().all(u8::is_ascii_digit);
        if is_number && !name.is_empty() {
            self.add_label(number, name);
        }
    }

    /// Name of a number; the number itself if no comment names it.
    #[inline]
    pub(in crate::capture) fn name<'a>(&'a mut self, number: &'a [u8]) -> &'a [u8] {
        if let Some(at) = self.0.iter().position(|(known, _)| known == number) {
            return self.0.get(at).map_or(number, |(_, name)| name);
        }
        self.add_label(number, number);
        number
    }

    #[cold]
    fn add_label(&mut self, number: &[u8], name: &[u8]) {
        if self.0.len() < MAX_BUSES && self.0.iter().all(|(known, _)| known != number) {
            let cut = |bytes: &[u8]| bytes.get(..MAX_BUS_NAME).unwrap_or(bytes).to_vec();
            self.0.push((cut(number), cut(name)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_comment_before_the_first_frame_names_a_bus() {
        let mut labels = BusLabels::default();
        labels.learn_label(b"1: can0 ");
        labels.learn_label(b"1: other");
        for wrong in [&b"2"[..], b"2:", b": can2", b"two: can2", b"2222: can2"] {
            labels.learn_label(wrong);
        }
        assert_eq!(labels.name(b"1"), b"can0");
        assert_eq!(labels.name(b"2"), b"2");
        labels.learn_label(b"2: late");
        assert_eq!(labels.name(b"2"), b"2");
    }

    #[test]
    fn memory_is_bounded() {
        let mut labels = BusLabels::default();
        for number in 0..1_000 {
            labels.learn_label(format!("{number}: {}", "x".repeat(1_000)).as_bytes());
        }
        assert_eq!(labels.0.len(), MAX_BUSES);
        assert_eq!(labels.name(b"0").len(), MAX_BUS_NAME);
        assert_eq!(labels.name(b"999"), b"999");
    }
}
