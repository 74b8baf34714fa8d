//! Which device a node is: by the user's word, or by what it says of itself.

use std::sync::Arc;

use crate::event::{EventKind, NodeIdentified};
use crate::frame::{CanId, Frame};
use crate::profile::{Device, Introduction, PdoName};
use crate::session::routes::Service;
use crate::session::{AssignedBy, Bus, Observer};
use crate::wire::canopen::ObjectAddress;

/// Objects that introduce a node (CiA 301 §7.5.2.1, §7.5.2.8, §7.5.2.19).
const INTRODUCING: [ObjectAddress; 5] = [
    ObjectAddress::new(0x1000, 0),
    ObjectAddress::new(0x1008, 0),
    ObjectAddress::new(0x1018, 1),
    ObjectAddress::new(0x1018, 2),
    ObjectAddress::new(0x1018, 3),
];

impl Bus {
    /// From now on the node is this device.
    pub(in crate::session) fn assign(&mut self, id: u8, device: &Arc<Device>, by: AssignedBy) {
        let Some(node) = self.node_mut(id) else { return };
        node.device = Arc::clone(device);
        node.assigned = Some(by);
        for pdo in &device.pdos {
            if let Some(cob_id) = pdo.cob_id.as_deref().and_then(|text| formula(text, id)) {
                self.route_default(pdo.pdo, id, cob_id);
            }
        }
        self.routes.refresh_pdos_of(id);
    }

    /// An identifier that is not the predefined one, unless the bus or the user said otherwise.
    fn route_default(&mut self, name: PdoName, id: u8, cob_id: u32) {
        const INVALID: u32 = 1 << 31;
        let service = Service::Pdo(name, id);
        if cob_id & INVALID == 0 && self.routes.learnt_id(service).is_none() {
            let can_id = u16::try_from(cob_id).ok().filter(|id| *id <= 0x7FF);
            let can_id = can_id.map_or(CanId::extended(cob_id & 0x1FFF_FFFF), CanId::standard);
            self.routes.learn(can_id, service);
        }
    }

    /// An object was learnt that may tell what a node is whose device nobody named.
    pub(in crate::session) fn introduce(
        &mut self,
        id: u8,
        object: ObjectAddress,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if !INTRODUCING.contains(&object) {
            return;
        }
        let Some(node) = self.node(id).filter(|node| node.assigned.is_none()) else { return };
        let number =
            |object: ObjectAddress| node.store().number(object).and_then(|number| u32::try_from(number).ok());
        let introduction = Introduction {
            vendor_id: number(ObjectAddress::new(0x1018, 1)),
            product_code: number(ObjectAddress::new(0x1018, 2)),
            revision: number(ObjectAddress::new(0x1018, 3)),
            device_type: number(ObjectAddress::new(0x1000, 0)),
            device_name: node.store().get(ObjectAddress::new(0x1008, 0)).map(|entry| {
                let characters = entry.value.iter().take_while(|byte| **byte != 0);
                characters.map(|byte| char::from(*byte)).collect()
            }),
        };
        // The same words were tried before.
        if node.introduction.as_deref() == Some(&introduction) {
            return;
        }
        self.recognise(id, &introduction, frame, out);
        if let Some(node) = self.node_mut(id) {
            node.introduction = Some(Arc::new(introduction));
        }
    }

    /// Assigns what fits; several are said, not guessed.
    pub(in crate::session) fn recognise(
        &mut self,
        id: u8,
        introduction: &Introduction,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let options = Arc::clone(&self.options);
        let candidates = options.catalogue.identify(introduction);
        let device = match candidates.as_slice() {
            [] => return,
            [one] => match options.catalogue.device(one) {
                Ok(device) => device,
                Err(error) => return self.note(frame, error.to_string(), out),
            },
            several => {
                let known = self.node(id).is_some_and(|node| node.ambiguous);
                if !known {
                    if let Some(node) = self.node_mut(id) {
                        node.ambiguous = true;
                    }
                    let names = several.join(", ");
                    let first = several.first().map_or("", String::as_str);
                    let text = format!("node {id} may be {names}: choose with --node {id}={first}");
                    self.note(frame, text, out);
                }
                return;
            }
        };
        let identified = NodeIdentified {
            device: device.full_id.clone(),
            title: device.title.clone(),
            by: AssignedBy::Identity.name(),
        };
        self.assign(id, &device, AssignedBy::Identity);
        self.emit(frame, id, false, EventKind::NodeIdentified(Box::new(identified)), out);
    }
}

/// `$NODEID+0x180`, `0x180+$NODEID`, `0x1A0`, with spaces, in any case.
pub(in crate::session) fn formula(text: &str, node: u8) -> Option<u32> {
    let mut sum: u32 = 0;
    for part in text.split('+').map(str::trim) {
        let number = if part.eq_ignore_ascii_case("$NODEID") {
            u32::from(node)
        } else {
            match part.strip_prefix("0x").or_else(|| part.strip_prefix("0X")) {
                Some(digits) => u32::from_str_radix(digits, 16).ok()?,
                None => part.parse().ok()?,
            }
        };
        sum = sum.checked_add(number)?;
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_of_identifiers() {
        assert_eq!(formula("$NODEID+0x180", 5), Some(0x185));
        assert_eq!(formula("0x180 + $nodeid", 5), Some(0x185));
        assert_eq!(formula("0x1A0", 5), Some(0x1A0));
        assert_eq!(formula("384", 5), Some(0x180));
        assert_eq!(formula("$NODE+1", 5), None);
        assert_eq!(formula("", 5), None);
    }
}
