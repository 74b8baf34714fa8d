// Measures the page in headless Chromium without GPU: node tests/speed.mjs cobscope.html [FRAMES]
//
//   - time to the empty screen, before the module is compiled
//   - time to decode and check 30 MB of candump text
//   - memory of the module for a compressed capture; refusal of one that does not fit
//   - frame times while 10 million rows are scrolled at 1280×800, and the memory of the module
//
// With LIMITS=1 a figure above its limit is a failure.

import { closeSync, mkdtempSync, openSync, readFileSync, rmSync, statSync, writeFileSync, writeSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { gzipSync } from "node:zlib";

import { choose, hasChromium, launch, open } from "./browser.mjs";

const [html, count = "10000000"] = process.argv.slice(2);
if (!html) {
  console.error("usage: node tests/speed.mjs cobscope.html [FRAMES]");
  process.exit(2);
}
if (!hasChromium()) {
  console.log("not run: speed of the page: Chromium is missing");
  process.exit(75);
}
const folder = mkdtempSync(join(tmpdir(), "cobscope-speed-"));
let failed = 0;

function figure(name, value, unit, limit) {
  const isAbove = value > limit;
  console.log(`${name}: ${value.toFixed(value < 10 ? 2 : 0)} ${unit} (limit ${limit} ${unit})${isAbove ? " ABOVE" : ""}`);
  failed += isAbove && process.env.LIMITS ? 1 : 0;
}

/** A bus of five nodes: SYNC, heartbeats and PDOs whose values change, 2,000 frames per second. */
function write(path, frames) {
  const file = openSync(path, "w");
  const hex = (value, width) => (value >>> 0).toString(16).toUpperCase().padStart(width, "0");
  const ids = ["181", "182", "183", "201", "202", "203", "281", "282"];
  let part = [];
  for (let n = 0; n < frames; n += 1) {
    const time = `${1_700_000_000 + Math.floor(n / 2000)}.${String((n % 2000) * 500).padStart(6, "0")}`;
    const place = n % 100;
    const frame = place === 0 ? "080#" : place === 10 || place === 60 ? `70${1 + (n % 5)}#05`
      : `${ids[n % 8]}#${hex((n * 7) & 0xffff, 4)}${hex(Math.floor(n / 100) & 0xffff, 4)}${hex(Math.floor(n / 1000), 8)}`;
    part.push(`(${time}) can0 ${frame}\n`);
    if (part.length === 100_000) {
      writeSync(file, part.join(""));
      part = [];
    }
  }
  writeSync(file, part.join(""));
  closeSync(file);
  return statSync(path).size;
}

/** 95th percentile of the times between frames of the browser while `act` runs. */
async function frameTimes(page, act) {
  await page.evaluate(() => {
    window.times = [];
    let last = performance.now();
    const tick = (now) => { window.times.push(now - last); last = now; window.ticking = requestAnimationFrame(tick); };
    window.ticking = requestAnimationFrame(tick);
  });
  await act();
  const times = await page.evaluate(() => { cancelAnimationFrame(window.ticking); return window.times; });
  times.sort((a, b) => a - b);
  return times[Math.floor(times.length * 0.95)];
}

/** Memory of the module in MB, as the Bus pane shows it. */
async function memory(page) {
  await page.keyboard.press("9");
  const text = await page.evaluate(() => [...document.querySelectorAll(".bus dt")].find((term) => term.textContent === "Memory used")?.nextElementSibling.textContent ?? "");
  const [amount, unit] = text.split(" ");
  return Number(amount) * ({ KB: 1 / 1024, MB: 1, GB: 1024 }[unit] ?? NaN);
}

const browser = await launch();
try {
  const painted = [];
  for (let n = 0; n < 5; n += 1) {
    const { context, page } = await open(browser, html);
    await page.waitForFunction(() => performance.getEntriesByName("first-contentful-paint").length > 0);
    painted.push(await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0].startTime));
    await context.close();
  }
  figure("empty screen, median of 5", painted.sort((a, b) => a - b)[2], "ms", 100);

  const small = join(folder, "small.log");
  const size = write(small, 690_000);
  const second = await open(browser, html);
  const start = Date.now();
  if ((await choose(second.page, small)) !== true) throw new Error("small.log does not open");
  figure(`${(size / 1e6).toFixed(1)} MB decoded and checked`, (Date.now() - start) / 1000, "s", 3);
  await second.context.close();
  rmSync(small);

  const medium = join(folder, "medium.log");
  const unpacked = write(medium, 4_000_000) / (1 << 20);
  writeFileSync(`${medium}.gz`, gzipSync(readFileSync(medium), { level: 1 }));
  const third = await open(browser, html);
  if ((await choose(third.page, `${medium}.gz`)) !== true) throw new Error("medium.log.gz does not open");
  figure(`memory of the module, ${unpacked.toFixed(0)} MB compressed`, await memory(third.page), "MB", Math.round(1.5 * unpacked + 200));
  // Frames without end, in some MB: members of gzip one after another.
  const member = gzipSync(Buffer.from("(1700000000.000000) can0 123#0011223344556677\n".repeat(2_000_000)), { level: 1 });
  writeFileSync(`${medium}.gz`, Buffer.concat(Array.from({ length: 30 }, () => member)));
  const refusal = String(await choose(third.page, `${medium}.gz`));
  if (!refusal.includes("max 2048 MB in a browser")) throw new Error(`a bomb of frames: ${refusal}`);
  console.log(`${(30 * member.length / 1e6).toFixed(0)} MB that contain 2.8 GB: ${refusal}`);
  await third.context.close();
  rmSync(medium);
  rmSync(`${medium}.gz`);

  const big = join(folder, "big.log");
  const bytes = write(big, Number(count));
  const { page, context, problems } = await open(browser, html);
  const begun = Date.now();
  if ((await choose(page, big, 900_000)) !== true) throw new Error("big.log does not open");
  console.log(`${(bytes / 1e6).toFixed(0)} MB, ${count} frames opened in ${((Date.now() - begun) / 1000).toFixed(1)} s`);
  await page.keyboard.press("2");
  await page.waitForSelector(".row:not(.waiting)");
  const scroller = page.locator(".scroller");
  const box = await scroller.boundingBox();
  await page.mouse.move(box.x + 300, box.y + 200);
  const wheel = await frameTimes(page, async () => {
    for (let n = 0; n < 150; n += 1) {
      await page.mouse.wheel(0, 240);
      await page.waitForTimeout(16);
    }
  });
  figure("frame time by wheel, 95th percentile", wheel, "ms", 33);
  const jumps = await frameTimes(page, async () => {
    for (let n = 1; n <= 40; n += 1) {
      await scroller.evaluate((element, part) => { element.scrollTop = (element.scrollHeight - element.clientHeight) * part; }, n / 40);
      await page.waitForTimeout(60);
    }
  });
  figure("frame time by scroll bar, 95th percentile", jumps, "ms", 33);
  const jump = Date.now();
  await scroller.evaluate((element) => { element.scrollTop = element.scrollHeight * 0.37; });
  await page.waitForFunction(() => document.querySelectorAll(".row:not(.waiting):not([hidden])").length > 10 && !document.querySelector(".row.waiting:not([hidden])"));
  console.log(`rows after a jump of the scroll bar: ${Date.now() - jump} ms`);
  const last = await page.evaluate(() => new Promise((resolve) => { const list = document.querySelector(".scroller"); list.focus(); resolve(list.getAttribute("aria-rowcount")); }));
  await page.keyboard.press("End");
  await page.waitForSelector(`.row[aria-rowindex="${last}"]:not(.waiting)`);
  console.log(`${last} rows; the last one is reached`);
  figure("memory of the module", await memory(page), "MB", 400);
  if (problems.length > 0) throw new Error(problems.join("\n"));
  await context.close();
} finally {
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
process.exit(failed > 0 ? 1 : 0);
