// The workbench in a real browser: the story of the paper's Fig. 10 by mouse, another by keyboard alone, narrow windows,
// contrasts, and that nothing is asked of another machine.
//
//     node tests/story.mjs RETINA CHROMIUM OUT [--write]
//
// RETINA is the command, OUT a folder for what is seen. `--write` makes the reference pictures anew.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";

const [retina, browserPath, out, write] = process.argv.slice(2);
assert.ok(retina && browserPath && out, "usage: node tests/story.mjs RETINA CHROMIUM OUT [--write]");
const REFERENCE = new URL("reference/", import.meta.url).pathname;
/** Blocks of pixels that are compared, and how far their means may be apart on average, of 255. Fonts differ. */
const BLOCKS = [48, 30];
const TOLERANCE = 8;
const LONG = { timeout: 120_000 };

rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
const server = spawn(retina, ["view", "--no-browser", "--json", "--state", join(out, "state")], { stdio: ["ignore", "pipe", "inherit"] });
const address = await new Promise((resolve, reject) => {
  server.stdout.once("data", (line) => resolve(JSON.parse(line).address));
  server.once("exit", (code) => reject(new Error(`the server ended with ${code}`)));
});
const browser = await chromium.launch({ executablePath: browserPath, args: ["--no-sandbox"] });
const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, acceptDownloads: true, colorScheme: "light" });
const faults = [];

