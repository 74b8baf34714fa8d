// Builds the page as one file: node build.mjs MODULE.wasm cobscope.html
//
// Two bundles by Vite (page and worker), the module packed with deflate, and a Content-Security-Policy with the
// hashes of the only script and style. The worker and the module are data blocks: nothing executes them in place.

import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { constants, deflateRawSync } from "node:zlib";

import { build } from "vite";

const MOST_BYTES = 4 * 1024 * 1024;
const here = dirname(fileURLToPath(import.meta.url));
const [wasm, out] = process.argv.slice(2);
if (!wasm || !out) {
  console.error("usage: node build.mjs MODULE.wasm cobscope.html");
  process.exit(2);
}

async function bundle(entry) {
  const { output } = (
    await build({
      root: here,
      configFile: false,
      logLevel: "warn",
      build: {
        write: false,
        target: "es2022",
        cssMinify: true,
        lib: { entry: join(here, "src", entry), formats: ["iife"], name: "cobscope", cssFileName: "page" },
      },
    })
  )[0];
  const script = output.find((part) => part.type === "chunk")?.code ?? "";
  const style = output.find((part) => part.type === "asset" && part.fileName.endsWith(".css"))?.source ?? "";
  return { script: script.trim(), style: String(style).trim() };
}

const hash = (text) => `'sha256-${createHash("sha256").update(text).digest("base64")}'`;

function checked(name, text) {
  if (/<\/(script|style)/i.test(text)) throw new Error(`${name}: contains the end of its own element`);
  return text;
}

const [page, worker] = [await bundle("main.ts"), await bundle("worker.ts")];
const module = deflateRawSync(readFileSync(wasm), { level: 9, memLevel: 9, strategy: constants.Z_DEFAULT_STRATEGY });
const policy = [
  "default-src 'none'",
  `script-src ${hash(page.script)} 'wasm-unsafe-eval'`,
  `style-src ${hash(page.style)}`,
  "worker-src blob:",
  "base-uri 'none'",
  "form-action 'none'",
].join("; ");
const parts = {
  CSP: policy,
  STYLE: checked("style", page.style),
  SCRIPT: checked("script", page.script),
  WORKER: checked("worker", worker.script),
  MODULE: module.toString("base64"),
};
const template = readFileSync(join(here, "index.html"), "utf8");
const html = template.replace(/%(CSP|STYLE|SCRIPT|WORKER|MODULE)%/g, (_, name) => parts[name]);
writeFileSync(out, html);
const size = Buffer.byteLength(html);
const kilobytes = (count) => `${Math.round(count / 1024)} KB`;
console.log(`${out}: ${kilobytes(size)}; module ${kilobytes(readFileSync(wasm).length)}, packed ${kilobytes(module.length)}, script ${kilobytes(page.script.length)}`);
if (size > MOST_BYTES) {
  console.error(`${out}: ${size} bytes; max ${MOST_BYTES}`);
  process.exit(1);
}
