// Reads what stiction.scenes.pictures.web wrote.
"use strict";

// The bytes that were compressed, as the body of a response.
function inflate(text) {
  const packed = Uint8Array.from(atob(text), sign => sign.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")));
}

// The columns of {columns: [[bits, rows, smallest value, step, order of the differences], ..], data}, each as a Float64Array; NaN is missing.
async function unpack({columns, data}) {
  const bytes = new Uint8Array(await inflate(data).arrayBuffer());
  let from = 0;
  return columns.map(([bits, rows, low, step, order]) => {
    const whole = new (bits === 16 ? Uint16Array : Uint32Array)(rows);
    for (let place = 0; place < bits; place += 8, from += rows)
      for (let i = 0; i < rows; i++) whole[i] += bytes[from + i] << place;
    for (let sums = 0; sums < order; sums++)
      for (let i = 1; i < rows; i++) whole[i] += whole[i - 1];  // wraps, as the differences did
    return Float64Array.from(whole, value => value === 2 ** bits - 1 ? NaN : low + step * value);
  });
}

// The last row at or before a time, in increasing times; 0 if there is none.
function rowAt(times, time) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle + 1; else high = middle;
  }
  return Math.max(low - 1, 0);
}
