// The frame viewer: two images of a frame, or of two reports, on one canvas, down to single pixels. What is looked at, and
// how, is in the address.

import { GlScreen } from "./screen_gl.js";
import { PlainScreen } from "./screen_2d.js";
import { at, load } from "./pixels.js";
import { stage } from "./stage.js";

const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const asked = new URL(location.href).searchParams;
const last = data.n_frames - 1;
const MODES = ["one", "swipe", "side", "blink", "difference"];
/** Of a blink, milliseconds: 2.5 changes a second, below the 3 that can harm. */
const BLINK = 400;
const PLAY = 100;

const number = (name, other) => (asked.has(name) && Number.isFinite(Number(asked.get(name))) ? Number(asked.get(name)) : other);
const state = {
  frame: data.frame,
  a: choice("a", "output"),
  b: choice("b", data.other ? "with:output" : data.images.some(({ id }) => id === "reference") ? "reference" : "input"),
  mode: MODES.includes(asked.get("mode")) ? asked.get("mode") : "swipe",
  ev: number("ev", 0),
  shown: asked.get("shown") ?? "color",
  white: number("white", 0.1),
  split: number("split", 0.5),
  view: asked.has("zoom") ? { x: number("x", 0), y: number("y", 0), zoom: number("zoom", 1) } : null,
};

function choice(name, usual) {
  return data.images.some(({ id }) => id === asked.get(name)) ? asked.get(name) : usual;
}

/** Where an image of a frame is; those of the other report begin with `with:`. */
function href(id, frame) {
  const [report, image] = id.startsWith("with:") ? [data.other, id.slice(5)] : [data.report, id];
  return `/api/v1/reports/${report}/frames/${frame}/${image}.f16`;
}

const canvas = byId("canvas");
const screen = (asked.get("renderer") !== "2d" && GlScreen.on(canvas, () => view.redraw())) || new PlainScreen(canvas);
let images = null;
let wanted = 0;
let isLoading = false;
let blinked = false;

const view = stage(byId("stage"), {
  view: state.view,
  split: state.split,
  draw,
  changed(next, split) {
    Object.assign(state, { view: next, split });
    remember();
  },
  values: (u, v) => images && visible().map(({ name, image }) => ({ name, values: at(image, u, v) })),
});

const nameOf = (id) => data.images.find((image) => image.id === id).name;
const visible = () =>
  images && (state.mode === "one" ? [{ name: nameOf(state.a), image: images[0] }] : [0, 1].map((i) => ({ name: nameOf(state["ab"[i]]), image: images[i] })));

/**
 * Shows a frame once its images are here; one that was asked for later goes first. Then fetches those that are `likely` to
 * be asked for next.
 */
async function show(frame = state.frame, likely = onwards(frame)) {
  const before = performance.now();
  state.frame = Math.min(Math.max(frame, 0), last);
  const turn = ++wanted;
  isLoading = true;
  const shown = [state.a, state.b];
  controls();
  let found;
  try {
    found = await Promise.all(shown.map((id) => load(href(id, state.frame))));
  } catch (error) {
    if (turn === wanted) {
      byId("trouble").textContent = error.message;
      isLoading = false;
    }
    return;
  }
  if (turn !== wanted) return;
  isLoading = false;
  byId("trouble").textContent = "";
  images = found;
  view.resize([images[0].width, images[0].height].map((n, i) => Math.max(n, images[1][["width", "height"][i]])));
  remember();
  byId("stage").dataset.frame = state.frame;
  await screen.finished();
  if (turn !== wanted) return;
  byId("stage").dataset.ms = (performance.now() - before).toFixed(1);
  fetchAhead(turn, shown, likely);
}

/** One frame after the other: together, the nearest would wait for all. */
async function fetchAhead(turn, shown, frames) {
  for (const frame of frames) {
    if (turn !== wanted) return;
    if (frame < 0 || frame > last) continue;
    const found = await Promise.all(shown.map((id) => load(href(id, frame)))).catch(() => null);
    if (!found || turn !== wanted) continue;
    screen.prepare(panes(found, view.layout()), look());
    await screen.finished();
  }
}

/** The frames that follow in the direction of a step, and the one that it came from. */
function onwards(frame) {
  const by = frame < state.frame ? -1 : 1;
  return [1, 2, 3, -1].map((n) => frame + n * by);
}

/** What the mode shows of two images, pane by pane. `layout` says where the picture lies. */
function panes([a, b], layout) {
  const { width, height } = canvas;
  const pane = (clip, image, shift = 0, other) => ({
    clip,
    origin: [layout.origin[0] + shift, layout.origin[1]],
    zoom: layout.zoom,
    size: layout.size,
    a: image,
    b: other,
  });
  const whole = [0, 0, width, height];
  const at = Math.round(width * layout.split);
  const half = Math.floor(width / 2);
  const modes = {
    one: () => [pane(whole, a)],
    swipe: () => [pane([0, 0, at, height], a), pane([at, 0, width - at, height], b)],
    side: () => [pane([0, 0, half - 1, height], a), pane([half + 1, 0, width - half - 1, height], b, half)],
    blink: () => [pane(whole, blinked ? b : a)],
    difference: () => [pane(whole, a, 0, b)],
  };
  return modes[state.mode]();
}

const look = () => ({ display: data.display, ev: state.ev, shown: state.shown, white: state.white });

function draw(layout) {
  if (images) screen.draw(panes(images, layout), look());
}

