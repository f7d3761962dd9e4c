// A pen in a real browser: what it draws reaches the daemon, what a person sees is there, and who may not, may not.

import { spawn } from "node:child_process";
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { clutch, finger, lan, mouse, strangers } from "./others.mjs";
import { desktops, phone } from "./screens.mjs";
import { barrel, dim, ended, measured, names, sheet, silent, told } from "./standing.mjs";

const { CHROMIUM, PROGRAM, SCRATCH, PICTURES, MORE_PICTURES } = process.env;
const root = [`--root=${SCRATCH}/root`, "--instance=7"];
const children = [];
let passed = 0;

function check(name, holds, evidence = "") {
  if (!holds) throw new Error(`${name}: ${evidence}`);
  passed += 1;
  console.log(`ok  ${name}${evidence === "" ? "" : ` (${evidence})`}`);
}

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

function start(...words) {
  const env = { ...process.env, XDG_STATE_HOME: `${SCRATCH}/state`, XDG_DATA_HOME: `${SCRATCH}/data` };
  const child = spawn(PROGRAM, [...words, ...root], { stdio: ["ignore", "pipe", "pipe"], cwd: SCRATCH, env });
  child.told = "";
  child.stderr.on("data", (bytes) => { child.told += bytes; });
  child.words = words.join(" ");
  children.push(child);
  return child;
}

async function run(...words) {
  const child = start(...words);
  let out = "";
  child.stdout.on("data", (bytes) => { out += bytes; });
  const [code] = await once(child, "exit");
  return { code, out, told: child.told };
}

async function until(what, test, seconds = 60) {
  const end = Date.now() + 1000 * seconds;
  for (;;) {
    // A page that is being loaded again has nothing to say yet.
    const found = await Promise.resolve(test()).catch((error) => {
      if (!String(error).includes("Execution context was destroyed")) throw error;
    });
    if (found) return found;
    if (Date.now() > end) throw new Error(`${what} did not come about within ${seconds} s`);
    await pause(50);
  }
}

async function end(child) {
  child.kill("SIGINT");
  if (child.exitCode === null) await once(child, "exit");
}

async function open(browser, address, { init, ...options } = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, colorScheme: "light", ...options });
  if (init) await context.addInitScript(init);
  const page = await context.newPage();
  page.faults = [];
  page.on("pageerror", (error) => page.faults.push(String(error)));
  page.on("console", (line) => { if (line.type() === "error") page.faults.push(line.text()); });
  await page.goto(address);
  await page.waitForFunction(() => globalThis.foretrace?.frames > 3, null, { timeout: 60000 });
  return page;
}

// Draws a figure with a pen, in bursts, as a fast pen does. `figure` gives metres of the plane.
async function draw(page, figure, count) {
  const at = await page.evaluate(() => {
    const { box, scale, cx, cy } = globalThis.foretrace.pad.frame();
    return { left: box.left + box.width / 2, top: box.top + box.height / 2, scale, cx, cy };
  });
  const cdp = await page.context().newCDPSession(page);
  const point = (index) => {
    const [x, y] = figure(index / count);
    return { x: at.left + (x - at.cx) * at.scale, y: at.top - (y - at.cy) * at.scale };
  };
  const pen = (type, index, buttons) => cdp.send("Input.dispatchMouseEvent", {
    type, ...point(index), button: type === "mouseMoved" ? "none" : "left", buttons, pointerType: "pen",
    force: buttons ? 0.6 : 0, tiltX: 20, tiltY: -10,
  });
  await pen("mouseMoved", 0, 0);
  await pen("mousePressed", 0, 1);
  for (let index = 1; index < count; index += 5) {
    const burst = [];
    for (let one = index; one < Math.min(index + 5, count); one += 1) burst.push(pen("mouseMoved", one, 1));
    await Promise.all(burst);
    await pause(20);
  }
  await pen("mouseReleased", count - 1, 0);
  await cdp.detach();
}

