// What fits on three sizes of screens, light and dark, running and stopped; and a phone in two hands.

const SIZES = [[390, 844], [1366, 768], [1920, 1080]];
const PHONE = 700;

// In the page: what is wrong with what a person sees, in words.
function flaws() {
  const found = [];
  // A phone's browser shows more of a page that is too wide: the window grows, its root does not.
  const { clientWidth: wide, clientHeight: high, scrollWidth, scrollHeight } = document.documentElement;
  const phone = wide <= 700;
  const called = (one) => (one.id ? `#${one.id}` : `${one.tagName.toLowerCase()} ${JSON.stringify(one.textContent.trim().slice(0, 24))}`);
  if (scrollWidth > wide) found.push(`the page is ${scrollWidth - wide} px too wide`);
  if (!phone && scrollHeight > high) found.push("the page is higher than the screen");
  const inside = (box, outer) => box.left >= outer.left - 1 && box.right <= outer.right + 1 && box.top >= outer.top - 1 && box.bottom <= outer.bottom + 1;
  for (const one of document.querySelectorAll("header, section, header *, section *")) {
    if (!one.checkVisibility() || ["OPTION", "WBR"].includes(one.tagName)) continue;
    const box = one.getBoundingClientRect();
    const outer = one.closest("#answers") ? document.documentElement : one.closest("header, section");
    if (box.width && !inside(box, outer.getBoundingClientRect()) && !one.closest("#answers")) found.push(`${called(one)} is cut off`);
    if (one.clientHeight && !["SELECT", "INPUT", "CANVAS"].includes(one.tagName)
      && (one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1)) found.push(`${called(one)} does not fit`);
    const target = ["BUTTON", "SELECT", "INPUT"].includes(one.tagName);
    if (phone && target && (box.width < 44 || box.height < 44)) found.push(`${called(one)} is ${box.width.toFixed(0)} x ${box.height.toFixed(0)}`);
  }
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text = texts.nextNode(); text; text = texts.nextNode()) {
    if (!text.parentElement.checkVisibility()) continue;
    // A line may end behind a hyphen or a slash.
    for (const word of text.data.matchAll(/[^\s/-]+[/-]?/g)) {
      const range = document.createRange();
      range.setStart(text, word.index);
      range.setEnd(text, word.index + word[0].length);
      const lines = new Set([...range.getClientRects()].map((box) => Math.round(box.top / 4)));
      if (lines.size > 1) found.push(`"${word[0]}" is broken`);
    }
  }
  const pad = document.getElementById("pad").getBoundingClientRect();
  const reason = document.getElementById("standing");
  if (reason.checkVisibility() && !inside(reason.getBoundingClientRect(), pad)) found.push("the reason is not at the pad");
  // In one screen, and under nothing else.
  for (const id of ["pad", "stop", "hold"]) {
    const one = document.getElementById(id);
    const box = one.getBoundingClientRect();
    if (!inside(box, { left: 0, top: 0, right: wide, bottom: high })) found.push(`#${id} is outside of the screen`);
    const above = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    if (above !== one) found.push(`#${id} is covered`);
  }
  if (pad.height < 250) found.push(`the pad is ${pad.height.toFixed(0)} px high`);
  return [...new Set(found)];
}

// Pictures for the documents: of an arm that follows on a screen, of a stopped one on a phone.
const DOCUMENTS = { "1366-running": "console", "1920-running": "console-wide", "390-stopped": "console-phone" };

// All sizes that belong to this kind of page, light and dark.
async function sizes({ check, pause, pictures, more, runs = async () => {} }, page, sizes, what) {
  for (const [width, height] of sizes) {
    for (const scheme of ["light", "dark"]) {
      // A screen that is made anew forgets the fingers on it.
      const now = page.viewportSize();
      if (now.width !== width || now.height !== height) await page.setViewportSize({ width, height });
      await page.emulateMedia({ colorScheme: scheme });
      await page.evaluate(() => scrollTo(0, 0));
      await pause(600);
      await runs();
      const name = DOCUMENTS[`${width}-${what}`];
      const mode = await page.evaluate(() => document.getElementById("mode").textContent);
      const shown = name && (mode === "stopped") === (what === "stopped");
      await page.screenshot({ path: shown ? `${pictures}/${name}-${scheme}.png` : `${more}/console-${width}x${height}-${what}-${scheme}.png` });
      if (width <= PHONE && what === "stopped") await page.screenshot({ path: `${more}/console-${width}x${height}-${what}-${scheme}-whole.png`, fullPage: true });
      const found = await page.evaluate(flaws);
      check(`${what} at ${width} by ${height}, ${scheme}: everything is whole and at hand`, found.length === 0, found.join("; "));
    }
  }
  await page.emulateMedia({ colorScheme: "light" });
}

export const desktops = (tools, page, what) => sizes(tools, page, SIZES.filter(([width]) => width > PHONE), what);

// Rules that spoil the page, each of which the judgement above must see.
export async function spoiled({ check }, page, rules) {
  for (const rule of rules) {
    await page.evaluate((rule) => { const [sheet] = document.styleSheets; sheet.insertRule(rule, sheet.cssRules.length); }, rule);
    const found = await page.evaluate(flaws);
    await page.evaluate(() => { const [sheet] = document.styleSheets; sheet.deleteRule(sheet.cssRules.length - 1); });
    check(`spoiled by ${rule}, the page is not found whole`, found.length > 0, found[0]);
  }
}

