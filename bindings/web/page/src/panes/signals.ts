// Signals with their values at the cursor, and a plot with findings as marks.

import uPlot from "uplot";

import { fill, h, seconds } from "../dom";
import type { Curve, SignalState } from "../protocol";
import { countingOf, since, type App, type ChosenSignal, type Pane } from "../state";
import { Table } from "../table";

/** Signals plotted together at most. */
const MOST = 12;

/** Dashes distinguish curves without colours. */
const DASHES = [[], [8, 4], [2, 3], [8, 3, 2, 3], [12, 4], [4, 4]];

function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim() || "#888";
}

function same(one: { bus: number; id: string; field: number }, other: { bus: number; id: string; field: number }): boolean {
  return one.bus === other.bus && one.id === other.id && one.field === other.field;
}

/** Curves on a common axis of times; between samples a value holds. */
function aligned(curves: Curve[]): (number | null)[][] {
  const times = [...new Set(curves.flatMap((curve) => curve.times))].sort((a, b) => a - b);
  const columns = curves.map((curve) => {
    let place = 0;
    let last: number | null = null;
    return times.map((time) => {
      while (place < curve.times.length && curve.times[place]! <= time) {
        last = curve.last[place] ?? null;
        place += 1;
      }
      return place === 0 ? null : last;
    });
  });
  return [times, ...columns];
}

