// Intervals marked, joints corrected, the patient named: sent at once, kept in step with the file, listed, withdrawn.

import { getJson, postJson } from "./api.js";

export class Corrections extends EventTarget {
  constructor(description, motion, playback, signing, elements, say) {
    super();
    Object.assign(this, { description, motion, playback, signing, elements, say });
    this.held = { unusable: [], joints: [], patient: null };
    this.open = { first: null, last: null };
    this.done = []; // in this session, for undo
    elements.markIn.addEventListener("click", () => this.mark("first"));
    elements.markOut.addEventListener("click", () => this.mark("last"));
    elements.markSave.addEventListener("click", () => this.saveInterval());
    elements.undo.addEventListener("click", () => this.undo());
  }

  async load() { this.take(await getJson("corrections")); }

  take(held) {
    this.held = held;
    this.list();
    this.changed();
  }

  changed() {
    this.elements.undo.disabled = !this.done.length;
    this.elements.markState.textContent = this.openInWords();
    this.dispatchEvent(new Event("changed"));
  }

  openInWords() {
    const named = (row) => row === null ? "…" : `frame ${this.motion.frame[row]}`;
    const { first, last } = this.open;
    return first === null && last === null ? "Set both ends, then mark the interval." : `From ${named(first)} to ${named(last)}.`;
  }

  mark(end) {
    this.open[end] = this.playback.position;
    this.changed();
    this.say(this.openInWords());
  }

  async saveInterval() {
    const { first, last } = this.open;
    if (first === null || last === null) return this.say("Set both ends first: I at the first frame, O at the last.");
    const [from, to] = [Math.min(first, last), Math.max(first, last)];
    this.playback.pause();
    const signed = await this.signing.ask(`Unusable: frames ${this.motion.frame[from]} to ${this.motion.frame[to]}`);
    if (!signed) return undefined;
    this.open = { first: null, last: null };
    return this.add({ first_frame: this.motion.frame[from], last_frame: this.motion.frame[to], ...signed });
  }

  async add(entry) {
    const newest = ({ unusable, joints, patient }) => ("joint" in entry ? joints.at(-1) : "first_frame" in entry ? unusable.at(-1) : patient);
    try {
      const { refused, ...held } = await postJson("corrections/add", { ...entry, replaces: this.replacedBy(entry) });
      if (!refused) this.done.push(newest(held));
      this.take(held);
      this.say(refused ?? "Saved.");
      return !refused;
    } catch (error) {
      this.say(error.message);
      this.changed();
      return false;
    }
  }

  /** The correction that an entry replaces, as far as this page knows; null for none. */
  replacedBy(entry) {
    const { joints, patient } = this.held;
    if ("joint" in entry) return joints.find(({ frame, joint }) => frame === entry.frame && joint === entry.joint) ?? null;
    return "position_m" in entry ? patient : null;
  }

  async takeBack(entry) {
    const signed = await this.signing.ask("Withdraw this correction", false);
    if (!signed) return;
    try {
      this.take(await postJson("corrections/take-back", { entry, who: signed.who }));
      this.done = this.done.filter((other) => JSON.stringify(other) !== JSON.stringify(entry));
      this.changed();
      const earlier = "joint" in entry
        ? this.held.joints.some((old) => old.frame === entry.frame && old.joint === entry.joint)
        : "position_m" in entry && this.held.patient !== null;
      this.say(earlier ? "Withdrawn; the earlier correction holds again." : "Withdrawn; the file keeps a note of it.");
    } catch (error) {
      this.say(error.message);
    }
  }

  undo() {
    const last = this.done[this.done.length - 1];
    if (last) this.takeBack(last);
  }

  /** Corrected joints of the frame shown: [{joint, position_m, ...}]. */
  jointsAt(position) {
    const frame = this.motion.frame[position];
    return this.held.joints.filter((entry) => entry.frame === frame);
  }

  /** The place of the patient who was named in the frame shown, as ``jointsAt``: none or one. */
  patientAt(position) {
    const { patient } = this.held;
    return patient?.frame === this.motion.frame[position] ? [{ ...patient, sigma_m: 0 }] : [];
  }

  list() {
    const { patient } = this.held;
    const rows = [
      ...(patient ? [{ entry: patient, frame: patient.frame, time: patient.time_s, text: `the patient is here: ${patient.reason}` }] : []),
      ...this.held.unusable.map((entry) => ({ entry, frame: entry.first_frame, time: entry.start_s,
        text: `unusable to ${this.seconds(entry.end_s)} s: ${entry.reason}` })),
      ...this.held.joints.map((entry) => ({ entry, frame: entry.frame, time: entry.time_s, text: `${entry.joint}: ${entry.reason}` })),
    ].sort((a, b) => a.time - b.time);
    this.elements.list.replaceChildren(...rows.map((row) => this.item(row)));
    if (!rows.length) this.elements.list.textContent = "None so far.";
    this.elements.next.hidden = !rows.length;
  }

  seconds(time) { return (time - this.description.first_s).toFixed(2); }

  item({ entry, frame, time, text }) {
    const item = document.createElement("li"), go = document.createElement("button"), away = document.createElement("button");
    const stamp = Object.assign(document.createElement("time"), { textContent: `${this.seconds(time)} s ` });
    go.type = away.type = "button";
    go.append(stamp, `${text} (${entry.who})`);
    go.addEventListener("click", () => { this.playback.pause(); this.playback.seek(this.motion.frame.indexOf(frame)); });
    go.addEventListener("keydown", (event) => { if (event.key === "Delete") this.takeBack(entry); });
    away.textContent = "✕";
    away.setAttribute("aria-label", `Withdraw: ${text}`);
    away.addEventListener("click", () => this.takeBack(entry));
    item.append(go, away);
    return item;
  }
}

// Asks for the reason where one is needed, and once per session for the reviewer's initials.
export class Signing {
  constructor(dialog, who) {
    this.dialog = dialog;
    this.reason = dialog.querySelector("#sign-reason");
    this.name = dialog.querySelector("#sign-who");
    this.name.value = sessionStorage.getItem("who") ?? who;
    dialog.querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      if ((this.reason.value.trim() || !this.reason.required) && this.name.value.trim()) dialog.close("saved");
    });
  }

  get who() { return this.name.value.trim(); }

  /** {reason, who}, or null where the dialog is cancelled. */
  ask(title, reasonNeeded = true) {
    if (!reasonNeeded && this.who) return Promise.resolve({ reason: "", who: this.who });
    this.dialog.querySelector("#sign-title").textContent = title;
    this.reason.value = "";
    this.reason.required = reasonNeeded;
    this.reason.parentElement.hidden = !reasonNeeded;
    this.dialog.returnValue = "";
    this.dialog.showModal();
    (reasonNeeded ? this.reason : this.name).focus();
    return new Promise((resolve) => {
      this.dialog.addEventListener("close", () => {
        if (this.dialog.returnValue !== "saved") return resolve(null);
        sessionStorage.setItem("who", this.who);
        return resolve({ reason: this.reason.value.trim(), who: this.who });
      }, { once: true });
    });
  }
}