// One finger holds, another one arms, draws and stops; `address` lets it control.
export async function phone({ check, until, pause, open, pictures, more }, browser, address) {
  const page = await open(browser, address, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  await until("a phone that controls", () => page.evaluate(() => globalThis.foretrace.mine
    && globalThis.foretrace.clock.offsetUs !== null), 30);
  const cdp = await page.context().newCDPSession(page);
  const touch = (type, ...fingers) => cdp.send("Input.dispatchTouchEvent", { type, touchPoints: fingers });
  const middle = (selector) => page.evaluate((selector) => {
    const box = document.querySelector(selector).getBoundingClientRect();
    return { x: box.left + box.width / 2, y: box.top + box.height / 2 };
  }, selector);
  const held = () => page.evaluate(() => globalThis.foretrace.newest?.here.held);
  const mode = () => page.evaluate(() => globalThis.foretrace.newest?.state?.mode);
  const at = { hold: await middle("#hold"), arm: await middle('[data-ask=\'{"arm":true}\']'),
    disarm: await middle('[data-ask=\'{"disarm":true}\']'), pad: await middle("#pad"), stop: await middle("#stop") };
  const thumb = { ...at.hold, id: 0 };
  const finger = (place) => ({ ...place, id: 1 });
  const tap = async (place) => {
    await touch("touchStart", thumb, finger(place));
    await pause(60);
    await touch("touchEnd", finger(place));
  };

  await touch("touchStart", thumb);
  await until("the held button", held, 10);
  // A busy machine stops the loop again.
  const runs = () => until("arming by the second finger", async () => {
    if (["armed", "following", "holding"].includes(await mode())) return true;
    await tap(at.disarm);
    await pause(500);
    await tap(at.arm);
    await pause(1500);
    return false;
  }, 60);
  await runs();
  check("one finger holds to run while another arms", await held());
  const before = await page.evaluate(() => { globalThis.foretrace.pad.clear(); return globalThis.foretrace.pad.sent; });
  let always = true;
  for (let step = 0; step <= 40; step += 1) {
    const place = { x: at.pad.x - 80 + 4 * step, y: at.pad.y - 30 * Math.sin(step / 6) };
    await touch(step === 0 ? "touchStart" : "touchMove", thumb, finger(place));
    await pause(20);
    if (step % 10 === 9) always &&= await held();
  }
  const drawn = await page.evaluate(() => ({ sent: globalThis.foretrace.pad.sent,
    ink: globalThis.foretrace.pad.ink.filter(([, , contact]) => contact).length }));
  check("while another draws", always && await held() && drawn.sent - before >= 30 && drawn.ink > 20, `${drawn.sent - before} samples`);
  await touch("touchEnd", finger(at.pad));
  await pause(200);
  check("and holds on when that one is lifted", await held());
  const stroke = async () => {
    await runs();
    await page.evaluate(() => { globalThis.foretrace.pad.clear(); document.getElementById("answers").replaceChildren(); });
    for (let step = 0; step <= 40; step += 1) {
      const place = { x: at.pad.x - 80 + 4 * step, y: at.pad.y - 30 * Math.sin(step / 6) };
      await touch(step === 0 ? "touchStart" : "touchMove", thumb, finger(place));
      await pause(15);
    }
    await touch("touchEnd", finger(at.pad));
  };
  await sizes({ check, pause, pictures, more, runs: stroke }, page, SIZES.filter(([width]) => width <= PHONE), "running");
  await runs();
  const stops = await page.evaluate(() => globalThis.foretrace.stops);
  await tap(at.stop);
  await until("the stop", async () => (await mode()) === "stopped", 20);
  check("a second finger stops, once", await page.evaluate(() => globalThis.foretrace.stops) === stops + 1);
  await touch("touchEnd", thumb);
  await until("the thumb lifted", async () => !(await held()), 10);

  // The other way round: a finger that draws came first.
  await touch("touchStart", finger(at.pad));
  await pause(100);
  await touch("touchStart", finger(at.pad), thumb);
  await until("the button held by the second finger", held, 10);
  await touch("touchEnd", thumb);
  await until("the button let go", async () => !(await held()), 10);
  await touch("touchEnd", finger(at.pad));
  check("the finger that draws may come first", true);
  await until("a stop at the pad", () => page.evaluate(() => document.querySelector('#standing[data-kind="stopped"]')?.checkVisibility()), 20);
  await sizes({ check, pause, pictures, more }, page, SIZES.filter(([width]) => width <= PHONE), "stopped");
  await spoiled({ check }, page, ["dd { width: 2.5ch; word-break: break-all }", "#clear { min-height: 0; height: 30px }", ".told { height: 4px }",
    "main { width: 120vw }", "section.pad { height: 900px }", "#standing { margin-top: 60vh }"]);
  check("the phone reports no error of its own", page.faults.length === 0, page.faults.join("; "));
  await page.tap("#control");
  await until("the control given back by the phone", async () => !(await page.evaluate(() => globalThis.foretrace.mine)), 10);
  await page.context().close();
}
