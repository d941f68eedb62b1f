// The tabs at the side, the list of frames to check, the list of layers, the view buttons, the card of a joint.

export function tabs(bar, shown) {
  const all = [...bar.querySelectorAll("[role=tab]")];
  const choose = (tab, focus) => {
    for (const other of all) {
      const chosen = other === tab;
      other.setAttribute("aria-selected", String(chosen));
      other.tabIndex = chosen ? 0 : -1;
      document.getElementById(other.getAttribute("aria-controls")).hidden = !chosen;
    }
    if (focus) tab.focus();
    shown(tab.id);
  };
  all.forEach((tab, i) => {
    tab.addEventListener("click", () => choose(tab, false));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) { event.preventDefault(); choose(all[(i + step + all.length) % all.length], true); }
    });
  });
  return (id) => choose(document.getElementById(id), false);
}

/** groups: [{list, worst: [{position, reason, joint}], numbered, nothing}]: lists that are gone through one after the other. seconds(position): the time shown. */
export class WorstList {
  constructor(groups, seconds, playback, choose) {
    Object.assign(this, { playback, choose, at: -1, worst: groups.flatMap(({ worst }) => worst), buttons: [] });
    for (const { list, worst, numbered, nothing } of groups) {
      worst.forEach(({ position, reason }, i) => {
        const at = this.buttons.length, item = document.createElement("li"), button = Object.assign(document.createElement("button"), { type: "button" });
        if (numbered) button.append(Object.assign(document.createElement("b"), { textContent: i + 1 }));
        button.append(Object.assign(document.createElement("time"), { textContent: `${seconds(position).toFixed(2)} s` }), reason);
        button.addEventListener("click", () => this.go(at));
        item.append(button);
        list.append(item);
        this.buttons.push(button);
      });
      if (!worst.length) list.textContent = nothing;
    }
    playback.addEventListener("moved", () => this.mark());
  }

  next(step) {
    if (this.worst.length) this.go((this.at + step + this.worst.length + (this.at < 0 && step < 0 ? 1 : 0)) % this.worst.length);
  }

  go(i) {
    this.at = i;
    this.playback.pause();
    this.playback.seek(this.worst[i].position);
    this.choose(this.worst[i].joint);
    this.mark();
    this.buttons[i].scrollIntoView({ block: "nearest" });
  }

  mark() {
    this.buttons.forEach((button, i) => button.setAttribute("aria-current", String(i === this.at && this.worst[i].position === this.playback.position)));
  }
}

/** What can be shown, as the parts that these results and this recording have. */
export function layersOf({ has, equipment }) {
  const labelled = has.people;
  return [
    { name: "skeleton", label: "skeleton", key: "X", tint: "joint", on: true },
    { name: "body", label: "learnt body", key: "B", tint: "body", on: !has.recording, there: has.body },
    { name: "anchors", label: "anchors", key: "A", tint: "anchor", on: true, there: has.anchors },
    { name: "patient", label: "patient's points", key: "P", tint: "patient", on: true, there: labelled },
    { name: "room", label: "points", key: "R", tint: "room", on: true, there: has.recording && !labelled },
    { name: "others", label: "other people", key: "T", tint: "other", on: true, there: labelled },
    { name: "surface", label: "patient's surface", key: "F", tint: "patient", on: false, there: labelled },
    { name: "equipment", label: equipment ? "equipment" : "equipment's points", key: "Q", tint: "equipment", on: true, there: labelled || equipment },
    { name: "room", label: "room", key: "R", tint: "room", on: false, there: labelled },
  ].filter(({ there }) => there ?? true);
}

export function presetsOf({ cameras }, view) {
  const named = [["Front", "front"], ["Right side", "side"], ["Back", "back"], ["Top", "top"]].map(([label, name]) => ({ label, run: () => view.look(name) }));
  const own = cameras.filter(({ camera_to_world: pose }) => pose).map((camera) => ({ label: `Camera ${camera.name}`, run: () => view.lookFrom(camera) }));
  return [...named, ...own].slice(0, 9).map((preset, i) => ({ ...preset, key: String(i + 1) }));
}

/** layers: [{name, label, key, tint, on, missing}]; calls changed() after each change; returns {name: on} kept up to date. */
export function layerList(box, layers, changed) {
  const state = {}, boxes = {};
  for (const { name, label, key, tint, on } of layers) {
    const row = document.createElement("label"), check = document.createElement("input"), dot = document.createElement("i");
    check.type = "checkbox";
    check.checked = state[name] = on;
    check.addEventListener("change", () => { state[name] = check.checked; changed(name); });
    if (tint) dot.style.background = `var(--${tint})`; else dot.className = "none";
    row.append(check, dot, label, ...named(key));
    boxes[name] = check;
    box.append(row);
  }
  return { state, toggle: (name) => boxes[name]?.click() };
}

/** The name of a key on its button; nothing where there is no key. */
const named = (key) => (key ? [Object.assign(document.createElement("kbd"), { textContent: key })] : []);

export function presetButtons(box, presets) {
  box.append(...presets.map(({ label, key, run }) => {
    const button = Object.assign(document.createElement("button"), { type: "button" });
    button.append(`${label} `, ...named(key));
    button.addEventListener("click", run);
    return button;
  }));
}

export class JointCard {
  constructor(card, description, skeleton, rows, playback) {
    Object.assign(this, { card, description, skeleton, rows, playback });
  }

  show(corrected) {
    const joint = this.skeleton.chosen, row = this.rows.at(this.playback.position);
    this.card.hidden = joint === null || row === null;
    if (this.card.hidden) return;
    const { joints, sigma, states } = row;
    const place = Array.from(joints.subarray(3 * joint, 3 * joint + 3), (value) => value.toFixed(3)).join(", ");
    const lost = Number.isNaN(joints[3 * joint]);
    const rows = [["joint", this.description.joints[joint]], ["state", this.description.states[states[joint]].replaceAll("_", " ")]];
    if (!lost) rows.push(["x, y, z in m", place], ["sigma", `${(1000 * sigma[joint]).toFixed(0)} mm`]);
    if (corrected) rows.push(["corrected", corrected.who]);
    this.card.replaceChildren(...rows.flatMap(([name, value]) => [
      Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }),
    ]));
  }
}
