// What the page says of how things stand, and what it saves: judged without a browser.

import { control, followed, holder, note, standing, told } from "./page/live.js";
import { svg } from "./page/sheet.js";

let passed = 0;
function check(name, holds, evidence = "") {
  if (!holds) { console.log(`FAILED  ${name}: ${evidence}`); process.exit(1); }
  passed += 1;
  console.log(`ok  ${name}`);
}

const here = { daemon: true, pen: null, dead_man: null, held: false, controller: "the browser 10.0.0.7", pen_note: null,
  hold_note: null, writing: false };
const state = { mode: "following", stopped: null, age_ms: 40 };
const stopped = { why: "dead-man switch not held", evidence: "silent for 160 ms", remedy: "hold it, then arm again" };
const page = { linked: true, before: true, silentMs: 30, askedMs: 40, mine: true, frame: { here, state } };

const runs = standing(page);
check("a loop that follows is live and says nothing over the pad", runs.live && runs.follows && runs.title === "");
const dead = [
  { linked: false }, { linked: false, before: false }, { silentMs: 2000 }, { askedMs: 3000 }, { frame: null },
  { frame: { here: { ...here, daemon: false }, state } }, { frame: { here, state: { ...state, age_ms: 5000 } } },
  { frame: { here, state: null } },
].map((change) => ({ now: standing({ ...page, ...change }), frame: change.frame === undefined ? page.frame : change.frame }));
check("without link, news, daemon or status nothing is live and nothing follows",
  dead.every(({ now }) => !now.live && !now.follows && !followed(now, page.frame, true)), JSON.stringify(dead.map(({ now }) => now.kind)));
check("and no mode of an arm is told", dead.every(({ now }) => !["following", "holding", "armed", "idle"].includes(now.mode)));
check("who controls is not told where it is not known", dead.every(({ now, frame }) =>
  now.kind === "no-daemon" || !/^(This page|The page)/.test(control(now, frame, true))));

const ended = { ...page, frame: { here, state: { ...state, mode: "stopped", stopped } } };
const pressed = (change, more = {}) => standing({ ...ended, ...change, frame: { here: { ...here, ...more.here },
  state: { ...ended.frame.state, stopped: { ...stopped, ...more.stopped } } } });
check("a stop says why, what to do and what to press", /Dead-man switch not held: silent for 160 ms\./.test(standing(ended).words[0])
  && standing(ended).press.includes("Hold to run") && note({ now: standing(ended), frame: ended.frame, mine: true }).includes("not followed"));
check("what to press is what helps", pressed({}, { stopped: { why: "requested", remedy: "arm again" } }).press === "Press Arm (key A)."
  && pressed({}, { stopped: { why: "tracking error", remedy: "then disarm and arm again" } }).press.startsWith("Press Disarm")
  && pressed({ mine: false }).press.includes("10.0.0.7") && pressed({ mine: false }, { here: { controller: null } }).press.startsWith("Press Take control"));
const odd = { ...ended.frame, arm_note: { text: "speed slider at 50 %", to_do: "set it to 100 %", age_s: 3 } };
check("the arm's own reason stands beside it", standing({ ...ended, frame: odd }).words[2]
  === "The arm's own process says: Speed slider at 50 %. Set it to 100 %.", standing({ ...ended, frame: odd }).words[2]);
check("a hand is followed only on the page that controls, whose pen is taken, while no writer writes",
  followed(runs, page.frame, true) && !followed(runs, page.frame, false)
  && !followed(runs, { here: { ...here, writing: true }, state }, true) && !followed(runs, { here: { ...here, pen_note: "held" }, state }, true));
check("angles and places that are no numbers are not shown", told({ joints_rad: [0, 1, 2, 3, 4, null], tool_m: [0.1, 0.2] }).joints === null
  && told({ joints_rad: [0, 1, 2, 3, 4, 5] }).joints.length === 6 && told({ here, state }).note === null);

check("who holds is named without what changes every second",
  holder("the browser 10.0.0.7:34466 (process 4606) since 3 s") === "the browser 10.0.0.7:34466" && holder(null) === "nobody");

const ink = [[0, 0, false, true], [0, 0, true, true], [0.01, 0.01, true, true], [0.02, 0.01, true, false], [0.02, 0.01, false, false]];
const sheet = svg({ ghost: [], tool: [], ink }, [[-0.06, 0.06], [-0.04, 0.04]], (name) => name);
check("a saved sheet is in millimetres, with what was followed and what was not apart",
  sheet.includes('viewBox="0 0 120 80"') && sheet.includes('d="M60 40L70 30" stroke="--pen"')
  && /d="M70 30L80 30" stroke="--soft"[^>]*stroke-dasharray/.test(sheet), sheet);
console.log(`${passed} passed without a browser`);
