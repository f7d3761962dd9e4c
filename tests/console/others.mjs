// Everybody else: browsers at addresses that are not secure, attackers at the port, fingers, other machines.

import { once } from "node:events";
import { connect } from "node:net";
import { networkInterfaces } from "node:os";
import { createInterface } from "node:readline";
import { connect as secure } from "node:tls";

const answer = (page) => page.evaluate(() => document.body.textContent);

// What a browser does for a page without a secure context, and what the console does with strangers. `page` controls.
export async function strangers({ check, until, pause, open }, browser, address, page) {
  const { port, host } = new URL(address);
  const foreign = await (await browser.newContext()).newPage();
  const refused = await foreign.goto(`http://console.example:${port}/`);
  check("an address that is not secure is refused by its name", refused.status() === 403
    && (await answer(foreign)).includes("foreign host") && !(await foreign.evaluate(() => isSecureContext)));
  await foreign.context().close();

  // The same page in a browser that gives it what such an address gets.
  const bare = await open(browser, address.replace(/#.*/, ""), { init: () => {
    delete PointerEvent.prototype.getCoalescedEvents;
    delete globalThis.onpointerrawupdate;
    Object.defineProperty(globalThis, "isSecureContext", { value: false });
  } });
  await until("the words on what is lost", () => bare.evaluate(() => document.getElementById("pad-rate").textContent
    .includes("not secure: only one sample per picture")), 20);
  check("a page without a secure context says what is lost", true);

  const closed = await bare.evaluate(() => new Promise((done) => {
    const socket = new WebSocket(`ws://${location.host}/socket`);
    socket.onopen = () => socket.send("x".repeat(1 << 20));
    socket.onclose = () => done(true);
  }));
  check("a message of a megabyte ends the page that sent it", closed);
  await bare.context().close();

  const frames = () => page.evaluate(() => globalThis.foretrace.frames);
  const deaf = connect(Number(port), "127.0.0.1");
  deaf.on("error", () => {});
  await once(deaf, "connect");
  deaf.write(`GET /socket HTTP/1.1\r\nHost: ${host}\r\nOrigin: http://${host}\r\nConnection: Upgrade\r\n`
    + "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
  deaf.pause();
  const before = await frames();
  await until("frames beside a page that never reads", async () => (await frames()) > before + 60);
  check("a page that never reads holds no other one up", true);
  deaf.destroy();

  let open_ = 0;
  const many = Array.from({ length: 1000 }, () => connect(Number(port), "127.0.0.1", () => { open_ += 1; }));
  for (const one of many) one.on("error", () => {});
  await until("a thousand connections", () => open_ > 900);
  const during = await frames();
  await until("frames beside a thousand connections", async () => (await frames()) > during + 15);
  for (const one of many) one.destroy();
  check("a thousand connections take the control from nobody", await page.evaluate(() => globalThis.foretrace.mine), `${open_}`);
  await until("a page after them", async () => {
    const after = await fetch(`http://${host}/`).catch(() => null);
    return after?.status === 200;
  });
  check("a page is served after a thousand connections", true);
  await pause(100);
}

// An empty pad that tells the kinds of what touches it, with its middle and the samples sent so far.
const blank = (page) => page.evaluate(() => {
  const { pad } = globalThis.foretrace;
  globalThis.kinds = new Set();
  pad.clear();
  pad.canvas.addEventListener("pointerdown", (event) => globalThis.kinds.add(event.pointerType));
  pad.leave();
  const { box } = pad.frame();
  return { sent: pad.sent, x: box.left + box.width / 2, y: box.top + box.height / 2 };
});

