// What a console costs the loop: wake-up and step p99 with a console and a scripted client, against without, in turn.
// node tests/console/pairs.mjs [PAIRS] [SECONDS]; PROGRAM is foretrace, SCRATCH an empty folder.

import { spawn } from "node:child_process";
import { randomBytes } from "node:crypto";
import { once } from "node:events";
import { connect } from "node:net";
import { createInterface } from "node:readline";

const { PROGRAM, SCRATCH } = process.env;
const [pairs, seconds] = [Number(process.argv[2] ?? 10), Number(process.argv[3] ?? 20)];
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

function start(number, ...words) {
  const options = [`--root=${SCRATCH}/r${number}`, "--instance=8"];
  return spawn(PROGRAM, [...words, ...options], { stdio: ["ignore", "pipe", "ignore"], cwd: SCRATCH });
}

async function run(number, ...words) {
  const child = start(number, ...words);
  let out = "";
  child.stdout.on("data", (bytes) => { out += bytes; });
  const [code] = await once(child, "close");
  return { code, out };
}

async function until(test) {
  for (let tries = 0; tries < 300; tries += 1) {
    if (await test()) return;
    await pause(100);
  }
  throw new Error("the loop did not come up within 30 s");
}

// A text frame of RFC 6455, masked as a client's must be.
function framed(text) {
  const body = Buffer.from(text);
  const mask = randomBytes(4);
  const head = body.length < 126 ? Buffer.from([0x81, 0x80 | body.length])
    : Buffer.from([0x81, 0xfe, body.length >> 8, body.length & 255]);
  return Buffer.concat([head, mask, body.map((byte, index) => byte ^ mask[index % 4])]);
}

// A page that controls, measures its clock, reads every frame and writes 200 samples a second.
async function client(address) {
  const { host, port, hash } = new URL(address);
  const socket = connect(Number(port), "127.0.0.1");
  await once(socket, "connect");
  socket.write(`GET /socket HTTP/1.1\r\nHost: ${host}\r\nOrigin: http://${host}\r\nConnection: Upgrade\r\n`
    + `Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: ${randomBytes(16).toString("base64")}\r\n\r\n`);
  let bytes = 0;
  socket.on("data", (data) => { bytes += data.length; });
  socket.on("error", () => {});
  await pause(200);
  socket.write(framed(JSON.stringify({ control: hash.slice(1) })));
  const hand = setInterval(() => {
    const us = Number(process.hrtime.bigint()) / 1000;
    const at = us / 1e6;
    const samples = [0, 5000].map((back) => [us - back - 5000, 0.03 * Math.cos(at), 0.03 * Math.sin(at), 3, 0.5, 0, 0])
      .sort((a, b) => a[0] - b[0]);
    socket.write(framed(JSON.stringify({ pen: samples })));
  }, 10);
  const clock = setInterval(() => socket.write(framed(JSON.stringify({ ping: 1 }))), 1000);
  return () => {
    clearInterval(hand);
    clearInterval(clock);
    socket.destroy();
    return bytes;
  };
}

let count = 0;
async function measured(withConsole) {
  count += 1;
  const number = count;
  const children = [start(number, "daemon", "--log", "error")];
  try {
    await until(async () => (await run(number, "status")).code === 0);
    children.push(start(number, "arm", "sim"), start(number, "play", "glyphs:hello", "--loop"));
    await until(async () => (await run(number, "request", "arm")).code === 0);
    let over = () => 1;
    if (withConsole) {
      const console_ = start(number, "console", "--port=0");
      children.push(console_);
      const [line] = await once(createInterface({ input: console_.stdout }), "line");
      over = await client(line.replace("open ", ""));
    }
    await pause(1000 * seconds);
    const status = JSON.parse((await run(number, "status", "--json=-")).out);
    if (!over()) throw new Error("the client heard nothing");
    return { wakeup: status.stage_us.wakeup.p99, step: status.stage_us.step.p99 };
  } finally {
    for (const child of children.reverse()) {
      if (child.exitCode === null) {
        child.kill("SIGINT");
        await once(child, "exit");
      }
    }
  }
}

const ratios = { wakeup: [], step: [] };
for (let pair = 1; pair <= pairs; pair += 1) {
  // In turn, so that what drifts with time favours neither.
  const order = pair % 2 === 1 ? [false, true] : [true, false];
  const got = {};
  for (const withConsole of order) got[withConsole] = await measured(withConsole);
  for (const stage of ["wakeup", "step"]) ratios[stage].push(got[true][stage] / got[false][stage]);
  const words = (stage) => `${stage} p99 ${got[false][stage].toFixed(1)} -> ${got[true][stage].toFixed(1)} us`;
  console.log(`pair ${pair}: ${words("wakeup")}, ${words("step")}`);
}
for (const [stage, all] of Object.entries(ratios)) {
  const sorted = all.toSorted((a, b) => a - b);
  const middle = (sorted[(pairs - 1) >> 1] + sorted[pairs >> 1]) / 2;
  console.log(`${stage} p99 with console / without: median ${middle.toFixed(3)} of ${pairs} pairs`);
}
