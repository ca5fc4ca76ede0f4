// Draws images of halves with WebGL2: exposure, tone mapping and false colour of every pixel in one pass.

import { NOT_FINITE, SHOWN, STOPS, TONEMAPS, palette } from "./pixels.js";

const VERTICES = `#version 300 es
void main() { gl_Position = vec4(vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID >> 1) * 4 - 1), 0, 1); }`;

/**
 * The shader for one way of looking. What differs between ways is constant in it: drivers that draw on the CPU run every
 * branch that a uniform chooses, and take several times as long.
 */
const fragments = ({ tonemap, shown, isMapA, isMapB, isDifference, n }) => `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D image_a, image_b, palette;
uniform vec2 size, origin;          // of the picture in its own pixels; where it begins on the canvas
uniform float zoom, height;         // canvas pixels for a picture's; the canvas's height
uniform vec2 scale_a, scale_b;      // black and white of maps
uniform float exposure, white;
out vec4 color;

const int tonemap = ${TONEMAPS.indexOf(tonemap)};
const int shown = ${SHOWN.indexOf(shown)};
const bool is_map_a = ${isMapA};
const bool is_map_b = ${isMapB};
const bool is_difference = ${isDifference};
const int n = ${n};                 // a canvas pixel is the mean of n² places
const vec3 NOT_FINITE = vec3(${NOT_FINITE.map((c) => (c / 255).toFixed(4)).join(", ")});

bool finite(vec3 v) { return !any(isnan(v)) && !any(isinf(v)); }
vec3 false_color(float level) {
    return texelFetch(palette, ivec2(int(clamp(level * 255.0, 0.0, 255.0) + 0.5), 0), 0).rgb;
}
vec3 encode(vec3 v) {
    v = min(v, 1.0);
    return mix(1.055 * pow(max(v, 1e-9), vec3(1.0 / 2.4)) - 0.055, 12.92 * v, lessThanEqual(v, vec3(0.0031308)));
}
vec3 displayed(vec3 linear) {
    vec3 v = max(linear, 0.0) * exposure;
    if (tonemap == 1) v /= 1.0 + max(max(v.r, v.g), v.b);
    if (tonemap == 2) v = v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14);
    return encode(v);
}
vec3 texel(sampler2D image, vec2 at) {
    ivec2 extent = textureSize(image, 0);
    return texelFetch(image, min(ivec2(at / size * vec2(extent)), extent - 1), 0).rgb;
}
float level(float value, vec2 scale) { return (value - scale.x) / (scale.y - scale.x); }
vec3 show(vec3 v) {
    if (is_map_a) return isnan(v.r) || isinf(v.r) ? NOT_FINITE : false_color(level(v.r, scale_a));
    if (!finite(v)) return NOT_FINITE;
    if (shown == 0) return displayed(v);
    if (shown < 4) return vec3(displayed(vec3(v[(shown + 2) % 3])).r);
    float y = dot(v, vec3(0.2126, 0.7152, 0.0722)) * exposure;
    return false_color((log2(max(y, 1e-9)) - ${STOPS[0].toFixed(1)}) / ${(STOPS[1] - STOPS[0]).toFixed(1)});
}
vec3 at(vec2 place) {
    vec3 a = texel(image_a, place);
    if (!is_difference) return show(a);
    vec3 b = texel(image_b, place);
    if (is_map_a || is_map_b) {
        float d = abs((is_map_a ? level(a.r, scale_a) : a.r) - (is_map_b ? level(b.r, scale_b) : b.r));
        return isnan(d) || isinf(d) ? NOT_FINITE : false_color(d);
    }
    if (!finite(a) || !finite(b)) return NOT_FINITE;
    return false_color(dot(abs(displayed(a) - displayed(b)), vec3(1.0 / 3.0)) / white);
}
void main() {
    vec2 place = (vec2(gl_FragCoord.x, height - gl_FragCoord.y) - origin) / zoom;
    if (any(lessThan(place, vec2(0.0))) || any(greaterThanEqual(place, size))) { color = vec4(0.0); return; }
    if (n == 1) { color = vec4(at(place), 1.0); return; }
    vec2 corner = place - 0.5 / zoom;
    vec3 sum = vec3(0.0);
    for (int y = 0; y < n; y++) for (int x = 0; x < n; x++) {
        vec2 here = corner + (vec2(x, y) + 0.5) / (zoom * float(n));
        sum += at(clamp(here, vec2(0.0), size - 0.5));
    }
    color = vec4(sum / float(n * n), 1.0);
}`;

/** How many images stay on the GPU. */
const MAX_TEXTURES = 24;
/** How many canvases are kept drawn. */
const MAX_DRAWN = 6;

