//! Options that are added while the terminal UI runs: profiles, device files and databases.

use std::sync::Arc;

use cobscope_decoder::session::SessionOptions;

use crate::app::{AddedOption, Reassign, ReassignedOptions};
use crate::run::arguments::{EdsArg, InputArgs, NodeArg};
use crate::run::input::options_with;

/// Evaluates added options. Profiles and the bus file are not read again.
pub fn reassign(input: &InputArgs) -> Reassign {
    let mut input = input.clone();
    Box::new(move |added, before| {
        let next = add_option(&input, added)?;
        let reassigned = evaluate_options(&next, before)?;
        input = next;
        Ok(reassigned)
    })
}

/// The options with one more. It replaces the profile or device file that its node had.
fn add_option(input: &InputArgs, added: &AddedOption) -> anyhow::Result<InputArgs> {
    let mut next = input.clone();
    let is_other = |one: &NodeArg, node: &NodeArg| (one.id, &one.bus) != (node.id, &node.bus);
    let free = |next: &mut InputArgs, node: &NodeArg| {
        next.node.retain(|one| one.profile.is_none() || is_other(one, node));
        next.eds.retain(|one| is_other(&one.node, node));
    };
    match added {
        AddedOption::Profile { place, profile } => {
            let node: NodeArg = format!("{place}={profile}").parse().map_err(anyhow::Error::msg)?;
            free(&mut next, &node);
            next.node.push(node);
        }
        AddedOption::DeviceFile { place, file } => {
            let eds: EdsArg = format!("{place}={file}").parse().map_err(anyhow::Error::msg)?;
            free(&mut next, &eds.node);
            next.eds.push(eds);
        }
        AddedOption::Database { file } => next.dbc.push(file.into()),
    }
    Ok(next)
}

fn evaluate_options(input: &InputArgs, before: &SessionOptions) -> anyhow::Result<ReassignedOptions> {
    let mut problems = Vec::new();
    let catalogue = Arc::clone(&before.catalogue);
    let options = options_with(input, before.bus_file.clone(), catalogue, &mut problems)?;
    Ok(ReassignedOptions { options, problems })
}
