// What the screen shows of a frame: all layers; points and surface as soon as they have arrived.

import { getArrays } from "./api.js";
import { Chunks } from "./chunks.js";
import { BodyLayer } from "./body.js";
import { SurfaceLayer, equipmentLayer } from "./meshes.js";
import { Pace } from "./playback.js";
import { PointLayer } from "./points.js";
import { DotLayer, SkeletonLayer } from "./skeleton.js";

// frames in a chunk, and chunks fetched ahead while playing and while there is time
const FRAMES = 8, AHEAD = 4, AHEAD_AT_REST = 12, MOST_BYTES = 384 * 1024 * 1024;

export class Frames {
  constructor(description, rows, view, playback, say) {
    Object.assign(this, { description, rows, view, playback });
    const frames = description.frames, chunked = (name, query) => new Chunks({
      load: (first, count, signal) => getArrays(name, { first, count, ...query() }, signal),
      frames, size: FRAMES, mostBytes: MOST_BYTES, arrived: () => this.set(), failed: (error) => say(error.message),
    });
    this.skeleton = new SkeletonLayer(description, rows, view);
    this.anchors = description.has.anchors ? new DotLayer(description.anchors.length, view, "anchor", 11) : null;
    this.corrected = new DotLayer(description.joints.length + 2, view, "cursor", 12);
    view.scene.add(this.skeleton.group, this.corrected.points);
    if (this.anchors) view.scene.add(this.anchors.points);
    this.shown = {};
    if (!description.has.recording) return;
    this.pictures = chunked("points", () => ({ room: this.shown.room ? 1 : 0 }));
    this.sheets = chunked("surface", () => ({}));
    this.surface = new SurfaceLayer(view);
    view.scene.add(this.surface.mesh);
    if (description.equipment) view.scene.add(this.equipment = equipmentLayer(description.equipment, view));
  }

  /** Fetches what is needed once, but not for the first picture. */
  async loadOnce() {
    if (this.description.has.recording) {
      this.points = new PointLayer(this.description, await getArrays("rays"), this.view);
      this.view.scene.add(this.points.group);
    }
    if (this.description.has.body) {
      this.body = new BodyLayer(await getArrays("body"), this.rows, this.view);
      this.view.scene.add(this.body.mesh);
    }
    this.set();
  }

  show(shown) {
    if (this.pictures && shown.room !== this.shown.room) this.pictures.clear();
    this.shown = { ...shown };
    this.set();
  }

  set() {
    const { position, direction, playing } = this.playback, { shown } = this, row = this.rows.at(position);
    this.rows.want(position, playing ? direction : 1);
    this.skeleton.group.visible = Boolean(shown.skeleton);
    this.skeleton.set(position);
    if (this.equipment) this.equipment.visible = shown.equipment;
    if (this.body) {
      this.body.set(position);
      this.body.mesh.visible &&= shown.body;
    }
    if (this.anchors) {
      this.anchors.points.visible = shown.anchors;
      this.anchors.set(this.anchorDots(row));
    }
    const clouds = shown.patient || shown.others || shown.equipment || shown.room;
    this.missing = !this.setPart(this.pictures, this.points, clouds, position, playing ? direction : 1);
    this.missing ||= row === null;
    if (this.points) this.points.show(shown);
    if (this.surface) this.missing = !this.setPart(this.sheets, this.surface, shown.surface, position, playing ? direction : 1) || this.missing;
    this.view.invalidate();
  }

  setPart(chunks, layer, wanted, position, direction) {
    if (!chunks || !layer) return true;
    const held = wanted ? chunks.get(position) : null;
    layer.set(held);
    if (wanted) chunks.want(position, direction, this.playback.playing ? AHEAD : AHEAD_AT_REST);
    return !wanted || held !== null;
  }

  /** The problems of the depth images of the frame shown, one sentence each. */
  problems() {
    const held = this.pictures?.get(this.playback.position);
    return held ? held.chunk.meta.problems[held.row] : [];
  }

  anchorDots(row) {
    return this.description.anchors.map((_, i) => {
      const place = row?.anchors.subarray(4 * i, 4 * i + 3);
      return !place || Number.isNaN(place[0]) ? null : { place, shape: 2, radius: 5 };
    });
  }

  setCorrected(entries) {
    const dots = entries.map(({ position_m: place, sigma_m: sigma }) => ({ place, shape: 2, radius: 7, halo: 1.96 * sigma }));
    this.corrected.set(dots);
    this.view.invalidate();
  }
}

const LOADING = "Loading … (the very first surface takes a few seconds more)", PATIENCE_MS = 700;

/** Plays and draws from now on; says so where what belongs on the screen does not come. said(): what was said last. */
export function animate(frames, say, said) {
  const { playback, view } = frames;
  const pace = new Pace(playback, (share) => { if (frames.points) { frames.points.detail = share; frames.set(); } });
  let waiting = null; // since when something has been missing
  const draw = (now) => {
    playback.tick(now);
    pace.tick(now);
    view.draw();
    if (!frames.missing) {
      if (waiting !== null && said() === LOADING) say("");
      waiting = null;
    } else if ((waiting ??= now) < now - PATIENCE_MS) say(LOADING);
    requestAnimationFrame(draw);
  };
  requestAnimationFrame(draw);
}
