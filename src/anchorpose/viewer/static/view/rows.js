// The tables, some hundred frames at a time: what is read of a frame is exact, and only frames around it are in memory.

import { getArrays } from "./api.js";
import { Chunks } from "./chunks.js";

const FRAMES = 512, MOST_BYTES = 96 * 1024 * 1024;

export class Rows extends EventTarget {
  constructor(frames, say) {
    super();
    this.chunks = new Chunks({
      load: (first, count, signal) => getArrays("motion", { first, count }, signal), frames, size: FRAMES, mostBytes: MOST_BYTES,
      arrived: () => this.dispatchEvent(new Event("arrived")), failed: (error) => say(error.message),
    });
  }

  /** Fetches the first frames; the page begins with them. */
  begin() { return this.chunks.fetch(0); }

  /** Fetches what is at the play head, and what comes next. */
  want(position, direction) { this.chunks.want(position, direction, 1); }

  /** What the tables have of a frame, as in motion_payload; null while it is fetched. */
  at(position) {
    const held = this.chunks.get(position);
    if (!held) return null;
    const part = (name) => {
      const all = held.chunk.arrays[name], size = all ? all.length / all.shape[0] : 0;
      return all?.subarray(size * held.row, size * (held.row + 1));
    };
    return {
      joints: part("joints"), sigma: part("sigma"), states: part("state"), poses: part("poses"), anchors: part("anchors"),
      angles: part("angles"), angleSigma: part("angle_sigma"), angleState: part("angle_state"),
    };
  }
}
