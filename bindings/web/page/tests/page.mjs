// Tests of the page in Chromium, opened from disk without network:
//
//   node tests/page.mjs cobscope.html PROGRAM [full] [NAME…]
//
// PROGRAM is `cobscope`, whose output the page must show. Without `full` only some captures are compared.

import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

import { choose, hasChromium, launch, open } from "./browser.mjs";

const [html, program, ...rest] = process.argv.slice(2);
if (!html || !program) {
  console.error("usage: node tests/page.mjs cobscope.html PROGRAM [full] [NAME...]");
  process.exit(2);
}
if (!hasChromium()) {
  console.log("not run: tests of the page: Chromium is missing");
  process.exit(75);
}
const isFull = rest.includes("full");
const wanted = rest.filter((word) => word !== "full");
const repository = resolve(dirname(fileURLToPath(import.meta.url)), "../../../..");
const corpus = process.env.COBSCOPE_CORPUS ?? resolve(repository, "../shared/corpus");
const folder = mkdtempSync(join(tmpdir(), "cobscope-page-"));
const fixture = (name) => join(repository, "fixtures", name);
const pve = fixture("devices/pve.log");

/** Lines of events compared per capture. */
const COMPARED = 200;

function assert(condition, text) {
  if (!condition) throw new Error(text);
}

function equal(found, expected, what) {
  const [one, other] = [JSON.stringify(found), JSON.stringify(expected)];
  assert(one === other, `${what}\n    found    ${one?.slice(0, 800)}\n    expected ${other?.slice(0, 800)}`);
}

function run(...words) {
  const { stdout, stderr, status } = spawnSync(program, words, { encoding: "utf8", maxBuffer: 1 << 30 });
  return { stdout, stderr, status };
}

const tests = [];
const test = (name, body) => tests.push({ name, body });

function captures(start, found = []) {
  for (const name of readdirSync(start).sort()) {
    const path = join(start, name);
    if (statSync(path).isDirectory()) captures(path, found);
    else if (/\.(log|asc|trc|blf|mf4|pcap|pcapng|crtd|csv|mcap|gz)$/i.test(name)) found.push(path);
  }
  return found;
}

function exists(path) {
  try {
    return statSync(path).isDirectory();
  } catch {
    return false;
  }
}

/** Rows of the page's table of findings: severity, times, count and text without the next step. */
async function shownFindings(page) {
  await page.keyboard.press("8");
  return page.evaluate(() =>
    [...document.querySelectorAll("table[aria-label=Findings] tbody tr[tabindex]")].map((row) => {
      const cells = [...row.children];
      return { count: cells[3].textContent, text: cells[5].firstElementChild.textContent, rule: cells[6].textContent };
    }),
  );
}

async function saved(page, action) {
  const [download] = await Promise.all([page.waitForEvent("download"), action()]);
  const path = join(folder, download.suggestedFilename());
  await download.saveAs(path);
  return path;
}

const byText = (one, other) => (one.rule + one.text < other.rule + other.text ? -1 : 1);

async function compare(browser, path) {
  const { context, page, problems } = await open(browser, html);
  try {
    const opened = await choose(page, path);
    const decoded = run("decode", "-f", "jsonl", "--frames", path);
    if (opened !== true) {
      assert(decoded.status !== 0, `${path}: the page refuses it: ${opened}`);
      return;
    }
    const findings = run("check", "-f", "jsonl", path).stdout.split("\n").filter(Boolean).map((line) => JSON.parse(line));
    const expected = findings.filter((one) => one.kind === "finding");
    const plain = (text) => text.replace(/[\u0000-\u001f]/g, "");
    const shown = await shownFindings(page);
    const wantedRows = expected.map((one) => ({ count: String(one.count), text: plain(one.text), rule: one.rule }));
    equal(shown.sort(byText), wantedRows.sort(byText), `${path}: findings`);
    const file = await saved(page, () => page.selectOption("select[aria-label=Export]", "jsonl"));
    const own = readFileSync(file, "utf8").split("\n").slice(0, COMPARED);
    equal(own, decoded.stdout.split("\n").slice(0, COMPARED), `${path}: events`);
    equal(problems, [], `${path}: problems`);
  } catch (error) {
    const alert = await page.textContent(".alert, .welcome .banner", { timeout: 100 }).catch(() => "");
    throw new Error(`${path}: the page shows "${alert}"\n    ${error.message}`);
  } finally {
    await context.close();
  }
}

