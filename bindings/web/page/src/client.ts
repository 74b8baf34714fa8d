// The worker as seen by the page: requests as promises.

import type { FromWorker, Progress, Request, ToWorker } from "./protocol";

/** Error that the user reads. */
export class PageError extends Error {}

interface Waiting {
  resolve(value: any): void;
  reject(error: Error): void;
  progress?(value: Progress, bytes?: Uint8Array<ArrayBuffer>): void;
}

function text(id: string): string {
  return document.getElementById(id)?.textContent ?? "";
}

/** A worker with its module; replaced as a whole when other captures are opened. */
export class Client {
  private worker: Worker;
  private waiting = new Map<number, Waiting>();
  private last = 0;
  /** Memory of the module in bytes, after the last response. */
  memory = 0;
  private address: string;

  constructor(public onFatal: (error: string) => void) {
    this.address = URL.createObjectURL(new Blob([text("worker-source")], { type: "text/javascript" }));
    this.worker = new Worker(this.address);
    this.worker.onmessage = (event: MessageEvent<FromWorker>) => this.receive(event.data);
    this.worker.onerror = (event) => this.fatal(event.message || "the worker failed");
    this.send({ kind: "module", text: text("module").trim() });
  }

  private send(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  private fatal(error: string): void {
    for (const one of this.waiting.values()) one.reject(new PageError(error));
    this.waiting.clear();
    this.onFatal(error);
  }

  private receive(message: FromWorker): void {
    if (message.kind === "fatal") return this.fatal(message.error);
    const one = this.waiting.get(message.id);
    if (!one) return;
    if (message.kind === "progress") return one.progress?.(message.value, message.bytes);
    this.waiting.delete(message.id);
    if (message.kind === "result") this.memory = message.memory;
    if (message.kind === "error") one.reject(new PageError(message.error));
    else {
      if (message.bytes) one.progress?.(message.value as Progress, message.bytes);
      one.resolve(message.bytes && !one.progress ? message.bytes : message.value);
    }
  }

  files(files: File[]): void {
    this.send({ kind: "files", files });
  }

  /** A request that is answered at once. */
  call<T>(request: Request): Promise<T> {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.send({ kind: "call", id, request });
    });
  }

  /** A request that is answered in steps; a later one replaces it. */
  job(request: Request, progress: (value: Progress, bytes?: Uint8Array<ArrayBuffer>) => void): Promise<Progress> {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject, progress });
      this.send({ kind: "job", id, request });
    });
  }

  end(): void {
    this.worker.terminate();
    URL.revokeObjectURL(this.address);
    this.waiting.clear();
  }
}
