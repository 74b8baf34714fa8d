// The page: the open captures, the cursor in time, and the panes.

import { Client, PageError } from "./client";
import { bytes, fill, grouped, h, plural, seconds } from "./dom";
import { moment, shortMoment } from "./clock";
import { formatLink, parseLink } from "./hash";
import { helpDialog, PANE_KEYS } from "./help";
import { busPane } from "./panes/bus";
import { detailPane } from "./panes/detail";
import { eventsPane } from "./panes/events";
import { signalsPane } from "./panes/signals";
import { findingsPane, framesPane, nodesPane, objectsPane, transfersPane } from "./panes/tables";
import { whyPane } from "./panes/why";
import type { BusState, ListName, NodeProfile, RowPosition, Overview, Progress } from "./protocol";
import { Navigation } from "./navigation";
import { copy, download } from "./save";
import { countingOf, type App, type Core, type Pane, type PaneName } from "./state";
import { Strip } from "./strip";

/** Suffixes of files next to a capture. */
const BESIDE = /\.(toml|eds|dcf|xdd|xdc|dbc|json)$/i;

/** Suffixes of exported files. */
const SUFFIXES: Record<string, string> = { csv: "values.csv", jsonl: "events.jsonl", text: "events.txt", pcapng: "frames.pcapng" };

const FORMATS = "candump log, pcap and pcapng, ASC, BLF, TRC, MDF4, MCAP, CSV, BUSMASTER, CRTD and others; plain, gzip or zstd";

/** Selection of the events. */
interface Shown { filter: string; onlyNews: boolean }

export class Page implements App {
  core!: Core;
  private client: Client | null = null;
  /** A worker whose module is compiled while the user looks for the capture. */
  private spare: Client | null = null;
  private files: File[] = [];
  private nodes: NodeProfile[] = [];
  private panes: Pane[];
  private events: ReturnType<typeof eventsPane>;
  private signals: ReturnType<typeof signalsPane>;
  private current: PaneName = "why";
  private strip = new Strip(this);
  private stateLoop: Promise<void> | null = null;
  private isStateStale = false;
  private root: HTMLElement;
  private tabs = h("div", { class: "tabs", role: "tablist", "aria-label": "Panes" });
  private main = h("div", { class: "main", id: "main", role: "tabpanel" });
  private side = h("section", { class: "side", "aria-label": "Detail of the event at the cursor" });
  private head = h("header", { class: "top" });
  private foot = h("footer", { class: "foot" });
  private position = h("span", { class: "position" });
  private status = h("p", { class: "status", role: "status" });
  private alert = h("p", { class: "banner error alert", role: "alert", hidden: true });
  private input = h("input", { type: "file", multiple: true, id: "files", class: "hidden-input", onchange: () => {
    const files = [...(this.input.files ?? [])];
    // The same files can be chosen again after they were changed.
    this.input.value = "";
    void this.take(files);
  } });
  private help = helpDialog();
  private navigation = new Navigation(this, this.foot);
  /** Moves and the keys typed after them, in order. */
  private turn: Promise<void> = Promise.resolve();
  /** Filters before and after the present one. */
  private before: Shown[] = [];
  private after: Shown[] = [];

  constructor(root: HTMLElement) {
    this.root = root;
    this.events = eventsPane(this);
    this.signals = signalsPane(this);
    this.panes = [
      whyPane(this), nodesPane(this), this.events, framesPane(this), detailPane(this),
      this.signals, transfersPane(this), objectsPane(this), findingsPane(this), busPane(this),
    ];
    addEventListener("dragover", (event) => { event.preventDefault(); document.body.classList.add("over"); });
    addEventListener("dragleave", (event) => { if (!event.relatedTarget) document.body.classList.remove("over"); });
    addEventListener("drop", (event) => {
      event.preventDefault();
      document.body.classList.remove("over");
      void this.take([...(event.dataTransfer?.files ?? [])]);
    });
    addEventListener("paste", (event) => this.paste(event));
    addEventListener("keydown", (event) => this.key(event));
    // A move that was under way may have written its own link over the address by now.
    addEventListener("hashchange", (event) => this.follow(new URL(event.newURL).hash));
    this.welcome();
  }

  // ── empty screen and progress ──────────────────────────────────────────────────────────────────────────────

