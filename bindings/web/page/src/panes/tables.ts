// Panes that are tables: findings, nodes, identifiers, objects, transfers.

import { h, seconds } from "../dom";
import { frameButton, linked } from "../links";
import type { Finding, FrameState, NodeState, ObjectState, TransferRow } from "../protocol";
import { findingsOf, since, type App, type Pane } from "../state";
import { Table } from "../table";
import { VirtualList } from "../virtual";

const RANK: Record<string, number> = { error: 0, warning: 1, note: 2 };

export function findingsPane(app: App): Pane {
  const first = (one: Finding) => since(app.core.overview, one.occurrences[0]?.t ?? null);
  const frame = (one: Finding) => one.occurrences[0]?.frames[1] ?? 0;
  const table = new Table<Finding>({
    label: "Findings",
    empty: "No finding",
    columns: [
      { title: "Severity", cell: (one) => h("span", { class: `severity ${one.severity}` }, one.standing === "new" ? one.severity : `${one.severity}, ${one.standing}`), order: (one) => RANK[one.severity] ?? 3 },
      { title: "Bus", cell: (one) => one.bus, order: (one) => one.bus },
      { title: "Node", cell: (one) => (one.node === undefined ? "" : `${one.node}${one.node_name ? ` ${one.node_name}` : ""}`), order: (one) => one.node ?? -1 },
      { title: "×", name: "number", cell: (one) => String(one.count), order: (one) => one.count },
      { title: "First", name: "number", cell: (one) => seconds(first(one)), order: (one) => first(one) ?? 0 },
      { title: "Finding", name: "text", cell: (one) => [
        h("span", {}, linked(app, one.text)),
        one.next_step ? h("span", { class: "next quiet" }, ` Next: ${one.next_step}.`) : "",
      ] },
      { title: "Rule", cell: (one) => one.rule, order: (one) => one.rule },
      { title: "Evidence", cell: (one) => one.occurrences.slice(0, 5).map((it) => frameButton(app, it.frames[1])) },
      { title: "Report", cell: (one) => one.severity === "note" ? "" : h("button", { type: "button", "aria-label": `Save report of finding ${one.finding}`, onclick: () => app.saveReport(one.finding) }, "Save") },
    ],
    rowClass: (one) => (one.finding === app.core.finding ? "selected" : ""),
    onOpen: (one) => { app.core.finding = one.finding; app.goTo(frame(one)); app.show("events"); },
  });
  return {
    name: "findings",
    title: "Findings",
    element: h("div", { class: "pane" }, table.element),
    open() {
      const all = findingsOf(app.core.overview);
      table.set([...all].sort((one, other) => (RANK[one.severity] ?? 3) - (RANK[other.severity] ?? 3)));
    },
    moved() {},
    focus: () => table.focus(),
  };
}

export function nodesPane(app: App): Pane {
  const toned = (one: { text: string; tone: string }) => h("span", { class: one.tone }, one.text);
  const lines = (all: (Node | string)[]) => all.flatMap((one, place) => (place > 0 ? [h("br"), one] : [one]));
  const profiles = (node: NodeState) => {
    const own = app.core.nodes.find((one) => one.bus === node.bus_name && ("j1939" in one.node ? one.node.j1939 : one.node.canopen) === node.node);
    const select = h("select", {
      "aria-label": `Profile of node ${node.number}`,
      onchange: () => app.assign(
        select.value ? { bus: node.bus_name, node: node.j1939 ? { j1939: node.node } : { canopen: node.node }, profile: select.value } : null,
        { bus: node.bus_name, node: node.node, j1939: node.j1939 },
      ),
    });
    select.append(h("option", { value: "" }, node.profile ?? "automatic"));
    for (const id of app.core.overview.profiles) select.append(h("option", { value: id, selected: own?.profile === id }, id));
    return select;
  };
  const table = new Table<NodeState>({
    label: "Nodes at the cursor",
    empty: "No node before the cursor",
    columns: [
      { title: "Bus", cell: (one) => one.bus_name, order: (one) => one.bus },
      { title: "ID/hex", cell: (one) => one.number, order: (one) => one.node },
      { title: "Name", cell: (one) => one.name, order: (one) => one.name ?? "" },
      { title: "Device", cell: (one) => one.device },
      { title: "NMT", cell: (one) => (one.nmt ? toned({ text: `${one.nmt}${one.presumed ? "?" : ""}`, tone: one.nmt === "operational" ? "good" : "caution" }) : one.j1939 ? "J1939" : "?") },
      { title: "State", cell: (one) => lines(one.states.map(toned)) },
      { title: "Set points", cell: (one) => lines(one.set_points.map((it) => h("span", { class: it.effective === "no" ? "bad" : "" }, `${it.name} ${it.value}${it.effective === "no" ? ", not effective" : ""}`))) },
      { title: "Gates", cell: (one) => lines(one.gates.filter((it) => it.status === "closed").map((it) => h("span", { class: "bad", title: it.advice }, `needs ${it.gate}${it.detail ? ` (${it.detail})` : ""}`))) },
      { title: "Alive", cell: (one) => (one.alive ? toned(one.alive) : "") },
      { title: "Errors", cell: (one) => h("span", { class: "bad" }, one.errors.join(", ")) },
      { title: "Objects", cell: (one) => one.objects === 0 ? "" : h("button", { type: "button", onclick: () => { app.core.node = one; app.show("objects"); } }, `${one.objects}`) },
      { title: "Profile", cell: profiles },
    ],
    rowClass: (one) => (app.core.node?.node === one.node && app.core.node.bus === one.bus ? "selected" : ""),
    onOpen: (one) => { app.core.node = one; app.show("objects"); },
  });
  const show = () => table.set(app.core.state?.nodes ?? []);
  return { name: "nodes", title: "Nodes", element: h("div", { class: "pane" }, table.element), open: show, moved: show, focus: () => table.focus() };
}

