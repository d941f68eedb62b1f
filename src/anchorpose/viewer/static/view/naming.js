// Saying who the patient is: a click on a person, in any frame.

import { getJson } from "./api.js";

export class PatientNamer {
  constructor({ view, playback, frames, corrections, signing, description, motion, elements, say }) {
    Object.assign(this, { view, playback, frames, corrections, signing, motion, elements, say, active: false });
    this.named = JSON.stringify(description.patient.named); // whom these results were tracked with
    elements.tracked.textContent = trackedInWords(description.patient.tracked);
    elements.start.disabled = !frames.points;
    elements.start.addEventListener("click", () => this.begin(!this.active));
    corrections.addEventListener("changed", () => this.show());
    this.show();
  }

  begin(on) {
    if (on && !this.frames.points) return this.say("Start the viewer with the recording to click on a person.");
    this.active = on;
    this.playback.pause();
    this.elements.start.setAttribute("aria-pressed", String(on));
    this.view.canvas.style.cursor = on ? "crosshair" : "";
    return this.say(on ? "Click on the trunk of the patient." : "");
  }

  /** The server says where the pixel under a click lies in the world, or why it is nobody. */
  async clicked(x, y) {
    const found = this.frames.points.pickPixel(x, y), { position } = this.playback, frame = this.motion.frame[position];
    if (!found) return this.say("Nothing that is shown is here; click on the trunk of a person.");
    const { camera, column, row } = found;
    try {
      const { position_m: place, why } = await getJson(`place?${new URLSearchParams({ position, camera, column, row })}`);
      if (!place) return this.say(why);
      this.begin(false);
      const signed = await this.signing.ask(`The patient is at ${inWords(place)} in frame ${frame}`);
      return signed ? this.corrections.add({ frame, position_m: place, ...signed }) : undefined;
    } catch (error) {
      return this.say(error.message);
    }
  }

  show() {
    const { patient } = this.corrections.held;
    const next = JSON.stringify(patient) === this.named ? "These results follow this person." : "Track again to follow this person.";
    this.elements.state.textContent = patient
      ? `The patient was named: the person at ${inWords(patient.position_m)} in frame ${patient.frame}. ${next}`
      : "If another person than the patient was tracked, go to a frame that shows the patient well, and click on the patient.";
  }
}

const inWords = ([x, , z]) => `x ${x.toFixed(2)}, z ${z.toFixed(2)} m`;

/** Who was tracked and why, and who else may be the patient. */
function trackedInWords(tracked) {
  if (!tracked) return "";
  const { frame, xz_m: [x, z], reason, rival_xz_m: rival } = tracked;
  const doubt = rival ? ` The person at ${inWords([rival[0], 0, rival[1]])} may be the patient as well.` : "";
  return `Tracked: the person at ${inWords([x, 0, z])} in frame ${frame}, who ${reason}.${doubt}`;
}