  private welcome(error = ""): void {
    setTimeout(() => { if (!this.client && !this.spare) this.spare = new Client(() => { this.spare = null; }); }, 300);
    this.root.className = "empty";
    fill(
      this.root,
      h(
        "main",
        { class: "welcome" },
        h("h1", {}, "cobscope"),
        h("p", { class: "lead" }, "Drop a CAN capture here, or paste its lines. It is decoded and checked in this browser and never leaves this computer."),
        error && h("p", { class: "banner error", role: "alert" }, error),
        h("label", { class: "choose", for: "files" }, "Choose files"),
        this.input,
        h("p", { class: "quiet" }, "CANopen, J1939, ISOBUS, UDS. ", FORMATS, "."),
        h("p", { class: "quiet" }, "Add a bus file (TOML), EDS, DCF, XDD or DBC by dropping it together with the capture. ",
          "The page stores nothing, loads nothing and works offline. ",
          h("kbd", {}, "o"), " opens, ", h("kbd", {}, "?"), " lists all keys."),
      ),
      this.help.element,
    );
  }

  private working(names: string): { update(value: Progress): void } {
    this.root.className = "working";
    const bar = h("progress", { max: 1, "aria-label": "Progress" });
    const text = h("p", { role: "status" }, "Starting");
    fill(
      this.root,
      h("main", { class: "welcome" }, h("h1", {}, names), bar, text, h("button", { type: "button", onclick: () => this.close() }, "Cancel")),
    );
    return {
      update: (value) => {
        if (value.phase === "unpack") text.textContent = `Decompressing, ${bytes(value.bytes ?? 0)}`;
        if (value.phase !== "read") return;
        const share = (value.bytes ?? 0) / Math.max(1, value.size ?? 1);
        if (share <= 1) bar.value = share;
        else bar.removeAttribute("value");
        text.textContent = `${grouped(value.frames ?? 0)} frames, ${bytes(value.bytes ?? 0)}, ${plural(value.findings ?? 0, "finding")} so far`;
      },
    };
  }

  private close(error = ""): void {
    try { history.replaceState(null, "", "#"); } catch { /* see write */ }
    this.client?.end();
    this.client = null;
    this.files = [];
    this.nodes = [];
    this.input.value = "";
    document.title = "cobscope";
    this.welcome(error);
  }

  /** Text or files of the clipboard are read like dropped ones, except in a field of the page. */
  private paste(event: ClipboardEvent): void {
    if (event.target instanceof HTMLInputElement || event.target instanceof HTMLTextAreaElement) return;
    const files = [...(event.clipboardData?.files ?? [])];
    const text = event.clipboardData?.getData("text/plain") ?? "";
    if (files.length === 0 && text.trim() === "") return;
    event.preventDefault();
    void this.take(files.length > 0 ? files : [new File([text], "pasted.txt")]);
  }

  /** Files were dropped or chosen: captures replace those that are open, others are added to them. */
  private async take(files: File[]): Promise<void> {
    if (files.length === 0) return;
    const captures = files.filter((file) => !BESIDE.test(file.name));
    const beside = files.filter((file) => BESIDE.test(file.name));
    if (captures.length === 0) {
      const open = this.files.filter((file) => !BESIDE.test(file.name));
      if (open.length === 0) return this.close(`${beside.map((file) => file.name).join(", ")}: no capture; drop one together with it`);
      const known = this.files.filter((file) => BESIDE.test(file.name) && !beside.some((one) => one.name === file.name));
      this.files = [...open, ...known, ...beside];
    } else {
      this.files = [...captures, ...beside];
      this.nodes = [];
    }
    await this.open();
  }

  private async open(): Promise<void> {
    const { files, nodes } = this;
    const captures = files.filter((file) => !BESIDE.test(file.name));
    const names = captures.map((file) => file.name).join(", ");
    const { update } = this.working(names);
    this.client?.end();
    const client = this.spare ?? new Client(() => {});
    this.spare = null;
    client.onFatal = (error) => { if (this.client === client) this.close(`${names}: ${error}`); };
    this.client = client;
    client.files(files);
    const named = (file: File) => ({ file: files.indexOf(file), name: file.name, size: file.size });
    const beside = files.filter((file) => BESIDE.test(file.name));
    const now = new Date();
    const today = `${now.getFullYear()}-${String(now.getMonth() + 1).padStart(2, "0")}-${String(now.getDate()).padStart(2, "0")}`;
    const request = { do: "open" as const, captures: captures.map(named), beside: beside.map(named), nodes, today };
    try {
      await client.job(request, update);
      if (this.client !== client) return;
      const overview = await client.call<Overview>({ do: "overview" });
      if (this.client === client) this.ready(client, overview, beside.map((file) => file.name));
    } catch (error) {
      if (this.client === client) this.close(error instanceof Error ? error.message : String(error));
    }
  }

