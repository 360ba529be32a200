// The panes beside the workbench in a real browser: sequences, results, a live scene, the bench, lens systems.
//
//     node tests/panes.mjs RETINA CHROMIUM OUT [--write]
//
// As story.mjs; the data are rendered and navigated here first.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { audited, fits, key, LONG, looksAsBefore as looks, said, started, weakTexts, window_ } from "./harness.mjs";

const [retina, browserPath, out, write] = process.argv.slice(2);
assert.ok(retina && browserPath && out, "usage: node tests/panes.mjs RETINA CHROMIUM OUT [--write]");
rmSync(out, { recursive: true, force: true });
const data = resolve(out, "data");
mkdirSync(data, { recursive: true });
const assets = new URL("../../../assets", import.meta.url).pathname;
const run = (...args) => execFileSync(retina, args, { stdio: ["ignore", "pipe", "pipe"] });

const scene = (more) => `schema = "retina.scene/1"
setup = "${assets}/setups/narrow-fov.toml"
trajectory = { kind = "lumio-halo", frames = 2000, step_s = 300.0 }
radiance_scale = 0.0177
${more}
[[body]]
name = "moon"
model = "${assets}/bodies/moon.glb"
photometry = { model = "lunar-lambert", normal_albedo = 0.12 }
[output]
layers = ["depth"]
`;
writeFileSync(join(data, "scene.toml"), scene(""));
writeFileSync(join(data, "direct.toml"), scene('[compensation]\nmode = "direct"'));
run("render", join(data, "scene.toml"), "--frames", "600..2000", "--every", "500", "--out", join(data, "none"));
run("render", join(data, "direct.toml"), "--frames", "600..2000", "--every", "500", "--out", join(data, "direct"));
run("navigate", "full-disk", join(data, "none"), "--out", join(data, "full-disk"));
run("navigate", "far-range", join(assets, "scenarios/far-range.toml"), "--poses", "60", "--out", join(data, "far-range"));

const { server, address, browser, context, faults } = await started(retina, browserPath, out, [data]);
const page = await window_(context, faults);
const looksAsBefore = (name) => looks(page, out, name, write === "--write");
const open = async (pane, at) => {
  await page.goto(new URL(`/#${pane}=${encodeURIComponent(at)}`, address).href);
  await page.locator("header h1").filter({ hasText: ":" }).first().waitFor();
};
const drawn = (name) => page.waitForFunction((own) => Number(document.querySelector(`[data-key="${own}"]`)?.dataset.shown ?? 0) > 0, name, LONG);
const sound = async (what) => {
  assert.deepEqual(await page.evaluate(weakTexts), [], `${what}: contrasts`);
  await audited(page, what);
  for (const width of [400, 2560, 1440]) {
    await page.setViewportSize({ width, height: 900 });
    await page.waitForTimeout(250);
    await fits(page, `${what} at ${width} px`);
    if (width !== 1440) await page.screenshot({ path: join(out, `${what}-${width}.png`), fullPage: true });
  }
};

