//! EDS, DCF, XDD and XDC files: reading, problems, assignment to nodes, and use as profiles.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::profile::device_file::{self, DeviceFile};
use cobscope_decoder::profile::{Catalogue, DeviceProfile, imported};
use cobscope_decoder::session::{AssignedBy, Assignment};
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::words::count_noun;

use super::limited::read_bytes;
use crate::path_text::path_text;
use crate::run::arguments::{EdsArg, InputArgs};
use crate::run::messages::print_warning;

/// Maximum number of problems printed per file.
const REPORTED: usize = 5;

/// Whether a file name has the suffix of a device file.
pub fn is_device_file(path: &Path) -> bool {
    let kinds = ["eds", "dcf", "xdd", "xdc"];
    path.extension().is_some_and(|extension| kinds.iter().any(|kind| extension.eq_ignore_ascii_case(kind)))
}

/// File name without the folder.
pub fn file_name(path: &Path) -> String {
    path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned())
}

/// Reads a device file.
///
/// # Errors
/// If the file is unreadable or not a device file.
pub fn read_device_file(path: &Path) -> anyhow::Result<Arc<DeviceFile>> {
    let file = device_file::parse_device_file(&read_bytes(path)?).with_context(|| path_text(path))?;
    Ok(Arc::new(file))
}

/// Problems of a file, one line each: `pump.eds:12: reason`.
pub fn problem_lines(path: &Path, file: &DeviceFile) -> Vec<String> {
    let shown = path_text(path);
    let line = |problem: &device_file::DescriptionProblem| match problem.line {
        0 => format!("{shown}: {}", problem.reason),
        line => format!("{shown}:{line}: {}", problem.reason),
    };
    file.problems.iter().map(line).collect()
}

/// Device files of nodes: those of the bus file, then those of the options, which take precedence.
///
/// # Errors
/// If a file is unreadable or not a device file; errors inside a readable file are added to `problems`.
pub(super) fn device_assignments(
    input: &InputArgs,
    bus_file: &BusFile,
    problems: &mut Vec<String>,
) -> anyhow::Result<Vec<Assignment>> {
    let folder = input.bus.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let mut reader = DescriptionReader { devices: BTreeMap::new(), problems };
    let mut all = Vec::new();
    for (bus, node, file) in bus_file.device_files() {
        let device = reader.read_device(&folder.join(file), node)?;
        all.push(Assignment { bus: bus.map(Into::into), node, device, by: AssignedBy::DeviceFile });
    }
    for EdsArg { node, file } in &input.eds {
        let device = reader.read_device(file, node.id)?;
        all.push(Assignment { bus: node.bus.clone(), node: node.id, device, by: AssignedBy::DeviceFile });
    }
    Ok(all)
}

/// Reads each file once and reports its problems once.
struct DescriptionReader<'a> {
    devices: BTreeMap<PathBuf, Arc<DeviceProfile>>,
    problems: &'a mut Vec<String>,
}

impl DescriptionReader<'_> {
    fn read_device(&mut self, path: &Path, node: NodeId) -> anyhow::Result<Arc<DeviceProfile>> {
        let device = if let Some(device) = self.devices.get(path) {
            Arc::clone(device)
        } else {
            let file = read_device_file(path)?;
            self.problems.extend(first_problems(path, &file));
            let device = Arc::new(imported::describe_device(&file, &file_name(path)));
            self.devices.insert(path.to_owned(), Arc::clone(&device));
            device
        };
        let own = device.file.as_ref().and_then(|import| import.file.node_id);
        if let Some(own) = own.filter(|own| node != NodeId::Canopen(*own)) {
            self.problems.push(format!("{}: for node {own}; used for node {node}", path_text(path)));
        }
        Ok(device)
    }
}

/// The first problems and the number of further ones.
fn first_problems(path: &Path, file: &DeviceFile) -> Vec<String> {
    let mut lines = problem_lines(path, file);
    if let Some(more) = lines.len().checked_sub(REPORTED).filter(|more| *more > 0) {
        let shown = path_text(path);
        lines.truncate(REPORTED);
        lines
            .push(format!("{shown}: {} (cobscope profiles check {shown})", count_noun(more, "more problem")));
    }
    lines
}

/// Adds a device file to the profiles; reports it if it is unreadable.
pub fn add_to(catalogue: &mut Catalogue, path: &Path) {
    let file = match read_device_file(path) {
        Ok(file) => file,
        Err(error) => return print_warning(&format!("{error:#}")),
    };
    let name = file_name(path);
    let mut device = imported::describe_device(&file, &name);
    let known = catalogue.ids();
    let stem = imported::id_of_name(&name);
    let kind = format!("{stem}-{}", file.kind.name());
    let numbered = (2_u32..).map(|number| format!("{kind}-{number}"));
    let ids = [device.id.clone(), stem, kind.clone()].into_iter().chain(numbered);
    if let Some(free) = ids.into_iter().find(|id| !known.contains(id)) {
        device.full_id.clone_from(&free);
        device.id = free;
    }
    catalogue.add_device(&path.display().to_string(), device);
}
