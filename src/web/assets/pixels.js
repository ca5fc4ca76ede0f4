// Images as numbers: fetched as halves, kept while there is room, and turned into what a display shows by the same formulas
// as the service's pictures.

/** What is kept, in bytes: some seconds of a flip-book at 1080p. */
const ROOM = 600e6;
const kept = new Map();

/** The image at an address: { width, height, channels, halves, scale }, where a map's scale is [black, white]. */
export function load(href) {
  const known = kept.get(href);
  if (known) {
    // The newest is last.
    kept.delete(href);
    kept.set(href, known);
    return known.image;
  }
  const entry = { bytes: 0, image: fetched(href) };
  entry.image.then(
    ({ halves }) => {
      entry.bytes = halves.byteLength;
      tidy();
    },
    () => kept.delete(href),
  );
  kept.set(href, entry);
  return entry.image;
}

function tidy() {
  let sum = [...kept.values()].reduce((bytes, entry) => bytes + entry.bytes, 0);
  for (const [href, entry] of kept) {
    if (sum <= ROOM) return;
    if (!entry.bytes) continue;
    sum -= entry.bytes;
    kept.delete(href);
  }
}

async function fetched(href) {
  // Past the browser's own cache, which would take longer to write so much to disk than the service takes to make it.
  const answer = await fetch(href, { cache: "no-store" });
  if (!answer.ok) throw new Error((await answer.json()).detail);
  const [width, height, channels] = answer.headers.get("x-afterimage-size").split("x").map(Number);
  const scale = answer.headers.get("x-afterimage-scale")?.split(",").map(Number);
  return { href, width, height, channels, scale, halves: new Uint16Array(await answer.arrayBuffer()) };
}

let values;

/** The number that each half stands for. */
export function decoded() {
  if (values) return values;
  values = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const [sign, exponent, fraction] = [bits >> 15 ? -1 : 1, (bits >> 10) & 31, bits & 1023];
    if (exponent === 31) values[bits] = fraction ? NaN : sign * Infinity;
    else values[bits] = sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
  }
  return values;
}

/** An image's values at a place given in shares of its size. */
export function at(image, u, v) {
  const x = Math.min(Math.floor(u * image.width), image.width - 1);
  const y = Math.min(Math.floor(v * image.height), image.height - 1);
  const start = (y * image.width + x) * image.channels;
  return Array.from(image.halves.subarray(start, start + image.channels), (bits) => decoded()[bits]);
}

/** D. A. Green's colour scheme of 2011, as the service draws maps with: bytes for a level of 0 to 1. */
export function cubehelix(level) {
  const angle = 2 * Math.PI * (0.5 / 3 + 1 - 1.5 * level);
  const amplitude = (level * (1 - level)) / 2;
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  const waves = [-0.14861 * cos + 1.78277 * sin, -0.29227 * cos - 0.90649 * sin, 1.97294 * cos];
  return waves.map((wave) => Math.round(Math.min(Math.max(255 * (level + amplitude * wave), 0), 255)));
}

/** Its 256 colours, red, green, blue and 255 each. */
export const palette = new Uint8Array(Array.from({ length: 256 }, (_, i) => [...cubehelix(i / 255), 255]).flat());

export const TONEMAPS = ["none", "reinhard_max", "aces"];
export const SHOWN = ["color", "red", "green", "blue", "luminance"];
export const NOT_FINITE = [255, 0, 255];

/** Stops of luminance that false colour spreads from black to white, about 1. */
export const STOPS = [-10, 6];

const encode = (value) => {
  const v = Math.min(value, 1);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
};

/** Display values of linear colour, 0 to 1. */
export function displayed([r, g, b], { exposure, tonemap }) {
  const [x, y, z] = [r, g, b].map((value) => Math.max(value, 0) * exposure);
  if (tonemap === "reinhard_max") {
    const scale = 1 / (1 + Math.max(x, y, z));
    return [encode(x * scale), encode(y * scale), encode(z * scale)];
  }
  const aces = (v) => (v * (2.51 * v + 0.03)) / (v * (2.43 * v + 0.59) + 0.14);
  return tonemap === "aces" ? [encode(aces(x)), encode(aces(y)), encode(aces(z))] : [encode(x), encode(y), encode(z)];
}

export const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;