export function signalsPane(app: App): Pane & { replot(): void } {
  let plot: uPlot | null = null;
  let curves: Curve[] = [];
  const box = h("div", { class: "plot", role: "img", "aria-label": "Plot of the chosen signals" });
  const status = h("p", { class: "quiet", role: "status" }, "Choose signals to plot them.");
  const legend = h("ul", { class: "legend" });
  const search = h("input", { type: "search", "aria-label": "Search signals", placeholder: "Search signals", oninput: () => list() });
  const table = new Table<SignalState>({
    label: "Signals at the cursor",
    empty: "No signal before the cursor; signals need a profile, EDS or DBC",
    columns: [
      { title: "Plot", cell: (one) => h("input", { type: "checkbox", "aria-label": `Plot ${one.name}`, checked: app.core.signals.some((it) => same(it, one)), onchange: () => toggle(one) }) },
      { title: "Node", cell: (one) => one.node, order: (one) => one.node ?? "" },
      { title: "From", cell: (one) => one.from, order: (one) => one.from },
      { title: "Signal", name: "text", cell: (one) => one.name, order: (one) => one.name },
      { title: "Value", name: "text", cell: (one) => one.value },
    ],
  });

  function list(): void {
    const wanted = search.value.toLowerCase();
    const all = app.core.state?.signals ?? [];
    table.set(wanted ? all.filter((one) => `${one.node} ${one.from} ${one.name}`.toLowerCase().includes(wanted)) : all);
  }

  function toggle(one: SignalState): void {
    const { core } = app;
    const known = core.signals.findIndex((it) => same(it, one));
    if (known >= 0) core.signals.splice(known, 1);
    else if (core.signals.length < MOST) core.signals.push({ bus: one.bus, id: one.id, field: one.field, frame: core.state?.frame ?? 0, name: one.name, unit: one.unit, from: one.from } as ChosenSignal);
    else return app.say(`max ${MOST} signals`);
    void sample().catch((error) => app.fail(error));
  }

  async function sample(): Promise<void> {
    const { core } = app;
    const { client } = core;
    if (core.signals.length === 0) {
      curves = [];
      draw();
      return;
    }
    const signals = core.signals.map(({ bus, id, field, frame }) => ({ bus, id, field, frame }));
    const done = await client.job({ do: "plot", signals, from: null, to: null }, (value) => {
      status.textContent = `Sampling, ${Math.round((100 * (value.frames ?? 0)) / Math.max(1, value.size ?? 1))} %`;
    });
    if (done.phase !== "done" || client !== app.core.client) return;
    curves = await client.call<Curve[]>({ do: "curves" });
    draw();
  }

  function marks(chart: uPlot): void {
    const { ctx, bbox } = chart;
    const labels: number[] = [];
    const line = (time: number, name: string, dash: number[], label: string) => {
      const x = Math.round(chart.valToPos(time, "x", true));
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.save();
      ctx.strokeStyle = colour(name);
      ctx.fillStyle = colour(name);
      ctx.setLineDash(dash);
      ctx.lineWidth = 1.5 * devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.font = `bold ${11 * devicePixelRatio}px system-ui, sans-serif`;
      // Labels that would overlap are omitted; the line remains.
      if (labels.every((other) => Math.abs(other - x) > 14 * devicePixelRatio)) {
        labels.push(x);
        ctx.fillText(label, x + 3 * devicePixelRatio, bbox.top + 11 * devicePixelRatio);
      }
      ctx.restore();
    };
    const { overview, cursor } = app.core;
    if (cursor.time !== null) line(cursor.time, "--text", [], "A");
    if (app.core.second !== null) line(app.core.second, "--text", [2, 4], "B");
    // Errors first: their labels take precedence.
    const found = countingOf(overview).sort((one, other) => Number(other.severity === "error") - Number(one.severity === "error"));
    for (const one of found) {
      const time = since(overview, one.occurrences[0]?.t ?? null);
      if (time !== null && one.severity !== "note") line(time, `--${one.severity}`, [4, 4], one.severity === "error" ? "E" : "w");
    }
  }

  function draw(): void {
    plot?.destroy();
    plot = null;
    fill(legend, curves.map((curve, place) => h("li", {}, swatch(place), `${curve.name}${curve.unit ? `, ${curve.unit}` : ""}${curve.presumed ? " (presumed)" : ""}: ${range(curve)}`)));
    if (curves.length === 0) {
      box.hidden = true;
      status.textContent = "Choose signals to plot them.";
      return;
    }
    box.hidden = false;
    status.textContent = `${distance()}Click in the plot moves the cursor; drag zooms, double click shows all.`;
    box.setAttribute("aria-label", `Plot of ${curves.map((curve) => `${curve.name} ${range(curve)} ${curve.unit}`).join("; ")}`);
    const units = [...new Set(curves.map((curve) => curve.unit))];
    const axis = { stroke: colour("--text"), grid: { stroke: colour("--line"), width: 0.6 }, ticks: { stroke: colour("--line") } };
    const options: uPlot.Options = {
      width: Math.max(280, box.clientWidth),
      height: 260,
      legend: { show: false },
      cursor: { drag: { x: true, y: false } },
      scales: { x: { time: false } },
      axes: [
        { ...axis, label: "s", labelSize: 16 },
        ...units.slice(0, 2).map((unit, place) => ({ ...axis, scale: `y${unit}`, label: unit || undefined, labelSize: 16, side: place === 0 ? 3 : 1, grid: place === 0 ? axis.grid : { show: false } })),
      ],
      series: [
        {},
        ...curves.map((curve, place) => ({
          label: curve.name,
          scale: `y${curve.unit}`,
          stroke: colour(`--c${(place % 3) + 1}`),
          width: 1.8,
          dash: DASHES[place % DASHES.length],
          paths: uPlot.paths.stepped!({ align: 1 }),
          points: { show: false },
        })),
      ],
      hooks: { draw: [marks] },
    };
    plot = new uPlot(options, aligned(curves) as uPlot.AlignedData, box);
    plot.over.addEventListener("click", () => {
      const left = plot?.cursor.left;
      if (plot && left !== undefined && left >= 0) app.goToTime(plot.posToVal(left, "x"));
    });
  }

  /** Time from cursor B to the cursor. */
  function distance(): string {
    const { cursor, second } = app.core;
    return cursor.time === null || second === null ? "" : `A − B = ${seconds(cursor.time - second)} s. `;
  }

  function range(curve: Curve): string {
    const known = (values: (number | null)[]) => values.filter((one): one is number => one !== null);
    const low = known(curve.min).reduce((a, b) => Math.min(a, b), Infinity);
    const high = known(curve.max).reduce((a, b) => Math.max(a, b), -Infinity);
    return low <= high ? `${Number(low.toPrecision(6))} to ${Number(high.toPrecision(6))}` : "no value";
  }

  function swatch(place: number): Element {
    const space = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(space, "svg");
    svg.setAttribute("viewBox", "0 0 38 12");
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS(space, "path");
    path.setAttribute("d", "M0 6H38");
    path.setAttribute("class", `curve c${(place % 3) + 1}`);
    path.setAttribute("stroke-dasharray", (DASHES[place % DASHES.length] ?? []).join(" "));
    svg.append(path);
    return svg;
  }

  new ResizeObserver(() => {
    if (plot && box.clientWidth > 0 && Math.abs(plot.width - box.clientWidth) > 2) plot.setSize({ width: Math.max(280, box.clientWidth), height: 260 });
  }).observe(box);

  const element = h("div", { class: "pane signals" }, box, legend, h("div", { class: "filterbar" }, search, status), table.element);
  return {
    name: "signals",
    title: "Signals",
    element,
    open() {
      list();
      draw();
    },
    moved() {
      list();
      plot?.redraw(false);
      if (plot && app.core.second !== null) status.textContent = distance();
    },
    key(event) {
      if (event.key === "/" || event.key === "F7") {
        event.preventDefault();
        search.focus();
        return true;
      }
      const chart = plot;
      if (chart && (event.key === "+" || event.key === "-")) {
        const { min, max } = chart.scales["x"]!;
        if (min == null || max == null) return false;
        const middle = app.core.cursor.time ?? (min + max) / 2;
        const factor = event.key === "+" ? 0.5 : 2;
        chart.setScale("x", { min: middle - (middle - min) * factor, max: middle + (max - middle) * factor });
        return true;
      }
      return false;
    },
    replot() {
      curves = [];
      void sample().catch((error) => app.fail(error));
    },
    focus: () => table.focus(),
  };
}