// A finger draws a line on the pad of the page that controls.
export async function finger({ check, pause, pictures }, page) {
  const cdp = await page.context().newCDPSession(page);
  await cdp.send("Emulation.setTouchEmulationEnabled", { enabled: true, maxTouchPoints: 2 });
  const before = await blank(page);
  const touch = (type, step) => cdp.send("Input.dispatchTouchEvent", {
    type, touchPoints: type === "touchEnd" ? [] : [{ x: before.x - 90 + 6 * step, y: before.y - 40 * Math.sin(step / 5) }],
  });
  await touch("touchStart", 0);
  for (let step = 1; step <= 30; step += 1) {
    await touch("touchMove", step);
    await pause(10);
  }
  await touch("touchEnd", 30);
  await cdp.send("Emulation.setTouchEmulationEnabled", { enabled: false });
  await cdp.detach();
  const after = await page.evaluate(() => ({ sent: globalThis.foretrace.pad.sent, kinds: [...globalThis.kinds],
    ink: globalThis.foretrace.pad.ink.slice(-20).filter(([, , contact]) => contact).length }));
  check("a finger writes", after.kinds.includes("touch") && after.sent - before.sent >= 20 && after.ink > 10,
    `${after.sent - before.sent} samples`);
  await page.locator("section.pad").screenshot({ path: `${pictures}/pad-touch.png` });
  await page.evaluate(() => globalThis.foretrace.pad.leave());
}

// A mouse writes on the same pad: no pressure, and as many samples as it gives.
export async function mouse({ check, pause, pictures }, page) {
  const before = await blank(page);
  const at = (step) => [before.x - 90 + 3 * step, before.y + 30 * Math.sin(step / 4) * Math.sin(step / 19)];
  await page.mouse.move(...at(0));
  await page.mouse.down();
  for (let step = 1; step <= 60; step += 1) {
    await page.mouse.move(...at(step));
    await pause(10);
  }
  await page.mouse.up();
  const after = await page.evaluate(() => ({ sent: globalThis.foretrace.pad.sent, kinds: [...globalThis.kinds],
    ink: globalThis.foretrace.pad.ink.slice(-40).filter(([, , contact]) => contact).length }));
  check("a mouse writes", after.kinds.includes("mouse") && after.sent - before.sent >= 40 && after.ink > 20,
    `${after.sent - before.sent} samples`);
  await page.locator("section.pad").screenshot({ path: `${pictures}/pad-mouse.png` });
  await page.evaluate(() => globalThis.foretrace.pad.leave());
}

// A clutch that is held while the hand goes elsewhere, and the half scale: the pen stays, and goes on without a jump.
export async function clutch({ check, pause, end, start }, page, rows) {
  const record = start("record", "--pen", rows.file);
  await pause(1000);
  const cdp = await page.context().newCDPSession(page);
  const middle = await page.evaluate(() => {
    globalThis.foretrace.pad.leave();
    const { box, scale, cx } = globalThis.foretrace.pad.frame();
    return { x: box.left + box.width / 2, y: box.top + box.height / 2, scale, cx };
  });
  const pen = (type, right, buttons) => cdp.send("Input.dispatchMouseEvent", { type, x: middle.x + right, y: middle.y,
    button: type === "mouseMoved" ? "none" : "left", buttons, pointerType: "pen", force: buttons ? 0.6 : 0 });
  const glide = async (from, to) => {
    for (let step = 1; step <= 20; step += 1) {
      await pen("mouseMoved", from + (to - from) * step / 20, 1);
      await pause(10);
    }
  };
  await pen("mousePressed", -60, 1);
  await glide(-60, -40);
  await page.keyboard.down("c");
  await page.evaluate(() => globalThis.foretrace.pad.scaled(0.5));
  await glide(-40, 60);
  await page.keyboard.up("c");
  await glide(60, 20);
  const at = await page.evaluate(() => globalThis.foretrace.pad.at);
  await pen("mouseReleased", 20, 0);
  await page.evaluate(() => { const { pad } = globalThis.foretrace; pad.clutch(true); pad.scaled(1); pad.offset = [0, 0]; pad.clutch(false); pad.anchor = null; pad.leave(); });
  await cdp.detach();
  await pause(500);
  await end(record);
  const ink = rows.read().filter((row) => row[3] === 1);
  const leap = Math.max(...ink.slice(1).map(([, x, y], index) => Math.hypot(x - ink[index][1], y - ink[index][2])));
  check("a clutched pen stays and goes on without a jump", leap * middle.scale < 6, `${(leap * middle.scale).toFixed(2)} px`);
  // 20 px to the right; then from the first sample of the hand that leads again, at 58, to 20 at half scale.
  const right = (at[0] - middle.cx) * middle.scale;
  check("the hand leads at the scale that was set meanwhile", Math.abs(right + 59) < 0.6, `${right.toFixed(2)} px`);
}

