// The page of a film: one run, shown as soon as it is read.
"use strict";
(async () => {
  const {mechanism, name, t, columns, largest, block} = JSON.parse(document.getElementById("film-data").textContent);
  const read = await unpack(block), film = new Film(document.querySelector(".film"));
  film.load({mechanism, name, largest, t: read[t], columns: Object.fromEntries(Object.entries(columns).map(([column, place]) => [column, read[place]]))});
  document.addEventListener("keydown", event => film.key(event));
  document.body.dataset.ready = "yes";
})();
