// All keys in one table, which the help shows.

/** groups: [{title, keys: [{press: ["Space", "K"], shown, does, run}]}]; press: names as made by pressed(). */
export function listen(groups, blocked) {
  const known = new Map(groups.flatMap(({ keys }) => keys.flatMap((key) => key.press.map((name) => [name, key]))));
  addEventListener("keydown", (event) => {
    const key = known.get(pressed(event));
    if (!key || event.defaultPrevented || typing(event, pressed(event)) || blocked()) return;
    if (key.when && !key.when()) return;
    event.preventDefault();
    key.run(event);
  });
}

export function pressed(event) {
  const name = event.key === " " ? "Space" : event.key.length === 1 ? event.key.toUpperCase() : event.key;
  const named = event.key === "?" ? "?" : name;
  const parts = [];
  if (event.ctrlKey || event.metaKey) parts.push("Ctrl");
  if (event.altKey) parts.push("Alt");
  if (event.shiftKey && named !== "?" && named !== "+" && named !== "*") parts.push("Shift");
  return [...parts, named].join("+");
}

const OWN = { BUTTON: ["Space", "Enter"], SUMMARY: ["Space", "Enter"] };

/** Whether the focused element needs the key itself. */
function typing({ target }, name) {
  if (target.tagName === "INPUT" && target.type === "checkbox") return name === "Space";
  if (target.tagName === "INPUT" && target.type === "range") return false; // keys step through frames, whatever has the focus
  if (target.tagName === "INPUT") return true;
  if (target.tagName === "SELECT") return /^(Arrow|Home|End|Page|Space|Enter|.$)/.test(name);
  if (target.getAttribute("role") === "tab") return ["ArrowLeft", "ArrowRight", "Space", "Enter"].includes(name);
  return OWN[target.tagName]?.includes(name) ?? false;
}

export function listKeys(box, groups) {
  box.replaceChildren(...groups.map(({ title, keys }) => {
    const group = document.createElement("div"), list = document.createElement("dl");
    for (const { shown, does } of keys) {
      const name = document.createElement("dt"), meaning = document.createElement("dd");
      shown.forEach((text, i) => name.append(i ? " " : "", Object.assign(document.createElement("kbd"), { textContent: text })));
      meaning.textContent = does;
      list.append(name, meaning);
    }
    group.append(Object.assign(document.createElement("h3"), { textContent: title }), list);
    return group;
  }));
}