  // ── an open capture ────────────────────────────────────────────────────────────────────────────────────────

  private ready(client: Client, overview: Overview, beside: string[]): void {
    const list: ListName = "all";
    this.core = {
      client, overview, beside, nodes: this.nodes,
      cursor: { frame: 0, time: 0 }, ordinal: 0, list, filter: "", total: overview.events,
      state: null, node: null, signals: [], finding: null, clock: "seconds", selection: null, second: null,
    };
    this.navigation.reset();
    [this.before, this.after, this.onlyNews] = [[], [], false];
    this.stateLoop = null;
    document.title = `${overview.name} – cobscope`;
    this.root.className = "open";
    this.header();
    this.tabs.replaceChildren(
      ...this.panes.map((pane, place) =>
        h(
          "button",
          { type: "button", role: "tab", id: `tab-${pane.name}`, "aria-controls": "main", "aria-selected": "false", tabindex: -1, onclick: () => this.show(pane.name) },
          h("kbd", { "aria-hidden": "true" }, String(place)), ` ${pane.title}`,
          pane.name === "findings" ? this.badge() : null,
        ),
      ),
    );
    this.tabs.onkeydown = (event) => {
      const place = this.panes.findIndex((pane) => pane.name === this.current);
      const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
      if (step === 0) return;
      event.preventDefault();
      const next = this.panes[(place + step + this.panes.length) % this.panes.length];
      if (next) { this.show(next.name); document.getElementById(`tab-${next.name}`)?.focus(); }
    };
    fill(this.foot, this.position, this.status);
    const stage = h("main", { class: "stage" }, this.strip.element, this.tabs, this.alert, h("div", { class: "work" }, this.main, this.side), this.input);
    fill(this.root, this.head, stage, this.foot, this.help.element);
    this.alert.hidden = true;
    const detail = this.pane("detail");
    fill(this.side, detail.element);
    this.events.list.reset(overview.events);
    const story = overview.why?.stories[0];
    const first = story?.frames?.[1] ?? countingOf(overview)[0]?.occurrences[0]?.frames[1] ?? 1;
    // Showing a pane writes the link, so that the one of the address is read first.
    const link = location.hash;
    this.show("why");
    if (!this.follow(link)) this.inTurn(() => this.goTo(first));
  }

  private badge(): HTMLElement | null {
    const { errors, warnings } = this.core.overview;
    const text = [errors > 0 ? `${errors} E` : "", warnings > 0 ? `${warnings} w` : ""].filter(Boolean).join(" ");
    return text ? h("span", { class: `badge ${errors > 0 ? "error" : "warning"}` }, text) : null;
  }

  private header(): void {
    const { overview, beside } = this.core;
    const verdict = overview.errors + overview.warnings === 0 ? "no error or warning"
      : [overview.errors > 0 ? plural(overview.errors, "error") : "", overview.warnings > 0 ? plural(overview.warnings, "warning") : ""].filter(Boolean).join(", ");
    const format = h("select", { "aria-label": "Export", onchange: () => { const name = format.value; format.value = ""; if (name) void this.export(name); } });
    for (const [value, text] of [["", "Export…"], ["cut", "cut-out capture of the story (pcapng)"], ["pcapng", "frames (pcapng)"], ["csv", "values (CSV)"], ["jsonl", "events (JSON Lines)"], ["text", "events (text)"], ["link", "link to this position"]]) {
      format.append(h("option", { value: value ?? "" }, text ?? ""));
    }
    fill(
      this.head,
      h("h1", { title: overview.name }, overview.name),
      h("p", { class: "facts" },
        h("span", { class: `severity ${overview.errors > 0 ? "error" : overview.warnings > 0 ? "warning" : "good"}` }, verdict),
        ` ${plural(overview.frames, "frame")}${overview.duration === null ? "" : ` in ${seconds(overview.duration)} s`}, ${overview.format}`,
        beside.length > 0 ? `; with ${beside.join(", ")}` : "",
        overview.failure ? [h("span", { class: "severity error" }, " INCOMPLETE")] : []),
      h("p", { class: "buttons" },
        h("button", { type: "button", class: "primary", onclick: () => this.saveReport(this.core.finding) }, "Save report"),
        format,
        h("label", { class: "choose small", for: "files" }, "Open"),
        h("button", { type: "button", onclick: () => this.help.open() }, "Keys")),
    );
  }

