// `foretrace foxglove` judged by the clients of others: the npm client of Foxglove (foxglove.websocket.v1),
// which the two others sit beside: one of foxglove.sdk.v1, and one that connects and never reads. Schemas are
// read by protobufjs from what the server advertises. ADDRESS and TOKEN say where the server is, SECONDS how long.

import foxglove from "@foxglove/ws-protocol";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor/index.js";
import WebSocket from "ws";

const { FoxgloveClient } = foxglove;

const { ADDRESS, SECONDS = "6" } = process.env;
const seconds = Number(SECONDS);
let broken = 0;
function judge(right, words) {
  console.log(`${right ? "ok " : "WRONG"} ${words}`);
  broken += right ? 0 : 1;
}
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const within = (promise, what) =>
  Promise.race([promise, sleep(10000).then(() => Promise.reject(new Error(`${what} did not come`)))]);

// What a set of files that describe messages says about the message `name`.
function decoder(channel) {
  const files = protobuf.descriptor.FileDescriptorSet.decode(Buffer.from(channel.schema, "base64"));
  const root = protobuf.Root.fromDescriptor(files);
  const type = root.lookupType(channel.schemaName);
  return (bytes) => type.decode(bytes);
}

// Counts ticks and frames of one viewer.
class Counter {
  ticks = [];
  frames = new Map();
  lines = [];
  scenes = [];
  previews = 0;
  tick(message) {
    this.ticks.push(Number(message.tick));
    judge.bad = judge.bad || !(message.qRad ?? message.q_rad)?.length;
  }
  frame(message) {
    const child = message.childFrameId ?? message.child_frame_id;
    this.frames.set(child, (this.frames.get(child) ?? 0) + 1);
  }
  take(topic, message) {
    if (topic === "/tick") this.tick(message);
    else if (topic === "/tf") this.frame(message);
    else if (topic === "/preview") this.previews += message.entities.some((entity) => entity.lines[0].points.length === 10);
    else if (topic === "/scene") this.scenes.push(message);
    else this.lines.push(message.message);
  }
  judge(who) {
    const { ticks, frames } = this;
    const span = ticks.at(-1) - ticks[0] + 1;
    const sorted = ticks.every((tick, at) => at === 0 || tick > ticks[at - 1]);
    judge(sorted, `${who}: ${ticks.length} ticks, each once and in order`);
    judge(ticks.length >= 0.95 * span && span > 100 * seconds, `${who}: of ${span} that the loop did meanwhile`);
    const counts = ["pen", "tool", "ghost"].map((child) => frames.get(child) ?? 0);
    judge(counts.every((count) => count >= 0.95 * span), `${who}: ${counts.join(", ")} frames of pen, tool, ghost`);
    const arm = frames.get("arm_6") ?? 0;
    judge(arm > 14 * seconds && arm < 22 * seconds, `${who}: ${arm} times the arm's last link in ${seconds} s`);
    const entities = this.scenes.flatMap((scene) => scene.entities);
    const hang = entities.every((entity) => ["base", ...frames.keys()].includes(entity.frameId ?? entity.frame_id));
    judge(this.previews > 20, `${who}: ${this.previews} times a previewed path of ten points`);
    judge(this.scenes.length === 1 && hang, `${who}: a scene of ${entities.map((entity) => entity.id).join(", ")}`);
  }
}

function npmClient() {
  const client = new FoxgloveClient({ ws: new WebSocket(`ws://${ADDRESS}`, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
  const counter = new Counter();
  const kinds = new Map();
  const all = { counter, client, services: [], failures: [], answers: [], values: [], statuses: [], info: null };
  client.on("serverInfo", (info) => (all.info = info));
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      kinds.set(client.subscribe(channel.id), { topic: channel.topic, decode: decoder(channel) });
    }
  });
  client.on("message", ({ subscriptionId, data }) => {
    const kind = kinds.get(subscriptionId);
    const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    const message = kind.decode(bytes);
    counter.take(kind.topic, message);
  });
  client.on("advertiseServices", (services) => all.services.push(...services));
  client.on("serviceCallFailure", (failure) => all.failures.push(failure));
  client.on("serviceCallResponse", (answer) => all.answers.push(answer));
  client.on("parameterValues", (values) => all.values.push(values));
  client.on("status", (status) => all.statuses.push(status));
  all.call = (name, payload) => {
    const { id } = all.services.find((service) => service.name === name);
    const data = new TextEncoder().encode(JSON.stringify(payload));
    client.sendServiceCallRequest({ serviceId: id, callId: 1, encoding: "json", data: new DataView(data.buffer) });
  };
  return all;
}

