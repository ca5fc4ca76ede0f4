// Line charts over uPlot in the page's own colours. Loaded as a module after uplot.js, which defines `uPlot`.
//
// A chart takes the keyboard: arrow keys move between points and lines, Enter opens a point, + and - zoom, 0 shows all.

import { color, format, moment, tick } from "./format.js";

export { finite, format } from "./format.js";

/**
 * Settled once the page was seen without charts, which may be long after its first animation frame: what they ask of the
 * service and draw would keep its words and figures waiting.
 */
export const shown = new Promise((resolve) => new PerformanceObserver(resolve).observe({ type: "paint", buffered: true }));

const N_COLORS = 8;
const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3]];
const FRAME_STEPS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
/** A click is not a drag, in pixels. */
const MIN_DRAG = 6;

const everyChart = new Set();
const redraw = () => everyChart.forEach((render) => render());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
addEventListener("themechange", redraw);

const strokeOf = (line, i) => color(`--series-${(line.color ?? i) % N_COLORS}`);

/**
 * Draws one line a name into `box`, again when its width or the colours change. `spec`:
 *
 * - `x`: ascending numbers; `lines`: [{ name, values, color, dash }] with null for gaps; `unit`; `height`
 * - `time`: x is seconds since 1970; `xLabel`; `range`: [from, to] of x; `sync`: the name that charts with one cursor share
 * - `stacked`: lines lie on each other; `shaded(index)`: whether to tint a column
 * - `levels`: [{ value, text, line }], `moments`: [{ x, text, worse }] drawn beside the points
 * - `describe(line, index)`: what is said of a point; `onPick(line, index)`: it was clicked
 * - `onZoom(from, to)`: called without numbers for all; without it the chart zooms by itself
 */
export function draw(box, spec) {
  let plot;
  const render = () => {
    plot?.destroy();
    plot = undefined;
    box.replaceChildren();
    if (!spec.lines.some((line) => line.values.some((value) => value !== null))) {
      const text = document.createElement("p");
      text.className = "none";
      text.textContent = "There is nothing to draw here.";
      box.append(text);
      box.dataset.drawn = 0;
      return;
    }
    const values = spec.stacked ? stack(spec.lines) : spec.lines.map((line) => line.values);
    plot = new uPlot(options(box, spec), [spec.x, ...values], box);
    box.dataset.drawn = spec.lines.length;
  };
  render();
  everyChart.add(render);
  new ResizeObserver(() => plot && plot.width !== box.clientWidth && plot.setSize(size(box, spec))).observe(box);
  keys(box, () => plot, () => spec);
  return {
    update(next) {
      const { left, top } = plot?.cursor ?? {};
      spec = { ...spec, ...next };
      render();
      // Marks come after the points: whoever is at a point by then stays there. A new plot has no scales before its own
      // microtask.
      if (!next.x && left >= 0) queueMicrotask(() => plot?.setCursor({ left, top }));
    },
    zoom: (from, to) => plot?.setScale("x", { min: from ?? spec.x[0], max: to ?? spec.x.at(-1) }),
  };
}

/** Running sums, so that each line's band is its own share. */
function stack(lines) {
  const sums = new Float64Array(lines[0].values.length);
  return lines.map((line) => line.values.map((value, i) => (sums[i] += value ?? 0)));
}

/** A single moment stands in the middle of two hours, a single frame between two others. */
const around = (x, time) => (time ? [x - 3600, x + 3600] : [x - 1, x + 1]);

const size = (box, spec) => ({ width: box.clientWidth, height: spec.height ?? (box.clientWidth < 600 ? 240 : 320) });

