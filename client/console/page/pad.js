// The pad: every sample that the browser gives, in metres of the pen's plane, stamped on the server's clock.

import { paint } from "./sheet.js";

const CONTACT = 1, IN_RANGE = 2, BUTTON_1 = 4, BUTTON_2 = 8, ERASER = 32;
// A pen at rest is sent again, because silence means that it is gone.
const REPEAT_MS = 20;
// Repeated samples are stamped this long ago, so that an event on its way stays later than they.
const MARGIN_MS = 4;
// A device may tell thousands of times per second: samples of so short a time go together, so many at most.
const TOGETHER_MS = 0.8;
const AT_ONCE = 100;
// Two stamps in a row differ by less, but for a clock that was set back.
const SET_BACK_US = 1e6;
const TRACE = 4000;
// No hand goes further between two points of the traces, a hundredth of a second [m].
const LEAP = 0.02;

// A lifted pen leaves one point, however long it hovers.
function keep(trace, point) {
  if (!point[2] && trace.length && !trace[trace.length - 1][2]) trace.pop();
  trace.push(point);
  if (trace.length > TRACE) trace.splice(0, trace.length - TRACE);
}

export class Pad {
  constructor(canvas, clock, { send, rate }) {
    this.canvas = canvas;
    this.clock = clock;
    this.send = send;
    this.rate = rate;
    this.may = false;
    this.plane = null;
    this.last = null;
    // The pointer that is followed, by its id and kind.
    this.follows = null;
    this.lastUs = 0;
    this.sent = 0;
    this.flushed = 0;
    this.pending = [];
    this.intervals = [];
    // Points of the traces: x, y, contact, and for ink whether it was followed.
    this.ink = [];
    this.tool = [];
    this.ghost = [];
    // Whether this page's hand is followed, and whether anybody's is.
    this.followed = false;
    this.loops = false;
    this.live = false;
    this.aim = null;
    this.path = [];
    // Pen metres per hand metre, and where the hand's zero lies for the pen.
    this.scale = 1;
    this.offset = [0, 0];
    // While the clutch is held the hand moves and the pen stays; it goes on from there, wherever the hand is by then.
    this.clutched = false;
    this.stays = null;
    this.anchor = null;
    this.tick = 0;
    // What a browser lacks outside of a secure context, or at all.
    this.raw = "onpointerrawupdate" in window;
    this.coalesced = typeof PointerEvent !== "undefined" && "getCoalescedEvents" in PointerEvent.prototype;
    const moves = this.raw ? "pointerrawupdate" : "pointermove";
    canvas.addEventListener(moves, (event) => this.moved(event));
    canvas.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      if (!this.isFollowed(event)) return;
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      this.one(event);
      this.flush();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (!this.isFollowed(event)) return;
      this.one(event);
      this.flush();
      this.follows.down = false;
    });
    for (const name of ["pointerleave", "pointercancel"]) {
      canvas.addEventListener(name, (event) => {
        if (this.follows && this.follows.id === event.pointerId) this.leave();
      });
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    setInterval(() => this.rest(), REPEAT_MS / 2);
    setInterval(() => this.tell(), 500);
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  paper(plane) { this.plane = plane; this.draw(); }
  enabled(may) { this.may = may; if (!may) this.leave(); this.draw(); }

  // What is drawn from now on was followed, or was not; what leads nowhere any more is taken off.
  standing({ live, loops, followed }) {
    if (live !== this.live) this.ask();
    Object.assign(this, { live, loops, followed });
    if (!live) { this.aim = null; this.path = []; }
  }

  // The paper on the canvas: as large as fits, in CSS pixels.
  frame() {
    const box = this.canvas.getBoundingClientRect();
    const [[x0, x1], [y0, y1]] = this.plane.workspace;
    const scale = 0.94 * Math.min(box.width / (x1 - x0), box.height / (y1 - y0));
    return { box, scale, cx: (x0 + x1) / 2, cy: (y0 + y1) / 2 };
  }

  // One pointer at a time: the one that went down first, or a pen, which outranks fingers. Samples of two in turn
  // would be a pen that leaps between them.
  isFollowed(event) {
    const now = this.follows;
    const down = event.buttons !== 0;
    if (now && now.id === event.pointerId) {
      now.down = down;
      return true;
    }
    const isPen = event.pointerType === "pen";
    if (now && (now.isPen || (!isPen && (now.down || !down)))) return false;
    if (now) this.leave();
    this.follows = { id: event.pointerId, isPen, down };
    return true;
  }

  moved(event) {
    if (!this.isFollowed(event)) return;
    const all = this.coalesced ? event.getCoalescedEvents() : [];
    for (const one of all.length ? all : [event]) this.one(one);
    // What waits goes with the next sample, or in a moment.
    if (performance.now() - this.flushed >= TOGETHER_MS) this.flush();
  }

  one(event) {
    if (!this.plane) return;
    const { box, scale, cx, cy } = this.frame();
    // Plane metres, then the pen's own.
    const x = cx + (event.clientX - box.left - box.width / 2) / scale;
    const y = cy - (event.clientY - box.top - box.height / 2) / scale;
    const keys = this.stays ?? this.read(event);
    const [px, py] = this.stays ? this.stays.at : this.lead([x, y]);
    // Held since before the first sample: this one is where the pen stays.
    if (this.clutched) this.stays ??= { ...keys, at: [px, py] };
    const [ox, oy] = this.plane.pen_origin;
    const { flags, pressure, tilt } = keys;
    this.put({ at: event.timeStamp, x: ox + px / this.plane.scale, y: oy + py / this.plane.scale, flags, pressure, tilt });
    this.at = [px, py];
    if (this.lastEvent !== undefined) this.intervals.push(event.timeStamp - this.lastEvent);
    this.lastEvent = event.timeStamp;
    if (this.other) keep(this.ink, [px, py, false, this.followed]);
    this.other = null;
    keep(this.ink, [px, py, (flags & CONTACT) !== 0, this.followed]);
  }

  // The pen's place for a hand that leads, both in plane metres.
  lead(hand) {
    if (this.anchor) {
      this.offset = hand.map((value, axis) => this.anchor[axis] - this.scale * value);
      this.anchor = null;
    }
    return hand.map((value, axis) => this.scale * value + this.offset[axis]);
  }

  // Holds the clutch, or lets it go.
  clutch(held) {
    if (held && !this.clutched && this.last) {
      const { flags, pressure, tilt } = this.last;
      this.stays = { flags, pressure, tilt, at: this.at };
    }
    if (!held && this.clutched) {
      this.anchor = this.stays?.at ?? this.anchor;
      this.stays = null;
    }
    this.clutched = held;
  }

  // Only while the clutch is held: else the pen would jump.
  scaled(scale) {
    if (this.clutched) this.scale = scale;
    return this.scale;
  }

  // Buttons, pressure and tilt of an event.
  read(event) {
    // A pen that touches while its side button is held tells the button alone: then its pressure says that it touches.
    const presses = event.pointerType === "pen" && event.buttons !== 0 && event.pressure > 0;
    const contact = (event.buttons & 1) === 1 || (event.buttons & 32) === 32 || presses;
    let flags = IN_RANGE;
    if (contact) flags |= CONTACT;
    if (event.buttons & 2) flags |= BUTTON_1;
    if (event.buttons & 4) flags |= BUTTON_2;
    if (event.buttons & 32) flags |= ERASER;
    const pressure = event.pointerType === "pen" ? event.pressure : -1;
    const rad = Math.PI / 180;
    return { flags, pressure, tilt: [event.tiltX * rad, -event.tiltY * rad] };
  }

  // On the server's clock, never later than now. After a clock that was set back, as by a sleep of the server's machine,
  // stamps begin anew: else they would stay in the future.
  stamp(at) {
    const us = this.clock.stampUs(Math.min(at, performance.now()));
    if (us !== null && us < this.lastUs - SET_BACK_US) this.lastUs = 0;
    return us;
  }

  put(reading) {
    const us = this.stamp(reading.at);
    if (us === null) return;
    // Of two events within the clock's grain the second one is later all the same.
    this.lastUs = Math.max(us, this.lastUs + 1);
    this.last = reading;
    this.pending.push([this.lastUs, reading.x, reading.y, reading.flags, reading.pressure, ...reading.tilt]);
  }

  flush() {
    if (!this.pending.length) return;
    this.flushed = performance.now();
    if (this.may) {
      for (let at = 0; at < this.pending.length; at += AT_ONCE) this.send(this.pending.slice(at, at + AT_ONCE));
      this.sent += this.pending.length;
    }
    this.pending = [];
    this.ask();
  }

  rest() {
    this.flush();
    if (!this.last || !this.may) return;
    const at = performance.now() - MARGIN_MS;
    const us = this.stamp(at);
    if (us === null || us < this.lastUs + REPEAT_MS * 1000) return;
    this.put({ ...this.last, at });
    this.flush();
  }

  leave() {
    this.follows = null;
    if (!this.last) return;
    const last = { ...this.last, at: performance.now() - MARGIN_MS, flags: this.last.flags & ~(CONTACT | IN_RANGE) };
    this.put(last);
    this.flush();
    this.last = null;
    // A hand that comes back goes on where the pen stayed.
    if (this.stays) [this.anchor, this.stays] = [this.stays.at, null];
    this.lastEvent = undefined;
  }

  tell() {
    // Samples of one burst share their moment nearly: only the whole time says the rate.
    const moving = this.intervals.filter((ms) => ms >= 0 && ms < 100);
    this.intervals = [];
    const wrongMs = this.clock.uncertaintyMs(performance.now());
    const clock = wrongMs === null ? "clock not known yet" : `clock ± ${wrongMs.toFixed(2)} ms`;
    const why = !isSecureContext ? "; this address is not secure: only one sample per picture, use localhost"
      : !this.coalesced ? "; this browser gives one sample per picture"
      : !this.raw ? "; this browser gives samples once per picture, late" : "";
    const lasted = moving.reduce((sum, ms) => sum + ms, 0);
    if (moving.length > 5 && lasted > 50) {
      const hz = (1000 * moving.length) / lasted;
      this.shown = `${hz.toFixed(0)} samples/s${hz < 100 ? ", as fast as this device and browser give them" : ""}`;
    }
    this.rate(`${this.shown ?? "move to see the rate"}; ${clock}${why}`);
  }

  // The arm's tool and the ghost, drawn under the hand's own ink.
  points(points, aim, path) {
    this.aim = aim ?? null;
    this.path = path ?? [];
    // Another daemon counts from 1 again.
    if (points.length && points[points.length - 1][0] < this.tick) this.tick = 0;
    for (const [tick, px, py, flags, x, y, z, gx, gy] of points) {
      if (tick <= this.tick) continue;
      // A gap in what was heard is a gap in the line.
      const whole = tick - this.tick <= 60;
      const writes = z < 0.002 && whole;
      this.tick = tick;
      // The hand of another page, a tablet or the writer; between two of them it leaps.
      if (!this.last) {
        const near = this.other && Math.hypot(px - this.other[0], py - this.other[1]) < LEAP;
        keep(this.ink, [px, py, (flags & CONTACT) !== 0 && whole && Boolean(near), this.loops]);
        this.other = [px, py];
      }
      keep(this.tool, [x, y, writes]);
      keep(this.ghost, [gx, gy, writes && (gx !== 0 || gy !== 0)]);
    }
    this.ask();
  }

  // An empty sheet.
  clear() {
    for (const trace of [this.ink, this.tool, this.ghost]) trace.length = 0;
    this.ask();
  }

  // At most one picture per picture of the screen.
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => { this.asked = false; this.draw(); });
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const box = canvas.getBoundingClientRect();
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, box.width, box.height);
    if (!this.plane) return;
    const { scale, cx, cy } = this.frame();
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => css.getPropertyValue(name).trim();
    const at = (x, y) => [box.width / 2 + (x - cx) * scale, box.height / 2 - (y - cy) * scale];
    const [[x0, x1], [y0, y1]] = this.plane.workspace;
    const [left, top] = at(x0, y1);
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    pen.strokeRect(left, top, (x1 - x0) * scale, (y1 - y0) * scale);
    paint(pen, this, at, colour);
    if (this.aim) {
      const [px, py] = at(this.aim[0], this.aim[1]);
      pen.strokeStyle = colour("--aim");
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.moveTo(px, py);
      for (const [x, y] of this.path) pen.lineTo(...at(x, y));
      pen.stroke();
      pen.beginPath();
      pen.arc(px, py, Math.max((this.aim[2] ?? 0) * scale, 3), 0, 2 * Math.PI);
      pen.stroke();
    }
    if (!this.may && this.live) {
      pen.fillStyle = colour("--soft");
      pen.font = "12px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.fillText("watching", box.width / 2, box.height - 8);
    }
  }
}
