// The page: its socket, its controls, and what goes where.

import { Pad } from "./pad.js";
import { Arm } from "./arm.js";
import { State } from "./state.js";

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

// The server's monotonic clock by the pings with the shortest way there and back.
class Clock {
  constructor() { this.offsetUs = null; this.uncertaintyMs = null; this.pings = []; }
  take(sentMs, serverUs, nowMs) {
    const rtt = nowMs - sentMs;
    this.pings.push({ rtt, offset: serverUs - 1000 * (sentMs + rtt / 2), at: nowMs });
    // Two clocks of one machine drift apart by less than 50 µs per second, also while one of them is slewed.
    const worth = (ping) => ping.rtt / 2 + 0.00005 * (nowMs - ping.at);
    this.pings = this.pings.sort((a, b) => worth(a) - worth(b)).slice(0, 60);
    this.offsetUs = this.pings[0].offset;
    this.uncertaintyMs = worth(this.pings[0]);
  }
  stampUs(eventMs) { return this.offsetUs === null ? null : eventMs * 1000 + this.offsetUs; }
}

const clock = new Clock();
const state = new State({ figures: byId("figures"), errors: byId("errors"), now: byId("error-now"),
  mode: byId("mode"), stopped: byId("stopped"), refused: byId("refused") });
let socket = null;
let mine = false;
let arm = null;
let frames = 0;
let stops = 0;
let recording = false;
// This page had the control when its link broke: it asks again until the console has noticed that.
let wanted = 0;
// A person gave the control back: a new link takes it no more by itself.
let watches = false;

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

// Dated, so that one that was long under way, or from before a stop, moves nothing: at the earliest moment that it may
// have been by the server's clock.
function order(kind, what) {
  const us = clock.stampUs(performance.now() - clock.uncertaintyMs);
  if (us === null) answer(false, "not asked for: the clock is not known yet; try again");
  else send({ [kind]: [what, us] });
}

function stop() {
  stops += 1;
  send({ stop: true });
}

const pad = new Pad(byId("pad"), clock, {
  send: (samples) => { if (mine) send({ pen: samples }); },
  rate: (words) => { byId("pad-rate").textContent = words; },
});

function answer(done, words) {
  const line = document.createElement("li");
  line.textContent = words;
  if (!done) line.className = "no";
  const list = byId("answers");
  list.prepend(line);
  while (list.children.length > 4) list.lastChild.remove();
}

function controls(now, refused, passing) {
  if (mine && !now) hold.letGo();
  mine = now;
  byId("bound").disabled = !mine;
  byId("control").textContent = mine ? "give it back" : "take control";
  if (mine) wanted = 0;
  if (refused && passing && wanted > 0) {
    wanted -= 1;
    setTimeout(() => send({ control: token }), 1000);
  } else if (refused) {
    wanted = 0;
    answer(false, refused);
  }
  pad.enabled(mine);
}

function hear(text) {
  const said = JSON.parse(text);
  if (said.pong) clock.take(said.pong[0], said.pong[1], performance.now());
  if (said.reply) answer(said.reply.done, said.reply.words);
  if (said.control) {
    // A token that works once was used up: its key opens from here on, in this tab.
    if (said.control.key) token = kept(said.control.key);
    controls(said.control.mine, said.control.refused, said.control.passing);
  }
  if (said.scene) begin(said.scene);
  if (said.frame) {
    frames += 1;
    show(said.frame);
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
  pad.points(frame.points, frame.arm?.aim, frame.arm?.path);
  if (arm) arm.frame(frame);
  state.frame(frame);
  const here = frame.here;
  const predictor = byId("predictor");
  if (frame.state && document.activeElement !== predictor) predictor.value = frame.state.predictor;
  const trust = byId("trust");
  if (frame.state && document.activeElement !== trust) trust.value = frame.state.trust;
  byId("link").textContent = here.daemon
    ? `pen: ${here.pen ?? "nobody"} · dead-man switch: ${here.dead_man ?? "nobody"}`
    : "no daemon runs";
  const other = here.controller && !mine ? `the page of ${here.controller} controls` : "";
  byId("control-note").textContent = mine ? "this page controls" : other || "this page only watches";
  byId("pad-note").textContent = note(here);
  hold.shown(here.held && mine);
  byId("recording").textContent = tape(here.recording);
}

// Where the recording goes, what was lost, and at the end what the run was worth.
function tape({ on, ending, path, seconds, bytes, lost, full, figures, failed }) {
  recording = Boolean(on);
  byId("record").textContent = on ? "end recording" : "record";
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

function note(here) {
  if (!mine) return "Take control to write here.";
  if (here.pen_note) return here.pen_note;
  if (here.hold_note) return here.hold_note;
  if (pad.clutched) return "Clutched: the hand moves, the arm stays.";
  if (here.writing) return "The built-in writer writes.";
  return "Write with pen, finger or mouse. The paper's borders are the workspace.";
}

// Hold-to-run: said again and again while it is held, so that silence lets it go.
const hold = {
  timer: null,
  button: byId("hold"),
  // Dated, so that one that was long under way enables nothing; not said before the clock is known.
  say(held) {
    const us = clock.stampUs(performance.now());
    if (us !== null) send({ hold: [held, us] });
  },
  press() {
    if (this.timer || !mine) return;
    this.say(true);
    this.timer = setInterval(() => this.say(true), 40);
  },
  letGo() {
    if (!this.timer) return;
    clearInterval(this.timer);
    this.timer = null;
    this.say(false);
  },
  shown(held) { this.button.classList.toggle("held", held); },
};
hold.button.addEventListener("pointerdown", (event) => {
  if (event.button !== 0 || !event.isPrimary) return;
  hold.button.setPointerCapture(event.pointerId);
  hold.press();
});
for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) {
  hold.button.addEventListener(name, () => hold.letGo());
}
document.addEventListener("visibilitychange", () => {
  if (document.hidden) { hold.letGo(); pad.leave(); }
});
addEventListener("blur", () => hold.letGo());

byId("stop").addEventListener("click", stop);
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
  if (event.key === " " && holds(event.target)) { event.preventDefault(); if (!event.repeat) hold.press(); }
});
addEventListener("keyup", (event) => {
  if (event.key === " ") hold.letGo();
  if ((event.key === "c" || event.key === "C") && !picking(event.target)) clutch(false);
});

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  socket.onopen = () => {
    for (let count = 0; count < 8; count += 1) setTimeout(() => send({ ping: performance.now() }), 30 * count);
    if (token && !watches) send({ control: token });
  };
  socket.onmessage = (event) => hear(event.data);
  socket.onclose = () => {
    if (mine) wanted = 20;
    controls(false, null, false);
    byId("link").textContent = "the console is gone; trying again";
    byId("mode").textContent = "no link";
    setTimeout(connect, 1000);
  };
}
setInterval(() => send({ ping: performance.now() }), 1000);
connect();

// For tests: what a person would see, in numbers.
globalThis.foretrace = { pad, clock, state, drop: () => socket.close(), get linked() { return socket.readyState === WebSocket.OPEN; }, get stops() { return stops; }, get frames() { return frames; }, get mine() { return mine; }, get arm() { return arm; } };
