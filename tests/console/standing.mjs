// What the page says of a stop, of refusals and of a console that is gone: nothing that is not live looks so.

import { readFileSync } from "node:fs";

// What a person sees of it.
const seen = (page) => page.evaluate(() => {
  const text = (id) => document.getElementById(id).textContent;
  const shown = (id) => Number(getComputedStyle(document.getElementById(id)).opacity);
  const stop = getComputedStyle(document.getElementById("stop"));
  return { kind: document.getElementById("standing").dataset.kind, banner: document.getElementById("standing").innerText, mode: text("mode"),
    looks: document.getElementById("mode").className, control: text("control-note"), note: text("pad-note"), link: text("link"),
    numbers: ["figures", "errors", "error-now", "arm", "recording", "pad-rate"].map(shown), now: text("error-now"),
    stop: { off: document.getElementById("stop").classList.contains("off"), ground: stop.backgroundColor },
    held: document.getElementById("hold").classList.contains("held"), bound: document.getElementById("bound-hand").disabled };
});

const pale = ({ numbers }) => numbers.every((opacity) => opacity < 0.5);

// Strokes of a stopped arm, on the page that controls: dim, dashed, named; and followed ones are not.
export async function dim({ check, pause, draw, circle }, page) {
  const colours = () => page.evaluate(() => {
    const { pad } = globalThis.foretrace;
    const words = [];
    const pen = pad.canvas.getContext("2d");
    const { fillText, setLineDash } = pen;
    let dashed = 0;
    pen.fillText = (text, ...more) => { words.push(text); fillText.call(pen, text, ...more); };
    pen.setLineDash = (dash) => { dashed += dash.length ? 1 : 0; setLineDash.call(pen, dash); };
    pad.draw();
    delete pen.fillText;
    delete pen.setLineDash;
    const { data } = pen.getImageData(0, 0, pad.canvas.width, pad.canvas.height);
    let blue = 0;
    for (let at = 0; at < data.length; at += 4) if (data[at + 3] > 200 && data[at + 2] - data[at] > 100) blue += 1;
    const ink = pad.ink.filter(([, , contact]) => contact);
    return { blue, words, dashed, lost: ink.filter(([, , , followed]) => !followed).length, all: ink.length };
  });
  await page.evaluate(() => globalThis.foretrace.pad.clear());
  await draw(page, circle, 60);
  await pause(100);
  const lost = await colours();
  check("a stroke of a stopped arm is dim, dashed and called not followed", lost.all > 30 && lost.lost === lost.all && lost.blue === 0
    && lost.words.includes("not followed"), JSON.stringify(lost));
  // The same points, as if they had been followed: what is judged can be seen.
  await page.evaluate(() => { for (const point of globalThis.foretrace.pad.ink) point[3] = true; });
  const followed = await colours();
  check("one that was followed is not", followed.blue > 100 && !followed.words.includes("not followed"), JSON.stringify(followed));
}

