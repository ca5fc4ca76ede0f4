// Where a picture lies on the canvas: zoom and pan by mouse, touch and keys, the divider of a swipe, and the values of the
// pixel under the pointer. Knows nothing of what is drawn.

const MAX_ZOOM = 256;
/** Where a pixel is so large, its values are written into it, in CSS pixels. */
const WRITTEN = 52;
const digits = (value) => (Number.isFinite(value) ? (Math.abs(value) >= 1e-3 || value === 0 ? value.toPrecision(4) : value.toExponential(2)) : String(value));

/**
 * `view`: { x, y, zoom } with the picture's pixel at the middle and CSS pixels for one of its, or nothing to fit;
 * `draw(layout)`; `changed(view, split)`; `values(u, v)`: [{ name, values }] at a place in shares of the picture.
 */
export function stage(box, { view, split, draw, changed, values }) {
  const canvas = box.querySelector("#canvas");
  const overlay = box.querySelector("#overlay");
  const readout = document.getElementById("pixel");
  let size = null;
  let mode = "swipe";
  let fitted = !view;
  let pointer = null;
  let queued = false;

  const ratio = () => devicePixelRatio || 1;
  // Beside each other, each picture has half of the room.
  const room = () => [box.clientWidth / (mode === "side" ? 2 : 1), box.clientHeight];

  function fitting() {
    const [width, height] = room();
    const zoom = Math.min(width / size[0], height / size[1]);
    return { x: size[0] / 2, y: size[1] / 2, zoom: zoom > 1 ? Math.floor(zoom * ratio()) / ratio() : zoom };
  }

  function layout() {
    const [width, height] = room();
    const zoom = view.zoom * ratio();
    return {
      size,
      zoom,
      split,
      origin: [Math.round((width / 2) * ratio() - view.x * zoom), Math.round((height / 2) * ratio() - view.y * zoom)],
    };
  }

  function redraw() {
    if (!size || queued) return;
    queued = true;
    requestAnimationFrame(now);
  }

  function now() {
    queued = false;
    if (fitted) view = fitting();
    const [width, height] = [box.clientWidth, box.clientHeight].map((n) => Math.round(n * ratio()));
    for (const one of [canvas, overlay]) {
      if (one.width !== width || one.height !== height) [one.width, one.height] = [width, height];
    }
    const placed = layout();
    draw(placed);
    write(placed);
    box.dataset.zoom = view.zoom;
    box.dataset.draws = Number(box.dataset.draws ?? 0) + 1;
    tell();
  }

  function change(next) {
    fitted = false;
    const zoom = Math.min(Math.max(next.zoom, 0.05), MAX_ZOOM);
    view = { x: Math.min(Math.max(next.x, 0), size[0]), y: Math.min(Math.max(next.y, 0), size[1]), zoom };
    redraw();
    changed(view, split);
  }

  /** The picture's place under a place of the stage, in its pixels. */
  function under([left, top]) {
    const [width, height] = room();
    return [view.x + ((left % width) - width / 2) / view.zoom, view.y + (top - height / 2) / view.zoom];
  }

  function zoomBy(factor, place = room().map((n) => n / 2)) {
    const [x, y] = under(place);
    const zoom = Math.min(Math.max(view.zoom * factor, 0.05), MAX_ZOOM);
    const [width, height] = room();
    change({ zoom, x: x - ((place[0] % width) - width / 2) / zoom, y: y - (place[1] - height / 2) / zoom });
  }

  /** Divider, and values in pixels that are large enough. */
  function write(placed) {
    const context = overlay.getContext("2d");
    context.clearRect(0, 0, overlay.width, overlay.height);
    if (mode === "swipe") {
      const x = Math.round(overlay.width * split);
      context.fillStyle = "#fff";
      context.fillRect(x - 1, 0, 2, overlay.height);
      context.fillStyle = "#000";
      context.fillRect(x + 1, 0, 1, overlay.height);
    }
    if (view.zoom < WRITTEN) return;
    const line = Math.min(view.zoom / 4.5, 13) * ratio();
    context.font = `${line}px ui-monospace, monospace`;
    context.textAlign = "center";
    context.lineWidth = 3 * ratio();
    context.strokeStyle = "#000";
    context.fillStyle = "#fff";
    const [width, height] = room().map((n) => n * ratio());
    const from = (i) => Math.max(0, Math.floor(-placed.origin[i] / placed.zoom));
    const to = (i, length) => Math.min(size[i], Math.ceil((length - placed.origin[i]) / placed.zoom));
    for (let y = from(1); y < to(1, height); y++) {
      for (let x = from(0); x < to(0, width); x++) {
        const shown = values((x + 0.5) / size[0], (y + 0.5) / size[1]);
        if (!shown) return;
        const left = placed.origin[0] + (x + 0.5) * placed.zoom;
        const isRight = mode === "swipe" && left > overlay.width * split;
        pixel(context, left, placed.origin[1] + (y + 0.5) * placed.zoom, line, shown[isRight ? 1 : 0].values);
        if (mode === "side") pixel(context, left + Math.floor(overlay.width / 2), placed.origin[1] + (y + 0.5) * placed.zoom, line, shown[1].values);
      }
    }
  }

  function pixel(context, x, y, line, numbers) {
    numbers.forEach((value, i) => {
      const at = y + (i - (numbers.length - 1) / 2) * line * 1.15 + line * 0.35;
      context.strokeText(digits(value), x, at);
      context.fillText(digits(value), x, at);
    });
  }

  function tell() {
    if (!size) return;
    const [x, y] = (pointer ? under(pointer) : [view.x, view.y]).map(Math.floor);
    const isInside = x >= 0 && y >= 0 && x < size[0] && y < size[1];
    const shown = isInside && values((x + 0.5) / size[0], (y + 0.5) / size[1]);
    readout.textContent = shown
      ? `(${x}, ${y})  ${shown.map(({ name, values: of }) => `${name}  ${of.map(digits).join("  ")}`).join("   ·   ")}`
      : "outside the image";
  }

  const placeOf = (event) => {
    const { left, top } = box.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  };
  const fingers = new Map();
  let dragging = null;
  box.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !size) return;
    box.setPointerCapture(event.pointerId);
    const place = placeOf(event);
    fingers.set(event.pointerId, place);
    dragging = mode === "swipe" && Math.abs(place[0] - box.clientWidth * split) < 12 ? "divider" : "picture";
  });
  box.addEventListener("pointermove", (event) => {
    const place = placeOf(event);
    pointer = place;
    const before = fingers.get(event.pointerId);
    if (!before || !size) return tell();
    if (dragging === "divider") {
      split = Math.min(Math.max(place[0] / box.clientWidth, 0), 1);
      redraw();
      return changed(fitted ? null : view, split);
    }
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      zoomBy(apart(place) / Math.max(apart(before), 1), [(place[0] + other[0]) / 2, (place[1] + other[1]) / 2]);
    } else {
      change({ ...view, x: view.x - (place[0] - before[0]) / view.zoom, y: view.y - (place[1] - before[1]) / view.zoom });
    }
    fingers.set(event.pointerId, place);
    return undefined;
  });
  for (const name of ["pointerup", "pointercancel"]) {
    box.addEventListener(name, (event) => {
      fingers.delete(event.pointerId);
      dragging = null;
    });
  }
  box.addEventListener("pointerleave", () => {
    pointer = null;
    tell();
  });
  box.addEventListener(
    "wheel",
    (event) => {
      if (!size) return;
      event.preventDefault();
      zoomBy(2 ** (-event.deltaY / 240), placeOf(event));
    },
    { passive: false },
  );
  box.addEventListener("dblclick", () => fit());
  box.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!by || !event.shiftKey || !size) return;
    event.preventDefault();
    event.stopPropagation();
    const step = Math.max(1, 40 / view.zoom);
    change({ ...view, x: view.x + by[0] * step, y: view.y + by[1] * step });
  });
  new ResizeObserver(redraw).observe(box);
  addEventListener("themechange", redraw);

  function fit() {
    fitted = true;
    redraw();
    changed(null, split);
  }

  return {
    redraw,
    fit,
    /** Where the picture lies. */
    layout,
    zoomBy: (factor) => size && zoomBy(factor),
    actual: () => size && change({ ...view, zoom: 1 / ratio() }),
    setMode(next) {
      mode = next;
      redraw();
    },
    /** Takes a picture of this size and draws it. */
    resize(next) {
      size = next;
      now();
    },
  };
}
