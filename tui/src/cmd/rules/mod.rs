//! `cobscope rules`: lists all rules; also the page of one rule for `cobscope explain`.

mod json;
mod listed;
mod markdown;
mod page;

use cobscope_decoder::sink::table::{Align, Table};

use super::input::common_catalogue;
use super::output::print;
use crate::cli::{RulesArgs, RulesFormat};
use crate::exit_code::Exit;
pub(super) use listed::{ListedRule, find, listed, meant};
pub(super) use page::page;

/// Runs the command.
pub fn run(arguments: &RulesArgs) -> Exit {
    let rules = listed(&common_catalogue(&arguments.profiles));
    let text = match arguments.format {
        RulesFormat::Text => table(&rules),
        RulesFormat::Json => json::list(&rules),
        RulesFormat::Markdown => markdown::document(&rules),
    };
    print(text.as_bytes())
}

fn table(rules: &[ListedRule]) -> String {
    let mut table = Table::new(&[
        ("RULE", Align::Left),
        ("SEVERITY", Align::Left),
        ("ON", Align::Left),
        ("TIMING", Align::Left),
        ("DEFECT", Align::Left),
    ]);
    for rule in rules {
        let on = if rule.is_on { "on" } else { "off" };
        let timing = if rule.is_timing { "timing" } else { "" };
        table.row([
            rule.name.clone(),
            rule.severity.name().to_owned(),
            on.to_owned(),
            timing.to_owned(),
            rule.title.clone(),
        ]);
    }
    let mut text = String::new();
    table.write(0, &mut text);
    text
}