try {
  await page.goto(address);
  await said("the start page lists what the folder holds", async () => {
    for (const name of ["sequence-0/none", "sequence-0/direct", "scene-0/scene.toml", "results-0/full-disk", "results-0/far-range", "bench-wide-fov", "optics-double-gauss"]) {
      await key(page, name).waitFor();
    }
    return looksAsBefore("panes");
  });
  await said("a sequence: frames, layers, values, a second run", async () => {
    await key(page, "sequence-0/none").click();
    await drawn("picture-0");
    await looksAsBefore("sequence");
    await page.keyboard.press("PageDown");
    await page.waitForFunction(() => document.querySelector(".player output").textContent === "frame 1100");
    await key(page, "picture-0").focus();
    await page.keyboard.press("ArrowRight");
    await page.waitForFunction(() => /digital count \d+/.test(document.querySelector(".readout").textContent));
    const count = Number((await page.locator(".readout").innerText()).match(/digital count (\d+)/)[1]);
    assert.ok(count > 20, `the Moon's middle has count ${count}`);
    await key(page, "layer").selectOption("depth");
    await page.waitForFunction(() => /depth \(m\) \d{8}/.test(document.querySelector(".readout").textContent), null, LONG);
    await key(page, "layer").selectOption("counts");
    await key(page, "other").selectOption("0/direct");
    await page.waitForFunction(() => /other run \d+/.test(document.querySelector(".readout").textContent), null, LONG);
    assert.equal(await page.locator(".stage canvas").count(), 2);
    await looksAsBefore("sequence-two");
    await key(page, "mode").selectOption("difference");
    await page.waitForTimeout(300);
    const difference = await looksAsBefore("sequence-difference");
    await sound("sequence");
    return difference;
  });
  await said("results of full-disk navigation: errors over time, and why", async () => {
    await open("results", "0/full-disk");
    await page.locator(".lines canvas").nth(2).waitFor();
    await drawn("picture");
    await key(page, "instant").focus();
    await page.keyboard.press("End");
    await page.waitForFunction(() => document.querySelector(".player output").textContent === "frame 1600");
    assert.ok(await page.locator(".verdict").isVisible());
    const seen = await looksAsBefore("results");
    await sound("results");
    await open("results", "0/far-range");
    await key(page, "list").waitFor();
    await looksAsBefore("results-far-range");
    return seen;
  });
  await said("a live scene: turned by hand, drafts and the full frame, the pose saved", async () => {
    await open("scene", "0/scene.toml");
    await page.waitForFunction(() => document.querySelector("canvas.picture")?.dataset.full === "true", null, LONG);
    await looksAsBefore("scene");
    const box = await key(page, "picture").boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    await page.mouse.move(x, y);
    await page.mouse.down();
    for (let k = 1; k <= 40; k++) {
      await page.mouse.move(x + 3 * k, y + k);
      await page.waitForTimeout(30);
    }
    const rate = /([\d.]+) a second/.exec(await key(page, "state").innerText())?.[1] ?? "?";
    await page.mouse.up();
    await page.waitForFunction(() => document.querySelector("canvas.picture").dataset.full === "true", null, LONG);
    await key(page, "law").selectOption("lambert");
    await page.waitForFunction(() => document.querySelector("canvas.picture").dataset.full === "true", null, LONG);
    const files = [];
    page.on("download", (download) => files.push(download));
    await key(page, "save").click();
    for (let k = 0; k < 200 && files.length < 2; k++) await page.waitForTimeout(100);
    assert.equal(files.length, 2, "two files are saved");
    for (const file of files) await file.saveAs(join(data, `saved-${file.suggestedFilename()}`));
    const saved = readFileSync(join(data, "saved-scene.toml"), "utf8").replace("pose.csv", "saved-pose.csv");
    writeFileSync(join(data, "saved-scene.toml"), saved);
    assert.ok(saved.includes("lambert"));
    run("render", join(data, "saved-scene.toml"), "--out", join(data, "saved"));
    const truth = JSON.parse(readFileSync(join(data, "saved/truth/000000.json"), "utf8"));
    const phase = Number(await key(page, "phase_deg-number").inputValue());
    assert.ok(Math.abs(truth.bodies.moon.phase_deg - phase) < 0.01, `${truth.bodies.moon.phase_deg} and ${phase}`);
    await sound("scene");
    return `${rate} drafts a second`;
  });
  await said("the bench: parts switched, a point's image", async () => {
    await open("bench", "wide-fov");
    const exposed = (count) => page.waitForFunction((own) => Number(document.querySelector("canvas.picture")?.dataset.exposed ?? 0) >= own, count, LONG);
    await exposed(1);
    await looksAsBefore("bench");
    await key(page, "mode").selectOption("screen");
    const box = await key(page, "picture").boundingBox();
    await page.mouse.click(box.x + 0.9 * box.width, box.y + 0.85 * box.height);
    await drawn("spot");
    const rms = async () => Number(/([\d.]+) px, [\d.]+ um/.exec(await page.locator(".beside").innerText())[1]);
    const full = await rms();
    await key(page, "points").selectOption("diffraction");
    await exposed(2);
    await page.waitForFunction((own) => Number(/([\d.]+) px, [\d.]+ um/.exec(document.querySelector(".beside").innerText)[1]) < own, full, LONG);
    const seen = await looksAsBefore("bench-spot");
    await sound("bench");
    return `${full} px with aberrations, ${await rms()} px by diffraction alone; ${seen}`;
  });
  await said("optics: a gap and a tilt by keyboard", async () => {
    await open("optics", "reference-1.3fc-wide");
    const traced = (count) => page.waitForFunction((own) => Number(document.querySelector(".drawings")?.dataset.traced ?? 0) >= own, count, LONG);
    await traced(1);
    await looksAsBefore("optics");
    const worst = async () => Math.max(...[...(await page.locator(".beside").innerText()).matchAll(/([\d.]+) um rms/g)].map((found) => Number(found[1])));
    const before = await worst();
    const gap = page.locator('[data-key^="gap-"][data-key$="-number"]').last();
    await gap.fill(String(Number(await gap.inputValue()) + 2));
    await gap.press("Enter");
    await page.waitForFunction((own) => Math.max(...[...document.querySelector(".beside").innerText.matchAll(/([\d.]+) um rms/g)].map((found) => Number(found[1]))) > 1.5 * own, before, LONG);
    const after = await worst();
    await key(page, "as-designed").click();
    await page.waitForFunction((own) => Math.abs(Math.max(...[...document.querySelector(".beside").innerText.matchAll(/([\d.]+) um rms/g)].map((found) => Number(found[1]))) - own) < 0.02, before, LONG);
    await sound("optics");
    return `worst spot ${before} to ${after} um and back`;
  });
  await said("a path outside the given folder is refused", async () => {
    const outside = (await page.request.get(new URL("/api/sequence?at=0/../..", address).href)).status();
    assert.equal(outside, 403);
  });
  assert.deepEqual(faults, []);
  console.log("ok  no console errors, and no request left this machine");
} finally {
  await browser.close();
  server.kill();
}
