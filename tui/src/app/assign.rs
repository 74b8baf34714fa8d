//! Assignment of a suggested profile to a node.

use std::fmt::Write as _;

use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::{AssignedBy, Assignment};
use cobscope_decoder::suggestion::{Suggestion, suggestions};

use super::application::App;
use super::start::quoted;
use crate::state::{Core, NodeKey};

impl App {
    /// Assigns the profile that the behaviour of a node suggests, and decodes the captures again.
    pub(super) fn assign(&mut self, key: NodeKey) {
        match chosen(&self.core, key).and_then(|chosen| self.decode_with(key, &chosen)) {
            Ok(text) => self.core.notify(&text),
            Err(reason) => self.core.refuse(&reason),
        }
    }

    fn decode_with(&mut self, (_, node): NodeKey, chosen: &Chosen) -> Result<String, String> {
        let Chosen { bus, place, profile, title } = chosen;
        let mut options = self.core.timeline.options().clone();
        let device = options.catalogue.device(profile).map_err(|error| error.to_string())?;
        let (bus, by) = (bus.clone(), AssignedBy::Option);
        options.assignments.push(Assignment { bus, node, device, by });
        self.core.replace(options).map_err(|error| format!("{error:#}"))?;
        self.is_surveyed = false;
        let option = format!("{place}={profile}");
        // Writing to a string cannot fail.
        let _ = write!(self.command, " --node {}", quoted(&option));
        Ok(format!("{} decoded as {title} from its first frame: --node {option}", node.words()))
    }
}

/// The profile to assign.
struct Chosen {
    /// Bus of the assignment; `None` if the captures have only one.
    bus: Option<String>,
    /// Node as in `--node`.
    place: String,
    profile: String,
    title: String,
}

fn chosen(core: &Core, (index, node): NodeKey) -> Result<Chosen, String> {
    if core.timeline.live().is_some() {
        return Err(format!("a live bus keeps its profiles; start again with --node {node}=PROFILE"));
    }
    let end = core.timeline.end();
    // Behaviour up to the end of the captures, or up to the cursor until they are read.
    let world: &ReplayState = end.as_deref().or_else(|| core.world()).ok_or("still reading the captures")?;
    let buses = world.buses();
    let bus = buses.iter().find(|bus| bus.index() == index).ok_or("no such bus")?;
    let is_only = buses.len() == 1;
    let place = if is_only { node.to_string() } else { format!("{}:{node}", bus.name()) };
    if let Some((id, by)) = bus.node(node).and_then(|node| node.device_id().zip(node.assigned())) {
        return Err(format!("{} already has the profile {id}, assigned by {}", node.words(), by.name()));
    }
    let found = likely(suggestions(bus, bus.catalogue(), Some(node)));
    match found.as_slice() {
        [] => Err(format!(
            "no profile fits the behaviour of {}; --node {place}=PROFILE assigns one, `profiles` lists them",
            node.words()
        )),
        [one] => Ok(Chosen {
            bus: (!is_only).then(|| bus.name().to_owned()),
            place,
            profile: one.profile.clone(),
            title: one.title.clone(),
        }),
        several => {
            let options: Vec<String> =
                several.iter().map(|one| format!("--node {place}={}", one.profile)).collect();
            Err(format!("{} fits several profiles: {}", node.words(), options.join(", ")))
        }
    }
}

/// The firm suggestions, or all if there are none.
fn likely(mut found: Vec<Suggestion>) -> Vec<Suggestion> {
    if found.iter().any(|one| !one.is_weak) {
        found.retain(|one| !one.is_weak);
    }
    found
}
