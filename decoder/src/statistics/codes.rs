//! Occurrences of error codes.

/// Maximum number of codes counted separately, per kind and node.
pub const MOST_CODES: usize = 64;

/// Occurrences per code, for up to [`MOST_CODES`] codes.
#[derive(Debug, Clone, Default)]
pub struct CodeCounts {
    /// Codes with their number of occurrences.
    pub codes: Vec<(u32, u64)>,
    /// Number of occurrences of further codes.
    pub others: u64,
}

impl CodeCounts {
    /// Counts an occurrence.
    pub fn count_code(&mut self, code: u32) {
        let has_room = self.codes.len() < MOST_CODES;
        match self.codes.iter_mut().find(|(known, _)| *known == code) {
            Some((_, count)) => *count += 1,
            None if has_room => self.codes.push((code, 1)),
            None => self.others += 1,
        }
    }

    /// Number of occurrences of all codes.
    pub fn total_count(&self) -> u64 {
        self.codes.iter().map(|(_, count)| count).sum::<u64>().saturating_add(self.others)
    }

    /// Codes with their number of occurrences, most frequent first.
    pub fn sort_by_count(&self) -> Vec<(u32, u64)> {
        let mut codes = self.codes.clone();
        codes.sort_by_key(|(code, count)| (std::cmp::Reverse(*count), *code));
        codes
    }
}

/// Key of a J1939 diagnostic trouble code: SPN, and FMI in the lowest five bits.
pub const fn dtc_key(spn: u32, fmi: u8) -> u32 {
    spn << 5 | (fmi & 0x1F) as u32
}

/// SPN and FMI of a key.
pub const fn dtc_of_key(key: u32) -> (u32, u8) {
    (key >> 5, (key & 0x1F).to_le_bytes()[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trouble_code_is_one_number() {
        assert_eq!(dtc_of_key(dtc_key(0x7_FFFF, 31)), (0x7_FFFF, 31));
        assert_eq!(dtc_of_key(dtc_key(298_985, 19)), (298_985, 19));
    }
}
