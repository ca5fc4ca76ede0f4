// Turns over a frame's images by slider, buttons or arrow keys. The next frame is fetched ahead, so that stepping does
// not flicker.

const byId = (id) => document.getElementById(id);

/**
 * `names`: of the images on the page; `base(frame)`: the address that their names are appended to; `query(name)`: what
 * follows them.
 */
export function viewer(names, base, query = () => "", file = (name) => name) {
  const slider = byId("frame");
  const last = Number(slider.max);

  function show(frame = Number(slider.value)) {
    frame = Math.min(Math.max(frame, 0), last);
    slider.value = frame;
    byId("frame-text").textContent = `frame ${frame} of ${last}`;
    for (const name of names) {
      const image = byId(`image-${name}`);
      image.src = `${base(frame)}/${file(name)}.png${query(name)}`;
      image.alt = `${file(name)} of frame ${frame}`;
      if (image.parentElement.tagName === "A") image.parentElement.href = image.src;
      byId(`exr-${name}`).href = `${base(frame)}/${file(name)}.exr`;
      if (frame < last) new Image().src = `${base(frame + 1)}/${file(name)}.png${query(name)}`;
    }
  }

  const step = (by) => show(Number(slider.value) + by);
  slider.addEventListener("input", () => show());
  byId("previous").addEventListener("click", () => step(-1));
  byId("next").addEventListener("click", () => step(1));
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input, select, textarea") || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === "ArrowLeft") step(-1);
    if (event.key === "ArrowRight") step(1);
  });
  return { show };
}
