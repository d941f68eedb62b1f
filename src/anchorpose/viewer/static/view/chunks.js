// Frames in chunks: fetched ahead of the play head, the least recently used dropped first.

import { getArrays } from "./api.js";

const MOST_AT_ONCE = 2, REST_MS = 2000; // after a failure

export class Chunks {
  /** load(first, count, signal): a promise of {meta, arrays, bytes}; arrived(): called when a chunk is there. */
  constructor({ load, frames, size, mostBytes, arrived, failed }) {
    Object.assign(this, { load, frames, size, mostBytes, arrived, failed });
    this.held = new Map(); // in the order of use
    this.underWay = new Map();
    this.bytes = 0;
    this.epoch = 0;
    this.restsUntil = 0;
  }

  /** The chunk that holds a frame, or null while it is fetched. */
  get(position) {
    const number = Math.floor(position / this.size);
    const chunk = this.held.get(number);
    if (!chunk) return null;
    this.held.delete(number);
    this.held.set(number, chunk);
    return { chunk, row: position - chunk.meta.first };
  }

  /** Fetches what is at the play head, then what comes next in the direction of play, and aborts the rest. */
  want(position, direction, ahead) {
    if (performance.now() < this.restsUntil) return;
    const now = Math.floor(position / this.size), last = Math.floor((this.frames - 1) / this.size);
    const wanted = [];
    for (let step = 0; step <= ahead; step++) wanted.push(now + direction * step);
    wanted.push(now - direction);
    const useful = wanted.filter((number) => number >= 0 && number <= last);
    for (const [number, control] of this.underWay) if (!useful.includes(number)) control.abort();
    for (const number of useful) {
      if (this.underWay.size >= MOST_AT_ONCE) return;
      if (!this.held.has(number) && !this.underWay.has(number)) this.fetch(number);
    }
  }

  async fetch(number) {
    const control = new AbortController(), epoch = this.epoch;
    this.underWay.set(number, control);
    try {
      const chunk = await this.load(number * this.size, this.size, control.signal);
      if (epoch === this.epoch) this.keep(number, chunk);
    } catch (error) {
      if (error.name !== "AbortError") this.failedOnce(error);
    } finally {
      if (this.underWay.get(number) === control) this.underWay.delete(number);
    }
    if (epoch === this.epoch) this.arrived();
  }

  /** Reports the error, and tries again after a while. */
  failedOnce(error) {
    this.restsUntil = performance.now() + REST_MS;
    setTimeout(() => this.arrived(), REST_MS + 50);
    this.failed(error);
  }

  keep(number, chunk) {
    this.held.set(number, chunk);
    this.bytes += chunk.bytes;
    for (const [oldest, old] of this.held) {
      if (this.bytes <= this.mostBytes || oldest === number) break;
      this.held.delete(oldest);
      this.bytes -= old.bytes;
    }
  }

  /** Drops everything: the request has changed. */
  clear() {
    this.epoch += 1;
    for (const control of this.underWay.values()) control.abort();
    this.underWay.clear();
    this.held.clear();
    this.bytes = 0;
  }
}

// The tables, some hundred frames at a time: what is read of a frame is exact, and only frames around it are in memory.
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
