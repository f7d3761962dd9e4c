// The sheet as a picture: the traces of hand, tool and ghost, on a canvas or as lines in millimetres.

// Strokes that nothing followed are dim and dashed, so that nobody takes them for followed ones.
const DIM = 0.65;
const DASH = [5, 4];
const SIDE_PX = 2400;
const WORDS = "not followed";

// Which points are drawn how, from the lowest to the uppermost.
const layers = ({ ghost, tool, ink }) => [
  { points: ghost, colour: "--ghost", thick: 1 },
  { points: tool, colour: "--tool", thick: 2 },
  { points: ink, colour: "--soft", thick: 1.5, followed: false },
  { points: ink, colour: "--pen", thick: 2, followed: true },
];

// The pieces of a trace, each a list of places; a lifted pen leaves a gap.
export function pieces(points, followed) {
  const found = [];
  let before = null;
  let piece = null;
  for (const [x, y, contact, was] of points) {
    const drawn = contact && before && (followed === undefined || was === followed);
    if (drawn && !piece) found.push(piece = [before]);
    if (drawn) piece.push([x, y]);
    else piece = null;
    before = contact ? [x, y] : null;
  }
  return found;
}

// Draws the traces on a canvas; `at` places metres of the plane on it, `times` widens the lines.
export function paint(pen, traces, at, colour, times = 1) {
  for (const { points, colour: name, thick, followed } of layers(traces)) {
    const lost = followed === false;
    pen.strokeStyle = colour(name);
    pen.lineWidth = thick * times;
    pen.globalAlpha = lost ? DIM : 1;
    pen.setLineDash(lost ? DASH.map((px) => px * times) : []);
    pen.beginPath();
    let down = false;
    let inside = false;
    let begin = null;
    for (const [x, y, contact, was] of points) {
      const [px, py] = at(x, y);
      const wanted = contact && (followed === undefined || was === followed);
      if (wanted && down) pen.lineTo(px, py);
      else pen.moveTo(px, py);
      if (wanted && !inside) begin = [px, py];
      inside = wanted;
      down = contact;
    }
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
    if (lost && begin) {
      pen.fillStyle = colour(name);
      pen.font = `${12 * times}px system-ui, sans-serif`;
      pen.textAlign = "left";
      pen.fillText(WORDS, begin[0] + 6 * times, begin[1] - 6 * times);
    }
  }
}

// The sheet as SVG: as large as the paper, one unit a millimetre.
export function svg(traces, [[x0, x1], [y0, y1]], colour) {
  const mm = (m) => Number((1000 * m).toFixed(3));
  const [width, height] = [mm(x1 - x0), mm(y1 - y0)];
  const place = ([x, y]) => `${mm(x - x0)} ${mm(y1 - y)}`;
  const lines = layers(traces).map(({ points, colour: name, thick, followed }) => {
    const way = pieces(points, followed).map((piece) => `M${piece.map(place).join("L")}`).join("");
    const lost = followed === false ? ` stroke-dasharray="1.3 1" opacity="${DIM}"` : "";
    const title = { "--ghost": "feedback alone", "--tool": "tool", "--soft": `hand, ${WORDS}`, "--pen": "hand" }[name];
    return way && `<path d="${way}" stroke="${colour(name)}" stroke-width="${thick / 5}"${lost}><title>${title}</title></path>`;
  });
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}mm" height="${height}mm" viewBox="0 0 ${width} ${height}">\n`
    + `<rect width="${width}" height="${height}" fill="${colour("--sheet")}"/>\n`
    + `<g fill="none" stroke-linecap="round" stroke-linejoin="round">\n${lines.filter(Boolean).join("\n")}\n</g>\n</svg>\n`;
}

// The sheet as PNG, of the same shape.
export function png(traces, [[x0, x1], [y0, y1]], colour) {
  const scale = SIDE_PX / Math.max(x1 - x0, y1 - y0);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [Math.round((x1 - x0) * scale), Math.round((y1 - y0) * scale)];
  const pen = canvas.getContext("2d");
  pen.fillStyle = colour("--sheet");
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.lineCap = pen.lineJoin = "round";
  paint(pen, traces, (x, y) => [(x - x0) * scale, (y1 - y) * scale], colour, SIDE_PX / 600);
  return new Promise((done) => { canvas.toBlob(done, "image/png"); });
}

// Hands a file to the browser, which asks or keeps it as it does with all others.
export function save(blob, ending) {
  const now = new Date(Date.now() - 60000 * new Date().getTimezoneOffset()).toISOString().slice(0, 19).replaceAll(":", "-");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = `foretrace-${now}.${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  return link.download;
}
