// A job's page: follows it while it runs, and charts its frames.

import { draw, finite, format, shown } from "./chart.js";
import { follow, cancel } from "./progress.js";

const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);

if (data.running) {
  follow(data.job, {
    progress(job) {
      byId("progress").max = Math.max(job.n_total, 1);
      byId("progress").value = job.n_done;
      byId("progress-text").textContent =
        job.status === "queued" ? "waiting for its turn" : `${job.n_done} of ${job.n_total} frames`;
    },
    end: () => location.reload(),
  });
  cancel(byId("cancel"), data.job);
}

if (data.reports.length && byId("chart")) {
  await shown;
  const lists = await Promise.all(
    data.reports.map(({ id }) => fetch(`/api/v1/reports/${id}/frames`).then((answer) => answer.json())),
  );
  const frames = lists.map((list) => list.frames);
  const select = byId("metric");
  const first = frames[0];
  const lines = () =>
    data.reports.map((report, i) => ({
      name: report.name,
      values: frames[i].map((frame) => finite(frame.metrics[select.value])),
    }));
  const spec = () => {
    const [drawn, unit] = [lines(), data.units[select.value]];
    return {
      name: select.value,
      x: first.map((frame) => frame.index),
      lines: drawn,
      unit,
      xLabel: "frame (tinted: warm-up, not counted)",
      shaded: (i) => first[i].warmup,
      describe: (line, i) => [drawn[line].name, `frame ${first[i].index}`, `${format(drawn[line].values[i], unit)} ${unit}`],
      onPick: (line, i) => data.images && location.assign(`/reports/${data.reports[line].id}/frames/${first[i].index}`),
    };
  };
  const plot = draw(byId("chart"), spec());
  select.addEventListener("change", () => {
    plot.update(spec());
    const url = new URL(location.href);
    url.searchParams.set("metric", select.value);
    history.replaceState(null, "", url);
  });
}
