// The viewer's page: reads the tables, puts the parts together, draws.

import { getArrays, getJson } from "./api.js";
import { Axis } from "./axis.js";
import { Corrections, Signing } from "./corrections.js";
import { Curves } from "./curves.js";
import { Frames, animate } from "./frames.js";
import { keyTable, listKeys, listen } from "./keys.js";
import { JointMover } from "./moving.js";
import { PatientNamer } from "./naming.js";
import { JointCard, WorstList, layerList, layersOf, presetButtons, presetsOf, tabs } from "./panels.js";
import { Playback } from "./playback.js";
import { Rows } from "./chunks.js";
import { View, middleOf } from "./scene.js";
import { Hypotheses } from "./spots.js";
import { Timeline } from "./timeline.js";
import { transport } from "./transport.js";

const element = (id) => document.getElementById(id);

const say = (sentence) => { element("status").textContent = sentence; };

async function start() {
  const [description, { arrays: motion, meta }] = await Promise.all([getJson("description"), getArrays("overview")]);
  const rows = new Rows(description.frames, say);
  await rows.begin();
  document.title = `${description.name}: anchorpose viewer`;
  element("title").textContent = description.name;
  element("subtitle").textContent = `of ${description.recording}, ${description.frames} frames`;
  element("time-origin").textContent = `Times: seconds since the first ${description.first_s_is_known ? "" : "tracked "}frame of the recording.`;
  const seconds = (position) => motion.time_s[position] - description.first_s;
  const playback = new Playback(motion.time_s), view = new View(element("scene"), ...middleOf(meta));
  const frames = new Frames(description, rows, view, playback, say);
  const signing = new Signing(element("sign"), description.who);
  const corrections = new Corrections(description, motion, playback, signing, {
    markIn: element("mark-in"), markOut: element("mark-out"), markSave: element("mark-save"), markState: element("mark-state"),
    undo: element("undo"), list: element("corrections"), next: element("corrections-next"),
  }, say);
  element("corrections-file").textContent = `Saved at once in ${description.corrections_file}.`;
  element("corrections-command").replaceChildren(...["anchorpose", "track", `"${description.recording}"`, "-o", "NEW-RESULTS",
    "--corrections", `"${description.corrections_file}"`].flatMap((word) => [Object.assign(document.createElement("span"), { textContent: word }), " "]));
  const axis = new Axis(motion.time_s, playback);
  const curves = new Curves(element("charts"), description, { motion, rows, axis, playback, say });
  const timeline = new Timeline(element("timeline"), description, motion, axis, playback, corrections);
  const card = new JointCard(element("joint-card"), description, frames.skeleton, rows, playback);
  let mover = null;
  const redraw = () => {
    const corrected = corrections.jointsAt(playback.position);
    frames.set();
    frames.setCorrected([...corrected, ...corrections.patientAt(playback.position), ...(mover?.draft ? [mover.draft] : [])]);
    card.show(corrected.find(({ joint }) => joint === description.joints[frames.skeleton.chosen]));
  };
  const layers = layerList(element("layer-list"), layersOf(description), () => frames.show(layers.state));
  frames.show(layers.state);
  await frames.loadOnce();
  mover = new JointMover({
    view, playback, skeleton: frames.skeleton, rows, points: frames.points, corrections, signing, description, motion, say, redraw,
    elements: Object.fromEntries(["select", "edit", "snap", "moving", "moved", "sigma", "save", "cancel"].map((name) => [name, element(`joint-${name}`)])),
  });
  const namer = new PatientNamer({
    view, playback, frames, corrections, signing, description, motion, say,
    elements: { start: element("name-start"), state: element("name-state"), tracked: element("name-tracked") },
  });
  const worst = new WorstList([
    { list: element("unexplained"), worst: description.unexplained ?? [], numbered: true, nothing: "The body explains every frame." },
    { list: element("worst"), worst: description.worst, nothing: "Nothing stands out." },
  ], seconds, playback, (joint) => { if (joint !== null) mover.choose(joint); });
  element("unexplained-box").hidden = !description.unexplained;
  const hypotheses = new Hypotheses(view, playback, motion, {
    start: element("hypotheses-start"), cancel: element("hypotheses-cancel"), state: element("hypotheses-state"), legend: element("hypotheses-legend"),
  }, say);
  element("hypotheses-start").disabled = !description.has.recording;
  view.scene.add(hypotheses.group);
  const showTab = tabs(document.querySelector("[role=tablist]"), (id) => { if (id === "tab-curves") curves.draw(); });
  timeline.chosen = (i) => { showTab("tab-check"); worst.go(i); };
  const presets = presetsOf(description, view);
  presetButtons(element("presets"), presets);
  const keys = keyTable({ playback, layers, layerKeys: layersOf(description), presets, view, worst, corrections, mover, namer, hypotheses, showTab, help });
  listKeys(element("key-list"), keys);
  listen(keys, () => document.querySelector("dialog[open]") !== null);
  transport(playback, () => {
    const time = seconds(playback.position);
    return { clock: `${time.toFixed(2)} of ${seconds(playback.last).toFixed(2)} s, frame ${motion.frame[playback.position]}`, spoken: `frame ${motion.frame[playback.position]}, ${time.toFixed(2)} seconds` };
  });
  element("worst-next").addEventListener("click", () => worst.next(1));
  element("span").addEventListener("change", (event) => axis.setSpan(Number(event.target.value)));
  canvasClicks(view, frames, rows, mover, namer);
  for (const button of document.querySelectorAll("[data-close]")) button.addEventListener("click", () => button.closest("dialog").close());
  element("help-button").addEventListener("click", help);
  notices(description);
  playback.addEventListener("moved", () => { redraw(); say(frames.problems().join(" ")); });
  rows.addEventListener("arrived", () => { redraw(); curves.move(); });
  corrections.addEventListener("changed", redraw);
  await corrections.load();
  window.anchorpose = { playback, view, frames, mover, namer, corrections, hypotheses, motion, rows, curves, timeline, description };
  animate(frames, say, () => element("status").textContent);
  document.documentElement.dataset.ready = "yes";
}