export class GlScreen {
  /** Nothing where the browser has no WebGL2. `redraw` is called once the browser gives back a context that it took. */
  static on(canvas, redraw) {
    const gl = canvas.getContext("webgl2", { antialias: false, premultipliedAlpha: false, preserveDrawingBuffer: true });
    if (!gl) return null;
    const screen = new GlScreen(gl);
    // Otherwise it would not come back.
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      screen.begin();
      redraw();
    });
    return screen;
  }

  constructor(gl) {
    this.gl = gl;
    this.begin();
  }

  /** Everything that a context owns, made anew. */
  begin() {
    const { gl } = this;
    this.textures = new Map();
    this.programs = new Map();
    this.drawn = new Map();
    this.palette = texture(gl, gl.RGBA8, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, palette);
    gl.bindVertexArray(gl.createVertexArray());
    gl.enable(gl.SCISSOR_TEST);
  }

  /** The program for a way of looking, made at its first use. */
  program(look) {
    const key = JSON.stringify(look);
    if (!this.programs.has(key)) this.programs.set(key, new Program(this.gl, fragments(look)));
    return this.programs.get(key);
  }

  /** Draws what is likely to be asked for soon, out of sight: drivers that draw on the CPU take a tenth of a second. */
  prepare(panes, look) {
    const { gl, drawn } = this;
    const key = keyOf(gl.canvas, panes, look);
    if (drawn.has(key) || gl.isContextLost()) return;
    const { width, height } = gl.canvas;
    const image = texture(gl, gl.RGBA8, width, height, gl.RGBA, gl.UNSIGNED_BYTE, null);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, image, 0);
    this.render(panes, look);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    drawn.set(key, { frame, image });
    for (const [old, one] of drawn) {
      if (drawn.size <= MAX_DRAWN) break;
      gl.deleteFramebuffer(one.frame);
      gl.deleteTexture(one.image);
      drawn.delete(old);
    }
  }

  /** Settled once what was drawn last can be seen. */
  async finished() {
    const { gl } = this;
    if (gl.isContextLost()) return;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise((resolve) => setTimeout(resolve, 2));
    gl.deleteSync(fence);
  }

  texture(image) {
    const { gl, textures } = this;
    let found = textures.get(image);
    textures.delete(image);
    const isMap = image.channels === 1;
    found ??= texture(gl, isMap ? gl.R16F : gl.RGB16F, image.width, image.height, isMap ? gl.RED : gl.RGB, gl.HALF_FLOAT, image.halves);
    textures.set(image, found);
    for (const [old, handle] of textures) {
      if (textures.size <= MAX_TEXTURES) break;
      gl.deleteTexture(handle);
      textures.delete(old);
    }
    return found;
  }

  /** Each pane: { clip: [x, y, width, height], origin, zoom, size, a, b }, all in canvas pixels from the top left. */
  draw(panes, look) {
    const { gl } = this;
    if (gl.isContextLost()) return;
    const { width, height } = gl.canvas;
    const ready = this.drawn.get(keyOf(gl.canvas, panes, look));
    if (!ready) {
      this.render(panes, look);
      return;
    }
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, ready.frame);
    gl.scissor(0, 0, width, height);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
  }

  /** Into the framebuffer that is bound. */
  render(panes, { display, ev, shown, white }) {
    const { gl } = this;
    const { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    gl.scissor(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const { clip, origin, zoom, size, a, b } of panes) {
      const [x, y, w, h] = clip.map(Math.round);
      gl.scissor(x, height - y - h, w, h);
      const { program, places } = this.program({
        tonemap: display.tonemap,
        shown,
        isMapA: a.channels === 1,
        isMapB: b?.channels === 1,
        isDifference: Boolean(b),
        // Smaller than it is: the pixels that a canvas pixel covers.
        n: Math.min(Math.max(Math.ceil(1 / zoom), 1), 8),
      });
      gl.useProgram(program);
      [this.texture(a), this.texture(b ?? a), this.palette].forEach((bound, i) => {
        gl.activeTexture(gl.TEXTURE0 + i);
        gl.bindTexture(gl.TEXTURE_2D, bound);
        gl.uniform1i(places[["image_a", "image_b", "palette"][i]], i);
      });
      gl.uniform2fv(places.scale_a, a.scale ?? [0, 1]);
      gl.uniform2fv(places.scale_b, b?.scale ?? [0, 1]);
      gl.uniform1f(places.exposure, display.exposure * 2 ** ev);
      gl.uniform1f(places.white, white);
      gl.uniform1f(places.height, height);
      gl.uniform2fv(places.size, size);
      gl.uniform2fv(places.origin, origin);
      gl.uniform1f(places.zoom, zoom);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
  }
}

/** What a drawn canvas depends on. */
const keyOf = ({ width, height }, panes, look) =>
  JSON.stringify([width, height, look, panes.map(({ a, b, ...pane }) => [pane, a.href, b?.href])]);

/** A linked program, and where its uniforms are by name; one that a look has no use for is nowhere. */
class Program {
  constructor(gl, fragments) {
    const made = gl.createProgram();
    for (const [type, text] of [
      [gl.VERTEX_SHADER, VERTICES],
      [gl.FRAGMENT_SHADER, fragments],
    ]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    this.program = made;
    this.places = {};
    for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(made, i);
      this.places[name] = gl.getUniformLocation(made, name);
    }
  }
}

function texture(gl, internal, width, height, layout, type, data) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, layout, type, data);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  return made;
}
