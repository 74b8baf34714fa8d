//! Texts after the options in help and manual pages: examples, exit statuses.

/// Exit statuses, as in the README.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  success, even if some lines are unreadable
  1  check, live --check: findings at or above --fail-on, or a required rule is not exercised;
     diff: the captures differ
  2  the command line is invalid, or an output cannot be created
  3  a capture is unreadable, incomplete or without frames, or an output is incomplete;
     check: a node of --only-node sent no frame
  4  a profile, bus file, device file, DBC or baseline is invalid or unreadable";

macro_rules! examples {
    ($($(#[$condition:meta])? $name:ident: $first:literal $(, $more:literal)*;)*) => {
        $(
            $(#[$condition])?
            #[doc = "Examples of a command."]
            pub const $name: &str = concat!("Examples:\n  ", $first $(, "\n  ", $more)*);
        )*

        #[cfg(test)]
        const ALL: &[&[&str]] = &[$($(#[$condition])? &[$first $(, $more)*]),*];
    };
}

examples! {
    VIEW:
        "cobscope view customer.log",
        "cobscope view --node 2=rexroth-sydfec --pane signals a.log b.log",
        "cobscope view --layout list --at 12.5 --filter 'node == 5' customer.log";
    LIVE:
        "cobscope live can0",
        "cobscope live --print --record run.pcapng --record-size 100M can0",
        "cobscope live --check -T 5000 pcan:USB1@500k";
    DECODE:
        "cobscope decode customer.log",
        "cobscope decode --filter 'kind == emcy && node == 5' --from 10 --to 60 customer.log",
        "cobscope decode -f csv -o values.csv --node 2=rexroth-sydfec customer.log";
    CONVERT:
        "cobscope convert customer.blf customer.log",
        "cobscope convert --from 120 --to 180 --bus-file part.bus.toml run.log part.pcapng",
        "cobscope convert --split-size 100M a.trc b.trc all.pcapng";
    STATS:
        "cobscope stats customer.log",
        "cobscope stats --from 10 --to 60 --bitrate 250k customer.log",
        "cobscope stats --bitrate can0:250k --bitrate can1:500k -f json customer.log";
    OBJECTS:
        "cobscope objects customer.log",
        "cobscope objects --node 5 --at 12.5 customer.log",
        "cobscope objects --node 5 --want pump.dcf customer.log";
    WHY:
        "cobscope why customer.log",
        "cobscope why --node 5 --at 12.5 customer.log",
        "cobscope why --node 5 --node 5=wandfluh-md2 -f json customer.log";
    DIFF_EXAMPLES:
        "cobscope diff good.log bad.log --bus machine.toml",
        "cobscope diff --at-event 'kind == boot-up && node == 2' good.log bad.log",
        "cobscope diff --only configuration,timing -f json golden/ run/";
    REPORT:
        "cobscope report customer.log -o case.html",
        "cobscope report --node 2=rexroth-sydfec --story 1 --attach customer.log -o case.html",
        "cobscope report captures/ -o reports/";
    CHECK_EXAMPLES:
        "cobscope check --node 2=rexroth-sydfec customer.log",
        "cobscope check --baseline known.json captures/",
        "cobscope check -f junit -o findings.xml --fail-on warning captures/";
    EXPLAIN:
        "cobscope explain 06090030",
        "cobscope explain 601#2B171000E8030000",
        "cobscope explain 8102 --device rexroth-sydfec";
    PROFILES:
        "cobscope profiles show rexroth-sydfec",
        "cobscope profiles import pump.eds > devices/pump.toml",
        "cobscope profiles check devices/pump.toml";
    EXTCAP:
        "cobscope extcap --install",
        "cobscope extcap --install --dir /usr/lib/x86_64-linux-gnu/wireshark/extcap";
    MCP:
        "cobscope mcp captures/",
        "cobscope mcp --profiles devices/ captures/ machines/";
    #[cfg(feature = "parquet")]
    LAKE:
        "cobscope lake add lake/ --bus excavator-7.toml captures/",
        "cobscope lake add lake/ --machine-from 'machines/([^/]+)/' machines/";
}

/// Examples of `check`, and the exit statuses.
pub fn check_notes() -> String {
    format!("{CHECK_EXAMPLES}\n\n{EXIT_STATUS}")
}

/// Examples of `diff`, and the exit statuses.
pub fn diff_notes() -> String {
    format!("{DIFF_EXAMPLES}\n\n{EXIT_STATUS}")
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser as _};

    use super::*;
    use crate::cli::Cli;

    /// Commands without examples.
    const PLAIN: [&str; 3] = ["rules", "completions", "man"];

    #[test]
    fn every_command_has_examples() {
        let cli = Cli::command();
        let is_without = |command: &&clap::Command| {
            !command.get_after_help().is_some_and(|help| help.to_string().starts_with("Examples:"))
        };
        let without = cli.get_subcommands().filter(is_without).map(clap::Command::get_name);
        assert_eq!(without.collect::<Vec<_>>(), PLAIN);
    }

    #[test]
    fn examples_are_understood() {
        for example in ALL.iter().copied().flatten() {
            let line = example.split(" > ").next().unwrap();
            let parts = line.split('\'').enumerate();
            let words =
                parts.flat_map(
                    |(at, part)| {
                        if at % 2 == 1 { vec![part] } else { part.split_whitespace().collect() }
                    },
                );
            Cli::try_parse_from(words).unwrap_or_else(|error| panic!("{example}: {error}"));
        }
    }
}