export async function sheet({ check }, page) {
  const saved = async (button) => {
    const [file] = await Promise.all([page.waitForEvent("download"), page.click(button)]);
    return { name: file.suggestedFilename(), bytes: readFileSync(await file.path()) };
  };
  const lines = await saved("#save-svg");
  check("the sheet is saved as SVG", /^foretrace-[\dT-]+\.svg$/.test(lines.name) && /<path d="M[\d. -]+L/.test(lines.bytes.toString()), lines.name);
  const picture = await saved("#save-png");
  check("and as PNG", picture.name.endsWith(".png") && picture.bytes.subarray(1, 4).toString() === "PNG" && picture.bytes.readUInt32BE(16) === 2400,
    `${picture.bytes.length} bytes`);
  const left = await page.evaluate(() => {
    document.getElementById("clear").click();
    const { ink, tool, ghost } = globalThis.foretrace.pad;
    return ink.length + tool.length + ghost.length;
  });
  check("and cleared", left === 0, `${left} points left`);
}

export async function told({ check, pause, until }, page) {
  const live = await page.evaluate(() => Object.fromEntries(["reason", "answers", "refused", "pad-note"].map((id) =>
    [id, document.getElementById(id).getAttribute("aria-live")])));
  check("reasons stand in live regions, that of a stop in an assertive one", live.reason === "assertive" && live.answers === "polite"
    && live.refused === "polite" && live["pad-note"] === "polite", JSON.stringify(live));
  const changes = await page.evaluate(async () => {
    let count = 0;
    const watch = new MutationObserver((all) => { count += all.length; });
    watch.observe(document.getElementById("reason"), { subtree: true, childList: true, characterData: true, attributes: true });
    const { frames } = globalThis.foretrace;
    while (globalThis.foretrace.frames < frames + 20) await new Promise((done) => setTimeout(done, 50));
    watch.disconnect();
    return count;
  });
  check("and are said once, not with each frame", changes === 0, `${changes} changes in 20 frames`);
  await page.evaluate(() => globalThis.foretrace.hear(JSON.stringify({ reply: { done: false, words: "a refusal of the judge" } })));
  const lines = () => page.evaluate(() => [...document.querySelectorAll("#answers li")].map((line) => line.textContent).filter((text) => text.includes("of the judge")));
  const [line] = await lines();
  const [hours, minutes, seconds] = line.slice(0, 8).split(":").map(Number);
  const local = await page.evaluate(() => { const now = new Date(); return now.getHours() * 3600 + now.getMinutes() * 60 + now.getSeconds(); });
  check("a refusal has the local time", Math.abs(local - (hours * 3600 + minutes * 60 + seconds)) <= 3, line);
  await pause(5000);
  check("it can be read for some seconds", (await lines()).length === 1);
  await until("the end of a refusal", async () => (await lines()).length === 0, 20);
  check("and goes by itself", true);
}

// Buttons and headings.
export async function names({ check }, page) {
  // What the mouse is over looks different.
  await page.mouse.move(2, 2);
  const looks = await page.evaluate(() => [...document.querySelectorAll("button")].map((button) => {
    const disabled = button.closest("fieldset")?.disabled;
    const { backgroundColor, color, borderColor, fontWeight } = getComputedStyle(button);
    const pressed = button.getAttribute("aria-pressed") === "true";
    const rank = ["primary", "danger"].find((name) => button.classList.contains(name)) ?? (pressed ? "pressed" : "plain");
    return { id: button.id, words: button.textContent, rank, look: disabled ? "" : [backgroundColor, color, borderColor, fontWeight].join(" ") };
  }));
  const odd = looks.filter(({ words }) => !/^[A-Z][a-zA-Z ]+$/.test(words) || /^[A-Z].* [A-Z]/.test(words.replace(/PNG|SVG/, "")));
  check("buttons are verbs in sentence case", odd.length === 0, odd.map(({ words }) => words).join(", "));
  for (const rank of ["primary", "danger", "plain"]) {
    const same = new Set(looks.filter((one) => one.rank === rank && one.look).map(({ look }) => look));
    check(`all ${rank} buttons look alike`, same.size === 1, [...same].join(" | "));
  }
  const others = new Set(["primary", "danger", "plain"].map((rank) => looks.find((one) => one.rank === rank && one.look)?.look));
  check("and differ from those of another rank", others.size === 3);
}

// A pen that touches while its side button is held; and what is no touch.
export async function barrel({ check }, page) {
  const flags = await page.evaluate(() => {
    const { pad } = globalThis.foretrace;
    pad.canvas.setPointerCapture = () => {};
    pad.leave();
    const of = (pointerType, buttons, pressure) => pad.read(new PointerEvent("pointermove", { pointerType, buttons, pressure })).flags;
    return [of("pen", 2, 0.4), of("pen", 3, 0.4), of("pen", 2, 0), of("pen", 0, 0), of("mouse", 2, 0.5), of("pen", 1, 0.4)].join(" ");
  });
  // Contact 1, in range 2, first side button 4.
  check("a pen that touches while its side button is held writes", flags === "7 7 6 2 6 3", flags);
}

// Fields of a frame that a daemon may tell: shown when they are there.
export async function measured({ check }, page) {
  const shown = (more) => page.evaluate((more) => {
    const frame = structuredClone(globalThis.foretrace.newest);
    for (const part of [frame, frame.arm ?? {}, frame.state ?? {}]) for (const name of ["joints_rad", "tool_m", "arm_note"]) delete part[name];
    globalThis.foretrace.hear(JSON.stringify({ frame: { ...frame, ...more } }));
    const table = document.getElementById("joints");
    return { table: table.checkVisibility(), rows: [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent).join(" ")),
      note: document.getElementById("arm-note").checkVisibility(), words: document.getElementById("arm-note").textContent,
      banner: document.getElementById("standing").textContent, images: document.querySelectorAll("main img").length };
  }, more);
  const none = await shown({});
  check("angles that nobody tells are not shown", !none.table && !none.note);
  const all = await shown({ joints_rad: [0, -Math.PI / 2, Math.PI / 2, 0.1, 1, -3], tool_m: [0.0123, -0.02, 0],
    arm_note: { text: "speed slider at 50 % <img src=x>", to_do: "set it to 100 %", age_s: 3.2 } });
  check("measured angles in degrees, the tool in millimetres", all.table && all.rows[0] === "Joints 1 to 6 [°] 0.0 -90.0 90.0 5.7 57.3 -171.9"
    && all.rows[1] === "Tool x, y, z [mm] 12.3 -20.0 0.0", all.rows.join("; "));
  check("the arm's own reason, as text, also beside the stop", all.note && all.words.includes("speed slider at 50 % <img src=x> (3 s ago). set it to 100 %")
    && all.banner.includes("<img src=x>") && all.images === 0, all.words);
}