// Arms again what a busy machine has stopped: that is not what is judged here.
async function awake() {
  await until("an armed loop", async () => {
    const { out } = await run("status", "--json=-");
    if (["armed", "following", "holding"].includes(JSON.parse(out).mode)) return true;
    await run("request", "disarm");
    await pause(500);
    await run("request", "arm");
    return false;
  });
}

// A mouse of 8000 Hz, and the samples that wait while the page is busy, are no reason to let the page go.
async function swift(page) {
  let sockets = 0;
  page.on("websocket", () => { sockets += 1; });
  const before = await page.evaluate(() => {
    const { pad } = globalThis.foretrace;
    pad.leave();
    const name = pad.raw ? "pointerrawupdate" : "pointermove";
    const event = (more) => new PointerEvent(name, { pointerId: 1, pointerType: "mouse", bubbles: true, clientX: 200, clientY: 300, ...more });
    const sent = pad.sent;
    const begin = performance.now();
    for (let count = 0; count < 4000; count += 1) {
      while (performance.now() < begin + count / 8);
      pad.canvas.dispatchEvent(event());
    }
    pad.canvas.dispatchEvent(event({ coalescedEvents: Array.from({ length: 600 }, () => event()) }));
    return sent;
  });
  await pause(2000);
  const sent = await page.evaluate(() => { globalThis.foretrace.pad.leave(); return globalThis.foretrace.pad.sent; }) - before;
  check("a mouse of 8000 Hz and 600 samples at once keep their link", sockets === 0 && sent >= 4600, `${sent} samples, ${sockets} links lost`);
}

// The page's account of the daemon's clock against that clock itself: all three processes run on one machine, and
// `process.hrtime` reads CLOCK_MONOTONIC, as the daemon does. The page looked between two readings of it.
async function agree(name, page) {
  const monotonicMs = () => Number(process.hrtime.bigint()) / 1e6;
  const readings = [];
  // One ping a second, and one look is as exact as its way to the page and back: a busy machine delays most of both.
  await until("clocks that are read within 5 ms and said to agree within 10", async () => {
    for (let count = 0; count < 20; count += 1) {
      const before = monotonicMs();
      const { stampMs, saysMs } = await page.evaluate(() => {
        const { clock } = globalThis.foretrace;
        const now = performance.now();
        return { stampMs: clock.stampUs(now) / 1000, saysMs: clock.uncertaintyMs(now) };
      });
      const after = monotonicMs();
      // The error lies between: least to most.
      if (saysMs !== null) readings.push({ saysMs, least: stampMs - after, most: stampMs - before, width: after - before });
    }
    return readings.some(({ width, saysMs }) => width < 5 && saysMs < 10);
  });
  const wrong = readings.filter(({ saysMs, least, most }) => !(least <= saysMs && most >= -saysMs));
  const [best] = readings.filter(({ saysMs }) => saysMs < 10).sort((a, b) => a.width - b.width);
  const words = ({ saysMs, least, most }) => `± ${saysMs.toFixed(2)} ms said, ${least.toFixed(2)} to ${most.toFixed(2)} ms found`;
  check(name, wrong.length === 0, `${wrong.length} of ${readings.length} looks outside: ${words(wrong[0] ?? best)}`);
}

// A link that breaks: the control comes back by itself, unless a person gave it back.
async function relinked(page) {
  const is = (name) => page.evaluate((name) => globalThis.foretrace[name], name);
  const broken = async () => {
    await page.evaluate(() => globalThis.foretrace.drop());
    await until("the broken link", async () => !await is("linked"), 10);
    await until("a new link", () => is("linked"), 10);
  };
  // No ping can better what is not a number, and none contradicts it: only a new link does away with it.
  await page.evaluate(() => { globalThis.foretrace.clock.best.tripMs = NaN; });
  await broken();
  await until("the control behind a new link", () => is("mine"), 20);
  await agree("a new link begins a new map of the clock", page);
  await page.click("#control");
  await until("the control given back", async () => !await is("mine"), 10);
  await broken();
  await pause(2500);
  check("a page that gave the control back does not take it behind a new link", !await is("mine"));
  await page.click("#control");
  await until("the control asked for", () => is("mine"), 10);
}

