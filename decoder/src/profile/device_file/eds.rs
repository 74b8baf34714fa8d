//! EDS and DCF (CiA 306-1): device information, lists of objects, objects.

use std::collections::BTreeSet;
use std::collections::btree_map::{BTreeMap, Entry};

use super::ini::{IniFile, IniSection};
use super::number::parse_integer;
use super::object::{IndexSections, ObjectFile};
use super::problem::DescriptionProblems;
use super::section::SectionName;
use super::value::strip_comment;
use super::{DescriptionKind, DeviceDescriptionError, DeviceFile, DeviceObject, MOST_ENTRIES};
use crate::profile::quoted::quote_start;

/// Sections that list the objects (CiA 306-1 §4.6.2).
const LISTS: [&str; 3] = ["mandatoryobjects", "optionalobjects", "manufacturerobjects"];

/// Additional section of a DCF (CiA 306-1 §4.7), in the standard's spelling and the correct one.
const COMMISSIONING: [&str; 2] = ["devicecomissioning", "devicecommissioning"];

/// Bit rates with a keyword of their own, in kbit/s.
const BIT_RATES: [u32; 8] = [10, 20, 50, 125, 250, 500, 800, 1000];

/// Parses an EDS or DCF.
pub(super) fn parse_eds(text: &str) -> Result<DeviceFile, DeviceDescriptionError> {
    let mut problems = DescriptionProblems::default();
    let ini = IniFile::parse(text, &mut problems);
    let mut context = ObjectFile { ini: &ini, problems: &mut problems };
    let objects = sort_sections(&mut context);
    let is_known =
        ["deviceinfo", "fileinfo"].iter().chain(&COMMISSIONING).any(|key| ini.parse_section(key).is_some());
    if objects.is_empty() && !is_known {
        return Err(DeviceDescriptionError::NoSection);
    }
    let mut file = DeviceFile::new(file_kind(&ini));
    device_info(&mut context, &mut file);
    parse_commissioning(&mut context, &mut file);
    check_lists(&mut context, &objects);
    for (index, sections) in &objects {
        let mut entries = context.parse_object(*index, sections);
        let room = MOST_ENTRIES.saturating_sub(file.objects.len());
        if entries.len() > room {
            let line = entries.get(room).map_or(0, |entry| entry.line);
            context.problems.add_problem(
                line,
                format!("objects from {index:04X} on skipped (max {MOST_ENTRIES} entries)"),
            );
            entries.truncate(room);
            file.objects.extend(entries);
            break;
        }
        check_limits(&mut context, &entries);
        file.objects.extend(entries);
    }
    file.complete_identity(&mut problems);
    file.problems = problems.finish();
    Ok(file)
}

/// Sections by index. The first of duplicate sections is used, like in the Windows functions for which this
/// file format was designed.
fn sort_sections(context: &mut ObjectFile<'_, '_>) -> BTreeMap<u16, IndexSections> {
    let mut objects = BTreeMap::<u16, IndexSections>::new();
    let mut of_modules = Vec::new();
    for (at, section) in context.ini.sections.iter().enumerate() {
        let is_new = match SectionName::parse_name(&section.key) {
            SectionName::Object(index) => take_place(&mut objects.entry(index).or_default().main, at),
            SectionName::Sub(index, sub) => match objects.entry(index).or_default().subs.entry(sub) {
                Entry::Vacant(vacant) => *vacant.insert(at) == at,
                Entry::Occupied(_) => false,
            },
            SectionName::Names(index) => take_place(&mut objects.entry(index).or_default().names, at),
            SectionName::Values(index) => take_place(&mut objects.entry(index).or_default().values, at),
            SectionName::Denotations(index) => {
                take_place(&mut objects.entry(index).or_default().denotations, at)
            }
            SectionName::ModuleFixed(index, sub) => {
                of_modules.push((at, index, sub));
                true
            }
            SectionName::ModuleExtension => {
                context.problems.add_problem(
                    section.line,
                    format!("[{}] skipped: its sub-indices depend on the installed modules", section.name),
                );
                true
            }
            SectionName::Strange => {
                context.problems.add_problem(
                    section.line,
                    format!("[{}] skipped: not a valid section name of an object", section.name),
                );
                true
            }
            SectionName::Other => context.ini.is_first(at),
        };
        if !is_new {
            context.problems.add_problem(
                section.line,
                format!("duplicate section [{}]; the first one is used", section.name),
            );
        }
    }
    place_modules(context, &of_modules, &mut objects);
    objects
}

