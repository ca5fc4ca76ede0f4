// Sends an endpoint's form and shows the answer.

const shown = async (response) => {
  const type = response.headers.get("content-type") ?? "";
  const text = type.includes("json")
    ? JSON.stringify(await response.json(), null, 2)
    : type.startsWith("text/") || type === ""
      ? await response.text()
      : `${(await response.blob()).size} bytes of ${type}`;
  return `${response.status} ${response.statusText}\n\n${text.slice(0, 20000)}`;
};

const send = async (form) => {
  let path = form.dataset.path;
  const query = new URLSearchParams();
  const headers = {};
  for (const input of form.querySelectorAll("input[data-in]")) {
    if (input.value === "") continue;
    if (input.dataset.in === "path") path = path.replace(`{${input.name}}`, encodeURIComponent(input.value));
    if (input.dataset.in === "query") query.set(input.name, input.value);
    if (input.dataset.in === "header") headers[input.name] = input.value;
  }
  const token = document.querySelector("#token").value;
  if (token) headers.authorization = `Bearer ${token}`;
  const options = { method: form.dataset.method, headers };
  if (form.elements.body) {
    headers["content-type"] = "application/json";
    options.body = form.elements.body.value;
  } else if (form.elements.file?.files.length) {
    options.body = form.elements.file.files[0];
  }
  const search = query.size ? `?${query}` : "";
  return shown(await fetch(`/api/v1${path}${search}`, options));
};

for (const form of document.querySelectorAll("form.try")) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const answer = form.querySelector(".answer");
    answer.hidden = false;
    answer.textContent = "…";
    try {
      answer.textContent = await send(form);
    } catch (error) {
      answer.textContent = String(error);
    }
  });
}

// A link to an endpoint or a schema opens it.
const open = () => {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target instanceof HTMLDetailsElement) target.open = true;
};
addEventListener("hashchange", open);
open();
