// How things stand, in words for the pad: what is live, whether the arm follows, why not, and what to press.
// Pure: it knows neither the page nor a clock.

// Without a frame for so long nothing on the page counts as live; without a status of the daemon neither [ms].
// An answer that has been under way for so long says that all that is shown is as old.
export const SILENT_MS = 1500;
const OLD_MS = 3000;
const LATE_MS = 2500;
// Modes in which a stroke is followed, from its beginning.
const FOLLOWS = ["armed", "following", "holding"];

const sentence = (text) => {
  const words = String(text ?? "").trim();
  const whole = words.charAt(0).toUpperCase() + words.slice(1);
  return whole && !/[.!?]$/.test(whole) ? `${whole}.` : whole;
};

// `linked`: the socket is open; `before`: it was open once; `silentMs`: since the newest frame; `askedMs`: since the
// oldest question that has no answer yet.
export function standing({ linked, before, silentMs, askedMs, frame, mine }) {
  const dead = (kind, title, ...words) => ({ kind, live: false, follows: false, title, words, press: "" });
  if (!linked && !before) return { ...dead("waits", ""), mode: "connecting" };
  if (!linked) {
    return { ...dead("ended", "The console has ended, or cannot be reached",
      "Nothing on this page is live, and nothing can be sent, Stop neither: use the arm's own stop button.",
      "This page tries again every second."), mode: "no link" };
  }
  if (!frame) return { ...dead("waits", ""), mode: "connecting" };
  if (silentMs > SILENT_MS) {
    return { ...dead("silent", "Nothing comes from the console any more", "Nothing on this page is live. Stop is still "
      + "sent, but may not arrive: use the arm's own stop button."), mode: "no news" };
  }
  if (askedMs > LATE_MS) {
    return { ...dead("late", "What comes from the console is seconds old", "The link or this device is too slow: nothing on "
      + "this page is live. Stop is sent, but may arrive late: use the arm's own stop button."), mode: "no news" };
  }
  const { here, state } = frame;
  if (!here.daemon) {
    return { ...dead("no-daemon", "No daemon runs", "Nothing follows, and nothing on this page is live. Start the daemon "
      + "where the arm is; this page then goes on by itself."), mode: "no daemon" };
  }
  if (!state) return { ...dead("waits", ""), mode: "unknown" };
  if (state.age_ms > OLD_MS) {
    return { ...dead("silent", "Nothing comes from the daemon any more", "Nothing on this page is live. "
      + "Look at the daemon's process; use the arm's own stop button."), mode: "no news" };
  }
  const mode = state.mode ?? "unknown";
  if (!state.stopped) return { kind: "runs", live: true, follows: FOLLOWS.includes(mode), title: "", words: [], press: "", mode };
  const { why, evidence, remedy } = state.stopped;
  const { note } = told(frame);
  const words = [sentence(evidence ? `${why}: ${evidence}` : why), sentence(remedy)];
  if (note) words.push(`The arm's own process says: ${sentence(note.text)} ${sentence(note.to_do)}`.trim());
  return { kind: "stopped", live: true, follows: false, title: "Stopped: what you draw is not followed", words,
    press: press(state.stopped, here, mine), mode };
}

// What to press after a stop, on this page.
function press({ why, remedy }, here, mine) {
  if (!mine && here.controller) return `The page of ${here.controller} controls: Arm is pressed there.`;
  if (!mine) return "Press Take control, then Arm.";
  if (/dead.man/i.test(`${why} ${remedy}`)) return "Hold “Hold to run”; while it is held, press Arm (key A).";
  if (/\bdisarm\b/i.test(remedy)) return "Press Disarm, then Arm (key A).";
  return "Press Arm (key A).";
}

// Whether a hand's stroke on this page reaches a loop that follows.
export function followed(now, frame, mine) {
  return now.follows && mine && !frame.here.pen_note && !frame.here.writing;
}

const numbers = (list, count) => (Array.isArray(list) && list.length === count && list.every(Number.isFinite) ? list : null);

// The measured joints [rad], the tool [m] and the words of the arm's own process; each may be absent.
export function told(frame) {
  const found = (name) => frame[name] ?? frame.arm?.[name] ?? frame.state?.[name];
  const note = found("arm_note");
  return { joints: numbers(found("joints_rad"), 6), tool: numbers(found("tool_m"), 3),
    note: note?.text ? { text: note.text, to_do: note.to_do ?? "", age_s: note.age_s } : null };
}

// A name without what changes every second, or fills a phone's line.
export const holder = (text) => (text ?? "nobody").replace(/ \(process \d+\)| since \d+ \w+/g, "");

// What may be done here, beside the pad.
export function note({ now, frame, mine, clutched }) {
  if (now.kind === "waits") return "";
  if (!now.live) return "What you draw now is not followed.";
  const { here } = frame;
  if (!mine) return "Take control to write here.";
  if (here.pen_note) return holder(here.pen_note);
  if (here.hold_note) return holder(here.hold_note);
  if (now.kind === "stopped") return "What you draw now is not followed.";
  if (!now.follows) return `The arm does not follow: it is ${now.mode}. Press Arm.`;
  if (clutched) return "Clutched: the hand moves, the arm stays.";
  if (here.writing) return "The built-in writer writes; your hand is not followed meanwhile.";
  return "Write with pen, finger or mouse. The paper's borders are the workspace.";
}

// Who controls, as far as it is known.
export function control(now, frame, mine) {
  if (!now.live && now.kind !== "no-daemon") return now.kind === "waits" ? "" : "Who controls is not known.";
  if (mine) return "This page controls.";
  return frame.here.controller ? `The page of ${frame.here.controller} controls.` : "This page only watches.";
}