/** Captures of all formats; all of them with `full`. */
function compared() {
  const all = [...captures(fixture("")), ...(exists(corpus) ? captures(corpus) : [])];
  if (isFull) return all;
  const some = ["devices/", "machine/", "recorders/", "incidents/"].map((part) => fixture(part));
  return all.filter((path) => some.some((part) => path.startsWith(part))).slice(0, 25);
}

test("captures give findings and events of the program", async (browser) => {
  for (const path of compared()) await compare(browser, path);
});

test("four actions from the capture to the saved report", async (browser) => {
  const { context, page, problems } = await open(browser, html);
  // 1: the capture.
  equal(await choose(page, pve), true, "opened");
  const first = await page.textContent(".story h2");
  assert(first.includes("EMCY 8305 spool position error"), `first line: ${first}`);
  // 2: the evidence, in the event list.
  await page.click("text=Show evidence");
  await page.waitForSelector(".row.selected:has-text('8305')");
  // 3: back to the story.
  await page.keyboard.press("0");
  // 4: the report.
  const path = await saved(page, () => page.click(".story >> text=Save report"));
  const report = readFileSync(path, "utf8");
  assert(report.includes("EMCY 8305 spool position error") && report.includes("pve.log"), "content of the report");
  equal(problems, [], "problems");
  await context.close();
});

