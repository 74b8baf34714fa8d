//! Bundled profiles checked by their own samples, and wrong samples, which must fail.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::sync::Arc;

use cobscope_decoder::profile::device::{ProfileFile, ProfileSample};
use cobscope_decoder::profile::{Catalogue, DeviceProfile, ProfileError, check_device};
use cobscope_decoder::rules::check_names;
use cobscope_decoder::samples::check_samples;

use crate::support::workspace;

/// A bundled profile: its path, its text, its variants.
struct Bundled {
    path: String,
    text: String,
    file: ProfileFile,
    devices: Vec<Arc<DeviceProfile>>,
}

fn bundled() -> Vec<Bundled> {
    let catalogue = Catalogue::default();
    let all = catalogue.ids().into_iter().map(|id| {
        let folder = if catalogue.is_generic(&id) { "generic" } else { "vendor" };
        let path = format!("decoder/profiles/{folder}/{}.toml", id.replacen('-', "/", 1));
        let text = fs::read_to_string(workspace().join(&path)).unwrap();
        let file = ProfileFile::parse(&text).unwrap();
        let variants: Vec<_> = match file.variants() {
            [] => vec![id.clone()],
            variants => variants.iter().map(|variant| format!("{id}:{}", variant.id)).collect(),
        };
        let devices = variants.iter().map(|id| catalogue.device(id).unwrap()).collect();
        Bundled { path, text, file, devices }
    });
    all.collect()
}

