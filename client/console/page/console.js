// The page: its socket, its controls, and what goes where.

import { ClockMap } from "./clock.js";
import { Pad } from "./pad.js";
import { Arm } from "./arm.js";
import { State } from "./state.js";
import { Hold } from "./hold.js";
import { Said, write } from "./said.js";
import { touch } from "./touch.js";
import { control as controller, followed, holder, note, standing } from "./live.js";
import { png, save, svg } from "./sheet.js";

const byId = (id) => document.getElementById(id);
// A tab keeps the token over a reload; it stays out of the history and of pictures of the screen.
let token = kept(location.hash.slice(1));
history.replaceState(null, "", location.pathname);

function kept(given) {
  // A browser may forbid to keep anything.
  try {
    if (given) sessionStorage.setItem("token", given);
    return given || sessionStorage.getItem("token") || "";
  } catch { return given; }
}

const clock = new ClockMap();
const state = new State({ figures: byId("figures"), errors: byId("errors"), now: byId("error-now"),
  mode: byId("mode"), refused: byId("refused"), joints: byId("joints"), note: byId("arm-note") });
const said = new Said(byId("answers"));
let socket = null;
// Whether there was a link once, and what came over it last, when.
let before = false;
let newest = null;
let heardMs = 0;
// When the pings were sent that have no answer yet.
let unanswered = [];
let live = false;
let mine = false;
let arm = null;
let frames = 0;
let stops = 0;
let recording = false;
// This page had the control when its link broke: it asks again until the console has noticed that.
let wanted = 0;
// A person gave the control back: a new link takes it no more by itself.
let watches = false;
// A stop that found no link goes with the next one that comes within this time [ms].
const OWED_MS = 5000;
let owedMs = null;

const linked = () => socket !== null && socket.readyState === WebSocket.OPEN;

function send(message) {
  if (linked()) socket.send(JSON.stringify(message));
}

function ping() {
  if (!linked()) return;
  const now = performance.now();
  unanswered.push(now);
  send({ ping: now });
}

// Dated, so that one that was long under way, or from before a stop, moves nothing: at the earliest moment that it may
// have been by the server's clock.
function order(kind, what) {
  const now = performance.now();
  const us = clock.stampUs(now - clock.uncertaintyMs(now));
  if (us === null) said.add(false, "not asked for: the clock is not known yet; try again");
  else send({ [kind]: [what, us] });
}

function stop() {
  stops += 1;
  if (linked()) return send({ stop: true });
  owedMs = performance.now();
  said.add(false, "Stop could not be sent: no link to the console. Use the arm's own stop button.");
}

const pad = new Pad(byId("pad"), clock, {
  send: (samples) => { if (mine) send({ pen: samples }); },
  rate: (words) => { byId("pad-rate").textContent = words; },
});

function controls(now, refused, passing) {
  if (mine && !now) hold.letGo();
  mine = now;
  byId("bound").disabled = !mine;
  byId("bound-hand").disabled = !mine;
  byId("control").textContent = mine ? "Give it back" : "Take control";
  byId("control").classList.toggle("primary", !mine);
  if (mine) wanted = 0;
  if (refused && passing && wanted > 0) {
    wanted -= 1;
    setTimeout(() => send({ control: token }), 1000);
  } else if (refused) {
    wanted = 0;
    said.add(false, refused);
  }
  pad.enabled(mine);
  stand();
}

function hear(text) {
  const { pong, reply, control, scene, frame } = JSON.parse(text);
  if (pong) {
    clock.take(pong[0], pong[1], performance.now());
    unanswered = unanswered.filter((sent) => sent > pong[0]);
  }
  if (reply) said.add(reply.done, reply.words);
  if (control) {
    // A token that works once was used up: its key opens from here on, in this tab.
    if (control.key) token = kept(control.key);
    controls(control.mine, control.refused, control.passing);
  }
  if (scene) begin(scene);
  if (frame) {
    frames += 1;
    newest = frame;
    heardMs = performance.now();
    show(frame);
  }
}

function begin(scene) {
  pad.paper(scene.plane);
  const list = byId("predictor");
  list.replaceChildren(...scene.predictors.map((name) => new Option(name, name)));
  try {
    arm = arm ?? new Arm(byId("arm"));
    arm.scene(scene);
  } catch (error) {
    // Without WebGL the pad and the controls work on.
    byId("arm")?.replaceWith(Object.assign(document.createElement("p"),
      { className: "note", textContent: `this browser shows no 3-D picture: ${error.message}` }));
    arm = null;
  }
}

