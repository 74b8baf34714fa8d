// The diagnosis: stories with cause, effects, steps and evidence.

import { fill, h, plural, seconds } from "../dom";
import { frameButton, linked } from "../links";
import type { Story } from "../protocol";
import type { App, Pane } from "../state";

const LABELS: Record<string, string> = {
  cause: "MOST LIKELY",
  "no-cause": "UNKNOWN",
  "first-effect": "FIRST EFFECT",
  effect: "then",
  act: "DO NOW",
  disproved: "NOT THE CAUSE",
  "not-judged": "NOT JUDGED",
  manual: "MANUAL",
  note: "NOTE",
};

export function whyPane(app: App): Pane {
  const element = h("div", { class: "pane why scroll", tabindex: 0, role: "region", "aria-label": "Why" });

  function story(one: Story): HTMLElement {
    const terms: HTMLElement[] = [];
    for (const line of one.lines) {
      // An effect that the capture shows before its cause has a negative delay.
      const isEarlier = line.label === "effect" && line.text.startsWith("-");
      const label = isEarlier ? "before" : LABELS[line.label];
      const frame = line.frames?.[1];
      const hasLink = frame !== undefined && !line.text.includes(`{${frame}}`);
      const text = h("dd", {}, linked(app, line.text), hasLink ? [" ", frameButton(app, frame)] : []);
      if (label === undefined && terms.length > 0) terms.push(text);
      else terms.push(h("dt", {}, label ?? ""), text);
    }
    const finding = one.findings[0] ?? null;
    const place = [one.bus, one.seconds === null ? null : `from ${seconds(one.seconds)} s`].filter(Boolean).join(", ");
    const evidence = one.frames;
    return h(
      "section",
      { class: "story", "aria-labelledby": `story-${one.story}` },
      h(
        "h2",
        { id: `story-${one.story}` },
        h("span", { class: `severity ${one.severity}` }, one.severity.toUpperCase()),
        " ",
        linked(app, one.title),
      ),
      h("p", { class: "quiet" }, place, one.rules.length > 0 ? `; rules ${[...new Set(one.rules)].join(", ")}` : ""),
      h("dl", {}, terms),
      h(
        "p",
        { class: "actions" },
        evidence && h("button", { type: "button", class: "primary", onclick: () => { app.goTo(evidence[1]); app.show("events"); } }, "Show evidence"),
        h("button", { type: "button", onclick: () => app.saveReport(finding) }, "Save report"),
      ),
    );
  }

  return {
    name: "why",
    title: "Why",
    element,
    open() {
      const { overview } = app.core;
      const stories = overview.why?.stories ?? [];
      const notes = overview.why?.notes ?? [];
      const suggestions = overview.buses.flatMap((bus) => bus.suggestions.map((one) => ({ bus, one })));
      fill(
        element,
        overview.failure && h("p", { class: "banner error", role: "alert" }, `INCOMPLETE ${overview.failure}`),
        overview.problems.map((text) => h("p", { class: "banner warning" }, text)),
        stories.length === 0 && h("h2", {}, overview.why?.fault ? "No finding; a fault that no rule judges" : "No finding"),
        stories.length === 0 && h("p", {}, `${plural(overview.frames, "frame")} read, all rules exercised that this traffic allows.`),
        stories.map(story),
        notes.length > 0 && h("section", {}, h("h2", {}, "Notes"), h("ul", {}, notes.map((note) => h("li", {}, linked(app, note.text))))),
        suggestions.length > 0 &&
          h(
            "section",
            {},
            h("h2", {}, "Profiles that fit"),
            h("p", { class: "quiet" }, "With its profile, a node's rules and signals come from the device manual."),
            h("ul", {}, suggestions.map(({ bus, one }) => h(
              "li",
              {},
              `${bus.name} node ${one.node}: ${one.title} (${one.profile}), ${one.because} `,
              h("button", { type: "button", onclick: () => app.assign(
                { bus: bus.name, node: one.j1939 ? { j1939: one.node } : { canopen: one.node }, profile: one.profile },
                { bus: bus.name, node: one.node, j1939: one.j1939 },
              ) }, "Use this profile"),
            ))),
          ),
        overview.limits.length > 0 &&
          h("section", {}, h("h2", {}, "Limits of this capture"), h("ul", {}, overview.limits.map((text) => h("li", {}, text)))),
      );
    },
    moved() {},
    focus() {
      element.focus({ preventScroll: true });
    },
  };
}