// A stop that finds no link goes with the next one; after five seconds no more, when it may stop another run.
async function owed(page) {
  const is = (name) => page.evaluate((name) => globalThis.foretrace[name], name);
  const mode = async () => JSON.parse((await run("status", "--json=-")).out).mode;
  const said = (words) => page.evaluate((words) => document.getElementById("answers").textContent.includes(words), words);
  const unlinked = async () => {
    await awake();
    await page.evaluate(() => { document.getElementById("answers").replaceChildren(); globalThis.foretrace.drop(); });
    await until("the broken link", async () => !await is("linked"), 10);
    await page.keyboard.press("Escape");
    check("a stop without a link is not called sent", await said("Stop could not be sent"));
  };
  await unlinked();
  await until("the stop behind a new link", async () => await mode() === "stopped", 10);
  check("a stop that found no link goes with the next one", await said("is sent now"));
  await page.context().setOffline(true);
  await unlinked();
  await pause(5500);
  check("no link came meanwhile", !await is("linked"));
  await page.context().setOffline(false);
  await until("a new link", () => is("linked"), 15);
  await pause(1000);
  check("a stop of more than five seconds ago is not sent", !await said("is sent now") && await mode() !== "stopped", await mode());
}

// Shows a path of the preview and then none: whether the pad has its colour at two places of it and beside it, and how
// many ends of lines the arm's picture has of it.
function previewed() {
  const { pad, arm } = globalThis.foretrace;
  const pen = pad.canvas.getContext("2d");
  const violet = (x, y) => {
    const { box, scale, cx, cy } = pad.frame();
    const [left, top] = [box.width / 2 + (x - cx) * scale, box.height / 2 - (y - cy) * scale].map((at) => at * devicePixelRatio - 3);
    const { data } = pen.getImageData(left, top, 6, 6);
    return [...data.keys()].some((at) => at % 4 === 0 && data[at + 2] - data[at + 1] > 60 && data[at] > data[at + 1] + 20);
  };
  const show = (aim, path) => {
    pad.points([], aim, path);
    pad.draw();
    arm.frame({ arm: { known: false, commanded: [], aim, path }, points: [] });
    return [violet(0.025, 0.045), violet(0.065, 0.045), violet(0.065, 0.055), arm.path.geometry.drawRange.count];
  };
  const path = Array.from({ length: 10 }, (_, index) => [0.01 * (index + 1) - 0.02, 0.045]);
  return [...show([-0.02, 0.045, 0.004], path), "|", ...show(null, [])];
}

const tools = { check, until, pause, open, start, end, draw, pictures: PICTURES, more: MORE_PICTURES };
const circle = (share) => [0.03 * Math.cos(2 * Math.PI * share), 0.03 * Math.sin(2 * Math.PI * share)];

