//! Legends of the panes: column heads, abbreviations, marks and colours with their meaning. The help screen
//! shows them, and `docs/panes.md` is generated from them.

use crate::theme::TextRole;

/// Explanation of a pane.
#[derive(Clone, Copy, Debug)]
pub struct PaneLegend {
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
    pub role: TextRole,
}

const fn plain_entry(mark: &'static str, meaning: &'static str) -> LegendEntry {
    LegendEntry { mark, meaning, role: TextRole::Key }
}

const fn styled_entry(mark: &'static str, role: TextRole, meaning: &'static str) -> LegendEntry {
    LegendEntry { mark, meaning, role }
}

/// Marks of the header, the status line and several panes.
pub const COMMON: &[LegendEntry] = &[
    styled_entry("green", TextRole::Good, "normal operation; italic without colours"),
    styled_entry("yellow", TextRole::Caution, "warning or unknown; bold without colours"),
    styled_entry("red", TextRole::Bad, "error or exceeded limit; bold, underlined without colours"),
    styled_entry("grey", TextRole::Quiet, "minor or unchanged; dim without colours"),
    styled_entry("blue", TextRole::Note, "remark without a verdict; underlined without colours"),
    plain_entry("37.5 %?", "presumed: based on a default or a value not seen"),
    plain_entry("{104}", "number of a frame in the capture"),
    plain_entry("32/20", "node-ID, decimal and hexadecimal"),
    plain_entry("SA80", "J1939 source address, hexadecimal"),
    plain_entry("–", "no value"),
    plain_entry("…", "text cut at this width"),
    plain_entry("▲ ▼", "sorted by this column, ascending or descending"),
    plain_entry("can0 250k", "bus with its bit rate in kbit/s"),
    plain_entry("load 3.4 % (1 s)", "bus load in the second before the cursor"),
    plain_entry("load ▁▂█", "strip of time: load relative to its maximum"),
    plain_entry("find ··Ew", "strip of time: the most important mark of each column"),
    plain_entry("E w n", "in the strip: error, warning, note"),
    plain_entry("x N", "in the strip: error frame; NMT command, state or boot-up"),
    plain_entry("80/s", "frames in the second before the cursor"),
    plain_entry("FINDINGS", "errors and warnings found by the rules; … while they run"),
    plain_entry("AGAINST", "number of differences from the capture of --against"),
    styled_entry("≠", TextRole::Caution, "differs from the capture of --against"),
    plain_entry("errframes", "error frames in the capture"),
    plain_entry("lost", "frames that the recorder lost"),
    plain_entry("bad lines", "unreadable lines or records of the capture"),
    plain_entry("timestamps ±1 ms", "resolution of the timestamps"),
    plain_entry("t 7.204 s", "time of the cursor since the first frame"),
    plain_entry("REC", "capture that --record writes, with frames and size"),
    plain_entry("INCOMPLETE", "the capture could not be read to its end"),
    plain_entry("CHANGED name", "the open file lost content that is shown; open it again"),
    plain_entry("ENDED", "a live source has failed"),
    plain_entry("#105/190", "frame at the cursor, number of frames"),
    plain_entry("indexing", "the capture is still being read"),
    plain_entry("state pending", "the position is not read yet; values are missing"),
    plain_entry("following", "the cursor moves to new frames; space pauses"),
];