#[test]
fn every_bundled_profile_is_right_in_every_variant() {
    let all = bundled();
    assert!(all.len() >= 5);
    let mut report = String::new();
    for Bundled { path, text, file, devices } in &all {
        for error in check_names(text, file) {
            writeln!(report, "{}", error.show_in_file(path)).unwrap();
        }
        for device in devices {
            assert!(!device.samples.is_empty(), "{path}");
            for error in [check_device(text, file, device), check_samples(text, device)].concat() {
                writeln!(report, "{}", error.show_in_file(path)).unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

/// A sample exists for each PDO layout, error, abort, state and procedure of a profile.
#[test]
fn every_layout_error_state_and_procedure_has_a_sample() {
    let mut missing = String::new();
    for device in bundled().iter().flat_map(|profile| &profile.devices) {
        let samples = || device.samples.iter().map(|(_, sample)| sample);
        let mut want = |what: &str, is_there: bool| {
            if !is_there {
                writeln!(missing, "{}: {what}", device.full_id).unwrap();
            }
        };
        for pdo in device.pdos.iter().filter(|pdo| !pdo.fields.is_empty()) {
            want(&pdo.pdo.to_string(), samples().any(|sample| sample.pdo == Some(pdo.pdo)));
        }
        for message in device.messages.iter().filter(|message| !message.fields.is_empty()) {
            want(&message.name, samples().any(|sample| sample.message.as_ref() == Some(&message.name)));
        }
        for fault in &device.j1939.dtc {
            let name = format!("{}/{}", fault.spn, fault.fmi);
            want(&name, samples().any(|sample| sample.dtc.as_ref() == Some(&name)));
        }
        for error in &device.emcy.code {
            let has = samples().any(|sample| sample.emcy == Some(error.code));
            want(&format!("EMCY {:04X}", error.code), has);
        }
        for abort in &device.aborts {
            let has =
                samples().any(|it| it.abort == Some(abort.code) && it.text.as_ref() == Some(&abort.text));
            want(&format!("abort {:08X} {}", abort.code, abort.text), has);
        }
        let states = device.machines.iter().flat_map(|machine| &machine.states);
        for state in states.map(|state| &state.name).collect::<BTreeSet<_>>() {
            want(state, samples().any(|sample| sample.state.as_ref() == Some(state)));
        }
        for procedure in &device.procedures {
            let has = samples().any(|sample| sample.procedure.as_ref() == Some(&procedure.name));
            want(&procedure.name, has);
        }
    }
    assert!(missing.is_empty(), "\n{missing}");
}

/// Copies of the sample with one changed statement each.
fn wrong_ones(sample: &ProfileSample) -> Vec<ProfileSample> {
    let mut all = Vec::new();
    let mut add = |change: &dyn Fn(&mut ProfileSample)| {
        let mut wrong = sample.clone();
        change(&mut wrong);
        all.push(wrong);
    };
    let other = |text: &mut Option<String>| {
        if let Some(text) = text {
            text.push('?');
        }
    };
    for object in sample.signals.keys() {
        add(&|it| *it.signals.get_mut(object).unwrap().get_mut() += 1.01);
    }
    for object in sample.texts.keys() {
        add(&|it| it.texts.get_mut(object).unwrap().push('?'));
    }
    if sample.emcy.is_some() {
        add(&|it| it.emcy = it.emcy.map(|code| code ^ 1));
    }
    if sample.message.is_some() {
        add(&|it| other(&mut it.message));
    }
    if sample.dtc.is_some() {
        add(&|it| it.dtc = Some("1/1".into()));
    }
    if sample.abort.is_some() {
        add(&|it| it.abort = it.abort.map(|code| code ^ 1));
    }
    if sample.value.is_some() {
        add(&|it| *it.value.as_mut().unwrap().get_mut() -= 1.01);
    }
    if sample.object.is_some() {
        add(&|it| it.object = Some("1FFF:00".into()));
    }
    for text in [&sample.text, &sample.unit, &sample.state, &sample.procedure, &sample.status, &sample.gate] {
        let Some(text) = text else { continue };
        add(&|it| {
            for own in
                [&mut it.text, &mut it.unit, &mut it.state, &mut it.procedure, &mut it.status, &mut it.gate]
            {
                if own.as_ref() == Some(text) {
                    other(own);
                }
            }
        });
    }
    if sample.cause.is_some() {
        add(&|it| other(&mut it.cause));
    }
    if sample.channel.is_some() {
        add(&|it| it.channel = Some(200));
    }
    all
}

#[test]
fn a_sample_that_states_anything_else_fails() {
    let mut report = String::new();
    let mut count = 0;
    for Bundled { text, devices, .. } in &bundled() {
        for device in devices {
            let mut changed = DeviceProfile::clone(device);
            changed.samples.clear();
            for (span, sample) in &device.samples {
                changed.samples.extend(wrong_ones(sample).into_iter().map(|wrong| (span.clone(), wrong)));
            }
            count += changed.samples.len();
            for (span, sample) in std::mem::take(&mut changed.samples) {
                let mut one = changed.clone();
                let shown = format!("{}: {sample:?}", device.full_id);
                one.samples.push((span, sample));
                if check_samples(text, &Arc::new(one)).is_empty() {
                    writeln!(report, "{shown}").unwrap();
                }
            }
        }
    }
    assert!(count > 600, "{count}");
    assert!(report.is_empty(), "\n{report}");
}

const PUMP: &str = "id = \"acme-pump\"\nextends = [\"cia301\"]\n\n\
    [[object]]\nindex = 0x2001\nname = \"Pressure\"\ntype = \"INTEGER16\"\nunit = \"bar\"\nscale = 0.1\n\n\
    [[pdo]]\npdo = \"TPDO1\"\nmapping = \"fixed\"\nfields = [{ object = \"2001:00\", bits = 16 }]\n\n";

/// Errors of a profile with one object, one PDO and this sample, without the position at their start.
fn wrong(sample: &str) -> Vec<String> {
    let text = format!("{PUMP}[[sample]]\n{sample}");
    let mut catalogue = Catalogue::default();
    catalogue.add_text("pump.toml", &text).unwrap();
    let device = catalogue.device("acme-pump").unwrap();
    check_samples(&text, &device).iter().map(|error| format!("{}: {}", error.line, error.message)).collect()
}

#[test]
fn numbers_are_compared_to_half_of_the_last_digit_written() {
    let pdo = |value: &str| {
        wrong(&format!("frames = [\"181#EF01\"]\npdo = \"TPDO1\"\nsignals = {{ \"2001:00\" = {value} }}"))
    };
    // 01EF = 495: 49.5 bar.
    for value in ["49.5", "49.50", "49", "50", "5e1"] {
        assert!(pdo(value).is_empty(), "{value}");
    }
    assert_eq!(pdo("49.4"), ["19: acme-pump: sample: 2001:00: found 49.5, expected 49.4"]);
    assert_eq!(pdo("49.51"), ["19: acme-pump: sample: 2001:00: found 49.5, expected 49.51"]);
    assert_eq!(pdo("48"), ["19: acme-pump: sample: 2001:00: found 49.5, expected 48"]);
}

#[test]
fn a_sample_that_shows_nothing_is_wrong() {
    let about = "about = \"x\"\n";
    assert_eq!(
        wrong(&format!("{about}frames = [\"181#EF01\"]")),
        [
            "16: acme-pump: sample: x: nothing to compare; expected pdo, message, emcy, dtc, object, abort, uds, nrc, state, procedure or gate"
        ]
    );
    assert_eq!(
        wrong("frames = [\"181#EF01\"]\npdo = \"TPDO1\""),
        ["16: acme-pump: sample: no values of TPDO1 to compare; expected signals or texts"]
    );
    assert_eq!(
        wrong("frames = [\"181#EF01\"]\nemcy = 0x8110"),
        ["16: acme-pump: sample: the last frame: found nmt-state, pdo, expected an EMCY"]
    );
    assert_eq!(
        wrong("frames = [\"181#EF01\"]\npdo = \"TPDO1\"\nsignals = { \"2002:00\" = 1 }"),
        ["19: acme-pump: sample: 2002:00 is not in TPDO1"]
    );
    assert_eq!(
        wrong("frames = [\"181#EF0\"]\nemcy = 0x8110"),
        ["16: acme-pump: sample: invalid frame; expected a form such as 182#08A0, 701#R or 702#"]
    );
    assert_eq!(
        wrong("frames = [\"181#EF01\", \"181#EF0\"]\nemcy = 0x8110"),
        [
            "16: acme-pump: sample: frames: line 2: data: expected pairs of hex digits; found \"(1000000000.010000) can0 181#EF0\""
        ]
    );
    assert_eq!(
        wrong("frames = [\"181#EF01\"]\ngiven = { \"x\" = 1 }\nemcy = 0x8110"),
        ["16: acme-pump: sample: given: x: not a valid object; expected e.g. 1018:01"]
    );
}

#[test]
fn a_sample_belongs_to_a_node() {
    for node in ["0", "128", "\"sa:254\""] {
        let sample = format!("{PUMP}[[sample]]\nnode = {node}\nframes = [\"081#\"]\nemcy = 0x8110");
        let Err(ProfileError::Broken { errors, .. }) = Catalogue::default().add_text("pump.toml", &sample)
        else {
            panic!("node {node} is taken")
        };
        assert_eq!(errors[0].message, "expected a node-ID 1 to 127 or a J1939 address sa:0 to sa:253");
    }
}

#[test]
fn transfers_name_what_they_found() {
    let read = |rest: &str| {
        wrong(&format!("frames = [\"601#4001200000000000\", \"581#4B012000EF010000\"]\nobject = {rest}"))
    };
    assert!(read("\"2001:00\"\nvalue = 49.5\nunit = \"bar\"").is_empty());
    assert_eq!(
        read("\"2001:00\"\nvalue = 49.5\nunit = \"psi\""),
        ["16: acme-pump: sample: unit: found 'bar', expected 'psi'"]
    );
    assert_eq!(
        read("\"2001:01\"\nvalue = 49.5"),
        ["16: acme-pump: sample: object: found 2001:00, expected 2001:01"]
    );
    let refused = "frames = [\"601#4001200000000000\", \"581#8001200000000206\"]\n";
    assert_eq!(
        wrong(&format!("{refused}object = \"2001:00\"\nvalue = 1")),
        ["16: acme-pump: sample: the transfer: found aborted, expected complete"]
    );
    assert_eq!(
        wrong(&format!("{refused}abort = 0x06020000\ntext = \"gone\"")),
        ["16: acme-pump: sample: text: found '', expected 'gone'"]
    );
}
