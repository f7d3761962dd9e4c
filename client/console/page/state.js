// The state in words and figures, and the errors over time.

import { clock, line, write } from "./said.js";
import { told } from "./live.js";

const SECONDS = 20;
// A refusal is shown for so long [s]; one that is told again is the same one within the grain of two clocks [ms].
const REFUSED_S = 10;
const SAME_MS = 500;
const number = (value, digits, unit = "") => (value === null || value === undefined ? "not known" : `${value.toFixed(digits)} ${unit}`.trim());

// The predictor of another process.
const foreign = ({ weight, share, evidence, hits, steps, latency_ms, refused }) => {
  const reasons = Object.entries(refused).map(([why, count]) => `${count} ${why}`).join(", ");
  return `${number(100 * weight, 0, "% of the preview")}, ${number(100 * Math.max(share, 0), 0, "% in the mean")} (evidence ${number(evidence, 1)}), ${hits} of ${steps} steps in time, ${number(latency_ms, 1, "ms")}, refused: ${reasons || "none"}`;
};

export class State {
  constructor(parts) {
    this.parts = parts;
    this.errors = [];
    this.tick = 0;
    new ResizeObserver(() => this.plot()).observe(parts.errors);
  }

  frame(frame) {
    const { state, errors, here } = frame;
    const now = performance.now();
    // Another daemon counts from 1 again.
    if (errors.length && errors[errors.length - 1][0] < this.tick) this.tick = 0;
    for (const [tick, error, ghost] of errors) {
      if (tick <= this.tick) continue;
      this.tick = tick;
      this.errors.push([now, error / 1000, ghost === null ? null : ghost / 1000]);
    }
    while (this.errors.length && now - this.errors[0][0] > SECONDS * 1000) this.errors.shift();
    if (state && here.daemon) this.words(state);
    this.measured(frame);
    this.plot();
  }

  // What the arm's process tells of itself; rows that it does not tell are not shown.
  measured(frame) {
    const { joints, tool, note } = told(frame);
    const rows = [
      ["Joints 1 to 6 [°]", joints?.map((rad) => (rad * 180 / Math.PI).toFixed(1))],
      ["Tool x, y, z [mm]", tool?.map((m) => (m * 1000).toFixed(1))],
    ].filter(([, cells]) => cells);
    const { joints: table, note: words } = this.parts;
    table.hidden = rows.length === 0;
    const shape = rows.map(([name]) => name).join();
    if (table.shape !== shape) {
      table.shape = shape;
      table.tBodies[0].replaceChildren(...rows.map(([name, cells]) => {
        const row = document.createElement("tr");
        const head = document.createElement("th");
        head.scope = "row";
        head.textContent = name;
        row.append(head, ...cells.map(() => document.createElement("td")));
        return row;
      }));
    }
    rows.forEach(([, cells], row) => cells.forEach((cell, index) => { table.rows[row].cells[index + 1].textContent = cell; }));
    words.hidden = !note;
    const ago = Number.isFinite(note?.age_s) ? ` (${note.age_s.toFixed(0)} s ago)` : "";
    if (note) write(words, `The arm's process: ${note.text}${ago}${note.to_do ? `. ${note.to_do}` : ""}`);
  }

  // The mode, or why it is not known; nothing else is told of what is not live.
  standing(now) {
    const { mode, refused } = this.parts;
    mode.textContent = now.mode;
    mode.className = `mode ${now.live ? now.mode : ""}`;
    if (now.live) {
      this.heard = new Date();
      return;
    }
    if (this.heard) write(this.parts.now, `last known at ${clock(this.heard)}`);
    refused.replaceChildren();
    this.refusals = new Map();
  }

