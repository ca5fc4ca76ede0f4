// The trends' charts. Points come from the API, thinned to what the screen can show, and anew for each zoom. The range
// and the difference are in the address, as everything else on the page is.

import { draw, finite, format, shown } from "./chart.js";
import { moment, table } from "./format.js";
import { difference, marks, points } from "./series.js";

const page = JSON.parse(document.getElementById("data").textContent);
const address = () => new URL(location.href);
const MAX_ROWS = 2000;
/** With more lines, levels and changes would hide them. */
const MAX_MARKED = 6;

const range = () => {
  const { searchParams } = address();
  const number = (name) => (searchParams.get(name) ? Number(searchParams.get(name)) : undefined);
  return { from: number("from"), to: number("to") };
};

function put(name, value) {
  const url = address();
  if (value === undefined) url.searchParams.delete(name);
  else url.searchParams.set(name, value);
  history.replaceState(null, "", url);
}

/** A panel: a metric's lines, their points as they were loaded last. */
class Panel {
  constructor(section, { metric, unit, lines }) {
    Object.assign(this, { section, metric, unit, lines });
    this.box = section.querySelector(".chart");
    this.loaded = [];
    section.querySelector("details.rows").addEventListener("toggle", () => this.tabulate());
    this.offerDifferences();
  }

  async load() {
    const before = performance.now();
    const { from, to } = range();
    // The smallest and the largest of every two pixels: a line is as wide, and twice as many take twice as long.
    const max = Math.max(400, this.box.clientWidth);
    this.box.setAttribute("aria-busy", "true");
    const loaded = await Promise.all(this.lines.map((line) => points(line, this.metric, { from, to, max })));
    if (range().from !== from || range().to !== to) return;
    this.loaded = loaded;
    this.box.removeAttribute("aria-busy");
    this.draw();
    this.box.dataset.ms = (performance.now() - before).toFixed(0);
    this.box.dataset.points = loaded.reduce((sum, { nPoints }) => sum + nPoints, 0);
    this.tabulate();
    // To find the changes takes the server far longer than the points: these are drawn first.
    this.marks ??= this.lines.length <= MAX_MARKED ? Promise.all(this.lines.map((line) => marks(line, this.metric))) : [];
    this.addMarks(await this.marks);
  }

  draw() {
    const tables = this.loaded.map(({ list }) => [list.map((p) => p.at), list.map((p) => finite(p.value))]);
    const [x, ...values] = uPlot.join(tables.length ? tables : [[[], []]]);
    this.index = this.loaded.map(({ list }) => new Map(list.map((p) => [p.at, p])));
    const { from, to } = range();
    const spec = {
      name: this.metric,
      x,
      lines: this.lines.map((line, i) => ({ ...line, values: values[i] ?? [] })),
      unit: this.unit,
      time: true,
      range: from !== undefined && to !== undefined ? [from / 1000, to / 1000] : undefined,
      sync: "trends",
      describe: (line, i) => this.describe(line, i),
      onPick: (line, i) => location.assign(`/reports/${this.at(line, i).report_id}`),
      onZoom: (a, b) => zoom(a && Math.floor(a * 1000), b && Math.ceil(b * 1000)),
    };
    this.x = x;
    if (this.chart) this.chart.update(spec);
    else this.chart = draw(this.box, spec);
    const thinned = this.loaded.filter(({ nPoints, list }) => list.length < nPoints);
    this.section.querySelector(".thinned").textContent = thinned.length
      ? `${this.loaded.reduce((n, { nPoints }) => n + nPoints, 0)} results, drawn as the smallest and the largest of each run; zoom in to see all.`
      : "";
  }

  at(line, i) {
    return this.index[line].get(this.x[i]);
  }

  describe(line, i) {
    const point = this.at(line, i);
    if (!point) return [this.lines[line].name];
    const place = [point.commit?.slice(0, 10), point.branch].filter(Boolean).join(" on ");
    return [this.lines[line].name, `${format(point.value, this.unit)} ${this.unit}`, ...(place ? [place] : []), moment(point.at, 0), `report ${point.report_id}`];
  }