async function window_(size) {
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

const key = (page, name) => page.locator(`[data-key="${name}"]`);
/** The held-out error that the page shows, by a test in the page. */
const shows = (page, test, than, options) =>
  page.waitForFunction(
    ([own, other]) => {
      const now = Number(document.querySelector("[data-heldout]")?.dataset.heldout ?? NaN);
      return { equal: now === other, less: now < other }[own];
    },
    [test, than],
    options ?? LONG,
  );
const heldOut = async (page) => Number(await page.locator("[data-heldout]").getAttribute("data-heldout"));
const rungs = (page) => page.locator(".ladder .rung").allTextContents();

async function said(what, work) {
  const start = Date.now();
  const more = await work().catch((error) => {
    throw new Error(`not so: ${what}`, { cause: error });
  });
  console.log(`ok  ${what}${more ? `: ${more}` : ""} (${((Date.now() - start) / 1000).toFixed(1)} s)`);
}

/** Means of blocks of a picture, by a canvas of an empty page. */
async function blocks(png) {
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

async function looksAsBefore(page, name) {
  const png = await page.screenshot({ path: join(out, `${name}.png`) });
  const now = await blocks(png);
  const path = join(REFERENCE, `${name}.json`);
  if (write === "--write") {
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
function weakTexts() {
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

async function fits(page, what) {
  const wide = await page.evaluate(() => [document.documentElement.scrollWidth, window.innerWidth]);
  assert.ok(wide[0] <= wide[1], `${what} is ${wide[0]} px wide in a window of ${wide[1]}`);
}

try {
  const page = await window_();
  await page.goto(address);
  await page.locator("button.primary").first().waitFor();
  await said("the start page", () => looksAsBefore(page, "start"));
  assert.ok(!page.url().includes("token"), "the token stays in the address");

  await said("Fig. 10 is opened: the bench makes its data", async () => {
    await page.locator(".cards button").first().click();
    await key(page, "add-flux_coma").waitFor(LONG);
    return looksAsBefore(page, "baseline");
  });
  const before = await heldOut(page);
  await said("the effect is added by a press", async () => {
    const start = Date.now();
    await key(page, "add-flux_coma").click();
    await shows(page, "less", 0.7 * before);
    const took = Date.now() - start;
    assert.deepEqual(await rungs(page), ["baseline", "+ flux_coma"]);
    await page.locator(".candidate").first().waitFor(LONG);
    return `held-out error ${before.toFixed(2)} to ${(await heldOut(page)).toFixed(2)} arcsec in ${took} ms; ${await looksAsBefore(page, "flux_coma")}`;
  });
  await said("undo, redo, blink", async () => {
    await key(page, "undo").click();
    await shows(page, "equal", before);
    await key(page, "redo").click();
    await shows(page, "less", before);
    await key(page, "blink").click();
    await page.waitForFunction(() => document.querySelector(".shown").textContent.endsWith("baseline"));
    await page.waitForFunction(() => document.querySelector(".shown").textContent.endsWith("flux_coma"));
    await key(page, "blink").click();
  });
  await said("a second window sees the same model", async () => {
    const other = await window_();
    await other.goto(page.url());
    await other.locator("[data-heldout]").waitFor(LONG);
    assert.equal(await heldOut(other), await heldOut(page));
    await key(other, "undo").click();
    await shows(page, "equal", before);
    await key(other, "redo").click();
    await shows(page, "less", before);
    await other.close();
  });
  await said("brushing in the field chooses rows in both plots; one exposure", async () => {
    const box = await page.locator('canvas[data-key="field"]').boundingBox();
    await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.2 * box.height);
    await page.mouse.down();
    await page.mouse.move(box.x + 0.55 * box.width, box.y + 0.5 * box.height, { steps: 4 });
    await page.mouse.up();
    await page.waitForFunction(() => /\d+ of \d+ rows/.test(document.querySelector(".selection").textContent));
    const chosen = await page.locator(".selection").innerText();
    await page.keyboard.press("Escape");
    const slider = page.locator('input[type="range"]');
    await slider.focus();
    await page.keyboard.press("ArrowRight");
    await page.waitForFunction(() => !document.querySelector("output").textContent.startsWith("all"));
    await page.keyboard.press("Home");
    return chosen.split("\n")[0];
  });
  await said("an own formula, its units checked as it is typed", async () => {
    await key(page, "formula-open").click();
    const text = (unit) => `name = "creep"\nunit = "arcsec"\ndx = "a * x * time_s"\ndy = "a * y * time_s"\n[parameters]\na = { start = 0.001, unit = "${unit}" }\n`;
    await key(page, "formula").fill(text("arcsec"));
    await page.waitForFunction(() => document.querySelector("#formula-said .bad"));
    assert.ok(await key(page, "formula-add").isDisabled());
    await key(page, "formula").fill(text("arcsec/s"));
    await page.waitForFunction(() => document.querySelector("#formula-said .good"));
    await key(page, "formula-add").click();
    await page.waitForFunction(() => document.querySelectorAll(".ladder .rung").length === 3, null, LONG);
    assert.deepEqual(await rungs(page), ["baseline", "+ flux_coma", "+ creep"]);
    await key(page, "remove-creep").click();
    await page.waitForFunction(() => document.querySelectorAll(".ladder .rung").length === 2, null, LONG);
  });
  await said("a formula is looked for", async () => {
    await key(page, "investigate").click();
    await page.waitForFunction(() => !document.querySelector('[data-key="investigate"]'), null, LONG);
    return (await page.locator(".next .verdict").innerText()).split("\n")[0];
  });
  await said("reports and commands are exported", async () => {
    for (const name of ["model.toml", "fit.html", "predictions.csv"]) {
      await key(page, "export").click();
      const [download] = await Promise.all([page.waitForEvent("download"), key(page, name).click()]);
      const text = readFileSync(await download.path(), "utf8");
      assert.ok(text.length > 200 && download.suggestedFilename() === name);
    }
    await key(page, "export").click();
    await key(page, "commands.txt").click();
    await page.locator(".commands").waitFor();
    assert.ok((await page.locator(".commands").innerText()).includes("retina fit"));
  });
  await said("contrasts, light and dark", async () => {
    assert.deepEqual(await page.evaluate(weakTexts), []);
    await key(page, "theme").click();
    assert.deepEqual(await page.evaluate(weakTexts), []);
    const dark = await looksAsBefore(page, "dark");
    await key(page, "theme").click();
    return dark;
  });
  await said("windows of 400 and 2560 px", async () => {
    for (const width of [400, 2560]) {
      await page.setViewportSize({ width, height: 900 });
      await page.waitForTimeout(400);
      await fits(page, `the session at ${width} px`);
      await page.screenshot({ path: join(out, `${width}.png`), fullPage: true });
    }
  });
  await page.close();

  await said("a wandering mount by keyboard alone, to the measurement that decides", async () => {
    const keys = await window_({ width: 1280, height: 900 });
    await keys.goto(address);
    await keys.locator(".cards button").first().waitFor();
    /** Tab to the element, as one without a mouse does. */
    const reach = async (name) => {
      for (let k = 0; k < 150; k++) {
        await keys.keyboard.press("Tab");
        if (await keys.evaluate((own) => document.activeElement?.matches(own), name)) return;
      }
      assert.fail(`${name} is not reached by the Tab key`);
    };
    await reach(".cards > :nth-child(2) button");
    await keys.keyboard.press("Enter");
    await key(keys, "measure").waitFor(LONG);
    const first = await keys.locator(".tables li").count();
    await reach('[data-key="measure"]');
    await keys.keyboard.press("Enter");
    await keys.waitForFunction((count) => document.querySelectorAll(".tables li").length > count, first, LONG);
    // The bench's work ends with a new list of candidates, with drift among the first.
    await keys.waitForFunction(
      () => !document.querySelector(".job") && document.querySelector('.maybe > div > .candidates [data-key="add-drift"]'),
      null,
      LONG,
    );
    const start = await heldOut(keys);
    await reach('[data-key="add-drift"]');
    await keys.keyboard.press("Enter");
    await shows(keys, "less", 0.5 * start);
    const end = await heldOut(keys);
    await keys.keyboard.press("Control+z");
    await shows(keys, "equal", start);
    await keys.close();
    return `${start.toFixed(2)} to ${end.toFixed(2)} arcsec`;
  });
  await said("a wrong token is refused", async () => {
    const other = await browser.newContext();
    const stranger = await other.newPage();
    const answer = await stranger.goto(address.replace(/token=.*/, "token=0"));
    assert.equal(answer.status(), 403);
    assert.equal((await stranger.goto(new URL("/api/start", address).href)).status(), 403);
    await other.close();
  });
  assert.deepEqual(faults, []);
  console.log("ok  no console errors, and no request left this machine");
} finally {
  await browser.close();
  server.kill();
}