// The page on another machine: under TLS, by an address that works once.
export async function lan({ check, until, start, open, draw, end, circle }, browser) {
  const outside = Object.values(networkInterfaces()).flat().find(({ internal, family }) => !internal && family === "IPv4");
  const console_ = start("console", "--port=0", outside ? "--lan" : "--lan=127.0.0.2");
  const lines = [];
  createInterface({ input: console_.stdout }).on("line", (line) => lines.push(line));
  await until("the fingerprint", () => lines.find((line) => line.startsWith("certificate ")) || console_.exitCode !== null, 30);
  const address = lines[0]?.replace("open ", "") ?? "";
  check("--lan prints an address with a token under TLS", /^https:\/\/[\d.]+:\d+\/#[0-9a-f]{32}$/.test(address), lines[0] ?? console_.told);
  check("and a QR code", lines.filter((line) => /[\u2580\u2584\u2588]{2}/.test(line)).length >= 15);
  const { hostname, port, host } = new URL(address);
  const peer = secure({ host: hostname, port: Number(port), rejectUnauthorized: false });
  await once(peer, "secureConnect");
  const { fingerprint256, subjectaltname } = peer.getPeerCertificate();
  peer.destroy();
  check("the fingerprint is that of its certificate", lines.some((line) => line.includes(fingerprint256)), subjectaltname);
  check("the certificate names the address", subjectaltname.includes(`IP Address:${hostname}`), subjectaltname);

  const careful = await (await browser.newContext()).newPage();
  const warned = await careful.goto(address).then(() => "", (error) => String(error));
  check("a browser warns before it goes on", warned.includes("ERR_CERT_AUTHORITY_INVALID"), warned.slice(0, 80));
  await careful.context().close();
  const plain = await (await browser.newContext()).newPage();
  await plain.goto(`http://${host}/`).catch(() => {});
  await until("words for plain HTTP", async () => (await answer(plain)).includes(`https://${host}/`), 20);
  check("plain HTTP is told where to go", true);
  await plain.context().close();

  const trusting = { ignoreHTTPSErrors: true };
  const page = await open(browser, address, trusting);
  await until("control and clock", () => page.evaluate(() => globalThis.foretrace.mine && globalThis.foretrace.clock.offsetUs !== null
    && globalThis.foretrace.clock.uncertaintyMs(performance.now()) < 20));
  check("the page is secure and isolated, and its pad gets every sample", await page.evaluate(() => isSecureContext
    && crossOriginIsolated && globalThis.foretrace.pad.coalesced && globalThis.foretrace.pad.raw));
  const before = await page.evaluate(() => globalThis.foretrace.pad.sent);
  await draw(page, circle, 100);
  const sent = (await page.evaluate(() => globalThis.foretrace.pad.sent)) - before;
  check("a pen writes over wss", sent >= 100, `${sent} samples`);
  const late = await open(browser, address, trusting);
  await until("the refusal", () => late.evaluate(() => document.getElementById("answers").textContent.includes("works once")), 20);
  check("the address works once", !(await late.evaluate(() => globalThis.foretrace.mine)));
  await late.context().close();
  await page.reload();
  await until("the control after a reload", () => page.evaluate(() => globalThis.foretrace?.mine), 30);
  check("the page that had it keeps its key over a reload", true);
  const faults = page.faults.filter((fault) => !fault.includes("certificate"));
  check("the page under TLS reports no error of its own", faults.length === 0, faults.join("; "));
  await page.context().close();
  await end(console_);
}
