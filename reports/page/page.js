// Draws the charts of the page. A chart is {views: [{labels, figure, shared}]}: the selects pick the view by its labels; where there
// are shared arrays, a trace with meta = i has shared[i] as its x.
"use strict";

function colors() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(["text", "line", "ground"].map(name => [name, style.getPropertyValue("--" + name).trim()]));
}

// Colours of the page in place of a figure's: its black is the colour of text.
function themed(view) {
  const {text, line, ground} = colors();
  const data = view.figure.data.map(trace => {
    const themed = {...trace, x: view.shared.length ? view.shared[trace.meta] : trace.x};
    for (const part of ["line", "marker"])
      if (trace[part] && trace[part].color === "#000000") themed[part] = {...trace[part], color: text};
    return themed;
  });
  const layout = {...view.figure.layout, paper_bgcolor: ground, plot_bgcolor: ground, font: {...view.figure.layout.font, color: text}};
  layout.hoverlabel = {...layout.hoverlabel, bgcolor: ground, font: {color: text}};
  for (const name of Object.keys(layout))
    if (/^[xy]axis/.test(name)) layout[name] = {...layout[name], gridcolor: line, linecolor: text, zerolinecolor: line};
  return [data, layout];
}

function setUp(element) {
  const chart = JSON.parse(document.getElementById(element.id + "-data").textContent);
  const controls = element.previousElementSibling, selects = [...controls.querySelectorAll("select")];
  const offered = level => [...new Set(chart.views.filter(view => selects.slice(0, level).every((select, i) => view.labels[i] === select.value))
    .map(view => view.labels[level]))];

  function fill(from) {  // what a select offers depends on those before it
    for (let level = from; level < selects.length; level++) {
      const before = selects[level].value, labels = offered(level);
      selects[level].replaceChildren(...labels.map(label => new Option(label)));
      selects[level].value = labels.includes(before) ? before : labels[0];
    }
  }

  function draw() {
    const view = chart.views.find(view => selects.every((select, i) => view.labels[i] === select.value));
    const [data, layout] = themed(view);
    return Plotly.newPlot(element, data, structuredClone(layout), {responsive: true, displaylogo: false, scrollZoom: false});
  }

  selects.forEach((select, level) => select.addEventListener("change", () => { fill(level + 1); draw(); }));
  controls.querySelector("button").addEventListener("click", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  fill(0);
  return draw();
}

Promise.all([...document.querySelectorAll(".chart")].map(setUp)).then(() => { document.body.dataset.ready = "yes"; });
