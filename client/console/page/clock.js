// The clock of the daemon's host, as far as pings over a link tell it.
// Pure: it knows neither the page nor a clock. `…Ms` is the browser's `performance.now()`, `…Us` the host's monotonic clock.

// Over `--lan` or ssh these are the clocks of two machines. Each may be wrong by 100 ppm, as much as
// client/ur/src/bridge/clock.rs reckons with, and one may gain what the other loses: 200 µs per second. What is faster
// than that, such as a clock that is being set right, comes to light as pings that contradict each other.
const DRIFT = 200e-6;
// Browsers tell the time in steps: of 5 to 20 µs to a page that is isolated, else of 0.1 ms or more.
const GRAIN_MS = 0.1;

// How far a ping's offset may be wrong by now. The host may have read its clock at any moment of the ping's way there and
// back; since it was sent, the clocks may have drifted apart.
const wrongMs = (ping, nowMs) => ping.tripMs / 2 + GRAIN_MS + DRIFT * (nowMs - ping.sentMs);

export class ClockMap {
  constructor() { this.reset(); }

  // A new link may lead to another start of that host, and clocks may have been set meanwhile: what is known is void.
  reset() { this.best = null; }

  // A ping that left at `sentMs`, was answered at `hostUs`, and was back at `nowMs`.
  take(sentMs, hostUs, nowMs) {
    const ping = { sentMs, tripMs: nowMs - sentMs, offsetUs: hostUs - 1000 * (sentMs + nowMs) / 2 };
    // One ping is all that has to be kept: all of them age alike, so that one that is worse now never becomes the better.
    const before = this.best;
    if (!before || wrongMs(ping, nowMs) <= wrongMs(before, nowMs) || contradict(before, ping, nowMs)) this.best = ping;
  }

  // Null while nothing is known.
  get offsetUs() { return this.best && this.best.offsetUs; }
  uncertaintyMs(nowMs) { return this.best && wrongMs(this.best, nowMs); }
  stampUs(eventMs) { return this.best && eventMs * 1000 + this.best.offsetUs; }
}

// No offset agrees with both: between them one of the clocks was set, or halted while its machine slept. Then the newer
// one is right, however good the older one was.
function contradict(older, newer, nowMs) {
  return Math.abs(newer.offsetUs - older.offsetUs) > 1000 * (wrongMs(older, nowMs) + wrongMs(newer, nowMs));
}
