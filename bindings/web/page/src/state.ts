// State shared by all panes: the open captures, and the cursor in time.

import type { Client } from "./client";
import type { Clock } from "./clock";
import type { BusState, Finding, ListName, NodeProfile, Overview, SignalName } from "./protocol";

export type { RowPosition } from "./protocol";

export interface Cursor { frame: number; time: number | null }

export type PaneName =
  | "why" | "nodes" | "events" | "frames" | "detail" | "signals" | "transfers" | "objects" | "findings" | "bus";

export interface ChosenSignal extends SignalName { name: string; unit: string; from: string }

export interface Core {
  client: Client;
  overview: Overview;
  /** Names of the files next to the captures. */
  beside: string[];
  nodes: NodeProfile[];
  cursor: Cursor;
  ordinal: number;
  list: ListName;
  filter: string;
  total: number;
  state: BusState | null;
  node: { bus: number; node: number; j1939: boolean } | null;
  signals: ChosenSignal[];
  finding: number | null;
  clock: Clock;
  /** First frame of the selection; it ends at the cursor. */
  selection: number | null;
  /** Time of cursor B in the plot. */
  second: number | null;
}

export interface App {
  core: Core;
  goTo(frame: number, ordinal?: number): Promise<void>;
  goToTime(time: number): Promise<void>;
  /** Does something after the moves before it. */
  inTurn(action: () => Promise<void> | void): void;
  show(pane: PaneName): void;
  /** Gives the keyboard to the pane. */
  focus(): void;
  /** Draws everything again. */
  redraw(): void;
  saveReport(finding: number | null): void;
  setFilter(text: string): Promise<void>;
  setOnlyNews(onlyNews: boolean): Promise<void>;
  assign(profile: NodeProfile | null, node: { bus: string; node: number; j1939: boolean }): void;
  say(text: string): void;
  fail(error: unknown): void;
  /** Called by panes that change the shared state. */
  changed(): void;
}

export interface Pane {
  name: PaneName;
  title: string;
  element: HTMLElement;
  /** The pane was shown, or the open captures changed. */
  open(): void;
  /** The cursor moved; only called while the pane is shown. */
  moved(): void;
  key?(event: KeyboardEvent): boolean;
  focus(): void;
}

export function findingsOf(overview: Overview): Finding[] {
  return overview.findings.filter((one): one is Finding => one.kind === "finding");
}

/** Findings that count: neither suppressed nor part of another one. */
export function countingOf(overview: Overview): Finding[] {
  return findingsOf(overview).filter((one) => one.standing !== "suppressed" && one.standing !== "absorbed");
}

/** Seconds since the first frame of an absolute time of a finding. */
export function since(overview: Overview, time: number | null): number | null {
  if (time === null || overview.zero === null) return null;
  return time - Number(overview.zero);
}
