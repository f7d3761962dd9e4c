// Buttons for a second finger: browsers make clicks of the first one only, and that one may hold to run.

// A browser that makes a click of it all the same makes it within this time [ms].
const SAME_MS = 600;

export function touch(root, apart) {
  let down = null;
  let pressed = null;
  const button = (event) => {
    const found = event.target.closest?.("button");
    return event.pointerType === "touch" && !event.isPrimary && found && !apart.includes(found) ? found : null;
  };
  root.addEventListener("pointerdown", (event) => { down = button(event) ?? down; });
  root.addEventListener("pointerup", (event) => {
    const found = button(event);
    const over = document.elementFromPoint(event.clientX, event.clientY);
    if (!found || found !== down || !found.contains(over)) return;
    down = null;
    found.click();
    pressed = { found, at: performance.now() };
  });
  root.addEventListener("click", (event) => {
    const again = event.isTrusted && pressed?.found.contains(event.target) && performance.now() - pressed.at < SAME_MS;
    if (again) { event.preventDefault(); event.stopImmediatePropagation(); }
  }, true);
}
