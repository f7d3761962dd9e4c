// The replay of a run: pen, arm and, where it is known, the arm without prediction, in true time. Beside it
// the arm from the side. Data: the element "moved", numbers only; see moving.rs.
(() => {
  'use strict';
  const data = JSON.parse(document.getElementById('moved').textContent);
  const root = document.getElementById('moving');
  const [sheet, side] = root.querySelectorAll('canvas');
  const [play, slow] = root.querySelectorAll('button');
  const slider = root.querySelector('input');
  const clock = root.querySelector('output');
  const gap = root.querySelector('.gap');
  const names = ['ghost', 'pen', 'arm'].filter((name) => data[name]);
  const end = (data.pen.x.length - 1) / data.hz;
  // Longer than the eye keeps a stroke, and long enough to read a word.
  const INK_S = 5, TAIL_S = 0.45, LENS_MM = 32;
  let now = data.still / data.hz, playing = false, rate = 1, before = 0, waiting = 0, seen = true, told = -1;

  // Where `series` is at frame `at` [mm]; null where that is not known.
  const place = (series, at) => {
    const first = Math.floor(at), share = at - first, next = Math.min(first + 1, series.x.length - 1);
    const x = series.x[first], y = series.y[first], u = series.x[next], v = series.y[next];
    if (x === null || x === undefined) return null;
    if (share === 0 || u === null) return [x / 100, y / 100];
    return [(x + (u - x) * share) / 100, (y + (v - y) * share) / 100];
  };
  const down = (series, at) => series.down[Math.floor(at)] === '1';

  const bounds = (() => {
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const name of names) {
      for (const [k, x] of data[name].x.entries()) {
        if (x === null) continue;
        const y = data[name].y[k];
        left = Math.min(left, x / 100); right = Math.max(right, x / 100);
        low = Math.min(low, y / 100); high = Math.max(high, y / 100);
      }
    }
    const pad = 4 + 0.03 * (right - left);
    return { left: left - pad, right: right + pad, low: low - pad, high: high + pad };
  })();

  let colour = {};
  const colours = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of ['ink', 'muted', 'line', 'paper', 'pen', 'arm', 'ghost']) {
      colour[name] = style.getPropertyValue(`--${name}`).trim();
    }
  };

  // Sizes a canvas for the screen's pixels; returns its context, width and height in CSS pixels.
  const ready = (canvas, height) => {
    const width = canvas.clientWidth, scale = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext('2d');
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = pen.lineCap = 'round';
    return [pen, width, height];
  };

  // Strokes the path of `series` from frame `from` to `to` through `map`; only what it wrote, if `ink`.
  const trail = (pen, series, from, to, map, ink) => {
    pen.beginPath();
    let open = false;
    const step = (at) => {
      const spot = ink && !down(series, at) ? null : place(series, at);
      if (spot === null) { open = false; return; }
      const [x, y] = map(spot);
      if (open) pen.lineTo(x, y); else pen.moveTo(x, y);
      open = true;
    };
    const first = Math.max(0, from);
    step(first);
    for (let k = Math.floor(first) + 1; k < to; k += 1) step(k);
    step(to);
    pen.stroke();
  };

  const mark = (pen, name, [x, y], size) => {
    pen.beginPath();
    if (name === 'ghost') {
      pen.moveTo(x, y - 1.3 * size); pen.lineTo(x + 1.3 * size, y);
      pen.lineTo(x, y + 1.3 * size); pen.lineTo(x - 1.3 * size, y);
      pen.closePath();
    } else {
      pen.arc(x, y, name === 'pen' ? 1.7 * size : size, 0, 2 * Math.PI);
    }
    pen.lineWidth = 2;
    if (name === 'pen') {
      pen.strokeStyle = colour.ink;
      pen.stroke();
    } else {
      pen.fillStyle = colour[name];
      pen.fill();
    }
  };

  // The drawing: what was written, faint; the last moments strong; where each is.
  const drawing = (pen, at, map, wide) => {
    for (const name of names) {
      const series = data[name];
      pen.strokeStyle = colour[name];
      pen.globalAlpha = name === 'pen' ? 0.4 : 0.3;
      pen.lineWidth = wide * (name === 'pen' ? 2.2 : 1);
      trail(pen, series, at - INK_S * data.hz, at, map, true);
      const parts = 6, length = TAIL_S * data.hz / parts;
      for (let k = parts; k > 0; k -= 1) {
        pen.globalAlpha = 0.25 + 0.7 * (1 - k / parts);
        pen.lineWidth = wide * (name === 'pen' ? 1.5 : 1.2) * (1.6 - 0.6 * k / parts);
        trail(pen, series, at - k * length, at - (k - 1) * length, map, false);
      }
    }
    pen.globalAlpha = 1;
    const spots = Object.fromEntries(names.map((name) => [name, place(data[name], at)]));
    if (spots.pen && spots.ghost) {
      // How far the one without prediction is behind, on a ground of its own.
      pen.beginPath();
      pen.moveTo(...map(spots.pen)); pen.lineTo(...map(spots.ghost));
      pen.strokeStyle = colour.paper;
      pen.lineWidth = 2.2 * wide + 3;
      pen.stroke();
      pen.strokeStyle = colour.ghost;
      pen.lineWidth = wide;
      pen.stroke();
    }
    for (const name of names) if (spots[name]) mark(pen, name, map(spots[name]), 2 + 1.4 * wide);
  };

  const drawSheet = (at) => {
    const width = sheet.clientWidth;
    const [spanX, spanY] = [bounds.right - bounds.left, bounds.high - bounds.low];
    const scale = Math.min(width / spanX, 300 / spanY);
    const top = Math.max(60, scale * spanY), lens = Math.min(0.5 * width, 210);
    const [pen, , height] = ready(sheet, Math.round(top + lens));
    const left = (width - scale * spanX) / 2;
    drawing(pen, at, ([x, y]) => [left + (x - bounds.left) * scale, (bounds.high - y) * scale], 1.6);
    // The lens follows the pen smoothly.
    let [sumX, sumY, count] = [0, 0, 0];
    for (let k = -25; k <= 25; k += 1) {
      const spot = place(data.pen, Math.min(Math.max(0, at + k), end * data.hz));
      if (spot) { sumX += spot[0]; sumY += spot[1]; count += 1; }
    }
    if (!count) return;
    const zoom = lens / LENS_MM, [x0, y0] = [sumX / count, sumY / count];
    pen.save();
    pen.beginPath(); pen.rect(0, top, width, lens); pen.clip();
    pen.fillStyle = colour.paper;
    pen.fillRect(0, top, width, lens);
    pen.strokeStyle = colour.line; pen.lineWidth = 1;
    pen.beginPath();
    const [halfX, halfY] = [width / 2 / zoom, lens / 2 / zoom];
    for (let x = Math.ceil((x0 - halfX) / 10) * 10; x < x0 + halfX; x += 10) {
      pen.moveTo(width / 2 + (x - x0) * zoom, top); pen.lineTo(width / 2 + (x - x0) * zoom, height);
    }
    for (let y = Math.ceil((y0 - halfY) / 10) * 10; y < y0 + halfY; y += 10) {
      pen.moveTo(0, top + lens / 2 - (y - y0) * zoom); pen.lineTo(width, top + lens / 2 - (y - y0) * zoom);
    }
    pen.globalAlpha = 0.6; pen.stroke(); pen.globalAlpha = 1;
    drawing(pen, at, ([x, y]) => [width / 2 + (x - x0) * zoom, top + lens / 2 - (y - y0) * zoom], 3);
    const label = 'around the pen, lines 10 mm apart';
    pen.font = '12px system-ui, sans-serif';
    pen.fillStyle = colour.paper; pen.globalAlpha = 0.85;
    pen.fillRect(0, height - 24, pen.measureText(label).width + 16, 24);
    pen.fillStyle = colour.muted; pen.globalAlpha = 1;
    pen.fillText(label, 8, height - 9);
    pen.restore();
  };

  // The arm as seen from its side, a little from above and from the front; z points up.
  const [o, ex, ey] = data.paper;
  const onPaper = ([x, y]) => [0, 1, 2].map((k) => o[k] + ex[k] * x + ey[k] * y);
  const middle = onPaper([(bounds.left + bounds.right) / 2, (bounds.low + bounds.high) / 2]);
  const reach = Math.hypot(middle[0], middle[1]) || 1;
  const [ahead, aside] = [[middle[0] / reach, middle[1] / reach], [-middle[1] / reach, middle[0] / reach]];
  const TURN = 0.55, ABOVE = 0.32;
  const seenAt = ([x, y, z]) => {
    const along = x * ahead[0] + y * ahead[1], across = x * aside[0] + y * aside[1];
    const u = along * Math.cos(TURN) + across * Math.sin(TURN);
    const deep = across * Math.cos(TURN) - along * Math.sin(TURN);
    return [u, z * Math.cos(ABOVE) + deep * Math.sin(ABOVE)];
  };
  const corners = [[0, 2], [1, 2], [1, 3], [0, 3]].map(([x, y]) => onPaper([data.sheet[x], data.sheet[y]]));
  const joints = data.arm_joints;
  const pose = (at) => {
    const size = joints.each, index = Math.min(at / data.hz * joints.hz, joints.at.length / size - 1);
    const first = Math.floor(index), next = Math.min(first + 1, joints.at.length / size - 1);
    const points = [[0, 0, 0]];
    for (let k = 0; k < size; k += 3) {
      const point = [0, 1, 2].map((axis) => {
        const a = joints.at[first * size + k + axis], b = joints.at[next * size + k + axis];
        return a === null || b === null ? null : a + (b - a) * (index - first);
      });
      if (point.includes(null)) return null;
      points.push(point);
    }
    return points;
  };
  const frame = (() => {
    const all = corners.concat([[0, 0, 0]]).map(seenAt);
    for (let k = 0; k <= 20; k += 1) {
      const points = pose(k / 20 * end * data.hz);
      if (points) all.push(...points.map(seenAt));
    }
    const [us, vs] = [all.map((p) => p[0]), all.map((p) => p[1])];
    return { u: [Math.min(...us), Math.max(...us)], v: [Math.min(...vs), Math.max(...vs)] };
  })();

  const drawSide = (at) => {
    const beside = side.offsetTop < sheet.offsetTop + sheet.clientHeight / 2;
    const [pen, width, height] = ready(side, beside ? sheet.clientHeight : Math.round(0.75 * side.clientWidth));
    const pad = 26;
    const [spanU, spanV] = [frame.u[1] - frame.u[0], frame.v[1] - frame.v[0]];
    const scale = Math.min((width - 2 * pad) / spanU, (height - 2 * pad) / spanV);
    const left = (width - scale * spanU) / 2, base = (height + scale * spanV) / 2;
    const map = (point) => {
      const [u, v] = seenAt(point);
      return [left + (u - frame.u[0]) * scale, base - (v - frame.v[0]) * scale];
    };
    pen.beginPath();
    corners.map(map).forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
    pen.fillStyle = colour.paper; pen.fill();
    pen.strokeStyle = colour.line; pen.lineWidth = 1; pen.stroke();
    for (const name of names) {
      pen.strokeStyle = colour[name];
      pen.lineWidth = 1.4;
      pen.globalAlpha = 0.8;
      trail(pen, data[name], at - INK_S * data.hz, at, (spot) => map(onPaper(spot)), true);
    }
    pen.globalAlpha = 1;
    const points = pose(at);
    if (points) {
      const flat = points.map(map);
      const line = (list, thick, tint) => {
        pen.strokeStyle = tint; pen.lineWidth = thick;
        pen.beginPath();
        list.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        pen.stroke();
      };
      const thick = Math.max(6, 0.09 * 1000 * scale);
      line(flat.slice(0, -1), thick, colour.muted);
      line(flat.slice(-2), 3, colour.arm);
      pen.fillStyle = colour.paper;
      for (const [x, y] of flat.slice(1, -1)) {
        pen.beginPath(); pen.arc(x, y, 0.24 * thick, 0, 2 * Math.PI); pen.fill();
      }
    }
    for (const name of names) {
      const spot = place(data[name], at);
      if (spot && name !== 'arm') mark(pen, name, map(onPaper(spot)), 2.6);
    }
  };

  // Root mean square distance from the pen over the last second of writing [mm]; null if it did not write.
  const off = (series, at) => {
    let [sum, count] = [0, 0];
    for (let k = Math.max(0, Math.ceil(at - data.hz)); k <= at; k += 1) {
      const [a, b] = [place(series, k), place(data.pen, k)];
      if (a && b && down(data.pen, k)) { sum += (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2; count += 1; }
    }
    return count ? Math.sqrt(sum / count) : null;
  };
  const words = (name, at) => {
    const mm = off(data[name], at);
    return mm === null ? '' : `${mm.toFixed(1)} mm off`;
  };

  const draw = () => {
    const at = Math.min(now, end) * data.hz;
    drawSheet(at);
    drawSide(at);
    slider.value = now;
    slider.setAttribute('aria-valuetext', `${now.toFixed(1)} of ${end.toFixed(1)} seconds`);
    clock.textContent = `${(data.from + now).toFixed(1)} s`;
    // Four times a second can be read.
    if (Math.abs(now - told) >= 0.25) {
      told = now;
      for (const place of gap.querySelectorAll('[data-name]')) place.textContent = words(place.dataset.name, at);
    }
  };

  const tick = (time) => {
    if (!playing) return;
    // A page that was hidden goes on where it was.
    now += rate * Math.min((time - before) / 1000, 0.1);
    before = time;
    if (now > end) now = 0;
    if (seen) draw();
    waiting = requestAnimationFrame(tick);
  };
  const set = (wanted) => {
    playing = wanted;
    play.textContent = playing ? 'Pause' : 'Play';
    // One that waits from before would make a second clock.
    cancelAnimationFrame(waiting);
    if (playing) waiting = requestAnimationFrame((time) => { before = time; tick(time); });
  };

  slider.max = end;
  play.addEventListener('click', () => set(!playing));
  slow.addEventListener('click', () => {
    rate = rate === 1 ? 0.2 : 1;
    slow.setAttribute('aria-pressed', String(rate !== 1));
  });
  slider.addEventListener('input', () => { set(false); now = Number(slider.value); draw(); });
  window.addEventListener('resize', draw);
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { colours(); draw(); });
  if ('IntersectionObserver' in window) {
    new IntersectionObserver((found) => { seen = found[found.length - 1].isIntersecting; }).observe(root);
  }
  colours();
  draw();
  if (!window.matchMedia('(prefers-reduced-motion: reduce)').matches) { now = 0; set(true); }
})();
