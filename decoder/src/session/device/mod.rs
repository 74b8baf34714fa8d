//! Behaviour of a device as its manual describes it: states, set points, procedures, bits and modes.

mod behaviour;
mod bits;
mod changed;
mod machine;
mod procedure;
mod procedure_status;
mod set_point;

pub(in crate::session) use behaviour::{
    on_device_restart, on_emcy_code, on_nmt_service, on_object_transfer, on_trouble_code, on_values,
};
pub(in crate::session) use procedure::{SettingAnnouncement, emit_announcement};
pub(in crate::session) use set_point::{DeviceMachine, confirm_identifier, reassess_set_points};