// A console that stands still, and goes on.
export async function silent({ check, until }, page, console_) {
  console_.kill("SIGSTOP");
  try {
    await until("a page that sees the silence", async () => (await seen(page)).kind === "silent", 10);
    const quiet = await seen(page);
    check("a console that says nothing looks dead", pale(quiet) && quiet.looks.trim() === "mode" && !/^This page/.test(quiet.control)
      && quiet.banner.includes("Nothing on this page is live"), JSON.stringify(quiet));
    check("Stop is for use while there is a link", !quiet.stop.off);
  } finally {
    console_.kill("SIGCONT");
  }
  await until("a page that is live again", async () => !pale(await seen(page)), 30);
  await until("the control again", () => page.evaluate(() => globalThis.foretrace.mine), 30);
  check("and alive when it goes on", true);
}

// A console that has ended.
export async function ended({ check, until, end, more }, page, console_) {
  const before = await seen(page);
  check("a live page looks so", !pale(before) && before.control === "This page controls." && !before.stop.off, JSON.stringify(before));
  await end(console_);
  await until("a page that sees the end", async () => (await seen(page)).kind === "ended", 10);
  const after = await seen(page);
  check("after the console's end the page says so and nothing looks live", pale(after) && after.banner.includes("The console has ended")
    && after.mode === "no link" && after.looks.trim() === "mode" && after.now.startsWith("last known at"), JSON.stringify(after));
  check("nobody seems to control", !/^This page|^The page/.test(after.control) && after.bound && !after.held, after.control);
  check("Stop does not look active", after.stop.off && after.stop.ground !== before.stop.ground, after.stop.ground);
  await page.click("#stop", { force: true });
  const words = await page.evaluate(() => document.getElementById("answers").textContent);
  check("and says that it was not sent", words.includes("Stop could not be sent"), words);
  await page.screenshot({ path: `${more}/console-ended.png` });
}