/// Legend of the Nodes pane.
pub(super) const NODES: PaneLegend = PaneLegend {
    purpose: "set points, states, signs of life and errors of all nodes at the cursor",
    columns: &[
        plain_entry("ID/hex", "node-ID, decimal and hexadecimal; SA: J1939 source address"),
        plain_entry("Name", "name in the bus file"),
        plain_entry("Device", "assigned device profile, master or orphan"),
        plain_entry("NMT", "OPER, PREOP, STOP or INIT; ? unknown or presumed"),
        plain_entry("State", "state of the device; A→B: A reported, B commanded"),
        plain_entry("Set → actual", "set point → actual value; /250: full scale"),
        plain_entry("Eff", "set point effective: yes, NO, ? unknown; Enter lists gates"),
        plain_entry("Alive", "age of the last sign of life / expected interval, in s"),
        plain_entry("Errors", "active EMCY codes or SPN/FMI with their age"),
    ],
    marks: &[
        plain_entry("HB 0.2/0.5", "heartbeat 0.2 s old, period 0.5 s"),
        plain_entry("GD 0.2/0.5", "guarding response 0.2 s old, guard time 0.5 s"),
        plain_entry("AVC .1/.25", "message AVC 0.1 s old, maximum interval 0.25 s"),
        plain_entry("rx 0.1", "last frame 0.1 s old; no heartbeat, no guarding"),
        plain_entry("boot 10.2", "boot-up 10.2 s old, no frame since"),
        plain_entry("never", "no frame of the node yet"),
        styled_entry("yellow Alive", TextRole::Caution, "interval exceeded by half, or never seen"),
        styled_entry("red Alive", TextRole::Bad, "limit exceeded or node lost"),
        plain_entry("master", "sender of NMT commands, SYNC and guarding requests"),
        plain_entry("guards 2,5", "nodes that the master guards"),
        plain_entry("orphan", "periodic identifier without a known node"),
        plain_entry("J1939", "node without NMT states"),
        plain_entry("c1", "output 1 of a device with several outputs"),
        plain_entry("R stuck", "fault reset held at 1; needs a 0→1 edge"),
        plain_entry("rebooted", "boot sign without an NMT reset before"),
        plain_entry("3 lost", "settings lost at a boot, not all written again"),
        styled_entry("closed", TextRole::Bad, "gate that blocks the set point"),
        styled_entry("open", TextRole::Good, "gate that permits the set point"),
        styled_entry("unknown", TextRole::Caution, "gate whose condition is unknown"),
        styled_entry("unseen", TextRole::Quiet, "gate whose condition is never on the bus"),
    ],
};

/// Legend of the Events pane.
pub(super) const EVENTS: PaneLegend = PaneLegend {
    purpose: "decoded events around the cursor, one per line",
    columns: &[
        plain_entry("No", "number of the last frame of the event"),
        plain_entry("Time", "seconds since the first frame; t: UTC, local time"),
        plain_entry("Δt", "seconds since the event above"),
        plain_entry("Bus", "name of the bus"),
        plain_entry("ID", "CAN identifier, hexadecimal"),
        plain_entry("Node", "node with its name, or source→destination"),
        plain_entry("Kind", "kind of the event; abbreviations below"),
        plain_entry("Object", "object, signal or error code"),
        plain_entry("Event", "changed values first, cause, consequence {frames}"),
        plain_entry("Data", "first eight bytes of the frame"),
    ],
    marks: &[
        styled_entry("E", TextRole::Bad, "error: finding about this event, or fault"),
        styled_entry("w", TextRole::Caution, "warning: finding about this event, or needs attention"),
        styled_entry("n", TextRole::Note, "note: finding about this event"),
        styled_entry("x", TextRole::Bad, "error frame"),
        plain_entry("DHar", "bits of a device word, capital if set; legend in Detail"),
        plain_entry("SETPT", "set point, and whether it is effective"),
        plain_entry("STATE", "NMT state or state of the device"),
        plain_entry("STAT, MODE", "status bits, operating mode"),
        plain_entry("PDO", "process data with its signals"),
        plain_entry("EMCY, DTC", "error: CANopen EMCY, J1939 trouble code"),
        plain_entry("BOOT, READY", "boot sign of a node"),
        plain_entry("HB, GUARD", "NMT error control: heartbeat, guarding"),
        plain_entry("LOST, BACK", "node silent beyond its limit, node back"),
        plain_entry("NMT, SYNC, TIME", "NMT command, SYNC, time stamp object"),
        plain_entry("SDO r, SDO w", "SDO upload (read), SDO download (write)"),
        plain_entry("OBJ, CONFLICT", "object value changed without SDO, contradicting values"),
        plain_entry("IDENT, ID, LSS", "device identified, node-ID changed, LSS message"),
        plain_entry("CALIB, PROC", "procedure; also STORE, RESTORE, SWITCH, M/S, RATE, RESET"),
        plain_entry("PG, TP, REQ", "J1939 message, transport session, request"),
        plain_entry("FP", "NMEA 2000 fast packet"),
        plain_entry("ACK, NACK", "J1939 acknowledgement, positive or negative"),
        plain_entry("CLAIM, ADDR", "J1939 address claim, commanded address"),
        plain_entry("GAP", "J1939 message later than its interval"),
        plain_entry("UDS, ISO-TP", "UDS request with its response, ISO-TP message"),
        plain_entry("ERROR, DROP", "error frame, frames lost by the recorder"),
        plain_entry("CLOCK, SILENT", "clock set back or forward, no frames on the bus"),
        plain_entry("LINK", "interface up, down or with another bit rate"),
        plain_entry("FRAME, BAD", "undecoded frame, frame invalid for its service"),
        plain_entry("UNREAD, LIMIT", "unreadable input, state evicted at a limit"),
        plain_entry("NOTE, TEST", "remark of the decoder, conformance test marker"),
    ],
};