// Pictures of a loop that follows the built-in writer, as the documents show them, while the machine lets it be.
async function pictures(page) {
  const looks = () => page.evaluate(() => ({ mode: document.getElementById("mode").textContent,
    overruns: Number(/(\d+) overruns/.exec(document.getElementById("figures").textContent)?.[1] ?? 0) }));
  let parts = null;
  for (let tries = 0; tries < 8 && !parts; tries += 1) {
    await awake();
    await page.setViewportSize({ width: 1280, height: 720 });
    await page.emulateMedia({ colorScheme: "light" });
    await page.evaluate(() => document.getElementById("answers").replaceChildren());
    await page.fill("#text", "foretrace");
    await page.click("#write button");
    await page.evaluate(() => globalThis.foretrace.pad.clear());
    await pause(3000);
    const before = await looks();
    await page.setViewportSize({ width: 1100, height: 900 });
    await page.click('[data-view="follow"]');
    await pause(1200);
    // The strip: hand, arm and state side by side, of one moment.
    const seen = [];
    for (const part of ["pad", "arm", "state"]) seen.push(await page.locator(`section.${part}`).screenshot());
    const after = await looks();
    await page.click('[data-view="orbit"]');
    await pause(3000);
    if (before.mode === "following" && after.mode === "following" && after.overruns - before.overruns < 20) parts = seen;
  }
  for (const [width, height] of [[1280, 720], [800, 1280]]) {
    for (const scheme of ["light", "dark"]) {
      await page.setViewportSize({ width, height });
      await page.emulateMedia({ colorScheme: scheme });
      await pause(700);
      if (height > width) await page.screenshot({ path: `${MORE_PICTURES}/console-${scheme}.png` });
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(`nothing is cut off at the side at ${width} by ${height}, ${scheme}`, wide <= 0, `${wide} px`);
    }
  }
  // The pictures of before stay where the machine is too busy for new ones.
  if (!parts) {
    console.log("console: skipped: pictures: this machine is too busy for a loop that follows for some seconds");
    return;
  }
  const images = parts.map((bytes) => `<img src="data:image/png;base64,${bytes.toString("base64")}">`);
  const strip = await (await page.context().browser().newContext({ viewport: { width: 1280, height: 400 } })).newPage();
  await strip.setContent(`<style>body { margin: 0; display: flex; align-items: flex-start; gap: 8px; background: #fff } img { width: 421px }</style>${images.join("")}`);
  await pause(300);
  await strip.locator("body").screenshot({ path: `${PICTURES}/console-strip.png` });
  await strip.context().close();
}

