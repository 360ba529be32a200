// What the tests in a real browser share: the server, windows that tell of faults, pictures against references.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";

const AXE = readFileSync(new URL("../node_modules/axe-core/axe.min.js", import.meta.url), "utf8");
const REFERENCE = new URL("reference/", import.meta.url).pathname;
/** Blocks of pixels that are compared, and how far their means may be apart on average, of 255. Fonts differ. */
const BLOCKS = [48, 30];
const TOLERANCE = 8;
export const LONG = { timeout: 120_000 };

/** A server of `retina view`, a browser, and what went wrong in its windows. */
export async function started(retina, browserPath, out, paths) {
  mkdirSync(out, { recursive: true });
  const server = spawn(retina, ["view", ...paths, "--no-browser", "--json", "--state", join(out, "state")], { stdio: ["ignore", "pipe", "inherit"] });
  const address = await new Promise((resolve, reject) => {
    server.stdout.once("data", (line) => resolve(JSON.parse(line).address));
    server.once("exit", (code) => reject(new Error(`the server ended with ${code}`)));
  });
  const browser = await chromium.launch({ executablePath: browserPath, args: ["--no-sandbox"] });
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, acceptDownloads: true, colorScheme: "light" });
  return { server, address, browser, context, faults: [] };
}

export async function window_(context, faults, size) {
  const page = await context.newPage();
  if (size) await page.setViewportSize(size);
  page.setDefaultTimeout(30_000);
  page.on("console", (message) => message.type() === "error" && faults.push(`console: ${message.text()}`));
  page.on("pageerror", (error) => faults.push(`page: ${error.message}`));
  page.on("request", (request) => {
    const { hostname, protocol } = new URL(request.url());
    if (hostname !== "127.0.0.1" && !["data:", "blob:"].includes(protocol)) faults.push(`asks ${request.url()}`);
  });
  return page;
}

export const key = (page, name) => page.locator(`[data-key="${name}"]`);

export async function said(what, work) {
  const start = Date.now();
  const more = await work().catch((error) => {
    throw new Error(`not so: ${what}`, { cause: error });
  });
  console.log(`ok  ${what}${more ? `: ${more}` : ""} (${((Date.now() - start) / 1000).toFixed(1)} s)`);
}

/** Means of blocks of a picture, by a canvas of an empty page. */
async function blocks(context, png) {
  const page = await context.newPage();
  const means = await page.evaluate(
    async ([data, width, height]) => {
      const image = new Image();
      image.src = `data:image/png;base64,${data}`;
      await image.decode();
      const canvas = Object.assign(document.createElement("canvas"), { width, height });
      const c = canvas.getContext("2d");
      c.imageSmoothingQuality = "high";
      c.drawImage(image, 0, 0, width, height);
      return [...c.getImageData(0, 0, width, height).data];
    },
    [png.toString("base64"), ...BLOCKS],
  );
  await page.close();
  return means;
}

/** Whether a window looks as its reference; `write` makes the reference anew. */
export async function looksAsBefore(page, out, name, write) {
  const png = await page.screenshot({ path: join(out, `${name}.png`) });
  const now = await blocks(page.context(), png);
  const path = join(REFERENCE, `${name}.json`);
  if (write) {
    mkdirSync(REFERENCE, { recursive: true });
    writeFileSync(path, `${JSON.stringify(now)}\n`);
    return "written";
  }
  const then = JSON.parse(readFileSync(path, "utf8"));
  const apart = now.reduce((sum, value, k) => sum + Math.abs(value - then[k]), 0) / now.length;
  assert.ok(apart < TOLERANCE, `${name} looks different: ${apart.toFixed(1)} of 255 on average; see ${join(out, name)}.png`);
  return `${apart.toFixed(2)} of 255 from the reference`;
}

/** Texts whose contrast with what lies behind them is below 4.5 (WCAG 2.2, 1.4.3). */
export function weakTexts() {
  const parse = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
  const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  const weak = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim() !== "");
    if (!own || element.closest(":disabled, .unseen, .skip") || element.getClientRects().length === 0) continue;
    const style = getComputedStyle(element);
    const [a, b] = [light(parse(element instanceof SVGElement ? style.fill : style.color)), light(behind(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) weak.push(`${element.textContent.trim().slice(0, 30)}: ${ratio.toFixed(2)}`);
  }
  return weak;
}

export async function fits(page, what) {
  const wide = await page.evaluate(() => [document.documentElement.scrollWidth, window.innerWidth]);
  assert.ok(wide[0] <= wide[1], `${what} is ${wide[0]} px wide in a window of ${wide[1]}`);
}

/** Asks axe for what WCAG 2.2 AA forbids; by the debugger, since the page lets no foreign script in. */
export async function audited(page, what) {
  await page.evaluate(AXE);
  // The bar on top covers what is scrolled under it.
  await page.evaluate(() => window.scrollTo(0, 0));
  const found = await page.evaluate(async () => {
    const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"];
    const { violations, passes } = await axe.run(document, { runOnly: tags });
    return { rules: passes.length, broken: violations.flatMap(({ id, nodes }) => nodes.map(({ target, failureSummary }) => `${id}: ${target.join(" ")}: ${failureSummary}`)) };
  });
  assert.deepEqual(found.broken, [], `${what}: axe`);
  assert.ok(found.rules > 5, `${what}: axe looked at ${found.rules} rules only`);
}
