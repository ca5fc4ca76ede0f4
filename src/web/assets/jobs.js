// The list of jobs: how far each is, as long as any waits or runs. One question for all of them, because a browser opens few
// streams at once.

import { cancel } from "./progress.js";

const rows = [...document.querySelectorAll("tr[data-live]")];
for (const row of rows) cancel(row.querySelector("button"), row.dataset.job);

async function ask() {
  const lists = await Promise.all(
    ["running", "queued"].map((status) => fetch(`/api/v1/jobs?status=${status}&limit=1000`).then((answer) => answer.json())),
  );
  const jobs = new Map(lists.flatMap((list) => list.jobs).map((job) => [String(job.id), job]));
  for (const row of rows) {
    const job = jobs.get(row.dataset.job);
    // Its end has an error, a time and reports: the page says them better.
    if (!job) return location.reload();
    row.querySelector(".status").className = `status ${job.status}`;
    row.querySelector(".status").textContent = job.cancel_requested ? "stopping" : job.status;
    const bar = row.querySelector("progress");
    [bar.max, bar.value] = [Math.max(job.n_total, 1), job.n_done];
    row.querySelector(".done").textContent = job.n_total ? `${job.n_done} of ${job.n_total}` : "";
  }
  setTimeout(ask, 700);
}

if (rows.length) ask();
