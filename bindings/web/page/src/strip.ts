// The strip of time: load, findings and the cursor over the whole capture.

import { h, seconds } from "./dom";
import { countingOf, since, type App } from "./state";

export class Strip {
  private canvas = h("canvas", { "aria-hidden": "true" });
  readonly element: HTMLElement;

  constructor(private app: App) {
    this.element = h(
      "div",
      {
        class: "strip",
        role: "slider",
        tabindex: 0,
        "aria-label": "Time in the capture",
        "aria-valuemin": 0,
        onkeydown: (event: KeyboardEvent) => this.key(event),
        onclick: (event: MouseEvent) => {
          const box = this.canvas.getBoundingClientRect();
          this.app.goToTime(((event.clientX - box.left) / Math.max(1, box.width)) * this.duration());
        },
      },
      this.canvas,
    );
    new ResizeObserver(() => this.draw()).observe(this.element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  private duration(): number {
    return this.app.core?.overview.duration ?? 0;
  }

  private key(event: KeyboardEvent): void {
    const steps: Record<string, number> = { ArrowRight: 0.01, ArrowLeft: -0.01, PageDown: 0.1, PageUp: -0.1 };
    const step = steps[event.key];
    const time = event.key === "Home" ? 0 : event.key === "End" ? this.duration()
      : step === undefined ? undefined : (this.app.core.cursor.time ?? 0) + step * this.duration();
    if (time === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.app.goToTime(Math.min(this.duration(), Math.max(0, time)));
  }

  draw(): void {
    const core = this.app.core;
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!core || width === 0) return;
    const ratio = devicePixelRatio;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    const context = this.canvas.getContext("2d");
    if (!context) return;
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const colour = (name: string) => style.getPropertyValue(name).trim();
    const duration = Math.max(this.duration(), 1e-9);
    const place = (time: number) => (time / duration) * width;
    // Bars of several buses overlap: the highest load shows, as in the terminal UI.
    const loads = core.overview.buses.flatMap((bus) => (bus.load ? [bus.load] : []));
    const most = loads.flatMap((load) => load.bits.map((bits) => bits / load.step)).reduce((a, b) => Math.max(a, b), 1);
    context.fillStyle = colour("--line");
    for (const load of loads) {
      load.bits.forEach((bits, index) => {
        const left = place(load.start + index * load.step);
        const tall = (bits / load.step / most) * (height - 10);
        context.fillRect(left, height - tall, Math.max(1, place(load.step)), tall);
      });
    }
    for (const one of countingOf(core.overview)) {
      context.fillStyle = colour(`--${one.severity}`);
      for (const occurrence of one.occurrences) {
        const time = since(core.overview, occurrence.t);
        if (time !== null) context.fillRect(place(time) - 1, 0, 2, one.severity === "error" ? height : height / 2);
      }
    }
    const time = core.cursor.time;
    if (time !== null) {
      context.fillStyle = colour("--text");
      context.fillRect(place(time) - 1, 0, 2, height);
      context.beginPath();
      context.moveTo(place(time) - 5, 0);
      context.lineTo(place(time) + 5, 0);
      context.lineTo(place(time), 7);
      context.fill();
    }
    this.element.setAttribute("aria-valuemax", duration.toFixed(3));
    this.element.setAttribute("aria-valuenow", (time ?? 0).toFixed(3));
    this.element.setAttribute("aria-valuetext", `${seconds(time)} s of ${seconds(core.overview.duration)} s, frame ${core.cursor.frame}`);
  }
}