/** A click that did not turn the view selects the joint under it, puts the joint being moved on the surface, or names the patient. */
function canvasClicks(view, frames, rows, mover, namer) {
  let down = null;
  view.canvas.addEventListener("pointerdown", (event) => { down = [event.offsetX, event.offsetY]; });
  view.canvas.addEventListener("pointerup", ({ offsetX: x, offsetY: y }) => {
    if (!down || Math.hypot(x - down[0], y - down[1]) > 4) return;
    if (namer.active) namer.clicked(x, y);
    else if (mover.snapping) mover.clicked(x, y);
    else if (!mover.active) mover.choose(nearestJoint(view, rows.at(frames.playback.position)?.joints ?? [], x, y));
  });
}

function nearestJoint(view, joints, x, y) {
  let best = null, nearest = 16;
  for (let i = 0; i < joints.length / 3; i++) {
    const seen = Number.isNaN(joints[3 * i]) ? null : view.project(joints.subarray(3 * i, 3 * i + 3));
    const away = seen ? Math.hypot(seen[0] - x, seen[1] - y) : Infinity;
    if (away < nearest) [best, nearest] = [i, away];
  }
  return best;
}

function notices({ has }) {
  const notice = !has.recording
    ? "No recording was given: skeleton, body and curves only. Start the viewer with the recording to see the points."
    : !has.people ? "These results have no person labels, so all points have one colour. Track the recording again to separate the people." : "";
  element("notice").textContent = notice;
  element("notice").hidden = !notice;
}

function help() { element("help").showModal(); }

start().catch((error) => {
  element("notice").textContent = error.message;
  element("notice").hidden = false;
  throw error;
});