/// Legend of the Frames pane.
pub(super) const FRAMES: PaneLegend = PaneLegend {
    purpose: "all identifiers up to the cursor with rate and last payload",
    columns: &[
        plain_entry("Bus", "name of the bus"),
        plain_entry("ID", "CAN identifier, hexadecimal; R: remote frames"),
        plain_entry("PGN", "J1939 parameter group number, hexadecimal"),
        plain_entry("SA", "J1939 source address, hexadecimal"),
        plain_entry("Message", "service, PDO or message of the identifier"),
        plain_entry("Count", "number of frames"),
        plain_entry("Mean ms", "mean interval in ms"),
        plain_entry("Jitter", "largest deviation from the mean interval, in ms"),
        plain_entry("Gap", "interval before the last frame, in ms"),
        plain_entry("Age s", "seconds since the last frame"),
        plain_entry("Len", "length of the payload in bytes"),
        plain_entry("Data", "payload of the last frame, hexadecimal"),
        plain_entry("ASCII", "payload as text; a dot for other bytes"),
    ],
    marks: &[
        styled_entry("⚠1.930", TextRole::Caution, "overdue: silent for more than 3 × the mean interval"),
        styled_entry("orange byte", TextRole::Changed, "changed by the last frame"),
        styled_entry("normal byte", TextRole::Text, "changed before, not by the last frame"),
        styled_entry("grey byte", TextRole::Quiet, "never changed"),
    ],
};

/// Legend of the Detail pane.
pub(super) const DETAIL: PaneLegend = PaneLegend {
    purpose: "bits, fields, findings and links of the event at the cursor",
    columns: &[],
    marks: &[
        plain_entry("byte, hex", "byte number, byte in hexadecimal"),
        plain_entry("bits", "bits of each byte, most significant first"),
        plain_entry("field", "letter of the field that contains the bit"),
        plain_entry("·", "bit outside all fields"),
        plain_entry("error, warning", "finding in this frame, text of its rule"),
        plain_entry("Fields", "fields with values; select one for scaling and origin"),
        plain_entry("raw 6144 × …", "raw value, scaling and result"),
        plain_entry("layout", "origin of the fields: mapping, profile or DBC"),
        plain_entry("Manual", "cause and remedy of an error from the manual"),
        plain_entry("Transfer", "result, frames and data of a transfer"),
        plain_entry("Related", "frames named by the event, previous and next event"),
        plain_entry("All event fields", "fields under their filter names; = filters"),
        styled_entry("underlined", TextRole::Link, "Enter goes there"),
    ],
};

/// Legend of the Signals pane.
pub(super) const SIGNALS: PaneLegend = PaneLegend {
    purpose: "all signals with their values at the cursor, and a plot",
    columns: &[
        plain_entry("Node", "node of the signal with its name"),
        plain_entry("From", "PDO or identifier that carries the signal"),
        plain_entry("Signal", "name of the signal"),
        plain_entry("Value", "value at the cursor"),
    ],
    marks: &[
        plain_entry("✓", "plotted, in the colour of its curve"),
        plain_entry("A", "cursor A: the cursor of all panes"),
        plain_entry("B", "cursor B: set or removed with b"),
        plain_entry("Δ", "B minus A: time or value"),
        plain_entry("min, max", "lowest and highest value in the plotted range"),
        plain_entry("E w", "error, warning of plotted nodes or bus, begin to end"),
        plain_entry("N", "change of the NMT state of a plotted node"),
        plain_entry("══", "values of several curves"),
        plain_entry("(no room)", "not drawn: the plot is too low for a further unit"),
    ],
};

/// Legend of the Transfers pane.
pub(super) const TRANSFERS: PaneLegend = PaneLegend {
    purpose: "SDO, J1939 and UDS transfers with duration and outcome",
    columns: &[
        plain_entry("No", "number of the last frame"),
        plain_entry("Time", "end of the transfer, seconds since the first frame"),
        plain_entry("ms", "duration in ms"),
        plain_entry("Bus", "name of the bus"),
        plain_entry("Nodes", "client→server or source→destination"),
        plain_entry("Kind", "SDO r: upload, w: download; TP: J1939; FP: NMEA 2000; UDS"),
        plain_entry("Content", "object or service, value, result"),
        plain_entry("Size", "number of bytes; empty for UDS"),
        plain_entry("Outcome", "complete, positive, aborted, negative, timeout, no-answer, …"),
    ],
    marks: &[
        plain_entry("median / max", "SDO duration per node; shown when sorted by ms"),
        plain_entry("suppressed", "the request wants no response, and none was received"),
        plain_entry("unsolicited", "response whose request is not in the capture"),
        plain_entry("superseded", "replaced by a new transfer before its end"),
        plain_entry("unfinished", "not ended at the end of the capture"),
    ],
};

