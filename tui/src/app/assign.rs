//! Assignment of a profile, device file or database while the program runs.

use std::fmt::Write as _;

use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::suggestion::{Suggestion, suggest_profiles};
use cobscope_decoder::words::count_noun;

use super::added::AddedOption;
use super::application::App;
use crate::state::{NodeKey, UiState};

impl App {
    /// The node for which the user assigns something: that of the selected row, else of the pane Nodes.
    pub(super) fn assigned_node(&self) -> Result<NodeKey, String> {
        let of_pane = self.panes.focused_pane().and_then(|pane| pane.selected_node(&self.core));
        let of_row = || self.core.cursor_row().and_then(|row| Some((row.event.bus, row.event.node?)));
        let node = of_pane.or_else(of_row).or(self.core.node).ok_or("select a row of a node first")?;
        match self.core.timeline.live() {
            Some(_) => {
                Err(format!("a live bus keeps its profiles; start again with --node {}=PROFILE", node.1))
            }
            None => Ok(node),
        }
    }

    /// Assigns a profile, device file or database, and decodes the captures again.
    ///
    /// # Errors
    /// Unknown profile, or a file that cannot be used.
    pub(super) fn assign_profile(&mut self, node: NodeKey, text: &str) -> Result<(), String> {
        let place = node_option(&self.core, node)?;
        let added = AddedOption::option_for(text.trim(), &place);
        let before = self.core.timeline.options().clone();
        let reassigned = (self.reassign)(&added, &before).map_err(|error| format!("{error:#}"))?;
        self.core.replace_options(reassigned.options).map_err(|error| format!("{error:#}"))?;
        self.jumps.is_surveyed = false;
        self.start_comparison();
        if let Some(place) = added.option_node() {
            self.command = without_device(&self.command, place);
        }
        // Writing to a string cannot fail.
        let _ = write!(self.command, " {}", added.option_text());
        let problems = match reassigned.problems.as_slice() {
            [] => String::new(),
            [one] => format!("; {one}"),
            [first, ..] => {
                format!("; {first} and {}", count_noun(reassigned.problems.len() - 1, "more problem"))
            }
        };
        self.core.show_message(&format!("decoded again with {}{problems}", added.option_text()));
        Ok(())
    }
}

/// The proposed text: the profile that the behaviour of the node suggests.
pub(super) fn proposed_profile(core: &UiState, node: NodeKey) -> Option<String> {
    match suggested_profiles(core, node).ok()?.as_slice() {
        [one] => Some(one.profile.clone()),
        _ => None,
    }
}

/// The command without the profile or device file of a node.
fn without_device(command: &str, place: &str) -> String {
    let mut words: Vec<&str> = Vec::new();
    for word in command.split(' ') {
        let is_of_node =
            word.trim_start_matches('\'').strip_prefix(place).is_some_and(|rest| rest.starts_with('='));
        if is_of_node && words.last().is_some_and(|option| ["--node", "--eds"].contains(option)) {
            words.pop();
        } else {
            words.push(word);
        }
    }
    words.join(" ")
}

/// The node as in `--node`: with its bus if the captures have several.
fn node_option(core: &UiState, (index, node): NodeKey) -> Result<String, String> {
    let end = core.timeline.end_state();
    let world: &ReplayState =
        end.as_deref().or_else(|| core.bus_state()).ok_or("still reading the captures")?;
    let buses = world.buses();
    let bus = buses.iter().find(|bus| bus.index() == index).ok_or("no such bus")?;
    Ok(if buses.len() == 1 { node.to_string() } else { format!("{}:{node}", bus.name()) })
}

/// Profiles that the behaviour of a node without a profile suggests: the firm ones, or all if there are none.
fn suggested_profiles(core: &UiState, (index, node): NodeKey) -> Result<Vec<Suggestion>, String> {
    let end = core.timeline.end_state();
    // Behaviour up to the end of the captures, or up to the cursor until they are read.
    let world: &ReplayState =
        end.as_deref().or_else(|| core.bus_state()).ok_or("still reading the captures")?;
    let bus = world.buses().iter().find(|bus| bus.index() == index).ok_or("no such bus")?;
    if bus.node(node).is_some_and(|node| node.device_id().is_some()) {
        return Ok(Vec::new());
    }
    let mut found = suggest_profiles(bus, bus.catalogue(), Some(node));
    if found.iter().any(|one| !one.is_weak) {
        found.retain(|one| !one.is_weak);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_has_one_device_in_the_command() {
        let command = "cobscope view --node 5=a --eds 15=b.eds --node 6=c x.log";
        assert_eq!(without_device(command, "5"), "cobscope view --eds 15=b.eds --node 6=c x.log");
        assert_eq!(without_device(command, "15"), "cobscope view --node 5=a --node 6=c x.log");
        assert_eq!(without_device(command, "x.log"), command);
    }
}
