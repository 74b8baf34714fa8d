// The link to a position: `#t=12.5&pane=findings`. It contains no data of the capture.

export interface Link { time: number | null; frame: number | null; pane: string | null; filter: string }

export function formatLink(link: Link): string {
  const parts: string[] = [];
  if (link.time !== null) parts.push(`t=${Number(link.time.toFixed(6))}`);
  if (link.frame !== null && link.frame > 0) parts.push(`frame=${link.frame}`);
  if (link.pane) parts.push(`pane=${link.pane}`);
  if (link.filter) parts.push(`filter=${encodeURIComponent(link.filter)}`);
  return `#${parts.join("&")}`;
}

export function parseLink(hash: string, panes: string[]): Link {
  const values = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (name: string) => {
    const text = values.get(name);
    const value = text === null || text === "" ? NaN : Number(text);
    return Number.isFinite(value) && value >= 0 ? value : null;
  };
  const pane = values.get("pane");
  return {
    time: number("t"),
    frame: number("frame"),
    pane: pane !== null && panes.includes(pane) ? pane : null,
    filter: values.get("filter") ?? "",
  };
}
