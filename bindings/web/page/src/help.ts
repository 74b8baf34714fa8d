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
  [":", "go to 12.5 (seconds) or #1234 (frame)"],
  ["f", "show only events that match a filter; Tab completes a word"],
  ["v", "show all events, or only changes"],
  ["c", "clear the filter"],
  ["/", "search signals"],
  ["p", "go to the plot"],
  ["+ −", "zoom the plot in or out at the cursor"],
  ["R", "save a report page"],
  ["w", "go to the export list"],
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
