// The form of a new job: parameters of the recipes that are ticked, the request that it amounts to, and its sending.

const { body: given, path, plain } = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const form = byId("job");
const element = (name, properties, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

/** What was given of presets, by id: the parameters that were changed. */
const before = new Map((given.presets ?? []).map((one) => (typeof one === "string" ? [one, {}] : [one.preset, one.parameters ?? {}])));

function control(parameter, value) {
  const { name, type } = parameter;
  if (type === "flag") return element("input", { type: "checkbox", name, checked: value });
  if (type === "choice") {
    const select = element("select", { name });
    for (const { name: one, description } of parameter.values) select.append(element("option", { value: one, textContent: one, title: description }));
    select.value = value;
    return select;
  }
  return element("input", { type: "number", name, value, min: parameter.min, max: parameter.max ?? "", step: type !== "integer" ? "any" : parameter.odd ? 2 : 1, required: true });
}

const read = (input, type) => (type === "flag" ? input.checked : type === "choice" ? input.value : Number(input.value));

/** Fills a preset's parameters once they are wanted. */
async function parameters(box) {
  const place = box.querySelector(".parameters");
  if (place.childElementCount) return;
  place.textContent = "…";
  const recipe = await (await fetch(`/api/v1/recipes/${box.dataset.preset}`)).json();
  const changed = before.get(recipe.id) ?? {};
  const rows = recipe.parameters.map((parameter) => {
    const input = control(parameter, changed[parameter.name] ?? parameter.default);
    input.dataset.type = parameter.type;
    input.dataset.usual = JSON.stringify(parameter.default);
    const most = parameter.max == null ? "" : ` to ${parameter.max}`;
    const range = parameter.min == null ? "" : `${parameter.odd ? "odd, " : ""}${parameter.excludes_min ? "above " : ""}${parameter.min}${most}`;
    const words = [parameter.unit, range, `usually ${parameter.default}`].filter(Boolean).join(", ");
    return element("label", { title: parameter.description }, element("code", { textContent: parameter.name }), input, element("span", { className: "muted", textContent: words }));
  });
  place.replaceChildren(element("p", { className: "muted", textContent: recipe.publication }), ...rows);
  write();
}

/** The parameters of a preset that differ from what it publishes. */
function overrides(box) {
  const inputs = [...box.querySelectorAll(".parameters [name]")];
  if (!inputs.length) return before.get(box.dataset.preset) ?? {};
  const changed = inputs.filter((input) => JSON.stringify(read(input, input.dataset.type)) !== input.dataset.usual);
  for (const input of inputs) input.classList.toggle("changed-value", changed.includes(input));
  return Object.fromEntries(changed.map((input) => [input.name, read(input, input.dataset.type)]));
}

/** The request that the form amounts to. */
function request() {
  if (!plain) return JSON.parse(form.elements.body.value);
  const { elements } = form;
  const ticked = (name) => [...form.querySelectorAll(`input[name=${name}]:checked`)].map((input) => input.value);
  const presets = ticked("preset").map((id) => {
    const changed = overrides(form.querySelector(`[data-preset="${id}"]`));
    return Object.keys(changed).length ? { preset: id, parameters: changed } : id;
  });
  const body = { sequence: elements.sequence.value, presets, metrics: ticked("metric") };
  const usual = { history: "f16", images: "half", repeat: 1, project: "default" };
  for (const name of ["history", "images"]) if (elements[name].value !== usual[name]) body[name] = elements[name].value;
  if (Number(elements.repeat.value) !== 1) body.repeat = Number(elements.repeat.value);
  if (elements.frames.value) body.frames = Number(elements.frames.value);
  for (const name of ["validate", "bisect"]) if (elements[name].checked) body[name] = true;
  for (const name of ["project", "branch", "commit", "label"]) {
    if (elements[name].value && elements[name].value !== usual[name]) body[name] = elements[name].value;
  }
  // What a job that is run again was asked beside.
  for (const name of ["skip", "until", "force"]) if (given[name] && given[name] !== "off") body[name] = given[name];
  return body;
}

function write() {
  let text;
  try {
    text = JSON.stringify(request(), null, 2).replaceAll("'", "'\\''");
  } catch (error) {
    return complain(`The request is no JSON: ${error.message}`);
  }
  byId("curl").textContent = `curl ${location.origin}/api/v1${path} -H 'content-type: application/json' -d '${text}'`;
  return undefined;
}

function complain(text) {
  byId("trouble").hidden = !text;
  byId("trouble").textContent = text;
  if (text) byId("trouble").scrollIntoView({ block: "nearest" });
}

form.addEventListener("input", write);
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  complain("");
  const button = form.querySelector("button.main, button");
  button.disabled = true;
  try {
    const answer = await fetch(`/api/v1${path}`, {
      method: "POST",
      headers: { "content-type": "application/json", "idempotency-key": crypto.randomUUID() },
      body: JSON.stringify(request()),
    });
    const found = await answer.json();
    if (answer.ok) return location.assign(`/jobs/${found.id}`);
    complain(found.field ? `${found.field}: ${found.detail}` : found.detail);
  } catch (error) {
    complain(String(error));
  }
  button.disabled = false;
  return undefined;
});

for (const box of form.querySelectorAll(".preset")) {
  const details = box.querySelector("details");
  const tick = box.querySelector("input[name=preset]");
  tick.checked = before.has(box.dataset.preset);
  details.addEventListener("toggle", () => details.open && parameters(box));
  if (Object.keys(before.get(box.dataset.preset) ?? {}).length) details.open = true;
}
write();
