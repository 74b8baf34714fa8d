//! Legends of the panes: column heads, abbreviations, marks and colours with their meaning. The help screen
//! shows them, and `docs/panes.md` is generated from them.

use crate::theme::Role;

/// Explanation of a pane.
#[derive(Clone, Copy, Debug)]
pub struct Legend {
    /// Content of the pane in one line.
    pub purpose: &'static str,
    /// Column heads in order.
    pub columns: &'static [LegendEntry],
    /// Abbreviations, marks and colours.
    pub marks: &'static [LegendEntry],
}

/// A column head, abbreviation, mark or colour.
#[derive(Clone, Copy, Debug)]
pub struct LegendEntry {
    /// Text as drawn, or a description of the look.
    pub mark: &'static str,
    /// Meaning in at most 15 words.
    pub meaning: &'static str,
    /// Role that draws the mark.
    pub role: Role,
}

const fn entry(mark: &'static str, meaning: &'static str) -> LegendEntry {
    LegendEntry { mark, meaning, role: Role::Key }
}

const fn look(mark: &'static str, role: Role, meaning: &'static str) -> LegendEntry {
    LegendEntry { mark, meaning, role }
}

/// Marks of the header, the status line and several panes.
pub const COMMON: &[LegendEntry] = &[
    look("green", Role::Good, "normal operation; italic without colours"),
    look("yellow", Role::Caution, "warning or unknown; bold without colours"),
    look("red", Role::Bad, "error or exceeded limit; bold, underlined without colours"),
    look("grey", Role::Quiet, "minor or unchanged; dim without colours"),
    look("blue", Role::Note, "remark without a verdict; underlined without colours"),
    entry("37.5 %?", "presumed: based on a default or a value not seen"),
    entry("{104}", "number of a frame in the capture"),
    entry("32/20", "node-ID, decimal and hexadecimal"),
    entry("SA80", "J1939 source address, hexadecimal"),
    entry("–", "no value"),
    entry("…", "text cut at this width"),
    entry("▲ ▼", "sorted by this column, ascending or descending"),
    entry("can0 250k", "bus with its bit rate in kbit/s"),
    entry("load 34 %", "bus load in the second before the cursor"),
    entry("load ▁▂█", "strip of time: load relative to its maximum"),
    entry("find ··Ew", "strip of time: the most important mark of each column"),
    entry("E w n", "in the strip: error, warning, note"),
    entry("x N", "in the strip: error frame; NMT command, state or boot-up"),
    entry("80/s", "frames in the second before the cursor"),
    entry("FINDINGS", "errors and warnings found by the rules; … while they run"),
    entry("AGAINST", "number of differences from the capture of --against"),
    look("≠", Role::Caution, "differs from the capture of --against"),
    entry("errframes", "error frames in the capture"),
    entry("lost", "frames that the recorder lost"),
    entry("bad lines", "unreadable lines or records of the capture"),
    entry("timestamps ±1 ms", "resolution of the timestamps"),
    entry("t 7.204 s", "time of the cursor since the first frame"),
    entry("REC", "capture that --record writes, with frames and size"),
    entry("INCOMPLETE", "the capture could not be read to its end"),
    entry("CHANGED name", "the open file lost content that is shown; open it again"),
    entry("ENDED", "a live source has failed"),
    entry("#105/190", "frame at the cursor, number of frames"),
    entry("indexing", "the capture is still being read"),
    entry("state pending", "the position is not read yet; values are missing"),
    entry("following", "the cursor moves to new frames; space pauses"),
];

