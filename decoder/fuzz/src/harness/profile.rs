//! Profiles: any text must be accepted, or rejected with a position; an accepted profile must answer all
//! queries.

use std::sync::Arc;

use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::profile::{EntryResolver, NoValues, check_device, plain_device};
use cobscope_decoder::wire::canopen::ObjectAddress;

/// Number of objects queried per profile.
const ASKED: usize = 4096;

/// Fuzzes a profile.
pub fn profile(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let lines = text.matches('\n').count() + 1;
    let file = match ProfileFile::parse(text) {
        Ok(file) => file,
        Err(errors) => {
            assert!(!errors.is_empty());
            for error in errors {
                assert!((1..=lines).contains(&error.line), "{error}");
                assert!(!error.show_in_file("f").contains('\x1b'));
            }
            return;
        }
    };
    let variants = file.variants().iter().map(|variant| Some(variant.id.as_str()));
    for variant in variants.chain([None]).take(3) {
        let device = file.build_device(variant, &[Arc::clone(plain_device())]);
        for error in check_device(text, &file, &device) {
            assert!((1..=lines).contains(&error.line), "{error}");
        }
        let mut resolver = EntryResolver::new(&device.dictionary, &NoValues);
        for object in device.dictionary.own_objects().iter().take(ASKED) {
            for entry in &object.entries {
                let address = ObjectAddress::new(object.index, entry.sub);
                let meaning = resolver.resolve_meaning(address).unwrap();
                let value = meaning.decode(&[0x80, 0xFF, 0x7F, 0x01]);
                assert!(!meaning.format_value(&value).is_empty() || value.to_string().is_empty());
                meaning.is_outside(&value);
            }
        }
    }
}
