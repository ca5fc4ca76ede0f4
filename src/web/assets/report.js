// A report's frames: a small chart a metric, the times of passes on each other, one cursor for all. Another report may lie
// beside it.

import { draw, finite, format, shown } from "./chart.js";

const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const frames = (id) => fetch(`/api/v1/reports/${id}/frames`).then((answer) => answer.json());

await shown;
const [own, other] = await Promise.all([frames(data.report), data.other ? frames(data.other.id) : null]);
const list = own.frames;
const x = list.map((frame) => frame.index);
const others = new Map((other?.frames ?? []).map((frame) => [frame.index, frame]));
const warmup = (i) => list[i].warmup || list[i].reset;
const resets = list.filter((frame, i) => frame.reset && i > 0).map((frame) => ({ x: frame.index, text: "reset" }));
const charts = [];

const common = {
  x,
  sync: "frames",
  shaded: warmup,
  moments: resets,
  onZoom: (from, to) => charts.forEach((chart) => chart.zoom(from, to)),
  onPick: (_, i) => data.viewer && location.assign(`${data.viewer}/${x[i]}${data.other ? `?with=${data.other.id}` : ""}`),
};

const note = (i) => (list[i].reset ? "history was dropped" : list[i].warmup ? "warm-up, not counted" : "");
const say = (name, value, unit, i) => [`frame ${x[i]}`, `${name} ${format(value, unit)} ${unit}`, note(i)].filter(Boolean);

for (const { metric, unit } of data.metrics) {
  const box = byId(`chart-${metric}`);
  if (!box) continue;
  const lines = [{ name: data.name, values: list.map((frame) => finite(frame.metrics[metric])) }];
  if (other) lines.push({ name: data.other.name, dash: 1, values: x.map((index) => finite(others.get(index)?.metrics[metric])) });
  charts.push(
    draw(box, { ...common, name: metric, lines, unit, height: 170, describe: (line, i) => say(lines[line].name, lines[line].values[i], unit, i) }),
  );
}

const HOST = new Set(["decode", "host_cpu", "metrics", "readback", "upload"]);
const passes = [...new Set(list.flatMap((frame) => Object.keys(frame.times_ms)))].filter((pass) => !HOST.has(pass));
const times = byId("chart-times");
if (times && passes.length) {
  const lines = passes.map((name) => ({ name, values: list.map((frame) => frame.times_ms[name] ?? 0) }));
  const total = (i) => lines.reduce((sum, line) => sum + line.values[i], 0);
  charts.push(
    draw(times, {
      ...common,
      name: "GPU time by pass",
      lines,
      unit: "ms",
      height: 220,
      stacked: true,
      xLabel: "frame (tinted: warm-up and resets, not counted)",
      describe: (line, i) => [...say(lines[line].name, lines[line].values[i], "ms", i), `all ${format(total(i), "ms")} ms`],
    }),
  );
}
document.body.dataset.charts = charts.length;
