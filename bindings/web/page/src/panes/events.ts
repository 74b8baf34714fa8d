// The event list: any number of rows, decoded when they are shown.

import { shortMoment } from "../clock";
import { grouped, h } from "../dom";
import type { EventRow } from "../protocol";
import type { App, Pane } from "../state";
import { VirtualList } from "../virtual";

const MARKS: Record<string, string> = { error: "E", warning: "w", note: "n" };

export function eventsPane(app: App): Pane & { list: VirtualList<EventRow>; search(): void } {
  const list = new VirtualList<EventRow>({
    label: "Events",
    columns: [
      { title: "", name: "mark", cell: (row) => (row.mark ? MARKS[row.mark] ?? "" : "") },
      { title: "No", name: "no", cell: (row) => String(row.frame) },
      { title: "Time", name: "time", cell: (row) => shortMoment(row.time, app.core.clock, app.core.overview, 6) },
      { title: "Bus", name: "busname", cell: (row) => row.bus },
      { title: "ID", name: "id", cell: (row) => row.id ?? "" },
      { title: "Node", name: "who", cell: (row) => row.who },
      { title: "Kind", name: "kind", cell: (row) => row.kind },
      { title: "Event", name: "what", cell: (row) => (row.unchanged ? `${row.what} · ${row.unchanged}` : row.what) },
      { title: "Data", name: "data", cell: (row) => row.data },
    ],
    fetch: async (from, count) => {
      const { client, list: name } = app.core;
      return (await client.call<{ rows: EventRow[] }>({ do: "rows", list: name, from, count })).rows;
    },
    rowClass: (row) => `tone-${row.tone}${row.mark ? ` marked-${row.mark}` : ""}`,
    onSelect: (row) => {
      app.core.cursor = { frame: row.frame, time: row.time };
      app.core.ordinal = row.ordinal;
      app.changed();
    },
    onOpen: () => app.show("detail"),
    inTurn: (move) => app.inTurn(move),
  });
  const count = h("span", { class: "quiet count", role: "status" });
  const all = h("input", { type: "checkbox", id: "only-news", onchange: () => void app.setOnlyNews(all.checked) });
  const input = h("input", {
    id: "filter",
    type: "text",
    role: "combobox",
    "aria-expanded": "false",
    "aria-autocomplete": "list",
    "aria-controls": "words",
    autocomplete: "off",
    spellcheck: "false",
    placeholder: "kind == emcy && node == 5",
    oninput: () => void suggest(),
    onkeydown: (event: KeyboardEvent) => keys(event),
    onblur: () => setTimeout(hide, 150),
  });
  const words = h("ul", { id: "words", role: "listbox", "aria-label": "Words of the filter", hidden: true });
  const problem = h("p", { class: "problem", role: "alert", hidden: true });
  let start = 0;
  let chosen = -1;

  function hide(): void {
    words.hidden = true;
    chosen = -1;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  }

  async function suggest(): Promise<void> {
    const text = input.value;
    const found = await app.core.client.call<{ start: number; words: string[] }>({ do: "complete", text });
    if (text !== input.value) return;
    start = found.start;
    const begun = new TextDecoder().decode(new TextEncoder().encode(text).subarray(start));
    const shown = found.words.filter((word) => word.startsWith(begun) && word !== begun).slice(0, 12);
    words.replaceChildren(
      ...shown.map((word, place) =>
        h("li", { id: `word-${place}`, role: "option", "aria-selected": "false", onmousedown: (event: Event) => { event.preventDefault(); take(word); } }, word),
      ),
    );
    words.hidden = shown.length === 0;
    input.setAttribute("aria-expanded", String(shown.length > 0));
    chosen = -1;
  }

  function take(word: string): void {
    const head = new TextDecoder().decode(new TextEncoder().encode(input.value).subarray(0, start));
    input.value = `${head}${word} `;
    hide();
    input.focus();
    void suggest();
  }

  function keys(event: KeyboardEvent): void {
    const shown = words.hidden ? [] : [...words.children];
    if ((event.key === "ArrowDown" || event.key === "ArrowUp") && shown.length > 0) {
      event.preventDefault();
      chosen = (chosen + (event.key === "ArrowDown" ? 1 : -1) + shown.length) % shown.length;
      shown.forEach((word, place) => word.setAttribute("aria-selected", String(place === chosen)));
      input.setAttribute("aria-activedescendant", `word-${chosen}`);
    } else if (event.key === "Tab" && shown.length > 0 && input.value !== "") {
      event.preventDefault();
      take(shown[Math.max(0, chosen)]?.textContent ?? "");
    } else if (event.key === "Enter") {
      event.preventDefault();
      const word = shown[chosen]?.textContent;
      if (chosen >= 0 && word) take(word);
      else {
        hide();
        void app.setFilter(input.value.trim()).then(() => list.focus());
      }
    } else if (event.key === "Escape") {
      event.stopPropagation();
      if (words.hidden) list.focus();
      hide();
    }
  }

  const bar = h(
    "form",
    { class: "filterbar", onsubmit: (event: Event) => event.preventDefault() },
    h("label", { for: "filter" }, "Filter"),
    h("span", { class: "combo" }, input, words),
    h("button", { type: "button", onclick: () => { input.value = ""; void app.setFilter(""); } }, "Clear"),
    h("label", { class: "check", for: "only-news" }, all, "changes only"),
    count,
  );
  const element = h("div", { class: "pane events" }, bar, problem, list.element);

  return {
    name: "events",
    title: "Events",
    element,
    list,
    search() {
      input.focus();
      input.select();
    },
    open() {
      const { core } = app;
      all.checked = core.list === "news";
      if (document.activeElement !== input) input.value = core.filter;
      count.textContent = `${grouped(core.total)} ${core.total === 1 ? "event" : "events"}`;
    },
    moved() {},
    key(event) {
      if (event.key === "f" || event.key === "F3") {
        event.preventDefault();
        this.search();
        return true;
      }
      if (event.key === "v") {
        app.inTurn(() => app.setOnlyNews(!all.checked));
        return true;
      }
      return false;
    },
    focus() {
      list.focus();
    },
    ...{ showProblem: (text: string) => { problem.hidden = text === ""; problem.textContent = text; } },
  } as Pane & { list: VirtualList<EventRow>; search(): void };
}
