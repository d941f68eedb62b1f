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

/** A row of the table. */
export const key = (shown, does, run, press = shown, when = undefined) => ({ shown, does, run, press, when });

// Which key does what in the viewer.
export function keyTable({ playback, layers, layerKeys, presets, view, worst, corrections, mover, namer, hypotheses, showTab, help }) {
  const moving = () => mover.active;
  const nudges = { ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], PageUp: [0, 0, 1], PageDown: [0, 0, -1] };
  const arrows = ({ key: name, shiftKey }) => {
    if (moving()) mover.nudge(...(nudges[name] ?? [0, 0, 0]), shiftKey);
    else if (name === "ArrowLeft") playback.step(shiftKey ? -10 : -1);
    else if (name === "ArrowRight") playback.step(shiftKey ? 10 : 1);
  };
  const forward = () => {
    if (playback.playing && playback.direction > 0) playback.setSpeed(Math.min(2, playback.speed * 2)); else playback.play(1);
  };
  return [
    { title: "Time", keys: [
      key(["Space", "K"], "play, pause", () => playback.toggle()),
      key(["L"], "play; again: faster", forward),
      key(["J"], "play backwards", () => playback.play(-1)),
      key(["←", "→"], "one frame back, forward", arrows, ["ArrowLeft", "ArrowRight"]),
      key(["Shift", "←", "→"], "ten frames back, forward", arrows, ["Shift+ArrowLeft", "Shift+ArrowRight"]),
      key(["Home", "End"], "first, last frame", ({ key: name }) => playback.seek(name === "Home" ? 0 : playback.last)),
      key(["W"], "next frame to check", () => { showTab("tab-check"); worst.next(1); }),
      key(["Shift", "W"], "previous frame to check", () => { showTab("tab-check"); worst.next(-1); }, ["Shift+W"]),
    ] },
    { title: "View", keys: [
      key([`1 … ${presets.length}`], "front, side, back, top, depth cameras", ({ key: name }) => presets[Number(name) - 1].run(), presets.map((preset) => preset.key)),
      key(["Alt", "arrows"], "turn the view", ({ key: name }) => {
        const by = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 6], ArrowDown: [0, -6] }[name];
        view.turn(...by);
      }, ["Alt+ArrowLeft", "Alt+ArrowRight", "Alt+ArrowUp", "Alt+ArrowDown"]),
      key(["+", "−"], "closer, farther", ({ key: name }) => view.turn(0, 0, name === "-" ? 1.1 : 1 / 1.1), ["+", "-", "="]),
      ...layerKeys.map(({ name, label, key: letter }) => key([letter], label, () => layers.toggle(name))),
    ] },
    { title: "Check and correct", keys: [
      key(["H"], "hypotheses of this frame", () => { showTab("tab-check"); hypotheses.start(); }),
      key(["N"], "name the patient: click on the person", () => { showTab("tab-correct"); namer.begin(!namer.active); }),
      key(["I", "O"], "unusable: from here, to here", ({ key: name }) => { showTab("tab-correct"); corrections.mark(name.toUpperCase() === "I" ? "first" : "last"); }),
      key(["M"], "mark the interval", () => corrections.saveInterval()),
      key(["[", "]"], "select the previous, next joint", ({ key: name }) => mover.next(name === "]" ? 1 : -1)),
      key(["E"], "move the selected joint", () => { showTab("tab-correct"); mover.begin(); }),
      key(["arrows"], "while moving: by 5 mm as seen on the screen", arrows, ["ArrowUp", "ArrowDown", "PageUp", "PageDown"], moving),
      key(["Shift", "arrows"], "while moving: by 1 mm", arrows, ["Shift+ArrowUp", "Shift+ArrowDown", "Shift+PageUp", "Shift+PageDown"], moving),
      key(["S"], "while moving: put it on a point that you click", () => mover.snap(!mover.snapping), ["S"], moving),
      key(["Enter"], "save the joint", () => mover.save(), ["Enter"], moving),
      key(["Esc"], "cancel moving, naming", () => { if (moving()) mover.end(); else namer.begin(false); }, ["Escape"], () => moving() || namer.active),
      key(["Ctrl", "Z"], "undo the last correction", () => corrections.undo(), ["Ctrl+Z"]),
      key(["Del"], "on a correction in the list: withdraw it", () => {}, ["Delete"], () => false),
      key(["?"], "this list of keys", help),
    ] },
  ];
}
