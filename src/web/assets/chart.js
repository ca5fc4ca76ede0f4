// Line charts over uPlot in the page's own colours. Loaded as a module after uplot.js, which defines `uPlot`.

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const N_COLORS = 8;
const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3]];
const FRAME_STEPS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];

/** The API writes what JSON cannot as text; a chart leaves those frames out. */
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
function tick(values) {
  const step = values.length > 1 ? Math.abs(values[1] - values[0]) : 1;
  let digits = 0;
  while (digits < 8 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits++;
  return values.map((v) => (v !== 0 && Math.abs(v) < 1e-4 ? v.toExponential(1) : v.toFixed(digits)));
}

/**
 * Draws one line a name into `box`, again when its width or the colour scheme changes.
 * `x`: ascending numbers; `lines`: [{ name, values, color, dash }] with null for gaps, colour and dash by number unless
 * their order will do; `shaded(index)`: whether to tint a column;
 * `onPick(index)`: called with the x index that was clicked.
 */
export function draw(box, { x, lines, unit, time = false, xLabel, shaded, onPick }) {
  let plot;
  const render = () => {
    plot?.destroy();
    box.replaceChildren();
    if (!lines.some((line) => line.values.some((value) => value !== null))) {
      const text = document.createElement("p");
      text.className = "none";
      text.textContent = "No frame has a finite value to draw.";
      box.append(text);
      return;
    }
    plot = new uPlot(options(box, { x, lines, unit, time, xLabel, shaded, onPick }), [x, ...lines.map((l) => l.values)], box);
    box.dataset.drawn = lines.length;
  };
  render();
  new ResizeObserver(() => plot && plot.setSize(size(box))).observe(box.parentElement);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", render);
  return {
    update(next) {
      ({ x, lines, unit, shaded } = { x, lines, unit, shaded, ...next });
      render();
    },
  };
}

const size = (box) => ({ width: box.clientWidth, height: box.clientWidth < 600 ? 240 : 320 });

function options(box, { x, lines, unit, time, xLabel, shaded, onPick }) {
  const axis = {
    stroke: style("--muted"),
    grid: { stroke: style("--line"), width: 1 },
    ticks: { stroke: style("--line"), width: 1 },
    font: `12px ${getComputedStyle(document.body).fontFamily}`,
  };
  const series = lines.map((line, i) => ({
    label: line.name,
    stroke: style(`--series-${(line.color ?? i) % N_COLORS}`),
    dash: DASHES[(line.dash ?? Math.floor(i / N_COLORS)) % DASHES.length],
    width: 1.75,
    points: { show: x.length <= 80, size: 5 },
    spanGaps: time,
    value: (_, value) => format(value, unit),
  }));
  return {
    ...size(box),
    scales: { x: { time }, y: { range: (_, low, high) => spread(low, high) } },
    axes: [
      {
        ...axis,
        ...(xLabel ? { label: xLabel, labelSize: 20, labelFont: axis.font } : {}),
        ...(time ? { space: 90, values: (_, times, __, ___, step) => times.map((t) => moment(t, step)) } : { incrs: FRAME_STEPS }),
      },
      { ...axis, size: 62, values: (_, values) => tick(values) },
    ],
    series: [{ label: time ? "Time" : "Frame", ...(time ? { value: (_, t) => (t === null ? "–" : moment(t, 0)) } : {}) }, ...series],
    legend: { markers: { width: 2 } },
    cursor: { drag: { x: true, y: false }, focus: { prox: 24 } },
    focus: { alpha: 0.25 },
    hooks: {
      drawClear: [(u) => shaded && shade(u, x, shaded)],
      ready: [(u) => onPick && u.over.addEventListener("click", () => u.cursor.idx !== null && onPick(u.cursor.idx))],
    },
  };
}

/** Local date and time, as much of it as labels `step` seconds apart need. */
function moment(seconds, step) {
  const two = (n) => String(n).padStart(2, "0");
  const t = new Date(seconds * 1000);
  const date = `${t.getFullYear()}-${two(t.getMonth() + 1)}-${two(t.getDate())}`;
  const clock = `${two(t.getHours())}:${two(t.getMinutes())}`;
  if (step >= 86400) return date;
  if (step === 0) return `${date} ${clock}:${two(t.getSeconds())}`;
  return step < 60 ? `${clock}:${two(t.getSeconds())}` : clock === "00:00" ? date : clock;
}

/** A little air above and below; a flat line still needs a scale. */
function spread(low, high) {
  if (low === null || high === null) return [0, 1];
  const air = Math.max((high - low) * 0.08, Math.abs(high) * 1e-4, 1e-9);
  return [low - air, high + air];
}

/** Tints the columns that do not count. */
function shade(u, x, shaded) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.fillStyle = style("--shade");
  for (let i = 0; i < x.length; i++) {
    if (!shaded(i)) continue;
    const left = Math.max(bbox.left, u.valToPos(x[i] - 0.5, "x", true));
    const right = Math.min(bbox.left + bbox.width, u.valToPos(x[i] + 0.5, "x", true));
    ctx.fillRect(left, bbox.top, Math.max(0, right - left), bbox.height);
  }
  ctx.restore();
}
