// Texts of the library with their frames as links: `{104}`.

import { h } from "./dom";
import type { App } from "./state";

export function frameButton(app: App, frame: number): HTMLElement {
  return h(
    "button",
    { class: "frame", type: "button", title: `Go to frame ${frame}`, onclick: () => { app.goTo(frame); app.show("events"); } },
    `{${frame}}`,
  );
}

export function linked(app: App, text: string): (Node | string)[] {
  const parts: (Node | string)[] = [];
  let last = 0;
  for (const match of text.matchAll(/\{(\d{1,15})\}/g)) {
    parts.push(text.slice(last, match.index));
    parts.push(frameButton(app, Number(match[1])));
    last = match.index + match[0].length;
  }
  parts.push(text.slice(last));
  return parts;
}
