// Panels of lines below each other that share one axis: zoom by dragging, a cursor with the names and values of all lines, names that hide and show.
"use strict";

const ROOM = {left: 62, right: 10, top: 6, bottom: 22};  // px around the lines of a panel
const FLAG = "#d00000";  // of what has become worse
const LEAST_DRAG = 8;  // px; less is a click

// Round numbers within a range, about so many; for logarithms whole decades.
function ticks([low, high], count, whole) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  let step = [1, 2, 5, 10].find(factor => factor * power >= rough) * power;
  if (whole) step = Math.max(1, Math.ceil(step));
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push({at: i * step, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9))});
  return found;
}

const SUPERSCRIPTS = Object.fromEntries([..."-0123456789"].map((sign, i) => [sign, [..."⁻⁰¹²³⁴⁵⁶⁷⁸⁹"][i]]));
const powerOfTen = power => "10" + [...String(power)].map(sign => SUPERSCRIPTS[sign]).join("");
const shortNumber = (value, digits) => Math.abs(value) >= 1e5 || digits > 4 ? value.toExponential(1).replace("e+", "e") : value.toFixed(digits);

class Chart {
  // view: {x: {label, range, names?, short?}, modes: [{name, panels: [{label, log, range}]}], series: [{name, color, dash, marker, shown, about?, flags?, x: [..], y: [[..]], error?}],
  // shades}; x and y are places in `columns`, by mode and panel.
  constructor(element, view, columns, moved) {
    Object.assign(this, {element, view, columns, moved, cursor: null});
    this.legend = element.querySelector(".legend");
    this.panels = element.querySelector(".panels");
    this.shown = view.series.map(series => series.shown);
    this.fillLegend();
    this.setMode(0);
    this.observer = new ResizeObserver(() => this.draw());
    this.observer.observe(this.panels);
  }

  close() { this.observer.disconnect(); }  // another chart takes its element

  get mode() { return this.view.modes[this.modeNumber]; }

  setMode(number) {
    this.modeNumber = number;
    this.panels.replaceChildren(...this.mode.panels.map((panel, place) => this.makePanel(panel, place)));
    this.reset();
  }

  reset() {
    this.range = [...this.view.x.range];
    this.ranges = this.mode.panels.map(panel => [...panel.range]);
    this.draw();
  }

  zoom(factor) {
    const centre = this.cursor ?? (this.range[0] + this.range[1]) / 2, [low, high] = this.view.x.range;
    this.range = this.range.map((end, i) => Math.max(low, Math.min(high, centre + (end - centre) / factor)));
    this.draw();
  }

  makePanel(panel, place) {
    const box = document.createElement("div"), title = document.createElement("div"), canvas = document.createElement("canvas");
    box.className = "panel";
    title.className = "title";
    title.textContent = panel.label;
    canvas.setAttribute("role", "img");
    box.append(title, canvas);
    this.listen(canvas, place);
    return box;
  }

  fillLegend() {
    this.legend.replaceChildren(...this.view.series.map((series, i) => {
      const label = document.createElement("label"), box = document.createElement("input"), sample = document.createElement("canvas");
      box.type = "checkbox";
      box.checked = series.shown;
      box.addEventListener("change", () => { this.shown[i] = box.checked; this.draw(); });
      sample.className = "sample";
      label.append(box, sample, series.name);
      return label;
    }));
  }

  scales(canvas, place) {
    const [width, height] = [canvas.clientWidth - ROOM.left - ROOM.right, canvas.clientHeight - ROOM.top - ROOM.bottom], [low, high] = this.ranges[place];
    return {
      width, height, x: value => ROOM.left + width * (value - this.range[0]) / (this.range[1] - this.range[0]),
      y: value => ROOM.top + height * (high - value) / (high - low),
      time: px => this.range[0] + (px - ROOM.left) / width * (this.range[1] - this.range[0]),
      value: px => high - (px - ROOM.top) / height * (high - low)};
  }

  series(place) {  // what can be seen in a panel: [series, its x, its y, its error]
    const mode = this.modeNumber;
    return this.view.series.flatMap((series, i) => this.shown[i] && series.y[mode]?.[place] != null
      ? [[series, this.columns[series.x[mode]], this.columns[series.y[mode][place]], this.columns[series.error?.[mode]?.[place]]]] : []);
  }

  draw() {
    if (!this.panels.clientWidth) return;
    [...this.legend.querySelectorAll("canvas")].forEach((sample, i) => this.drawSample(sample, this.view.series[i]));
    [...this.panels.children].forEach((box, place) => this.drawPanel(box.querySelector("canvas"), place));
    this.mark(this.cursor);
  }

