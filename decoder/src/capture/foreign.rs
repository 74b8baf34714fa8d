//! Files that are passed as captures by mistake, or that contain captures in an unreadable form: what they are, and
//! what to do.
//!
//! They are looked up only after no format of captures matches, so nothing here can take a capture away from its reader.

use super::text::line_format::first_lines;

/// A kind of file without frames for this program.
#[derive(Debug, PartialEq, Eq)]
pub struct ForeignFile {
    /// The kind, with its article: `a ZIP archive`.
    pub name: &'static str,
    /// What to do with it.
    pub remedy: &'static str,
}

const fn foreign(name: &'static str, remedy: &'static str) -> ForeignFile {
    ForeignFile { name, remedy }
}

const UNPACK: &str = "unpack it, then pass the captures in it";
const DATABASE: &str = "export it as DBC, then use --dbc FILE with a capture";
const RESULTS: &str = "pass the capture that it was made from";

/// Kinds by bytes at an offset.
const BINARY: &[(usize, &[u8], ForeignFile)] = &[
    (0, b"PK\x03\x04", foreign("a ZIP archive", UNPACK)),
    (0, b"7z\xBC\xAF\x27\x1C", foreign("a 7z archive", UNPACK)),
    (0, b"Rar!\x1A\x07", foreign("a RAR archive", UNPACK)),
    (0, b"\xFD7zXZ\0", foreign("a file compressed with xz", UNPACK)),
    (0, b"BZh", foreign("a file compressed with bzip2", UNPACK)),
    (0, b"\x04\x22\x4D\x18", foreign("a file compressed with LZ4", UNPACK)),
    (257, b"ustar", foreign("a tar archive", UNPACK)),
    (
        0,
        b"PAR1",
        foreign(
            "a Parquet table",
            "a capture cannot be made from it; pass the capture that it was made from",
        ),
    ),
    (0, b"%PDF-", foreign("a PDF document", RESULTS)),
    (0, b"\x89PNG", foreign("a picture", "copy the frames as text, or pass the capture")),
    (0, b"\xFF\xD8\xFF", foreign("a picture", "copy the frames as text, or pass the capture")),
    (0, b"TDSm", foreign("a TDMS file of LabVIEW", "export its frames as ASC or CSV")),
    (0, b"\x89HDF\r\n", foreign("an HDF5 or MATLAB 7.3 file", "export its frames as ASC, BLF or CSV")),
    (0, b"MATLAB 5.0", foreign("a MATLAB file", "export its frames as ASC, BLF or CSV")),
    (0, b"SQLite format 3\0", foreign("an SQLite database", "export its frames as CSV")),
    (0, b"\x7FELF", foreign("a program", RESULTS)),
];

/// Kinds by the suffix of their name, where their content has no known sign.
const SUFFIXES: &[(&[&str], ForeignFile)] = &[
    (
        &["kme", "kme24", "kme25", "kme40", "kme50", "kme60"],
        foreign(
            "a log of Kvaser Memorator",
            "export it with Kvaser's converter as Vector ASC, BLF, MDF 4 or CSV",
        ),
    ),
    (&["xmt", "xmtb"], foreign("a trace of PCAN-Explorer", "save it as PEAK TRC (.trc)")),
    (&["cmtx", "ctrc", "csf"], foreign("a trace of canAnalyser", "export it as Vector ASC or CSV")),
    (
        &["ttl"],
        foreign("a log of TTX loggers", "convert it with the program of the logger to ASC, BLF or MDF 4"),
    ),
    (&["vsb"], foreign("a log of Vehicle Spy", "save it as Vector ASC, BLF or MDF 4")),
];

/// Kinds by their first lines of text: all of these must begin or occur in lines, without regard to case.
struct TextSigns {
    /// A line begins with one of these.
    begins: &'static [&'static str],
    /// A line contains one of these; empty if the beginning suffices.
    contains: &'static [&'static str],
    file: ForeignFile,
}

const TEXTS: &[TextSigns] = &[
    TextSigns {
        begins: &["version \"", "bu_:", "bs_:", "bo_ "],
        contains: &["bu_:", "bo_ ", "ns_ :"],
        file: foreign("a CAN database (DBC)", "use --dbc FILE with a capture"),
    },
    TextSigns {
        begins: &["[fileinfo]", "[deviceinfo]", "[devicecomissioning]", "[devicecommissioning]"],
        contains: &[],
        file: foreign("a device description (EDS or DCF)", "use --eds NODE=FILE with a capture"),
    },
    TextSigns {
        begins: &["<?xml", "<iso15745"],
        contains: &["iso15745profile"],
        file: foreign("a device description (XDD or XDC)", "use --eds NODE=FILE with a capture"),
    },
    TextSigns {
        begins: &["<?xml", "<networkdefinition", "<autosar"],
        contains: &["<networkdefinition", "<autosar"],
        file: foreign("a network description (KCD or ARXML)", DATABASE),
    },
    TextSigns {
        begins: &["formatversion=5", "formatversion=6"],
        contains: &[],
        file: foreign("a symbol file of PEAK", DATABASE),
    },
    TextSigns {
        begins: &["[database_version]"],
        contains: &[],
        file: foreign("a database of BUSMASTER", DATABASE),
    },
    TextSigns {
        begins: &["[bus.", "[node.", "[nodes.", "[[expect]]", "[[suppress]]", "[rules"],
        contains: &[],
        file: foreign("a bus file", "use --bus FILE with a capture"),
    },
    TextSigns {
        begins: &["[[identity]]", "[[hint]]", "[[rule]]", "[[object]]"],
        contains: &[],
        file: foreign("a profile of a device", "use --profiles FOLDER with a capture"),
    },
    TextSigns {
        begins: &["<!doctype html"],
        contains: &["name=\"generator\" content=\"cobscope\""],
        file: foreign("a report of cobscope", RESULTS),
    },
    TextSigns {
        begins: &["<!doctype html", "<html"],
        contains: &[],
        file: foreign("a web page", "save the capture itself, or copy its lines to a text file"),
    },
    TextSigns {
        begins: &["time,bus,frame,node,device,group,signal", "time,bus,frame,node,device"],
        contains: &[],
        file: foreign("an export of decode -f csv", RESULTS),
    },
    TextSigns {
        begins: &["{\"t\":"],
        contains: &["\"kind\":\""],
        file: foreign("an export of decode -f jsonl", RESULTS),
    },
    TextSigns {
        begins: &["{\"timestamp\":"],
        contains: &["\"pgn\":"],
        file: foreign(
            "JSON of canboat without the bytes of the messages",
            "run analyzer -json with -data, or pass its input",
        ),
    },
    TextSigns {
        begins: &["{\"kind\":\"summary\"", "{\"kind\":\"finding\""],
        contains: &[],
        file: foreign("an export of check -f jsonl", RESULTS),
    },
    TextSigns {
        begins: &[":020000", ":10"],
        contains: &[":00000001ff"],
        file: foreign("an Intel HEX file", RESULTS),
    },
];