  private pane(name: PaneName): Pane {
    return this.panes.find((pane) => pane.name === name) ?? this.panes[0]!;
  }

  private get hasSide(): boolean {
    return getComputedStyle(this.side).display !== "none";
  }

  show(name: PaneName): void {
    this.current = name;
    const pane = this.pane(name);
    for (const tab of this.tabs.children) {
      const isOwn = tab.id === `tab-${name}`;
      tab.setAttribute("aria-selected", String(isOwn));
      (tab as HTMLElement).tabIndex = isOwn ? 0 : -1;
      if (isOwn) tab.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
    this.root.classList.toggle("without-side", name === "detail");
    this.main.setAttribute("aria-labelledby", `tab-${name}`);
    const detail = this.pane("detail");
    if (name === "detail") fill(this.main, detail.element);
    else {
      fill(this.main, pane.element);
      if (!this.side.contains(detail.element)) fill(this.side, detail.element);
    }
    pane.open();
    this.refresh();
    pane.focus();
    this.write();
  }

  // ── cursor ─────────────────────────────────────────────────────────────────────────────────────────────────

  async goTo(frame: number, ordinal = 0): Promise<void> {
    await this.locate({ spot: { frame, ordinal } }, frame, ordinal).catch((error) => this.fail(error));
  }

  async goToTime(time: number): Promise<void> {
    await this.locate({ time }).catch((error) => this.fail(error));
  }

  inTurn(action: () => Promise<void> | void): void {
    this.turn = this.turn.then(() => this.events.list.settled()).then(action).catch((error) => this.fail(error));
  }

  focus(): void {
    this.pane(this.current).focus();
  }

  redraw(): void {
    const { clock, overview } = this.core;
    // Times with a day are wider.
    this.events.element.classList.toggle("days", shortMoment(0, clock, overview).includes(" "));
    this.events.list.repaint();
    this.moved();
  }

  private async locate(at: { spot: RowPosition } | { time: number }, frame?: number, ordinal = 0): Promise<void> {
    const { client, list, total } = this.core;
    const found = await client.call<{ row: number; frame: number }>({ do: "locate", list: total > 0 ? list : "all", at });
    const target = frame ?? found.frame;
    this.events.list.reveal(found.row);
    this.core.cursor = { frame: target, time: "time" in at ? at.time : null };
    this.core.ordinal = ordinal;
    await this.refreshState();
    if ("spot" in at && this.core.state) this.core.cursor.time = this.core.state.time;
    this.moved();
  }

  changed(): void {
    this.moved();
    void this.refreshState().then(() => this.pane(this.current).moved()).catch((error) => this.fail(error));
  }

  /** Reads the state at the cursor; a cursor that moves meanwhile is read once, when the response arrives. */
  private refreshState(): Promise<void> {
    this.isStateStale = true;
    this.stateLoop ??= (async () => {
      while (this.isStateStale) {
        this.isStateStale = false;
        const { client, cursor } = this.core;
        const state = await client.call<BusState>({ do: "state", frame: cursor.frame });
        if (client === this.core.client) this.core.state = state;
      }
    })().finally(() => { this.stateLoop = null; });
    return this.stateLoop;
  }

  private refresh(): void {
    const { cursor, overview, clock, selection } = this.core;
    const unit = clock === "seconds" ? " s" : clock === "UTC" ? " UTC" : "";
    const selected = selection === null ? "" : `  selected from #${selection}`;
    this.position.textContent = `t ${moment(cursor.time, clock, overview)}${unit}  #${cursor.frame}/${overview.frames}${selected}`;
    this.strip.draw();
  }

  private moved(): void {
    this.refresh();
    this.pane(this.current).moved();
    if (this.hasSide && this.current !== "detail") this.pane("detail").moved();
    this.write();
  }

  private write(): void {
    const { cursor, filter } = this.core;
    const link = formatLink({ time: cursor.time, frame: cursor.frame, pane: this.current, filter });
    // A file:// page may refuse to change its history.
    try { history.replaceState(null, "", link); } catch { /* the link is still in the export menu */ }
  }

  /** Goes to the place of a link; false if it has none. */
  private follow(hash: string): boolean {
    if (!this.root.className.startsWith("open")) return false;
    const link = parseLink(hash, this.panes.map((pane) => pane.name));
    if (link.filter) void this.setFilter(link.filter);
    if (link.pane) this.show(link.pane as PaneName);
    const { frame, time } = link;
    if (frame !== null) this.inTurn(() => this.goTo(frame));
    else if (time !== null) this.inTurn(() => this.goToTime(time));
    return link.frame !== null || link.time !== null;
  }

  // ── filter ─────────────────────────────────────────────────────────────────────────────────────────────────

  async setFilter(text: string): Promise<void> {
    if (text !== this.core.filter) this.keep();
    this.core.filter = text;
    await this.select(this.onlyNews);
  }

  private onlyNews = false;

  async setOnlyNews(onlyNews: boolean): Promise<void> {
    if (onlyNews !== this.onlyNews) this.keep();
    await this.select(onlyNews);
  }

  /** Keeps the present selection for undo. */
  private keep(): void {
    this.before.push({ filter: this.core.filter, onlyNews: this.onlyNews });
    this.after = [];
  }

  private async undo(from: Shown[], to: Shown[]): Promise<void> {
    const shown = from.pop();
    if (!shown) return this.say(from === this.before ? "Nothing to undo" : "Nothing to redo");
    to.push({ filter: this.core.filter, onlyNews: this.onlyNews });
    this.core.filter = shown.filter;
    await this.select(shown.onlyNews);
    this.say(shown.filter === "" ? "No filter" : `Filter ${shown.filter}`);
  }

  /** Filters by node and kind of the selected event. */
  private async filterLikeThis(): Promise<void> {
    const wanted = this.events.list.row(this.events.list.selected)?.filter;
    if (!wanted) return this.say("No event is selected");
    const { filter } = this.core;
    const text = filter === "" || filter.includes(wanted) ? wanted : `(${filter}) && ${wanted}`;
    this.show("events");
    await this.setFilter(text);
  }

  private async copyLine(): Promise<void> {
    const row = this.events.list.row(this.events.list.selected);
    if (!row) return this.say("No event is selected");
    const isCopied = await copy(`${moment(row.time, this.core.clock, this.core.overview, 6)} ${row.line}`);
    this.say(isCopied ? "Copied" : "The browser does not allow copying");
  }

  private async select(onlyNews: boolean): Promise<void> {
    const { core } = this;
    const { client } = core;
    this.onlyNews = onlyNews;
    const problem = this.events as unknown as { showProblem(text: string): void };
    problem.showProblem("");
    try {
      if (core.filter === "") {
        core.list = onlyNews ? "news" : "all";
        core.total = onlyNews ? core.overview.news : core.overview.events;
      } else {
        const done = await client.job({ do: "filter", text: core.filter, only_news: onlyNews }, (value) => {
          this.say(`Filtering, ${Math.round((100 * (value.frames ?? 0)) / Math.max(1, value.size ?? 1))} %`);
        });
        const { invalid } = done;
        if (invalid) {
          problem.showProblem(`${invalid.reason} (character ${invalid.start + 1})`);
          return;
        }
        if (done.phase !== "done") return;
        core.list = "filter";
        core.total = done.total ?? 0;
        this.say(`${grouped(core.total)} events match`);
      }
      this.events.list.reset(core.total);
      this.events.open();
      if (core.total > 0) {
        const at = { spot: { frame: core.cursor.frame, ordinal: core.ordinal } };
        const found = await client.call<{ row: number }>({ do: "locate", list: core.list, at });
        this.events.list.reveal(found.row);
      }
      this.write();
    } catch (error) {
      this.fail(error);
    }
  }

  // ── results to keep ────────────────────────────────────────────────────────────────────────────────────────

  private stem(): string {
    return this.core.overview.name.split(",")[0]!.replace(/\.[^.]*$/, "").replace(/[^\w.-]+/g, "_").slice(0, 80) || "capture";
  }

  private async report(finding: number | null): Promise<Progress> {
    const done = await this.core.client.job(
      { do: "report", finding, page: finding === null ? "cobscope.html, report of all stories" : `cobscope.html, report of finding ${finding}` },
      (value) => this.say(`Report, ${Math.round((100 * (value.frames ?? 0)) / Math.max(1, value.size ?? 1))} %`),
    );
    return done;
  }

  saveReport(finding: number | null): void {
    const { client } = this.core;
    void (async () => {
      const done = await this.report(finding);
      if (done.phase !== "done") return;
      const content = await client.call<Uint8Array<ArrayBuffer>>({ do: "bytes", what: "report" });
      const name = `${this.stem()}${finding === null ? "" : `-finding-${finding}`}.report.html`;
      download(name, [content], "text/html");
      this.say(`${name} saved (${bytes(content.length)})`);
    })().catch((error) => this.fail(error));
  }

  private async export(format: string): Promise<void> {
    const { client, list, overview } = this.core;
    try {
      if (format === "link") {
        const link = formatLink({ time: this.core.cursor.time, frame: this.core.cursor.frame, pane: this.current, filter: this.core.filter });
        await copy(link);
        return this.say(`Link for whoever has ${overview.name}: ${link}`);
      }
      if (format === "cut") {
        const done = await this.report(this.core.finding);
        if (done.phase !== "done") return;
        if (!done.cut) return this.say("No story with frames: no capture was cut out");
        const content = await client.call<Uint8Array<ArrayBuffer>>({ do: "bytes", what: "cut" });
        download(`${this.stem()}.cut.pcapng`, [content], "application/octet-stream");
        return this.say(`${this.stem()}.cut.pcapng saved (${bytes(content.length)})`);
      }
      const parts: Uint8Array<ArrayBuffer>[] = [];
      const { selection, cursor } = this.core;
      const frames: [number, number] | null = selection === null ? null : [Math.min(selection, cursor.frame), Math.max(selection, cursor.frame)];
      const done = await client.job({ do: "export", format, list, frames }, (value, part) => {
        if (part && part.length > 0) parts.push(part);
        this.say(`Export, ${Math.round((100 * (value.frames ?? 0)) / Math.max(1, value.size ?? 1))} %`);
      });
      if (done.phase !== "done") return;
      const name = `${this.stem()}.${SUFFIXES[format] ?? format}`;
      download(name, parts, format === "pcapng" ? "application/octet-stream" : format === "csv" ? "text/csv" : "text/plain");
      this.say(`${name} saved (${bytes(parts.reduce((sum, part) => sum + part.length, 0))})`);
    } catch (error) {
      this.fail(error);
    }
  }

  assign(profile: NodeProfile | null, node: { bus: string; node: number; j1939: boolean }): void {
    const number = (one: NodeProfile) => ("j1939" in one.node ? one.node.j1939 : one.node.canopen);
    const others = this.nodes.filter((one) => one.bus !== node.bus || number(one) !== node.node || "j1939" in one.node !== node.j1939);
    this.nodes = profile ? [...others, profile] : others;
    void this.open();
  }

  say(text: string): void {
    this.status.textContent = text;
  }

  fail(error: unknown): void {
    const text = error instanceof PageError || error instanceof Error ? error.message : String(error);
    this.alert.textContent = text;
    this.alert.hidden = false;
  }

  // ── keys ───────────────────────────────────────────────────────────────────────────────────────────────────

  private key(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    const isText = target.matches("input[type=text], input[type=search], select, textarea");
    if (isText || event.ctrlKey || event.metaKey || event.altKey || this.help.isOpen()) return;
    if (this.navigation.letter(event.key)) return event.preventDefault();
    if (event.key === "?" || event.key === "F1") { event.preventDefault(); return this.help.open(); }
    if (event.key === "o" || event.key === "O") return this.input.click();
    if (!this.root.className.startsWith("open")) return;
    const pane = PANE_KEYS[event.key];
    if (pane !== undefined) return this.show(pane);
    if (this.pane(this.current).key?.(event)) return;
    if (this.navigation.key(event.key)) return event.preventDefault();
    switch (event.key) {
      case "=": return this.inTurn(() => this.filterLikeThis());
      case "u": return this.inTurn(() => this.undo(this.before, this.after));
      case "U": return this.inTurn(() => this.undo(this.after, this.before));
      case "y": return this.inTurn(() => this.copyLine());
      case "a": this.show("nodes"); return this.main.querySelector<HTMLElement>("select")?.focus();
      case "i": this.strip.element.hidden = !this.strip.element.hidden; return this.strip.draw();
      case "f": case "F3": event.preventDefault(); this.show("events"); return this.events.search();
      case "v": this.show("events"); return this.inTurn(() => this.setOnlyNews(!this.onlyNews));
      case "c": return this.inTurn(() => this.setFilter(""));
      case "w": case "F2": return void this.head.querySelector<HTMLElement>("select")?.focus();
      case "R": return this.saveReport(this.core.finding);
      case "p": return this.show("signals");
      case "Escape": case "Backspace": return this.show(this.current === "detail" ? "events" : "why");
      default:
    }
  }
}
