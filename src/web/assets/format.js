// Numbers, times and colours as the pages' tables and style sheet have them.

/** The API writes what JSON cannot as text; a chart leaves those values out. */
export const finite = (value) => (typeof value === "number" ? value : null);

/** As many digits as the pages' tables. */
export function format(value, unit) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "string") return { inf: "∞", "-inf": "−∞", nan: "NaN" }[value] ?? value;
  if (unit === "dB") return value.toFixed(2);
  if (unit === "ms") return value.toFixed(3);
  return value !== 0 && Math.abs(value) < 1e-3 ? value.toExponential(2) : value.toFixed(5);
}

/** Axis labels need only the digits that tell them apart. */
export function tick(values) {
  const step = values.length > 1 ? Math.abs(values[1] - values[0]) : 1;
  let digits = 0;
  while (digits < 8 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits++;
  return values.map((v) => (v !== 0 && Math.abs(v) < 1e-4 ? v.toExponential(1) : v.toFixed(digits)));
}

/** Local date and time, as much of it as labels `step` seconds apart need. */
export function moment(seconds, step) {
  const two = (n) => String(n).padStart(2, "0");
  const t = new Date(seconds * 1000);
  const date = `${t.getFullYear()}-${two(t.getMonth() + 1)}-${two(t.getDate())}`;
  const clock = `${two(t.getHours())}:${two(t.getMinutes())}`;
  if (step >= 86400) return date;
  if (step === 0) return `${date} ${clock}`;
  return step < 60 ? `${clock}:${two(t.getSeconds())}` : clock === "00:00" ? date : clock;
}

let probe;
const known = new Map();
addEventListener("themechange", () => known.clear());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => known.clear());

/** A colour of the style sheet as `#rrggbb`, or with alpha, in the scheme that is shown. */
export function color(name) {
  if (known.has(name)) return known.get(name);
  probe ??= document.body.appendChild(Object.assign(document.createElement("span"), { hidden: true }));
  probe.style.color = `var(${name})`;
  const text = getComputedStyle(probe).color;
  const [r, g, b, alpha] = text.match(/[\d.]+/g).map(Number);
  const hex = (n) => Math.round(n).toString(16).padStart(2, "0");
  const found = alpha === undefined ? `#${hex(r)}${hex(g)}${hex(b)}` : text;
  known.set(name, found);
  return found;
}

/** A table of texts: `columns` as [title, isNumber]; a cell is a text or [text, address]. */
export function table(columns, rows) {
  const element = (name, text, className) => Object.assign(document.createElement(name), { textContent: text, className });
  const whole = document.createElement("table");
  const head = whole.createTHead().insertRow();
  for (const [title, isNumber] of columns) head.append(element("th", title, isNumber ? "number" : ""));
  const body = whole.createTBody();
  for (const cells of rows) {
    const row = body.insertRow();
    cells.forEach((cell, i) => {
      const place = row.insertCell();
      if (columns[i][1]) place.className = "number";
      if (Array.isArray(cell)) place.append(Object.assign(element("a", cell[0], ""), { href: cell[1] }));
      else place.textContent = cell;
    });
  }
  return whole;
}
