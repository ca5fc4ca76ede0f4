// On every page: the colour scheme, and views that were saved in this browser. A view is its address.

const VIEWS = "views";
const THEMES = { auto: "As the system", light: "Light", dark: "Dark" };

const element = (name, properties, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

const read = () => {
  try {
    const views = JSON.parse(localStorage.getItem(VIEWS) ?? "[]");
    return Array.isArray(views) ? views.filter((view) => typeof view?.name === "string" && view.href?.startsWith("/")) : [];
  } catch {
    return [];
  }
};
const write = (views) => localStorage.setItem(VIEWS, JSON.stringify(views));
const here = () => location.pathname + location.search + location.hash;

function views(menu) {
  const list = element("ul", {});
  let shown;
  const show = () => {
    const saved = read();
    // A row that is made anew under the pointer takes no click.
    if (JSON.stringify(saved) === shown) return;
    shown = JSON.stringify(saved);
    const row = (view, i) =>
      element(
        "li",
        {},
        element("a", { href: view.href, textContent: view.name }),
        element("button", {
          type: "button",
          textContent: "×",
          ariaLabel: `Forget ${view.name}`,
          onclick: () => (write(read().filter((_, at) => at !== i)), show()),
        }),
      );
    list.replaceChildren(...saved.map(row));
    if (!saved.length) list.append(element("li", { className: "muted", textContent: "None yet." }));
  };
  const name = element("input", { type: "text", required: true, maxLength: 60, ariaLabel: "Name of the view" });
  const form = element("form", {}, name, element("button", { textContent: "Save this view" }));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    write([...read().filter((view) => view.name !== name.value), { name: name.value, href: here() }]);
    show();
  });
  menu.addEventListener("toggle", () => {
    if (!menu.open) return;
    name.value = document.title.split(" · ")[0];
    show();
  });
  menu.append(element("div", { className: "sheet" }, element("b", { textContent: "Saved views" }), list, form));
  // Before it is opened too, so that nothing moves under the pointer just after.
  show();
}

function theme() {
  const select = element("select", { ariaLabel: "Colours", id: "theme" });
  for (const [value, text] of Object.entries(THEMES)) select.append(element("option", { value, textContent: text }));
  select.value = document.documentElement.dataset.theme ?? "auto";
  select.addEventListener("change", () => {
    if (select.value === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = select.value;
    try {
      localStorage.setItem("theme", select.value);
    } catch {
      // Then it holds for this page.
    }
    dispatchEvent(new Event("themechange"));
  });
  return select;
}

const menu = element("details", { className: "menu", id: "views" }, element("summary", { textContent: "Views" }));
views(menu);
const place = document.querySelector(".top .tools");
place.append(menu, theme());
addEventListener("click", (event) => {
  for (const open of document.querySelectorAll("details.menu[open], details.pick[open]")) {
    if (!open.contains(event.target)) open.open = false;
  }
});
addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  for (const open of document.querySelectorAll("details.menu[open], details.pick[open]")) {
    open.open = false;
    open.querySelector("summary").focus();
  }
});
