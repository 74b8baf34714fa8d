// Chromium of the system, without network, on a page opened from disk.

import { existsSync } from "node:fs";
import { pathToFileURL } from "node:url";

import { chromium } from "playwright-core";

export const CHROMIUM = process.env.CHROMIUM ?? "/usr/bin/chromium";

export function hasChromium() {
  return existsSync(CHROMIUM);
}

export async function launch() {
  return chromium.launch({
    executablePath: CHROMIUM,
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
      "--disable-component-update", "--disable-sync", "--force-color-profile=srgb"],
  });
}

/** An open page; any request to another address, error or dialog is kept as a problem. */
export async function open(browser, file, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, offline: true, acceptDownloads: true, ...options });
  const page = await context.newPage();
  const problems = [];
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) problems.push(`console: ${message.text()}`); });
  page.on("pageerror", (error) => problems.push(`error: ${error.message}`));
  page.on("dialog", (dialog) => { problems.push(`dialog: ${dialog.message()}`); void dialog.dismiss(); });
  page.on("request", (request) => { if (!/^(file|blob|data):/.test(request.url())) problems.push(`request: ${request.url()}`); });
  await page.goto(pathToFileURL(file).href);
  return { context, page, problems };
}

/** Chooses files and waits for the result: true, or the error shown. */
export async function choose(page, files, timeout = 120_000) {
  await page.evaluate(() => document.getElementById("app").append(Object.assign(document.createElement("i"), { id: "before" })));
  await page.setInputFiles("#files", files);
  await page.waitForFunction(() => {
    const root = document.getElementById("app");
    return root && !document.getElementById("before") && (root.className.startsWith("open") || (root.className === "empty" && document.querySelector(".welcome .banner")));
  }, null, { timeout });
  return page.evaluate(() => document.querySelector(".welcome .banner")?.textContent ?? true);
}