  stroke(context, series, color) {
    context.strokeStyle = context.fillStyle = series.color === "ink" ? color("ink") : series.color;
    context.lineWidth = 1.5;
    context.setLineDash(series.dash);
    context.beginPath();
  }

  drawSample(canvas, series) {
    const {context, width, height, color} = prepared(canvas);
    this.stroke(context, series, color);
    context.moveTo(0, height / 2);
    context.lineTo(width, height / 2);
    context.stroke();
    if (series.marker) context.fillRect(width / 2 - 2.5, height / 2 - 2.5, 5, 5);
  }

  drawPanel(canvas, place) {
    const {context, color} = prepared(canvas), {width, height, x, y} = this.scales(canvas, place), panel = this.mode.panels[place];
    this.drawAxes(context, color, place, {width, height, x, y});
    context.save();
    context.beginPath();
    context.rect(ROOM.left, ROOM.top, width, height);
    context.clip();
    context.fillStyle = color("veil");
    for (const [from, to] of this.view.shades) context.fillRect(x(from), ROOM.top, x(to) - x(from), height);
    const drawn = this.series(place);
    for (const [series, times, values, errors] of drawn.reverse()) {  // what comes first is on top
      this.stroke(context, series, color);
      const last = Math.min(rowAt(times, this.range[1]) + 1, times.length - 1);
      let pen = false;
      for (let i = Math.max(rowAt(times, this.range[0]) - 1, 0); i <= last; i++) {
        if (Number.isNaN(values[i])) { pen = false; continue; }
        if (pen) context.lineTo(x(times[i]), y(values[i])); else context.moveTo(x(times[i]), y(values[i]));
        pen = true;
        if (errors && errors[i] > 0) { context.moveTo(x(times[i]), y(values[i] - errors[i])); context.lineTo(x(times[i]), y(values[i] + errors[i])); context.moveTo(x(times[i]), y(values[i])); }
      }
      context.stroke();
      if (series.marker) for (let i = 0; i < times.length; i++) if (!Number.isNaN(values[i])) context.fillRect(x(times[i]) - 2.5, y(values[i]) - 2.5, 5, 5);
      this.drawFlags(context, series, times, values, x, value => Number.isNaN(value) ? ROOM.top + height - 8 : y(value));
    }
    context.restore();
    const [from, to] = this.range.map(end => this.view.x.names?.[Math.round(end)] ?? +end.toPrecision(6));
    canvas.setAttribute("aria-label", `${panel.label} over ${this.view.x.label} from ${from} to ${to}: ${drawn.map(([series]) => series.name).reverse().join("; ")}`);
  }

