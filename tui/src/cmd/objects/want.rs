//! `cobscope objects --want`: what is configured in a node against what a DCF wants.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::device_file::{Access, DeviceFile, DeviceObject, Kind};
use cobscope_decoder::profile::{DataType, Value};
use cobscope_decoder::session::{Bus, Buses, Entry, Node};
use cobscope_decoder::sink::escape;
use cobscope_decoder::wire::NodeId;
use serde_json::json;

use super::entry::{hex, label, place};
use crate::cli::{ObjectsArgs, ReportFormat};
use crate::cmd::input::device_files;

/// Store and restore: a read tells what the device can do, not what was wanted.
const COMMANDS: [u16; 2] = [0x1010, 0x1011];

/// What is wanted of one node.
pub(super) struct Want {
    file: Arc<DeviceFile>,
    name: String,
    bus: Option<String>,
    node: NodeId,
    format: ReportFormat,
}

/// An object's value against the wanted one.
struct Compared<'a> {
    object: &'a DeviceObject,
    wanted: Vec<u8>,
    is: Option<&'a Entry>,
}

impl Want {
    /// # Errors
    /// A file that cannot be read or wants nothing; no node it could be of.
    pub(super) fn new(path: &Path, arguments: &ObjectsArgs) -> anyhow::Result<Self> {
        let shown = path.display();
        let file = device_files::read(path)?;
        let wants = file.objects.iter().any(|object| object.value.is_some());
        let why = match file.kind {
            Kind::Eds | Kind::Xdd => "an EDS or XDD has no values, a DCF or XDC does",
            Kind::Dcf => "no object in it has a ParameterValue",
            Kind::Xdc => "no object in it has an actualValue",
        };
        anyhow::ensure!(wants, "{shown}: wants nothing: {why}");
        let chosen = arguments.input.node.iter().find(|node| node.profile.is_none());
        let Some(node) = chosen.map(|node| node.id).or(file.node_id.map(NodeId::Canopen)) else {
            anyhow::bail!("{shown}: does not say of which node it is: add --node");
        };
        Ok(Self {
            name: device_files::name(path),
            bus: chosen.and_then(|node| node.bus.clone()),
            node,
            format: arguments.format,
            file,
        })
    }

    /// The node, and its bus where one is named.
    pub(super) fn chosen(&self) -> (Option<&str>, NodeId) {
        (self.bus.as_deref(), self.node)
    }

    /// Compares the node on every bus it was seen on.
    pub(super) fn compare(
        &self,
        buses: Buses<'_>,
        first: Option<Timestamp>,
        capture: &str,
        output: &mut String,
    ) {
        let wanted = |bus: &&Bus| self.bus.as_deref().is_none_or(|name| name == bus.name());
        for bus in buses.iter().filter(wanted) {
            let Some(node) = bus.node(self.node) else { continue };
            match self.format {
                ReportFormat::Text => self.text(bus, node, first, output),
                ReportFormat::Json => self.json(bus, node, capture, output),
            }
        }
    }

    /// Everything the file wants that can be compared.
    fn compared<'a>(&'a self, node: &'a Node) -> impl Iterator<Item = Compared<'a>> {
        let objects = self.file.objects.iter().filter(|object| !COMMANDS.contains(&object.address.index));
        objects.filter_map(|object| {
            let wanted = object.wanted(self.node.number())?;
            Some(Compared { object, wanted, is: node.store().seen(object.address) })
        })
    }

    fn text(&self, bus: &Bus, node: &Node, first: Option<Timestamp>, output: &mut String) {
        let (mut equal, mut differing, mut unseen) = (0, String::new(), Vec::new());
        let mut differ = 0;
        for compared in self.compared(node) {
            match compared.result() {
                Outcome::Equal => equal += 1,
                Outcome::Unseen if compared.object.access == Some(Access::Wo) => {}
                Outcome::Unseen => unseen.push(compared.object.address.to_string()),
                Outcome::Differs => {
                    differ += 1;
                    compared.row(node, first, &mut differing);
                }
            }
        }
        let unknown = unseen.len();
        let _ = writeln!(
            output,
            "{} against {}: {differ} different, {equal} equal, {unknown} never seen",
            label(bus, node),
            escape(&self.name)
        );
        output.push_str(&differing);
        if unknown > 0 {
            let _ = writeln!(output, "to be read: {}", unseen.join(" "));
        }
    }

    fn json(&self, bus: &Bus, node: &Node, capture: &str, output: &mut String) {
        for compared in self.compared(node) {
            let record = json!({
                "capture": capture,
                "bus": bus.name(),
                "node": node.id().number(),
                "object": format!("0x{}", compared.object.address),
                "name": node.meaning(compared.object.address).map(|meaning| meaning.name),
                "result": compared.result().name(),
                "wanted": hex(&compared.wanted),
                "data": compared.is.map(|entry| hex(&entry.value)),
                "origin": compared.is.map(|entry| entry.origin.kind.name()),
                "frame": compared.is.map(|entry| entry.origin.frame).filter(|frame| *frame != 0),
                "stale": compared.is.map(|entry| entry.stale),
            });
            let _ = writeln!(output, "{record}");
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Equal,
    Differs,
    Unseen,
}

impl Outcome {
    const fn name(self) -> &'static str {
        match self {
            Self::Equal => "equal",
            Self::Differs => "differs",
            Self::Unseen => "never-seen",
        }
    }
}

impl Compared<'_> {
    fn result(&self) -> Outcome {
        let Some(entry) = self.is else { return Outcome::Unseen };
        let decode = |bytes: &[u8]| self.object.data_type.map(|data_type| data_type.decode(bytes));
        if decode(&self.wanted) == decode(&entry.value) { Outcome::Equal } else { Outcome::Differs }
    }

    /// `1017:00  Producer heartbeat time   wanted 500 ms, is 1000 ms  written {88} 1.234 s`
    fn row(&self, node: &Node, first: Option<Timestamp>, output: &mut String) {
        let Some(entry) = self.is else { return };
        let object = self.object.address;
        let meaning = node.meaning(object);
        let show = |bytes: &[u8]| match meaning.as_ref().map(|meaning| (meaning, meaning.decode(bytes))) {
            Some((_, Value::Bytes(_))) | None => plain(bytes, self.object.data_type),
            Some((meaning, value)) => meaning.show(&value),
        };
        let name = meaning.as_ref().map_or(self.object.object_name.as_str(), |meaning| meaning.name.as_str());
        let stale = if entry.stale { "?" } else { "" };
        let waiting = node.store().waiting(object).filter(|waiting| waiting.value == self.wanted);
        let waits = waiting
            .map_or(String::new(), |waiting| format!(", the wanted one acts {}", waiting.effect.when()));
        let line = format!(
            "{object}  {name:<50}  wanted {}, is {}{stale}  {}{}{waits}",
            show(&self.wanted),
            show(&entry.value),
            entry.origin.kind.verb(),
            place(entry, first),
        );
        let _ = writeln!(output, "{}", escape(&line));
    }
}

/// A value of an object nothing but the file describes.
fn plain(bytes: &[u8], data_type: Option<DataType>) -> String {
    data_type.map_or(Value::Bytes(bytes.to_vec()), |data_type| data_type.decode(bytes)).to_string()
}
