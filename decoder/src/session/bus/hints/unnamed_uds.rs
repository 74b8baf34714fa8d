//! Detects UDS between 11-bit identifiers missing from the bus file, by requests and matching responses.
//!
//! A false pair costs more than a missing one: a request identifier has one response identifier and vice versa,
//! and at least half of its requests must be answered.

use std::fmt;

use crate::frame::{CanId, Frame};
use crate::profile;
use crate::wire::isotp::{self, IsoTpFrame};
use crate::words::count_noun;

/// Max pairs of identifiers counted; more pairs match only by chance.
const MOST_PAIRS: usize = 32;

/// Matching responses after which chance is ruled out.
const ENOUGH: u32 = 2;

/// Offset from request to response SID, and SID of a negative response (ISO 14229-1 §8.3, §8.7).
const ANSWER: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

/// Tester present, which is often sent without a response (ISO 14229-1 §9.6).
const TESTER_PRESENT: u8 = 0x3E;

/// Services of KWP 2000 that UDS has replaced: read and write by local identifier (ISO 14230-3), and read ECU
/// identification.
const KWP: [u8; 3] = [0x1A, 0x21, 0x3B];

/// Pairs of identifiers with UDS-like traffic.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct UdsSuspects {
    /// Last request: identifier and service.
    asked: Option<(CanId, u8)>,
    /// Requests per identifier.
    requests: Vec<(CanId, u32)>,
    pairs: Vec<UdsPairHint>,
}

/// Identifiers of requests and their responses that no bus file names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UdsPairHint {
    /// Identifier of the requests.
    pub request: CanId,
    /// Identifier of the responses.
    pub response: CanId,
    /// Number of matching responses.
    pub answers: u32,
}

/// Prints the pair with its line for the bus file.
impl fmt::Display for UdsPairHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { request, response, answers } = self;
        let times = count_noun(*answers, "time");
        write!(
            f,
            "{response} responds to {request} like a UDS server ({times}); to decode, add to a bus file (--bus): \
             uds = [{{ request = \"{request}\", response = \"{response}\" }}]"
        )
    }
}

impl UdsSuspects {
    /// Evaluates a frame that belongs to no service.
    pub(in crate::session) fn take_frame(&mut self, frame: &Frame) {
        let data = frame.data();
        let Ok(IsoTpFrame::Single { data } | IsoTpFrame::First { data, .. }) = isotp::parse(data, data.len())
        else {
            return;
        };
        let Some(service) = data.first().copied() else { return };
        if let Some((request, asked)) = self.asked.filter(|(request, _)| *request != frame.id)
            && (service == asked | ANSWER || matches!(data, [NEGATIVE, refused, _] if *refused == asked))
        {
            return self.count_response(request, frame.id);
        }
        let is_known = || profile::uds_names().service_by_id(service).is_some_and(|known| !known.is_obd());
        if service & ANSWER == 0 && (KWP.contains(&service) || is_known()) {
            self.asked = Some((frame.id, service));
            let is_suppressed =
                matches!(data, [TESTER_PRESENT, sub_function, ..] if sub_function & 0x80 != 0);
            if !is_suppressed {
                self.count_request(frame.id);
            }
        }
    }

    fn count_request(&mut self, request: CanId) {
        let has_room = self.requests.len() < MOST_PAIRS;
        match self.requests.iter_mut().find(|(id, _)| *id == request) {
            Some((_, count)) => *count = count.saturating_add(1),
            None if has_room => self.requests.push((request, 1)),
            None => {}
        }
    }

    fn count_response(&mut self, request: CanId, response: CanId) {
        // Another response to the same request would be that of another server.
        self.asked = None;
        let has_room = self.pairs.len() < MOST_PAIRS;
        let known = self.pairs.iter_mut().find(|pair| (pair.request, pair.response) == (request, response));
        match known {
            Some(pair) => pair.answers = pair.answers.saturating_add(1),
            None if has_room => {
                self.pairs.push(UdsPairHint { request, response, answers: 1 });
            }
            None => {}
        }
    }