  // Red rings around the samples that a series is flagged at; at the lower edge where there is no value.
  drawFlags(context, series, times, values, x, y) {
    context.strokeStyle = FLAG;
    context.lineWidth = 2;
    context.setLineDash([]);
    for (const i of series.flags ?? []) {
      context.beginPath();
      context.arc(x(times[i]), y(values[i]), 7, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  drawAxes(context, color, place, {width, height, x, y}) {
    const panel = this.mode.panels[place], names = this.view.x.names, bottom = ROOM.top + height;
    context.lineWidth = 1;
    context.strokeStyle = color("line");
    context.fillStyle = color("text");
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const {at, digits} of ticks(this.ranges[place], 4, panel.log)) {
      context.beginPath();
      context.moveTo(ROOM.left, y(at));
      context.lineTo(ROOM.left + width, y(at));
      context.stroke();
      context.fillText(panel.log ? powerOfTen(Math.round(at)) : shortNumber(at, digits), ROOM.left - 6, y(at));
    }
    context.textBaseline = "top";
    for (const {at, digits} of ticks(this.range, Math.max(2, Math.min(names ? names.length : 12, width / 90)), names)) {
      context.beginPath();
      context.moveTo(x(at), ROOM.top);
      context.lineTo(x(at), bottom + 4);
      context.stroke();
      context.textAlign = x(at) > ROOM.left + width - 20 ? "right" : "center";
      context.fillText(names ? ((this.view.x.short ?? names)[at] ?? "") : shortNumber(at, digits), x(at), bottom + 6);
    }
    context.strokeStyle = color("quiet");
    context.strokeRect(ROOM.left, ROOM.top, width, height);
  }

  listen(canvas, place) {
    let start = null;
    const inside = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    canvas.addEventListener("pointerdown", event => {
      this.point(place, inside(event)[0], true);
      if (event.pointerType !== "touch" && event.button === 0) { start = inside(event); canvas.setPointerCapture(event.pointerId); }
    });
    canvas.addEventListener("pointermove", event => {
      this.point(place, inside(event)[0], event.pointerType === "touch");
      if (start) this.band(canvas, start, inside(event));
    });
    canvas.addEventListener("pointerup", event => {
      if (start) this.release(canvas, place, start, inside(event));
      start = null;
    });
    canvas.addEventListener("pointerleave", () => this.element.querySelector(".tip")?.remove());
    canvas.addEventListener("dblclick", () => this.reset());
  }

  band(canvas, from, to) {
    this.drawPanel(canvas, [...this.panels.children].indexOf(canvas.parentElement));
    const context = canvas.getContext("2d"), high = Math.abs(to[1] - from[1]) < LEAST_DRAG;
    context.fillStyle = "#0072b240";
    context.fillRect(from[0], high ? 0 : from[1], to[0] - from[0], high ? canvas.clientHeight : to[1] - from[1]);
  }

  release(canvas, place, from, to) {
    const {time, value} = this.scales(canvas, place), [low, high] = this.view.x.range;
    if (Math.abs(to[0] - from[0]) >= LEAST_DRAG) {
      this.range = [from[0], to[0]].map(time).sort((a, b) => a - b).map(end => Math.max(low, Math.min(high, end)));
      if (Math.abs(to[1] - from[1]) >= LEAST_DRAG) this.ranges[place] = [from[1], to[1]].map(value).sort((a, b) => a - b);
    }
    this.draw();
  }

  // The pointer is at px of a panel: cursor and values there.
  point(place, px, pressed) {
    const canvas = this.panels.children[place].querySelector("canvas"), {time} = this.scales(canvas, place);
    const {snap} = this.view.x, coarse = snap && time(px + 4) - time(px) > snap;  // samples that all lines have, unless they are pixels apart
    const at = Math.max(this.range[0], Math.min(this.range[1], coarse ? Math.round(time(px) / snap) * snap : time(px)));
    if (this.moved) this.moved(at, pressed); else this.mark(at);
    this.tip(place, at);
  }

  // [name, value as text, series, what else is known] of all lines of a panel at a time: straight between samples that are not logarithms, else the nearest.
  values(place, at) {
    const {log} = this.mode.panels[place];
    return this.series(place).flatMap(([series, times, values]) => {
      const row = rowAt(times, at), next = Math.min(row + 1, times.length - 1), share = next > row ? (at - times[row]) / (times[next] - times[row]) : 0;
      const near = values[share > 0.5 ? next : row];
      const value = log ? 10 ** near : this.view.x.names ? near : values[row] + share * (values[next] - values[row]);
      const about = [series.about ?? "", ...(series.flags?.includes(share > 0.5 ? next : row) ? ["regression"] : [])].filter(Boolean).join(", ");
      return at > times.at(-1) + 1e-9 ? [] : [[series.name, Number.isNaN(value) ? "–" : value.toPrecision(this.mode.digits), series, about]];
    });
  }

  tip(place, at) {
    const panel = this.panels.children[place], tip = this.element.querySelector(".tip") ?? document.createElement("div"), x = this.view.x;
    tip.className = "tip";
    const title = document.createElement("strong");
    title.textContent = `${this.mode.panels[place].label}, ${x.names ? x.names[Math.round(at)] + " " + (x.notes?.[Math.round(at)] ?? "") : "t = " + at.toFixed(4) + " s"}`;
    tip.replaceChildren(title, ...this.values(place, at).map(([name, value, series, about]) => {
      const line = document.createElement("div"), swatch = document.createElement("span");
      swatch.style.background = series.color === "ink" ? "var(--ink)" : series.color;
      line.append(swatch, `${name}: ${value}${about ? ` (${about})` : ""}`);
      return line;
    }));
    panel.append(tip);
    const canvas = panel.querySelector("canvas"), left = this.scales(canvas, place).x(at);
    tip.style.left = `${Math.max(0, left > canvas.clientWidth / 2 ? left - tip.offsetWidth - 12 : Math.min(left + 12, canvas.clientWidth - tip.offsetWidth))}px`;
  }

  mark(at) {
    this.cursor = at;
    for (const box of this.panels.children) {
      const line = box.querySelector(".cursor") ?? box.appendChild(Object.assign(document.createElement("div"), {className: "cursor"}));
      const canvas = box.querySelector("canvas"), seen = at !== null && at >= this.range[0] && at <= this.range[1];
      line.hidden = !seen;
      if (seen) line.style.left = `${this.scales(canvas, 0).x(at)}px`;
    }
  }

  key(event) {
    if (event.target.closest("select, button, input") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "+" || event.key === "-") this.zoom(event.key === "+" ? 2 : 0.5);
    else if (event.key === "0") this.reset();
    else return;
    event.preventDefault();
  }
}