function remember() {
  const url = new URL(location.href);
  url.pathname = `/reports/${data.report}/frames/${state.frame}`;
  const usual = { ev: 0, shown: "color", white: 0.1, split: 0.5 };
  for (const name of ["a", "b", "mode", "ev", "shown", "white", "split"]) {
    if (state[name] === usual[name]) url.searchParams.delete(name);
    else url.searchParams.set(name, typeof state[name] === "number" ? +state[name].toFixed(4) : state[name]);
  }
  for (const name of ["x", "y", "zoom"]) {
    if (state.view) url.searchParams.set(name, +state.view[name].toFixed(3));
    else url.searchParams.delete(name);
  }
  history.replaceState(null, "", url);
}

function controls() {
  byId("frame").value = state.frame;
  byId("frame-text").textContent = `frame ${state.frame} of ${last}`;
  byId("exr-a").href = href(state.a, state.frame).replace(".f16", ".exr");
  byId("exr-b").href = href(state.b, state.frame).replace(".f16", ".exr");
  for (const name of ["a", "b", "shown", "white"]) byId(name).value = state[name];
  byId("ev").value = state.ev;
  byId("ev-text").textContent = `${state.ev > 0 ? "+" : ""}${state.ev} EV`;
  for (const radio of document.querySelectorAll("input[name=mode]")) radio.checked = radio.value === state.mode;
  const isMap = (id) => data.images.find((image) => image.id === id).is_map;
  byId("white").closest("label").hidden = state.mode !== "difference";
  byId("scale").hidden = !(state.mode === "difference" || isMap(state.a) || (state.mode !== "one" && isMap(state.b)) || state.shown === "luminance");
  byId("stage").dataset.mode = state.mode;
}

function set(changes) {
  Object.assign(state, changes);
  if ("a" in changes || "b" in changes) return show();
  controls();
  view.setMode(state.mode);
  view.redraw();
  remember();
  return undefined;
}

// Frames from the worst to the best of the metric that was asked for.
const worst = fetch(`/api/v1/reports/${data.report}/frames`)
  .then((answer) => answer.json())
  .then(({ frames }) => {
    const badness = ({ metrics }) => {
      const value = metrics[data.metric];
      if (typeof value !== "number") return value === "nan" ? Infinity : -Infinity;
      return data.lower_is_better ? value : -value;
    };
    return frames.filter((frame) => !frame.warmup && data.metric in frame.metrics).sort((p, q) => badness(q) - badness(p)).map((frame) => frame.index);
  });

async function nextWorst(by) {
  const order = await worst;
  const place = order.includes(state.frame) ? order.indexOf(state.frame) : -by;
  const after = (n) => order[(place + n * by + order.length) % order.length];
  if (order.length) show(after(1), [after(2)]);
}

// Whoever plays: a turn that was waiting when another began must not go on beside it.
let player = null;
async function play() {
  const self = player ? null : {};
  player = self;
  byId("play").textContent = self ? "Pause" : "Play";
  byId("play").setAttribute("aria-pressed", self !== null);
  while (self && player === self) {
    const began = performance.now();
    const after = (n) => (state.frame + n) % (last + 1);
    await show(after(1), [2, 3, 4].map(after));
    await new Promise((next) => setTimeout(next, Math.max(0, PLAY - (performance.now() - began))));
  }
}

setInterval(() => {
  if (state.mode !== "blink") return;
  blinked = !blinked;
  byId("stage").dataset.blinked = blinked ? "b" : "a";
  view.redraw();
}, BLINK);

const actions = {
  ArrowLeft: () => show(state.frame - 1),
  ArrowRight: () => show(state.frame + 1),
  Home: () => show(0),
  End: () => show(last),
  n: () => nextWorst(1),
  N: () => nextWorst(-1),
  " ": play,
  x: () => set({ a: state.b, b: state.a }),
  e: () => set({ ev: Math.min(state.ev + 0.5, 10) }),
  E: () => set({ ev: Math.max(state.ev - 0.5, -10) }),
  "+": () => view.zoomBy(2),
  "-": () => view.zoomBy(0.5),
  0: () => view.fit(),
  z: () => view.actual(),
};
MODES.forEach((mode, i) => (actions[i + 1] = () => set({ mode })));
addEventListener("keydown", (event) => {
  if (event.target.matches("input:not([type=radio], [type=range]), select, textarea") || event.altKey || event.ctrlKey || event.metaKey) return;
  if (event.target.matches("button, summary, a") && (event.key === " " || event.key === "Enter")) return;
  const action = actions[event.key];
  if (!action) return;
  event.preventDefault();
  // A key that is held down asks for frames faster than they come.
  if (!(event.repeat && isLoading)) action();
});

const on = (id, event, act) => byId(id)?.addEventListener(event, act);
on("previous", "click", actions.ArrowLeft);
on("next", "click", actions.ArrowRight);
on("worst", "click", actions.n);
on("play", "click", play);
on("fit", "click", actions[0]);
on("actual", "click", actions.z);
on("closer", "click", actions["+"]);
on("farther", "click", actions["-"]);
on("swap", "click", actions.x);
on("frame", "input", () => isLoading || show(Number(byId("frame").value)));
on("frame", "change", () => show(Number(byId("frame").value)));
for (const name of ["a", "b"]) on(name, "change", () => set({ [name]: byId(name).value }));
on("shown", "change", () => set({ shown: byId("shown").value }));
on("ev", "input", () => set({ ev: Number(byId("ev").value) }));
on("white", "change", () => Number(byId("white").value) > 0 && set({ white: Number(byId("white").value) }));
for (const radio of document.querySelectorAll("input[name=mode]")) radio.addEventListener("change", () => set({ mode: radio.value }));

byId("viewer").hidden = false;
byId("figures").remove();
byId("stage").dataset.renderer = screen instanceof GlScreen ? "webgl2" : "2d";
view.setMode(state.mode);
show();