/// Legend of the Nodes pane.
pub(super) const NODES: Legend = Legend {
    purpose: "set points, states, signs of life and errors of all nodes at the cursor",
    columns: &[
        entry("ID/hex", "node-ID, decimal and hexadecimal; SA: J1939 source address"),
        entry("Name", "name in the bus file"),
        entry("Device", "assigned device profile, master or orphan"),
        entry("NMT", "OPER, PREOP, STOP or INIT; ? unknown or presumed"),
        entry("State", "state of the device; A→B: A reported, B commanded"),
        entry("Set → actual", "set point → actual value; /250: full scale"),
        entry("Eff", "set point effective: yes, NO, ? unknown; Enter lists gates"),
        entry("Alive", "age of the last sign of life / expected interval, in s"),
        entry("Errors", "active EMCY codes or SPN/FMI with their age"),
    ],
    marks: &[
        entry("HB 0.2/0.5", "heartbeat 0.2 s old, period 0.5 s"),
        entry("GD 0.2/0.5", "guarding response 0.2 s old, guard time 0.5 s"),
        entry("AVC .1/.25", "message AVC 0.1 s old, maximum interval 0.25 s"),
        entry("rx 0.1", "last frame 0.1 s old; no heartbeat, no guarding"),
        entry("boot 10.2", "boot-up 10.2 s old, no frame since"),
        entry("never", "no frame of the node yet"),
        look("yellow Alive", Role::Caution, "interval exceeded by half, or never seen"),
        look("red Alive", Role::Bad, "limit exceeded or node lost"),
        entry("master", "sender of NMT commands, SYNC and guarding requests"),
        entry("guards 2,5", "nodes that the master guards"),
        entry("orphan", "periodic identifier without a known node"),
        entry("J1939", "node without NMT states"),
        entry("c1", "output 1 of a device with several outputs"),
        entry("R stuck", "fault reset held at 1; needs a 0→1 edge"),
        entry("rebooted", "boot sign without an NMT reset before"),
        entry("3 lost", "settings lost at a boot, not all written again"),
        look("closed", Role::Bad, "gate that blocks the set point"),
        look("open", Role::Good, "gate that permits the set point"),
        look("unknown", Role::Caution, "gate whose condition is unknown"),
        look("unseen", Role::Quiet, "gate whose condition is never on the bus"),
    ],
};

/// Legend of the Events pane.
pub(super) const EVENTS: Legend = Legend {
    purpose: "decoded events around the cursor, one per line",
    columns: &[
        entry("No", "number of the last frame of the event"),
        entry("Time", "seconds since the first frame; t: UTC, local time"),
        entry("Δt", "seconds since the event above"),
        entry("Bus", "name of the bus"),
        entry("ID", "CAN identifier, hexadecimal"),
        entry("Node", "node with its name, or source→destination"),
        entry("Kind", "kind of the event; abbreviations below"),
        entry("Object", "object, signal or error code"),
        entry("Event", "changed values first, cause, consequence {frames}"),
        entry("Data", "first eight bytes of the frame"),
    ],
    marks: &[
        look("E", Role::Bad, "error: finding about this event, or fault"),
        look("w", Role::Caution, "warning: finding about this event, or needs attention"),
        look("n", Role::Note, "note: finding about this event"),
        look("x", Role::Bad, "error frame"),
        entry("DHar", "bits of a device word, capital if set; legend in Detail"),
        entry("SETPT", "set point, and whether it is effective"),
        entry("STATE", "NMT state or state of the device"),
        entry("STAT, MODE", "status bits, operating mode"),
        entry("PDO", "process data with its signals"),
        entry("EMCY, DTC", "error: CANopen EMCY, J1939 trouble code"),
        entry("BOOT, READY", "boot sign of a node"),
        entry("HB, GUARD", "NMT error control: heartbeat, guarding"),
        entry("LOST, BACK", "node silent beyond its limit, node back"),
        entry("NMT, SYNC, TIME", "NMT command, SYNC, time stamp object"),
        entry("SDO r, SDO w", "SDO upload (read), SDO download (write)"),
        entry("OBJ, CONFLICT", "object value changed without SDO, contradicting values"),
        entry("IDENT, ID, LSS", "device identified, node-ID changed, LSS message"),
        entry("CALIB, PROC", "procedure; also STORE, RESTORE, SWITCH, M/S, RATE, RESET"),
        entry("PG, TP, REQ", "J1939 message, transport session, request"),
        entry("FP", "NMEA 2000 fast packet"),
        entry("ACK, NACK", "J1939 acknowledgement, positive or negative"),
        entry("CLAIM, ADDR", "J1939 address claim, commanded address"),
        entry("GAP", "J1939 message later than its interval"),
        entry("UDS, ISO-TP", "UDS request with its response, ISO-TP message"),
        entry("ERROR, DROP", "error frame, frames lost by the recorder"),
        entry("CLOCK, SILENT", "clock set back or forward, no frames on the bus"),
        entry("LINK", "interface up, down or with another bit rate"),
        entry("FRAME, BAD", "undecoded frame, frame invalid for its service"),
        entry("UNREAD, LIMIT", "unreadable input, state evicted at a limit"),
        entry("NOTE, TEST", "remark of the decoder, conformance test marker"),
    ],
};