/// Adds the objects of modules, whose addresses do not depend on the slot. Objects of the device itself take
/// precedence, then those of the first module.
fn place_modules(
    context: &mut ObjectFile<'_, '_>,
    of_modules: &[(usize, u16, Option<u8>)],
    objects: &mut BTreeMap<u16, IndexSections>,
) {
    for (at, index, sub) in of_modules.iter().copied() {
        let sections = objects.entry(index).or_default();
        let first = match sub {
            None => *sections.main.get_or_insert(at),
            Some(sub) => *sections.subs.entry(sub).or_insert(at),
        };
        if let (false, Some(section), Some(first)) =
            (first == at, context.ini.sections.get(at), context.ini.sections.get(first))
        {
            let reason = format!("[{}] skipped: same address as [{}]", section.name, first.name);
            context.problems.add_problem(section.line, reason);
        }
    }
}

fn take_place(place: &mut Option<usize>, at: usize) -> bool {
    *place.get_or_insert(at) == at
}

/// DCF if the file contains configured values of a device, otherwise EDS.
fn file_kind(ini: &IniFile<'_>) -> DescriptionKind {
    let is_dcf = COMMISSIONING.iter().any(|key| ini.parse_section(key).is_some())
        || ini.parse_section("connectedmodules").is_some()
        || ini.sections.iter().any(|section| section.value("parametervalue").is_some());
    if is_dcf { DescriptionKind::Dcf } else { DescriptionKind::Eds }
}

/// `[DeviceInfo]` (CiA 306-1 §4.5).
fn device_info(context: &mut ObjectFile<'_, '_>, file: &mut DeviceFile) {
    let Some(section) = context.ini.parse_section("deviceinfo") else {
        context
            .problems
            .add_problem(0, "section [DeviceInfo] is missing; vendor and product are taken from object 1018");
        return;
    };
    let text = |context: &mut ObjectFile<'_, '_>, key| {
        section.entry(key).and_then(|entry| context.parse_text(entry))
    };
    file.vendor_name = text(context, "vendorname").unwrap_or_default();
    file.product_name = text(context, "productname").unwrap_or_default();
    file.vendor_id = parse_ranged(context, section, "vendornumber");
    file.product_code = parse_ranged(context, section, "productnumber");
    file.revision = parse_ranged(context, section, "revisionnumber");
    for rate in BIT_RATES {
        if context.parse_number(section, &format!("baudrate_{rate}")).is_some_and(|number| number != 0) {
            file.bit_rates.push(rate.saturating_mul(1000));
        }
    }
}

/// `[DeviceComissioning]` (CiA 306-1 §4.7.1).
fn parse_commissioning(context: &mut ObjectFile<'_, '_>, file: &mut DeviceFile) {
    let Some(section) = COMMISSIONING.iter().find_map(|key| context.ini.parse_section(key)) else { return };
    file.node_name =
        section.entry("nodename").and_then(|entry| context.parse_text(entry)).unwrap_or_default();
    let node_id: Option<u32> = parse_ranged(context, section, "nodeid");
    file.node_id = node_id.and_then(|id| u8::try_from(id).ok()).filter(|id| (1..=127).contains(id));
    if let Some(id) = node_id.filter(|_| file.node_id.is_none()) {
        let line = section.entry("nodeid").map_or(section.line, |entry| entry.line);
        context.problems.add_problem(line, format!("NodeID {id}: expected 1 to 127"));
    }
    // In kbit/s; 0 means unknown.
    let rate: Option<u32> = parse_ranged(context, section, "baudrate");
    file.bit_rate = rate.and_then(|rate| rate.checked_mul(1000)).filter(|rate| *rate != 0);
}

/// Parses a 32-bit number; reports an invalid one.
fn parse_ranged(context: &mut ObjectFile<'_, '_>, section: &IniSection<'_>, key: &str) -> Option<u32> {
    let entry = section.entry(key)?;
    let found = parse_integer(strip_comment(entry.value));
    let number = found.and_then(|found| u32::try_from(found.value).ok());
    let doubt = match found {
        _ if strip_comment(entry.value).is_empty() => return None,
        Some(found) if number.is_some() => found.doubt,
        _ => Some("expected a 32-bit number"),
    };
    if let Some(doubt) = doubt {
        context
            .problems
            .add_problem(entry.line, format!("{} {}: {doubt}", entry.name, quote_start(entry.value)));
    }
    number
}