/// Legend of the Objects pane.
pub(super) const OBJECTS: PaneLegend = PaneLegend {
    purpose: "known object values of one node at the cursor",
    columns: &[
        plain_entry("Object", "index:sub-index, hexadecimal"),
        plain_entry("Name", "name in the profile or EDS"),
        plain_entry("Value", "value with its unit; ? presumed"),
        plain_entry("Raw", "first bytes in bus order, hexadecimal"),
        plain_entry("Origin", "written, read or sent {frame}; bus file; DCF; default"),
        plain_entry("Age", "time since the value was seen"),
        plain_entry("Persists", "after a restart: yes, no, unsaved (store first)"),
        plain_entry("Pending", "accepted value and when it becomes active"),
    ],
    marks: &[styled_entry("red Value", TextRole::Bad, "value outside the permitted range")],
};

/// Legend of the Why pane.
pub(super) const WHY: PaneLegend = PaneLegend {
    purpose: "stories: the most likely cause, what followed, what to do",
    columns: &[],
    marks: &[
        styled_entry(
            "MOST LIKELY",
            TextRole::Bad,
            "cause that explains most findings; Enter goes to its frames",
        ),
        styled_entry("UNKNOWN", TextRole::Caution, "no cause in the capture, and what to record next"),
        plain_entry("FIRST EFFECT", "first finding of a story without a visible cause"),
        plain_entry("then, before", "consequence with its delay; it can be seen before the cause"),
        plain_entry("DO NOW", "steps from the manual, the rule or the state machine"),
        plain_entry("NOT THE CAUSE", "what the capture disproves"),
        plain_entry("NOT JUDGED", "what the capture cannot show"),
        plain_entry("MANUAL", "manual and section"),
        plain_entry("NOTE", "finding of the severity note, in no story"),
    ],
};

/// Legend of the Findings pane.
pub(super) const FINDINGS: PaneLegend = PaneLegend {
    purpose: "findings of the rules by cause, worst first",
    columns: &[
        plain_entry("Severity", "error, warning or note; suppr.: suppressed by the bus file"),
        plain_entry("Bus", "name of the bus"),
        plain_entry("Node", "node of the finding with its name"),
        plain_entry("×", "number of occurrences"),
        plain_entry("First", "first occurrence, seconds since the first frame"),
        plain_entry("Last", "last occurrence, if there are several"),
        plain_entry("Cursor", "first occurrence relative to the cursor, in s"),
        plain_entry("Rule", "name of the rule"),
        plain_entry("Subject", "object, PGN or signal of the finding"),
        plain_entry("Finding", "measured value and limit"),
    ],
    marks: &[
        plain_entry("▾", "cause with its effects below; x hides them"),
        plain_entry("▸", "cause with hidden effects; x shows them"),
        plain_entry("look first", "first check that the rule recommends"),
        plain_entry("also covers", "findings of other rules with the same cause"),
        plain_entry("quality", "defects of the capture that limit the verdict"),
        plain_entry("failure", "reason why the capture was not read to its end"),
        plain_entry("filter", "findings selected by the current filter"),
    ],
};

/// Legend of the Bus pane.
pub(super) const BUS: PaneLegend = PaneLegend {
    purpose: "load and error frames over time, quality of the capture",
    columns: &[],
    marks: &[
        plain_entry("max 31 %", "load of the highest bar, of its busiest interval"),
        plain_entry("1691 bit/s", "highest rate, if the bit rate of the bus is unknown"),
        styled_entry("yellow bar", TextRole::Caution, "load of 60 % or more"),
        styled_entry("red bar", TextRole::Bad, "load of 80 % or more"),
        plain_entry("▲", "cursor on the time axis"),
        plain_entry("17 err", "error frames of the highest error bar"),
        plain_entry("frames", "rates of the whole capture and of its worst second"),
        plain_entry("master", "commands and SYNC of the NMT master"),
        plain_entry("unknown", "frames without a known service"),
        plain_entry("wiring", "error frames; without them wiring cannot be judged"),
        plain_entry("timestamps", "resolution or defects of the timestamps"),
        plain_entry("quality", "defects of the capture"),
    ],
};
