// A sequence's page: turns over its frames by slider, buttons or arrow keys. The next frame is fetched ahead, so that
// stepping does not flicker.

const byId = (id) => document.getElementById(id);
const { hash } = JSON.parse(byId("data").textContent);
const slider = byId("frame");
const last = Number(slider.max);
const asked = Number(new URL(location.href).searchParams.get("frame") ?? 0);
const names = ["input", "reference"].filter((name) => byId(`image-${name}`));
const file = (frame, name) => `/api/v1/sequences/${hash}/frames/${frame}/${name}`;

function show(frame = Number(slider.value)) {
  frame = Math.min(Math.max(frame, 0), last);
  slider.value = frame;
  byId("frame-text").textContent = `frame ${frame} of ${last}`;
  for (const name of names) {
    const image = byId(`image-${name}`);
    image.src = `${file(frame, name)}.png`;
    image.alt = `${name} of frame ${frame}`;
    byId(`exr-${name}`).href = `${file(frame, name)}.exr`;
    if (frame < last) new Image().src = `${file(frame + 1, name)}.png`;
  }
  const url = new URL(location.href);
  url.searchParams.set("frame", frame);
  history.replaceState(null, "", url);
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
if (asked > 0) show(asked);
