//! COB-IDs of PDOs as written or read in 14xx:01 and 18xx:01, and the PDOs that share one.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::frame::CanId;
use crate::profile::PdoName;
use crate::session::bus::nodes::Node;
use crate::session::bus::objects::OriginKind;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// PDOs with an identifier.
pub(in crate::session) type Users = Vec<(PdoName, NodeId)>;

/// Identifiers for which the predefined connection set does not name all users.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct PdoUsers(pub(in crate::session) Arc<BTreeMap<CanId, Users>>);

impl Node {
    /// Configured COB-ID of a PDO, written or read and not doubtful since; bit 31 marks it as not valid.
    pub(crate) fn configured_cob_id(&self, name: PdoName) -> Option<u64> {
        let object = ObjectAddress::new(name.communication_index(), 1);
        let entry = self.store.seen_value(object)?;
        let is_certain = !entry.stale && entry.origin.kind != OriginKind::Pdo;
        is_certain.then(|| self.store.number(object)).flatten()
    }

    /// PDOs with a configured COB-ID.
    pub(in crate::session) fn configured_pdos(&self) -> impl Iterator<Item = (PdoName, u64)> {
        let objects = self.store.sorted().into_iter().map(|(object, _)| object);
        objects.filter(|object| object.sub == 1).filter_map(|object| {
            let name = PdoName::of_parameter(object.index)?;
            let is_cob_id = name.communication_index() == object.index;
            Some((name, is_cob_id.then(|| self.configured_cob_id(name)).flatten()?))
        })
    }
}
