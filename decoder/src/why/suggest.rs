//! Which profile a node without one may have: by behaviour, so never more than a suggestion.

use crate::frame::BusIndex;
use crate::profile::device::{Hint, Sign};
use crate::profile::{Catalogue, Device, PdoName, little_endian};
use crate::session::Node;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// PDOs whose length is remembered of a node.
const PDOS: usize = 16;

/// What a node says of itself that no setting changes, and which bits of it are compared: of the device type (CiA 301
/// §7.5.2.1) the number of the profile, since the upper half depends on what is fitted; the vendor-ID whole.
const TELLING: [(ObjectAddress, u64); 2] =
    [(ObjectAddress::new(0x1000, 0), 0xFFFF), (ObjectAddress::new(0x1018, 1), 0xFFFF_FFFF)];

/// What a node does that may suggest its profile.
#[derive(Debug, Clone, Default)]
pub(super) struct Signs {
    /// It sent an EMCY without data.
    pub(super) ready: bool,
    /// Lengths of its PDOs; `None` where they differ.
    pdos: Vec<(PdoName, Option<u8>)>,
}

/// A profile a node may have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Suggestion {
    /// Bus of the node.
    pub bus: BusIndex,
    /// The node.
    pub node: NodeId,
    /// Id of the profile.
    pub profile: String,
    /// What output calls the device.
    pub title: String,
    /// Why, in the profile's words.
    pub because: Vec<String>,
}

impl Signs {
    /// A PDO of this length came.
    pub(super) fn pdo(&mut self, name: PdoName, length: u8) {
        let has_room = self.pdos.len() < PDOS;
        match self.pdos.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) => *known = known.filter(|known| *known == length),
            None if has_room => self.pdos.push((name, Some(length))),
            None => {}
        }
    }

    /// Whether a hint fits; `None` where nothing tells.
    fn fits(&self, hint: &Hint) -> Option<bool> {
        match hint.sign {
            Sign::ReadyTelegram => self.ready.then_some(true),
            Sign::Pdo => {
                let wanted = hint.pdo.as_deref()?;
                let (_, length) = self.pdos.iter().find(|(name, _)| name.to_string() == wanted)?;
                Some(length.is_some() && *length == hint.length)
            }
        }
    }

    /// Profiles with a hint that fits, none that does not, and nothing the node said of itself against them.
    pub(super) fn suggestions(&self, bus: BusIndex, node: &Node, catalogue: &Catalogue) -> Vec<Suggestion> {
        // What the node said, not what is presumed of it.
        let said = |object| node.store().seen(object).map(|entry| little_endian(&entry.value));
        self.fitting(bus, node.id(), said, catalogue)
    }

    fn fitting(
        &self,
        bus: BusIndex,
        node: NodeId,
        said: impl Fn(ObjectAddress) -> Option<u64>,
        catalogue: &Catalogue,
    ) -> Vec<Suggestion> {
        let devices = catalogue.ids().into_iter().filter_map(|id| catalogue.device(&id).ok());
        let mut found = Vec::new();
        for device in devices.filter(|device| !is_denied(device, &said)) {
            let variant = device.variant.as_deref().unwrap_or_default();
            let hints = device.hints.iter().filter(|hint| hint.only.allows(variant));
            let judged: Vec<_> = hints.map(|hint| (hint, self.fits(hint))).collect();
            if judged.iter().any(|(_, fits)| *fits == Some(false)) {
                continue;
            }
            let because: Vec<_> =
                judged.iter().filter(|(_, fits)| fits.is_some()).map(|(hint, _)| hint.text.clone()).collect();
            if !because.is_empty() {
                let (profile, title) = (device.id.clone(), device.title.clone());
                found.push(Suggestion { bus, node, profile, title, because });
            }
        }
        found
    }
}

/// Whether a node that says this of itself is another device.
fn is_denied(device: &Device, said: impl Fn(ObjectAddress) -> Option<u64>) -> bool {
    TELLING.iter().any(|(object, mask)| {
        let entry = device.dictionary.find(*object).and_then(|found| found.entry);
        let wanted = entry.and_then(|entry| entry.default_number(None)).map(i64::cast_unsigned);
        said(*object).zip(wanted).is_some_and(|(said, wanted)| said & mask != wanted & mask)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn profiles(ready: bool, pdos: &[(&str, u8)]) -> Vec<String> {
        told(ready, pdos, &[])
    }

    fn told(ready: bool, pdos: &[(&str, u8)], said: &[(u16, u8, u64)]) -> Vec<String> {
        let mut signs = Signs { ready, ..Signs::default() };
        for (name, length) in pdos {
            signs.pdo(name.parse().unwrap(), *length);
        }
        let said = |object: ObjectAddress| {
            let of = |(index, sub, _): &&(u16, u8, u64)| (*index, *sub) == (object.index, object.sub);
            said.iter().find(of).map(|(_, _, value)| *value)
        };
        let found = signs.fitting(BusIndex(0), 2.into(), said, &Catalogue::default());
        found.into_iter().map(|suggestion| suggestion.profile).collect()
    }

    #[test]
    fn hints_of_the_profiles() {
        // SYDFEC: ready telegram, TPDO1 of 5 bytes. MD2: TPDO1 of 2 bytes.
        assert_eq!(profiles(true, &[]), ["rexroth-sydfec"]);
        assert_eq!(profiles(true, &[("TPDO1", 5)]), ["rexroth-sydfec"]);
        assert_eq!(profiles(false, &[("TPDO1", 2)]), ["wandfluh-md2"]);
        // The one contradicts the other.
        assert!(profiles(true, &[("TPDO1", 4)]).is_empty());
        assert!(profiles(false, &[("TPDO1", 5), ("TPDO1", 4)]).is_empty());
        assert!(profiles(false, &[("TPDO2", 5)]).is_empty());
    }

    #[test]
    fn what_the_node_said_of_itself_goes_before_hints() {
        let with = |said| told(false, &[("TPDO1", 2)], said);
        // CiA 408 with other fittings, and the vendor-ID of Wandfluh.
        assert_eq!(with(&[(0x1000, 0, 0x0001_0198), (0x1018, 1, 0x14D)]), ["wandfluh-md2"]);
        // CiA 402; another maker.
        assert!(with(&[(0x1000, 0, 0x0002_0192)]).is_empty());
        assert!(with(&[(0x1018, 1, 0x22)]).is_empty());
    }
}
