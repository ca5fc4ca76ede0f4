// The forms of new jobs: parameters of the recipes that are ticked, the request that a form amounts to, and its sending.
// A control's name is its place in the request; what is not filled in, and what the request means anyway, is left out.

const { body: given, path, usual } = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const form = byId("job");
const recipes = byId("recipes");
const knobs = byId("knobs");
const element = (name, properties, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

const at = (body, place) => place.split(".").reduce((found, name) => found?.[name], body);
const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** Puts a value at a place of the body; what is numbered is a list. */
function put(body, place, value) {
  const names = place.split(".");
  const last = names.pop();
  const inner = names.reduce((found, name, i) => (found[name] ??= /^\d+$/.test(names[i + 1] ?? last) ? [] : {}), body);
  inner[last] = value;
}

/** What was given of recipes, by id: the parameters that were changed. */
const before = new Map(((recipes && at(given, recipes.dataset.place)) ?? []).map((one) => (typeof one === "string" ? [one, {}] : [one.preset, one.parameters ?? {}])));

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

/** The recipes that are ticked, as short as the request takes them. */
function ticked() {
  const boxes = [...recipes.querySelectorAll(".preset")].filter((box) => box.querySelector("[data-tick=preset]").checked);
  return boxes.map((box) => {
    const [preset, changed] = [box.dataset.preset, overrides(box)];
    if (Object.keys(changed).length) return { preset, parameters: changed };
    return path === "/jobs" ? preset : { preset };
  });
}

/** The values of each knob that is turned: what was ticked of few, or written with commas. */
function turned() {
  const values = (box) => {
    const text = box.querySelector("input[type=text]");
    if (!text) return [...box.querySelectorAll("input:checked")].map(({ value: one }) => JSON.parse(one));
    const written = text.value.split(",").map((one) => one.trim()).filter(Boolean);
    return written.map((one) => (Number.isFinite(Number(one)) ? Number(one) : one));
  };
  return Object.fromEntries([...knobs.querySelectorAll("[data-knob]")].map((box) => [box.dataset.knob, values(box)]).filter(([, list]) => list.length));
}

/** A control's value; nothing where it says none. */
function value(input) {
  if (input.type === "checkbox") return input.checked || undefined;
  if (input.value === "") return undefined;
  return input.type === "number" ? Number(input.value) : input.value;
}

/** The request that the form amounts to. */
function request() {
  const raw = form.querySelector("textarea");
  if (raw) return JSON.parse(raw.value);
  const body = {};
  const lists = {};
  for (const input of form.elements) {
    if (!input.name || input.closest(".preset, .knob")) continue;
    if ("list" in input.dataset) (lists[input.name] ??= []).push(...(input.checked ? [input.value] : []));
    else if (value(input) !== undefined && !same(value(input), at(usual, input.name))) put(body, input.name, value(input));
  }
  for (const [place, list] of Object.entries(lists)) if (!same(list, at(usual, place))) put(body, place, list);
  const places = [[recipes, ticked], [knobs, turned]].filter(([box]) => box);
  for (const [box, found] of places) if (!same(found(), at(usual, box.dataset.place))) put(body, box.dataset.place, found());
  return body;
}

/** How many settings or cells it makes. */
function count() {
  if (!byId("count")) return;
  const n = (selector) => form.querySelectorAll(selector).length;
  const n_recipes = n("[data-tick=preset]:checked");
  if (knobs) {
    byId("count").textContent = Object.values(turned()).reduce((product, list) => product * list.length, n_recipes);
    return;
  }
  const isQuick = form.elements["stress.quick"].checked;
  const chosen = [...form.querySelectorAll("#hazards input:checked")];
  const all = [...form.querySelectorAll("#hazards [data-family]")];
  const families = new Set(chosen.filter(({ dataset }) => "family" in dataset).map((input) => input.value));
  const counted = chosen.filter((input) => "family" in input.dataset || !families.has(input.value.split(".")[0]));
  const n_hazards = (chosen.length ? counted : all).reduce((sum, { dataset }) => sum + Number(chosen.length || !isQuick ? dataset.n : dataset.quick), 0);
  byId("count").textContent = n_hazards * (n_recipes || n("[data-tick=preset]")) * n("[name='stress.precisions']:checked") * n("[name='stress.guards']:checked");
}

function write() {
  let text;
  try {
    text = JSON.stringify(request(), null, 2).replaceAll("'", "'\\''");
  } catch (error) {
    return complain(`The request is no JSON: ${error.message}`);
  }
  complain("");
  byId("curl").textContent = `curl ${location.origin}/api/v1${path} -H 'content-type: application/json' -d '${text}'`;
  return count();
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
  const button = form.querySelector("button.main");
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
  box.querySelector("[data-tick=preset]").checked = before.has(box.dataset.preset);
  details.addEventListener("toggle", () => details.open && parameters(box));
  if (Object.keys(before.get(box.dataset.preset) ?? {}).length) details.open = true;
}
write();
