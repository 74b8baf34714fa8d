// All keys, the same as in the terminal UI.

import { h } from "./dom";
import type { PaneName } from "./state";

export const PANE_KEYS: Record<string, PaneName> = {
  0: "why", 1: "nodes", 2: "events", 3: "frames", 4: "detail", 5: "signals", 6: "transfers", 7: "objects", 8: "findings", 9: "bus",
};

const KEYS: [string, string][] = [
  ["0 … 9", "Why, Nodes, Events, Frames, Detail, Signals, Transfers, Objects, Findings, Bus"],
  ["j k ↓ ↑", "go down or up one line"],
  ["PgDn PgUp", "go down or up one page"],
  ["g G", "go to the start or the end"],
  ["Enter", "open the selected row"],
  ["Esc", "go back"],
  ["] [", "go to the next or previous finding"],
  ["} {", "go to the next or previous story"],
  ["e E", "go to the next or previous error event"],
  [":", "go to 12.5 (seconds) or #1234 (frame)"],
  ["m '", "set a mark, named by a letter, or go to it"],
  ["t", "show times in seconds, in UTC or in local time"],
  ["f", "show only events that match a filter; Tab completes a word"],
  ["v", "show all events, or only changes"],
  ["=", "filter by node and kind of the selected event"],
  ["c", "clear the filter"],
  ["u U", "undo or redo the last change of the filter or of v"],
  ["/", "search events for a text (regular expression); in Signals, search signals"],
  ["n N", "go to the next or previous match"],
  ["p", "go to the plot"],
  ["+ −", "zoom the plot in or out at the cursor"],
  ["b", "set or remove cursor B of the plot"],
  ["a", "assign a profile to a node"],
  ["y", "copy the selected line"],
  ["V", "start or clear the selection of frames to export"],
  ["R", "save a report page"],
  ["w", "go to the export list"],
  ["i", "show or hide the strip of time"],
  ["o", "open files"],
  ["?", "list all keys"],
];

export function helpDialog(): { element: HTMLElement; open(): void; isOpen(): boolean } {
  const element = h(
    "dialog",
    { class: "help", "aria-label": "Keys" },
    h("h2", {}, "Keys"),
    h("dl", {}, KEYS.flatMap(([keys, text]) => [h("dt", {}, h("kbd", {}, keys)), h("dd", {}, text)])),
    h("form", { method: "dialog" }, h("button", { type: "submit", class: "primary" }, "Close")),
  );
  return { element, open: () => element.showModal(), isOpen: () => element.open };
}
