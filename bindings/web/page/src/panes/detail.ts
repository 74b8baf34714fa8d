// All fields of the event at the cursor, with its payload.

import { moment } from "../clock";
import { fill, h } from "../dom";
import type { EventDetail } from "../protocol";
import { findingsOf, type App, type Pane } from "../state";

/** Fields shown in the heading. */
const HEAD = new Set(["t", "bus", "frames", "kind", "capture"]);

function value(content: unknown): Node | string {
  if (content === null || typeof content !== "object") return String(content);
  if (Array.isArray(content)) {
    if (content.every((one) => one === null || typeof one !== "object")) return content.join(", ");
    return h("ol", {}, content.map((one) => h("li", {}, value(one))));
  }
  return h("dl", {}, Object.entries(content).flatMap(([key, one]) => [h("dt", {}, key), h("dd", {}, value(one))]));
}

export function detailPane(app: App): Pane {
  const element = h("div", { class: "pane detail scroll", tabindex: 0, role: "region", "aria-label": "Detail" });
  let shown = "";

  async function show(): Promise<void> {
    const { client, cursor, ordinal, overview, clock } = app.core;
    const key = `${cursor.frame}/${ordinal}/${clock}`;
    if (key === shown) return;
    shown = key;
    let found: EventDetail | null = await client.call<EventDetail | null>({ do: "event", frame: cursor.frame, ordinal });
    if (!found && ordinal > 0) found = await client.call<EventDetail | null>({ do: "event", frame: cursor.frame, ordinal: 0 });
    if (key !== shown) return;
    if (!found) {
      fill(element, h("p", { class: "quiet" }, `Frame ${cursor.frame} has no event; choose a row of the event list.`));
      return;
    }
    const { event } = found;
    const own = findingsOf(overview).filter((one) => one.occurrences.some((it) => it.frames[0] <= cursor.frame && cursor.frame <= it.frames[1]));
    const fields = Object.entries(event).filter(([name]) => !HEAD.has(name));
    const frames = event["frames"] as number[] | undefined;
    fill(
      element,
      h("h2", {}, `${String(event["kind"])} in frame ${frames && frames[0] !== frames[1] ? `${frames[0]} to ${frames[1]}` : cursor.frame}`),
      h("p", { class: "quiet" }, `${moment(found.time, clock, overview, 6)}${clock === "seconds" ? " s" : ""} on ${String(event["bus"])}`, found.id ? `, identifier ${found.id}` : "", found.meaning ? `: ${found.meaning}` : ""),
      own.map((one) => h("p", {}, h("span", { class: `severity ${one.severity}` }, one.severity), ` ${one.text} [${one.rule}]`)),
      found.bytes && h("p", { class: "payload" }, found.bytes.map((byte, place) => h("span", { title: `byte ${place}` }, byte))),
      h("dl", { class: "fields" }, fields.flatMap(([name, content]) => [h("dt", {}, name), h("dd", {}, value(content))])),
    );
  }

  let isRunning = false;
  let isStale = false;

  /** Moves that occur while an event is read are answered once. */
  async function safely(): Promise<void> {
    isStale = true;
    if (isRunning) return;
    isRunning = true;
    try {
      while (isStale) {
        isStale = false;
        await show();
      }
    } catch (error) {
      app.fail(error);
    } finally {
      isRunning = false;
    }
  }
  return {
    name: "detail",
    title: "Detail",
    element,
    open() {
      shown = "";
      void safely();
    },
    moved: () => void safely(),
    focus: () => element.focus({ preventScroll: true }),
  };
}
