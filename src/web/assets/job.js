// A job's page: follows it while it runs, charts its frames, and turns over its images.

import { draw, finite } from "./chart.js";
import { viewer } from "./viewer.js";

const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);

if (data.running) follow();
const frames = data.reports.length && byId("figures") ? images() : null;
if (data.reports.length && byId("chart")) chart();

function follow() {
  const events = new EventSource(`/api/v1/jobs/${data.job}/events`);
  events.addEventListener("progress", (event) => {
    const job = JSON.parse(event.data);
    byId("progress").max = Math.max(job.n_total, 1);
    byId("progress").value = job.n_done;
    byId("progress-text").textContent =
      job.status === "queued" ? "waiting for its turn" : `${job.n_done} of ${job.n_total} frames`;
  });
  for (const end of ["done", "failed", "cancelled"]) {
    events.addEventListener(end, () => {
      events.close();
      location.reload();
    });
  }
  byId("cancel").addEventListener("click", async (event) => {
    event.target.disabled = true;
    await fetch(`/api/v1/jobs/${data.job}`, { method: "DELETE" });
  });
}

function chart() {
  const select = byId("metric");
  const first = data.reports[0].frames;
  const lines = () =>
    data.reports.map((report) => ({
      name: report.name,
      values: report.frames.map((frame) => finite(frame.metrics[select.value])),
    }));
  const plot = draw(byId("chart"), {
    x: first.map((frame) => frame.index),
    lines: lines(),
    unit: data.units[select.value],
    xLabel: "frame (tinted: warm-up, not counted)",
    shaded: (i) => first[i].warmup,
    onPick: (i) => frames?.show(i),
  });
  select.addEventListener("change", () => plot.update({ lines: lines(), unit: data.units[select.value] }));
}

function images() {
  const names = data.reference ? ["output", "reference", "error"] : ["output"];
  const preset = byId("preset");
  const max = byId("max");
  const map = byId("map");
  const view = viewer(
    names,
    (frame) => `/api/v1/reports/${data.reports[preset.value].id}/frames/${frame}`,
    (name) => (name === "error" && map.value === "error" ? `?max=${max.value}` : ""),
    (name) => (name === "error" ? map.value : name),
  );
  preset.addEventListener("change", () => view.show());
  max?.addEventListener("change", () => {
    byId("max-text").textContent = max.value;
    view.show();
  });
  map?.addEventListener("change", () => {
    byId("error-name").textContent = map.value === "error" ? "Error" : map.value;
    byId("error-scale").hidden = map.value !== "error";
    view.show();
  });
  byId("viewer").addEventListener("submit", (event) => event.preventDefault());
  return view;
}