export function framesPane(app: App): Pane {
  const millis = (value: number | null) => (value === null ? "" : value.toFixed(3));
  const table = new Table<FrameState>({
    label: "Identifiers up to the cursor",
    empty: "No frame before the cursor",
    columns: [
      { title: "Bus", cell: (one) => one.bus, order: (one) => one.bus },
      { title: "ID", cell: (one) => `${one.id}${one.remote ? " R" : ""}`, order: (one) => one.id.padStart(10) },
      { title: "Message", name: "text", cell: (one) => one.message, order: (one) => one.message },
      { title: "Count", name: "number", cell: (one) => String(one.count), order: (one) => one.count },
      { title: "Mean ms", name: "number", cell: (one) => millis(one.mean), order: (one) => one.mean ?? -1 },
      { title: "Jitter", name: "number", cell: (one) => millis(one.jitter), order: (one) => one.jitter ?? -1 },
      { title: "Age s", name: "number", cell: (one) => seconds(one.age), order: (one) => one.age ?? -1 },
      { title: "Data", name: "data", cell: (one) => one.data },
    ],
  });
  const show = () => table.set(app.core.state?.frames ?? []);
  return { name: "frames", title: "Frames", element: h("div", { class: "pane" }, table.element), open: show, moved: show, focus: () => table.focus() };
}

export function objectsPane(app: App): Pane {
  const title = h("h2", { class: "subject" });
  const table = new Table<ObjectState>({
    label: "Objects of the node",
    empty: "No object of this node is known",
    columns: [
      { title: "Object", name: "data", cell: (one) => one.object, order: (one) => one.object },
      { title: "Name", cell: (one) => one.name, order: (one) => one.name ?? "" },
      { title: "Value", cell: (one) => one.value },
      { title: "Raw", name: "data", cell: (one) => one.raw },
      { title: "Origin", cell: (one) => (one.frame > 0 ? [`${one.origin} `, frameButton(app, one.frame)] : one.origin), order: (one) => one.frame },
      { title: "Time", name: "number", cell: (one) => seconds(one.time), order: (one) => one.time ?? -1 },
      { title: "Persists", cell: (one) => (one.persists === "not-stored" ? "unsaved" : one.persists) },
      { title: "Pending", name: "data", cell: (one) => one.pending },
    ],
  });
  const picker = h("select", { "aria-label": "Node", onchange: () => {
    const found = app.core.state?.nodes[Number(picker.value)];
    if (found) { app.core.node = found; void show(); }
  } });
  async function show(): Promise<void> {
    const { core } = app;
    const nodes = (core.state?.nodes ?? []).filter((one) => one.objects > 0);
    const is = (one: NodeState) => core.node !== null && one.bus === core.node.bus && one.node === core.node.node && one.j1939 === core.node.j1939;
    const node = nodes.find(is) ?? nodes[0];
    picker.replaceChildren(...nodes.map((one) => h("option", { value: core.state?.nodes.indexOf(one) ?? 0, selected: one === node }, `${one.bus_name} ${one.number} ${one.name ?? one.device ?? ""}`)));
    picker.hidden = nodes.length === 0;
    title.textContent = node ? `Objects of node ${node.number}${node.name ? ` ${node.name}` : ""} on ${node.bus_name}` : "No node with known objects";
    if (!node) return table.set([]);
    const name = node.j1939 ? { j1939: node.node } : { canopen: node.node };
    const frame = core.cursor.frame;
    table.set(await core.client.call<ObjectState[]>({ do: "objects", frame, bus: node.bus, node: name }));
  }
  const safely = () => void show().catch((error) => app.fail(error));
  return {
    name: "objects",
    title: "Objects",
    element: h("div", { class: "pane" }, h("div", { class: "filterbar" }, title, picker), table.element),
    open: safely,
    moved: safely,
    focus: () => table.focus(),
  };
}

export function transfersPane(app: App): Pane {
  const list = new VirtualList<TransferRow>({
    label: "Transfers",
    columns: [
      { title: "No", name: "no", cell: (row) => String(row.frame) },
      { title: "Time", name: "time", cell: (row) => seconds(row.time) },
      { title: "ms", name: "ms", cell: (row) => (row.duration === null ? "" : row.duration.toFixed(1)) },
      { title: "Bus", name: "busname", cell: (row) => row.bus },
      { title: "Nodes", name: "who", cell: (row) => row.who },
      { title: "Kind", name: "kind", cell: (row) => row.kind },
      { title: "Content", name: "what", cell: (row) => row.text },
      { title: "Size", name: "size", cell: (row) => (row.size > 0 ? String(row.size) : "") },
      { title: "Outcome", name: "outcome", cell: (row) => row.outcome },
    ],
    fetch: async (from, count) => (await app.core.client.call<{ rows: TransferRow[] }>({ do: "transfers", from, count })).rows,
    rowClass: (row) => `tone-${row.tone}`,
    onSelect: (row) => app.goTo(row.frame, row.ordinal),
    onOpen: (row) => { app.goTo(row.frame, row.ordinal); app.show("detail"); },
  });
  const count = h("p", { class: "quiet" });
  let shown: unknown = null;
  return {
    name: "transfers",
    title: "Transfers",
    element: h("div", { class: "pane events" }, count, list.element),
    open() {
      const { overview } = app.core;
      const more = overview.more_transfers > 0 ? `; ${overview.more_transfers} further ones are only counted` : "";
      count.textContent = `${overview.transfers} transfers${more}`;
      if (shown !== overview) list.reset(overview.transfers);
      shown = overview;
    },
    moved() {},
    focus: () => list.focus(),
  };
}
