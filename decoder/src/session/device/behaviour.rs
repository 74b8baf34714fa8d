//! What a device does by its manual: states, set points, procedures.

use crate::frame::Frame;
use crate::session::store::OriginKind;
use crate::session::{Bus, Observer};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

impl Bus {
    pub(in crate::session) fn device_saw_emcy(
        &mut self,
        _id: u8,
        _code: u16,
        _frame: &Frame,
        _out: &mut dyn Observer,
    ) {
    }
    pub(in crate::session) fn device_saw_nmt(
        &mut self,
        _id: u8,
        _service: NmtService,
        _frame: &Frame,
        _out: &mut dyn Observer,
    ) {
    }
    pub(in crate::session) fn device_restarted(&mut self, _id: u8) {}
    pub(in crate::session) fn device_saw_object(
        &mut self,
        _id: u8,
        _object: ObjectAddress,
        _value: &[u8],
        _kind: OriginKind,
        _frame: &Frame,
        _out: &mut dyn Observer,
    ) {
    }
}
