// The workbench in a real browser: the story of the paper's Fig. 10 by mouse, another by keyboard alone, narrow windows,
// contrasts, and that nothing is asked of another machine.
//
//     node tests/story.mjs RETINA CHROMIUM OUT [--write]
//
// RETINA is the command, OUT a folder for what is seen. `--write` makes the reference pictures anew.

import assert from "node:assert/strict";
import { readFileSync, rmSync } from "node:fs";
import { join } from "node:path";
import { audited, fits, key, LONG, looksAsBefore as looks, said, started, weakTexts, window_ as opened } from "./harness.mjs";

const [retina, browserPath, out, write] = process.argv.slice(2);
assert.ok(retina && browserPath && out, "usage: node tests/story.mjs RETINA CHROMIUM OUT [--write]");
rmSync(out, { recursive: true, force: true });
const { server, address, browser, context, faults } = await started(retina, browserPath, out, []);
const window_ = (size) => opened(context, faults, size);
const looksAsBefore = (page, name) => looks(page, out, name, write === "--write");

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

try {
  const page = await window_();
  await page.goto(address);
  await page.locator("button.primary").first().waitFor();
  await said("the start page", async () => {
    await audited(page, "the start page");
    return looksAsBefore(page, "start");
  });
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
  await said("contrasts and axe, light and dark", async () => {
    assert.deepEqual(await page.evaluate(weakTexts), []);
    await audited(page, "the workbench");
    await key(page, "theme").click();
    assert.deepEqual(await page.evaluate(weakTexts), []);
    await audited(page, "the workbench in the dark");
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