/// Legend of the Frames pane.
pub(super) const FRAMES: Legend = Legend {
    purpose: "all identifiers up to the cursor with rate and last payload",
    columns: &[
        entry("Bus", "name of the bus"),
        entry("ID", "CAN identifier, hexadecimal; R: remote frames"),
        entry("PGN", "J1939 parameter group number, hexadecimal"),
        entry("SA", "J1939 source address, hexadecimal"),
        entry("Message", "service, PDO or message of the identifier"),
        entry("Count", "number of frames"),
        entry("Mean ms", "mean interval in ms"),
        entry("Jitter", "largest deviation from the mean interval, in ms"),
        entry("Gap", "interval before the last frame, in ms"),
        entry("Age s", "seconds since the last frame"),
        entry("Len", "length of the payload in bytes"),
        entry("Data", "payload of the last frame, hexadecimal"),
        entry("ASCII", "payload as text; a dot for other bytes"),
    ],
    marks: &[
        look("⚠1.930", Role::Caution, "overdue: silent for more than 3 × the mean interval"),
        look("orange byte", Role::Changed, "changed by the last frame"),
        look("normal byte", Role::Text, "changed before, not by the last frame"),
        look("grey byte", Role::Quiet, "never changed"),
    ],
};

/// Legend of the Detail pane.
pub(super) const DETAIL: Legend = Legend {
    purpose: "bits, fields, findings and links of the event at the cursor",
    columns: &[],
    marks: &[
        entry("byte, hex", "byte number, byte in hexadecimal"),
        entry("bits", "bits of each byte, most significant first"),
        entry("field", "letter of the field that contains the bit"),
        entry("·", "bit outside all fields"),
        entry("error, warning", "finding in this frame, text of its rule"),
        entry("Fields", "fields with values; select one for scaling and origin"),
        entry("raw 6144 × …", "raw value, scaling and result"),
        entry("layout", "origin of the fields: mapping, profile or DBC"),
        entry("Manual", "cause and remedy of an error from the manual"),
        entry("Transfer", "result, frames and data of a transfer"),
        entry("Related", "frames named by the event, previous and next event"),
        entry("All event fields", "fields under their filter names; = filters"),
        look("underlined", Role::Link, "Enter goes there"),
    ],
};

/// Legend of the Signals pane.
pub(super) const SIGNALS: Legend = Legend {
    purpose: "all signals with their values at the cursor, and a plot",
    columns: &[
        entry("Node", "node of the signal with its name"),
        entry("From", "PDO or identifier that carries the signal"),
        entry("Signal", "name of the signal"),
        entry("Value", "value at the cursor"),
    ],
    marks: &[
        entry("✓", "plotted, in the colour of its curve"),
        entry("A", "cursor A: the cursor of all panes"),
        entry("B", "cursor B: set or removed with b"),
        entry("Δ", "B minus A: time or value"),
        entry("min, max", "lowest and highest value in the plotted range"),
        entry("E w", "error, warning of plotted nodes or bus, begin to end"),
        entry("N", "change of the NMT state of a plotted node"),
        entry("══", "values of several curves"),
        entry("(no room)", "not drawn: the plot is too low for a further unit"),
    ],
};

/// Legend of the Transfers pane.
pub(super) const TRANSFERS: Legend = Legend {
    purpose: "SDO, J1939 and UDS transfers with duration and outcome",
    columns: &[
        entry("No", "number of the last frame"),
        entry("Time", "end of the transfer, seconds since the first frame"),
        entry("ms", "duration in ms"),
        entry("Bus", "name of the bus"),
        entry("Nodes", "client→server or source→destination"),
        entry("Kind", "SDO r: upload, w: download; TP: J1939; FP: NMEA 2000; UDS"),
        entry("Content", "object or service, value, result"),
        entry("Size", "number of bytes; empty for UDS"),
        entry("Outcome", "complete, positive, aborted, negative, timeout, no-answer, …"),
    ],
    marks: &[
        entry("median / max", "SDO duration per node; shown when sorted by ms"),
        entry("suppressed", "the request wants no response, and none was received"),
        entry("unsolicited", "response whose request is not in the capture"),
        entry("superseded", "replaced by a new transfer before its end"),
        entry("unfinished", "not ended at the end of the capture"),
    ],
};