    /// All pairs with enough responses, the most frequent first.
    pub(in crate::session) fn pair_hints(&self) -> Vec<UdsPairHint> {
        let asked = |id| self.requests.iter().find(|(known, _)| *known == id).map_or(0, |(_, count)| *count);
        let is_enough = |pair: &UdsPairHint| {
            pair.answers >= ENOUGH && pair.answers.saturating_mul(2) >= asked(pair.request)
        };
        let mut pairs: Vec<_> = self.pairs.iter().copied().filter(is_enough).collect();
        pairs.sort_by_key(|pair| (std::cmp::Reverse(pair.answers), pair.request, pair.response));
        let mut hints: Vec<UdsPairHint> = Vec::new();
        for pair in pairs {
            let ids = [pair.request, pair.response];
            if !hints.iter().any(|known| ids.contains(&known.request) || ids.contains(&known.response)) {
                hints.push(pair);
            }
        }
        hints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair_hints(frames: &[(u16, &[u8])]) -> Vec<String> {
        let mut unnamed = UdsSuspects::default();
        for (id, data) in frames {
            unnamed.take_frame(&Frame::data_frame(CanId::from_standard(*id), data));
        }
        unnamed.pair_hints().iter().map(ToString::to_string).collect()
    }

    // Session control requests; one receives a positive, one a negative response (7F, service, NRC).
    const ASKED: (u16, &[u8]) = (0x7E0, &[2, 0x10, 3, 0, 0, 0, 0, 0]);
    const GRANTED: (u16, &[u8]) = (0x7E8, &[6, 0x50, 3, 0, 0x32, 1, 0xF4, 0]);
    const REFUSED: (u16, &[u8]) = (0x7E8, &[3, 0x7F, 0x10, 0x22, 0, 0, 0, 0]);

    #[test]
    fn requests_with_responses_reveal_unnamed_identifiers() {
        let hints = pair_hints(&[ASKED, GRANTED, ASKED, REFUSED]);
        let [hint] = &hints[..] else { panic!("{hints:?}") };
        assert!(hint.starts_with("7E8 responds to 7E0 like a UDS server (2 times); to decode"), "{hint}");
        assert!(hint.ends_with("uds = [{ request = \"7E0\", response = \"7E8\" }]"), "{hint}");
    }

    #[test]
    fn one_answer_may_be_chance_and_other_traffic_is_none() {
        assert_eq!(pair_hints(&[ASKED, GRANTED]), [""; 0]);
        // A response to another service, and a response on the identifier of the request.
        assert_eq!(pair_hints(&[ASKED, (0x7E8, &[2, 0x51, 1]), ASKED, (0x7E0, &[2, 0x50, 3])]), [""; 0]);
        assert_eq!(pair_hints(&[(0x123, &[0xFF; 8]), (0x124, &[]), (0x123, &[0x10])]), [""; 0]);
    }

    #[test]
    fn every_pair_is_listed_and_one_identifier_belongs_to_one_pair() {
        // KWP 2000: 21 is read by local identifier, 61 its positive response (ISO 14230-3).
        const OTHER: (u16, &[u8]) = (0x79B, &[2, 0x21, 1, 0, 0, 0, 0, 0]);
        const ITS_ANSWER: (u16, &[u8]) = (0x7BB, &[0x10, 0x29, 0x61, 1, 0, 0, 0, 0]);
        // By chance, 300 looks like a response once, and twice like another request.
        const CHANCE: (u16, &[u8]) = (0x300, &[2, 0x50, 3, 0, 0, 0, 0, 0]);
        let pair = [ASKED, GRANTED, OTHER, ITS_ANSWER];
        let found = pair_hints(&[&pair[..], &[ASKED, CHANCE, ASKED, CHANCE], &pair, &pair].concat());
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("7BB responds to 79B") || found[1].starts_with("7BB responds to 79B"));
        assert!(
            found.iter().any(|hint| hint.starts_with("7E8 responds to 7E0") && hint.contains("(3 times)"))
        );
    }

    #[test]
    fn requests_that_are_mostly_unanswered_are_no_pair() {
        let cyclic = [ASKED; 7];
        assert_eq!(pair_hints(&[&cyclic[..], &[ASKED, GRANTED, ASKED, GRANTED]].concat()), [""; 0]);
        // Tester present without response (bit 7 of the sub-function) does not count.
        let present: (u16, &[u8]) = (0x7E0, &[2, 0x3E, 0x80, 0, 0, 0, 0, 0]);
        assert_eq!(pair_hints(&[&[present; 7][..], &[ASKED, GRANTED, ASKED, GRANTED]].concat()).len(), 1);
    }
}
