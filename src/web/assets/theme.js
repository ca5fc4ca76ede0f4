// Before anything is drawn: the scheme that was chosen on this machine, if any. Not a module, so that no page flashes.
try {
  const theme = localStorage.getItem("theme");
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
} catch {
  // Storage may be forbidden; the system's scheme is then used.
}
