// Draws mechanisms as stiction.scenes.pictures.parts describes them, and moves them.
"use strict";

// A canvas as large as its element, in pixels of the screen: its context in CSS pixels, width, height, colours of the page by name.
function prepared(canvas) {
  const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio || 1];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d"), style = getComputedStyle(canvas);
  context.scale(ratio, ratio);
  context.font = "12px system-ui, sans-serif";
  return {context, width, height, color: name => style.getPropertyValue("--" + name).trim()};
}

const HEAD = 7;  // px, of an arrow
const LEAST_UNIT = 6;  // px of a symbol, below which words would lie on each other

function trace(context, points) {
  context.beginPath();
  points.forEach(([x, y], i) => i ? context.lineTo(x, y) : context.moveTo(x, y));
}

function drawHead(context, [x, y], tip) {
  const angle = Math.atan2(tip[1] - y, tip[0] - x), side = turn => [tip[0] - HEAD * Math.cos(angle + turn), tip[1] - HEAD * Math.sin(angle + turn)];
  trace(context, [tip, side(0.4), side(-0.4)]);
  context.fill();
}

function drawStroke(context, points, look, color) {
  context.strokeStyle = context.fillStyle = look.line ? color(look.line) : "transparent";
  context.lineWidth = look.width * 4 / 3;  // points to pixels
  context.lineCap = "round";
  trace(context, points);
  if (look.fill) {
    context.closePath();
    context.fillStyle = color(look.fill);
    context.fill();
    if (look.hatched) hatch(context, points, color("quiet"));
  }
  if (look.line) context.stroke();
  context.fillStyle = context.strokeStyle;
  if (look.arrow) drawHead(context, points.at(-2), points.at(-1));
  if (look.arrow === "both") drawHead(context, points[1], points[0]);
}

function hatch(context, points, color) {
  const [x, y] = [0, 1].map(i => points.map(point => point[i])), [low, high] = [Math.min(...y), Math.max(...y)], rise = high - low;
  context.save();
  context.clip();
  context.beginPath();
  for (let at = Math.min(...x) - rise; at < Math.max(...x); at += 6) { context.moveTo(at, high); context.lineTo(at + rise, low); }
  context.strokeStyle = color;
  context.lineWidth = 0.7;
  context.stroke();
  context.restore();
}

// Draws {x, y, unit, longest, bodies, looks, parts}; value(column) is the number of a column at the time shown; largest: the force, N, of the longest arrow.
function drawMechanism(canvas, mechanism, value, largest) {
  const {context, width, height, color} = prepared(canvas), {x, y, unit, looks} = mechanism;
  const scale = Math.min(width / (x[1] - x[0]), height / (y[1] - y[0]));
  const screen = ([px, py]) => [width / 2 + scale * (px - (x[0] + x[1]) / 2), height / 2 - scale * (py - (y[0] + y[1]) / 2)];
  const poses = {ground: {x: 0, y: 0, angle: 0}};
  for (const body of mechanism.bodies) poses[body] = {x: value(body + ".x"), y: value(body + ".y"), angle: value(body + ".angle")};
  const turned = (body, [px, py]) => {
    const [c, s] = [Math.cos(poses[body].angle), Math.sin(poses[body].angle)];
    return [c * px - s * py, s * px + c * py];
  };
  const sum = (a, b, factor = 1) => [a[0] + factor * b[0], a[1] + factor * b[1]];
  const placed = (body, point) => sum([poses[body].x, poses[body].y], turned(body, point));
  const fixed = (part, point) => sum(placed(...part.at), turned(part.axes, point));

  function linked(part) {
    let [first, second] = part.ends.map((point, i) => placed(part.bodies[i], point));
    if (part.axis) {
      const long = Math.hypot(...part.axis), along = turned(part.bodies[1], part.axis).map(part => part / long);
      const reach = (first[0] - second[0]) * along[0] + (first[1] - second[1]) * along[1];
      first = sum(second, along, Math.abs(reach) < unit && looks[part.look].arrow ? 4 * unit : reach);
    }
    const way = sum(first, second, -1), length = Math.hypot(...way) || 1, across = [-way[1] / length, way[0] / length];
    return part.points.map(([share, beside]) => sum(sum(second, way, share), across, beside));
  }

  context.textBaseline = "middle";
  for (const part of mechanism.parts) {
    if (part.kind === "label") {
      if (unit * scale < LEAST_UNIT) continue;
      const name = mechanism.bodies.includes(part.text);
      context.font = `${name ? "italic " : ""}11px system-ui, sans-serif`;
      context.textAlign = name ? "left" : "center";
      context.fillStyle = color("text");
      context.fillText(part.text, ...screen(fixed(part, part.point)));
    } else if (part.kind === "force") {
      const length = Math.min(2, (value(part.column) || 0) / largest) * mechanism.longest, end = fixed(part, part.corner);
      if (Math.abs(length) * scale > 0.5) drawStroke(context, [sum(end, turned(part.axes, part.direction), -length), end].map(screen), looks["corner force"], color);
    } else if (part.kind === "link") {
      drawStroke(context, linked(part).map(screen), looks[part.look], color);
    } else if (!part.sign || value("load " + part.sign[0]) === part.sign[1]) {
      drawStroke(context, part.points.map(point => screen(fixed(part, point))), looks[part.look], color);
    }
  }
  if (mechanism.parts.some(part => part.kind === "force")) {  // the scale of the arrows
    const round = 10 ** Math.floor(Math.log10(largest)), force = [5, 2, 1].find(digit => digit * round <= largest) * round;
    const from = [10, height - 10], to = [10 + force / largest * mechanism.longest * scale, height - 10];
    drawStroke(context, [from, to], looks["corner force"], color);
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillStyle = color("text");
    context.fillText(`corner forces: ${+force.toPrecision(1)} N`, to[0] + 6, to[1]);
  }
}