  words(state) {
    const { now } = this.parts;
    write(now, state.error_mm === null ? `not compared (${state.ghost_state})`
      : `${state.error_mm.toFixed(2)} mm rms; feedback alone ${state.ghost_mm === null ? "not known" : `${state.ghost_mm.toFixed(2)} mm`}`);
    const chain = state.chain_ms;
    const rows = [
      ["trust", `${number(state.trust, 2)} → ${number(state.trust_target, 2)} (${state.trust_reason})`],
      ["predictor", state.external
        ? `${state.predictor}: ${foreign(state.external)}`
        : state.predictor],
      ["pen → command", number(state.pen_to_command_ms, 2, "ms")],
      ["command → motion", number(state.command_to_motion_ms, 1, "ms")],
      ["reader, transport", `${number(chain.reader, 2, "ms")}, ${number(chain.transport, 2, "ms")}`],
      ["compute, to the arm", `${number(chain.compute, 2, "ms")}, ${number(chain.to_arm, 2, "ms")}`],
      ["arm's lag", number(chain.lag, 1, "ms")],
      ["loop", `${number(state.rate_hz, 1, "Hz")}, ${state.overruns} overruns, ${state.shed} shed`],
      ["pen", `${number(state.pen_age_ms, 0, "ms old")}, ${state.pen_samples} samples, ${state.pen_rejected} rejected`],
      ["arm", number(state.arm_age_ms, 0, "ms old")],
      ...state.stages_us.map(([name, p50, p99]) => [name, `${p50.toFixed(0)} µs, p99 ${p99.toFixed(0)}`]),
    ];
    const list = this.parts.figures;
    while (list.children.length < 2 * rows.length) {
      list.append(document.createElement("dt"), document.createElement("dd"));
    }
    rows.forEach(([name, words], index) => {
      list.children[2 * index].textContent = name;
      list.children[2 * index + 1].textContent = words;
    });
    this.refuse(state.refused);
  }

  // Refusals of the last seconds, by the local time at which they were made; only what is new changes the list.
  refuse(all) {
    const { refused } = this.parts;
    const known = this.refusals ?? new Map();
    this.refusals = new Map();
    for (const { who, why, ago_s } of all) {
      if (ago_s >= REFUSED_S) continue;
      const at = new Date(Date.now() - 1000 * ago_s);
      const before = known.get(who);
      const same = before && before.why === why && Math.abs(at - before.at) < SAME_MS;
      this.refusals.set(who, same ? before : { why, at, item: line(`refused ${who}: ${why}`, false, at) });
    }
    for (const { item } of known.values()) if (![...this.refusals.values()].some((one) => one.item === item)) item.remove();
    for (const { item } of this.refusals.values()) if (item.parentNode !== refused) refused.append(item);
  }

  plot() {
    const canvas = this.parts.errors;
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => css.getPropertyValue(name).trim();
    const most = Math.max(2, ...this.errors.map(([, error, ghost]) => Math.max(error ?? 0, ghost ?? 0))) * 1.1;
    const now = performance.now();
    const at = (time, value) => [width - 4 - ((now - time) / (SECONDS * 1000)) * (width - 34), height - 14 - (value / most) * (height - 20)];
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = colour("--soft");
    pen.strokeStyle = colour("--line");
    pen.beginPath();
    for (const value of [0, most / 2.2, most / 1.1]) {
      const [, y] = at(now, value);
      pen.moveTo(30, y);
      pen.lineTo(width - 4, y);
      pen.fillText(value.toFixed(1), 2, y + 4);
    }
    pen.stroke();
    pen.fillText("mm off the pen, last 20 s", 34, height - 2);
    const trace = (index, style) => {
      pen.strokeStyle = style;
      pen.lineWidth = 1.5;
      pen.beginPath();
      let before = null;
      for (const sample of this.errors) {
        if (sample[index] === null) continue;
        const [x, y] = at(sample[0], sample[index]);
        if (before !== null && sample[0] - before < 500) pen.lineTo(x, y);
        else pen.moveTo(x, y);
        before = sample[0];
      }
      pen.stroke();
    };
    trace(2, colour("--ghost"));
    trace(1, colour("--tool"));
  }
}