  addMarks(found) {
    if (!found.length) return;
    const levels = [];
    const moments = [];
    const level = (value, text, line) => {
      if (value !== null && value !== undefined && !levels.some((known) => known.value === value && known.text === text)) {
        levels.push({ value, text, line });
      }
    };
    found.forEach((one, line) => {
      if (!one) return;
      const own = this.lines.length > 1 ? line : undefined;
      level(one.min, `least allowed ${format(one.min, this.unit)}`);
      level(one.max, `most allowed ${format(one.max, this.unit)}`);
      if (one.baseline) level(one.baseline.worst, `baseline ${format(one.baseline.worst, this.unit)}`, own ?? 0);
      if (one.baseline?.allowed != null) level(one.baseline.allowed, `tolerance ${format(one.baseline.allowed, this.unit)}`);
      for (const change of one.changes) {
        const step = change.after - change.before;
        moments.push({
          x: Date.parse(change.created_at) / 1000,
          text: `${step > 0 ? "+" : ""}${format(step, this.unit)} ${change.commit?.slice(0, 8) ?? ""}`,
          worse: change.worse,
        });
      }
    });
    this.chart.update({ levels, moments });
    this.box.dataset.changes = moments.length;
    this.box.dataset.levels = levels.length;
  }

  tabulate() {
    const details = this.section.querySelector("details.rows");
    if (!details.open) return;
    const rows = this.lines.flatMap((line, i) =>
      (this.loaded[i]?.list ?? []).map((p) => [line.name, moment(p.at, 0), p.commit?.slice(0, 10) ?? "–", p.branch ?? "–", format(p.value, this.unit), [`#${p.report_id}`, `/reports/${p.report_id}`]]),
    );
    const columns = [["Line"], ["Time"], ["Commit"], ["Branch"], [`${this.metric} ${this.unit}`, true], ["Report"]];
    const body = details.querySelector(".scroll");
    body.replaceChildren(table(columns, rows.slice(-MAX_ROWS)));
    if (rows.length > MAX_ROWS) body.append(`The newest ${MAX_ROWS} of ${rows.length}; the CSV has all.`);
  }

  offerDifferences() {
    const form = this.section.querySelector("form.difference");
    if (!form || this.lines.length < 2) return;
    form.hidden = false;
    const [a, b] = form.querySelectorAll("select");
    this.lines.forEach((line, i) => [a, b].forEach((select) => select.add(new Option(line.name, i))));
    b.selectedIndex = 1;
    const name = `minus.${this.metric}`;
    const asked = address().searchParams.get(name)?.split("-").map(Number);
    if (asked?.length === 2 && asked.every((i) => this.lines[i])) {
      [a.selectedIndex, b.selectedIndex] = asked;
      this.subtract(...asked);
    }
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      put(name, `${a.selectedIndex}-${b.selectedIndex}`);
      this.subtract(a.selectedIndex, b.selectedIndex);
    });
  }

  async subtract(a, b) {
    const box = this.section.querySelector(".chart.minus");
    box.hidden = false;
    const list = await difference(this.lines[a], this.lines[b], this.metric, range());
    const spec = {
      name: `Difference of ${this.metric}`,
      x: list.map((p) => p.at),
      lines: [{ name: `${this.lines[a].name} − ${this.lines[b].name}`, values: list.map((p) => p.value) }],
      unit: this.unit,
      time: true,
      height: 180,
      levels: [{ value: 0, text: "equal" }],
      describe: (_, i) => [`${format(list[i].value, this.unit)} ${this.unit}`, list[i].commit?.slice(0, 10) ?? "", moment(list[i].at, 0)],
      onPick: (_, i) => location.assign(`/reports/${list[i].report_id}?with=${list[i].other}`),
    };
    if (this.minus) this.minus.update(spec);
    else this.minus = draw(box, spec);
    this.subtracted = [a, b];
  }
}

const panels = page.panels.map((panel, i) => new Panel(document.getElementById(`panel-${i}`), panel));

/** Milliseconds since 1970; nothing for all. */
function zoom(from, to) {
  put("from", from);
  put("to", to);
  for (const panel of panels) {
    panel.load();
    if (panel.subtracted) panel.subtract(...panel.subtracted);
  }
  showRange();
}

function showRange() {
  const { from, to } = range();
  const form = document.querySelector("form.filters");
  for (const [name, value] of Object.entries({ from, to })) {
    form.elements[name].value = value ?? "";
    form.elements[name].disabled = value === undefined;
  }
  const text = document.getElementById("range");
  text.hidden = from === undefined;
  text.querySelector("span").textContent = from === undefined ? "" : `${moment(from / 1000, 0)} to ${moment(to / 1000, 0)}`;
}

document.querySelector("#range button").addEventListener("click", () => zoom());
addEventListener("popstate", () => location.reload());
showRange();
await shown;
for (const panel of panels) panel.load();
