// Elements from texts: a text of a capture is only ever a text node, never markup.

type Child = Node | string | number | null | undefined | false;
type Properties = Record<string, string | number | boolean | ((event: any) => void) | undefined>;

/** An element; `on…` properties are listeners, `class` and `aria-…` are attributes. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: (Child | Child[])[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  append(element, children);
  return element;
}

export function append(element: Element, children: (Child | Child[])[]): void {
  for (const child of children.flat()) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : String(child));
  }
}

export function fill(element: Element, ...children: (Child | Child[])[]): void {
  element.replaceChildren();
  append(element, children);
}

/** Seconds since the first frame, truncated as in all outputs of cobscope: 0.9999 is 0.999. */
export function seconds(time: number | null | undefined, digits = 3): string {
  if (time === null || time === undefined) return "–";
  // A time is a whole number of ns; a float of seconds may be one digit below it.
  const parts = Math.floor(Math.round(Math.abs(time) * 1e9) / 10 ** (9 - digits));
  return `${time < 0 && parts > 0 ? "-" : ""}${(parts / 10 ** digits).toFixed(digits)}`;
}

/** `10,485,760`. */
export function grouped(count: number): string {
  return count.toLocaleString("en-US");
}

export function plural(count: number, word: string): string {
  return `${grouped(count)} ${word}${count === 1 ? "" : "s"}`;
}

export function bytes(size: number): string {
  if (size < 1024) return `${size} bytes`;
  const units = ["KB", "MB", "GB"];
  let value = size / 1024;
  let unit = 0;
  while (value >= 1024 && unit < 2) {
    value /= 1024;
    unit += 1;
  }
  return `${value.toFixed(value < 10 ? 1 : 0)} ${units[unit]}`;
}
