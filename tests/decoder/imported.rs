//! Device files as devices and as profiles: both are equivalent, and the profile has no errors.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]
#![expect(clippy::panic, reason = "helpers of tests fail so")]

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::profile::device_file::{self, DeviceFile};
use cobscope_decoder::profile::{
    DeviceProfile, EntryResolver, NoValues, check_device, imported, plain_device,
};
use cobscope_decoder::wire::canopen::ObjectAddress;

use crate::support::{corpus, skip, workspace};

fn files_in(folder: PathBuf) -> Vec<(String, Arc<DeviceFile>)> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension != "txt" && extension != "md"));
    paths.sort();
    let read = |path: PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let file = device_file::parse_device_file(&fs::read(&path).unwrap())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, Arc::new(file))
    };
    paths.into_iter().map(read).collect()
}

fn fixtures() -> Vec<(String, Arc<DeviceFile>)> {
    files_in(workspace().join("fixtures/device_files"))
}

/// The profile written from a file and read again; it must have no errors.
fn profile(file: &Arc<DeviceFile>, name: &str) -> (String, ProfileFile, DeviceProfile) {
    let text = imported::write_profile(file, name);
    let shown = |errors: Vec<String>| panic!("{name}:\n{}\n{text}", errors.join("\n"));
    let parsed = ProfileFile::parse(&text)
        .unwrap_or_else(|errors| shown(errors.iter().map(|error| error.show_in_file(name)).collect()));
    let device = parsed.build_device(None, &[Arc::clone(plain_device())]);
    let wrong = check_device(&text, &parsed, &device);
    if !wrong.is_empty() {
        shown(wrong.iter().map(|error| error.show_in_file(name)).collect());
    }
    (text, parsed, device)
}

/// Description of an entry in a device.
fn entry(device: &DeviceProfile, object: ObjectAddress) -> String {
    let found = device.dictionary.find_object(object).unwrap();
    let mut meaning =
        EntryResolver::for_node(&device.dictionary, &NoValues, 5).resolve_meaning(object).unwrap();
    // A written profile replaces an entry of CiA 301 as a whole, without the names of its bits.
    meaning.bits = None;
    let entry = found.entry.unwrap();
    format!("{meaning:?} {:?} {:?} {:?} {:?}", entry.access, entry.default, entry.effect, entry.note)
}

fn compare(name: &str, file: &Arc<DeviceFile>) -> usize {
    let device = imported::describe_device(file, name);
    let (text, _, again) = profile(file, name);
    assert_eq!(
        (&device.id, &device.title, &device.vendor),
        (&again.id, &again.title, &again.vendor),
        "{name}"
    );
    let identity =
        |device: &DeviceProfile| device.identities.first().map(|it| (it.vendor_id, it.product_code));
    assert_eq!(identity(&device), identity(&again), "{name}");
    assert_eq!(device.object_count(), file.objects.len(), "{name}");
    assert_eq!(again.object_count(), file.objects.len(), "{name}\n{text}");
    for object in &file.objects {
        assert_eq!(
            entry(&device, object.address),
            entry(&again, object.address),
            "{name}: {}",
            object.address
        );
    }
    again.pdos.len()
}

#[test]
fn a_device_and_the_profile_of_its_file_are_alike() {
    for (name, file) in fixtures() {
        compare(&name, &file);
    }
}

#[test]
fn so_they_are_for_all_of_the_corpus() {
    let folder = corpus().join("eds");
    if !folder.exists() {
        return skip("corpus", &format!("{} is not there", folder.display()));
    }
    let files = files_in(folder);
    assert_eq!(files.len(), 63);
    // Checked in the files: PDOs with a complete mapping of objects that the file defines.
    let known = [
        ("kacanopen__605.3150.51-V-EK-2-60.eds", 6),
        ("kacanopen__IoX3_24DO.eds", 1),
        ("canopen__sample.eds", 0),
        ("lely-core__cocatd.dcf", 3),
    ];
    let pdos: BTreeMap<_, _> =
        files.iter().map(|(name, file)| (name.as_str(), compare(name, file))).collect();
    for (name, count) in known {
        assert_eq!(pdos[name], count, "{name}");
    }
}