test("keyboard: find the fault, plot it, save the report", async (browser) => {
  const { context, page, problems } = await open(browser, html);
  equal(await choose(page, pve), true, "opened");
  await page.keyboard.press("2");
  // Keys that move wait for the moves before them.
  await page.keyboard.press("g");
  await page.keyboard.press("]");
  await page.waitForFunction(() => /#104\//.test(document.querySelector(".position").textContent));
  await page.keyboard.press("5");
  await page.keyboard.press("/");
  await page.keyboard.type("spool");
  await page.keyboard.press("Tab");
  await page.waitForSelector("table[aria-label='Signals at the cursor'] input");
  await page.focus("table[aria-label='Signals at the cursor'] input");
  await page.keyboard.press("Space");
  await page.waitForSelector(".plot canvas");
  await page.keyboard.press("8");
  await page.keyboard.press("Enter");
  const path = await saved(page, () => page.keyboard.press("R"));
  assert(readFileSync(path, "utf8").includes("<h1>"), "a report");
  equal(problems, [], "problems");
  await context.close();
});

test("keyboard: errors, marks, search, undo, selection, as in the terminal", async (browser) => {
  const { context, page, problems } = await open(browser, html);
  equal(await choose(page, pve), true, "opened");
  const press = async (...keys) => { for (const key of keys) await page.keyboard.press(key); };
  const at = (frame) => page.waitForFunction((wanted) => document.querySelector(".position").textContent.includes(`#${wanted}/`), frame);
  const events = run("decode", "-f", "jsonl", "--frames", pve).stdout.split("\n").filter(Boolean).map((line) => JSON.parse(line));
  const emergencies = events.filter((one) => one.kind === "emcy").map((one) => one.frames[1]);
  const raised = events.find((one) => one.kind === "emcy" && one.action === "raised").frames[1];
  // The first error event after the start is the emergency, or an event before it.
  await press("2", "g", "e");
  await page.waitForFunction(() => !/#1\//.test(document.querySelector(".position").textContent));
  const first = Number((await page.textContent(".position")).match(/#(\d+)\//)[1]);
  assert(first <= raised, `first error in frame ${first}, emergency in ${raised}`);
  // A search in both directions, from a mark.
  await press("g", "m", "a", "/");
  await page.waitForSelector("#sought");
  await page.keyboard.type("EMCY");
  await press("Enter");
  await at(emergencies[0]);
  await press("n");
  await at(emergencies[1]);
  await press("N");
  await at(emergencies[0]);
  await press("'", "a");
  await at(1);
  // The filter of the selected event, and back.
  const all = await page.textContent(".count");
  const counted = (text) => page.waitForFunction((wanted) => document.querySelector(".count").textContent === wanted, text);
  await press("n", "=");
  await counted(`${emergencies.length} events`);
  await press("u");
  await counted(all);
  // The selected frames, as a capture.
  await press("g", "V", "n");
  await at(emergencies[0]);
  const file = await saved(page, () => page.selectOption("select[aria-label=Export]", "pcapng"));
  const frames = run("stats", "-f", "json", file).stdout;
  equal(JSON.parse(frames).buses.reduce((sum, bus) => sum + bus.frames, 0), emergencies[0], "selected frames");
  // Times in UTC need a date; this capture starts in 2023 or has none.
  await press("V", "t");
  await page.waitForFunction(() => /UTC|no wall-clock time/.test(document.body.textContent));
  equal(problems, [], "problems");
  await context.close();
});

test("a filter completes, selects and names its error", async (browser) => {
  const { context, page, problems } = await open(browser, html);
  equal(await choose(page, pve), true, "opened");
  await page.keyboard.press("f");
  await page.keyboard.type("kind == em");
  await page.waitForSelector("#words li");
  equal(await page.$$eval("#words li", (all) => all.map((one) => one.textContent)), ["emcy"], "words");
  await page.keyboard.press("Tab");
  await page.keyboard.press("Enter");
  const expected = run("decode", "-f", "jsonl", "--filter", "kind == emcy", pve).stdout.split("\n").filter(Boolean).length;
  await page.waitForFunction((count) => document.querySelector(".count").textContent.startsWith(`${count} event`), expected);
  const file = await saved(page, () => page.selectOption("select[aria-label=Export]", "jsonl"));
  equal(readFileSync(file, "utf8"), run("decode", "-f", "jsonl", "--filter", "kind == emcy", pve).stdout, "filtered export");
  await page.fill("#filter", "kind = emcy");
  await page.press("#filter", "Enter");
  await page.waitForSelector(".problem:not([hidden])");
  equal(problems, [], "problems");
  await context.close();
});

test("a link leads to the same place", async (browser) => {
  const { context, page } = await open(browser, html);
  equal(await choose(page, pve), true, "opened");
  await page.evaluate(() => { location.hash = "#t=7.5&pane=findings"; });
  await page.waitForSelector("#tab-findings[aria-selected=true]");
  await page.waitForFunction(() => /t 7\.5/.test(document.querySelector(".position").textContent));
  // Also if the page writes its own link before it has seen this one.
  await page.evaluate(() => {
    location.hash = "#t=1.5&pane=nodes";
    history.replaceState(null, "", "#t=7.5&pane=findings");
  });
  await page.waitForSelector("#tab-nodes[aria-selected=true]");
  await page.waitForFunction(() => /t 1\.5/.test(document.querySelector(".position").textContent));
  await context.close();
});

test("a bus file beside the capture names its nodes", async (browser) => {
  const bus = join(folder, "machine.toml");
  writeFileSync(bus, "[node.32]\nname = \"boom <b>valve</b>\"\n");
  const { context, page, problems } = await open(browser, html);
  equal(await choose(page, [pve, bus]), true, "opened");
  await page.keyboard.press("1");
  await page.waitForSelector("td:text-is('boom <b>valve</b>')");
  writeFileSync(bus, "nodes = 1\n");
  const error = await choose(page, [pve, bus]);
  assert(String(error).startsWith("machine.toml:1:1"), `error: ${error}`);
  equal(problems, [], "problems");
  await context.close();
});

test("pasted lines are read like a file", async (browser) => {
  const { context, page, problems } = await open(browser, html);
  const text = readFileSync(fixture("layouts/german-head.txt"), "utf8");
  await page.evaluate((lines) => {
    const clipboardData = new DataTransfer();
    clipboardData.setData("text/plain", lines);
    dispatchEvent(new ClipboardEvent("paste", { clipboardData }));
  }, text);
  await page.waitForFunction(() => document.getElementById("app").className.startsWith("open"));
  assert((await page.title()).includes("pasted.txt"), `title: ${await page.title()}`);
  equal(problems, [], "problems");
  await context.close();
});

test("hostile files leave an inert page", async (browser) => {
  const markup = "<img src=x onerror=alert(1)>";
  const name = `${markup.replace("/", "")}.log`;
  const hostile = join(folder, name);
  const frames = Array.from({ length: 200 }, (_, n) => `(1700000000.${String(n * 1000).padStart(6, "0")}) <b>x</b> 705#7F`);
  writeFileSync(hostile, frames.join("\n") + "\n");
  const { context, page, problems } = await open(browser, html);
  equal(await choose(page, hostile), true, "opened");
  for (const key of "0123456789") {
    await page.keyboard.press(key);
    await page.waitForTimeout(50);
    equal(await page.$$eval("img, b, script[src], iframe", (all) => all.length), 0, `markup in pane ${key}`);
  }
  assert((await page.textContent("h1")).includes("<img"), "the name is shown as text");
  // A gzip bomb of zeros, a pcap whose sizes lie, a file of nothing.
  const bomb = join(folder, "bomb.log.gz");
  writeFileSync(bomb, gzipSync(Buffer.alloc(64 << 20)));
  assert((await choose(page, bomb)) !== true, "the bomb is refused");
  const lying = Buffer.alloc(60, 0xff);
  lying.writeUInt32LE(0xa1b2c3d4, 0);
  lying.writeUInt16LE(2, 4);
  lying.writeUInt16LE(4, 6);
  lying.writeUInt32LE(227, 20);
  const pcap = join(folder, "lying.pcap");
  writeFileSync(pcap, lying);
  assert((await choose(page, pcap)) !== true, "the capture without frames is refused");
  const empty = join(folder, "empty.log");
  writeFileSync(empty, "");
  assert(/empty/.test(await choose(page, empty)), "an empty file is named");
  equal(problems, [], "problems");
  await context.close();
});

test("the policy blocks scripts, requests and storage is empty", async (browser) => {
  const { context, page } = await open(browser, html);
  equal(await choose(page, pve), true, "opened");
  const result = await page.evaluate(async () => {
    const script = document.createElement("script");
    script.textContent = "window.broken = true";
    document.body.append(script);
    const fetched = await fetch("https://example.com/").then(() => true, () => false);
    return { broken: window.broken === true, fetched, stored: localStorage.length + sessionStorage.length, cookies: document.cookie };
  });
  equal(result, { broken: false, fetched: false, stored: 0, cookies: "" }, "what the policy permits");
  await context.close();
});

test("opening can be cancelled", async (browser) => {
  const big = join(folder, "big.log");
  const line = (n) => `(${1_700_000_000 + Math.floor(n / 1000)}.${String((n % 1000) * 1000).padStart(6, "0")}) can0 ${(0x181 + (n % 8)).toString(16)}#${(n % 65536).toString(16).padStart(4, "0")}0011223344`;
  writeFileSync(big, Array.from({ length: 600_000 }, (_, n) => line(n)).join("\n") + "\n");
  const { context, page, problems } = await open(browser, html);
  await page.setInputFiles("#files", big);
  await page.click("text=Cancel");
  await page.waitForSelector(".empty");
  equal(await choose(page, pve), true, "another capture opens");
  equal(problems, [], "problems");
  await context.close();
});

test("accessibility: axe finds no violation", async (browser) => {
  const axe = readFileSync(resolve(repository, "bindings/web/page/node_modules/axe-core/axe.min.js"), "utf8");
  for (const colorScheme of ["light", "dark"]) {
    const { context, page } = await open(browser, html, { colorScheme });
    const check = async (where) => {
      // Playwright evaluates past the page's own policy.
      await page.evaluate(axe);
      const found = await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }));
      const problems = found.violations.map((one) => `${one.id}: ${one.nodes.slice(0, 2).map((node) => `${node.html.slice(0, 160)} ${node.failureSummary.slice(0, 200)}`).join(" | ")}`);
      equal(problems, [], `axe, ${colorScheme}, ${where}`);
    };
    await check("empty");
    equal(await choose(page, pve), true, "opened");
    for (const key of "0123456789") {
      await page.keyboard.press(key);
      await page.waitForTimeout(150);
      await check(`pane ${key}`);
    }
    await page.keyboard.press("?");
    await check("keys");
    await context.close();
  }
});

test("the page fits into 360 pixels", async (browser) => {
  const { context, page } = await open(browser, html, { viewport: { width: 360, height: 740 } });
  equal(await choose(page, pve), true, "opened");
  for (const key of "0123456789") {
    await page.keyboard.press(key);
    await page.waitForTimeout(50);
    const width = await page.evaluate(() => document.documentElement.scrollWidth);
    assert(width <= 360, `pane ${key}: ${width} pixels`);
  }
  await context.close();
});

const browser = await launch();
let failed = 0;
try {
  for (const { name, body } of tests) {
    if (wanted.length > 0 && !wanted.some((word) => name.includes(word))) continue;
    const start = Date.now();
    try {
      await body(browser);
      console.log(`ok     ${((Date.now() - start) / 1000).toFixed(1)} s  ${name}`);
    } catch (error) {
      failed += 1;
      console.log(`FAILED ${name}\n  ${error.stack ?? error}`);
    }
  }
} finally {
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
process.exit(failed > 0 ? 1 : 0);
