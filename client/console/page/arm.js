// The arm in space: the capsules that the clearance uses, the paper, what is kept out, and the traces.

import * as three from "./three.js";

const TRACE = 3000;
// No hand goes further between two points of the traces, a hundredth of a second [m].
const LEAP = 0.02;
const UP = new three.Vector3(0, 1, 0);

export class Arm {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new three.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.world = new three.Scene();
    this.camera = new three.PerspectiveCamera(40, 1, 0.05, 10);
    this.camera.up.set(0, 0, 1);
    this.orbit = new three.OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.ask());
    this.world.add(new three.AmbientLight(0xffffff, 1.4));
    const sun = new three.DirectionalLight(0xffffff, 2.2);
    sun.position.set(1, -2, 3);
    this.world.add(sun);
    this.stage = new three.Group();
    this.world.add(this.stage);
    this.tick = 0;
    this.mode = "orbit";
    this.drawn = 0;
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.colours(); this.ask(); });
  }

  scene(scene) {
    // A page that connects again keeps its traces.
    const same = JSON.stringify(scene);
    if (same === this.told) return;
    this.told = same;
    this.stage.clear();
    this.plane = scene.plane;
    this.radii = scene.radii;
    this.links = this.radii.map((radius) => {
      const mesh = new three.Mesh(new three.CapsuleGeometry(radius, 1, 6, 16), new three.MeshLambertMaterial());
      this.stage.add(mesh);
      return mesh;
    });
    this.drawTable();
    for (const box of scene.keep_out.boxes) this.drawBox(box);
    for (const plane of scene.keep_out.planes ?? []) this.drawPlane(plane);
    // Where the preview leads, with the radius in which the pen is expected.
    this.aim = new three.LineLoop(new three.BufferGeometry().setFromPoints(Array.from({ length: 32 }, (_, i) =>
      new three.Vector3(Math.cos(i * Math.PI / 16), Math.sin(i * Math.PI / 16), 0))), new three.LineBasicMaterial());
    const [ax, ay, az] = this.plane.axes.map((axis) => new three.Vector3(...axis));
    this.aim.quaternion.setFromRotationMatrix(new three.Matrix4().makeBasis(ax, ay, az));
    this.aim.visible = false;
    this.stage.add(this.aim);
    // The previewed path, on the paper, from the ring on.
    this.path = this.line();
    this.traces = { pen: this.line(), tool: this.line(), ghost: this.line() };
    this.tip = new three.Mesh(new three.SphereGeometry(0.004), new three.MeshBasicMaterial());
    this.stage.add(this.tip);
    this.place(scene.home);
    this.colours();
    this.view(this.mode);
  }

  at(x, y, z) {
    const [ax, ay, az] = this.plane.axes;
    const o = this.plane.origin;
    return new three.Vector3(...[0, 1, 2].map((i) => o[i] + x * ax[i] + y * ay[i] + z * az[i]));
  }

  drawTable() {
    const [[x0, x1], [y0, y1]] = this.plane.workspace;
    const corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(([x, y]) => this.at(x, y, 0));
    const paper = new three.BufferGeometry().setFromPoints([0, 1, 2, 0, 2, 3].map((i) => corners[i]));
    paper.computeVertexNormals();
    // Drawn first and without depth: what is written on it lies above it at any distance.
    this.sheet = new three.Mesh(paper, new three.MeshBasicMaterial({ side: three.DoubleSide, depthWrite: false }));
    this.sheet.renderOrder = -1;
    this.stage.add(this.sheet);
    this.border = new three.LineLoop(new three.BufferGeometry().setFromPoints(corners), new three.LineBasicMaterial());
    this.stage.add(this.border);
    const lines = [];
    for (let i = -10; i <= 10; i += 1) lines.push([i / 10, -1, 0], [i / 10, 1, 0], [-1, i / 10, 0], [1, i / 10, 0]);
    const below = new three.BufferGeometry().setFromPoints(lines.map((p) => new three.Vector3(...p)));
    this.grid = new three.LineSegments(below, new three.LineBasicMaterial({ transparent: true, opacity: 0.5 }));
    this.stage.add(this.grid);
  }

  drawBox({ centre, size, axes }) {
    const material = new three.MeshLambertMaterial({ color: 0xc22727, transparent: true, opacity: 0.25 });
    const box = new three.Mesh(new three.BoxGeometry(...size), material);
    const [x, y, z] = axes.map((axis) => new three.Vector3(...axis));
    box.quaternion.setFromRotationMatrix(new three.Matrix4().makeBasis(x, y, z));
    box.position.set(...centre);
    this.stage.add(box);
  }

  // A piece of a plane about its point; what lies behind its normal is kept out.
  drawPlane([point, normal]) {
    const material = new three.MeshBasicMaterial({ color: 0xc22727, transparent: true, opacity: 0.12, side: three.DoubleSide, depthWrite: false });
    const plane = new three.Mesh(new three.BoxGeometry(2, 2, 0.001), material);
    plane.quaternion.setFromUnitVectors(new three.Vector3(0, 0, 1), new three.Vector3(...normal).normalize());
    plane.position.set(...point);
    this.stage.add(plane);
    this.planes = (this.planes ?? 0) + 1;
  }

  line() {
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(3 * TRACE), 3).setUsage(three.DynamicDrawUsage));
    geometry.setDrawRange(0, 0);
    const line = new three.LineSegments(geometry, new three.LineBasicMaterial());
    line.frustumCulled = false;
    line.points = [];
    this.stage.add(line);
    return line;
  }

  colours() {
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => new three.Color(css.getPropertyValue(name).trim());
    if (!this.links) return;
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    for (const link of this.links) link.material.color = new three.Color(dark ? 0x8fa3b5 : 0xb9c4ce);
    for (const name of ["pen", "tool", "ghost"]) this.traces[name].material.color = colour(`--${name}`);
    this.tip.material.color = colour("--tool");
    this.aim.material.color = colour("--aim");
    this.path.material.color = colour("--aim");
    this.sheet.material.color = new three.Color(dark ? 0x2a3036 : 0xffffff);
    this.border.material.color = colour("--soft");
    this.grid.material.color = colour("--line");
  }

  place(capsules) {
    const [a, b, along] = [new three.Vector3(), new three.Vector3(), new three.Vector3()];
    capsules.forEach(([ax, ay, az, bx, by, bz], index) => {
      const link = this.links[index];
      if (!link) return;
      a.set(ax, ay, az);
      b.set(bx, by, bz);
      along.subVectors(b, a);
      const length = along.length();
      link.position.addVectors(a, b).multiplyScalar(0.5);
      if (length > 1e-6) link.quaternion.setFromUnitVectors(UP, along.divideScalar(length));
      // The capsule's middle part is 1 m long; its round ends keep their radius.
      this.stretch(link, index, length);
    });
  }

  stretch(link, index, length) {
    if (link.length !== undefined && Math.abs(link.length - length) < 1e-4) return;
    link.length = length;
    link.geometry.dispose();
    link.geometry = new three.CapsuleGeometry(this.radii[index], length, 6, 16);
  }

  frame({ arm, points }) {
    if (!this.links) return;
    if (arm) this.place(arm.known ? arm.measured : arm.commanded);
    this.aim.visible = Boolean(arm?.aim);
    if (arm?.aim) {
      const [x, y, band] = arm.aim;
      this.aim.position.copy(this.at(x, y, 0.001));
      this.aim.scale.setScalar(Math.max(band ?? 0, 0.001));
    }
    this.path.points = [];
    this.path.before = null;
    this.path.geometry.setDrawRange(0, 0);
    for (const [x, y] of arm?.aim ? [arm.aim, ...arm.path] : []) this.add(this.path, this.at(x, y, 0.0012), true);
    const newest = points.length ? points[points.length - 1][0] : 0;
    // Another daemon counts from 1 again.
    if (newest && newest < this.tick) this.tick = 0;
    for (const [tick, px, py, flags, tx, ty, tz, gx, gy] of points) {
      if (tick <= this.tick) continue;
      // A gap in what was heard is a gap in the line.
      const whole = tick - this.tick <= 60;
      this.tick = tick;
      const writes = tz < 0.002 && whole;
      // Another hand begins elsewhere.
      const near = this.pen && Math.hypot(px - this.pen[0], py - this.pen[1]) < LEAP;
      this.pen = [px, py];
      this.add(this.traces.pen, this.at(px, py, 0.0005), (flags & 1) === 1 && whole && near);
      this.add(this.traces.tool, this.at(tx, ty, 0.001), writes);
      this.add(this.traces.ghost, this.at(gx, gy, 0.0002), writes && (gx !== 0 || gy !== 0));
      this.tip.position.copy(this.at(tx, ty, tz));
    }
    if (this.mode === "follow") this.orbit.target.lerp(this.tip.position, 0.1);
    this.ask();
  }

  // Pairs of points are segments; a lifted pen leaves a gap.
  add(line, point, writes) {
    if (writes && line.before) {
      line.points.push(line.before, point);
      if (line.points.length > TRACE) line.points.splice(0, line.points.length - TRACE);
      const position = line.geometry.getAttribute("position");
      line.points.forEach((p, index) => position.setXYZ(index, p.x, p.y, p.z));
      position.needsUpdate = true;
      line.geometry.setDrawRange(0, line.points.length);
    }
    line.before = writes ? point : null;
  }

  view(mode) {
    this.mode = mode;
    if (!this.plane) return;
    const middle = this.at(0, 0, 0);
    const [x, y, z] = this.plane.axes.map((axis) => new three.Vector3(...axis));
    if (mode === "top") {
      this.camera.up.copy(y);
      this.camera.position.copy(middle).addScaledVector(z, 0.45);
      this.orbit.target.copy(middle);
    } else if (mode === "follow") {
      this.camera.up.set(0, 0, 1);
      this.camera.position.copy(middle).addScaledVector(x, 0.12).addScaledVector(y, -0.25).addScaledVector(z, 0.22);
      this.orbit.target.copy(middle);
    } else {
      this.camera.up.set(0, 0, 1);
      const base = new three.Vector3(0, 0, 0.25).addScaledVector(middle, 0.5);
      const aside = new three.Vector3().crossVectors(middle, z).normalize();
      this.camera.position.copy(base).addScaledVector(aside, 1.3).addScaledVector(middle, 0.8).add(new three.Vector3(0, 0, 0.6));
      this.orbit.target.copy(base);
    }
    this.orbit.update();
    this.ask();
  }

  // Pictures take a third of the time at most: where they are slow, the pad and the held button come first.
  ask() {
    if (this.asked) return;
    this.asked = true;
    const draw = () => requestAnimationFrame((began) => {
      this.draw();
      requestAnimationFrame((next) => {
        this.cost = 0.7 * (this.cost ?? 0) + 0.3 * (next - began);
        this.next = next + (this.cost > 25 ? 2 * this.cost : 0);
        this.asked = false;
      });
    });
    setTimeout(draw, Math.max(0, (this.next ?? 0) - performance.now()));
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    // Out of sight, as on a phone that shows the pad: its time belongs to the held button.
    const { top, bottom } = this.canvas.getBoundingClientRect();
    if (bottom <= 0 || top >= innerHeight) return;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    if (this.size !== `${width} ${height} ${ratio}`) {
      this.size = `${width} ${height} ${ratio}`;
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
    }
    this.renderer.render(this.world, this.camera);
    this.drawn += 1;
  }
}