/// Legend of the Objects pane.
pub(super) const OBJECTS: Legend = Legend {
    purpose: "known object values of one node at the cursor",
    columns: &[
        entry("Object", "index:sub-index, hexadecimal"),
        entry("Name", "name in the profile or EDS"),
        entry("Value", "value with its unit; ? presumed"),
        entry("Raw", "first bytes in bus order, hexadecimal"),
        entry("Origin", "written, read or sent {frame}; bus file; DCF; default"),
        entry("Age", "time since the value was seen"),
        entry("Persists", "after a restart: yes, no, unsaved (store first)"),
        entry("Pending", "accepted value and when it becomes active"),
    ],
    marks: &[look("red Value", Role::Bad, "value outside the permitted range")],
};

/// Legend of the Why pane.
pub(super) const WHY: Legend = Legend {
    purpose: "stories: the most likely cause, what followed, what to do",
    columns: &[],
    marks: &[
        look("MOST LIKELY", Role::Bad, "cause that explains most findings; Enter goes to its frames"),
        look("UNKNOWN", Role::Caution, "no cause in the capture, and what to record next"),
        entry("FIRST EFFECT", "first finding of a story without a visible cause"),
        entry("then, before", "consequence with its delay; it can be seen before the cause"),
        entry("DO NOW", "steps from the manual, the rule or the state machine"),
        entry("NOT THE CAUSE", "what the capture disproves"),
        entry("NOT JUDGED", "what the capture cannot show"),
        entry("MANUAL", "manual and section"),
        entry("NOTE", "finding of the severity note, in no story"),
    ],
};

/// Legend of the Findings pane.
pub(super) const FINDINGS: Legend = Legend {
    purpose: "findings of the rules by cause, worst first",
    columns: &[
        entry("Severity", "error, warning or note; suppr.: suppressed by the bus file"),
        entry("Bus", "name of the bus"),
        entry("Node", "node of the finding with its name"),
        entry("×", "number of occurrences"),
        entry("First", "first occurrence, seconds since the first frame"),
        entry("Last", "last occurrence, if there are several"),
        entry("Cursor", "first occurrence relative to the cursor, in s"),
        entry("Rule", "name of the rule"),
        entry("Subject", "object, PGN or signal of the finding"),
        entry("Finding", "measured value and limit"),
    ],
    marks: &[
        entry("▾", "cause with its effects below; x hides them"),
        entry("▸", "cause with hidden effects; x shows them"),
        entry("look first", "first check that the rule recommends"),
        entry("also covers", "findings of other rules with the same cause"),
        entry("quality", "defects of the capture that limit the verdict"),
        entry("failure", "reason why the capture was not read to its end"),
        entry("filter", "findings selected by the current filter"),
    ],
};

/// Legend of the Bus pane.
pub(super) const BUS: Legend = Legend {
    purpose: "load and error frames over time, quality of the capture",
    columns: &[],
    marks: &[
        entry("max 31 %", "load of the highest bar, of its busiest interval"),
        entry("1691 bit/s", "highest rate, if the bit rate of the bus is unknown"),
        look("yellow bar", Role::Caution, "load of 60 % or more"),
        look("red bar", Role::Bad, "load of 80 % or more"),
        entry("▲", "cursor on the time axis"),
        entry("17 err", "error frames of the highest error bar"),
        entry("frames", "rates of the whole capture and of its worst second"),
        entry("master", "commands and SYNC of the NMT master"),
        entry("unknown", "frames without a known service"),
        entry("wiring", "error frames; without them wiring cannot be judged"),
        entry("timestamps", "resolution or defects of the timestamps"),
        entry("quality", "defects of the capture"),
    ],
};
