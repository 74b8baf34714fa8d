//! Detects SDO dialogues on identifiers of no SDO channel, by requests and responses that repeat their object.

use std::fmt;

use crate::frame::{CanId, Frame};
use crate::profile::{IdentifierOwner, connection_set};

/// Max pairs of identifiers counted; more pairs match only by chance.
const PAIR_LIMIT: usize = 32;

/// Exchanges after which chance is ruled out.
const ENOUGH: u32 = 3;

/// Frames examined without an exchange, after which the search ends.
const BUDGET: u32 = 4_096;

/// Bytes of every SDO message (CiA 301 §7.2.4.3).
const LENGTH: usize = 8;

/// Dialogues that have the form of SDO transfers.
#[derive(Debug, Clone)]
pub(in crate::session) struct SdoDialogues {
    /// Last request: identifier, command specifier and multiplexer.
    asked: Option<(CanId, u8, [u8; 3])>,
    pairs: Vec<SdoIdentifiers>,
    budget: u32,
}

/// Identifiers of requests and of their responses.
#[derive(Debug, Clone, Copy)]
struct SdoIdentifiers {
    request: CanId,
    response: CanId,
    exchanges: u32,
}

/// A pair with enough exchanges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct SdoPair {
    pub(in crate::session) request: CanId,
    pub(in crate::session) response: CanId,
}

impl Default for SdoDialogues {
    fn default() -> Self {
        Self { asked: None, pairs: Vec::new(), budget: BUDGET }
    }
}

impl SdoDialogues {
    /// Whether a frame may belong to a dialogue: it has the form of a request or response, or its identifier is in
    /// a pair.
    pub(in crate::session) fn is_candidate(&self, frame: &Frame) -> bool {
        let is_known = |id: CanId| self.pairs.iter().any(|pair| pair.request == id || pair.response == id);
        self.budget > 0
            && frame.data().len() == LENGTH
            && (parse_request(frame.data()).is_some()
                || parse_response(frame.data()).is_some()
                || is_known(frame.id))
    }

    /// Evaluates a frame of an identifier without SDO channel; returns its pair at the exchange that rules out
    /// chance.
    pub(in crate::session) fn take_frame(&mut self, frame: &Frame) -> Option<SdoPair> {
        let data = frame.data();
        if data.len() != LENGTH {
            // An SDO always has eight bytes.
            let is_pending = |pair: &SdoIdentifiers| pair.exchanges < ENOUGH;
            self.pairs
                .retain(|pair| !is_pending(pair) || pair.request != frame.id && pair.response != frame.id);
            return None;
        }
        self.budget = self.budget.checked_sub(1)?;
        if let (Some((id, specifier, object)), Some((responses, responded))) =
            (self.asked, parse_response(data))
            && id != frame.id
            && responses.contains(&specifier)
            && object == responded
        {
            self.asked = None;
            self.budget = BUDGET;
            return self.add_exchange(id, frame.id);
        }
        if let Some((specifier, object)) = parse_request(data) {
            self.asked = Some((frame.id, specifier, object));
        }
        None
    }

    /// Pairs with enough exchanges.
    pub(in crate::session) fn pair_hints(&self) -> Vec<SdoPairHint> {
        let enough = self.pairs.iter().filter(|pair| pair.exchanges >= ENOUGH);
        enough
            .map(|SdoIdentifiers { request, response, .. }| {
                let pair = SdoPair { request: *request, response: *response };
                SdoPairHint { request: *request, response: *response, node: pair.server_node() }
            })
            .collect()
    }

    fn add_exchange(&mut self, request: CanId, response: CanId) -> Option<SdoPair> {
        let is_same = |pair: &&mut SdoIdentifiers| (pair.request, pair.response) == (request, response);
        let Some(pair) = self.pairs.iter_mut().find(is_same) else {
            if self.pairs.len() < PAIR_LIMIT {
                self.pairs.push(SdoIdentifiers { request, response, exchanges: 1 });
            }
            return None;
        };
        pair.exchanges = pair.exchanges.saturating_add(1);
        (pair.exchanges == ENOUGH).then_some(SdoPair { request, response })
    }
}

impl SdoPair {
    /// Node-ID of the server, from an identifier of the predefined connection set; 1 if there is none.
    fn server_node(self) -> u8 {
        [self.response, self.request].into_iter().find_map(predefined_owner).unwrap_or(1)
    }

    /// Pair and its entries in the bus file, as text.
    pub(in crate::session) fn hint_text(self) -> String {
        let Self { request, response } = self;
        let node = self.server_node();
        format!(
            "{response} responds to {request} like an SDO server, {ENOUGH} exchanges: no longer decoded as PDO; to \
             decode, add to a bus file (--bus), with the node-ID of the server: \
             id = [{{ id = \"{request}\", service = \"sdo-request\", node = {node} }}, \
             {{ id = \"{response}\", service = \"sdo-response\", node = {node} }}]"
        )
    }
}

/// Identifiers without a channel that exchange messages like SDO client and server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoPairHint {
    /// Identifier of the requests.
    pub request: CanId,
    /// Identifier of the responses.
    pub response: CanId,
    /// Presumed node-ID of the server.
    pub node: u8,
}

impl SdoPairHint {
    /// Entries of the bus file that decode the dialogue, complete and as TOML.
    pub fn bus_file(&self) -> String {
        let Self { request, response, node } = self;
        let entry = |id: CanId, service: &str| {
            format!("[[id]]\nid = \"{id}\"\nservice = \"{service}\"\nnode = {node}\n")
        };
        entry(*request, "sdo-request") + &entry(*response, "sdo-response")
    }
}

