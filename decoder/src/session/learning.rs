//! Applies a confirmed object value to its node, in this order: device file, store, identity, device state.

use crate::frame::Frame;
use crate::session::context::MachineContext;
use crate::session::device::on_object_transfer;
use crate::session::identity::{identify_node, join_by_serial};
use crate::session::objects::{ObjectTransfer, apply_transfer};
use crate::wire::canopen::ObjectAddress;

/// Serial number (CiA 301 §7.5.2.19).
const SERIAL_NUMBER: ObjectAddress = ObjectAddress::new(0x1018, 4);

/// Applies the object value of a confirmed transfer; `frame` is the last one of the transfer.
pub(in crate::session) fn learn_object(
    mut transfer: ObjectTransfer,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let (id, object) = (transfer.node, transfer.object);
    if cx.bus.nodes.node_mut(id).is_none() {
        return;
    }
    apply_transfer(&mut transfer, frame, cx);
    identify_node(id, object, frame, cx);
    if object == SERIAL_NUMBER {
        join_by_serial(id, frame, cx);
    }
    on_object_transfer(id, object, &transfer.value, transfer.kind, frame, cx);
    cx.emit_table_full(frame);
}
