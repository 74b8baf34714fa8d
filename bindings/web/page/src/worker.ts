// The worker: it owns the module and reads the user's files in slices. Nothing leaves it but messages to the page.


import type { FromWorker, Progress, Request, ToWorker } from "./protocol";

/** Only workers have it; TypeScript's types of pages do not contain it. */
declare class FileReaderSync {
  readAsArrayBuffer(blob: Blob): ArrayBuffer;
}

interface Exports {
  memory: WebAssembly.Memory;
  alloc(length: number): number;
  call(): number;
  response(): number;
  bytes(): number;
}

/** Frames per step: a step takes about 20 ms, so that a later request is noticed. */
const STEP = 16_384;

/** Bytes read from a file at once. */
const SLICE = 1 << 20;

const scope = self as unknown as {
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
};

let files: File[] = [];
let slice = { file: -1, start: 0, bytes: new Uint8Array(0) };
let exports: Promise<Exports> | undefined;
let job = 0;

const encoder = new TextEncoder();
const decoder = new TextDecoder();

/** Reads from a file into the memory of the module. */
function read(memory: WebAssembly.Memory, file: number, offset: number, room: number, length: number): number {
  const known = slice.file === file && offset >= slice.start && offset < slice.start + slice.bytes.length;
  if (!known) {
    const source = files[file];
    if (!source) return -1;
    if (offset >= source.size) return 0;
    try {
      const part = source.slice(offset, Math.min(source.size, offset + Math.max(length, SLICE)));
      slice = { file, start: offset, bytes: new Uint8Array(new FileReaderSync().readAsArrayBuffer(part)) };
    } catch {
      return -1;
    }
  }
  const from = offset - slice.start;
  const part = slice.bytes.subarray(from, Math.min(slice.bytes.length, from + length));
  new Uint8Array(memory.buffer, room, length).set(part);
  return part.length;
}

/** Unpacks and compiles the module. */
async function start(text: string): Promise<Exports> {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const bytes = await new Response(stream).arrayBuffer();
  const holder: { memory?: WebAssembly.Memory } = {};
  const imports = {
    page: {
      read: (file: number, offset: number, room: number, length: number) =>
        holder.memory ? read(holder.memory, file, offset, room, length) : -1,
    },
  };
  const { instance } = await WebAssembly.instantiate(bytes, imports);
  const found = instance.exports as unknown as Exports;
  holder.memory = found.memory;
  return found;
}

function call(module: Exports, request: Request): { value: any; bytes?: Uint8Array<ArrayBuffer> } {
  const text = encoder.encode(JSON.stringify(request));
  // Every call may grow the memory, which detaches its buffer: the address first, then the buffer.
  const room = module.alloc(text.length);
  new Uint8Array(module.memory.buffer, room, text.length).set(text);
  const length = module.call();
  const response = module.response();
  const value = JSON.parse(decoder.decode(new Uint8Array(module.memory.buffer, response, length)));
  if (request.do !== "bytes" || value?.error) return { value };
  const bytes = module.bytes();
  return { value, bytes: new Uint8Array(module.memory.buffer, bytes, value.length).slice() };
}

/** Lets waiting messages be handled. */
const turn = new MessageChannel();
let turned: (() => void) | undefined;
turn.port1.onmessage = () => turned?.();
function pause(): Promise<void> {
  return new Promise((resolve) => {
    turned = resolve;
    turn.port2.postMessage(0);
  });
}

function report(id: number, answer: { value: any; bytes?: Uint8Array<ArrayBuffer> }): boolean {
  if (answer.value?.error) {
    scope.postMessage({ kind: "error", id, error: String(answer.value.error) });
    return false;
  }
  return true;
}

/** A request whose work is done in steps, until it ends or another one replaces it. */
async function run(module: Exports, id: number, request: Request): Promise<void> {
  job = id;
  const begun = call(module, request);
  if (!report(id, begun)) return;
  if (begun.value?.invalid) {
    scope.postMessage({ kind: "result", id, memory: module.memory.buffer.byteLength, value: begun.value });
    return;
  }
  while (job === id) {
    const answer = call(module, { do: "step", frames: STEP });
    if (!report(id, answer)) return;
    const value = answer.value as Progress;
    const bytes = request.do === "export" ? call(module, { do: "bytes", what: "export" }).bytes : undefined;
    if (value.phase === "ready" || value.phase === "done" || value.phase === "idle") {
      scope.postMessage({ kind: "result", id, memory: module.memory.buffer.byteLength, value, bytes }, bytes ? [bytes.buffer] : []);
      return;
    }
    scope.postMessage({ kind: "progress", id, value, bytes }, bytes ? [bytes.buffer] : []);
    await pause();
  }
}

function fail(error: unknown): void {
  const text = error instanceof Error ? error.message : String(error);
  const memory = /unreachable|memory|allocation/i.test(text);
  const reason = memory
    ? "the capture does not fit into the memory of this browser, or the module failed"
    : text;
  scope.postMessage({ kind: "fatal", error: reason });
}

scope.onmessage = async ({ data }) => {
  try {
    switch (data.kind) {
      case "module":
        exports = start(data.text);
        await exports;
        return;
      case "files":
        files = data.files;
        slice = { file: -1, start: 0, bytes: new Uint8Array(0) };
        return;
      default: {
        if (!exports) throw new Error("the module was not sent");
        const module = await exports;
        if (data.kind === "job") return await run(module, data.id, data.request);
        const answer = call(module, data.request);
        if (report(data.id, answer)) {
          const { value, bytes } = answer;
          const memory = module.memory.buffer.byteLength;
          scope.postMessage({ kind: "result", id: data.id, memory, value, bytes }, bytes ? [bytes.buffer] : []);
        }
      }
    }
  } catch (error) {
    fail(error);
  }
};
