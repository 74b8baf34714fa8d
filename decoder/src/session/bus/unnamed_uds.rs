//! UDS between identifiers of 11 bits that nobody named: no identifier says it, but requests and their answers do.

use crate::frame::{CanId, Frame};
use crate::profile;
use crate::wire::isotp::{self, IsoTp};
use crate::words::plural;

/// Pairs of identifiers that are counted; many more talk to each other by chance only.
const MOST_PAIRS: usize = 32;

/// Answers behind which it is no chance.
const ENOUGH: u32 = 2;

/// What an answer adds to the service of its request, and what a refusal begins with (ISO 14229-1 §8.3, §8.7).
const ANSWER: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

/// What was seen of it.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct UnnamedUds {
    /// The last request: its identifier and service.
    asked: Option<(CanId, u8)>,
    pairs: Vec<Pair>,
}

/// Two identifiers, one of which answered the other.
#[derive(Debug, Clone, Copy)]
struct Pair {
    request: CanId,
    response: CanId,
    answers: u32,
}

impl UnnamedUds {
    /// A frame that no service explains.
    pub(in crate::session) fn take(&mut self, frame: &Frame) {
        let data = frame.data();
        let Ok(IsoTp::Single { data } | IsoTp::First { data, .. }) = isotp::parse(data, data.len()) else {
            return;
        };
        let Some(service) = data.first().copied() else { return };
        if let Some((request, asked)) = self.asked.filter(|(request, _)| *request != frame.id)
            && (service == asked | ANSWER || matches!(data, [NEGATIVE, refused, _] if *refused == asked))
        {
            return self.answered(request, frame.id);
        }
        if service & ANSWER == 0 && profile::uds().service(service).is_some() {
            self.asked = Some((frame.id, service));
        }
    }

    fn answered(&mut self, request: CanId, response: CanId) {
        let has_room = self.pairs.len() < MOST_PAIRS;
        let known = self.pairs.iter_mut().find(|pair| (pair.request, pair.response) == (request, response));
        match known {
            Some(pair) => pair.answers = pair.answers.saturating_add(1),
            None if has_room => {
                self.pairs.push(Pair { request, response, answers: 1 });
            }
            None => {}
        }
    }

    /// What helps to read them, where there are any.
    pub(in crate::session) fn hint(&self) -> Option<String> {
        let mut pairs: Vec<_> = self.pairs.iter().filter(|pair| pair.answers >= ENOUGH).collect();
        pairs.sort_by_key(|pair| std::cmp::Reverse(pair.answers));
        let [Pair { request, response, .. }, others @ ..] = pairs.as_slice() else { return None };
        let others = match others.len() {
            0 => String::new(),
            more => format!(", and so do {}", plural(more, "more pair")),
        };
        Some(format!(
            "{response} answers {request} as UDS does{others}: named under [[uds]] in a bus file (--bus), request = \
             \"{request}\", response = \"{response}\", they are decoded"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hint(frames: &[(u16, &[u8])]) -> Option<String> {
        let mut unnamed = UnnamedUds::default();
        for (id, data) in frames {
            unnamed.take(&Frame::data_frame(CanId::standard(*id), data));
        }
        unnamed.hint()
    }

    // Sessions are asked for, one is granted and one refused (7F, service, NRC).
    const ASKED: (u16, &[u8]) = (0x7E0, &[2, 0x10, 3, 0, 0, 0, 0, 0]);
    const GRANTED: (u16, &[u8]) = (0x7E8, &[6, 0x50, 3, 0, 0x32, 1, 0xF4, 0]);
    const REFUSED: (u16, &[u8]) = (0x7E8, &[3, 0x7F, 0x10, 0x22, 0, 0, 0, 0]);

    #[test]
    fn requests_with_answers_tell_which_identifiers_to_name() {
        let hint = hint(&[ASKED, GRANTED, ASKED, REFUSED]).unwrap();
        assert!(hint.starts_with("7E8 answers 7E0 as UDS does: named under [[uds]]"), "{hint}");
        assert!(hint.ends_with("request = \"7E0\", response = \"7E8\", they are decoded"), "{hint}");
    }

    #[test]
    fn one_answer_may_be_chance_and_other_traffic_is_none() {
        assert_eq!(hint(&[ASKED, GRANTED]), None);
        // Another service, and the same identifier.
        assert_eq!(hint(&[ASKED, (0x7E8, &[2, 0x51, 1]), ASKED, (0x7E0, &[2, 0x50, 3])]), None);
        assert_eq!(hint(&[(0x123, &[0xFF; 8]), (0x124, &[]), (0x123, &[0x10])]), None);
    }
}