function show(frame) {
  state.frame(frame);
  const now = stand();
  if (now.live) {
    pad.points(frame.points, frame.arm?.aim, frame.arm?.path);
    if (arm) arm.frame(frame);
  }
  const here = frame.here;
  const predictor = byId("predictor");
  if (frame.state && document.activeElement !== predictor) predictor.value = frame.state.predictor;
  const trust = byId("trust");
  if (frame.state && document.activeElement !== trust) trust.value = frame.state.trust;
  write(byId("recording"), tape(here.recording));
}

// What is live, and everything that may not look so when it is not: looked at with each frame, and without any.
function stand() {
  const now = standing({ linked: linked(), before, silentMs: performance.now() - heardMs,
    askedMs: unanswered.length ? performance.now() - unanswered[0] : 0, frame: newest, mine });
  const here = newest?.here;
  if (!now.live && live) arm?.frame({ arm: null, points: [] });
  live = now.live;
  document.body.dataset.live = live ? "yes" : "no";
  state.standing(now);
  pad.standing({ live: now.live, loops: now.follows, followed: Boolean(newest) && followed(now, newest, mine) });
  reason(now);
  const words = controller(now, newest, mine);
  write(byId("control-note"), words);
  write(byId("pad-note"), note({ now, frame: newest, mine, clutched: pad.clutched }));
  write(byId("link"), now.live ? `pen: ${holder(here.pen)} · dead-man switch: ${holder(here.dead_man)}` : now.title);
  byId("link").title = now.live ? [here.pen, here.dead_man].filter(Boolean).join("; ") : "";
  hold.shown(now.live && mine && here.held);
  const stop = byId("stop");
  stop.classList.toggle("off", !linked());
  stop.setAttribute("aria-disabled", String(!linked()));
  return now;
}

// Why nothing follows, over the pad. A screen reader says it once: it is written anew only where it changes.
function reason({ kind, title, words, press }) {
  const box = byId("standing");
  const told = JSON.stringify([kind, title, words, press]);
  if (box.told === told) return;
  box.told = told;
  box.dataset.kind = kind;
  box.hidden = !title;
  const part = (name, text, className) => Object.assign(document.createElement(name), { textContent: text, className });
  box.replaceChildren(part("strong", title, ""), ...words.filter(Boolean).map((text) => part("p", text, "")),
    ...(press ? [part("p", press, "press")] : []));
}

// Where the recording goes, what was lost, and at the end what the run was worth.
function tape({ on, ending, path, seconds, bytes, lost, full, figures, failed }) {
  recording = Boolean(on);
  byId("record").textContent = on ? "End the recording" : "Record";
  byId("record").setAttribute("aria-pressed", String(recording));
  const mm = (value) => (value === null ? "not known" : `${value.toFixed(2)} mm`);
  const bound = full ? `; it ended by itself: no file may be larger than ${(full / 1e6).toFixed(0)} MB (--max-size)` : "";
  const size = path ? `${path}: ${(bytes / 1e6).toFixed(1)} MB, ${lost} lost${bound}` : "";
  if (failed) return failed;
  if (on) return `${seconds.toFixed(0)} s into ${size}`;
  if (ending) return `${size}; working out its figures`;
  if (!figures) return size;
  return `${size}; rms ${mm(figures.rms_mm)}, feedback alone ${mm(figures.ghost_rms_mm)}, saved ${mm(figures.saved_mm)}; `
    + `${figures.violations} violations in ${figures.commands} commands; max |jerk| ${figures.max_jerk_mps3.toFixed(1)} m/s³`;
}

const hold = new Hold(byId("hold"), {
  // Dated, so that one that was long under way enables nothing; not said before the clock is known.
  say: (held) => {
    const us = clock.stampUs(performance.now());
    if (us !== null) send({ hold: [held, us] });
  },
  may: () => mine,
  stays: (target) => target === pad.canvas,
});
document.addEventListener("visibilitychange", () => {
  if (document.hidden) { hold.letGo(); pad.leave(); }
});

