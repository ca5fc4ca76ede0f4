// Draws images of halves without WebGL: each whole picture is computed once for each look, then scaled by the browser.

import { NOT_FINITE, STOPS, decoded, displayed, luminance, palette } from "./pixels.js";

/** Pictures that stay computed: of the frame that is shown and of those that steps lead to. */
const MAX_PICTURES = 12;

export class PlainScreen {
  constructor(canvas) {
    this.context = canvas.getContext("2d");
    this.pictures = new Map();
  }

  /** Computes what is likely to be asked for soon. */
  prepare(panes, look) {
    for (const { a, b } of panes) this.picture(a, b, look);
  }

  /** Settled once what was drawn last can be seen. */
  async finished() {}

  draw(panes, look) {
    const { context } = this;
    context.clearRect(0, 0, context.canvas.width, context.canvas.height);
    for (const { clip, origin, zoom, size, a, b } of panes) {
      context.save();
      context.beginPath();
      context.rect(...clip);
      context.clip();
      context.imageSmoothingEnabled = zoom < 1;
      context.drawImage(this.picture(a, b, look), ...origin, size[0] * zoom, size[1] * zoom);
      context.restore();
    }
  }

  picture(a, b, look) {
    const key = JSON.stringify([a.href, b?.href, look]);
    let found = this.pictures.get(key);
    this.pictures.delete(key);
    found ??= computed(a, b, look);
    this.pictures.set(key, found);
    for (const old of this.pictures.keys()) {
      if (this.pictures.size <= MAX_PICTURES) break;
      this.pictures.delete(old);
    }
    return found;
  }
}

function computed(a, b, look) {
  const { width, height } = a;
  const picture = new OffscreenCanvas(width, height);
  const context = picture.getContext("2d");
  const data = context.createImageData(width, height);
  const bytes = new Uint32Array(data.data.buffer);
  const [r, g, b_] = NOT_FINITE;
  const notFinite = pack(r, g, b_);
  const colors = Array.from({ length: 256 }, (_, i) => pack(palette[4 * i], palette[4 * i + 1], palette[4 * i + 2]));
  const falseColor = (level) => (Number.isFinite(level) ? colors[Math.round(Math.min(Math.max(level, 0), 1) * 255)] : notFinite);
  const pixel = b ? difference(a, b, look, falseColor, notFinite) : one(a, look, falseColor, notFinite);
  for (let i = 0; i < bytes.length; i++) bytes[i] = pixel(i);
  context.putImageData(data, 0, 0);
  return picture;
}

const pack = (r, g, b) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;

/** The browser's numbers lie as halves lie: little end first. */
function one(image, { display, ev, shown }, falseColor, notFinite) {
  const [values, halves] = [decoded(), image.halves];
  if (image.channels === 1) return (i) => falseColor(level(image, values[halves[i]]));
  const shownAs = { exposure: display.exposure * 2 ** ev, tonemap: display.tonemap };
  const channel = ["red", "green", "blue"].indexOf(shown);
  // Of a colour without a common divisor, each channel is looked up by its bits.
  const alone = display.tonemap === "reinhard_max" && shown === "color" ? null : lookUp(shownAs);
  return (i) => {
    const [r, g, b] = [halves[3 * i], halves[3 * i + 1], halves[3 * i + 2]];
    const color = [values[r], values[g], values[b]];
    if (!Number.isFinite(color[0] + color[1] + color[2])) return notFinite;
    if (shown === "luminance") {
      const stops = Math.log2(Math.max(luminance(color) * shownAs.exposure, 1e-9));
      return falseColor((stops - STOPS[0]) / (STOPS[1] - STOPS[0]));
    }
    if (channel >= 0) {
      const byte = alone[halves[3 * i + channel]];
      return pack(byte, byte, byte);
    }
    if (alone) return pack(alone[r], alone[g], alone[b]);
    return pack(...displayed(color, shownAs).map((value) => Math.round(255 * value)));
  };
}

function lookUp(shownAs) {
  const grey = (value) => Math.round(255 * displayed([value, value, value], shownAs)[0]);
  return Uint8Array.from(decoded(), (value) => (Number.isFinite(value) ? grey(value) : 0));
}

const level = ({ scale: [black, white] }, value) => (value - black) / (white - black);

function difference(a, b, { display, ev, white }, falseColor, notFinite) {
  const values = decoded();
  const shownAs = { exposure: display.exposure * 2 ** ev, tonemap: display.tonemap };
  const there = (i) => {
    const [x, y] = [i % a.width, Math.floor(i / a.width)];
    return Math.floor(((y + 0.5) * b.height) / a.height) * b.width + Math.floor(((x + 0.5) * b.width) / a.width);
  };
  const color = (image, i) => [0, 1, 2].map((c) => values[image.halves[3 * i + c]]);
  if (a.channels === 1 || b.channels === 1) {
    const number = (image, i) => (image.channels === 1 ? level(image, values[image.halves[i]]) : values[image.halves[3 * i]]);
    return (i) => falseColor(Math.abs(number(a, i) - number(b, there(i))));
  }
  return (i) => {
    const [p, q] = [color(a, i), color(b, there(i))];
    if (![...p, ...q].every(Number.isFinite)) return notFinite;
    const [s, t] = [displayed(p, shownAs), displayed(q, shownAs)];
    return falseColor((Math.abs(s[0] - t[0]) + Math.abs(s[1] - t[1]) + Math.abs(s[2] - t[2])) / 3 / white);
  };
}