async function judge(browser) {
  // A busy machine starves the simulated arm for longer than the preset allows.
  const daemon = start("daemon", "--set=safety.joint_state_timeout_ms=500");
  await until("the daemon", async () => (await run("status")).code === 0);
  start("arm", "sim");
  await until("arming", async () => (await run("request", "arm")).code === 0);
  const console_ = start("console", "--port=0");
  const [line] = await once(createInterface({ input: console_.stdout }), "line");
  const address = line.replace("open ", "");
  check("the console prints an address with a token", /^http:\/\/127\.0\.0\.1:\d+\/#[0-9a-f]{32}$/.test(address));

  const page = await open(browser, address);
  await page.waitForFunction(() => globalThis.foretrace.mine && globalThis.foretrace.clock.offsetUs !== null);
  check("the token does not stay in the address", !page.url().includes("#"));
  check("the page is isolated", await page.evaluate(() => crossOriginIsolated && isSecureContext));
  await agree("the page knows the daemon's clock as well as it says", page);

  const record = start("record", "--pen", `${SCRATCH}/pen.csv`);
  await pause(1000);
  const before = await page.evaluate(() => globalThis.foretrace.pad.sent);
  await draw(page, circle, 200);
  await pause(300);
  await page.locator("section.pad").screenshot({ path: `${PICTURES}/pad-pen.png` });
  await page.evaluate(() => globalThis.foretrace.pad.leave());
  await pause(500);
  const sent = await page.evaluate(() => globalThis.foretrace.pad.sent) - before;
  await end(record);
  const read = (file) => readFileSync(file, "utf8").trim().split("\n").filter((row) => /^[\d-]/.test(row))
    .map((row) => row.split(",").map(Number));
  const rows = read(`${SCRATCH}/pen.csv`);
  check("every sample of the pen reaches the daemon", rows.length === sent && sent >= 200, `${rows.length} of ${sent}`);
  check("in the order of their stamps", rows.every((row, index) => index === 0 || row[0] > rows[index - 1][0]));
  const ink = rows.filter((row) => row[3] === 1);
  const off = Math.max(...ink.map(([, x, y]) => Math.abs(Math.hypot(x, y) - 0.03)));
  check("the circle is within 0.1 mm where it was drawn", off < 1e-4, `${(off * 1e3).toFixed(4)} mm`);

  await awake();
  const mode = () => page.evaluate(() => document.getElementById("mode").textContent);
  await until("the mode on the page", async () => ["following", "holding", "armed"].includes(await mode()), 20);
  check("the mode is shown", true, await mode());
  const pen = await page.evaluate(() => document.getElementById("link").textContent);
  check("the holder of the pen is named", pen.includes("the browser 127.0.0.1"), pen);
  check("the arm is drawn", await page.evaluate(() => globalThis.foretrace.arm?.drawn > 5));
  const way = await page.evaluate(previewed);
  check("the previewed path is drawn on pad and paper, and goes with the last one",
    way.join(" ") === "true true false 20 | false false false 0", way.join(" "));
  await page.click("#record");
  const tape = () => page.evaluate(() => document.getElementById("recording").textContent);
  await until("a recording", async () => / s into .*\.mcap: [\d.]+ MB, \d+ lost/.test(await tape()), 20);
  let led = 0;
  await until("the writer's text behind an armed loop", async () => {
    await awake();
    await page.fill("#text", "Hello");
    await page.click("#write button");
    await pause(2500);
    led = Math.max(led, await page.evaluate(() => globalThis.foretrace.pad.path.length));
    await pause(2500);
    return page.evaluate(() => document.getElementById("answers").textContent.includes("the writer writes")
      && globalThis.foretrace.state.errors.length > 50);
  }, 90);
  check("a loop that follows tells where the preview leads it", led === 10, `${led} points`);
  await page.click("#record");
  await until("the run's figures", async () => /rms [\d.]+ mm, feedback alone [\d.]+ mm, saved .* violations/.test(await tape()), 60)
    .catch(async (error) => { throw new Error(`${error.message}: ${await tape()}`); });
  const figures = await tape();
  check("the run is recorded, and its figures are shown", figures.includes("; 0 violations in"), figures);
  const info = await run("record", `--info=${figures.split(": ")[0]}`);
  check("its file is whole", info.code === 0 && !info.out.includes("ends early"), info.out.split("\n")[0]);
  await pictures(page);
  await page.setViewportSize({ width: 1280, height: 720 });
  await page.emulateMedia({ colorScheme: "light" });

  await page.evaluate(() => {
    document.getElementById("answers").replaceChildren();
    const trust = document.getElementById("trust");
    trust.value = 0.5;
    trust.dispatchEvent(new Event("change"));
  });
  const answered = () => page.evaluate(() => [...document.getElementById("answers").children].map((line) => `${line.className}${line.textContent}`));
  await until("an answer about trust", async () => (await answered()).length > 0, 20);
  const said = await answered();
  check("trust is set from the page", !said[0].startsWith("no"), said[0]);
  await page.selectOption("#predictor", "constant-velocity");
  await until("the predictor that was asked for", () => page.evaluate(() => document.getElementById("figures").textContent
    .includes("predictorconstant-velocity")), 30);
  check("and the predictor", true);
  await page.evaluate(() => {
    globalThis.told = [];
    const { send } = WebSocket.prototype;
    WebSocket.prototype.send = function (text) { globalThis.told.push(text); return send.call(this, text); };
  });
  await page.focus("#predictor");
  for (const key of ["a", "c"]) await page.keyboard.press(key);
  await until("what the keys on a list asked for", () => page.evaluate(() => globalThis.told.length > 2), 20);
  const keys = await page.evaluate(() => ({ armed: globalThis.told.some((text) => text.includes('"arm"')),
    clutched: globalThis.foretrace.pad.clutched }));
  check("letters that pick from a list neither arm nor clutch", !keys.armed && !keys.clutched, JSON.stringify(keys));
  await page.selectOption("#predictor", "mixture");
  await swift(page);
  const ahead = await page.evaluate(() => {
    const { pad, clock } = globalThis.foretrace;
    const us = () => clock.stampUs(performance.now());
    const move = (timeStamp) => {
      const event = new PointerEvent(pad.raw ? "pointerrawupdate" : "pointermove", { pointerId: 1, pointerType: "mouse", bubbles: true });
      Object.defineProperty(event, "timeStamp", { value: timeStamp });
      pad.canvas.dispatchEvent(event);
      return (pad.lastUs - us()) / 1e6;
    };
    // An event from the future; and the server's clock, an hour behind after a sleep.
    const found = [move(performance.now() + 3.6e6)];
    pad.lastUs = us() + 3.6e9;
    found.push(move(performance.now()));
    pad.leave();
    return found;
  });
  check("stamps stay out of the future", ahead.every((seconds) => seconds < 0.1), ahead.map((seconds) => `${seconds.toFixed(3)} s`).join(", "));
  await page.click('[data-ask=\'{"trust_auto":true}\']');
  await names(tools, page);
  await barrel(tools, page);
  // The graph forgets what was judged before: it shows the last 20 s.
  await pause(12000);
  await awake();
  await page.fill("#text", "foretrace");
  await page.click("#write button");
  // The rate of events that were made by hand is none that anybody moves at.
  await page.evaluate(() => { globalThis.foretrace.pad.shown = undefined; globalThis.foretrace.pad.clear(); });
  await pause(10000);
  await desktops(tools, page, "running");
  await page.setViewportSize({ width: 1280, height: 720 });
  await strangers(tools, browser, address, page);
  await finger({ ...tools, pictures: PICTURES }, page);
  await mouse({ ...tools, pictures: PICTURES }, page);
  const clutched = `${SCRATCH}/clutched.csv`;
  await clutch(tools, page, { file: clutched, read: () => read(clutched) });

  const watcher = await open(browser, address.replace(/#.*/, "#00000000000000000000000000000000"));
  await pause(300);
  check("a wrong token only watches", !(await watcher.evaluate(() => globalThis.foretrace.mine)));
  const second = await open(browser, address);
  await pause(300);
  check("a second page does not get the control", !(await second.evaluate(() => globalThis.foretrace.mine)));
  await second.context().close();

  await owed(page);
  await awake();
  await page.bringToFront();
  await page.waitForFunction(() => globalThis.foretrace.mine);
  const held = () => page.evaluate(() => document.getElementById("hold").classList.contains("held"));
  const button = await page.locator("#hold").boundingBox();
  await page.mouse.move(button.x + 5, button.y + 5);
  await page.mouse.down();
  await until("the held button", held, 10);
  await page.evaluate(() => {
    Object.defineProperty(document, "hidden", { value: true, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  });
  await until("the release by a hidden page", async () => !(await held()), 10);
  await page.mouse.up();
  await until("the stop after the release", async () =>
    (await page.evaluate(() => document.getElementById("mode").textContent)) === "stopped", 20);
  check("hiding the page lets the button go, and the arm stops", true);
  await page.focus("#stop");
  await page.keyboard.down("Space");
  await pause(300);
  check("the space bar on Stop holds nothing", !(await held()));
  await page.keyboard.up("Space");
  await page.mouse.move(button.x + 5, button.y + 5);
  await page.mouse.down({ button: "right" });
  await pause(300);
  check("the right button of a mouse holds nothing", !(await held()));
  await page.mouse.up({ button: "right" });
  const stops = await page.evaluate(() => document.getElementById("answers").textContent);
  check("the space bar on Stop stops", stops.includes("the arm stops"), stops);
  await page.focus("#trust");
  const asked = (await page.evaluate(() => globalThis.foretrace.stops));
  await page.keyboard.press("s");
  await page.keyboard.press("Escape");
  check("S on the slider and Escape stop", await page.evaluate(() => globalThis.foretrace.stops) === asked + 2);
  const two = await page.evaluate(() => {
    const { pad } = globalThis.foretrace;
    const event = (type, pointerId, pointerType, buttons) => pad.canvas.dispatchEvent(
      new PointerEvent(type, { pointerId, pointerType, buttons, clientX: 200, clientY: 300, bubbles: true }));
    pad.canvas.setPointerCapture = () => {};
    pad.leave();
    const ids = [];
    for (const [type, id, kind, buttons] of [["pointerdown", 11, "touch", 1], ["pointerdown", 12, "touch", 1],
      ["pointerleave", 12, "touch", 0], ["pointerdown", 13, "pen", 1], ["pointerup", 11, "touch", 0]]) {
      event(type, id, kind, buttons);
      ids.push(pad.follows?.id);
    }
    pad.leave();
    return ids.join(" ");
  });
  check("one pointer is followed, a pen before fingers", two === "11 11 11 13 13", two);
  await page.reload();
  await until("the control after a reload", () => page.evaluate(() => globalThis.foretrace.mine
    && globalThis.foretrace.clock.offsetUs !== null), 20);
  check("a reload keeps the token", true);
  const reason = () => page.evaluate(() => document.querySelector('#standing[data-kind="stopped"]')?.textContent ?? "");
  await until("the reason of the stop", reason, 20);
  const why = await reason();
  check("the stop is told at the pad, with its remedy and what to press", why.includes("dead-man") && why.includes("press Arm"), why);
  await told(tools, page);
  await measured(tools, page);
  await dim({ ...tools, circle }, page);
  await sheet(tools, page);
  await desktops(tools, page, "stopped");
  await page.setViewportSize({ width: 1280, height: 720 });
  let answers = "";
  await until("arming by the page", async () => {
    // A busy machine stops the loop again.
    await page.mouse.up();
    await page.click('[data-ask=\'{"disarm":true}\']');
    await pause(500);
    // A switch that said stop has to be held again: the mouse holds it, the keyboard arms.
    await page.mouse.move(button.x + 5, button.y + 5);
    await page.mouse.down();
    await until("the held button", held, 10);
    await page.keyboard.press("a");
    await pause(1500);
    answers = await page.evaluate(() => document.getElementById("answers").innerText);
    return ["armed", "following", "holding"].includes(await mode());
  }, 40).catch((error) => { throw new Error(`${error.message}: ${answers}`); });
  check("a loop whose switch was let go is armed while that is held", true);
  await watcher.click("#stop");
  await until("the stop by a page that only watches", async () =>
    (await page.evaluate(() => document.getElementById("mode").textContent)) === "stopped", 20);
  check("a page without token can stop the arm", true);
  await page.mouse.up();
  await relinked(page);
  await page.click("#control");
  await until("the control given back", () => page.evaluate(() => !globalThis.foretrace.mine), 10);
  await phone(tools, browser, address);
  await page.click("#control");
  await until("the control asked for", () => page.evaluate(() => globalThis.foretrace.mine), 20);
  const faults = [...page.faults, ...watcher.faults];
  check("no page reports an error of its own", faults.length === 0, faults.join("; "));
  await silent(tools, page, console_);
  await watcher.context().close();
  await ended(tools, page, console_);
  await page.context().close();
  await lan({ ...tools, circle }, browser);
  check("the stop is logged with its address", /stop, asked for by the page of 127\.0\.0\.1:\d+/.test(console_.told), "");
  check("the daemon runs on", daemon.exitCode === null);
}

const browser = await chromium.launch({
  // Only the arm's picture is drawn by a graphics card made of software: all of every page drawn so leaves two cores no
  // time for the pages' own clocks.
  executablePath: CHROMIUM, args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing",
    "--host-resolver-rules=MAP console.example 127.0.0.1"],
});
let failed = 0;
try {
  await judge(browser);
} catch (error) {
  failed = 1;
  console.log(`FAILED  ${error.message}`);
  for (const child of children) if (child.exitCode === null || child.exitCode > 0) console.log(`${child.words}: ${child.told.slice(-600)}`);
} finally {
  await browser.close();
  for (const child of children.reverse()) if (child.exitCode === null) await end(child);
}
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed);