/// Prints the pair without its entries.
impl fmt::Display for SdoPairHint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { request, response, .. } = self;
        write!(
            f,
            "{response} responds to {request} like an SDO server (at least {ENOUGH} exchanges); to decode, add to a bus \
             file (--bus), with the node-ID of the server:"
        )
    }
}

/// Node-ID in an identifier of the predefined connection set.
fn predefined_owner(id: CanId) -> Option<u8> {
    match id {
        CanId::Standard(id) => match connection_set().owner_of(id) {
            IdentifierOwner::Pdo(_, node) => Some(node),
            _ => None,
        },
        CanId::Extended(_) => None,
    }
}

/// Multiplexer of an object that exists in a dictionary (CiA 301 table 41: 0001 to 0FFF are data types).
fn valid_multiplexer(low: u8, high: u8, sub: u8) -> Option<[u8; 3]> {
    (0x10..0xC0).contains(&high).then_some([low, high, sub])
}

/// Client command specifier (1: download, 2: upload, 5 and 6: blocks) and multiplexer of an initiate request.
fn parse_request(data: &[u8]) -> Option<(u8, [u8; 3])> {
    let [command, low, high, sub, rest @ ..] = data else { return None };
    let is_valid = match command {
        0x40 => rest == [0; 4],
        0x20 | 0x21 | 0x22 | 0x23 | 0x27 | 0x2B | 0x2F | 0xA0 | 0xA4 | 0xC0 | 0xC2 | 0xC4 | 0xC6 => true,
        _ => false,
    };
    Some((command >> 5, valid_multiplexer(*low, *high, *sub)?)).filter(|_| is_valid)
}

/// Client command specifiers that a response belongs to, and its multiplexer.
fn parse_response(data: &[u8]) -> Option<(&'static [u8], [u8; 3])> {
    let [command, low, high, sub, rest @ ..] = data else { return None };
    let specifiers: &[u8] = match command {
        0x60 if rest == [0; 4] => &[1],
        0x40..=0x43 | 0x47 | 0x4B | 0x4F => &[2, 5],
        0xC0 | 0xC2 | 0xC4 | 0xC6 => &[5],
        0xA0 | 0xA4 => &[6],
        // The abort codes of CiA 301 table 22 start with 05, 06 or 08.
        0x80 if matches!(rest, [.., 5 | 6 | 8]) => &[1, 2, 5, 6],
        _ => return None,
    };
    Some((specifiers, valid_multiplexer(*low, *high, *sub)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(frames: &[(u16, &[u8])]) -> Vec<SdoPair> {
        let mut dialogues = SdoDialogues::default();
        let frames = frames.iter().map(|(id, data)| Frame::data_frame(CanId::from_standard(*id), data));
        frames.filter_map(|frame| dialogues.take_frame(&frame)).collect()
    }

    // Read of 1000:00, write of 1017:00, refused read of 2000:01.
    const READ: (u16, &[u8]) = (0x223, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    const VALUE: (u16, &[u8]) = (0x1A3, &[0x43, 0, 0x10, 0, 0x91, 1, 3, 0]);
    const WRITE: (u16, &[u8]) = (0x223, &[0x2B, 0x17, 0x10, 0, 0xE8, 3, 0, 0]);
    const DONE: (u16, &[u8]) = (0x1A3, &[0x60, 0x17, 0x10, 0, 0, 0, 0, 0]);
    const REFUSED: (u16, &[u8]) = (0x1A3, &[0x80, 0, 0x10, 0, 0, 0, 2, 6]);

    #[test]
    fn three_exchanges_reveal_a_pair() {
        let pairs = found(&[READ, VALUE, WRITE, DONE, READ, REFUSED, READ, VALUE]);
        let [pair] = pairs.as_slice() else { panic!("{pairs:?}") };
        let hint = pair.hint_text();
        assert!(hint.starts_with("1A3 responds to 223 like an SDO server"), "{hint}");
        // One line of TOML.
        let lines = "id = [{ id = \"223\", service = \"sdo-request\", node = 35 }, \
                     { id = \"1A3\", service = \"sdo-response\", node = 35 }]";
        assert!(crate::bus_file::BusFile::parse(lines).is_ok());
        assert!(hint.ends_with(lines), "{hint}");
    }

    #[test]
    fn other_dialogues_are_no_pair() {
        assert!(found(&[READ, VALUE, WRITE, DONE]).is_empty(), "two exchanges may be chance");
        // Another object, another command specifier, the identifier of the request, another length.
        assert!(found(&[READ, DONE, WRITE, VALUE, READ, DONE, WRITE, VALUE]).is_empty());
        let own: (u16, &[u8]) = (READ.0, VALUE.1);
        assert!(found(&[READ, own, READ, own, READ, own]).is_empty());
        let short: (u16, &[u8]) = (0x1A3, &[0x43, 0, 0x10, 0]);
        assert!(found(&[READ, VALUE, READ, VALUE, short, READ, VALUE]).is_empty());
        // Control and status words: the same first bytes, but not the specifiers of an SDO.
        let control: (u16, &[u8]) = (0x223, &[0x0F, 0, 0x10, 0, 1, 2, 3, 4]);
        let status: (u16, &[u8]) = (0x1A3, &[0x37, 0, 0x10, 0, 1, 2, 3, 4]);
        assert!(found(&[control, status, control, status, control, status]).is_empty());
    }
}
