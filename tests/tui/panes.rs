//! Legends of the panes: complete, short, and the source of docs/panes.md.

use std::fmt::Write as _;

use cobscope::keymap::default_bindings;
use cobscope::panes::{COMMON, LegendEntry, PaneId, PaneLayout, Panes};

use crate::docs::is_current;

/// Maximum number of words of a meaning.
const MOST_WORDS: usize = 15;

/// Maximum width of a mark, and of a meaning next to it on a screen of 80 columns.
const WIDTHS: (usize, usize) = (16, 60);

#[test]
fn every_column_head_is_in_the_legend() {
    let panes = Panes::default();
    for id in PaneId::ALL {
        let pane = panes.get(*id).unwrap();
        let titles = pane.table_heads().into_iter().map(|column| column.title.into_owned());
        let drawn: Vec<String> = titles.filter(|title| !title.is_empty()).collect();
        let explained: Vec<&str> = pane.pane_legend().columns.iter().map(|entry| entry.mark).collect();
        assert_eq!(explained, drawn, "{}", id.name());
    }
}

#[test]
fn a_legend_is_short_enough_for_80_columns() {
    let panes = Panes::default();
    let mut all = COMMON.to_vec();
    for id in PaneId::ALL {
        let legend = panes.get(*id).unwrap().pane_legend();
        all.extend(legend.columns.iter().chain(legend.marks));
    }
    for LegendEntry { mark, meaning, .. } in all {
        assert!(mark.chars().count() <= WIDTHS.0, "{mark}");
        assert!(meaning.chars().count() <= WIDTHS.1, "{mark}: {meaning}");
        assert!(meaning.split_whitespace().count() <= MOST_WORDS, "{mark}: {meaning}");
    }
}

/// A table of entries; nothing without entries.
fn table(text: &mut String, head: &str, entries: &[LegendEntry]) {
    if entries.is_empty() {
        return;
    }
    write!(text, "\n| {head} | meaning |\n| --- | --- |\n").unwrap();
    for LegendEntry { mark, meaning, .. } in entries {
        writeln!(text, "| `{mark}` | {meaning} |").unwrap();
    }
}

/// Panes with the main one in bold.
fn named(panes: &[PaneId], layout: PaneLayout) -> String {
    let name = |pane: &PaneId| {
        if *pane == layout.main() { format!("**{}**", pane.title()) } else { pane.title().to_owned() }
    };
    panes.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// The panes of a wide layout, one column after the other.
fn columns(layout: PaneLayout) -> String {
    let columns = layout.layout_columns().map(|column| named(column, layout));
    let columns: Vec<_> = columns.into_iter().filter(|column| !column.is_empty()).collect();
    if columns.is_empty() { "one pane".to_owned() } else { columns.join(" and, beside them, ") }
}

/// The panes of a narrow layout.
fn stack(layout: PaneLayout) -> String {
    let panes = named(layout.stacked_panes(), layout);
    if panes.is_empty() { "one pane".to_owned() } else { panes }
}

#[test]
fn the_reference_of_panes() {
    let mut text = String::from(
        "# Panes\n\nGenerated from the legends of the terminal UI. `?` shows the legend of the current pane and all keys.\n\n\
         ## All panes\n",
    );
    table(&mut text, "mark", COMMON);
    let panes = Panes::default();
    for (number, id) in (0..).zip(PaneId::ALL) {
        let legend = panes.get(*id).unwrap().pane_legend();
        writeln!(text, "\n## {number} {}\n\nKey `{number}`: {}.", id.title(), legend.purpose).unwrap();
        table(&mut text, "column", legend.columns);
        table(&mut text, "mark", legend.marks);
    }
    text += "\n## Layouts\n\nKey `|` or `--layout`. The default is `diagnose` from 140 columns or 40 lines, else `one`. In a terminal of \
             less than 140 columns the panes of the narrow layout are below each other. Panes that would have less than 8 lines \
             are left out, from the last one of a column. A pane that does not belong to the layout takes the place of the one in \
             bold.\n\n\
             | layout | 140 columns and more | narrower |\n| --- | --- | --- |\n";
    for layout in PaneLayout::ALL {
        writeln!(text, "| `{}` | {} | {} |", layout.name(), columns(layout), stack(layout)).unwrap();
    }
    text += "\n## Keys\n\nThe names of actions and keys are those of `[keys]` in the config file (docs/config.toml).\n\n\
             | key | action | meaning |\n| --- | --- | --- |\n";
    for binding in default_bindings() {
        let keys: Vec<String> =
            binding.keys.iter().map(|key| format!("`{}`", key.replace('|', "\\|"))).collect();
        writeln!(text, "| {} | `{}` | {} |", keys.join(" "), binding.name(), binding.help).unwrap();
    }
    is_current("docs/panes.md", &text);
}