// At the first touch: a finger that moves a little, or a second one, makes no click. A keyboard makes nothing else.
let touchedMs = -Infinity;
byId("stop").addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  touchedMs = performance.now();
  stop();
});
byId("stop").addEventListener("click", (event) => {
  if (event.detail === 0 || performance.now() - touchedMs > 1000) stop();
});
touch(document, [byId("hold"), byId("stop")]);
byId("clear").addEventListener("click", () => pad.clear());
function keep(blob, ending) {
  if (blob) said.add(true, `The sheet is saved as ${save(blob, ending)}`);
  else said.add(false, "The sheet is not saved: this browser makes no picture of it");
}
function colours() {
  const css = getComputedStyle(document.documentElement);
  return (name) => css.getPropertyValue(name).trim();
}
byId("save-svg").addEventListener("click", () => {
  if (pad.plane) keep(new Blob([svg(pad, pad.plane.workspace, colours())], { type: "image/svg+xml" }), "svg");
});
byId("save-png").addEventListener("click", async () => {
  if (pad.plane) keep(await png(pad, pad.plane.workspace, colours()), "png");
});
byId("control").addEventListener("click", () => {
  watches = mine;
  send(mine ? { release: true } : { control: token });
});
byId("record").addEventListener("click", () => send({ record: !recording }));
byId("take-pen").addEventListener("click", () => send({ take_pen: true }));
for (const button of document.querySelectorAll("[data-ask]")) {
  button.addEventListener("click", () => order("ask", JSON.parse(button.dataset.ask)));
}
function clutch(held) {
  pad.clutch(held);
  byId("clutch").setAttribute("aria-pressed", String(held));
  byId("scale").disabled = !held;
}
byId("clutch").addEventListener("click", () => clutch(!pad.clutched));
byId("scale").addEventListener("change", (event) => { event.target.value = pad.scaled(Number(event.target.value)); });
byId("trust").addEventListener("change", (event) => order("ask", { trust: Number(event.target.value) }));
byId("predictor").addEventListener("change", (event) => order("ask", { predictor: event.target.value }));
byId("write").addEventListener("submit", (event) => {
  event.preventDefault();
  order("write", byId("text").value);
});
for (const button of document.querySelectorAll("[data-view]")) {
  button.addEventListener("click", () => {
    if (arm) arm.view(button.dataset.view);
    for (const other of document.querySelectorAll("[data-view]")) {
      other.setAttribute("aria-pressed", String(other === button));
    }
  });
}

// Where letters are text; a slider takes none.
const typing = (target) => target.tagName === "TEXTAREA" || (target.tagName === "INPUT" && target.type !== "range");
// A list goes to what begins with the letter.
const picking = (target) => typing(target) || target.tagName === "SELECT";
// Elsewhere the space bar presses the button that has the focus, such as Stop.
const holds = (target) => target === document.body || target === hold.button || target === pad.canvas;
addEventListener("keydown", (event) => {
  if (event.key === "Escape") { if (!event.repeat) stop(); return; }
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if ((event.key === "s" || event.key === "S") && !event.repeat && !typing(event.target)) stop();
  if ((event.key === "a" || event.key === "A") && !event.repeat && !picking(event.target)) order("ask", { arm: true });
  if ((event.key === "c" || event.key === "C") && !event.repeat && !picking(event.target)) clutch(true);
  if (event.key === " " && holds(event.target)) { event.preventDefault(); if (!event.repeat) hold.press("key"); }
});
addEventListener("keyup", (event) => {
  if (event.key === " " && hold.by === "key") hold.letGo();
  if ((event.key === "c" || event.key === "C") && !picking(event.target)) clutch(false);
});

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  socket.onopen = () => {
    before = true;
    heardMs = performance.now();
    unanswered = [];
    clock.reset();
    if (owedMs !== null && performance.now() - owedMs < OWED_MS) {
      send({ stop: true });
      said.add(true, "The stop that found no link is sent now");
    }
    owedMs = null;
    // The first one goes before all that needs the clock.
    ping();
    for (let count = 1; count < 8; count += 1) setTimeout(ping, 30 * count);
    if (token && !watches) send({ control: token });
    stand();
  };
  socket.onmessage = (event) => hear(event.data);
  socket.onclose = () => {
    if (mine) wanted = 20;
    newest = null;
    controls(false, null, false);
    setTimeout(connect, 1000);
  };
}
setInterval(stand, 250);
setInterval(ping, 1000);
connect();

// For tests: what a person would see, in numbers.
globalThis.foretrace = { pad, clock, state, hear, drop: () => socket.close(), get linked() { return linked(); }, get newest() { return newest; }, get stops() { return stops; }, get frames() { return frames; }, get mine() { return mine; }, get arm() { return arm; } };
