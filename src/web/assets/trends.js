// The trend chart: lines whose reports were made at different times are joined on a common axis.

import { draw, finite } from "./chart.js";

const box = document.getElementById("chart");
const element = document.getElementById("data");
if (box && element) {
  const data = JSON.parse(element.textContent);
  const x = [...new Set(data.lines.flatMap((line) => line.times))].sort((a, b) => a - b);
  const place = new Map(x.map((time, i) => [time, i]));
  const lines = data.lines.map((line) => {
    const values = new Array(x.length).fill(null);
    line.points.forEach((point, i) => (values[place.get(line.times[i])] = finite(point.value)));
    return { name: line.name, color: line.color, dash: line.dash, values };
  });
  const jobs = new Map();
  data.lines.forEach((line) => line.points.forEach((point, i) => jobs.set(line.times[i], point.job_id)));
  draw(box, { x, lines, unit: data.unit, time: true, onPick: (i) => location.assign(`/jobs/${jobs.get(x[i])}`) });
}