function sdkClient() {
  const counter = new Counter();
  const socket = new WebSocket(`ws://${ADDRESS}`, ["foxglove.sdk.v1"]);
  socket.binaryType = "nodebuffer";
  const kinds = new Map();
  socket.on("message", (data, isBinary) => {
    if (!isBinary) {
      const said = JSON.parse(data.toString());
      if (said.op !== "advertise") return;
      said.channels.forEach((channel, at) => kinds.set(100 + at, { topic: channel.topic, decode: decoder(channel) }));
      const subscriptions = said.channels.map((channel, at) => ({ id: 100 + at, channelId: channel.id }));
      socket.send(JSON.stringify({ op: "subscribe", subscriptions }));
    } else if (data[0] === 1) {
      const kind = kinds.get(data.readUInt32LE(1));
      const message = kind.decode(data.subarray(13));
      counter.take(kind.topic, message);
    }
  });
  return { counter, socket };
}

// Subscribes to everything, then takes nothing from its socket any more.
async function neverReads() {
  const socket = new WebSocket(`ws://${ADDRESS}`, ["foxglove.sdk.v1"]);
  await within(new Promise((open) => socket.on("open", open)), "the third viewer");
  const subscriptions = [1, 2].map((id) => ({ id, channelId: id }));
  socket.send(JSON.stringify({ op: "subscribe", subscriptions }));
  await sleep(100);
  socket._socket.pause();
  socket.on("error", () => {});
  return socket;
}

const third = await neverReads();
const [npm, sdk] = [npmClient(), sdkClient()];
await sleep(1000 * seconds);
npm.counter.judge("npm client, foxglove.websocket.v1");
sdk.counter.judge("client of foxglove.sdk.v1");
judge(sdk.socket.protocol === "foxglove.sdk.v1", "the subprotocol that was asked for is the one agreed on");
judge(!judge.bad, "joints are in every tick");
judge(npm.info?.capabilities.includes("services"), `server: ${npm.info?.name}`);

npm.client.getParameters([], "all");
const shown = () => npm.values.find(({ id }) => id === "all")?.parameters.map(({ name }) => name);
for (let at = 0; at < 100 && !shown(); at++) await sleep(50);
judge(["trust", "predictor"].every((name) => shown()?.includes(name)), `parameters: ${shown()}`);

npm.call("/foretrace/arm", {});
for (let at = 0; at < 100 && !npm.failures.length; at++) await sleep(50);
judge(npm.failures[0]?.message.includes("token"), `arm without the token: ${npm.failures[0]?.message}`);
npm.call("/foretrace/stop", {});
for (let at = 0; at < 100 && !npm.answers.length; at++) await sleep(50);
const answer = npm.answers[0] && Buffer.from(npm.answers[0].data.buffer, npm.answers[0].data.byteOffset, npm.answers[0].data.byteLength);
judge(answer?.toString().includes("the arm stops"), `stop: ${answer}`);

for (let at = 0; at < 100 && !npm.counter.lines.length; at++) await sleep(50);
judge(npm.counter.lines.some((line) => line.startsWith("stopped")), `log: ${npm.counter.lines.join("; ")}`);

const wrong = new WebSocket(`ws://${ADDRESS}`, ["foxglove.sdk.v9"]);
const status = await within(
  new Promise((done) => {
    wrong.on("unexpected-response", (_, response) => done(response.statusCode));
    wrong.on("error", () => {});
  }),
  "a refusal",
);
judge(status === 400, `another subprotocol: HTTP ${status}`);
third.terminate();
sdk.socket.terminate();
npm.client.close();
process.exit(broken ? 1 : 0);
