// A job's progress while it runs, and its end.

/** Calls `progress(job)` for each step and `end(job)` once. */
export function follow(id, { progress, end }) {
  const events = new EventSource(`/api/v1/jobs/${id}/events`);
  events.addEventListener("progress", (event) => progress(JSON.parse(event.data)));
  for (const name of ["done", "failed", "cancelled"]) {
    events.addEventListener(name, (event) => {
      events.close();
      end(JSON.parse(event.data));
    });
  }
}

/** Makes a button cancel a job. */
export function cancel(button, id) {
  button.addEventListener("click", async () => {
    button.disabled = true;
    const answer = await fetch(`/api/v1/jobs/${id}`, { method: "DELETE" });
    if (!answer.ok) button.textContent = (await answer.json()).detail;
  });
}
