// Sets up the pictures and charts of the page: selects that pick a view by its labels, data read when they are first shown, a mechanism that follows the cursor.
"use strict";

class Board {
  constructor(element) {
    this.element = element;
    this.views = [...element.querySelectorAll("script")].map(script => ({script, labels: JSON.parse(script.dataset.labels)}));
    const find = name => element.querySelector(name);
    [this.shown, this.run, this.said] = [".mode", ".run", ".said"].map(find);
    this.selects = [...element.querySelectorAll(".label")];
    this.film = find(".film") && new Film(find(".film"), time => this.followed(time));
    this.selects.forEach((select, level) => select.addEventListener("change", () => { this.fill(level + 1); return this.show(); }));
    this.shown?.addEventListener("change", () => this.chart.setMode(this.shown.selectedIndex));
    this.run?.addEventListener("change", () => this.loadRun());
    find(".reset").addEventListener("click", () => this.chart.reset());
    find(".closer").addEventListener("click", () => this.chart.zoom(2));
    find(".wider").addEventListener("click", () => this.chart.zoom(0.5));
    element.addEventListener("keydown", event => { this.film?.key(event); this.chart?.key(event); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.chart?.draw());
    if (innerWidth < 700) find("details").open = false;
    this.fill(0);
  }

  fill(from) {  // what a select offers depends on those before it
    for (let level = from; level < this.selects.length; level++) {
      const fit = this.views.filter(({labels}) => this.selects.slice(0, level).every((select, i) => labels[i] === select.value));
      const before = this.selects[level].value, labels = [...new Set(fit.map(view => view.labels[level]))];
      this.selects[level].replaceChildren(...labels.map(label => new Option(label)));
      this.selects[level].value = labels.includes(before) ? before : labels[0];
    }
  }

  async show() {
    const picked = this.views.find(({labels}) => this.selects.every((select, i) => labels[i] === select.value));
    this.picked = picked;
    picked.view ??= JSON.parse(picked.script.textContent);
    picked.columns ??= await unpack(picked.view.block);
    if (this.picked !== picked) return;  // something else was picked meanwhile
    this.chart?.close();
    const {view, columns} = picked, cursor = this.film && (time => this.film.show(time)), mode = this.shown?.selectedIndex ?? 0;
    this.chart = new Chart(this.element, view, columns, this.film && ((time, pressed) => {
      if (pressed) this.film.pause();
      if (!this.film.playing) cursor(time);
    }));
    if (this.shown) {
      this.shown.replaceChildren(...view.modes.map(({name}) => new Option(name)));
      this.shown.selectedIndex = Math.max(0, mode);
      if (mode > 0) this.chart.setMode(mode);
    }
    if (this.run) {
      this.run.replaceChildren(...view.film.runs.map(({name}) => new Option(name)));
      this.loadRun();
    }
    this.element.dataset.ready = "yes";
  }

  loadRun() {
    const {view, columns} = {view: this.chart.view, columns: this.chart.columns}, run = view.film.runs[this.run.selectedIndex];
    const read = Object.fromEntries(Object.entries({...view.film.common[run.t], ...run.columns}).map(([name, place]) => [name, columns[place]]));
    this.film.load({mechanism: view.film.mechanism, name: run.name, t: columns[run.t], columns: read, largest: view.film.largest});
  }

  followed(time) {  // cursor, and for those who listen, the values once it rests
    this.chart?.mark(time);
    clearTimeout(this.waiting);
    if (!this.film.playing) this.waiting = setTimeout(() => {
      const run = this.run.value, told = this.chart.mode.panels.flatMap((panel, place) => this.chart.values(place, time).filter(([name]) => name === run)
        .map(([, value]) => `${panel.label} ${value}`));
      this.said.textContent = `t = ${time.toFixed(3)} s, ${run}: ${told.join(", ")}`;
    }, 400);
  }
}

async function showPicture(image) {
  const svg = await inflate(image.dataset.svg).arrayBuffer();
  image.src = URL.createObjectURL(new Blob([svg], {type: "image/svg+xml"}));
}

const showAll = (kind, show) => [...document.querySelectorAll(kind)].map(element => show(element).catch(error => {
  element.closest(".board, .picture").prepend(`This could not be read: ${error}. It takes a browser with DecompressionStream.`);
  throw error;
}));
Promise.all([...showAll(".board", board => new Board(board).show()), ...showAll("img[data-svg]", showPicture)])
  .then(() => { document.body.dataset.ready = "yes"; });

const widths = new ResizeObserver(entries => {  // says where columns are hidden; boxes in closed details have no width until they are opened
  for (const {target} of entries) target.classList.toggle("wide", target.scrollWidth > target.clientWidth + 1);
});
document.querySelectorAll(".table").forEach(box => widths.observe(box));

function reveal() {  // a link may lead into sections that are closed
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  let opened = false;
  for (let part = target?.closest("details"); part; part = part.parentElement.closest("details")) {
    opened ||= !part.open;
    part.open = true;
  }
  if (opened) target.scrollIntoView();
}
addEventListener("hashchange", reveal);
reveal();
