//! Readers of EDS, DCF and XDD: each address must occur once, every problem must have a line, a byte order
//! mark must not change the result, and the file must result in a valid profile.

use std::collections::BTreeSet;
use std::sync::Arc;

use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::profile::device_file::{DeviceFile, MOST_ENTRIES, MOST_PROBLEMS, parse_device_file};
use cobscope_decoder::profile::{check_device, imported, plain_device};

/// Fuzzes the device file readers.
pub fn device_file(data: &[u8]) {
    let file = parse_device_file(data);
    if let Ok(text) = std::str::from_utf8(data)
        && !text.starts_with('\u{FEFF}')
    {
        let marked = parse_device_file(&[b"\xEF\xBB\xBF", data].concat());
        assert_eq!(file, marked, "with and without byte order mark");
    }
    let Ok(file) = file else { return };
    let lines = data.iter().filter(|byte| matches!(byte, b'\n' | b'\r')).count() + 1;
    assert!(file.objects.len() <= MOST_ENTRIES && file.problems.len() <= MOST_PROBLEMS + 1);
    assert!(file.objects.is_sorted_by(|first, second| first.address < second.address));
    for object in &file.objects {
        assert!((1..=lines).contains(&object.line), "{object:?} of {lines} lines");
        assert_eq!(file.find_object(object.address), Some(object));
    }
    for problem in &file.problems {
        assert!(problem.line <= lines, "{problem:?} of {lines} lines");
        assert!(!problem.reason.is_empty() && !problem.reason.contains(char::is_control), "{problem:?}");
    }
    assert!(file.node_id.is_none_or(|id| (1..=127).contains(&id)));
    assert!([file.vendor_id, file.product_code, file.revision].iter().all(|number| *number != Some(0)));
    let rates: BTreeSet<_> = file.bit_rates.iter().collect();
    assert!(rates.into_iter().eq(&file.bit_rates), "{:?}", file.bit_rates);
    profile(&Arc::new(file));
}

/// Checks that the profile of a file is valid and has all entries of the file.
fn profile(file: &Arc<DeviceFile>) {
    let text = imported::write_profile(file, "a.eds");
    let profile = ProfileFile::parse(&text).unwrap_or_else(|errors| panic!("{errors:?}\n{text}"));
    let device = profile.build_device(None, &[Arc::clone(plain_device())]);
    assert_eq!(check_device(&text, &profile, &device), [], "{text}");
    assert_eq!(device.object_count(), file.objects.len(), "{text}");
    let made = imported::describe_device(file, "a.eds");
    assert_eq!((&made.id, &made.title, made.object_count()), (&device.id, &device.title, file.objects.len()));
    for object in &file.objects {
        let entry = |dictionary: &cobscope_decoder::profile::Dictionary| {
            let entry = dictionary.find_object(object.address).and_then(|found| found.entry)?;
            Some((entry.data_type, entry.access, entry.default.clone()))
        };
        assert_eq!(entry(&made.dictionary), entry(&device.dictionary), "{}\n{text}", object.address);
    }
}