function options(box, spec) {
  const { x, lines, unit, time, stacked } = spec;
  const axis = {
    stroke: color("--muted"),
    grid: { stroke: color("--line"), width: 1 },
    ticks: { stroke: color("--line"), width: 1 },
    font: `12px ${getComputedStyle(document.body).fontFamily}`,
  };
  const series = lines.map((line, i) => ({
    label: line.name,
    stroke: strokeOf(line, i),
    fill: stacked ? strokeOf(line, i) + "55" : undefined,
    dash: DASHES[(line.dash ?? Math.floor(i / N_COLORS)) % DASHES.length],
    width: stacked ? 1 : 1.75,
    // One that has no line through it must be seen by itself.
    points: { show: !stacked && x.length <= 80, size: line.values.filter(Number.isFinite).length === 1 ? 9 : 5 },
    spanGaps: time,
    value: (_, value, i_, index) => format(stacked && index !== null ? lines[i].values[index] : value, unit),
  }));
  return {
    ...size(box, spec),
    scales: {
      x: { time, range: (_, low, high) => spec.range ?? (x.length > 1 ? [low, high] : around(x[0], time)) },
      y: { range: (_, low, high) => spread(low, high, spec) },
    },
    axes: [
      {
        ...axis,
        ...(spec.xLabel ? { label: spec.xLabel, labelSize: 20, labelFont: axis.font } : {}),
        ...(time
          ? { space: 90, values: (_, times, __, ___, step) => times.map((t) => moment(t, step)) }
          : { incrs: FRAME_STEPS }),
      },
      { ...axis, size: 62, values: (_, values) => tick(values) },
    ],
    bands: stacked ? lines.slice(1).map((_, i) => ({ series: [i + 2, i + 1] })) : [],
    series: [
      { label: time ? "Time" : "Frame", ...(time ? { value: (_, t) => (t === null ? "–" : moment(t, 0)) } : {}) },
      ...series,
    ],
    legend: { markers: { width: 2 }, live: !spec.describe },
    cursor: {
      drag: { x: true, y: false, setScale: false },
      focus: { prox: 24 },
      dataIdx: (u, line, index) => (time && line > 0 ? nearest(u.data[line], index) : index),
      bind: { dblclick: () => () => zoomAll(box, spec) },
      ...(spec.sync ? { sync: { key: spec.sync, setSeries: false } } : {}),
    },
    focus: { alpha: stacked ? 1 : 0.25 },
    hooks: {
      drawClear: [(u) => spec.shaded && shade(u, x, spec.shaded)],
      draw: [(u) => marks(u, spec)],
      setCursor: [(u) => spec.describe && tell(u, spec)],
      setSelect: [(u) => select(u, spec)],
      ready: [(u) => ready(u, box, spec)],
    },
  };
}

/** The index of the value nearest to a gap. */
function nearest(values, index) {
  for (let by = 0; by < values.length; by++) {
    if (values[index - by] != null) return index - by;
    if (values[index + by] != null) return index + by;
  }
  return index;
}

function ready(u, box, spec) {
  box.tabIndex = 0;
  box.setAttribute("role", "group");
  box.setAttribute("aria-roledescription", "chart");
  box.setAttribute("aria-label", `${spec.name ?? "Chart"}: ${spec.lines.map((line) => line.name).join("; ")}. Arrow keys move between points.`);
  u.over.addEventListener("click", () => {
    const [line, index] = focused(u);
    if (spec.onPick && index !== null && u.select.width < MIN_DRAG) spec.onPick(line, index);
  });
  if (spec.onPick) u.over.style.cursor = "pointer";
  if (!spec.describe) return;
  const note = document.createElement("div");
  note.className = "tip";
  note.setAttribute("role", "status");
  note.hidden = true;
  u.over.append(note);
  u.over.addEventListener("mouseleave", () => (note.hidden = true));
}

/** The line and the index that the cursor is nearest to. */
function focused(u) {
  let [best, line, index] = [Infinity, 0, null];
  u.data.forEach((values, i) => {
    const at = i > 0 ? u.cursor.idxs?.[i] : null;
    if (at == null || values[at] == null || !u.series[i].show) return;
    const distance = Math.hypot(
      u.valToPos(values[at], "y") - u.cursor.top,
      (u.valToPos(u.data[0][at], "x") - u.cursor.left) / 2,
    );
    if (distance < best) [best, line, index] = [distance, i - 1, at];
  });
  return [line, index];
}

function tell(u, spec) {
  const note = u.over.querySelector(".tip");
  if (!note) return;
  const [line, index] = u.cursor.left >= 0 ? focused(u) : [0, null];
  note.hidden = index === null;
  if (index === null) return;
  note.replaceChildren(
    ...spec.describe(line, index).map((text) => {
      const row = document.createElement("div");
      row.textContent = text;
      return row;
    }),
  );
  const left = u.valToPos(u.data[0][index], "x");
  note.style.borderColor = strokeOf(spec.lines[line], line);
  note.style.left = `${Math.min(Math.max(left + 12, 0), Math.max(u.over.clientWidth - note.offsetWidth, 0))}px`;
  const top = u.valToPos(u.data[line + 1][index], "y");
  note.style.top = `${top > note.offsetHeight + 16 ? top - note.offsetHeight - 12 : top + 14}px`;
}

function select(u, spec) {
  const { left, width } = u.select;
  if (width >= MIN_DRAG) {
    const [from, to] = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    if (spec.onZoom) spec.onZoom(from, to);
    else u.setScale("x", { min: from, max: to });
  }
  if (width > 0) setTimeout(() => u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false));
}

function zoomAll(box, spec) {
  if (spec.onZoom) spec.onZoom();
  else box.dispatchEvent(new CustomEvent("showall"));
}

