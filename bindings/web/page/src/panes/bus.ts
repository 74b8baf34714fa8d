// Load and figures of each bus, quality of the capture.

import uPlot from "uplot";

import { bytes, fill, grouped, h } from "../dom";
import type { BusFacts, BusFigures, IdFigures, Period } from "../protocol";
import type { App, Pane } from "../state";
import { Table } from "../table";

function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim() || "#888";
}

/** Largest deviation of an interval from the mean. */
function jitter(period: Period | null): number | null {
  return period && Math.max(period.max - period.mean, period.mean - period.min);
}

export function busPane(app: App): Pane {
  const element = h("div", { class: "pane bus scroll", tabindex: 0, role: "region", "aria-label": "Bus" });
  let plots: uPlot[] = [];

  function load(bus: BusFacts, box: HTMLElement): void {
    const steps = bus.load;
    if (!steps || steps.frames.length === 0) return;
    const times = steps.frames.map((_, place) => steps.start + place * steps.step);
    const rate = bus.bit_rate;
    const load = steps.bits.map((bits) => (rate ? (100 * bits) / (rate * steps.step) : bits / steps.step));
    const errors = steps.errors;
    const axis = { stroke: colour("--text"), grid: { stroke: colour("--line"), width: 0.6 }, ticks: { stroke: colour("--line") } };
    const hasErrors = errors.some((count) => count > 0);
    plots.push(new uPlot(
      {
        width: Math.max(280, element.clientWidth - 40),
        height: 180,
        legend: { show: false },
        scales: { x: { time: false }, y: { range: (_, __, most) => [0, Math.max(1, most ?? 1)] } },
        axes: [{ ...axis, label: "s", labelSize: 16 }, { ...axis, label: rate ? "load %" : "bit/s", labelSize: 16, size: 70 }],
        series: [
          {},
          { stroke: colour("--c1"), fill: `${colour("--c1")}33`, width: 1.5, paths: uPlot.paths.stepped!({ align: 1 }), points: { show: false } },
          ...(hasErrors ? [{ stroke: colour("--error"), width: 2, paths: uPlot.paths.bars!({ size: [1, 6] }), points: { show: false } }] : []),
        ],
        hooks: {
          draw: [(chart: uPlot) => {
            const time = app.core.cursor.time;
            if (time === null) return;
            const x = Math.round(chart.valToPos(time, "x", true));
            chart.ctx.fillStyle = colour("--text");
            chart.ctx.fillRect(x, chart.bbox.top, Math.max(1, devicePixelRatio), chart.bbox.height);
          }],
        },
      },
      (hasErrors ? [times, load, errors] : [times, load]) as uPlot.AlignedData,
      box,
    ));
    const chart = plots[plots.length - 1];
    chart?.over.addEventListener("click", () => {
      const left = chart.cursor.left;
      if (left !== undefined && left >= 0) app.goToTime(chart.posToVal(left, "x"));
    });
  }

  function facts(bus: BusFacts, figures: BusFigures | undefined): HTMLElement {
    const box = h("div", { class: "plot", role: "img", "aria-label": `Load of ${bus.name} over time` });
    const pairs: [string, string][] = [
      ["Protocol", bus.protocols.join(", ") || "none confirmed"],
      ["Bit rate", bus.bit_rate ? `${grouped(bus.bit_rate)} bit/s` : "unknown; load in bit/s"],
    ];
    if (figures) {
      pairs.push(["Frames", `${grouped(figures.frames)}, worst second ${grouped(figures.worst_second.frames)}`]);
      const share = bus.bit_rate ? ` (${((100 * figures.worst_second.bits) / bus.bit_rate).toFixed(1)} %)` : "";
      pairs.push(["Worst second", `${grouped(figures.worst_second.bits)} bit${share}`]);
      pairs.push(["Master", `${grouped(figures.sync.count)} SYNC, ${grouped(figures.guard_requests)} guarding requests`]);
      pairs.push(["Not decoded", `${grouped(figures.undecoded)} frames without a known service, ${grouped(figures.malformed)} malformed`]);
    }
    if (bus.doubt) pairs.push(["Remark", bus.doubt]);
    const table = new Table<IdFigures>({
      label: `Identifiers of ${bus.name}`,
      empty: "No identifier",
      columns: [
        { title: "ID", name: "data", cell: (one) => `${one.id}${one.remote ? " R" : ""}`, order: (one) => one.id.padStart(10) },
        { title: "Frames", name: "number", cell: (one) => grouped(one.frames), order: (one) => one.frames },
        { title: "Mean ms", name: "number", cell: (one) => one.period_ms?.mean.toFixed(3) ?? "", order: (one) => one.period_ms?.mean ?? -1 },
        { title: "Jitter ms", name: "number", cell: (one) => jitter(one.period_ms)?.toFixed(3) ?? "", order: (one) => jitter(one.period_ms) ?? -1 },
        { title: "", cell: (one) => (one.silent_since !== null ? h("span", { class: "caution" }, "silent at the end") : "") },
      ],
    });
    table.set(figures?.ids ?? []);
    const section = h(
      "section",
      {},
      h("h2", {}, bus.name),
      h("dl", {}, pairs.flatMap(([name, text]) => [h("dt", {}, name), h("dd", {}, text)])),
      box,
      h("details", {}, h("summary", {}, `${figures?.ids.length ?? 0} identifiers`), table.element),
    );
    requestAnimationFrame(() => load(bus, box));
    return section;
  }

  return {
    name: "bus",
    title: "Bus",
    element,
    open() {
      const { overview } = app.core;
      plots.forEach((one) => one.destroy());
      plots = [];
      const quality: [string, string][] = [
        ["Format", overview.format],
        ["Error frames", grouped(overview.error_frames)],
        ["Lost by the recorder", grouped(overview.lost)],
        ["Unreadable", grouped(overview.unreadable)],
        ["Memory used", bytes(app.core.client.memory)],
      ];
      fill(
        element,
        overview.buses.map((bus, place) => facts(bus, overview.statistics.buses[place])),
        h("section", {}, h("h2", {}, "Capture"), h("dl", {}, quality.flatMap(([name, text]) => [h("dt", {}, name), h("dd", {}, text)])),
          overview.limits.length > 0 && h("ul", {}, overview.limits.map((text) => h("li", {}, text)))),
        h("section", {}, h("h2", {}, "Events by kind"), h("dl", {}, overview.kinds.flatMap(([kind, count]) => [h("dt", {}, kind), h("dd", {}, grouped(count))]))),
      );
    },
    moved() {
      plots.forEach((one) => one.redraw(false));
    },
    focus: () => element.focus({ preventScroll: true }),
  };
}