/// Checks that every object from 1000 on is in a list.
fn check_lists(context: &mut ObjectFile<'_, '_>, objects: &BTreeMap<u16, IndexSections>) {
    let lists: Vec<_> = LISTS.iter().filter_map(|key| context.ini.parse_section(key)).collect();
    if lists.is_empty() {
        context.problems.add_problem(0, "no list of objects; expected [MandatoryObjects]");
        return;
    }
    let mut listed = BTreeSet::new();
    for section in lists {
        check_list(context, section, objects, &mut listed);
    }
    for (_, sections) in objects.range(0x1000..).filter(|(index, _)| !listed.contains(*index)) {
        let section = sections.main.and_then(|at| context.ini.sections.get(at));
        // Objects of modules have separate lists.
        if let Some(section) = section.filter(|section| !section.key.starts_with('m')) {
            let reason = format!("[{}] is not in a list of objects; used anyway", section.name);
            context.problems.add_problem(section.line, reason);
        }
    }
}

/// Checks that every listed object has a section.
fn check_list<'a>(
    context: &mut ObjectFile<'a, '_>,
    section: &IniSection<'a>,
    objects: &BTreeMap<u16, IndexSections>,
    listed: &mut BTreeSet<u16>,
) {
    let mut count = 0_i128;
    for (_, entry) in section.numbered_entries() {
        count = count.saturating_add(1);
        let number =
            parse_integer(strip_comment(entry.value)).and_then(|found| u16::try_from(found.value).ok());
        let Some(index) = number else {
            context
                .problems
                .add_problem(entry.line, format!("{}: expected an index", quote_start(entry.value)));
            continue;
        };
        listed.insert(index);
        if objects.get(&index).is_none_or(|sections| sections.main.is_none()) {
            let reason = format!("{index:04X} is listed, but section [{index:04X}] is missing");
            context.problems.add_problem(entry.line, reason);
        }
    }
    let announced = context.parse_number(section, "supportedobjects");
    if let Some(announced) = announced.filter(|announced| *announced != count) {
        let reason = format!("SupportedObjects {announced} in [{}], but {count} listed", section.name);
        context.problems.add_problem(section.line, reason);
    }
}

/// Reports limits that exclude all values.
fn check_limits(context: &mut ObjectFile<'_, '_>, entries: &[DeviceObject]) {
    for entry in entries {
        let limits = (
            entry.low.as_ref().and_then(|low| low.number_for(0)),
            entry.high.as_ref().and_then(|high| high.number_for(0)),
        );
        if let (Some(low), Some(high)) = limits
            && low > high
        {
            context
                .problems
                .add_problem(entry.line, format!("{}: LowLimit {low} > HighLimit {high}", entry.address));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> DeviceFile {
        parse_eds(text).unwrap()
    }

    #[test]
    fn the_device_and_its_commissioning() {
        let file = read(
            "[DeviceInfo]\nVendorName=A\nVendorNumber=0x1F\nBaudRate_10=1\nBaudRate_1000=0x1\nBaudRate_20=0\n\
             [DeviceComissioning]\nNodeID=0x10\nNodeName=N\nBaudrate=125",
        );
        assert_eq!((file.vendor_name.as_str(), file.vendor_id), ("A", Some(31)));
        assert_eq!((file.node_id, file.node_name.as_str(), file.bit_rate), (Some(16), "N", Some(125_000)));
        assert_eq!(file.bit_rates, [10_000, 1_000_000]);
    }

    #[test]
    fn lists_and_sections_are_held_against_each_other() {
        let file = read(
            "[DeviceInfo]\n[MandatoryObjects]\nSupportedObjects=2\n1=0x1000\n[5]\nObjectType=5\n\
             [1001]\nParameterName=E\nDataType=5\nAccessType=ro",
        );
        let problems: Vec<_> = file.problems.iter().map(ToString::to_string).collect();
        assert_eq!(
            problems,
            [
                "line 2: SupportedObjects 2 in [MandatoryObjects], but 1 listed",
                "line 4: 1000 is listed, but section [1000] is missing",
                "line 7: [1001] is not in a list of objects; used anyway",
            ]
        );
    }

    #[test]
    fn of_two_sections_the_first_counts_however_they_are_spelled() {
        let file = read(
            "[MandatoryObjects]\n[2000sub1]\nParameterName=A\n[2000SUB01]\nParameterName=B\n[mandatoryobjects]",
        );
        assert_eq!(file.objects[0].entry_name.as_deref(), Some("A"));
        let twice: Vec<_> =
            file.problems.iter().filter(|problem| problem.reason.contains("duplicate section")).collect();
        assert_eq!(twice.iter().map(|problem| problem.line).collect::<Vec<_>>(), [4, 6]);
    }
}