function keys(box, current, spec) {
  let line = 0;
  box.addEventListener("showall", () => current()?.setScale("x", { min: spec().x[0], max: spec().x.at(-1) }));
  box.addEventListener("keydown", (event) => {
    const u = current();
    if (!u || event.target !== box || event.ctrlKey || event.altKey || event.metaKey) return;
    const x = u.data[0];
    const { min, max } = u.scales.x;
    const zoom = (by) => {
      const middle = u.cursor.idx == null ? (min + max) / 2 : x[u.cursor.idx];
      const half = ((max - min) / 2) * by;
      const [from, to] = [Math.max(middle - half, x[0]), Math.min(middle + half, x.at(-1))];
      if (spec().onZoom) spec().onZoom(from, to);
      else u.setScale("x", { min: from, max: to });
    };
    const move = (by) => {
      const values = u.data[line + 1];
      let index = u.cursor.idx ?? (by > 0 ? -1 : x.length);
      do index += by;
      while (index >= 0 && index < x.length && values[index] == null);
      if (values[index] == null) return;
      u.setCursor({ left: u.valToPos(x[index], "x"), top: u.valToPos(values[index], "y") });
    };
    const turn = (by) => {
      line = (line + by + spec().lines.length) % spec().lines.length;
      const index = nearest(u.data[line + 1], u.cursor.idx ?? 0);
      u.setCursor({ left: u.valToPos(x[index], "x"), top: u.valToPos(u.data[line + 1][index], "y") });
    };
    const actions = {
      ArrowLeft: () => move(-1),
      ArrowRight: () => move(1),
      ArrowUp: () => turn(-1),
      ArrowDown: () => turn(1),
      Enter: () => u.cursor.idx != null && spec().onPick?.(line, nearest(u.data[line + 1], u.cursor.idx)),
      "+": () => zoom(0.5),
      "-": () => zoom(2),
      0: () => zoomAll(box, spec()),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  });
}

/** A little air above and below; a flat line still needs a scale. Levels that are near are shown too. */
function spread(low, high, { stacked, levels = [] }) {
  if (low == null || high == null) return [0, 1];
  if (stacked) return [0, Math.max(high * 1.05, 1e-9)];
  const reach = (high - low) * 1.5 + Math.abs(high) * 0.02;
  for (const { value } of levels) {
    if (value < low && value > low - reach) low = value;
    if (value > high && value < high + reach) high = value;
  }
  const air = Math.max((high - low) * 0.08, Math.abs(high) * 1e-4, 1e-9);
  return [low - air, high + air];
}

/** Tints the columns that do not count. */
function shade(u, x, shaded) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.fillStyle = color("--shade");
  for (let i = 0; i < x.length; i++) {
    if (!shaded(i)) continue;
    const left = Math.max(bbox.left, u.valToPos(x[i] - 0.5, "x", true));
    const right = Math.min(bbox.left + bbox.width, u.valToPos(x[i] + 0.5, "x", true));
    ctx.fillRect(left, bbox.top, Math.max(0, right - left), bbox.height);
  }
  ctx.restore();
}

/** Levels across the chart and moments down it, with their words. */
function marks(u, { levels = [], moments = [], lines }) {
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.font = `${11 * ratio}px ${getComputedStyle(document.body).fontFamily}`;
  ctx.textAlign = "left";
  ctx.textBaseline = "alphabetic";
  ctx.lineWidth = ratio;
  for (const { value, text, line } of levels) {
    const y = Math.round(u.valToPos(value, "y", true));
    ctx.strokeStyle = ctx.fillStyle = line === undefined ? color("--bad") : strokeOf(lines[line], line);
    ctx.setLineDash([8 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.fillText(text, bbox.left + 6 * ratio, y - 4 * ratio);
  }
  ctx.setLineDash([2 * ratio, 3 * ratio]);
  moments.forEach(({ x, text, worse }, i) => {
    const at = Math.round(u.valToPos(x, "x", true));
    ctx.strokeStyle = ctx.fillStyle = color(worse === undefined || worse === null ? "--muted" : worse ? "--bad" : "--good");
    ctx.beginPath();
    ctx.moveTo(at, bbox.top);
    ctx.lineTo(at, bbox.top + bbox.height);
    ctx.stroke();
    // Near the right edge the words stand on the other side.
    const isLate = at + ctx.measureText(text).width > bbox.left + bbox.width - 8 * ratio;
    ctx.textAlign = isLate ? "right" : "left";
    ctx.fillText(text, at + (isLate ? -4 : 4) * ratio, bbox.top + (13 + 13 * (i % 3)) * ratio);
  });
  ctx.restore();
}