/// Number of lines at the start that are compared with [`TEXTS`].
const DETECTING_LINES: usize = 60;

/// Kind of another file, by its first bytes and the suffix of its name; `None` if it is unknown.
pub fn foreign_file(head: &[u8], suffix: Option<&str>) -> Option<&'static ForeignFile> {
    let has = |(at, sign, _): &&(usize, &[u8], ForeignFile)| {
        head.get(*at..).is_some_and(|bytes| bytes.starts_with(sign))
    };
    if let Some((_, _, file)) = BINARY.iter().find(has) {
        return Some(file);
    }
    if let Some(signs) = TEXTS.iter().find(|signs| signs.occur_in(head)) {
        return Some(&signs.file);
    }
    let suffix = suffix?.to_ascii_lowercase();
    SUFFIXES.iter().find(|(known, _)| known.contains(&suffix.as_str())).map(|(_, file)| file)
}

impl TextSigns {
    fn occur_in(&self, head: &[u8]) -> bool {
        let lines = || first_lines(head, DETECTING_LINES);
        let begins = |line: &[u8]| self.begins.iter().any(|sign| begins_with(line, sign.as_bytes()));
        let contains = |line: &[u8]| {
            let line = line.to_ascii_lowercase();
            self.contains.iter().any(|sign| memchr::memmem::find(&line, sign.as_bytes()).is_some())
        };
        lines().any(begins) && (self.contains.is_empty() || lines().any(contains))
    }
}

fn begins_with(line: &[u8], sign: &[u8]) -> bool {
    line.get(..sign.len()).is_some_and(|start| start.eq_ignore_ascii_case(sign))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(head: &[u8], suffix: Option<&str>) -> Option<&'static str> {
        foreign_file(head, suffix).map(|file| file.name)
    }

    #[test]
    fn files_are_known_by_their_content() {
        for (head, expected) in [
            (&b"PK\x03\x04\x14\0"[..], "a ZIP archive"),
            (b"PAR1\x15\x04", "a Parquet table"),
            (b"VERSION \"\"\r\n\r\nNS_ :\r\n\tNS_DESC_\r\n", "a CAN database (DBC)"),
            (b"[FileInfo]\nFileName=a.eds\n", "a device description (EDS or DCF)"),
            (b"; made by hand\n\n[DeviceInfo]\n", "a device description (EDS or DCF)"),
            (b"<?xml version=\"1.0\"?>\n<ISO15745ProfileContainer>\n", "a device description (XDD or XDC)"),
            (b"# our machine\n[bus.can0]\nbitrate = 250000\n", "a bus file"),
            (b"<!DOCTYPE html><html><meta name=\"generator\" content=\"cobscope\">", "a report of cobscope"),
            (b"<!DOCTYPE html><html><body>", "a web page"),
            (
                b"time,bus,frame,node,device,group,signal,id,value,unit,label,raw\n",
                "an export of decode -f csv",
            ),
            (b"{\"t\":0.5,\"bus\":\"can0\",\"kind\":\"nmt\"}\n", "an export of decode -f jsonl"),
        ] {
            assert_eq!(name(head, None), Some(expected), "{}", head.escape_ascii());
        }
        let mut tar = vec![0; 300];
        tar[257..262].copy_from_slice(b"ustar");
        assert_eq!(name(&tar, None), Some("a tar archive"));
    }

    #[test]
    fn a_suffix_is_used_only_for_unknown_content() {
        assert_eq!(name(b"\x01\x02", Some("KME50")), Some("a log of Kvaser Memorator"));
        assert_eq!(name(b"PK\x03\x04", Some("kme50")), Some("a ZIP archive"));
        assert_eq!(name(b"\x01\x02", Some("log")), None);
        assert_eq!(name(b"\x01\x02", None), None);
    }

    #[test]
    fn captures_and_plain_texts_are_not_foreign() {
        for head in [&b"(1.0) can0 701#05\n"[..], b"", b"hello\n", b"time,bus,id,extended\n", b"BO\n"] {
            assert_eq!(name(head, None), None, "{}", head.escape_ascii());
        }
    }
}
