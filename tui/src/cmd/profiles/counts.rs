//! Numbers of entries in profiles.

use cobscope_decoder::profile::DeviceProfile;

/// Numbers of entries by kind.
pub(super) fn entry_counts(device: &DeviceProfile) -> [(&'static str, usize); 12] {
    let fields = device.pdos.iter().map(|pdo| pdo.fields.len()).sum::<usize>();
    let states = device.machines.iter().map(|machine| machine.states.len()).sum::<usize>();
    [
        ("object entries", device.object_count()),
        ("EMCY codes", device.emcy.code.len()),
        ("abort codes", device.aborts.len()),
        ("PDO layouts", device.pdos.len()),
        ("PDO fields", fields),
        ("state machines", device.machines.len()),
        ("states", states),
        ("gates", device.gates.len()),
        ("procedures", device.procedures.len()),
        ("rules", device.rules.len()),
        ("waivers", device.waivers.len()),
        ("samples", device.samples.len()),
    ]
}
