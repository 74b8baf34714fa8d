// Keys that move the cursor: findings, stories, errors, matches, marks, typed positions.

import { nextClock } from "./clock";
import { h } from "./dom";
import { countingOf, since, type App, type RowPosition } from "./state";

export class Navigation {
  private marks = new Map<string, RowPosition>();
  private sought = "";
  /** What the next letter is for: to set a mark, or to go to one. */
  private awaits: "m" | "'" | null = null;

  constructor(private app: App, private foot: HTMLElement) {}

  /** Another capture was opened. */
  reset(): void {
    this.marks.clear();
    this.sought = "";
    this.awaits = null;
  }

  /** Takes a key as the letter of a mark, if one was requested; any other key ends the request. */
  letter(key: string): boolean {
    const purpose = this.awaits;
    if (purpose === null || key === "Shift") return false;
    this.awaits = null;
    if (key.length !== 1) {
      this.app.say("");
      return key === "Escape";
    }
    this.app.inTurn(() => this.mark(purpose, key));
    return true;
  }

  /** Handles a key; false if it moves nothing. Its work starts when the moves before it have ended. */
  key(key: string): boolean {
    const { app } = this;
    const actions: Record<string, () => Promise<void> | void> = {
      "]": () => this.finding(1), "[": () => this.finding(-1),
      "}": () => this.story(1), "{": () => this.story(-1),
      e: () => this.error(false), E: () => this.error(true),
      n: () => this.search(false), N: () => this.search(true),
      ":": () => this.askPlace(), "/": () => this.askText(), F7: () => this.askText(),
      t: () => this.clock(), V: () => this.select(), b: () => this.second(),
    };
    const action = actions[key];
    if (key === "m" || key === "'") {
      this.awaits = key;
      app.say(key === "m" ? "Mark: press a letter" : "Go to mark: press a letter");
    } else if (action) {
      app.inTurn(action);
    }
    return key === "m" || key === "'" || action !== undefined;
  }

  private here(): RowPosition {
    const { cursor, ordinal } = this.app.core;
    return { frame: cursor.frame, ordinal };
  }

  private async finding(step: number): Promise<void> {
    const { app } = this;
    const all = countingOf(app.core.overview)
      .flatMap((one) => one.occurrences.map((it) => ({ id: one.finding, frame: it.frames[1], text: one.text, time: since(app.core.overview, it.t) })))
      .sort((one, other) => one.frame - other.frame);
    const { frame } = app.core.cursor;
    const found = step > 0 ? all.find((one) => one.frame > frame) : all.reverse().find((one) => one.frame < frame);
    if (!found) return app.say(step > 0 ? "No later finding" : "No earlier finding");
    app.core.finding = found.id;
    app.say(found.text);
    await app.goTo(found.frame);
  }

  private async story(step: number): Promise<void> {
    const { app } = this;
    const stories = app.core.overview.why?.stories ?? [];
    const { frame } = app.core.cursor;
    const all = stories.filter((one) => one.frames).sort((one, other) => one.frames![1] - other.frames![1]);
    const found = step > 0 ? all.find((one) => one.frames![1] > frame) : all.reverse().find((one) => one.frames![1] < frame);
    if (!found?.frames) return app.say(step > 0 ? "No later story" : "No earlier story");
    app.core.finding = found.findings[0] ?? null;
    app.say(found.title);
    await app.goTo(found.frames[1]);
  }

  private async error(backward: boolean): Promise<void> {
    const { app } = this;
    const found = await app.core.client.call<RowPosition | null>({ do: "error", from: this.here(), backward });
    if (!found) return app.say(backward ? "No earlier error event" : "No later error event");
    await app.goTo(found.frame, found.ordinal);
  }

  private async search(backward: boolean): Promise<void> {
    const { app, sought } = this;
    if (sought === "") return app.say("No search text; press / first");
    const { client, list } = app.core;
    const done = await client.job({ do: "search", text: sought, list, from: this.here(), backward }, (value) => {
      app.say(`Searching, ${Math.round((100 * (value.frames ?? 0)) / Math.max(1, value.size ?? 1))} %`);
    });
    if (done.invalid) return app.say(`${sought}: ${done.invalid.reason}`);
    if (done.phase !== "done") return;
    const found = done.place;
    if (!found) return app.say(`No ${backward ? "earlier" : "later"} row matches ${sought}`);
    app.say(`Found ${sought}`);
    await app.goTo(found.frame, found.ordinal);
  }

  private async mark(purpose: "m" | "'", letter: string): Promise<void> {
    const { app, marks } = this;
    if (purpose === "m") {
      marks.set(letter, this.here());
      return app.say(`Mark ${letter} set`);
    }
    const place = marks.get(letter);
    if (!place) return app.say(`Mark ${letter} is not set`);
    await app.goTo(place.frame, place.ordinal);
  }

  private clock(): void {
    const { app } = this;
    app.core.clock = nextClock(app.core.clock, app.core.overview);
    app.say(app.core.overview.start === null ? "Times count from the start of the capture; no wall-clock time" : `Times in ${app.core.clock === "local" ? "local time" : app.core.clock}`);
    app.redraw();
  }

  private select(): void {
    const { app } = this;
    app.core.selection = app.core.selection === null ? app.core.cursor.frame : null;
    app.say(app.core.selection === null ? "Selection cleared" : `Selected from #${app.core.selection} to the cursor; w exports it`);
  }

  private second(): void {
    const { app } = this;
    app.core.second = app.core.second === null ? app.core.cursor.time : null;
    app.say(app.core.second === null ? "Cursor B removed" : "Cursor B set; the plot shows the difference from the cursor");
    app.redraw();
  }

  /** Asks for a text of a row. */
  private askText(): void {
    this.ask("sought", "Search", "text of a row (regular expression)", this.sought, async (text) => {
      this.sought = text;
      if (text !== "") await this.search(false);
    });
  }

  /** Asks for a position: `12.5` (seconds), `#1234` (frame). */
  private askPlace(): void {
    this.ask("place", "Go to", "12.5 (seconds) or #1234 (frame)", "", async (text) => {
      const number = Number(text.replace(/^#/, ""));
      if (!Number.isFinite(number) || text === "") return this.app.say(`${text}: expected 12.5 (seconds) or #1234 (frame)`);
      await (text.startsWith("#") ? this.app.goTo(number) : this.app.goToTime(number));
    });
  }

  private ask(id: string, label: string, hint: string, text: string, take: (text: string) => Promise<void>): void {
    const { app } = this;
    const field = h("input", { type: "text", id, "aria-label": `${label}: ${hint}`, placeholder: hint, value: text });
    const close = () => { form.remove(); app.focus(); };
    const form = h("form", { class: "ask", onsubmit: (event: Event) => {
      event.preventDefault();
      const typed = field.value.trim();
      close();
      app.inTurn(() => take(typed));
    } }, h("label", { for: id }, label), field);
    field.onkeydown = (event) => { if (event.key === "Escape") close(); event.stopPropagation(); };
    this.foot.querySelector("form")?.remove();
    this.foot.append(form);
    field.focus();
    field.select();
  }
}
