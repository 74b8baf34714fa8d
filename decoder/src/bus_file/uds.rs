//! UDS servers of the bus file: their request and response identifiers.

use serde::Deserialize;
use toml::Spanned;

use super::written::{NO_IDENTIFIER, TextProblem, WrittenNumber};
use crate::frame::CanId;

/// Identifiers and addressing of a UDS server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdsPair {
    /// Identifier of physical requests to this server.
    pub request: CanId,
    /// Identifier of its responses.
    pub response: CanId,
    /// Identifier of functional requests to a group of servers.
    pub functional: Option<CanId>,
    /// Name shown in output.
    pub name: Option<String>,
    /// Whether the first byte of each payload is an address (ISO 15765-2 §10.3.4, §10.3.5: extended and mixed
    /// addressing).
    pub extended_addressing: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct UdsPairEntry {
    request: Spanned<WrittenNumber>,
    response: Spanned<WrittenNumber>,
    #[serde(default)]
    functional: Option<Spanned<WrittenNumber>>,
    #[serde(default)]
    extended: bool,
    #[serde(default)]
    name: Option<String>,
    #[serde(default)]
    extended_addressing: bool,
}

/// Checks the pairs of one table; returns the first problem.
pub(super) fn check_pairs(pairs: Vec<UdsPairEntry>) -> Result<Vec<UdsPair>, TextProblem> {
    let mut checked: Vec<UdsPair> = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let id = |number: &Spanned<WrittenNumber>| {
            let id = number.get_ref().can_id(pair.extended);
            id.ok_or_else(|| (number.span(), NO_IDENTIFIER.to_owned()))
        };
        let (request, response) = (id(&pair.request)?, id(&pair.response)?);
        let functional = pair.functional.as_ref().map(id).transpose()?;
        let own = [(request, &pair.request), (response, &pair.response)];
        let twice =
            |number: &Spanned<WrittenNumber>, id: CanId| (number.span(), format!("duplicate entry for {id}"));
        if request == response {
            return Err(twice(&pair.response, response));
        }
        for (id, number) in own {
            let is_taken = |other: &UdsPair| [other.request, other.response].contains(&id);
            if checked.iter().any(|other| is_taken(other) || other.functional == Some(id)) {
                return Err(twice(number, id));
            }
        }
        if let (Some(id), Some(number)) = (functional, &pair.functional)
            && checked
                .iter()
                .flat_map(|other| [other.request, other.response])
                .chain([request, response])
                .any(|it| it == id)
        {
            return Err(twice(number, id));
        }
        checked.push(UdsPair {
            request,
            response,
            functional,
            name: pair.name,
            extended_addressing: pair.extended_addressing,
        });
    }
    Ok(checked)
}

#[cfg(test)]
mod tests {
    use crate::bus_file::BusFile;
    use crate::frame::CanId;

    #[test]
    fn pairs_of_all_buses_and_of_one() {
        let file = BusFile::parse(
            r#"
            [[uds]]
            request = 0x7E0
            response = "7E8"
            functional = 0x7DF
            name = "ECU"
            [[uds]]
            request = 0x7E1
            response = 0x7E9
            functional = 0x7DF
            [[bus.can1.uds]]
            request = 0x6F1
            response = 0x612
            extended = true
            extended_addressing = true
            "#,
        )
        .unwrap();
        let pairs: Vec<_> = file.uds("can1").collect();
        assert_eq!((pairs[0].request, pairs[0].extended_addressing), (CanId::from_extended(0x6F1), true));
        assert_eq!((pairs[1].response, pairs[1].name.as_deref()), (CanId::from_standard(0x7E8), Some("ECU")));
        assert_eq!(pairs[2].functional, Some(CanId::from_standard(0x7DF)));
        assert_eq!(file.uds("can0").count(), 2);
    }

    #[test]
    fn identifiers_are_given_once() {
        let fails = |text: &str, message: &str| {
            let error = BusFile::parse(text).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        };
        fails("[[uds]]\nrequest = 0x7E0\nresponse = 0x7E0", "3:12: duplicate entry for 7E0");
        fails(
            "[[uds]]\nrequest = 0x7E0\nresponse = 0x7E8\n[[uds]]\nrequest = 0x7E1\nresponse = 0x7E8",
            "6:12: duplicate entry for 7E8",
        );
        fails(
            "[[uds]]\nrequest = 0x7E0\nresponse = 0x7E8\nfunctional = 0x7E0",
            "4:14: duplicate entry for 7E0",
        );
        fails(
            "[[uds]]\nrequest = 0x20000000\nresponse = 0x7E8",
            "2:11: invalid CAN identifier; expected 11 or 29 bits",
        );
        fails("[[uds]]\nrequest = 0x7E0", "missing field `response`");
    }
}
