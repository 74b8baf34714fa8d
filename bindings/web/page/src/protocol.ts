// Messages between page and worker, and the responses of the module (bindings/web/src/session.rs).

export type ListName = "all" | "news" | "filter";

export type Request =
  | { do: "open"; captures: NamedFile[]; beside: NamedFile[]; nodes: NodeProfile[]; today: string }
  | { do: "step"; frames: number }
  | { do: "overview" }
  | { do: "rows"; list: ListName; from: number; count: number }
  | { do: "locate"; list: ListName; at: { spot: RowPosition } | { time: number } }
  | { do: "filter"; text: string; only_news: boolean }
  | { do: "complete"; text: string }
  | { do: "state"; frame: number }
  | { do: "objects"; frame: number; bus: number; node: NodeName }
  | { do: "event"; frame: number; ordinal: number }
  | { do: "transfers"; from: number; count: number }
  | { do: "plot"; signals: SignalName[]; from: number | null; to: number | null }
  | { do: "curves" }
  | { do: "report"; finding: number | null; page: string }
  | { do: "export"; format: string; list: ListName; frames: [number, number] | null }
  | { do: "error"; from: RowPosition; backward: boolean }
  | { do: "search"; text: string; list: ListName; from: RowPosition; backward: boolean }
  | { do: "bytes"; what: "report" | "cut" | "export" };

/** Position of an event. */
export interface RowPosition { frame: number; ordinal: number }
export interface NamedFile { file: number; name: string; size: number; node?: number }
export type NodeName = { canopen: number } | { j1939: number };
export interface NodeProfile { bus: string | null; node: NodeName; profile: string }
export interface SignalName { bus: number; id: string; field: number; frame: number }

/** A request of the page to the worker. */
export type ToWorker =
  | { kind: "module"; text: string }
  | { kind: "files"; files: File[] }
  | { kind: "call"; id: number; request: Request }
  | { kind: "job"; id: number; request: Request };

/** A message of the worker to the page. */
export type FromWorker =
  | { kind: "result"; id: number; memory: number; value: unknown; bytes?: Uint8Array<ArrayBuffer> }
  | { kind: "error"; id: number; error: string }
  | { kind: "progress"; id: number; value: Progress; bytes?: Uint8Array<ArrayBuffer> }
  | { kind: "fatal"; error: string };

export interface Progress {
  phase: string;
  what?: string;
  frames?: number;
  bytes?: number;
  size?: number;
  findings?: number;
  total?: number;
  cut?: number;
  place?: RowPosition | null;
  invalid?: { reason: string; start: number };
}

export type Severity = "error" | "warning" | "note";
export type Tone = "plain" | "quiet" | "good" | "caution" | "bad";

export interface StoryLine { label: string; text: string; seconds: number | null; frames: [number, number] | null }
export interface Story {
  story: number;
  severity: Severity;
  bus: string | null;
  node: number | null;
  title: string;
  cause_visible: boolean;
  seconds: number | null;
  frames: [number, number] | null;
  findings: number[];
  rules: string[];
  lines: StoryLine[];
}

export interface Occurrence { t: number | null; frames: [number, number] }
export interface Finding {
  kind: "finding";
  finding: number;
  rule: string;
  title: string;
  severity: Severity;
  standing: string;
  bus: string;
  node?: number;
  node_name?: string;
  about?: string;
  text: string;
  count: number;
  duration?: number;
  lasts?: boolean;
  next_step?: string;
  occurrences: Occurrence[];
  worst?: { text: string; t: number | null; frames: [number, number] };
  cause_finding?: number;
  cause?: string;
  manual?: string;
  downgraded?: string;
  suppressed?: string;
}

export interface LoadSteps { start: number; step: number; frames: number[]; bits: number[]; errors: number[] }
/** Parts of `cobscope stats -f json` (docs/stats.schema.json) that the page shows. */
export interface Period { min: number; mean: number; max: number; worst_from: number }
export interface IdFigures { id: string; remote: boolean; what: string; frames: number; period_ms: Period | null; silent_since: number | null }
export interface BusFigures {
  frames: number;
  bits: number;
  worst_second: { frames: number; bits: number };
  undecoded: number;
  malformed: number;
  ids: IdFigures[];
  sync: { count: number; counter_gaps: number; period_ms: Period | null };
  guard_requests: number;
}
export interface Suggestion { node: number; j1939: boolean; profile: string; title: string; because: string }
export interface BusFacts {
  bus: number;
  name: string;
  bit_rate: number | null;
  protocols: string[];
  doubt: string | null;
  load: LoadSteps | null;
  suggestions: Suggestion[];
}

export interface Overview {
  name: string;
  format: string;
  frames: number;
  duration: number | null;
  zero: string | null;
  start: string | null;
  failure: string | null;
  problems: string[];
  errors: number;
  warnings: number;
  notes: number;
  unreadable: number;
  lost: number;
  error_frames: number;
  limits: string[];
  events: number;
  news: number;
  transfers: number;
  more_transfers: number;
  kinds: [string, number][];
  why: { stories: Story[]; notes: StoryLine[]; fault: unknown } | null;
  findings: (Finding | { kind: string })[];
  statistics: { buses: BusFigures[] };
  buses: BusFacts[];
  profiles: string[];
}

export interface EventRow {
  row: number;
  frame: number;
  ordinal: number;
  time: number | null;
  bus: string;
  id: string | null;
  who: string;
  kind: string;
  what: string;
  unchanged: string;
  data: string;
  tone: Tone;
  mark: Severity | null;
  filter: string;
  line: string;
}

export interface NodeState {
  bus: number;
  bus_name: string;
  node: number;
  j1939: boolean;
  number: string;
  name: string | null;
  device: string | null;
  profile: string | null;
  assigned: string | null;
  nmt: string | null;
  presumed: boolean;
  lost: boolean;
  states: { text: string; tone: Tone }[];
  set_points: { name: string; value: string; effective: string }[];
  gates: { set_point: string; gate: string; status: string; detail: string; advice: string }[];
  alive: { text: string; tone: Tone } | null;
  errors: string[];
  boots: number;
  objects: number;
}

export interface FrameState {
  bus: string;
  id: string;
  remote: boolean;
  message: string;
  count: number;
  mean: number | null;
  jitter: number | null;
  age: number | null;
  data: string;
}

export interface SignalState {
  bus: number;
  bus_name: string;
  id: string;
  from: string;
  node: string | null;
  field: number;
  name: string;
  unit: string;
  value: string | null;
}

export interface BusState {
  frame: number;
  time: number | null;
  nodes: NodeState[];
  frames: FrameState[];
  signals: SignalState[];
}

export interface ObjectState {
  object: string;
  name: string | null;
  value: string | null;
  raw: string;
  origin: string;
  frame: number;
  time: number | null;
  persists: string | null;
  pending: string | null;
}

export interface TransferRow {
  frame: number;
  ordinal: number;
  time: number | null;
  bus: string;
  who: string;
  kind: string;
  text: string;
  duration: number | null;
  size: number;
  outcome: string;
  tone: Tone;
}

export interface Curve {
  name: string;
  unit: string;
  presumed: boolean;
  exact: boolean;
  times: number[];
  last: (number | null)[];
  min: (number | null)[];
  max: (number | null)[];
}

export interface EventDetail {
  event: Record<string, unknown>;
  time: number | null;
  id: string | null;
  meaning: string | null;
  filter: string | null;
  bytes: string[] | null;
}
