// The page's map of the daemon's clock, against a clock that the test knows: judged without a browser.

import { ClockMap } from "./page/clock.js";

let passed = 0;
function check(name, holds, evidence = "") {
  if (!holds) { console.log(`FAILED  ${name}: ${evidence}`); process.exit(1); }
  passed += 1;
  console.log(`ok  ${name}`);
}

// The same numbers at each run, in [0, 1).
function numbers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

// The clock of a host: what it shows at a moment of the browser.
const host = (aheadUs, ppm = 0) => (ms) => 1000 * ms * (1 + ppm * 1e-6) + aheadUs;
// A ping that leaves at `sentMs`; how long it takes there and back.
const ping = (map, truth, sentMs, there, back) => map.take(sentMs, truth(sentMs + there), sentMs + there + back);
// How wrong the map is at a moment [ms], and what it says of that.
const wrongMs = (map, truth, ms) => Math.abs(map.stampUs(ms) - truth(ms)) / 1000;
const within = (map, truth, ms) => wrongMs(map, truth, ms) <= map.uncertaintyMs(ms);

const AHEAD_US = 86_400e6;

{
  const map = new ClockMap();
  check("a clock that was never asked is not known", map.offsetUs === null && map.stampUs(5) === null && map.uncertaintyMs(5) === null);
  ping(map, host(AHEAD_US), 1000, 0.4, 0.4);
  check("a ping as long there as back gives the offset itself", wrongMs(map, host(AHEAD_US), 1001) < 1e-6 && map.offsetUs === AHEAD_US,
    `${map.offsetUs}`);
  check("the uncertainty begins at half the way there and back, with little on top",
    map.uncertaintyMs(1000.8) >= 0.4 && map.uncertaintyMs(1000.8) < 0.6, `${map.uncertaintyMs(1000.8)}`);
  check("and grows by 0.2 ms each second without another ping",
    Math.abs(map.uncertaintyMs(11_000) - map.uncertaintyMs(1000) - 2) < 1e-9);
}

for (const [there, back] of [[0, 40], [40, 0], [3, 37], [37, 3]]) {
  const [map, truth] = [new ClockMap(), host(AHEAD_US)];
  ping(map, truth, 1000, there, back);
  check(`a way of ${there} ms there and ${back} back is wrong by no more than is said`, within(map, truth, 1040)
    && wrongMs(map, truth, 1040) > Math.abs(there - back) / 2 - 1e-6, `${wrongMs(map, truth, 1040)}`);
  ping(map, truth, 2000, 0.3, 0.2);
  check("a shorter way takes its place", wrongMs(map, truth, 2001) < 0.06 && map.uncertaintyMs(2001) < 0.4);
  const known = map.offsetUs;
  ping(map, truth, 3000, there, back);
  check("and a longer one does not", map.offsetUs === known);
}

// Ten minutes with a ping each second, on ways that are short or long by chance: stamps of all moments in between.
for (const [seed, ppm] of [[1, 0], [2, 100], [3, -100], [4, 200], [5, -200]]) {
  const [map, truth, chance] = [new ClockMap(), host(AHEAD_US, ppm), numbers(seed)];
  let [most, mostSaid, lies] = [0, 0, 0];
  for (let second = 1; second <= 600; second += 1) {
    const [there, back] = [0.1 + 4 * chance() ** 3, 0.1 + 4 * chance() ** 3];
    ping(map, truth, 1000 * second, there, back);
    for (let ms = 1000 * second + 10; ms < 1000 * (second + 1); ms += 90) {
      most = Math.max(most, wrongMs(map, truth, ms));
      mostSaid = Math.max(mostSaid, map.uncertaintyMs(ms));
      lies += within(map, truth, ms) ? 0 : 1;
    }
  }
  check(`a drift of ${ppm} ppm stays within what is said, which stays small`, lies === 0 && mostSaid < 5,
    `${lies} moments outside, ${most} ms wrong, ${mostSaid} said`);
}

{
  // A browser that tells the time in steps of 0.1 ms: the way there and back looks like none.
  const [map, truth] = [new ClockMap(), host(AHEAD_US)];
  map.take(1000, truth(1000.09), 1000);
  check("the grain of the browser's clock is within what is said", wrongMs(map, truth, 1000) > 0.08 && within(map, truth, 1000));
}

{
  // The tab was in the background: a ping each minute.
  const [map, truth] = [new ClockMap(), host(AHEAD_US, 200)];
  for (let minute = 1; minute < 20; minute += 1) ping(map, truth, 60_000 * minute, 0.2, 0.2);
  check("pings that are rare leave a wide claim, not a wrong one", within(map, truth, 20 * 60_000 - 1) && map.uncertaintyMs(20 * 60_000) > 12);
}

// One side sleeps for 20 s: the best ping of before is better than all that come after.
for (const stepUs of [20e6, -20e6, 60e3, -60e3]) {
  const map = new ClockMap();
  const [before, after] = [host(AHEAD_US), host(AHEAD_US + stepUs)];
  for (let second = 1; second < 10; second += 1) ping(map, before, 1000 * second, 0.1, 0.1);
  check("before a step the clock is known well", map.uncertaintyMs(9000) < 0.3);
  ping(map, after, 10_000, 30, 20);
  check(`a step of ${stepUs / 1000} ms is seen at the first ping after it, though that is worse`, within(map, after, 10_050)
    && wrongMs(map, after, 10_050) <= 5 + 1e-6, `${wrongMs(map, after, 10_050)}`);
  ping(map, after, 11_000, 5, 5);
  check("and the next better one takes its place", wrongMs(map, after, 11_010) < 1e-6);
}

{
  // The host halts while it answers a ping: the answer fits neither the clock of before nor that of after.
  const map = new ClockMap();
  ping(map, host(AHEAD_US), 1000, 0.1, 0.1);
  map.take(2000, host(AHEAD_US)(2000.1) - 7e6, 2000.4);
  ping(map, host(AHEAD_US - 20e6), 3000, 4, 4);
  check("a ping that a step made wrong holds until the next one", wrongMs(map, host(AHEAD_US - 20e6), 3010) < 1e-6);
}

{
  const map = new ClockMap();
  ping(map, host(AHEAD_US), 1000, 0.1, 0.1);
  map.reset();
  check("a new link begins without a clock", map.offsetUs === null && map.stampUs(1001) === null && map.uncertaintyMs(1001) === null);
  // Another start of the host: by so little apart that the old ping and the new one would agree.
  const truth = host(AHEAD_US + 20e3);
  ping(map, truth, 2000, 60, 5);
  check("and takes the first ping on it, however bad", within(map, truth, 2065) && map.uncertaintyMs(2065) > 32);
}
console.log(`${passed} passed without a browser`);