// The controls of an element of film_controls(): a time that plays, and a mechanism that follows it.
class Film {
  constructor(element, changed) {
    Object.assign(this, {changed, time: 0, playing: false});
    const find = selector => element.querySelector(selector);
    [this.canvas, this.play, this.range, this.speed, this.output] = ["canvas", ".play", "input", "select", "output"].map(find);
    this.play.addEventListener("click", () => this.toggle());
    find(".back").addEventListener("click", () => this.move(-1));
    find(".on").addEventListener("click", () => this.move(1));
    this.range.addEventListener("input", () => { this.pause(); this.show(+this.range.value); });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // Shows a run: its mechanism, name, times and columns by name; largest: the force, N, of the longest arrow.
  load({mechanism, name, t, columns, largest}) {
    Object.assign(this, {mechanism, name, t, columns, largest});
    this.canvas.style.aspectRatio = (mechanism.x[1] - mechanism.x[0]) / (mechanism.y[1] - mechanism.y[0]);
    this.range.max = t.at(-1);
    this.show(Math.min(this.time, t.at(-1)));
  }

  value(column) {  // straight between two samples; signs of loads keep
    const values = this.columns[column];
    if (!values) return NaN;
    const row = rowAt(this.t, this.time), next = Math.min(row + 1, this.t.length - 1);
    if (next === row || column.startsWith("load ")) return values[row];
    return values[row] + (this.time - this.t[row]) / (this.t[next] - this.t[row]) * (values[next] - values[row]);
  }

  show(time) {
    this.time = Math.max(0, Math.min(time, this.t.at(-1)));
    this.range.value = this.time;
    this.range.setAttribute("aria-valuetext", `${this.time.toFixed(3)} s`);
    this.output.textContent = `t = ${this.time.toFixed(3)} s`;
    this.draw();
    this.changed?.(this.time);
  }

  draw() {
    if (!this.mechanism || !this.canvas.clientWidth) return;
    drawMechanism(this.canvas, this.mechanism, column => this.value(column), this.largest);
    this.canvas.setAttribute("aria-label", `${this.mechanism.name}, ${this.name}: the mechanism at ${this.time.toFixed(3)} s, corner forces as arrows`);
  }

  move(samples) {
    this.pause();
    let row = Math.max(0, Math.min(rowAt(this.t, this.time + 1e-9) + samples, this.t.length - 1));
    while (samples > 0 && row < this.t.length - 1 && this.t[row] <= this.time + 1e-9) row++;  // both sides of an event have one time
    this.show(this.t[row]);
  }

  toggle() {
    if (this.playing) { this.pause(); return; }
    this.playing = true;
    this.mark();
    if (this.time >= this.t.at(-1)) this.time = 0;
    let before;
    const step = now => {
      if (!this.playing) return;
      this.show(this.time + (before === undefined ? 0 : (now - before) / 1000 * this.speed.value));
      before = now;
      if (this.time >= this.t.at(-1)) this.pause(); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.mark();
    this.changed?.(this.time);
  }

  mark() {
    this.play.textContent = this.playing ? "❚❚" : "▶";
    this.play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }

  // Space and arrows, of an event within the part of the page that this film belongs to.
  key(event) {
    const {target, key} = event, busy = target.closest("select, button, summary, a, input:not([type=range])");
    if (event.ctrlKey || event.altKey || event.metaKey || busy && (key === " " || busy.matches("select"))) return;
    if (key === " ") this.toggle();
    else if (key === "ArrowLeft" || key === "ArrowRight") this.move((key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 10 : 1));
    else return;
    event.preventDefault();
  }
}
